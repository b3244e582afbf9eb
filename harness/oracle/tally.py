"""Many rays judged: a tracer's hits against the oracle's answers, counted.

tally = judge_rays(solid, rays, tracer.trace(rays))
rays[tally.unexcused]  # what must be explained
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from multiprocessing import get_context

import numpy as np

import tracers
from harness.oracle.judge import Judgement, Verdict, judge
from harness.oracle.solid import ExactSolid


@dataclass
class Tally:
    """Judgements of many rays. Arrays are by ray, in order."""

    verdicts: dict[Verdict, int] = field(default_factory=lambda: dict.fromkeys(Verdict, 0))
    raw: dict[Verdict, int] = field(default_factory=lambda: dict.fromkeys(Verdict, 0))
    reasons: dict[str, int] = field(default_factory=dict)
    coplanar: int = 0  # rays that run in a surface: answered by convention
    #: (N,) in E of the leaf; NaN where not both hit the same boundary
    errors: np.ndarray = field(default_factory=lambda: np.zeros(0))
    #: (N,); NaN where boundary or leaf differ
    normals_deg: np.ndarray = field(default_factory=lambda: np.zeros(0))
    #: indices of rays
    unexcused: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))

    @property
    def rays(self) -> int:
        return sum(self.verdicts.values())

    def worst_error(self) -> float:
        return _quantile(self.errors, 1.0)

    def error_p999(self) -> float:
        return _quantile(self.errors, 0.999)

    def normal_p999_deg(self) -> float:
        return _quantile(self.normals_deg, 0.999)


def judge_rays(
    solid: ExactSolid,
    rays: np.ndarray,
    hits: tracers.Hits,
    precision: str = "float64",
    progress: Callable[[int, int], None] | None = None,
    processes: int = 1,
) -> Tally:
    """rays: (N, 8) float64; hits: anything with t (N,), leaf (N,) and normal (N, 3). `progress` is
    called with the rays done and the rays in all, about a hundred times."""
    tasks = list(zip(rays, hits.t.tolist(), hits.leaf.tolist(), hits.normal, strict=True))
    step = max(1, len(tasks) // 100)
    tally = Tally(errors=np.full(len(tasks), np.nan), normals_deg=np.full(len(tasks), np.nan))
    unexcused = []
    for i, (judgement, coplanar) in enumerate(_judgements(solid, tasks, precision, processes)):
        tally.verdicts[judgement.verdict] += 1
        tally.raw[judgement.raw] += 1
        tally.coplanar += coplanar
        if judgement.verdict is Verdict.EXCUSED:
            tally.reasons[judgement.reason] = tally.reasons.get(judgement.reason, 0) + 1
        elif judgement.verdict is not Verdict.AGREE:
            unexcused.append(i)
        tally.errors[i], tally.normals_deg[i] = judgement.error, judgement.normal_deg
        if progress and (i + 1) % step == 0:
            progress(i + 1, len(tasks))
    tally.unexcused = np.array(unexcused, np.int64)
    return tally


def _judgements(
    solid: ExactSolid, tasks: list, precision: str, processes: int
) -> Iterator[tuple[Judgement, bool]]:
    if processes == 1:
        yield from (_judge_one(solid, task, precision) for task in tasks)
        return
    with get_context("fork").Pool(processes, _share, (solid, precision)) as pool:
        yield from pool.imap(_judge_shared, tasks, chunksize=64)


def _judge_one(solid: ExactSolid, task: tuple, precision: str) -> tuple[Judgement, bool]:
    ray, t, leaf, normal = task
    answer = solid.answer(ray)
    return judge(solid, answer, ray, t, leaf, normal, precision), bool(answer.coplanar)


_shared: tuple = ()


def _share(*shared) -> None:
    global _shared
    _shared = shared


def _judge_shared(task: tuple) -> tuple[Judgement, bool]:
    solid, precision = _shared
    return _judge_one(solid, task, precision)


def _quantile(values: np.ndarray, share: float) -> float:
    finite = values[np.isfinite(values)]
    return float(np.quantile(finite, share, method="higher")) if len(finite) else 0.0
