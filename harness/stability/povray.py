"""POV-Ray on the rows' own rays, beside ours: how often each fails, and by how much.

A failure is a hit where there is nothing, a miss where there is something, or a hit on another
surface than the first: so far off that rounding of doubles does not explain it. Rays within the
guard of where the answer changes are left out.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

import tracers
from harness import povray_rays
from harness.adversaries.families import random_solid
from harness.povray_scene import PovrayError
from harness.stability import torus
from harness.stability.exact import Long, Rays, at
from harness.stability.exact_torus import Torus
from harness.stability.invariance import EXPONENTS, scaled
from harness.stability.judged import leaf_tree, powers, unit
from harness.stability.layers import (
    CHAINS,
    FLUSH,
    PRIMITIVES,
    box_distance,
    box_spans,
    extended,
    parsed,
    surface_rays,
    two_ways,
)
from harness.stability.quadrics import backed
from harness.stability.scenes import GUARD, directions, error_unit, rays_through

RAYS = 100_000  # a case
ANOTHER = 2.0**24  # E: what lies farther off than 1e-9 of the size is another surface
EXTENT = 10.0  # of tori: what POV-Ray's tolerances are made for
WIDEST = 20.0  # R/r
TORI = 5  # a case
SOLIDS = 4


@dataclass(frozen=True)
class Peer:
    """The same rays by POV-Ray and by naive."""

    row: str
    case: str
    rays: int
    povray_failures: int
    our_failures: int
    povray_worst_E: float  # of the hits that are no failures
    our_worst_E: float


class _Count:
    def __init__(self) -> None:
        self.rays = 0
        self.failures, self.worst = [0, 0], [0.0, 0.0]

    def add(self, who: int, t: np.ndarray, there: np.ndarray, off: np.ndarray, E: np.ndarray):
        """t (N,), whether something is there, and the distance of the hit from it, model units."""
        hit = np.isfinite(t)
        close = hit & there & (off <= ANOTHER * E)
        self.failures[who] += int(((hit | there) & ~close).sum())
        self.worst[who] = max(self.worst[who], float((off / E)[close].max(initial=0)))

    def peer(self, row: str, case: str) -> Peer:
        return Peer(row, case, self.rays, *self.failures, *self.worst)


def compare(most: int = RAYS) -> list[Peer]:
    """At most so many rays a case, and no fewer than a thousand."""
    return list(_peers(max(1000, min(most, RAYS)), np.random.default_rng(0)))


def _peers(rays: int, rng: np.random.Generator) -> Iterator[Peer]:
    for aim in torus._AIMS:
        yield _torus(aim, rays, rng)
    for kind in PRIMITIVES:
        yield _nothing(kind, rays, rng)
    for case in FLUSH:
        yield _box(case, rays, rng)
    yield from _other_units(rays, rng)


def _both(tree: tracers.CsgTree, rays: np.ndarray, own_scale: bool = False) -> list[np.ndarray]:
    """t (N,) of POV-Ray and of naive. At a scale that is not of its liking, POV-Ray may stop with a
    message, such as `Unknown box side`; then it has hit nothing."""
    try:
        theirs = povray_rays.trace(tree, rays, own_scale)
    except PovrayError:
        if not own_scale:
            raise
        theirs = np.full(len(rays), np.inf)
    return [theirs, tracers.make("naive", tree).trace(rays).t]


def _torus(aim, rays: int, rng: np.random.Generator) -> Peer:
    """First hits of tori of POV-Ray's own scale; from 1 to 10 sizes away."""
    count = _Count()
    for _ in range(TORI):
        minor = 1 / powers(rng, 0, np.log10(WIDEST), ())
        one = Torus(*np.array([1, minor]) * EXTENT / 2 / (1 + minor))
        point, along = aim(rng, *one.size[:2], rays // TORI)
        lines = backed(rng, (point, unit(along)), one.radius, 1)
        of = Rays.of(*lines, one.radius, "float64")
        critical = one.critical_points(of.o, of.d)
        finite = np.isfinite(critical)
        places = np.where(finite, critical, 0)
        depth = np.stack([one.depth(at(of.o, of.d, s)) for s in places.T], axis=1)
        guard = GUARD * of.E[:, None]
        clear = (~finite | ((np.abs(depth) > guard) & (critical > 0))).all(axis=1)
        clear &= one.depth(of.o) > guard[:, 0]  # some would start in the tube's other side
        inside = np.where(finite & (depth < 0), critical, np.inf)
        first = inside.min(axis=1)  # a point behind the first boundary, before the second
        count.rays += int(clear.sum())
        for who, t in enumerate(_both(leaf_tree("torus", one.size), of.rows)):
            p = at(of.o, of.d, np.where(np.isfinite(t), t, 0).astype(Long))
            off = np.where(t < first, np.abs(one.depth(p)), np.inf).astype(float)
            count.add(who, t[clear], np.isfinite(first)[clear], off[clear], of.E[clear])
    return count.peer("X3", f"torus, {aim.__name__}")


def _nothing(kind: str, rays: int, rng: np.random.Generator) -> Peer:
    """A − A, the second reached through other decimals."""
    count = _Count()
    for chain in ("same text", *CHAINS):
        first, second = (PRIMITIVES[kind],) * 2 if chain == "same text" else two_ways(kind, chain)
        batch = surface_rays(parsed("union", first), "float64", rng, rays // (1 + len(CHAINS)))
        tree = parsed("difference", first, second)
        E = error_unit(tree, batch, "float64")
        count.rays += len(batch)
        for who, t in enumerate(_both(tree, batch)):
            count.add(who, t, np.zeros(len(t), bool), np.zeros(len(t)), E)
    return count.peer("X7", f"A − A, {kind}")


def _box(case: str, rays: int, rng: np.random.Generator) -> Peer:
    """Booleans that make one box."""
    operator, children, top = FLUSH[case]
    tree = parsed(operator, *children)
    lo, hi = extended([Fraction(1, 10)] * 3), extended([Fraction(1), Fraction(1), top])
    batch = surface_rays(tree, "float64", rng, rays)
    E = error_unit(tree, batch, "float64")
    guard = GUARD * E[:, None]
    smaller, larger = (box_spans(batch, lo + g, hi - g) for g in (guard, -guard))
    clear = (smaller[0] < smaller[1]) | (larger[0] > larger[1])
    enter, leave = box_spans(batch, lo, hi)
    count = _Count()
    count.rays = int(clear.sum())
    for who, t in enumerate(_both(tree, batch)):
        off = box_distance(batch, t[:, None], lo, hi)[:, 0].astype(float)
        off = np.where(t < (enter + leave) / 2, off, np.inf)
        count.add(who, t[clear], (enter < leave)[clear], off[clear], E[clear])
    return count.peer("X7", case)


def _other_units(rays: int, rng: np.random.Generator) -> Iterator[Peer]:
    """A scene times 2^k, which POV-Ray is given as it is. What is right is what both agree on where
    POV-Ray is given the scene at a scale of its liking."""
    counts = {exponent: _Count() for exponent in sorted((0, *EXPONENTS))}
    for _ in range(SOLIDS):
        tree = random_solid(rng)
        while not np.isfinite(tree.bounds).all():  # nothing is left of it
            tree = random_solid(rng)
        at_random = rng.uniform(*tree.bounds, (rays // SOLIDS, 3))
        batch = rays_through(at_random, directions(rng, rays // SOLIDS), 2 * tree.size)
        theirs, ours = _both(tree, batch)
        E = error_unit(tree, batch, "float64")
        either_none = np.isinf(theirs) | np.isinf(ours)
        off = np.abs(np.where(either_none, 0, theirs) - np.where(either_none, 0, ours))
        agreed = (np.isinf(theirs) == np.isinf(ours)) & (off <= ANOTHER * E)
        batch, truth, E = batch[agreed], ours[agreed], E[agreed]
        there = np.isfinite(truth)
        for exponent, count in counts.items():
            count.rays += len(batch)
            found = _both(tree.scaled(exponent), scaled(batch, exponent), own_scale=True)
            for who, t in enumerate(found):
                t = np.ldexp(t, -exponent)
                both = there & np.isfinite(t)
                off = np.abs(np.where(both, t, 0) - np.where(both, truth, 0))
                count.add(who, t, there, off, E)
    for exponent, count in counts.items():
        yield count.peer("X11", f"the scene times 2^{exponent}")
