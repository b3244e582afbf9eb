"""X8: gaps and shells of known thickness, down to where they are thinner than the error unit.

The gap between two surfaces must be seen from 64 E on, at every angle. A shell's area is measured
by Crofton's formula: uniform lines through a convex body of area B cross a surface of area A in it
2A / B times on average. Thinner layers than that may be seen or not: their share is told.
"""

from __future__ import annotations

import numpy as np

import tracers
from harness.adversaries.families import DIFFERENCE, UNION, Solid, placed
from harness.stability import Findings, row
from harness.stability.scenes import (
    BAND,
    EXCUSED_COSINE,
    GUARD,
    PRECISIONS,
    Tally,
    chunks,
    directions,
    error_unit,
    rays_through,
    walk,
)

SEEN_FROM = 64  # E
GAPS = np.array([1, 2, 4, 8, 16, 32, 64, 128, 1e3, 1e4, 1e5, 1e6])  # E
ANGLES = np.array([0, 30, 60, 80, 85, 88, 89, 89.5, 89.9, 89.99])  # to the normal, degrees
THICKNESS = 10.0 ** -np.arange(1, 16)  # of the size
SHELLS = {
    "sphere": [1.0],
    "block": [0.9, 0.6, 0.5],
    "cylinder": [0.7, 0.6],
    "cone": [0.8, 0.3, 0.6],
    "torus": [0.7, 0.25],
}
LEAST_LINES = 100_000  # for an area's standard error of 1/4 %


