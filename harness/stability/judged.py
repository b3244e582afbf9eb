"""Rays for the rows on single primitives, and the kernels' answers to them, judged by exact.py."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

import tracers
from harness.stability import Finding
from harness.stability.exact import UNIT_ROUNDOFF, Convex, Long, Rays, at
from harness.stability.exact_torus import Torus

_CHUNK = 200_000  # rays in memory at a time


def leaf_tree(kind: str, size: np.ndarray, matrix: np.ndarray | None = None) -> tracers.CsgTree:
    """A model of one primitive."""
    matrix = np.eye(3, 4) if matrix is None else matrix
    return tracers.CsgTree.build(
        [kind], size[None], matrix[None].astype(float), np.array([[0, 0, -1]], np.int32)
    )


class Tally:
    """What the rays of one case came to."""

    def __init__(self) -> None:
        self.rays = self.failures = self.excused = 0
        self.worst = self.worst_of_size = self.seconds = 0.0

    def judge(self, primitive: Convex | Torus, origin, dir, numerics: dict[str, str]) -> None:
        """Runs the kernel over lines given by float64 (N, 3), in the primitive's frame."""
        precision = numerics["precision"]
        rays = Rays.of(origin, dir, primitive.radius, precision)
        tree = leaf_tree(primitive.kind, primitive.size)
        count, t, seconds = tracers.crossings(tree, rays.rows, numerics)
        wrong, excused = primitive.flips(rays, count, t)
        for i in range(4):
            there = count > i
            off = np.abs(
                primitive.depth(at(rays.o[there], rays.d[there], t[there, i].astype(Long)))
            ).astype(float)
            self.worst = max(self.worst, float(np.max(off / rays.E[there], initial=0)))
            size = UNIT_ROUNDOFF[precision] * primitive.radius
            self.worst_of_size = max(self.worst_of_size, float(np.max(off / size, initial=0)))
        self.rays += len(rays.rows)
        self.seconds += seconds
        self.failures += int((wrong & ~excused).sum())
        self.excused += int((wrong & excused).sum())

    def finding(self, row: str, case: str, bar: float, red: str = "") -> Finding:
        return Finding(
            row,
            case,
            self.rays,
            "surface error, E",
            self.worst,
            bar,
            self.failures,
            self.excused,
            red,
        )


def chunks(n: int, parts: int) -> Iterator[tuple[int, int]]:
    """(part, rays): n rays over so many parts, none of more rays than fit in memory."""
    for part in range(parts):
        left = n * (part + 1) // parts - n * part // parts
        while left > 0:
            yield part, min(left, _CHUNK)
            left -= _CHUNK


def powers(rng: np.random.Generator, low: float, high: float, shape) -> np.ndarray:
    """10^x, x uniform."""
    return 10.0 ** rng.uniform(low, high, shape)


def near_one(rng: np.random.Generator, low: float, high: float, shape) -> np.ndarray:
    """1 ± 10^x."""
    return 1 + rng.choice([-1, 1], shape) * powers(rng, low, high, shape)


def frames(rng: np.random.Generator, n: int, aligned: float = 0.25) -> np.ndarray:
    """(n, 3, 3) orthonormal, in rows; a share of them the axes themselves, permuted, so that far
    origins do not blur the aim."""
    q, _ = np.linalg.qr(rng.normal(size=(n, 3, 3)))
    axes = np.eye(3)[rng.permuted(np.tile(np.arange(3), (n, 1)), axis=1)]
    axes *= rng.choice([-1.0, 1.0], (n, 3, 1))
    return np.where(rng.random((n, 1, 1)) < aligned, axes, q)


def unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def merged(tallies: Iterable[Tally]) -> Tally:
    """One tally of several."""
    total = Tally()
    for tally in tallies:
        total.rays += tally.rays
        total.failures += tally.failures
        total.excused += tally.excused
        total.seconds += tally.seconds
        total.worst = max(total.worst, tally.worst)
        total.worst_of_size = max(total.worst_of_size, tally.worst_of_size)
    return total
