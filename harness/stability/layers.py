"""X7: layers that are not there must not be seen, and layers that are there must be: surfaces that
are one in the source, reached through different decimals. X8 is gaps.py, X9 contacts.py.
"""

from __future__ import annotations

import itertools
from fractions import Fraction

import numpy as np

import tracers
from harness.stability import Findings, row
from harness.stability.scenes import (
    BAND,
    EXCUSED_COSINE,
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

# ---- X7: the same surface through different decimals, as .csg text ------------------------------

PRIMITIVES = {
    "sphere": "sphere(r = 0.7);",
    "block": "cube(size = [0.9, 0.7, 1.1], center = true);",
    "cylinder": "cylinder(h = 1.3, r1 = 0.6, r2 = 0.6, center = true);",
    "cone": "cylinder(h = 1.3, r1 = 0.7, r2 = 0.2, center = true);",
    "torus": "rotate_extrude() { multmatrix([[1, 0, 0, 0.6], [0, 1, 0, 0], [0, 0, 1, 0], "
    "[0, 0, 0, 1]]) { circle(r = 0.3); } }",
}


def _text(matrix, child: str) -> str:
    rows = [[float(x) for x in line] for line in matrix]
    return f"multmatrix({[*rows, [0.0, 0.0, 0.0, 1.0]]}) {{ {child} }}"


def _fractions(text: str) -> list[list[Fraction]]:
    """Twelve decimals, a row of four after another."""
    numbers = [Fraction(word) for word in text.split()]
    return [numbers[0:4], numbers[4:8], numbers[8:12]]


def _product(a, b):
    return [
        [sum(a[i][k] * b[k][j] for k in range(3)) + (a[i][3] if j == 3 else 0) for j in range(4)]
        for i in range(3)
    ]


MOVE = "1 0 0 {} 0 1 0 {} 0 0 1 {}"
TURN_Z, TURN_X = "0.6 -0.8 0 0 0.8 0.6 0 0 0 0 1 0", "1 0 0 0 0 0.28 -0.96 0 0 0.96 0.28 0"
GROW, SHRINK = "10 0 0 0 0 10 0 0 0 0 10 0", "0.1 0 0 0 0 0.1 0 0 0 0 0.1 0"
# Each chain is one map in decimals of few digits: its exact product can be written down as well.
CHAINS = {
    "sums": [MOVE.format("0.1", "0.7", "-1.1"), MOVE.format("0.2", "0.1", "0.3")],
    "turns": [TURN_Z, TURN_X, TURN_Z],
    "turn and move": [TURN_Z, MOVE.format("0.3", "0.1", "0.7"), TURN_X],
    "scales": [GROW, MOVE.format("0.03", "0.07", "0.01"), SHRINK, TURN_Z],
}


def two_ways(kind: str, chain: str) -> tuple[str, str]:
    """A primitive placed by the chain, and by the chain's product."""
    whole = None
    nested = PRIMITIVES[kind]
    for matrix in reversed([_fractions(text) for text in CHAINS[chain]]):
        nested = _text(matrix, nested)
        whole = matrix if whole is None else _product(matrix, whole)
    return nested, _text(whole, PRIMITIVES[kind])


def parsed(operator: str, *children: str) -> tracers.CsgTree:
    return tracers.parse_csg(f"{operator}() {{ {' '.join(children)} }}", "row.csg")


LEAST_RADIUS = 0.2  # of curvature, of the round ones
ANGLES = np.array([0, 30, 60, 80, 88, 89, 89.9, 89.99, 89.999, 89.9999])


def surface_rays(tree, precision: str, rng: np.random.Generator, count: int) -> np.ndarray:
    """(count, 8) rays that meet the surface of the solid at one of ANGLES, in a random direction
    around the normal, and one third of them anywhere."""
    tracer = tracers.make("naive", tree, {"precision": precision})
    points, normals = np.empty((0, 3)), np.empty((0, 3))
    lo, hi = tree.bounds
    while len(points) < count:
        probe = rays_through(rng.uniform(lo, hi, (count, 3)), directions(rng, count), 2 * tree.size)
        hits = tracer.trace(probe)
        hit = hits.leaf >= 0
        points = np.concatenate([points, (probe[:, :3] + hits.t[:, None] * probe[:, 3:6])[hit]])
        normals = np.concatenate([normals, hits.normal[hit]])
    points, normals = points[:count], normals[:count]
    aside = np.cross(normals, directions(rng, count))
    aside /= np.linalg.norm(aside, axis=1)[:, None]
    angle = np.deg2rad(rng.choice(ANGLES, count))[:, None]
    along = -np.cos(angle) * normals + np.sin(angle) * aside
    along = np.where(rng.random((count, 1)) < 1 / 3, directions(rng, count), along)
    return rays_through(points, along, rng.choice([1.0, 2.0, 8.0], count) * tree.size)


def tangent_within_guard(layers, unit: np.ndarray, curvature_radius: float) -> np.ndarray:
    """(N,) whether a ray grazes a surface so that it clears it by less than the guard: at depth e
    below a surface of radius r, the cosine is √(2e/r)."""
    least = np.sqrt(2 * GUARD * unit / curvature_radius)[:, None]
    return ((layers.cosine < least) & np.isfinite(layers.t)).any(axis=1)


@row("X7", "surfaces that are one but for rounding", tests=30_000, full=3_600_000)
def coincident(rays: int, rng: np.random.Generator) -> Findings:
    cases = [*itertools.product(PRIMITIVES, ["same text", *CHAINS])]
    share = max(rays // (2 * (len(cases) + len(FLUSH))), 1)
    for precision in PRECISIONS:
        for kind, chain in cases:
            yield from _kin(kind, chain, precision, share, rng)
        for case in FLUSH:
            yield from _flush(case, precision, share, rng)


def _kin(kind: str, chain: str, precision: str, rays: int, rng) -> Findings:
    """A − A must be empty, A ∩ A and A ∪ A must be A, which has no layers but its own."""
    first, second = (PRIMITIVES[kind],) * 2 if chain == "same text" else two_ways(kind, chain)
    alone = parsed("union", first)
    trees = {name: parsed(name, first, second) for name in ("difference", "intersection", "union")}
    numerics = {"precision": precision}
    single = tracers.make("naive", alone, numerics)
    tallies = {
        name: Tally("X7", f"{kind}, {chain}, {name}, {precision}", "layers unlike A's")
        for name in trees
    }
    for count in chunks(rays):
        batch = surface_rays(alone, precision, rng, count)
        unit = error_unit(alone, batch, precision)
        expected = walk(single, alone, batch, precision)
        grazing = tangent_within_guard(expected, unit, np.inf if kind == "block" else LEAST_RADIUS)
        for name, tree in trees.items():
            found = walk(tracers.make("naive", tree, numerics), tree, batch, precision)
            wrong = found.count != (0 if name == "difference" else expected.count)
            tallies[name].add(count, (wrong & ~grazing).sum(), (wrong & grazing).sum())
    yield from (tally.finding() for tally in tallies.values())


def cube(corner: str, size: str, in_steps: bool) -> str:
    """A cube of three decimals, its corner reached in one move, or in steps, the last of 0.1; then
    turned by TURNED."""
    at = [Fraction(word) for word in corner.split()]
    steps = [[x - Fraction(1, 10) for x in at], [Fraction(1, 10)] * 3] if in_steps else [at]
    text = f"cube(size = [{', '.join(size.split())}], center = false);"
    for matrix in [*(_fractions(MOVE.format(*step)) for step in steps), *TURNED]:
        text = _text(matrix, text)
    return text


TURNED = [_fractions(TURN_X), _fractions(TURN_Z)]
# Booleans that make one box, [0.1, 1]² × [0.1, its top].
FLUSH = {
    "flush difference": (
        "difference",
        [cube("0.1 0.1 0.1", "0.9 0.9 0.2", False), cube("-0.1 -0.1 0.2", "1.3 1.3 0.1", True)],
        Fraction("0.2"),
    ),
    "coplanar union": (
        "union",
        [
            cube("0.1 0.1 0.1", "0.9 0.9 0.2", False),
            cube("0.1 0.1 0.3", "0.9 0.9 0.1", True),
            cube("0.1 0.1 0.4", "0.9 0.9 0.6", False),
        ],
        Fraction(1),
    ),
}


def extended(values) -> np.ndarray:
    """Fractions as long doubles, rounded once."""
    flat = np.ravel(np.array(values, dtype=object))
    exact = [np.longdouble(f.numerator) / np.longdouble(f.denominator) for f in map(Fraction, flat)]
    return np.array(exact).reshape(np.shape(values))


def _in_box_frame(rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Origins and directions (N, 3) in the frame TURNED, extended precision."""
    frame = extended([line[:3] for line in _product(TURNED[1], TURNED[0])])  # world from local
    return rays[:, :3] @ frame, rays[:, 3:6] @ frame


def box_spans(rays: np.ndarray, lo: np.ndarray, hi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N,) where rays enter a box in the frame TURNED, and where they leave it; for a miss, the
    first is the later."""
    origin, along = _in_box_frame(rays)
    t = np.sort(np.stack([(lo - origin) / along, (hi - origin) / along]), axis=0)
    return t[0].max(axis=1), t[1].min(axis=1)


def box_chord(rays: np.ndarray, lo: np.ndarray, hi: np.ndarray) -> np.ndarray:
    """(N,) how long rays are in the box; negative for a miss."""
    enter, leave = box_spans(rays, lo, hi)
    return leave - enter


def box_distance(rays: np.ndarray, t: np.ndarray, lo: np.ndarray, hi: np.ndarray) -> np.ndarray:
    """(N, K) distance of points at t (N, K) from the box's surface, along the nearest axis."""
    origin, along = _in_box_frame(rays)
    at = origin[:, None] + np.where(np.isfinite(t), t, 0)[..., None] * along[:, None]
    return np.abs(np.maximum(lo - at, at - hi).max(axis=2))


def _flush(case: str, precision: str, rays: int, rng) -> Findings:
    operator, children, top = FLUSH[case]
    tree = parsed(operator, *children)
    tracer = tracers.make("naive", tree, {"precision": precision})
    tenth, one = Fraction(1, 10), Fraction(1)
    lo, hi = extended([tenth] * 3), extended([one, one, top])
    tally = Tally("X7", f"{case}, {precision}", "surface error, E", GUARD)
    unexplained = False
    for count in chunks(rays):
        batch = surface_rays(tree, precision, rng, count)
        unit = error_unit(tree, batch, precision)
        found = walk(tracer, tree, batch, precision)
        chord = box_chord(batch, lo, hi)
        guard = GUARD * unit[:, None]
        inner = box_chord(batch, lo + guard, hi - guard)
        outer = box_chord(batch, lo - guard, hi + guard)
        # Where the box, smaller by the guard, is missed or left within two of the widest bands, and
        # the box larger by it is not missed, either answer is right.
        least = 2 * BAND * unit / EXCUSED_COSINE[precision]
        open_to_doubt = (inner < least) & (outer > 0)
        wrong = found.count != np.where(chord > 0, 2, 0)
        k = min(found.t.shape[1], 2)
        seen = np.isfinite(found.t[:, :k])
        off = box_distance(batch, found.t[:, :k], lo, hi) / unit[:, None]
        worst = off[seen].max() if seen.any() else None
        failed = wrong & ~open_to_doubt
        tally.add(count, failed.sum(), (wrong & open_to_doubt).sum(), worst)
        flat = (np.abs(_in_box_frame(batch)[1]) < LEAST_COSINE[precision]).any(axis=1)
        unexplained |= bool((failed & ~flat).any())
    tally.red = "" if unexplained else RED_WHERE_GRAZED[precision]
    yield tally.finding()
