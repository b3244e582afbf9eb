"""What the rows share: rays, tallies, and the walk through all boundaries of a ray."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

import tracers
from harness.stability import Finding

PRECISIONS = ("float64", "float32")
UNIT = {"float64": 2.0**-53, "float32": 2.0**-24}
LIMITS = {precision: tracers.limits(precision) for precision in PRECISIONS}  # of this build
# What excuses does not follow the build: a band made wider would loosen every bar.
EXCUSED_COSINE = {"float64": 2.0**-10, "float32": 2.0**-5}
# Why a row may be red: t of a surface that is grazed is off by E / cos, and the band follows that
# only down to this cosine.
LEAST_COSINE = {"float64": 2.0**-20, "float32": 2.0**-5}
RED_WHERE_GRAZED = {
    precision: f"the band widens to a cosine of {cosine} only, that P stay {pad} of the size; "
    "a surface can be grazed at less and yet be more than 4 E away"
    for precision, cosine, pad in [("float64", "2⁻²⁰", "2⁻²⁰"), ("float32", "2⁻⁵", "2⁻¹²")]
}
BAND = 16  # tie band, in E
GUARD = 4  # in E: what is closer than this may be decided either way


def joined(operator: int, parts: list) -> list:
    """The parts under one operator, as a balanced tree."""
    if len(parts) == 1:
        return parts[0]
    half = len(parts) // 2
    return [operator, joined(operator, parts[:half]), joined(operator, parts[half:])]


def directions(rng: np.random.Generator, count: int) -> np.ndarray:
    """(count, 3) unit vectors, uniform."""
    v = rng.normal(size=(count, 3))
    return v / np.linalg.norm(v, axis=1)[:, None]


def rays_through(points: np.ndarray, along: np.ndarray, back) -> np.ndarray:
    """(N, 8) rays through points (N, 3), from `back` times `along` (N, 3) before them."""
    back = np.broadcast_to(back, len(points))
    origin = points - back[:, None] * along
    return np.column_stack([origin, along, np.zeros(len(points)), np.full(len(points), np.inf)])


def error_unit(tree: tracers.CsgTree, rays: np.ndarray, precision: str) -> np.ndarray:
    """(N,) E of error_unit.hpp, model units: float32 keeps the way to the primitive in double."""
    single = UNIT["float32"] * tree.size if precision == "float32" else 0
    return UNIT["float64"] * (np.linalg.norm(rays[:, :3], axis=1) + tree.size) + single


@dataclass(frozen=True)
class Layers:
    """All boundaries along rays: t (N, K) ascending, +inf behind the last; |cosine| (N, K) between
    ray and normal there; leaf (N, K), -1 behind the last."""

    t: np.ndarray
    cosine: np.ndarray
    leaf: np.ndarray

    @property
    def count(self) -> np.ndarray:
        return np.isfinite(self.t).sum(axis=1)


def walk(tracer, tree: tracers.CsgTree, rays: np.ndarray, precision: str, most: int = 64) -> Layers:
    """Traces behind each hit again, by rule 11: from `skip`, one widened band behind it."""
    n = len(rays)
    t, cosine = np.full((n, most), np.inf), np.ones((n, most))
    leaf = np.full((n, most), -1, dtype=np.int32)
    active, deepest, current = np.arange(n), 0, np.ascontiguousarray(rays)
    for k in range(most):
        hits = tracer.trace(current)
        found = hits.leaf >= 0
        if not found.any():
            break
        active, current, deepest = active[found], current[found], k + 1
        speed = np.linalg.norm(current[:, 3:6], axis=1)
        t[active, k], leaf[active, k] = hits.t[found], hits.leaf[found]
        facing = np.abs((hits.normal[found] * current[:, 3:6]).sum(axis=1)) / speed
        cosine[active, k] = facing
        band = BAND * error_unit(tree, current, precision) / speed
        widened = band / np.maximum(facing, LIMITS[precision]["min_cosine"])
        current[:, 6] = hits.t[found] + widened - band
    return Layers(t[:, :deepest], cosine[:, :deepest], leaf[:, :deepest])


def same_bits(a: Layers, b: Layers) -> np.ndarray:
    """(N,) whether two walks saw the same leaves at the same bits of t."""
    if a.t.shape != b.t.shape:
        k = max(a.t.shape[1], b.t.shape[1])
        a, b = widened(a, k), widened(b, k)
    return (a.t == b.t).all(axis=1) & (a.leaf == b.leaf).all(axis=1)


def widened(layers: Layers, most: int) -> Layers:
    """With columns of nothing up to `most`."""
    more = ((0, 0), (0, most - layers.t.shape[1]))
    return Layers(
        np.pad(layers.t, more, constant_values=np.inf),
        np.pad(layers.cosine, more, constant_values=1),
        np.pad(layers.leaf, more, constant_values=-1),
    )


@dataclass
class Tally:
    """A Finding that grows with each chunk of rays."""

    row: str
    case: str
    measured: str
    bar: float | None = None
    rays: int = 0
    worst: float | None = None
    failures: int = 0
    excused: int = 0
    red: str = ""

    def add(self, rays: int, failures: int = 0, excused: int = 0, worst: float | None = None):
        self.rays += int(rays)
        self.failures += int(failures)
        self.excused += int(excused)
        if worst is not None:
            self.worst = float(max(worst, -np.inf if self.worst is None else self.worst))

    def finding(self) -> Finding:
        missed = self.failures or (self.bar is not None and self.worst and self.worst > self.bar)
        red = self.red if missed else ""
        return Finding(
            self.row, self.case, self.rays, self.measured, self.worst, self.bar,
            self.failures, self.excused, red,
        )  # fmt: skip


def check_layers(
    tally: Tally,
    found: Layers,
    truth: np.ndarray,
    cosine: np.ndarray,
    unit: np.ndarray,
    band_cosine,
) -> np.ndarray:
    """Adds a walk to the tally, against true boundaries.

    truth: (N, K) t, ascending, +inf behind the last, |dir| = 1; cosine: (N, K) there; unit: (N,)
    E; band_cosine: where the band is widest. A ray whose number of layers is wrong is excused where
    two true boundaries, or a boundary and the start, are closer than two widened bands. The surface
    error counts where the number is right. Returns the rays that failed (N,).
    """
    band = BAND * unit[:, None] / np.maximum(cosine, band_cosine)
    start = np.zeros((len(truth), 1))
    either = np.maximum(band, np.concatenate([start, band[:, :-1]], axis=1))
    with np.errstate(invalid="ignore"):  # inf − inf, behind the last
        gap = np.diff(truth, axis=1, prepend=start)
    close = (np.isfinite(truth) & (np.abs(gap) < 2 * either)).any(axis=1)
    count = np.isfinite(truth).sum(axis=1)
    wrong = found.count != count
    k = min(found.t.shape[1], truth.shape[1])
    both = np.isfinite(found.t[:, :k]) & ~(wrong | close)[:, None]
    error = np.abs(found.t[:, :k] - np.where(both, truth[:, :k], 0)) * cosine[:, :k] / unit[:, None]
    worst = float(error[both].max()) if both.any() else None
    failed = wrong & ~close
    tally.add(len(truth), failed.sum(), (wrong & close).sum(), worst)
    return failed


def chunks(total: int, size: int = 50_000) -> Iterator[int]:
    """Numbers of at most `size` that add up to the total."""
    for begin in range(0, total, size):
        yield min(size, total - begin)
