"""X16: the same answers from any number of threads, and from builds for other instruction sets.

Another build differs in -march alone, and is asked in a process of its own, since one process loads
the extension module once.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import tracers
from harness import ROOT, UserError
from harness.adversaries.aim import rays_for
from harness.adversaries.families import random_solid
from harness.adversaries.walls import finite_bounds
from harness.stability import Findings, row
from harness.stability.build import build
from harness.stability.scenes import GUARD, PRECISIONS, Tally, error_unit

BUILT_FOR = re.search(r"-march=(\S+)", tracers.machine()["flags"])[1]
OTHERS = ("x86-64-v3", "x86-64-v4")
SEED = 16
FROM_FULL = 100_000  # rays from which the other builds are made: each takes a minute
RAYS_PER_SOLID = 50_000
SIDE = 160  # of a picture, pixels: several tiles, the last of each row cut
SCHEMES = ("naive", "hybrid_sdsm", "packet_sdsm", "embree_cells")


def runnable() -> list[str]:
    """Those of OTHERS that this processor runs, by the dynamic linker's word."""
    loader = next(Path("/lib64").glob("ld-linux-x86-64.so*"), None)
    if loader is None:
        return []
    told = subprocess.run([loader, "--help"], capture_output=True, text=True, check=False).stdout
    return [isa for isa in OTHERS if f"{isa} (supported" in told]


def view(tree: tracers.CsgTree, side: int) -> tracers.View:
    middle = finite_bounds(tree).mean(axis=0)
    eye = tuple(middle + 1.5 * tree.size * np.array([0.5, -0.7, 0.4]))
    lights = [(3.0, -9.0, 9.0, 0.7, 0.7, 0.7), (-9.0, -2.0, 5.0, 0.3, 0.3, 0.3)]
    return tracers.View(
        eye, tuple(middle), (0, 0, 1), 40, side, side,
        lights, (0.1, 0.1, 0.1), (0, 0, 0), (0.8, 0.8, 0.8),
    )  # fmt: skip


def scenes(count: int) -> Iterator[tuple[tracers.CsgTree, np.ndarray]]:
    """Solids and rays that every process makes anew, the same."""
    rng = np.random.default_rng(SEED)
    for _ in range(count):
        tree = random_solid(rng)
        yield tree, rays_for(tree, rng, RAYS_PER_SOLID)


def answers(count: int) -> Iterator[tuple[str, np.ndarray, np.ndarray, str]]:
    """Case, t (N,), leaf (N,) and the picture's hash, for each solid, precision and scheme."""
    for number, (tree, rays) in enumerate(scenes(count)):
        for precision in PRECISIONS:
            for scheme in SCHEMES:
                tracer = tracers.make(scheme, tree, {"precision": precision})
                hits = tracer.trace(rays)
                case = f"{number}/{precision}/{scheme}"
                yield case, hits.t, hits.leaf, tracer.render(view(tree, SIDE)).hash


def answers_of(module: Path, count: int) -> dict[str, np.ndarray]:
    """The same by another build: arrays "case:t", "case:leaf" and "case:hash"."""
    out = module.parent / "answers.npz"
    command = [sys.executable, "-c", _ASK, str(module), str(count), str(out)]
    ran = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    if ran.returncode:
        raise UserError(f"{module}: {ran.stderr.strip().splitlines()[-1]}")
    with np.load(out) as arrays:
        return dict(arrays)


_ASK = """
import sys
from pathlib import Path
from harness.stability import build
module, count, out = sys.argv[1:]
build.load(Path(module))
from harness.stability.instruction_sets import save
save(int(count), out)
"""


def save(count: int, out: str) -> None:
    arrays: dict[str, np.ndarray] = {"flags": np.array(tracers.machine()["flags"])}
    for case, t, leaf, digest in answers(count):
        arrays |= {f"{case}:t": t, f"{case}:leaf": leaf, f"{case}:hash": np.array(digest)}
    np.savez(out, **arrays)


def _other_build(isa: str, count: int) -> Findings:
    """Identical, or different only inside the guard: counted as excused."""
    theirs = answers_of(build(isa, isa=isa), count)
    if f"-march={isa}" not in str(theirs["flags"]):
        raise UserError(f"{isa}: the module was built with {theirs['flags']}")
    units = [{p: error_unit(tree, rays, p) for p in PRECISIONS} for tree, rays in scenes(count)]
    hits = Tally("X16", f"{isa} against {BUILT_FOR}", "distance, E", GUARD)
    pictures = Tally("X16", f"{isa} against {BUILT_FOR}, pictures", "other hashes")
    for case, t, leaf, digest in answers(count):
        number, precision, _ = case.split("/")
        other_t, other_leaf = theirs[f"{case}:t"], theirs[f"{case}:leaf"]
        both = np.isfinite(t) & np.isfinite(other_t)
        unit = units[int(number)][precision]
        off = np.abs(np.where(both, t, 0) - np.where(both, other_t, 0)) / unit
        unlike = (t != other_t) | (leaf != other_leaf)
        inside = both & (off <= GUARD) & (leaf == other_leaf)
        hits.add(len(t), (unlike & ~inside).sum(), (unlike & inside).sum(), off.max())
        other_picture = digest != str(theirs[f"{case}:hash"])
        pictures.add(
            SIDE * SIDE, other_picture and not unlike.any(), other_picture and unlike.any()
        )
    yield hits.finding()
    yield pictures.finding()


def _threads(count: int) -> Findings:
    """One build: the same hash from 1 to twice the number of processors."""
    most = 2 * (os.cpu_count() or 1)
    for precision in PRECISIONS:
        tally = Tally("X16", f"1 to {most} threads, {precision}", "other hashes")
        for tree, _ in scenes(count):
            for scheme in SCHEMES:
                tracer = tracers.make(scheme, tree, {"precision": precision})
                seen = view(tree, SIDE)
                expected = tracer.render(seen).hash
                for threads in range(1, most + 1):
                    got = tracer.render(seen, threads=threads).hash
                    tally.add(seen.width * seen.height, got != expected)
        yield tally.finding()


@row("X16", "instruction sets and threads", tests=50_000, full=1_000_000)
def builds(rays: int, rng: np.random.Generator) -> Findings:
    """The scenes do not depend on `rng`: other processes make them again."""
    count = max(rays // (RAYS_PER_SOLID * len(PRECISIONS)), 1)
    if rays >= FROM_FULL:
        for isa in runnable():
            yield from _other_build(isa, count)
    yield from _threads(min(count, 3))
