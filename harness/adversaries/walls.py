"""Trees that broke the tracers even after families.py passed: the second wave.

Most aim at rule 9, where a box is judged a little larger than it is: faces exactly on the walls of
cells, and one pad P or one tie band off them.
"""

from functools import reduce

import numpy as np

import tracers
from harness.adversaries.families import (
    DIFFERENCE,
    INTERSECTION,
    KINDS,
    UNION,
    Family,
    Solid,
    combine,
    placed,
    random_size,
    rotation,
)

U = 2.0**-53
LIMITS = tracers.limits("float64")


def offsets(size: float, precision: str = "float64") -> np.ndarray:
    """Distances from a wall at which something changes: ulps, bands, the widest bands, the pad."""
    limits, unit = tracers.limits(precision), {"float64": U, "float32": 2.0**-24}[precision]
    pad, band = limits["pad"] * size, 16 * unit * 2 * size
    widest = band / limits["min_cosine"]
    by = [pad / 2, pad, band, widest, 2 * widest, pad - widest, pad - 2 * widest, size * U]
    return np.array([0, 0, 0, 0, *by, *(-b for b in by)])


def finite_bounds(tree: "tracers.CsgTree") -> np.ndarray:
    return tree.bounds if np.isfinite(tree.bounds).all() else np.array([[-1.0] * 3, [1.0] * 3])


def walls(tree: "tracers.CsgTree", rng: np.random.Generator, count: int) -> np.ndarray:
    """(count, 3) corners of the octree's cells, of levels 0 to 4: its root is the cube around the
    padded world. The grid's walls are the same where the world is a cube."""
    lo, hi = finite_bounds(tree)
    side = (hi - lo).max() / 2 + LIMITS["pad"] * tree.size
    parts = 2.0 ** rng.integers(0, 5, (count, 3))
    return (lo + hi) / 2 + side * np.floor(rng.uniform(-1, 1 + 1 / parts) * parts) / parts


def faces_on_walls(rng: np.random.Generator) -> "tracers.CsgTree":
    """Faces on walls and a pad or a band off them: boxes padded after being combined lost these."""
    solid = Solid()
    centre = rng.uniform(-1, 1, 3) * rng.choice([0, 1, 100])
    parts = [solid.leaf("block", [1, 1, float(rng.choice([1, 0.3]))], placed(*centre))]
    world = solid.tree(parts[0])
    off = offsets(world.size)
    for a, b in walls(world, rng, 24).reshape(12, 2, 3):
        lo, hi = np.minimum(a, b) + rng.choice(off, 3), np.maximum(a, b) + rng.choice(off, 3)
        if (hi <= lo).any():
            continue
        half = (hi - lo) / 2
        scale = rng.uniform(0.3, 3, 3) if rng.random() < 0.5 else np.ones(3)
        thin = half.min() < 1e-6  # a round one would be singular
        kind = "block" if thin else KINDS[rng.choice(4, p=[0.1, 0.7, 0.1, 0.1])]
        local = half / scale
        size = {"sphere": [1], "block": local, "cylinder": [1, 1], "cone": [1, 0.5, 1]}[kind]
        linear = np.diag(scale if kind == "block" else half)
        parts.append(solid.leaf(kind, list(size), placed(*(lo + hi) / 2, linear)))
    rest = combine(rng, parts[1:]) if len(parts) > 1 else solid.leaf("sphere", [0.3])
    return solid.tree([int(rng.choice([DIFFERENCE, UNION])), parts[0], rest])


def tie_past_an_edge(rng: np.random.Generator) -> "tuple[tracers.CsgTree, np.ndarray]":
    """Blocks a fraction of a band apart, and a ray (1, 8) that starts at a cell's edge two of the
    widest bands before the slit: embree_cells, which asks each cell by itself, saw half of the tie.
    A small sphere makes the octree divide."""
    solid = Solid()
    size, z = float(np.sqrt(12)), 0.2
    pad, band = LIMITS["pad"] * size, 16 * U * (z + size) / np.sqrt(2)
    widest = band / LIMITS["min_cosine"]
    x, y = rng.uniform(-3, 0.5) * widest, rng.uniform(-3, 3) * widest - pad
    lo, hi = -1.0, x + 2 * widest - (y + pad) + rng.uniform(-3, 3) * band
    blocks = []
    while not blocks or lo < hi:
        half, middle = (hi - lo) / 2, (hi + lo) / 2
        blocks.append(solid.leaf("block", [half, 1, 1], placed(middle, 0, 0)))
        lo = hi + rng.uniform(0.1, 1.2) * band
        thin = lo + rng.uniform(0.1, 1.2) * band
        hi = 1.0 if hi == 1 or len(blocks) == 3 or rng.random() < 0.4 else thin
    union = reduce(lambda a, b: [UNION, a, b], blocks)
    root = [DIFFERENCE, union, solid.leaf("sphere", [0.05], placed(0.25, 0.25, z))]
    return solid.tree(root), np.array([[x, y, z, 1, 1, 0, 0, np.inf]])


