"""X15: rays that are none, and arithmetic that flushes denormals to zero."""

from __future__ import annotations

import ctypes
import platform
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

import tracers
from harness.stability import Finding, Findings, row
from harness.stability.exact import (
    UNIT_ROUNDOFF,
)
from harness.stability.judged import unit

_SLOWEST = 2.5  # times the time of ordinary rays
_FLUSH = 0x8040  # of the register MXCSR: flush results to zero, take denormal operands as zero


@contextmanager
def flush_to_zero() -> Iterator[bool]:
    """This thread's SSE arithmetic without denormals; False where that cannot be had. Through the C
    library's floating-point environment, of which MXCSR is the last word on x86-64."""
    if platform.machine() != "x86_64" or platform.libc_ver()[0] != "glibc":
        yield False
        return
    libm = ctypes.CDLL("libm.so.6")
    before, flushing = (ctypes.c_uint32 * 8)(), (ctypes.c_uint32 * 8)()
    libm.fegetenv(before)
    libm.fegetenv(flushing)
    flushing[7] |= _FLUSH
    libm.fesetenv(flushing)
    try:
        yield True
    finally:
        libm.fesetenv(before)


def _model() -> tracers.CsgTree:
    """One of each primitive, united."""
    return tracers.parse_csg(
        """sphere(r = 1);
        multmatrix([[1, 0, 0, 2], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]) {
          cube(size = [1, 2, 3], center = true);
          cylinder(h = 4, r1 = 0.5, r2 = 0.5, center = true); }
        multmatrix([[1, 0, 0, 0], [0, 0.8, -0.6, 2], [0, 0.6, 0.8, 0], [0, 0, 0, 1]]) {
          cylinder(h = 2, r1 = 1, r2 = 0, center = true);
          rotate_extrude(convexity = 2) {
            multmatrix([[1, 0, 0, 2], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]) {
              circle(r = 0.25); } } }"""
    )


def _ordinary(rng: np.random.Generator, n: int) -> np.ndarray:
    """(n, 8) rays at the model; a tenth of the directions are denormal but for one entry."""
    aim, origin = rng.uniform(-2, 3, (n, 3)), 8 * unit(rng.normal(size=(n, 3)))
    axis = np.eye(3)[rng.integers(3, size=n)]
    straight = np.where(axis > 0, 1, rng.choice([5e-324, -1e-310, 1e-308], (n, 3)))
    chosen = rng.random((n, 1)) < 0.1
    along = np.where(chosen, straight, aim - origin)
    origin = np.where(chosen, aim - 8 * axis, origin)
    return np.column_stack([origin, along, np.zeros(n), np.full(n, np.inf)])


def _not_rays(rng: np.random.Generator, n: int) -> np.ndarray:
    """(n, 8): some entry NaN or infinite, or all of the direction ±0."""
    rays = _ordinary(rng, n)
    kind = rng.integers(4, size=n)
    poison = np.array([np.nan, -np.nan, np.inf, -np.inf])
    for column in range(6):
        hurt = (kind < 2) & (rng.random(n) < 0.3)
        rays[hurt, column] = rng.choice(poison, hurt.sum())
    clean = np.isfinite(rays[:, :6]).all(axis=1)
    limits = clean & (kind == 2)
    rays[limits, rng.choice([6, 7], limits.sum())] = np.nan
    none = clean & (kind != 2)
    rays[none, 3:6] = np.copysign(0.0, rng.normal(size=(none.sum(), 3)))
    return rays


def _tracer(scheme, tree: tracers.CsgTree, precision: str):
    if not scheme.needs_mesh:
        return tracers.make(scheme.name, tree, {"precision": precision} if scheme.exact else {})
    corners = np.array([[-9.0, -9, 0], [9, -9, 0], [0, 9, 0]])  # one triangle across the model
    mesh = (corners, np.array([[0, 1, 2]], np.uint32), np.zeros(1, np.int32))
    return tracers.make(scheme.name, tree, {}, mesh)


def _bits(hits) -> bytes:
    return hits.t.tobytes() + hits.leaf.tobytes() + hits.normal.tobytes()


@row("X15", "rays that are none; flush-to-zero", tests=30_000, full=1_000_000)
def no_rays(n: int, rng: np.random.Generator) -> Findings:
    tree = _model()
    ordinary, none = _ordinary(rng, n), _not_rays(rng, n)
    few = ordinary[: n // 10]
    for scheme in tracers.schemes():
        for precision in list(UNIT_ROUNDOFF)[: 2 if scheme.exact else 1]:
            tracer = _tracer(scheme, tree, precision)
            hits = tracer.trace(none)
            wrong = (hits.leaf != -1) | (hits.t != np.inf) | (tracer.occluded(none) != 0)
            slow = [tracer.trace(none).trace_s / tracer.trace(ordinary).trace_s for _ in range(3)]
            case = f"{scheme.name}, {precision}"
            yield Finding(
                "X15",
                case,
                n,
                "time, of ordinary rays'",
                float(np.median(slow)),
                _SLOWEST,
                int(wrong.sum()),
            )
            plain = _bits(tracer.trace(few)), _bits(tracer.trace(none))
            with flush_to_zero() as flushed:
                if flushed:
                    rebuilt = _tracer(scheme, tree, precision)
                    same = plain == (_bits(rebuilt.trace(few)), _bits(rebuilt.trace(none)))
                    yield Finding(
                        "X15",
                        case,
                        len(few) + n,
                        "other bits, flushing denormals",
                        None,
                        None,
                        int(not same),
                    )
