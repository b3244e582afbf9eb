"""The loader: damaged files, and a million levels. Nothing crashes, hangs or recurses."""

import random
import re
import time
from pathlib import Path

import numpy as np
import pytest
from loader_text import IDENTITY, parse, refusal

import tracers
from harness.openscad import evaluate

# A real file, damaged. Each outcome is a tree or one line.

EVERY_KIND = """
difference() {
  color("red") union() { cube([1, 2, 3]); %sphere(1); #cylinder(r1 = 1, r2 = 0, h = 2); }
  translate([1, 2, 3]) rotate([10, 20, 30]) sphere(2);
  render() { cube(1); cylinder(h = 1, r = 2, $fn = 6); }
}
mirror([1, 1, 0]) rotate_extrude() translate([5, 1]) circle(2);
intersection() { cube(4); sphere(3); }
"""


@pytest.fixture(scope="module")
def real_file(tmp_path_factory) -> bytes:
    folder = tmp_path_factory.mktemp("fuzz")
    (folder / "m.scad").write_text(EVERY_KIND)
    evaluate(folder / "m.scad", folder / "m.csg")
    return (folder / "m.csg").read_bytes()


def survives(folder: Path, damaged: bytes) -> bool:
    """Whether it loads; if not, the refusal is one line with a place."""
    path = folder / "m.csg"
    path.write_bytes(damaged)
    try:
        tree = tracers.load_csg(str(path))
    except tracers.ModelError as error:
        line = str(error).removeprefix(str(path))
        assert re.fullmatch(r":\d+:\d+: [^\n]+|: the model is empty|: leaf \d+ [^\n]+", line), (
            line,
            damaged,
        )
        return False
    assert np.isfinite(tree.sizes).all()
    assert np.isfinite(tree.matrices).all()
    assert tree.nodes == 2 * tree.halfspaces - 1
    return True


def test_fuzz_truncations(tmp_path, real_file):
    assert survives(tmp_path, real_file)
    loaded = sum(survives(tmp_path, real_file[:n]) for n in range(len(real_file)))
    assert 0 < loaded < 20  # only where a top-level node has just ended


@pytest.mark.parametrize("seed", range(3))
def test_fuzz_bytes(tmp_path, real_file, seed):
    draw = random.Random(seed)
    alphabet = b'(){}[],;=!#%*"\\/.-+e0919nai\n\x00\xff'
    outcomes = set()
    for _ in range(1000):
        damaged = bytearray(real_file)
        for _ in range(draw.choice([1, 1, 2, 10])):
            at = draw.randrange(len(damaged))
            match draw.randrange(5):
                case 0:
                    damaged[at] ^= 1 << draw.randrange(8)
                case 1:
                    damaged[at] = draw.choice(alphabet)
                case 2:
                    damaged.insert(at, draw.choice(alphabet))
                case 3:
                    del damaged[at : at + draw.randrange(1, 30)]
                case 4:
                    damaged[at:at] = damaged[: draw.randrange(60)]
        outcomes.add(survives(tmp_path, bytes(damaged)))
    assert outcomes == {True, False}


@pytest.mark.parametrize("seed", range(3))
def test_fuzz_noise(tmp_path, seed):
    draw = random.Random(seed)
    words = [
        b"group",
        b"sphere",
        b"(",
        b")",
        b"{",
        b"}",
        b";",
        b"r",
        b"=",
        b"1",
        b"[",
        b"]",
        b",",
        b"%",
        b"\n",
        b'"',
        b" ",
    ]
    for length in range(300):
        assert not survives(tmp_path, draw.randbytes(length))
        survives(tmp_path, b"".join(draw.choices(words, k=length)))


# Depth and width.

MILLION = 1_000_000
DEEP = {
    "union, right-deep": (
        "union(){sphere(r=1);" * MILLION + "sphere(r=2);" + "}" * MILLION,
        MILLION + 1,
    ),
    "difference, left-deep": (
        "difference(){" * MILLION + "sphere(r=2);" + "sphere(r=1);}" * MILLION,
        MILLION + 1,
    ),
    "groups": ("group(){" * MILLION + "sphere(r=1);" + "}" * MILLION, 1),
    "multmatrix": (f"multmatrix({IDENTITY}){{" * MILLION + "sphere(r=1);" + "}" * MILLION, 1),
    "side by side": ("sphere(r=1);" * MILLION, MILLION),
    "circle in groups": (
        "rotate_extrude(){" + "group(){" * MILLION + "}" * MILLION + "}sphere(r=1);",
        1,
    ),
}


@pytest.mark.parametrize("shape", ["as_written", "balanced"])
@pytest.mark.parametrize("name", DEEP)
def test_a_million_levels_load(name, shape):
    text, halfspaces = DEEP[name]
    started = time.monotonic()
    tree = parse(text, shape)
    assert (tree.halfspaces, tree.nodes) == (halfspaces, 2 * halfspaces - 1)
    del tree
    assert time.monotonic() - started < 30


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "group(){" * MILLION,
            "m.csg:1:8000001: end of file, but the group of m.csg:1:7999993 is not closed",
        ),
        (
            "hull(" + "[" * MILLION + "]" * MILLION + ");",
            "m.csg:1:1: unsupported: hull",
        ),
        ("hull(" + "[" * MILLION, "m.csg:1:1000006: expected a value, found end of file"),
        (
            "hull(){" * MILLION + "}" * MILLION,
            f"m.csg:1:1: unsupported: hull (the first of {MILLION})",
        ),
        ("%" * MILLION, "m.csg:1:1000001: expected a node, found end of file"),
        ('import("' + '" ' * MILLION + "x", "m.csg:1:8: string without an end"),
    ],
)
def test_a_million_levels_that_are_refused(text, message):
    started = time.monotonic()
    assert refusal(text) == message
    assert time.monotonic() - started < 30
