"""X11, X12, X13: what must not change an answer: units, the way a solid is written, the axes, the
direction in which a line is walked, and the scheme."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

import tracers
from harness.adversaries import FAMILIES
from harness.adversaries.aim import all_rays
from harness.adversaries.families import DIFFERENCE, INTERSECTION, UNION, Solid, combine
from harness.adversaries.walls import part
from harness.stability import Findings, row
from harness.stability.scenes import (
    BAND,
    EXCUSED_COSINE,
    GUARD,
    PRECISIONS,
    Layers,
    Tally,
    directions,
    error_unit,
    rays_through,
    walk,
)

RAYS_PER_TREE, SETTINGS_A_TREE = 2_000, 3
EXACT = [scheme for scheme in tracers.schemes() if scheme.exact]


def settings(scheme) -> list[dict]:
    """All combinations of the values that a scheme wants tried."""
    names = [p.name for p in scheme.parameters]
    values = itertools.product(*(p.trial_values for p in scheme.parameters))
    return [dict(zip(names, combination, strict=True)) for combination in values]


def solids(
    total: int, rng: np.random.Generator, per_tree: int = RAYS_PER_TREE
) -> Iterator[tuple[int, tracers.CsgTree, np.ndarray]]:
    """Numbered trees, of all families in turn; rays (n, 8) that add up to at least the total."""
    number = done = 0
    while done < total or number < len(FAMILIES):
        tree = list(FAMILIES.values())[number % len(FAMILIES)](rng)
        rays = all_rays(tree, rng, min(-(-total // len(FAMILIES)), per_tree))
        rays[np.abs(rays) < 1e-300] = 0  # near denormals, scaling by a power of two is not exact
        yield number, tree, rays
        number, done = number + 1, done + len(rays)


def scaled(rays: np.ndarray, exponent: int) -> np.ndarray:
    """Origins, t_min and t_max in units 2**exponent times as large; the direction stays."""
    out = rays.copy()
    out[:, [0, 1, 2, 6, 7]] = np.ldexp(out[:, [0, 1, 2, 6, 7]], exponent)
    return out


def unlike(hits, t: np.ndarray, leaf: np.ndarray) -> int:
    return int(((hits.t != t) | (hits.leaf != leaf)).sum())


EXPONENTS = (-30, -17, -1, 1, 10, 30)


@row("X11", "the scene times 2^k, k from -30 to 30", tests=20_000, full=3_000_000)
def other_units(rays: int, rng: np.random.Generator) -> Findings:
    """t·2^-k and leaf, bits; every scheme in one of its settings in turn."""
    tallies = {
        (scheme.name, precision): Tally("X11", f"{scheme.name}, {precision}", "other bits")
        for scheme, precision in itertools.product(EXACT, PRECISIONS)
    }
    for number, tree, batch in solids(rays // (len(EXPONENTS) * len(PRECISIONS)), rng):
        for precision in PRECISIONS:
            numerics = {"precision": precision}
            truth = tracers.make("naive", tree, numerics).trace(batch)
            t, leaf = truth.t, truth.leaf
            for exponent, scheme in itertools.product(EXPONENTS, EXACT):
                params = settings(scheme)[number % len(settings(scheme))]
                tracer = tracers.make(scheme.name, tree.scaled(exponent), params | numerics)
                hits = tracer.trace(scaled(batch, exponent))
                wrong = unlike(hits, np.ldexp(t, exponent), leaf)
                tallies[scheme.name, precision].add(len(batch), wrong)
    yield from (tally.finding() for tally in tallies.values())


@row("X13", "all exact schemes, over their settings", tests=10_000_000, full=1_000_000_000)
def all_schemes(rays: int, rng: np.random.Generator) -> Findings:
    """Leaf and bits of t against naive's; `occluded` against `trace`. Rays go by the scheme, in one
    of its settings, that answers them."""
    others = [scheme for scheme in EXACT if scheme.name != "naive"]
    tallies = {
        (scheme.name, precision): Tally("X13", f"{scheme.name}, {precision}", "other bits")
        for scheme, precision in itertools.product(others, PRECISIONS)
    }
    total = -(-rays // (len(tallies) * SETTINGS_A_TREE))
    for number, tree, batch in solids(total, rng, per_tree=4_000):
        for precision in PRECISIONS:
            numerics = {"precision": precision}
            truth = tracers.make("naive", tree, numerics).trace(batch)
            t, leaf = truth.t, truth.leaf
            for scheme in others:
                grid = settings(scheme)
                for k in range(SETTINGS_A_TREE):
                    params = grid[(SETTINGS_A_TREE * number + k) % len(grid)]
                    tracer = tracers.make(scheme.name, tree, params | numerics)
                    wrong = unlike(tracer.trace(batch), t, leaf)
                    wrong += int((tracer.occluded(batch).astype(bool) != (leaf >= 0)).sum())
                    tallies[scheme.name, precision].add(len(batch), wrong)
    yield from (tally.finding() for tally in tallies.values())


# ---- X12 ----------------------------------------------------------------------------------------


def mirrored(node: list) -> list:
    """Operands of ∪ and ∩ in the other order."""
    if node[0] == "leaf":
        return node
    left, right = mirrored(node[1]), mirrored(node[2])
    return [node[0], left, right] if node[0] == DIFFERENCE else [node[0], right, left]


def by_complements(node: list, solid: Solid, world) -> list:
    """De Morgan: A ∩ B = W − ((W − A) ∪ (W − B)), and A ∪ B likewise; A − B = A ∩ (W − B)."""
    if node[0] == "leaf":
        return node
    a, b = by_complements(node[1], solid, world), by_complements(node[2], solid, world)

    def complement(part: list) -> list:
        return [DIFFERENCE, solid.leaf(*world), part]

    if node[0] == DIFFERENCE:
        return [INTERSECTION, a, complement(b)]
    other = UNION if node[0] == INTERSECTION else INTERSECTION
    return complement([other, complement(a), complement(b)])


HALF = 8.0  # of a line through the solid: both ends are outside, and as far from it
WORLD = ("block", [6.0, 6.0, 6.0], np.eye(3, 4))


def rewritten(rng: np.random.Generator) -> dict[str, tracers.CsgTree]:
    """One random solid within a block, which sets the size of all, written in several ways."""
    solid = Solid()
    root = combine(rng, [part(solid, rng, 0.6) for _ in range(rng.integers(3, 12))])

    def within(node: list) -> tracers.CsgTree:
        return solid.tree([INTERSECTION, node, solid.leaf(*WORLD)])

    return {
        "as written": within(root),
        "commuted": within(mirrored(root)),
        "complements": within(by_complements(root, solid, WORLD)),
    }


def permuted(tree: tracers.CsgTree, rays: np.ndarray, axes) -> tuple[tracers.CsgTree, np.ndarray]:
    matrices = np.ascontiguousarray(tree.matrices[:, axes])
    turned = rays.copy()
    turned[:, 0:3], turned[:, 3:6] = rays[:, axes], rays[:, [3 + axis for axis in axes]]
    return tracers.CsgTree.build(tree.kinds, tree.sizes, matrices, tree.operators), turned


def backwards(rays: np.ndarray, length: float) -> np.ndarray:
    """From `length` times the direction on, back."""
    out = rays.copy()
    out[:, :3] += length * rays[:, 3:6]
    out[:, 3:6] = -rays[:, 3:6]
    return out


def reversed_layers(layers: Layers, length: float) -> Layers:
    """As seen from the other end: t becomes length − t."""
    order = np.argsort(-np.where(np.isfinite(layers.t), layers.t, -np.inf), axis=1, kind="stable")
    t = length - np.take_along_axis(layers.t, order, 1)
    return Layers(
        np.where(np.isfinite(t), t, np.inf),
        np.take_along_axis(layers.cosine, order, 1),
        np.take_along_axis(layers.leaf, order, 1),
    )


def near_ties(tree: tracers.CsgTree, rays: np.ndarray, unit: np.ndarray, precision: str):
    """(N,) whether two crossings of any leaves, not only such as bound the solid, are closer than
    two of the widest bands, or one is so close to the ray's start."""
    numerics = {"precision": precision}
    found = [tracers.crossings(tree, rays, numerics, i)[1] for i in range(tree.halfspaces)]
    t = np.sort(np.concatenate([np.zeros((len(rays), 1)), *found], axis=1), axis=1)
    with np.errstate(invalid="ignore"):  # inf − inf, behind the last
        gap = np.diff(t, axis=1)
    return (gap < 2 * BAND * (unit / EXCUSED_COSINE[precision])[:, None]).any(axis=1)


