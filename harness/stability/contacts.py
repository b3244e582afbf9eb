"""X9: solids that touch in a point, along a line or along a circle. What they have in common is
empty, one less the other is the first alone, and no layer has zero length."""

from __future__ import annotations

import itertools

import numpy as np

import tracers
from harness.adversaries.families import DIFFERENCE, INTERSECTION, UNION, Solid, placed
from harness.stability import Findings, row
from harness.stability.exact import Block, Cylinder, Long, Sphere, at
from harness.stability.exact_torus import Torus
from harness.stability.scenes import (
    BAND,
    GUARD,
    LEAST_COSINE,
    PRECISIONS,
    RED_WHERE_GRAZED,
    Tally,
    chunks,
    directions,
    error_unit,
    rays_through,
    walk,
)

LYING = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # z to x

SHAPES = {"sphere": Sphere, "block": Block, "cylinder": Cylinder, "torus": Torus}

Part = tuple[str, list[float], np.ndarray]


def spheres(a: float, b: float) -> tuple[Part, Part]:
    return ("sphere", [a], placed(0, 0, -a)), ("sphere", [b], placed(0, 0, b))


def cylinder_on_plane(r: float) -> tuple[Part, Part]:
    block = ("block", [2, 2, 0.5], placed(0, 0, -0.5))
    return ("cylinder", [r, 1.5], placed(0, 0, r, LYING)), block


def sphere_in_hole(major: float, minor: float) -> tuple[Part, Part]:
    return ("sphere", [major - minor], np.eye(3, 4)), ("torus", [major, minor], np.eye(3, 4))


# The two solids, and a point and a normal of their contact. The decimals touch but for rounding.
CONTACTS = {
    "spheres, dyadic": (spheres(0.5, 0.25), [0, 0, 0], [0, 0, 1]),
    "spheres, decimal": (spheres(0.3, 0.7), [0, 0, 0], [0, 0, 1]),
    "cylinder on plane, dyadic": (cylinder_on_plane(0.5), [0.2, 0, 0], [0, 0, 1]),
    "cylinder on plane, decimal": (cylinder_on_plane(0.3), [0.2, 0, 0], [0, 0, 1]),
    "sphere in a torus' hole, dyadic": (sphere_in_hole(0.75, 0.25), [0.5, 0, 0], [1, 0, 0]),
    "sphere in a torus' hole, decimal": (sphere_in_hole(0.7, 0.3), [0.4, 0, 0], [1, 0, 0]),
}


def contact_rays(point, normal, unit: float, rng: np.random.Generator, count: int) -> np.ndarray:
    """(count, 8) rays past the contact: at 1e-16 to 1 from it in any direction, in its tangent
    plane and 1 E to 0.1 off that, and across it at angles down to 1e-8."""
    point, normal = np.array(point, dtype=float), np.array(normal, dtype=float)
    distance = 10.0 ** rng.uniform(-16, 0, (count, 1)) * (rng.random((count, 1)) < 0.9)
    at = point + distance * directions(rng, count)
    along = directions(rng, count)
    flat = along - (along @ normal)[:, None] * normal
    flat /= np.linalg.norm(flat, axis=1)[:, None]
    kind = rng.integers(3, size=(count, 1))
    lift = rng.choice([-1.0, 1.0], (count, 1)) * unit * 10.0 ** rng.uniform(0, 13, (count, 1))
    at = np.where(kind == 1, at - ((at - point) @ normal)[:, None] * normal, at)
    at = np.where(kind == 1, at + np.where(rng.random((count, 1)) < 0.8, lift, 0) * normal, at)
    slope = 10.0 ** rng.uniform(-8, 0, (count, 1))
    tilted = flat + slope * normal
    tilted /= np.linalg.norm(tilted, axis=1)[:, None]
    along = np.where(kind == 1, flat, np.where(kind == 2, tilted, along))
    return rays_through(at, along, rng.choice([2.0, 4.0, 16.0], count))


def grazes(part: Part, rays: np.ndarray, guard: np.ndarray) -> np.ndarray:
    """(N,) whether a ray is tangent to the primitive but for the guard (N,), in extended precision:
    it misses it by less, or is less deep in it where it is deepest."""
    kind, size, matrix = part
    # The matrices only shift and permute: the inverse is the transpose.
    linear = matrix[:, :3].astype(Long)
    o = (rays[:, :3].astype(Long) - matrix[:, 3]) @ linear
    d = rays[:, 3:6].astype(Long) @ linear
    solid = SHAPES[kind](*size)
    if isinstance(solid, Torus):
        s = solid.critical_points(o, d)
        points = (at(o, d, np.where(np.isfinite(column), column, 0)) for column in s.T)
        depth = np.where(np.isfinite(s), np.stack([solid.depth(p) for p in points], 1), np.inf)
    else:
        depth = solid.width(o, d)[:, None]
    return (np.abs(depth) < guard[:, None]).any(axis=1)


@row("X9", "solids that touch: zero-length layers", tests=60_000, full=3_000_000)
def contacts(rays: int, rng: np.random.Generator) -> Findings:
    """A layer is of zero length if it is shorter than the tie band at normal incidence. A ray is
    excused if it grazes one of the two within the guard."""
    for (case, (parts, point, normal)), precision in itertools.product(
        CONTACTS.items(), PRECISIONS
    ):
        solid = Solid()
        a, b = (solid.leaf(*part) for part in parts)
        trees = {
            "alone": solid.tree(a),
            "A ∩ B": solid.tree([INTERSECTION, a, b]),
            "A − B": solid.tree([DIFFERENCE, a, b]),
            "A ∪ B": solid.tree([UNION, a, b]),
        }
        numerics = {"precision": precision}
        built = {name: tracers.make("naive", tree, numerics) for name, tree in trees.items()}
        tallies = {
            name: Tally(
                "X9",
                f"{case}, {name}, {precision}",
                "layers that are not there",
            )
            for name in list(trees)[1:]
        }
        unexplained = dict.fromkeys(tallies, False)
        whole = trees["A ∪ B"]
        for count in chunks(rays // (len(CONTACTS) * 2)):
            unit = error_unit(whole, np.zeros((1, 8)), precision)[0]
            batch = contact_rays(point, normal, unit, rng, count)
            units = error_unit(whole, batch, precision)
            near = np.any([grazes(part, batch, GUARD * units) for part in parts], axis=0)
            flat = np.abs(batch[:, 3:6] @ normal) < LEAST_COSINE[precision]
            found = {n: walk(t, whole, batch, precision) for n, t in built.items()}
            wrong = {
                "A ∩ B": found["A ∩ B"].count > 0,
                "A − B": found["A − B"].count != found["alone"].count,
                "A ∪ B": zero_length(found["A ∪ B"].t, BAND * units),
            }
            for name, tally in tallies.items():
                tally.add(count, (wrong[name] & ~near).sum(), (wrong[name] & near).sum())
                unexplained[name] |= bool((wrong[name] & ~near & ~flat).any())
        for name, tally in tallies.items():
            tally.red = "" if unexplained[name] else RED_WHERE_GRAZED[precision]
            yield tally.finding()


def zero_length(t: np.ndarray, band: np.ndarray) -> np.ndarray:
    """(N,) whether two boundaries are closer than the band."""
    with np.errstate(invalid="ignore"):  # inf − inf, behind the last
        return (np.diff(t, axis=1) < band[:, None]).any(axis=1)
