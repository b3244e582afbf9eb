"""X4: blocks aimed at where slabs meet, in and beside their planes, flat, far and denormal."""

from __future__ import annotations

import numpy as np

from harness.stability import Findings, row
from harness.stability.exact import Block
from harness.stability.judged import Tally, chunks, near_one, powers
from harness.stability.quadrics import REACH, Aim

_TREES = 16
_DENORMALS = np.array([5e-324, 1e-320, 1e-310])


def _signs(rng: np.random.Generator, n: int, choices: tuple[int, ...] = (-1, 1)) -> np.ndarray:
    return rng.choice(np.array(choices, float), (n, 3))


def corner(rng: np.random.Generator, half: np.ndarray, n: int) -> Aim:
    """At a vertex or off it by 1e-16..1e-1, at any angle, or along a diagonal."""
    point = _signs(rng, n) * half * near_one(rng, -16, -1, (n, 3)) ** rng.choice([0, 1], (n, 1))
    along = np.where(rng.random((n, 1)) < 0.5, rng.normal(size=(n, 3)), _signs(rng, n) * half)
    return point, along


def edge(rng: np.random.Generator, half: np.ndarray, n: int) -> Aim:
    """At a point of an edge, at any angle or along the edge."""
    axis = np.eye(3)[rng.integers(3, size=n)]
    on = np.where(axis > 0, rng.uniform(-1, 1, (n, 3)), _signs(rng, n))
    point = on * half * near_one(rng, -16, -1, (n, 3)) ** rng.choice([0, 1], (n, 1))
    tilt = rng.normal(size=(n, 3)) * powers(rng, -16, 0, (n, 1))
    return point, np.where(rng.random((n, 1)) < 0.5, rng.normal(size=(n, 3)), axis + tilt)


def face_plane(rng: np.random.Generator, half: np.ndarray, n: int) -> Aim:
    """In the plane of a face, or off it and tilted by 1e-16..1e-1."""
    axis = np.eye(3)[rng.integers(3, size=n)]
    on = np.where(axis > 0, _signs(rng, n) * near_one(rng, -16, -1, (n, 1)), 0)
    point = half * np.where(axis > 0, on, rng.uniform(-1.2, 1.2, (n, 3)))
    tilt = powers(rng, -16, -1, (n, 1)) * rng.choice([-1, 0, 1], (n, 1))
    return point, np.where(axis > 0, tilt, rng.normal(size=(n, 3)))


def zeros(rng: np.random.Generator, half: np.ndarray, n: int) -> Aim:
    """Directions with one or two entries +0 or −0."""
    along = _signs(rng, n) * rng.uniform(0.1, 1, (n, 3))
    kept = rng.permuted(np.tile([1, 0, 0], (n, 1)), axis=1).astype(bool)
    kept |= rng.random((n, 3)) < 0.25
    zero = np.copysign(0.0, _signs(rng, n))
    return half * _signs(rng, n, (-1, 0, 1)) * near_one(rng, -16, -1, (n, 3)), np.where(
        kept, along, zero
    )


def denormal(rng: np.random.Generator, half: np.ndarray, n: int) -> Aim:
    """Directions whose small entries have no normal exponent; so may the points aimed at."""
    point, along = zeros(rng, half, n)
    tiny = _signs(rng, n) * rng.choice(_DENORMALS, (n, 3))
    near_axis = rng.random((n, 1)) < 0.3
    return np.where(near_axis, tiny, point), np.where(along == 0, tiny, along)


_CASES = {
    "corner": (corner, 0, 2),
    "edge": (edge, 0, 2),
    "face plane": (face_plane, 0, 2),
    "±0 directions": (zeros, 0, 2),
    "flat": (corner, 8, 2),
    "far": (edge, 0, None),  # as far as the precision's farthest
    "denormal": (denormal, 0, 2),
}


@row(
    "X4",
    "block: corners, edges, planes, ±0, flat, far, denormal",
    tests=1_000_000,
    full=100_000_000,
)
def blocks(n: int, rng: np.random.Generator) -> Findings:
    for precision, (farthest, scales) in REACH.items():
        for case, (aim, thinnest, far) in _CASES.items():
            tally = Tally()
            for _, rays in chunks(n // (2 * len(_CASES)), _TREES):
                shape = powers(rng, -thinnest, 0, 3) if thinnest else rng.uniform(0.1, 1, 3)
                block = Block(*(shape * powers(rng, -scales, scales, ())))
                point, along = aim(rng, block.size, rays)
                direction = along / np.abs(along).max(axis=1, keepdims=True)
                back = powers(rng, -1, far or farthest, (rays, 1))
                origin = point - block.radius * back * direction
                tally.judge(block, origin, direction, {"precision": precision})
            yield tally.finding("X4", f"block, {case}, {precision}", 4)