@row(
    "X8", "gaps of 1 to 1e6 E, shells of 1e-1 to 1e-15 of the size", tests=120_000, full=12_000_000
)
def thin_layers(rays: int, rng: np.random.Generator) -> Findings:
    for precision in PRECISIONS:
        for make in (facing_blocks, ball_in_shell):
            yield from _gaps(make, precision, rays // 12, rng)
        for kind in SHELLS:
            yield from _shells(kind, precision, rays // 15, rng)


def facing_blocks(gap: float, angle: np.ndarray, rng: np.random.Generator):
    """Blocks with faces z = 0 and z = gap; rays that leave the first at an angle (N,), radians.
    Returns the tree, rays (N, 8), and t (N, 2) of both faces in extended precision."""
    solid = Solid()
    below = solid.leaf("block", [3, 3, 0.5], placed(0, 0, -0.5))
    middle = 0.5 + gap
    above = solid.leaf("block", [3, 3, 0.5], placed(0, 0, middle))
    n, turn = len(angle), rng.uniform(0, 2 * np.pi, len(angle))
    sine = np.sin(angle)
    along = np.column_stack([sine * np.cos(turn), sine * np.sin(turn), np.cos(angle)])
    at = np.column_stack([rng.uniform(-0.5, 0.5, (n, 2)), np.zeros(n)])
    rays = rays_through(at, along, 0.5)
    z, dz = (rays[:, i].astype(np.longdouble) for i in (2, 5))
    face = np.longdouble(middle) - 0.5
    return solid.tree([UNION, below, above]), rays, np.stack([-z / dz, (face - z) / dz], axis=1)


def ball_in_shell(gap: float, angle: np.ndarray, rng: np.random.Generator):
    """The same with a ball of radius 1 in a shell from 1 + gap on; rays start in the ball."""
    solid = Solid()
    ball, hollow = solid.leaf("sphere", [1.0]), solid.leaf("sphere", [1 + gap])
    shell = [DIFFERENCE, solid.leaf("sphere", [2.0]), hollow]
    normal = directions(rng, len(angle))
    aside = np.cross(normal, directions(rng, len(angle)))
    aside /= np.linalg.norm(aside, axis=1)[:, None]
    along = np.cos(angle)[:, None] * normal + np.sin(angle)[:, None] * aside
    rays = rays_through(normal, along, np.cos(angle))
    o, d = (rays[:, i : i + 3].astype(np.longdouble) for i in (0, 3))
    dd = (d * d).sum(axis=1)
    foot = o - ((o * d).sum(axis=1) / dd)[:, None] * d
    squared = (foot * foot).sum(axis=1)
    middle = -(o * d).sum(axis=1) / dd
    radii = np.array([1, np.longdouble(1 + gap)])
    return (
        solid.tree([UNION, ball, shell]),
        rays,
        middle[:, None] + np.sqrt((radii**2 - squared[:, None]) / dd[:, None]),
    )


def _gaps(make, precision: str, rays: int, rng: np.random.Generator) -> Findings:
    name = make.__name__.replace("_", " ")
    seen = Tally("X8", f"{name}, from {SEEN_FROM} E on, {precision}", "gaps missed")
    lost = Tally("X8", f"{name}, below {SEEN_FROM} E, {precision}", "share missed (no bar)", np.inf)
    missed = np.zeros(2)
    for multiple in GAPS:
        for count in chunks(rays // len(GAPS)):
            angle = np.deg2rad(rng.choice(ANGLES, count))
            tree, batch, _ = make(0.0, angle, rng)
            gap = multiple * error_unit(tree, batch, precision).max()
            angle[gap > np.cos(angle)] = 0  # else it leaves at the side
            tree, batch, truth = make(np.ldexp(np.ceil(np.ldexp(gap, 52)), -52), angle, rng)
            unit = error_unit(tree, batch, precision)
            tracer = tracers.make("naive", tree, {"precision": precision})
            found = walk(tracer, tree, batch, precision, most=2)
            both = found.count == 2
            if found.t.shape[1] == 2:  # the surfaces themselves, within the guard
                off = np.abs(found.t - truth) * np.cos(angle)[:, None] / unit[:, None]
                both &= (off < GUARD).all(axis=1)
            widest = BAND * unit / np.maximum(np.cos(angle), EXCUSED_COSINE[precision])
            at_start = truth[:, 0] < 2 * widest
            if multiple >= SEEN_FROM:
                seen.add(count, (~both & ~at_start).sum(), (~both & at_start).sum())
            else:
                missed += (~both).sum(), count
                lost.add(count, worst=missed[0] / missed[1])
    lost.worst = missed[0] / missed[1]
    yield seen.finding()
    yield lost.finding()


def area(kind: str, size: list[float]) -> float:
    a, b, c = [*size, 0, 0][:3]
    return {
        "sphere": 4 * np.pi * a * a,
        "block": 8 * (a * b + b * c + c * a),
        "cylinder": 2 * np.pi * a * (a + 2 * b),
        "cone": np.pi * (a * a + b * b + (a + b) * np.hypot(a - b, 2 * c)),
        "torus": 4 * np.pi**2 * a * b,
    }[kind]


def inradius(kind: str, size: list[float]) -> float:
    """How far the nearest piece of surface moves if the sizes that make a shell shrink by 1."""
    if kind == "torus":
        return size[1]
    if kind == "cone":
        a, b, c = size
        return min(c, (a + b) / 2 * 2 * c / np.hypot(a - b, 2 * c))
    return min(size)


def shell(kind: str, thickness: float) -> tuple[tracers.CsgTree, float]:
    """A primitive minus a smaller one, at least `thickness` thick; and its area."""
    size = SHELLS[kind]
    shrink = 1 - thickness / inradius(kind, size)
    inner = [size[0], size[1] * shrink] if kind == "torus" else [s * shrink for s in size]
    solid = Solid()
    root = [DIFFERENCE, solid.leaf(kind, size), solid.leaf(kind, inner)]
    return solid.tree(root), area(kind, size) + area(kind, inner)


def lines_through(half: np.ndarray, rng: np.random.Generator, count: int) -> np.ndarray:
    """(count, 8) rays along uniform lines through the box ±half: from points uniform on its faces,
    in directions of density cosine."""
    area_of_faces = half[[1, 2, 0]] * half[[2, 0, 1]]
    axis = rng.choice(3, count, p=area_of_faces / area_of_faces.sum())
    side = rng.choice([-1.0, 1.0], count)
    at = rng.uniform(-half, half, (count, 3))
    at[np.arange(count), axis] = side * half[axis]
    u, turn = rng.random(count), rng.uniform(0, 2 * np.pi, count)
    along = np.empty((count, 3))
    rows = np.arange(count)
    along[rows, axis] = -side * np.sqrt(1 - u)
    along[rows, (axis + 1) % 3] = np.sqrt(u) * np.cos(turn)
    along[rows, (axis + 2) % 3] = np.sqrt(u) * np.sin(turn)
    return rays_through(at, along, 1.0)


def crossings(tree, precision: str, lines: np.ndarray) -> np.ndarray:
    """(N,) how many boundaries each line meets."""
    tracer = tracers.make("naive", tree, {"precision": precision})
    return walk(tracer, tree, lines, precision).count


def _shells(kind: str, precision: str, rays: int, rng: np.random.Generator) -> Findings:
    """The solid's area by itself; the shells' by the same lines, relative to it, which leaves
    little to chance: mean(n of shell) / mean(n of solid) is the ratio of the areas."""
    size = SHELLS[kind]
    solid = Solid()
    whole = solid.tree(solid.leaf(kind, size))
    half = whole.bounds[1]
    lines = lines_through(half, rng, max(rays // 2, LEAST_LINES))
    of_box, of_solid = area("block", list(half)), area(kind, size)
    n = np.concatenate(
        [crossings(whole, precision, part) for part in np.array_split(lines, len(lines) // 50_000)]
    )
    error = n.std() / n.mean() / np.sqrt(len(n))
    alone = Tally(
        "X8", f"{kind}, area, {precision}", f"area error (standard error {error:.1e})", 0.01
    )
    alone.add(len(n), worst=abs(n.mean() * of_box / 2 / of_solid - 1))
    yield alone.finding()

    few = max(rays // 4 // len(THICKNESS), LEAST_LINES // 50)
    unit = error_unit(whole, lines, precision).max()
    thick = Tally("X8", f"{kind} shells from {SEEN_FROM} E on, {precision}", "", 0.01)
    thin = Tally("X8", f"{kind} shells below, {precision}", "share of the area (no bar)", np.inf)
    largest_error = 0.0
    for thickness in THICKNESS:
        tree, known = shell(kind, thickness)
        count = min(
            int(few * (1 + 100 * thickness)), len(n)
        )  # thick shells resemble the solid less
        found, of_whole = crossings(tree, precision, lines[:count]), n[:count]
        share = found.mean() / of_whole.mean()
        if thickness < SEEN_FROM * unit:
            thin.add(count, worst=share * of_solid / known)
            continue
        residual = (found - share * of_whole).std() / of_whole.mean() * of_solid / known
        largest_error = max(largest_error, residual / np.sqrt(count))
        thick.add(count, worst=abs(share * of_solid / known - 1))
    thick.measured = f"area error (standard error {largest_error:.1e})"
    yield thick.finding()
    yield thin.finding()
