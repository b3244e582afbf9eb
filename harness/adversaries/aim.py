"""Rays aimed at whatever is delicate in a tree: its leaves, the walls of cells, its own hits."""

import numpy as np

import tracers
from harness.adversaries.walls import U, finite_bounds, offsets, walls


def targets(tree: "tracers.CsgTree", rng: np.random.Generator, count: int) -> np.ndarray:
    """(count, 3) points that matter: centres, corners, middles of edges and faces, rims."""
    leaf = rng.integers(tree.halfspaces, size=count)
    corner = rng.choice([-1.0, 0.0, 1.0], size=(count, 3))
    half = tree.sizes.copy()
    for i, kind in enumerate(tree.kinds):
        s = tree.sizes[i]
        half[i] = {
            "sphere": [s[0], s[0], s[0]],
            "block": s,
            "cylinder": [s[0], s[0], s[1]],
            "cone": [max(s[0], s[1]), max(s[0], s[1]), s[2]],
            "torus": [s[0] + s[1], s[0] + s[1], s[1]],
        }[kind]
    local = corner * half[leaf]
    matrices = tree.matrices[leaf]
    return np.einsum("nij,nj->ni", matrices[:, :, :3], local) + matrices[:, :, 3]


def rays_for(tree: "tracers.CsgTree", rng: np.random.Generator, count: int) -> np.ndarray:
    """(count, 8) rays: at random, along axes and edges, through vertices, from in and outside."""
    lo, hi = finite_bounds(tree)
    centre, radius = (lo + hi) / 2, max(float(np.linalg.norm(hi - lo)) / 2, 1e-3)
    inside = rng.uniform(lo, hi, (count, 3))
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    outside = centre + radius * direction * rng.uniform(1.1, 6, (count, 1))
    aim = targets(tree, rng, count)
    aim2 = targets(tree, rng, count)
    axis = np.eye(3)[rng.integers(3, size=count)] * rng.choice([-1.0, 1.0], (count, 1))

    kind = rng.integers(8, size=count)[:, None]
    origin = np.where(
        kind <= 2,
        outside,
        np.where(kind <= 4, inside, np.where(kind == 5, aim2, aim - 4 * radius * axis)),
    )
    along = np.where(kind == 0, inside - origin, np.where(kind == 3, direction, aim - origin))
    along = np.where((kind == 4) | (kind >= 6), axis, along)
    along = np.where(np.abs(along).max(axis=1)[:, None] > 1e-12, along, axis)
    along *= np.where(rng.random((count, 1)) < 0.2, 10.0 ** rng.uniform(-3, 3, (count, 1)), 1.0)
    rays = np.column_stack([origin, along, np.zeros(count), np.full(count, np.inf)])
    finite = rng.random(count) < 0.3
    rays[finite, 7] = rng.uniform(0, 8 * radius, int(finite.sum())) / np.linalg.norm(
        along[finite], axis=1
    )
    later = rng.random(count) < 0.1
    rays[later, 6] = (
        rng.uniform(-1, 1, int(later.sum())) * radius / np.linalg.norm(along[later], axis=1)
    )
    return np.ascontiguousarray(rays)


def onward(rays: np.ndarray, t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Rays from points that others hit, in new directions: reflections, shadows, grazing ones."""
    hit = np.isfinite(t)
    start = rays[hit, :3] + t[hit, None] * rays[hit, 3:6]
    away = rng.normal(size=start.shape)
    along = np.where(rng.random((len(start), 1)) < 0.3, -rays[hit, 3:6], away)
    return np.ascontiguousarray(
        np.column_stack([start, along, np.zeros(len(start)), np.full(len(start), np.inf)])
    )


def wall_rays(tree: "tracers.CsgTree", rng: np.random.Generator, count: int) -> np.ndarray:
    """(count, 8) rays in walls, along cells' edges, across their corners, and grazing faces, some
    offsets off; parallel to an axis but for 1e-30 or a denormal; from 0 to 1e6 sizes away."""
    corner = np.where(
        rng.random((count, 1)) < 0.7, walls(tree, rng, count), targets(tree, rng, count)
    )
    through = corner + rng.choice(offsets(tree.size), (count, 3))
    axis = np.eye(3)[rng.integers(3, size=count)] * rng.choice([-1.0, 1.0], (count, 1))
    sign = rng.choice([-1.0, 0.0, 1.0], (count, 3))
    along = np.where(axis == 0, np.copysign(0.0, sign), axis)
    kind = rng.integers(6, size=(count, 1))
    along += np.where(kind == 1, sign * 10.0 ** rng.uniform(-30, -3, (count, 3)), 0)
    along += np.where(kind == 2, sign * rng.choice([5e-324, 1e-320, 1e-310], (count, 3)), 0)
    along = np.where((kind == 3) & sign.any(axis=1)[:, None], sign, along)
    along = np.where(kind == 4, rng.normal(size=(count, 3)), along)
    back = rng.choice([0, 0, 1, 3, 20, 40, 1e3, 1e6], (count, 1)) * tree.size
    origin = through - back * along / np.linalg.norm(along, axis=1)[:, None]
    return np.column_stack([origin, along, np.zeros(count), np.full(count, np.inf)])


def cut_at_hits(rays: np.ndarray, t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The rays that hit, with t_min or t_max at the hit, an ulp off it, or within a few bands."""
    rays, t = rays[np.isfinite(t)].copy(), t[np.isfinite(t)]
    band = 16 * U * np.linalg.norm(rays[:, :3], axis=1) / np.linalg.norm(rays[:, 3:6], axis=1)
    at = [
        t,
        np.nextafter(t, -np.inf),
        np.nextafter(t, np.inf),
        t + band * rng.uniform(-3, 3, len(t)),
    ]
    limit = np.choose(rng.integers(4, size=len(t)), at)
    rays[np.arange(len(t)), rng.choice([6, 7], len(t))] = limit
    return rays


def all_rays(tree: "tracers.CsgTree", rng: np.random.Generator, count: int) -> np.ndarray:
    """At least `count` rays of every sort, the sequels of their hits among them."""
    rays = np.concatenate(
        [rays_for(tree, rng, count // 2), wall_rays(tree, rng, count - count // 2)]
    )
    t = tracers.make("naive", tree).trace(rays).t
    return np.concatenate([rays, onward(rays, t, rng), cut_at_hits(rays, t, rng)])
