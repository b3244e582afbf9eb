"""A second way to a ray's first boundary, to check the oracle by: bisection with intervals.

It shares no step with solid.py: no polynomial, no root, no gcd, no incremental tree. A
piece of the ray is put into each leaf's distance function in outward-rounded arithmetic (flint.arb,
128 bits). Leaves, and then the whole tree by Kleene's logic, are inside, outside or unknown on it;
an unknown piece is halved. What stays unknown at the finest width is a boundary if the solid is
not the same on its two sides, and else a touch. For trees of tens of leaves.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import flint
import numpy as np
from flint import arb, fmpq

import tracers
from harness.nary import INTERSECTION, LEAF, UNION
from harness.oracle.solid import Answer, ExactSolid, is_ray

_BITS = 128
_FINEST = 2.0**-60  # of the whole piece of the ray that is searched
_MOST_PIECES = 5_000  # a ray in a face stays unknown everywhere: give up
_LONGEST = 2.0  # how far to look, in distances to the far side of all leaves


@dataclass(frozen=True)
class Bisection:
    """The first boundary lies in [low, high]; (inf, inf) if there is none."""

    low: float
    high: float
    touches: tuple[
        tuple[float, float], ...
    ]  # pieces left unknown before it, the solid alike on both sides
    is_decided: bool = True


UNDECIDED = Bisection(math.nan, math.nan, (), is_decided=False)


class IntervalSolid:
    """A solid in interval arithmetic."""

    def __init__(self, solid: ExactSolid) -> None:
        self._operators = solid.tree.operators.tolist()
        self._leaves = [_IntervalLeaf(solid, i) for i in range(len(solid.kinds))]
        offset = np.linalg.norm(solid.centres, axis=1)
        self._radius = float(np.max(offset + solid.reach))

    def first_boundary(self, ray: np.ndarray) -> Bisection:
        """ray: (8,) float64 as in the tracers; what they take for no ray has none."""
        if not is_ray(ray):
            return Bisection(math.inf, math.inf, ())
        precision = flint.ctx.prec
        flint.ctx.prec = _BITS
        try:
            return self._search(ray)
        finally:
            flint.ctx.prec = precision

    def _search(self, ray: np.ndarray) -> Bisection:
        far = _LONGEST * (self._radius + math.hypot(*ray[:3])) / math.hypot(*ray[3:6])
        start, end = max(float(ray[6]), -far), min(float(ray[7]), far)
        if not start < end:
            return Bisection(math.inf, math.inf, ())
        for leaf in self._leaves:
            leaf.aim(ray)
        finest = (end - start) * _FINEST
        unknown = dict.fromkeys(range(len(self._leaves)))
        waiting = [(start, end, unknown)]
        state, gap, touches, pieces = None, None, [], 0
        while waiting:
            a, b, known = waiting.pop()
            pieces += 1
            if pieces > _MOST_PIECES:
                return UNDECIDED
            over = arb(a).union(arb(b))
            known = {
                i: self._leaves[i].inside(over) if value is None else value
                for i, value in known.items()
            }
            inside = self._evaluate(known)
            if inside is None:
                middle = a / 2 + b / 2
                if b - a > finest and a < middle < b:
                    waiting += [(middle, b, known), (a, middle, known)]
                else:
                    gap = (a if gap is None else gap[0], b)
                continue
            if state is not None and inside != state:
                return Bisection(*(gap or (a, a)), tuple(touches))
            if gap:
                touches.append(gap)  # at the start, too, for nobody knows what was before
            state, gap = inside, None
        if gap:
            touches.append(gap)
        return Bisection(math.inf, math.inf, tuple(touches))

    def _evaluate(self, leaves: dict[int, bool | None]) -> bool | None:
        value: list[bool | None] = []
        for operator, left, right in self._operators:
            if operator == LEAF:
                value.append(leaves[left])
                continue
            a, b = value[left], value[right]
            if operator == UNION:
                value.append(_or(a, b))
            elif operator == INTERSECTION:
                value.append(_not(_or(_not(a), _not(b))))
            else:
                value.append(_not(_or(_not(a), b)))
        return value[-1]


class _IntervalLeaf:
    def __init__(self, solid: ExactSolid, index: int) -> None:
        leaf = solid.leaf(index)
        self._kind = leaf.kind
        self._sizes = [arb(size) for size in leaf.exact_sizes]
        inverse = leaf.world_from_local.inv()
        self._linear = [[inverse[i, j] for j in range(3)] for i in range(3)]
        self._offset = [inverse[i, 3] for i in range(3)]

    def aim(self, ray: np.ndarray) -> None:
        """Local origin and direction, exact before they are rounded once."""
        o, d = ([fmpq(*float(v).as_integer_ratio()) for v in part] for part in (ray[:3], ray[3:6]))
        self._origin, self._dir = [], []
        for row, offset in zip(self._linear, self._offset, strict=True):
            self._origin.append(arb(sum((m * v for m, v in zip(row, o, strict=True)), offset)))
            self._dir.append(arb(sum((m * v for m, v in zip(row, d, strict=True)), fmpq(0))))

    def inside(self, t: arb) -> bool | None:
        """On all of the interval t; None if it is not known."""
        x, y, z = (o + t * d for o, d in zip(self._origin, self._dir, strict=True))
        unknown = False
        for distance in self._distances(x, y, z):
            if distance > 0:
                return False
            unknown |= not distance < 0
        return None if unknown else True

    def _distances(self, x: arb, y: arb, z: arb) -> list[arb]:
        a, b, c = self._sizes
        if self._kind == "block":
            return [abs(x) - a, abs(y) - b, abs(z) - c]
        rho2 = _square(x) + _square(y)
        if self._kind == "sphere":
            return [_root(rho2 + _square(z)) - a]
        if self._kind == "cylinder":
            return [abs(z) - b, _root(rho2) - a]
        if self._kind == "cone":
            return [abs(z) - c, _root(rho2) - ((a + b) / 2 + (b - a) / (2 * c) * z)]
        return [_root(_square(_root(rho2) - a) + _square(z)) - b]


def _square(x: arb) -> arb:
    """Never negative, as x·x of an interval around 0 would be."""
    return abs(x) ** 2


def _root(x: arb) -> arb:
    return x.nonnegative_part().sqrt()


def _not(a: bool | None) -> bool | None:
    return None if a is None else not a


def _or(a: bool | None, b: bool | None) -> bool | None:
    if a or b:
        return True
    return None if a is None or b is None else False


@dataclass
class Agreement:
    rays: int = 0
    undecided: int = 0
    disagreeing: tuple[int, ...] = ()  # indices of rays


def confirms(found: Bisection, answer: Answer) -> bool | None:
    """Whether both ways say the same. None if the second cannot say: it gave up, or the oracle's
    boundary is a span too thin for it, or at the very start."""
    if not found.is_decided:
        return None
    low, high = answer.enclosure
    if found.low <= high and low <= found.high:
        return True
    return None if any(a <= high and low <= b for a, b in found.touches) else False


def check(tree: tracers.CsgTree, rays: np.ndarray) -> Agreement:
    """Both ways on rays (N, 8)."""
    solid = ExactSolid.from_tree(tree)
    intervals = IntervalSolid(solid)
    result = Agreement(rays=len(rays))
    for i, ray in enumerate(rays):
        agrees = confirms(intervals.first_boundary(ray), solid.answer(ray))
        if agrees is None:
            result.undecided += 1
        elif not agrees:
            result.disagreeing += (i,)
    return result
