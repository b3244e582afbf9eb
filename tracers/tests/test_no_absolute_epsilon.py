"""No absolute epsilon: what looks like one stands in error_unit.hpp, or here with a reason."""

import re
from pathlib import Path

import pytest

TRACERS = Path(__file__).parents[1]
SMALL = re.compile(r"(?<![\w.])(?:\d+\.?\d*e-\d+|0x[\d.]+p-\d+|0?\.0\d+|\d+\.?\d*f?e-\d+)(?!\w)")

# (file, literal): why it is none.
EXPLAINED = {
    ("structures/embree.hpp", "0x1p-19"): "of the world's size: Embree computes in float",
    ("primitives/torus.hpp", "0x1p-16"): "of Newton's step: when the next one is exact to rounding",
    ("primitives/torus.hpp", "0.0133598"): "a coefficient of a polynomial that fits a cosine",
    ("bench/kernels.cpp", "0x1p-20"): "of the radius: how near the benchmark's lines graze",
    ("packets/start.hpp", "0x1p-46"): "of a torus whose major radius is 1: rounding in double",
    ("packets/cell_maker.hpp", "0x1p-48"): "of the leaf, whose size is 1 there: rounding in double",
    ("packets/cell_maker.hpp", "0x1p-8"): "of the leaf, too: a float wrong by more is not asked",
    ("packets/build.hpp", "0x1p-4"): "of half a cell's side: the margin of what a tree holds for",
    ("packets/build.hpp", "0x1p-3"): "the same in float32",
    ("tracer.cpp", "0x1p-32"): "of a direction: which rays need not be scaled by a power of two",
}


def small_literals(text: str) -> list[str]:
    """Of C++ source, comments left out."""
    code = re.sub(r"//[^\n]*|/\*.*?\*/", "", text, flags=re.DOTALL)
    return SMALL.findall(code)


def test_every_small_literal_is_explained() -> None:
    found = {
        (str(path.relative_to(TRACERS)), literal)
        for path in sorted(TRACERS.rglob("*.?pp"))
        if path.name != "error_unit.hpp"
        for literal in small_literals(path.read_text())
    }
    assert found == set(EXPLAINED), "a tolerance belongs into error_unit.hpp"


@pytest.mark.parametrize(
    "line", ["if (t > 1e-9)", "x + 0x1p-20", "0.001 * y", "1.5e-7", "const double k = .0001;"]
)
def test_a_planted_epsilon_is_found(line: str) -> None:
    assert small_literals(line)


@pytest.mark.parametrize("line", ["0.5 * x", "// 1e-9", "vec3e-1", "2.0943951023931953", "1e9"])
def test_other_numbers_are_left_alone(line: str) -> None:
    assert not small_literals(line)
