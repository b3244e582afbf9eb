"""What a ray meets, in exact arithmetic.

A leaf is a conjunction of polynomial inequalities fᵢ(p) ≤ 0 with integer coefficients; along a ray
each becomes a polynomial in t. Their roots are enclosed and ordered with proof (roots.py),
the leaf is classified at a rational point between any two of them, and the Boolean tree is
evaluated at each distinct crossing. So touching surfaces, A − A and faces in common vanish without
a tolerance. Doubles serve only to leave out leaves that are far from the ray.

A leaf's interior is open: a ray that runs in a leaf's surface is outside of it. `Answer.coplanar`
names such leaves, where the answer is this convention and not a fact about the solid.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from flint import fmpq, fmpq_mat

import tracers
from harness.oracle.boolean import BooleanTree
from harness.oracle.leaf import Leaf, Line, OnPiece
from harness.oracle.roots import Root, at, compare, in_order

# How much farther than its radius a leaf may be from the ray before it is left out, relative to the
# distance from the ray's origin: 2²³ times what rounding can cost.
_MARGIN = 2.0**-30


@dataclass(frozen=True)
class Crossing:
    """Where leaves change, all at exactly the same t. Crossings are distinct and ascending."""

    low: float  # low < t < high, a few ulps apart
    high: float
    changes: tuple[OnPiece, ...]  # by leaf
    inside: bool  # of the solid, after the crossing
    root: Root = field(repr=False)

    @property
    def t(self) -> float:
        middle = self.low / 2 + self.high / 2
        return middle if math.isfinite(middle) else self.low

    @property
    def leaves(self) -> tuple[int, ...]:
        return tuple(change.leaf for change in self.changes)


@dataclass(frozen=True)
class Answer:
    """The first boundary of the regularized solid with t_min < t < t_max, and all crossings of the
    whole line."""

    crossings: list[Crossing]
    first: int | None  # index of the crossing that is the hit; None for a miss
    #: of the leaves that change at the hit those that alone make it one (rule 6), ascending
    decisive: tuple[int, ...]
    starts_inside: bool  # just after t_min
    coplanar: tuple[int, ...]  # leaves in whose surface the ray runs

    @property
    def hit(self) -> Crossing | None:
        return None if self.first is None else self.crossings[self.first]

    @property
    def leaves(self) -> tuple[int, ...]:
        """All that change at the hit."""
        return self.hit.leaves if self.hit else ()

    @property
    def leaf(self) -> int:
        """Ties go to the lowest; -1 for a miss."""
        return self.decisive[0] if self.decisive else -1

    @property
    def t(self) -> float:
        """In the middle of the enclosure; +inf for a miss."""
        return self.hit.t if self.hit else math.inf

    @property
    def enclosure(self) -> tuple[float, float]:
        return (self.hit.low, self.hit.high) if self.hit else (math.inf, math.inf)

    @property
    def entering(self) -> bool:
        return self.hit is not None and self.hit.inside

    @property
    def span_end(self) -> float | None:
        """Where the solid changes next after the hit; None if it does not."""
        if self.first is None:
            return None
        inside = self.crossings[self.first].inside
        for crossing in self.crossings[self.first + 1 :]:
            if crossing.inside != inside:
                return crossing.t
        return None


class ExactSolid:
    """A tree with rational sizes and transforms."""

    def __init__(
        self,
        kinds: Sequence[str],
        sizes: Sequence[Sequence[fmpq]],
        matrices: Sequence[fmpq_mat],
        tree: tracers.CsgTree,
        is_rounded: bool,
    ) -> None:
        """matrices: 4x4, world from local. `is_rounded`: the tree's doubles are not exactly these
        numbers. Operators, and the `size` of the hit rule, are the tree's."""
        self.tree, self.is_rounded = tree, is_rounded
        self.kinds = list(kinds)
        self._sizes, self._matrices = sizes, matrices
        self._leaves: dict[int, Leaf] = {}
        self._boolean = BooleanTree(tree.operators)
        places = tree.matrices
        self.centres = places[:, :, 3].copy()
        stretch = np.linalg.norm(places[:, :, :3], 2, axis=(1, 2))
        #: (n,) float64, Frobenius, at least 1: as Leaf::condition of the tracers
        self.condition = np.maximum(1, _condition(places[:, :, :3]))
        #: (n,) float64: radius of a ball around the centre that holds the leaf
        self.reach = stretch * _local_radius(self.kinds, tree.sizes) * (1 + _MARGIN)

    @staticmethod
    def from_tree(tree: tracers.CsgTree) -> ExactSolid:
        """The tree's doubles, taken as the rationals that they are."""
        sizes = [[_exact(v) for v in row] for row in tree.sizes.tolist()]
        bottom = [fmpq(0), fmpq(0), fmpq(0), fmpq(1)]
        matrices = [
            fmpq_mat(4, 4, [_exact(v) for row in matrix for v in row] + bottom)
            for matrix in tree.matrices.tolist()
        ]
        return ExactSolid(tree.kinds, sizes, matrices, tree, is_rounded=False)

    @staticmethod
    def from_csg(source: Path | str, tree: tracers.CsgTree) -> ExactSolid:
        """The .csg that the tree was loaded from, a path or its text, with decimals as rationals.
        UserError if it is not the tree's."""
        from harness.oracle.csg import read_csg

        kinds, sizes, matrices = read_csg(source, tree)
        return ExactSolid(kinds, sizes, matrices, tree, is_rounded=True)

    def leaf(self, index: int) -> Leaf:
        if index not in self._leaves:
            self._leaves[index] = Leaf(self.kinds[index], self._sizes[index], self._matrices[index])
        return self._leaves[index]

    def candidates(self, ray: np.ndarray) -> list[int]:
        """Leaves that the whole line of the ray may meet; the others surely are not met."""
        origin, direction = ray[:3], ray[3:6]
        direction = np.ldexp(direction, -np.frexp(np.abs(direction).max())[1])
        to_centre = self.centres - origin
        with np.errstate(over="ignore", invalid="ignore"):
            across = np.cross(to_centre, direction)
            off = np.sqrt(np.einsum("ij,ij->i", across, across) / (direction @ direction))
            far = np.sqrt(np.einsum("ij,ij->i", to_centre, to_centre))
            beyond = off > self.reach + _MARGIN * (self.reach + far)
        return np.flatnonzero(~beyond).tolist()

    def answer(self, ray: np.ndarray) -> Answer:
        """ray: (8,) float64 as in the tracers: origin, dir, t_min, t_max. A ray that is no ray
        (NaN, zero or infinite direction) misses."""
        t_min, t_max = float(ray[6]), float(ray[7])
        if not is_ray(ray):
            return Answer([], None, (), False, ())
        line = Line(ray)
        roots: list[Root] = []
        changes: list[OnPiece] = []
        coplanar = []
        for index in self.candidates(ray):
            found, runs_in_surface = self.leaf(index).changes(line)
            if runs_in_surface:
                coplanar.append(index)
            for root, change in found:
                roots.append(root)
                changes.append(change._replace(leaf=index))

        state = self._boolean.start()
        crossings: list[Crossing] = []
        first, decisive, starts_inside = None, (), False
        before = False
        for group in in_order(roots):
            root = roots[group[0]]
            here = tuple(sorted(changes[i] for i in group))
            here_leaves = [change.leaf for change in here]
            for index in here_leaves:
                state.toggle(index)
            inside = state.inside
            crossings.append(Crossing(root.low, root.high, here, inside, root))
            if not _is_after(root, t_min):
                starts_inside = inside
            elif first is None and inside != before and _is_before(root, t_max):
                first = len(crossings) - 1
                decisive = state.decisive(here_leaves)
            before = inside
        return Answer(crossings, first, decisive, starts_inside, tuple(coplanar))


