"""Figures 8 and 9 row by row: what the paper printed, what we measured, what the bound saves."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from harness import statistics
from harness.results import Result, Results, paired
from harness.statistics import Estimate

# How the paper names what we call by the value of the parameter `bound` of hybrid_sdsm. With none
# the structure is the plain SDSM; "root" is the paper's Figure 6; "all" goes beyond it.
BOUNDS = {"none": "No", "root": "Yes", "all": "every node"}
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
        for bound, label in BOUNDS.items():
            ours, theirs = find(results, model, d, h, bound), paper.get((d, h, label))
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
    """The share of the trace time that `after` saves, from values measured in the same rounds."""
    return statistics.reduction(*paired(before, after, "trace_s"))


def pictures_to_break_even(plain: Result, bounded: Result) -> float:
    """How many pictures pay for building the bounds."""
    return statistics.break_even(
        bounded.build_s.median - plain.build_s.median,
        plain.trace_s.median - bounded.trace_s.median,
    )


def equally_fast(best: Result, other: Result) -> bool:
    """Whether the measurements cannot tell the trace times apart."""
    ratio = statistics.ratio(*paired(other, best, "trace_s"))
    return ratio.n > 1 and ratio.low <= 1 <= ratio.high
