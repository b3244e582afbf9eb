"""The tables that answer the paper: Figures 7 to 9, what bounds save, the optimum, break-even."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from harness import statistics
from harness.figures import (
    BOUNDS,
    Figure,
    Row,
    equally_fast,
    pictures_to_break_even,
    printed,
)
from harness.results import Result, Results, ratio
from harness.scheme_tables import AS_FAST, INTERVAL, repeats
from harness.table import Column, Table, integer, milliseconds, number, percent

_MODEL = Column("model", "model", align="l")
_BOUND = Column("bound", "bound", align="l")


def characteristics(results: Results, models: dict[str, dict]) -> Table:
    rows = []
    for model, counted in models.items():
        theirs = printed()["figure7"].get(model, {})
        size = next(
            (f"{c.width}×{c.height}" for c in results.study.configurations if c.model == model),
            None,
        )
        kinds = ", ".join(sorted(set(counted["kinds"])))
        rows.append([
            model, size, theirs.get("nodes"), counted["nodes"],
            theirs.get("halfspaces"), counted["halfspaces"], kinds,
        ])  # fmt: skip
    columns = [
        _MODEL,
        Column("size", "resolution"),
        Column("paper_nodes", "paper", integer, group="tree nodes"),
        Column("nodes", "ours", integer, group="tree nodes"),
        Column("paper_halfspaces", "paper", integer, group="halfspaces"),
        Column("halfspaces", "ours", integer, group="halfspaces"),
        Column("kinds", "halfspace types", align="l"),
    ]
    return Table("figure7", "Figure 7: model characteristics", columns, rows)


def timing(name: str, fig: Figure) -> Table:
    """Figure 8 or 9: ours beside the paper's."""
    rows = []
    for row in fig.rows:
        theirs, ours = row.paper or {}, row.ours
        rows.append([
            row.name, BOUNDS[row.bound],
            *(theirs.get(key) for key in ("build_s", "trace_s", "total_s")), row.paper_reduction,
            *((ours.build_s, ours.trace_s, ours.total_s) if ours else (None,) * 3), row.reduction,
            ours and repeats(ours),
        ])  # fmt: skip
    columns = [
        Column("d:h", "d:h", align="l"),
        _BOUND,
        Column("paper_build_s", "build s", "{:.2f}".format, group="paper"),
        Column("paper_trace_s", "trace s", "{:.2f}".format, group="paper"),
        Column("paper_total_s", "total s", "{:.2f}".format, group="paper"),
        Column("paper_reduction", "saved %", percent, group="paper"),
        Column("build_s", "build ms", milliseconds, group="ours"),
        Column("trace_s", "trace ms", milliseconds, group="ours"),
        Column("total_s", "total ms", milliseconds, group="ours"),
        Column("reduction", "saved %", percent, group="ours"),
        Column("repeats", "repeats", group="ours"),
    ]
    notes = [
        '"saved" is of the trace time, by the bound, at the same d:h; ours from pairs measured in '
        "the same round, or, where fewer than three rounds measured both, from the medians and "
        f"without interval. {INTERVAL} Yes (root) is the S-bound of the root of each cell's tree, "
        "the paper's Figure 6; Yes (every node) goes beyond the paper."
    ]
    title = f"Figure {name.removeprefix('figure')}: timing data of model {fig.model}"
    return Table(name, title, columns, rows, notes, keys=2)


def reductions(figures: Iterable[Figure]) -> Table:
    """The spread of what the bound saves and of what it costs to build, over the rows."""
    rows = []
    for fig in figures:
        for bound in ("root", "all"):
            group = fig.bound(bound)
            theirs = [r.paper_reduction for r in group if r.paper_reduction is not None]
            ours = [r.reduction.median for r in group if r.reduction]
            about = [fig.model, BOUNDS[bound]]
            rows.append([*about, *_spread(theirs), *_spread(ours), _build_ratio(fig, group)])
    columns = [_MODEL, _BOUND]
    for prefix, group in (("paper_", "paper, saved %"), ("", "ours, saved %")):
        columns += [
            Column(f"{prefix}{key}", key, percent, group=group) for key in ("mean", "least", "most")
        ]
    columns.append(Column("build_ratio", "times the build time", number))
    title = "What the bound saves of the trace time, over the rows of Figures 8 and 9"
    return Table("reductions", title, columns, rows, keys=2)


def _spread(values: list[float]) -> tuple[float | None, ...]:
    return (float(np.mean(values)), min(values), max(values)) if values else (None,) * 3


