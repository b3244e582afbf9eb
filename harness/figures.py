"""Figures 8 and 9 row by row: what the paper printed, what we measured, what the bound saves."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from harness import statistics
from harness.results import Result, Results, ratio
from harness.statistics import Estimate

# How all tables name a value of the parameter `bound` of hybrid_sdsm. With none the structure is
# the plain SDSM; "root" is the paper's Figure 6; "all" goes beyond it.
BOUNDS = {"none": "No", "root": "Yes (root)", "all": "Yes (every node)"}
PRINTED_BOUNDS = {"none": "No", "root": "Yes"}  # the paper's words
FIGURES = ("figure8", "figure9")


@cache
def printed() -> dict[str, Any]:
    """The paper's numbers."""
    path = Path(__file__).with_name("paper_figures.toml")
    return tomllib.loads(path.read_text(encoding="utf-8"))


@dataclass(frozen=True)
class Row:
    """One d:h with one kind of bound. What the paper has not, or we have not, is None."""

    d: int
    h: int
    bound: str  # a key of BOUNDS
    paper: dict[str, float] | None  # build_s, trace_s, total_s
    paper_reduction: float | None  # of the trace time, by the bound, as a share
    ours: Result | None
    reduction: Estimate | None

    @property
    def name(self) -> str:
        return f"{self.d}:{self.h}"


@dataclass(frozen=True)
class Figure:
    model: str
    rows: list[Row]

    def bound(self, bound: str) -> list[Row]:
        return [row for row in self.rows if row.bound == bound]


def figure(name: str, results: Results) -> Figure:
    """`name`: one of FIGURES. A row for every d:h of the paper and every kind of bound."""
    model = printed()[name]["model"]
    paper = {(r["d"], r["h"], r["bound"]): r for r in printed()[name]["rows"]}
    rows = []
    for d, h in dict.fromkeys((d, h) for d, h, _ in paper):
        plain, paper_plain = find(results, model, d, h, "none"), paper[d, h, "No"]
        for bound in BOUNDS:
            ours = find(results, model, d, h, bound)
            theirs = paper.get((d, h, PRINTED_BOUNDS.get(bound)))
            bounded = bound != "none"
            paper_reduction = (
                1 - theirs["trace_s"] / paper_plain["trace_s"] if bounded and theirs else None
            )
            reduction = trace_reduction(plain, ours) if bounded and plain and ours else None
            rows.append(Row(d, h, bound, theirs, paper_reduction, ours, reduction))
    return Figure(model, rows)


def find(results: Results, model: str, d: int, h: int, bound: str) -> Result | None:
    if bound == "none":
        return results.find(model, "sdsm", d=d, h=h)
    return results.find(model, "hybrid_sdsm", d=d, h=h, bound=bound)


def trace_reduction(before: Result, after: Result) -> Estimate:
    """The share of the trace time that `after` saves; negative where it takes longer."""
    return ratio(after, before, "trace_s").map(lambda r: 1 - r)


def pictures_to_break_even(plain: Result, bounded: Result) -> float:
    """How many pictures pay for building the bounds. NaN where the noise hides whether tracing
    gains by them or, if it does, whether building them costs."""
    built, traced = (ratio(bounded, plain, key) for key in ("build_s", "trace_s"))
    if _is_one(traced) or (traced.median < 1 and _is_one(built)):
        return math.nan
    return statistics.break_even(
        (built.median - 1) * plain.build_s.median, (1 - traced.median) * plain.trace_s.median
    )


def equally_fast(best: Result, other: Result) -> bool:
    """Whether the measurements cannot tell the trace times apart: by the interval of their
    ratio or, where too few rounds give one, because they overlap."""
    compared = ratio(other, best, "trace_s")
    if not math.isnan(compared.low):
        return _is_one(compared)
    a, b = best.rows["trace_s"], other.rows["trace_s"]
    return bool(a.min() <= b.max() and b.min() <= a.max())


def _is_one(ratio: Estimate) -> bool:
    """For all that is known; without an interval nothing is."""
    return not (ratio.low > 1 or ratio.high < 1)
