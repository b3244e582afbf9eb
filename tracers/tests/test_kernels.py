"""The five kernels against 50-digit arithmetic, under mirrored, sheared, rotated, thin transforms.

The conformance suite cannot see a wrong kernel: all schemes share it. Here a hit must lie on the
exact surface, its normal along the exact gradient, and rays that clear the surface, or enter the
solid, by more than the tolerance must say so. The tolerance is 16 E times the condition (Frobenius,
1 for a rotation); hits were within 3.
"""

from decimal import Decimal, localcontext

import numpy as np
import pytest

import tracers
from harness.adversaries.families import KINDS, Solid, placed, random_size, rotation
from harness.adversaries.walls import U

TRANSFORMS = {
    "translated": lambda rng: np.eye(3),
    "mirrored": lambda rng: rotation(rng) @ np.diag([-1.0, 1, 1]),
    "sheared": lambda rng: np.array(
        [[1, rng.uniform(-2, 2), 0], [0, 1, rng.uniform(-2, 2)], [0, 0, 1]]
    ),
    "rotated": rotation,
    "thin": lambda rng: rotation(rng) @ np.diag(rng.permutation([1, 1, 1e-3])) @ rotation(rng),
}


def exact(values) -> list[Decimal]:
    return [Decimal(float(v)) for v in values]


def dot(a: list, b: list) -> Decimal:
    return sum((x * y for x, y in zip(a, b, strict=True)), Decimal(0))


class Surface:
    """A placed primitive in decimal arithmetic; `inside` < 0 in the solid, 0 on its boundary."""

    def __init__(self, tree: "tracers.CsgTree") -> None:
        self.kind, self.size = tree.kinds[0], exact(tree.sizes[0])
        rows = [exact(row) for row in tree.matrices[0]]
        self.offset = [row[3] for row in rows]
        a, b, c = ([row[i] for row in rows] for i in range(3))  # columns

        def cross(u: list, v: list) -> list:
            return [u[i - 2] * v[i - 1] - u[i - 1] * v[i - 2] for i in range(3)]

        volume = dot(a, cross(b, c))
        self.inverse = [[x / volume for x in cross(*uv)] for uv in ((b, c), (c, a), (a, b))]
        linear = tree.matrices[0][:, :3]
        self.condition = np.linalg.norm(linear) * np.linalg.norm(np.linalg.inv(linear)) / 3

    def inside(self, p: list) -> Decimal:
        local = [
            dot(row, [x - o for x, o in zip(p, self.offset, strict=True)]) for row in self.inverse
        ]
        x, y, z = local
        rho = (x * x + y * y).sqrt()
        a, b, c = self.size
        if self.kind == "sphere":
            return dot(local, local).sqrt() - a
        if self.kind == "block":
            return max(abs(v) - half for v, half in zip(local, self.size, strict=True))
        if self.kind == "cylinder":
            return max(rho - a, abs(z) - b)
        if self.kind == "cone":
            return max(rho - (a + b) / 2 - (b - a) / (2 * c) * z, abs(z) - c)
        return ((rho - a) ** 2 + z * z).sqrt() - b

    def distance_and_normal(self, p: list) -> tuple[float, np.ndarray]:
        """To first order in the distance, world units; the normal by differences of 1e-24."""
        step = Decimal("1e-24")
        at = self.inside(p)
        moved = [[x + step * (i == axis) for i, x in enumerate(p)] for axis in range(3)]
        gradient = [(self.inside(q) - at) / step for q in moved]
        norm = dot(gradient, gradient).sqrt()
        return float(at / norm), np.array([float(g / norm) for g in gradient])


def cases(kind: str, transform: str, count: int):
    """Per tree: the tree, its exact surface, and a Generator."""
    for number in range(count):
        rng = np.random.default_rng([number, KINDS.index(kind), list(TRANSFORMS).index(transform)])
        solid = Solid()
        matrix = placed(*rng.uniform(-1, 1, 3), TRANSFORMS[transform](rng))
        tree = solid.tree(solid.leaf(kind, random_size(rng, kind), matrix))
        with localcontext() as context:
            context.prec = 50
            yield tree, Surface(tree), rng


def aimed(tree, rng: np.random.Generator, count: int) -> np.ndarray:
    """(count, 8) rays at points of the bounds, from 0.5 to 30 sizes away."""
    at = rng.uniform(*tree.bounds, (count, 3))
    along = rng.normal(size=(count, 3))
    along /= np.linalg.norm(along, axis=1)[:, None]
    origin = at - along * tree.size * rng.choice([0.5, 1, 5, 25], (count, 1))
    return np.column_stack([origin, along, np.zeros(count), np.full(count, np.inf)])


def tolerance(tree, surface: Surface, origin: np.ndarray) -> float:
    return 16 * U * (np.linalg.norm(origin) + tree.size) * surface.condition


def point_at(ray: np.ndarray, t: float) -> list[Decimal]:
    return [o + Decimal(float(t)) * d for o, d in zip(exact(ray[:3]), exact(ray[3:6]), strict=True)]