def is_ray(ray: np.ndarray) -> bool:
    """What the tracers take as one; all else misses."""
    return bool(np.isfinite(ray[:6]).all() and ray[3:6].any() and not np.isnan(ray[6:]).any())


def _exact(value: float) -> fmpq:
    return fmpq(*value.as_integer_ratio())


def _is_after(root: Root, t: float) -> bool:
    if root.low >= t:
        return True
    return not (root.high <= t or t == math.inf) and compare(root, at(t)) > 0


def _is_before(root: Root, t: float) -> bool:
    """A root that no double can hold is no hit, wherever t_max is."""
    if root.high <= t:
        return root.high < math.inf
    return root.low < t < math.inf and compare(root, at(t)) < 0


def _condition(linear: np.ndarray) -> np.ndarray:
    """(n,): ‖M‖·‖M⁻¹‖/3 in the Frobenius norm."""
    inverse = np.linalg.inv(linear)
    return np.linalg.norm(linear, axis=(1, 2)) * np.linalg.norm(inverse, axis=(1, 2)) / 3


def _local_radius(kinds: Sequence[str], sizes: np.ndarray) -> np.ndarray:
    """(n,): distance of a leaf's farthest point from its centre, local."""
    a, b, c = sizes.T
    of_kind = {
        "sphere": a,
        "block": np.hypot(np.hypot(a, b), c),
        "cylinder": np.hypot(a, b),
        "cone": np.hypot(np.maximum(a, b), c),
        "torus": a + b,
    }
    return np.select([np.array(kinds) == kind for kind in of_kind], list(of_kind.values()))