def ties_at_walls(rng: np.random.Generator) -> "tracers.CsgTree":
    """A slit of less than a band at a cell's wall."""
    return tie_past_an_edge(rng)[0]


def ulp_apart(rng: np.random.Generator) -> "tracers.CsgTree":
    """A ∩ B with boxes disjoint by an ulp: not empty to rays that graze, from far, the slit."""
    solid = Solid()
    at = rng.uniform(-0.4, 0.4)
    a, b = rng.uniform(0.3, 1, 2)
    centre = at + b
    while not (at - a) + a < centre - b:
        b = np.nextafter(b, 0)
    parts = [solid.leaf("block", [a, 1, 1], placed(at - a, 0, 0))]
    parts.append(solid.leaf("block", [b, 1, 1], placed(centre, 0, 0)))
    root = [INTERSECTION, *parts]
    if rng.random() < 0.5:
        root = [UNION, root, solid.leaf("sphere", [0.3], placed(0, 0.5, 0))]
    return solid.tree(root)


def part(solid: Solid, rng: np.random.Generator, scale: float, spread=1.0, centre=0.0) -> list:
    """Any primitive, any rotation, within `spread` of the centre."""
    kind = KINDS[rng.integers(5)]
    matrix = placed(*(centre + rng.uniform(-spread, spread, 3)), rotation(rng))
    return solid.leaf(kind, random_size(rng, kind, scale), matrix)


def huge_subtrahend(rng: np.random.Generator) -> "tracers.CsgTree":
    """A small solid minus one of 10 to 1e7 times its size, which alone sets `size` and so E."""
    solid = Solid()
    small = [part(solid, rng, 1.0, 0.5) for _ in range(rng.integers(2, 6))]
    radius = 10.0 ** rng.uniform(1, 7)
    away = placed(radius + rng.uniform(-1, 1), 0, 0)
    huge = solid.leaf(KINDS[rng.integers(2)], [radius] * 3, away)
    return solid.tree([DIFFERENCE, combine(rng, small), huge])


def complements(rng: np.random.Generator) -> "tracers.CsgTree":
    """Cells that are Full but for a few subtrahends: chains of NOT B (rule 10)."""
    solid = Solid()
    root = solid.leaf("block", [3, 3, 3])
    for _ in range(rng.integers(3, 20)):
        hole = part(solid, rng, 1.5)
        if rng.random() < 0.6:
            hole = [DIFFERENCE, solid.leaf("sphere", [2.5]), hole]
        root = [INTERSECTION if rng.random() < 0.3 else DIFFERENCE, root, hole]
    return solid.tree(root)


def deep_chains(rng: np.random.Generator) -> "tracers.CsgTree":
    """A − B − C − …, 30 to 1000 deep."""
    solid = Solid()
    root = solid.leaf("block", [1, 1, 1])
    for _ in range(rng.choice([30, 100, 1000], p=[0.6, 0.35, 0.05])):
        root = [DIFFERENCE if rng.random() < 0.8 else UNION, root, part(solid, rng, 0.3)]
    return solid.tree(root)


def thin_shells(rng: np.random.Generator) -> "tracers.CsgTree":
    """A minus A smaller by 1e-16 to 1e-3: both walls fall into one tie band, or just do not."""
    solid = Solid()
    shells = []
    for _ in range(rng.integers(1, 8)):
        outer = part(solid, rng, 1.0, rng.choice([0, 0.5]))
        kind, (a, b, c), matrix = solid.kinds[-1], solid.sizes[-1], solid.matrices[-1]
        thin = 1 - 10.0 ** rng.uniform(-16, -3)
        inner = [a if kind == "torus" else a * thin, b * thin, c * thin]
        shells.append([DIFFERENCE, outer, solid.leaf(kind, inner, matrix)])
    return solid.tree(combine(rng, shells))


def far_from_origin(rng: np.random.Generator) -> "tracers.CsgTree":
    """Unit solids 10 to 1e6 from the origin: the pad must grow with |o|, not with the extent."""
    solid = Solid()
    centre = rng.normal(size=3) * 10.0 ** rng.uniform(1, 6)
    parts = [part(solid, rng, 1.0, 0.6, centre) for _ in range(rng.integers(2, 9))]
    return solid.tree(combine(rng, parts))


def rods(rng: np.random.Generator) -> "tracers.CsgTree":
    """Condition 1e4 to 1e8: adjugates lost digits, and one pad for all leaves was too thin."""
    solid = Solid()
    thin = 10.0 ** -rng.uniform(4, 8)
    parts = [part(solid, rng, 1.5, 0.5) for _ in range(rng.integers(1, 7))]
    for matrix in solid.matrices:
        matrix[:, :3] = matrix[:, :3] @ np.diag(rng.permutation([1, thin, thin])) @ rotation(rng)
    return solid.tree(combine(rng, parts))


HARD = (faces_on_walls, ties_at_walls, ulp_apart, huge_subtrahend, complements, deep_chains)
HARD += (thin_shells, far_from_origin, rods)
SECOND_WAVE: dict[str, Family] = {f.__name__: f for f in HARD}