def _build_ratio(fig: Figure, group: list[Row]) -> float | None:
    """Median over the rows: building with the bound against building without it."""
    plain = {row.name: row.ours for row in fig.bound("none")}
    pairs = [(row.ours, plain[row.name]) for row in group if row.ours and plain[row.name]]
    ratios = [ratio(a, b, "build_s").median for a, b in pairs]
    return float(np.median(ratios)) if ratios else None


def optimum(figures: Iterable[Figure], grid: Results, code_version: str | None = None) -> Table:
    """The best d:h by trace time and by total time, in the paper's rows and in the grid study."""
    rows, has_grid = [], False
    for fig in figures:
        for bound, label in BOUNDS.items():
            printed_rows = [r for r in fig.bound(bound) if r.paper]
            measured = {row.name: row.ours for row in fig.bound(bound) if row.ours}
            bracketed = grid_of(grid, fig.model, bound)
            has_grid |= bool(bracketed)
            best = min(measured.values(), key=lambda r: r.trace_s.median, default=None)
            ties = [name for name, r in measured.items() if r is not best and equally_fast(best, r)]
            rows.append([
                fig.model, label,
                *(min(printed_rows, key=lambda r: r.paper[key]).name if printed_rows else None
                  for key in ("trace_s", "total_s")),
                _best(measured, "trace_s"), " ".join(ties) or None, _best(measured, "total_s"),
                *(_best(bracketed, key) for key in ("trace_s", "total_s")),
            ])  # fmt: skip
    columns = [
        _MODEL,
        _BOUND,
        Column("paper_trace", "by trace", group="paper"),
        Column("paper_total", "by total", group="paper"),
        Column("trace", "by trace", group="ours"),
        Column("trace_ties", "as fast", group="ours"),
        Column("total", "by total", group="ours"),
        Column("grid_trace", "by trace", group="ours, grid study"),
        Column("grid_total", "by total", group="ours, grid study"),
    ]
    notes = [AS_FAST]
    if has_grid and grid.code_version != code_version:
        notes.append(
            f"The grid study was measured by an earlier version of the code, {grid.code_version}; "
            f"the rest by {code_version}."
        )
    return Table(
        "optimum", "The best d:h, with and without the time to build", columns, rows, notes, 2
    )


def grid_of(grid: Results, model: str, bound: str) -> dict[str, Result]:
    """The grid study's results of one model and kind of bound, by d:h; none without two d and two
    h, for a cell may have been measured by another study alone."""
    scheme = "sdsm" if bound == "none" else "hybrid_sdsm"
    found = {
        "{d}:{h}".format(**r.params): r
        for r in grid.tabled
        if (r.model, r.scheme) == (model, scheme) and r.params.get("bound", "none") == bound
    }
    is_grid = all(len({r.params[key] for r in found.values()}) > 1 for key in "dh")
    return found if is_grid else {}


def _best(results: dict[str, Result], key: str) -> str | None:
    return min(results, key=lambda name: getattr(results[name], key).median, default=None)


def break_even(figures: Iterable[Figure]) -> Table:
    """From how many rays on the bound pays for its building."""
    rows = []
    for fig in figures:
        plain = {row.name: row for row in fig.bound("none")}
        for row in fig.rows:
            if row.bound == "none":
                continue
            theirs, ours, base = row.paper, row.ours, plain[row.name]
            paper_pictures = theirs and statistics.break_even(
                theirs["build_s"] - base.paper["build_s"], base.paper["trace_s"] - theirs["trace_s"]
            )
            pictures = pictures_to_break_even(base.ours, ours) if ours and base.ours else None
            rays = None if pictures is None else pictures * ours.rays
            counts = map(_or_word, (paper_pictures, pictures, rays))
            rows.append([fig.model, row.name, BOUNDS[row.bound], *counts])
    columns = [
        _MODEL,
        Column("d:h", "d:h", align="l"),
        _BOUND,
        Column("paper_pictures", "pictures", number, group="paper"),
        Column("pictures", "pictures", number, group="ours"),
        Column("rays", "rays", integer, group="ours"),
    ]
    notes = [
        "(build with bound − build without) / (trace without − trace with), the differences from "
        "pairs measured in the same round; a picture is 512×512 with the shadow rays of two "
        "lights. never: tracing is no faster with the bound. 0: it is, and building costs no more. "
        "open: the 95% interval of one of the two differences contains 0."
    ]
    title = "Number of pictures and of rays from which the bound pays"
    return Table("break_even", title, columns, rows, notes, keys=3)


def _or_word(pictures: float | None) -> float | str | None:
    if pictures is None or math.isfinite(pictures):
        return pictures
    return "never" if math.isinf(pictures) else "open"
