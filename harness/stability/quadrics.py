"""X1 and X2: spheres, cylinders, cones and frusta, aimed at where their roots appear or vanish."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from harness.stability import Findings, row
from harness.stability.exact import Cone, Convex, Cylinder, Sphere
from harness.stability.judged import Tally, chunks, frames, near_one, powers, unit

# Of a precision: decimal exponents of the farthest origin in sizes, and of the scale.
REACH = {"float64": (8, 9), "float32": (6, 3)}
_TREES = 16  # sizes drawn a case

Aim = tuple[np.ndarray, np.ndarray]  # points (N, 3) on the lines, directions (N, 3)
Shape = Callable[[np.random.Generator], Convex]


def backed(rng: np.random.Generator, aim: Aim, radius: float, farthest: int) -> Aim:
    """Origins 1 to 10^farthest sizes before the points, and directions of any length near 1."""
    point, along = aim
    n = len(point)
    back = radius * powers(rng, 0, farthest, (n, 1))
    return point - back * unit(along), along * powers(rng, -1, 1, (n, 1))


def run_case(
    case: str,
    n: int,
    rng: np.random.Generator,
    shape: Shape,
    aim: Callable[[np.random.Generator, Convex, int], Aim],
    bars: dict[str, float],
) -> Findings:
    """Both precisions over _TREES primitives; `shape` makes one of a size near 1."""
    name, what = case.split(" ", 1)
    for precision, (farthest, scales) in REACH.items():
        tally = Tally()
        for _, rays in chunks(n, _TREES):
            one = shape(rng)
            primitive = type(one)(*(one.size * powers(rng, -scales, scales, ())))
            lines = backed(rng, aim(rng, primitive, rays), primitive.radius, farthest)
            tally.judge(primitive, *lines, {"precision": precision})
        yield tally.finding(name, f"{what}, {precision}", bars[precision])


def _grazing_sphere(rng: np.random.Generator, sphere: Convex, n: int) -> Aim:
    frame = frames(rng, n)
    impact = sphere.size[0] * near_one(rng, -16, -1, (n, 1))
    return impact * frame[:, 0], frame[:, 1]


def _on_cylinder(rng: np.random.Generator, r: np.ndarray, h: float, n: int) -> tuple:
    """A point near the side at r (n,), the outward normal there, and the tangent."""
    turn = rng.uniform(0, 2 * np.pi, n) * (rng.random(n) < 0.75)  # else exactly at x = r
    out = np.stack([np.cos(turn), np.sin(turn), np.zeros(n)], axis=1)
    point = r[:, None] * out
    point[:, 2] = h * rng.uniform(-1.1, 1.1, n)
    return point, out, np.stack([-out[:, 1], out[:, 0], np.zeros(n)], axis=1)


def _grazing_side(rng: np.random.Generator, cylinder: Convex, n: int) -> Aim:
    r, h = cylinder.size[:2]
    point, _, tangent = _on_cylinder(rng, r * near_one(rng, -16, -1, n), h, n)
    slant = rng.normal(size=n) * (rng.random(n) < 0.75)
    return point, tangent + slant[:, None] * [0, 0, 1]


def _along_side(rng: np.random.Generator, cylinder: Convex, n: int) -> Aim:
    """Nearly parallel to the axis, near the side."""
    r, h = cylinder.size[:2]
    point, _, _ = _on_cylinder(rng, r * near_one(rng, -16, -1, n), h, n)
    tilt = rng.normal(size=(n, 3)) * powers(rng, -16, -1, (n, 1)) * [1, 1, 0]
    return point, tilt + rng.choice([-1.0, 1.0], (n, 1)) * [0, 0, 1]


def _at_rim(rng: np.random.Generator, solid: Convex, n: int) -> Aim:
    """Past a point of the rim, at any angle, one in three within the plane of the cap."""
    top = rng.random(n) < 0.5
    if isinstance(solid, Cone):
        r, h = np.where(top, solid.size[1], solid.size[0]), solid.size[2]
    else:
        r, h = np.full(n, solid.size[0]), solid.size[1]
    point, _, _ = _on_cylinder(rng, r, h, n)
    point[:, 2] = np.where(top, h, -h)
    point += solid.radius * powers(rng, -16, -1, (n, 1)) * rng.normal(size=(n, 3))
    along = rng.normal(size=(n, 3))
    along[:, 2] *= rng.choice([0, 1, 1], n) * powers(rng, -3, 0, n)
    return point, along


def _sphere(rng: np.random.Generator) -> Convex:
    return Sphere(1.0)


def _cylinder(rng: np.random.Generator) -> Convex:
    return Cylinder(1.0, powers(rng, -3, 3, ()))


@row("X1", "sphere and cylinder: grazed from far", tests=100_000, full=10_000_000)
def quadrics(n: int, rng: np.random.Generator) -> Findings:
    bars = {"float64": 4, "float32": 4}
    n = n // 8
    yield from run_case("X1 sphere, grazed", n, rng, _sphere, _grazing_sphere, bars)
    yield from run_case("X1 cylinder, grazed", n, rng, _cylinder, _grazing_side, bars)
    yield from run_case("X1 cylinder, along its side", n, rng, _cylinder, _along_side, bars)
    yield from run_case("X1 cylinder, at its rim", n, rng, _cylinder, _at_rim, bars)


def _pointed(rng: np.random.Generator) -> Convex:
    radii = rng.permutation([0.0, 1.0])
    return Cone(*radii, powers(rng, -3, 3, ()))


def _frustum(rng: np.random.Generator) -> Convex:
    radii = rng.permutation([powers(rng, -6, -0.01, ()), 1.0])
    return Cone(*radii, powers(rng, -3, 3, ()))


def _at_apex(rng: np.random.Generator, cone: Convex, n: int) -> Aim:
    """The point where the sides would meet, for a frustum outside of it."""
    r0, r1, h = cone.size
    apex = -h * (r0 + r1) / (r1 - r0)
    off = cone.radius * powers(rng, -16, -1, (n, 1)) * frames(rng, n)[:, 0]
    return off + np.array([0, 0, apex]), frames(rng, n)[:, 0]


def _along_generator(rng: np.random.Generator, cone: Convex, n: int) -> Aim:
    """From a point near the side, 1 ± 1e-16..1e-2 along the generator there."""
    r0, r1, h = cone.size
    height = rng.uniform(-1.1, 1.1, n)
    r = np.abs((r0 + r1) / 2 + (r1 - r0) / 2 * height)
    point, out, _ = _on_cylinder(rng, r, h, n)
    point[:, 2] = h * height
    along = (r1 - r0) * out * near_one(rng, -16, -2, (n, 1)) + [0, 0, 2 * h]
    off = cone.radius * powers(rng, -16, -1, (n, 1)) * rng.choice([-1, 0, 1], (n, 1))
    return point + off * out, rng.choice([-1.0, 1.0], (n, 1)) * unit(along)


@row("X2", "cone: at its apex, along a generator", tests=100_000, full=10_000_000)
def cones(n: int, rng: np.random.Generator) -> Findings:
    bars = {"float64": 4, "float32": 8}
    n = n // 10
    for name, shape in (("cone", _pointed), ("frustum", _frustum)):
        yield from run_case(f"X2 {name}, at the apex", n, rng, shape, _at_apex, bars)
        yield from run_case(f"X2 {name}, along a generator", n, rng, shape, _along_generator, bars)
    yield from run_case("X2 frustum, at its rim", n, rng, _frustum, _at_rim, bars)
