"""The paper's claims, each judged against the paper's own tables and against our rows.

A claimed reduction of p percent agrees with a row if the row's 95% interval (a printed value has
none) meets p ± 0.5, what is rounded to p. Where that interval contains 0 as well, or where too few
rounds give one, the row shows nothing, and the claim is open.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

from harness.figures import BOUNDS, FIGURES, Figure, Row, equally_fast, figure, printed
from harness.results import Results
from harness.statistics import Estimate
from harness.table import NOTHING, Column, Table, percent

ROUNDING = 0.005


@dataclass(frozen=True)
class Judge:
    """Whose rows a claim is held against."""

    name: str
    bound: str
    reduction: Callable[[Row], Estimate | None]
    trace_s: Callable[[Row], float | None]
    tie: Callable[[Row, Row], bool]  # (best, other): the trace times cannot be told apart


def _printed_reduction(row: Row) -> Estimate | None:
    share = row.paper_reduction
    return None if share is None else Estimate(share, share, share, 1)


PAPER = Judge(
    "the paper's own rows",
    "root",
    _printed_reduction,
    lambda row: row.paper and row.paper["trace_s"],
    lambda best, other: best is other,
)


def ours(bound: str) -> Judge:
    return Judge(
        f"our rows, bound: {BOUNDS[bound]}",
        bound,
        lambda row: row.reduction,
        lambda row: row.ours and row.ours.trace_s.median,
        lambda best, other: best is other or equally_fast(best.ours, other.ours),
    )


JUDGES = (PAPER, *(ours(bound) for bound in BOUNDS if bound != "none"))


def claims(results: Results) -> Table:
    """Every claim against every judge."""
    figures = [figure(name, results) for name in FIGURES]
    rows: list[list] = []
    for fig in figures:
        share = printed()["claims"]["reduction"][fig.model]
        claim = f"{fig.model}: bounds save {100 * share:.0f}% of the trace time"
        rows += [[claim, judge.name, *_judge_reduction(share, fig, judge)] for judge in JUDGES]
    optimum = "{d}:{h}".format(**printed()["claims"]["optimum"])
    for fig in figures:
        claim = f"{fig.model}: the optimal d:h is {optimum}"
        rows += [[claim, judge.name, *_judge_optimum(optimum, fig, judge)] for judge in JUDGES]
    claim = "bounds make tracing faster in every row"
    rows += [[claim, judge.name, *_judge_faster(figures, judge)] for judge in JUDGES]

    columns = [
        Column("claim", "the paper claims", align="l"),
        Column("judge", "held against", align="l"),
        Column("verdict", "verdict", align="l"),
        Column("finding", "because", align="l"),
    ]
    notes = [_across_rows(figures[0])]
    return Table("claims", "The paper's claims, judged", columns, rows, notes, keys=2)


def _reductions(fig: Figure, judge: Judge) -> list[Estimate]:
    found = (judge.reduction(row) for row in fig.bound(judge.bound))
    return [r for r in found if r is not None]


def _judge_reduction(share: float, fig: Figure, judge: Judge) -> tuple[str, str]:
    reductions = _reductions(fig, judge)
    if not reductions:
        return NOTHING, "not measured"
    low, high = share - ROUNDING, share + ROUNDING

    def relation(r: Estimate) -> str:
        if r.high < low:
            return "less"
        if r.low > high:
            return "more"
        return "as claimed" if r.low > 0 else "open"

    count = Counter(map(relation, reductions))
    medians = [r.median for r in reductions]
    found = f"{percent(min(medians))} to {percent(max(medians))}%: {_shares(count)}"
    if count["as claimed"]:
        return ("holds" if count["as claimed"] == len(reductions) else "holds in part"), found
    return ("fails" if count["less"] + count["more"] else "open"), found


def _shares(count: Counter[str]) -> str:
    """`less in 1 of 6 rows, more in 5`."""
    words = [f"{what} in {n}" for what, n in count.most_common()]
    return ", ".join([f"{words[0]} of {count.total()} rows", *words[1:]])


def _judge_optimum(optimum: str, fig: Figure, judge: Judge) -> tuple[str, str]:
    rows = [row for row in fig.bound(judge.bound) if judge.trace_s(row) is not None]
    claimed = next((row for row in rows if row.name == optimum), None)
    if claimed is None:
        return NOTHING, "not measured"
    best = min(rows, key=judge.trace_s)
    if best is claimed:
        ties = [row.name for row in rows if row is not best and judge.tie(best, row)]
        found = f"{optimum} is the fastest of {len(rows)} rows"
        if not ties:
            return "holds", found
        return "open", f"{found}; within the noise so is {', '.join(ties)}"
    slower = percent(judge.trace_s(claimed) / judge.trace_s(best) - 1)
    found = f"{best.name} is the fastest; {optimum} takes {slower}% longer"
    if judge.tie(best, claimed):
        return "open", f"{found}, within the noise"
    return "fails", found


def _judge_faster(figures: list[Figure], judge: Judge) -> tuple[str, str]:
    reductions = [r for fig in figures for r in _reductions(fig, judge)]
    if not reductions:
        return NOTHING, "not measured"
    count = Counter(
        "faster" if r.low > 0 else "slower" if r.high < 0 else "open" for r in reductions
    )
    if count["slower"]:
        return "fails", _shares(count)
    return ("open" if count["open"] else "holds"), _shares(count)


def _across_rows(fig: Figure) -> str:
    """Where the paper's 25% comes from, since no row has it."""
    share = printed()["claims"]["reduction"][fig.model]
    pairs = itertools.product(fig.bound("none"), fig.bound("root"))

    def saved(plain: Row, bounded: Row) -> float:
        return 1 - bounded.paper["trace_s"] / plain.paper["trace_s"]

    plain, bounded = min(pairs, key=lambda pair: abs(saved(*pair) - share))
    return (
        f"No row of the paper's {fig.model} saves {100 * share:.0f}%. Nearest is a comparison "
        f"across rows: {bounded.name} with bounds against {plain.name} without saves "
        f"{percent(saved(plain, bounded))}%."
    )
