"""X17: the certified oracle against a second way to the truth, and naive against the oracle."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

import tracers
from harness import models
from harness.adversaries import FAMILIES
from harness.adversaries.aim import rays_for
from harness.adversaries.walls import finite_bounds
from harness.oracle import ExactSolid, Verdict, judge_rays
from harness.oracle.check import check
from harness.stability import Findings, row
from harness.stability.scenes import GUARD, PRECISIONS, Tally

CHECKED = 100  # one ray in so many goes both ways
RAYS_PER_TREE = 150
MOST_LEAVES = 40  # of trees for the second way
PIXELS = 512  # of a side of ball's picture
SHARE_OF_BALL = 10  # one ray in so many
PROCESSES = 2


def judged(tally: Tally, solid: ExactSolid, rays: np.ndarray, precision: str) -> None:
    """Adds naive's hits on rays (N, 8) to the tally."""
    hits = tracers.make("naive", solid.tree, {"precision": precision}).trace(rays)
    judged = judge_rays(solid, rays, hits, precision, processes=PROCESSES)
    excused = judged.verdicts[Verdict.EXCUSED]
    tally.add(judged.rays, len(judged.unexcused), excused, judged.worst_error())


def from_outside(tree: tracers.CsgTree, rng: np.random.Generator, count: int) -> np.ndarray:
    """(count, 8) rays at what is delicate; starts on a surface would be excused."""
    lo, hi = finite_bounds(tree)
    rays = rays_for(tree, rng, 2 * count)
    outside = ((rays[:, :3] < lo) | (rays[:, :3] > hi)).any(axis=1)
    return rays[np.flatnonzero(outside)[:count]]


def trees(
    name: str, total: int, rng: np.random.Generator, aim: Callable, most: float = math.inf
) -> Iterator[tuple[tracers.CsgTree, np.ndarray]]:
    """Trees of a family with at most so many leaves, and rays that add up to about the total."""
    parts = -(-total // RAYS_PER_TREE)
    for part in range(parts):
        tree = FAMILIES[name](rng)
        while tree.halfspaces > most:
            tree = FAMILIES[name](rng)
        yield tree, aim(tree, rng, (total + part) // parts)


@row("X17", "the oracle checked, and naive against it", tests=20_000, full=1_000_000)
def oracle(rays: int, rng: np.random.Generator) -> Findings:
    few = max(rays // CHECKED // len(FAMILIES), 1)
    twice = Tally("X17", "the oracle, by exact roots and by bisection", "answers that differ")
    for name in FAMILIES:
        for tree, batch in trees(name, few, rng, rays_for, MOST_LEAVES):
            agreement = check(tree, batch)
            twice.add(agreement.rays, len(agreement.disagreeing), agreement.undecided)
    yield twice.finding()
    of_ball = rays // len(PRECISIONS) // SHARE_OF_BALL
    of_family = (rays // len(PRECISIONS) - of_ball) // len(FAMILIES)
    ball = ExactSolid.from_csg(models.csg("ball"), models.tree("ball"))
    pixels = models.scene("ball").view(PIXELS, PIXELS).primary_rays()
    for precision in PRECISIONS:
        for name in FAMILIES:
            tally = Tally("X17", f"{name}, {precision}", "surface error, E", GUARD)
            for tree, batch in trees(name, of_family, rng, from_outside):
                judged(tally, ExactSolid.from_tree(tree), batch, precision)
            yield tally.finding()
        tally = Tally("X17", f"pixels of ball, {precision}", "surface error, E", GUARD)
        chosen = rng.choice(len(pixels), min(of_ball, len(pixels)), replace=False)
        judged(tally, ball, pixels[chosen], precision)
        yield tally.finding()
