"""X17: the certified oracle against a second way to the truth, and naive against the oracle."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from multiprocessing import get_context

import numpy as np

import tracers
from harness import models
from harness.adversaries import FAMILIES
from harness.adversaries.aim import rays_for
from harness.adversaries.walls import finite_bounds
from harness.oracle.check import check
from harness.oracle.judge import U_DOUBLE, U_FLOAT, Judge, Judgement, Verdict
from harness.oracle.solid import Answer, Crossing, ExactSolid
from harness.stability import Findings, row
from harness.stability.scenes import BAND, EXCUSED_COSINE, GUARD, PRECISIONS, Tally

CHECKED = 100  # one ray in so many goes both ways
RAYS_PER_TREE = 150
MOST_LEAVES = 40  # of trees for the second way
PIXELS = 512  # of a side of ball's picture
SHARE_OF_BALL = 10  # one ray in so many
PROCESSES = 2


class RowJudge(Judge):
    """The oracle's judge with the tracers' own unit in float32, which keep the way to a primitive
    in double, and with two more excuses.

    An edge: the hit is on the right leaf, and from the true boundary to the hit the ray is nowhere
    farther than the guard from that leaf's surface. So it is where one face is hit and the next,
    grazed, is as near. A neighbour: the leaf is not the right one, but within the band, which is as
    far as rule 6 looks, the ray comes to that leaf's surface within the guard.
    """

    def __init__(self, solid: ExactSolid, answer: Answer, ray: np.ndarray, precision: str) -> None:
        super().__init__(solid, answer, ray, U_DOUBLE)
        self.single = U_FLOAT if precision == "float32" else 0.0
        self.least_cosine = EXCUSED_COSINE[precision]
        self.band += BAND * self.single * solid.tree.size / self.speed

    def unit(self, leaf: int) -> float:
        own = self.single * self.solid.reach[leaf] * self.solid.condition[leaf]
        return super().unit(leaf) + own

    def wide_band(self, crossing: Crossing) -> float:
        return self.band / max(self.cosine(crossing), self.least_cosine)

    def judge(self, t: float, leaf: int, normal: np.ndarray) -> Judgement:
        judgement, truth = super().judge(t, leaf, normal), self.answer.hit
        if judgement.verdict is Verdict.FLIP and truth is not None and leaf in self.answer.decisive:
            between = np.linspace(truth.t, t, 9)
            if all(abs(self.clearance(leaf, at)) <= GUARD for at in between):
                return Judgement(Verdict.EXCUSED, Verdict.FLIP, "edge")
        if judgement.verdict is Verdict.WRONG_LEAF:
            band = truth.t + np.linspace(0, 1, 65) * self.wide_band(truth)
            if any(abs(self.clearance(leaf, at)) <= GUARD for at in band):
                return Judgement(Verdict.EXCUSED, Verdict.WRONG_LEAF, "neighbour", judgement.error)
        return judgement


_shared: tuple = ()


def _share(*shared) -> None:
    global _shared
    _shared = shared


def _judge(task: tuple) -> tuple[Verdict, float]:
    solid, precision = _shared
    ray, t, leaf, normal = task
    judgement = RowJudge(solid, solid.answer(ray), ray, precision).judge(t, leaf, normal)
    return judgement.verdict, judgement.error


def judged(tally: Tally, solid: ExactSolid, rays: np.ndarray, precision: str) -> None:
    """Adds naive's hits on rays (N, 8) to the tally."""
    hits = tracers.make("naive", solid.tree, {"precision": precision}).trace(rays)
    tasks = list(zip(rays, hits.t.tolist(), hits.leaf.tolist(), hits.normal, strict=True))
    with get_context("fork").Pool(PROCESSES, _share, (solid, precision)) as pool:
        for verdict, error in pool.imap_unordered(_judge, tasks, chunksize=32):
            failed = verdict in (Verdict.FLIP, Verdict.WRONG_LEAF)
            worst = None if math.isnan(error) else error
            tally.add(1, failed, verdict is Verdict.EXCUSED, worst)


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