def compare_spans(tally: Tally, a: Layers, b: Layers, unit: np.ndarray, near: np.ndarray) -> None:
    wrong = a.count != b.count
    k = min(a.t.shape[1], b.t.shape[1])
    both = np.isfinite(a.t[:, :k]) & np.isfinite(b.t[:, :k]) & ~(wrong | near)[:, None]
    with np.errstate(invalid="ignore"):
        off = np.abs(a.t[:, :k] - b.t[:, :k]) * a.cosine[:, :k] / unit[:, None]
    worst = off[both].max() if both.any() else None
    tally.add(len(near), (wrong & ~near).sum(), (wrong & near).sum(), worst)


@row("X12", "one solid written in several ways", tests=40_000, full=4_000_000)
def equal_spans(rays: int, rng: np.random.Generator) -> Findings:
    """Layers along the whole ray; their distance in E. Near ties are excused."""
    ways = ("commuted", "complements", "axes permuted", "ray reversed")
    tallies = {
        (way, precision): Tally("X12", f"{way}, {precision}", "distance of spans, E", GUARD)
        for way, precision in itertools.product(ways, PRECISIONS)
    }
    for _ in range(max(rays // (RAYS_PER_TREE * len(tallies)), 1)):
        trees = rewritten(rng)
        tree = trees.pop("as written")
        points = rng.uniform(-1.5, 1.5, (RAYS_PER_TREE, 3))
        batch = rays_through(points, directions(rng, RAYS_PER_TREE), HALF)
        for precision in PRECISIONS:
            numerics = {"precision": precision}
            unit = error_unit(tree, batch, precision)
            near = near_ties(tree, batch, unit, precision)
            tracer = tracers.make("naive", tree, numerics)
            found = walk(tracer, tree, batch, precision)
            for way, other in trees.items():
                seen = walk(tracers.make("naive", other, numerics), other, batch, precision)
                compare_spans(tallies[way, precision], found, seen, unit, near)
            other, turned = permuted(tree, batch, [2, 0, 1])
            seen = walk(tracers.make("naive", other, numerics), other, turned, precision)
            compare_spans(tallies["axes permuted", precision], found, seen, unit, near)
            seen = walk(tracer, tree, backwards(batch, 2 * HALF), precision)
            seen = reversed_layers(seen, 2 * HALF)
            compare_spans(tallies["ray reversed", precision], found, seen, unit, near)
    yield from (tally.finding() for tally in tallies.values())