@pytest.mark.parametrize("transform", TRANSFORMS)
@pytest.mark.parametrize("kind", KINDS)
def test_hits_lie_on_the_surface_and_normals_point_out(kind: str, transform: str) -> None:
    checked = 0
    for tree, surface, rng in cases(kind, transform, 6):
        rays = aimed(tree, rng, 60)
        hits = tracers.make("naive", tree).trace(rays)
        for i in np.flatnonzero(hits.leaf == 0):
            off, normal = surface.distance_and_normal(point_at(rays[i], hits.t[i]))
            assert abs(off) <= tolerance(tree, surface, rays[i, :3]), f"{rays[i].tolist()}: {off}"
            assert hits.normal[i] @ normal > 1 - 1e-9, rays[i].tolist()
            assert abs(hits.normal[i] @ hits.normal[i] - 1) < 1e-15
            checked += 1
    assert checked > 50


@pytest.mark.parametrize("transform", TRANSFORMS)
@pytest.mark.parametrize("kind", KINDS)
def test_tangents_hit_within_and_miss_without(kind: str, transform: str) -> None:
    """A hit's tangent, moved in or out by 1.5 to 1e4 tolerances: where a point of it is inside, it
    hits; where it runs outside a plane that supports the solid, it misses."""
    decided = {"in": 0, "out": 0}
    for tree, surface, rng in cases(kind, transform, 12):
        naive = tracers.make("naive", tree)
        rays = aimed(tree, rng, 30)
        hits = naive.trace(rays)
        for i in np.flatnonzero(hits.leaf == 0):
            at, normal = rays[i, :3] + hits.t[i] * rays[i, 3:6], hits.normal[i]
            away = tree.size * rng.choice([0.5, 1, 5, 25])
            bound = tolerance(tree, surface, at + away)
            move = bound * 10.0 ** rng.uniform(0.2, 4) * rng.choice([-1, 1])
            along = np.cross(normal, rng.normal(size=3))
            along /= np.linalg.norm(along)
            ray = np.array([*(at + move * normal - away * along), *along, 0, np.inf])
            hit = naive.trace(ray[None]).leaf[0] == 0
            off, _ = surface.distance_and_normal(point_at(ray, away))
            if off < -bound:
                assert hit, f"{ray.tolist()} enters by {-off}, tolerance {bound}"
                decided["in"] += 1
            convex = kind != "torus" or supports(surface, at, normal)
            foot = dot(exact(normal), exact(at))
            ends = [dot(exact(normal), point_at(ray, t)) - foot for t in (away - 4, away + 4)]
            if convex and min(ends) > bound:
                assert not hit, f"{ray.tolist()} clears by {min(ends)}, tolerance {bound}"
                decided["out"] += 1
    assert min(decided.values()) > 15, decided


def supports(surface: Surface, at: np.ndarray, normal: np.ndarray) -> bool:
    """Whether a torus lies behind its tangent plane there: at its outer half."""
    inverse = np.array(surface.inverse, dtype=float)
    x, y, _ = inverse @ (at - np.array(surface.offset, dtype=float))
    return np.hypot(x, y) > float(surface.size[0]) * (1 + 1e-6)


def test_crossings_that_rounding_makes_one_are_none() -> None:
    """A chord through a block's corner, shorter than an ulp of t: which of the two faces is met
    decides the tie band, and schemes that met the leaf in another order disagreed."""
    solid = Solid()
    tree = solid.tree(solid.leaf("block", [0.5, 0.5000000000000013, 0.5]))
    along = np.array([3.568150466468701, 1.4581927496578788, 2.39042904136011])
    origin = np.array([-4.068150466468701, -0.9581927496578776, -2.89042904136011])
    count, _, _ = tracers.crossings(tree, np.array([[*origin, *along, 0, np.inf]]))
    assert count[0] == 0
    solid = Solid()  # a little thicker, it is met
    tree = solid.tree(solid.leaf("block", [0.5, 0.50000000000002, 0.5]))
    count, t, _ = tracers.crossings(tree, np.array([[*origin, *along, 0, np.inf]]))
    assert count[0] == 2
    assert t[0, 0] < t[0, 1]


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("kind", KINDS)
def test_crossings_do_not_depend_on_the_length_of_the_direction(kind: str, precision: str) -> None:
    """Squares of directions shorter than 1e-160 vanish, of those longer than 1e160 overflow."""
    numerics = {"precision": precision}
    tree, _, rng = next(cases(kind, "rotated", 1))
    rays = aimed(tree, rng, 200)
    count, t, _ = tracers.crossings(tree, rays, numerics)
    assert (count > 0).any()
    for exponent in (-1000, -600, -1, 1, 600, 1000):
        scaled = rays.copy()
        scaled[:, 3:6] = np.ldexp(rays[:, 3:6], exponent)
        again, u, _ = tracers.crossings(tree, scaled, numerics)
        assert np.array_equal(again, count)
        assert np.array_equal(u, np.ldexp(t, -exponent))
        hits = tracers.make("naive", tree, numerics).trace(scaled)
        met = hits.leaf == 0
        assert (u[met] == hits.t[met, None]).any(axis=1).all()


def test_what_is_no_ray_has_no_crossings() -> None:
    solid = Solid()
    tree = solid.tree(solid.leaf("torus", [1, 0.25]))
    line = np.array([[-3.0, 0.1, 0, 1, 0, 0, 0, np.inf]])
    assert tracers.crossings(tree, line)[0] == [4]
    for column in range(8):
        for value in (np.nan, np.inf, 0.0):
            row = line.copy()
            row[0, column] = value
            none = (
                np.isnan(value) or (column < 6 and np.isinf(value)) or (column == 3 and not value)
            )
            assert (tracers.crossings(tree, row)[0] == [0]) == none
            assert not none or tracers.make("naive", tree).trace(row).leaf == [-1]
