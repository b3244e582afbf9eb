"""The plots of a report, as SVG and PNG: the same numbers give the same bytes.

Colours are Okabe and Ito's, told apart by the colour-blind; kinds also differ in their marks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import LogLocator, NullFormatter

from harness.figures import BOUNDS, FIGURES, Figure, figure
from harness.results import Result, Results
from harness.scheme_tables import COUNTERS, fastest, parameters, per_ray
from harness.statistics import Estimate
from harness.study import Configuration
from harness.table import number
from harness.tables import grid_of

COLOURS = {"none": "#000000", "root": "#0072B2", "all": "#D55E00"}
MARKS = {"none": "o", "root": "s", "all": "^"}
TIMES = {"trace_s": "trace", "total_s": "build + trace"}
COUNTER_COLOURS = ["#56B4E9", "#E69F00", "#009E73", "#CC79A7"]
matplotlib.rcParams |= {
    "svg.hashsalt": "csgbench",
    "svg.fonttype": "none",
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "figure.constrained_layout.use": True,
}


CostOf = Callable[[Configuration], np.ndarray]  # (H, W) primitives tested a pixel


def all_plots(paper: Results, grid: Results, cost_of: CostOf) -> Iterator[tuple[str, Canvas]]:
    """A plot and its name for everything that has been measured."""
    for name in FIGURES:
        fig = figure(name, paper)
        if any(row.ours for row in fig.rows):
            yield f"{name}_{fig.model}", times(fig)
    for model in dict.fromkeys(result.model for result in grid.tabled):
        if any(grid_of(grid, model, bound) for bound in BOUNDS):
            yield f"grid_{model}", heat_maps(model, grid, paper.code_version)
    for model in dict.fromkeys(result.model for result in paper.tabled):
        yield f"schemes_{model}", schemes(model, paper)
        yield f"cost_{model}", cost_pictures(model, paper, cost_of)


def save(canvas: Canvas, stem: Path) -> None:
    """`stem`.svg and .png, without dates and versions in them."""
    stem.parent.mkdir(parents=True, exist_ok=True)
    canvas.savefig(f"{stem}.svg", metadata={"Date": None, "Creator": None})
    canvas.savefig(f"{stem}.png", dpi=144, metadata={"Software": None})


def times(fig: Figure) -> Canvas:
    """Trace and total time over d:h: ours in ms, and ours and the paper's relative to no bound."""
    canvas = Canvas(figsize=(9, 6.4))
    axes = canvas.subplots(2, 2, sharex=True)
    names = [row.name for row in fig.bound("none")]
    x = np.arange(len(names))
    for (above, below), (key, what) in zip(axes.T, TIMES.items(), strict=True):
        base = {
            "ours": _mean(getattr(row.ours, key).median for row in fig.bound("none") if row.ours),
            "paper": _mean(row.paper[key] for row in fig.bound("none") if row.paper),
        }
        for i, bound in enumerate(BOUNDS):
            rows, shift = fig.bound(bound), 0.12 * (i - 1)
            style = {"color": COLOURS[bound], "marker": MARKS[bound], "markersize": 5}
            ours = [getattr(row.ours, key) if row.ours else _NONE for row in rows]
            in_ms, relative = _scaled(ours, 1e3), _scaled(ours, 1 / base["ours"])
            _points(above, x + shift, in_ms, style | {"label": BOUNDS[bound]})
            _points(below, x + shift, relative, style)
            if any(row.paper for row in rows):
                theirs = [row.paper[key] / base["paper"] for row in rows]
                below.plot(
                    x + shift, theirs, linestyle=":", markerfacecolor="white",
                    **style, label=BOUNDS[bound],
                )  # fmt: skip
        above.set_title(f"{fig.model}: {what} time")
        above.set_ylabel("ms a picture")
        below.set_ylabel("relative to the mean without bound")
        below.set_xlabel("d:h")
        below.set_xticks(x, names)
        for axis in (above, below):
            axis.set_ylim(0, 1.25 * axis.dataLim.ymax)  # room for the legend
            axis.grid(axis="y", alpha=0.3)
            axis.yaxis.set_major_formatter("{x:,.10g}")
        _legend(above, "bound; bars: 95% interval")
        _legend(below, "ours as above; the paper's, bound:")
    return canvas


def _legend(axis: Axes, title: str) -> None:
    axis.legend(
        title=title, fontsize=8, title_fontsize=8, ncols=3, loc="upper center",
        edgecolor="white", framealpha=1,
    )  # fmt: skip


_NONE = Estimate(np.nan, np.nan, np.nan, 0)


def _mean(values: Iterable[float]) -> float:
    values = list(values)
    return float(np.mean(values)) if values else np.nan


def _scaled(estimates: list[Estimate], factor: float) -> list[Estimate]:
    return [estimate.map(lambda value: factor * value) for estimate in estimates]


def _points(axis: Axes, x: np.ndarray, estimates: list[Estimate], style: dict) -> None:
    """Medians joined by a line, with their intervals."""
    medians = [estimate.median for estimate in estimates]
    axis.errorbar(x, medians, yerr=_reach(estimates), capsize=2, linewidth=1, **style)


def _reach(estimates: list[Estimate]) -> np.ndarray:
    """(2, n): how far the interval reaches below and above the median; NaN where there is none."""
    reach = [(e.median - e.low, e.high - e.median) for e in estimates]
    return np.array(reach).T.clip(0)


def heat_maps(model: str, grid: Results, code_version: str | None = None) -> Canvas:
    """Trace and total time over d and h, one map for each kind of bound, the best cell marked. The
    title says if they were measured by another version of the code than this."""
    kinds = {bound: grid_of(grid, model, bound) for bound in BOUNDS}
    kinds = {bound: list(results.values()) for bound, results in kinds.items() if results}
    everything = [r for results in kinds.values() for r in results]
    d_values, h_values = (sorted({r.params[key] for r in everything}) for key in "dh")
    canvas = Canvas(figsize=(1 + 3.6 * len(kinds), 7))
    axes = canvas.subplots(2, len(kinds), squeeze=False)
    for line, (key, what) in zip(axes, TIMES.items(), strict=True):
        values = [1e3 * getattr(r, key).median for r in everything]
        norm = LogNorm(min(values), max(values))
        for axis, (bound, results) in zip(line, kinds.items(), strict=True):
            cells = np.full((len(d_values), len(h_values)), np.nan)
            for r in results:
                cell = d_values.index(r.params["d"]), h_values.index(r.params["h"])
                cells[cell] = 1e3 * getattr(r, key).median
            image = axis.imshow(cells, origin="lower", norm=norm, cmap="cividis", aspect="auto")
            row, column = np.unravel_index(np.nanargmin(cells), cells.shape)
            axis.plot(
                column, row, marker="*", markersize=15, color="white", markeredgecolor="black"
            )
            best = f"{d_values[row]}:{h_values[column]}, {number(cells[row, column])} ms"
            axis.set_title(f"bound: {BOUNDS[bound]}\nbest {best}", fontsize=9)
            axis.set_xticks(range(len(h_values)), h_values)
            axis.set_yticks(range(len(d_values)), d_values)
            axis.set_xlabel("h, halfspaces in a terminal cell")
            axis.set_ylabel("d, levels of subdivision")
        bar = canvas.colorbar(image, ax=line, label=f"{what}, ms a picture (log)")
        bar.ax.yaxis.set_major_locator(LogLocator(subs=(1, 1.5, 2, 3, 5, 7)))
        bar.ax.yaxis.set_major_formatter("{x:,.10g}")
        bar.ax.yaxis.set_minor_formatter(NullFormatter())
    size = everything[0].configuration
    title = f"{model}, {size.width}×{size.height}: the optimum over d and h (star)"
    title += "; blank: not tabled"
    if code_version not in (None, grid.code_version):
        title += f"\nmeasured by an earlier version of the code, {grid.code_version}"
    canvas.suptitle(title)
    return canvas


def schemes(model: str, results: Results) -> Canvas:
    """Trace time of each scheme at its fastest parameters, and beside it the work a ray."""
    ordered = fastest(model, results)[::-1]
    y = np.arange(len(ordered))
    canvas = Canvas(figsize=(10, 1.3 + 0.55 * len(ordered)))
    left, right = canvas.subplots(1, 2, sharey=True, width_ratios=[3, 2])
    traced = _scaled([r.trace_s for r in ordered], 1e3)
    medians = [estimate.median for estimate in traced]
    colours = ["#BBBBBB" if not r.exact else "#0072B2" for r in ordered]
    left.barh(y, medians, xerr=_reach(traced), color=colours, height=0.6, capsize=2)
    left.set_xscale("log")
    ends = [np.nanmax([estimate.median, estimate.high]) for estimate in traced]
    left.set_xlim(min(medians) / 2, max(ends) * 4)  # room for the last number
    for position, value, end in zip(y, medians, ends, strict=True):
        left.annotate(
            f"{number(value)} ms",
            (end, position),
            (6, 0),
            textcoords="offset points",
            va="center",
        )
    left.set_yticks(y, [_scheme_label(r, results) for r in ordered])
    left.set_xlabel("trace time, ms a picture (log); bars: 95% interval")
    size = ordered[0].configuration
    left.set_title(f"{model}, {size.width}×{size.height}, two lights, one thread")
    for i, (word, colour) in enumerate(zip(COUNTERS.values(), COUNTER_COLOURS, strict=True)):
        work = [per_ray(r)[i] or np.nan for r in ordered]
        right.plot(work, y + 0.18 * (1.5 - i), "osD^"[i], color=colour, label=word)
    right.set_xscale("log")
    right.set_xlabel("operations a ray (log); no mark: none")
    right.set_title("work")
    right.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1, 1), frameon=False)
    right.tick_params(axis="y", length=0)
    for position in y[1:]:
        right.axhline(position - 0.5, color="black", alpha=0.1, linewidth=0.8)
    for axis in (left, right):
        axis.grid(axis="x", alpha=0.3)
        low, high = axis.get_xlim()
        axis.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if high < 100 * low else (1,)))
        axis.xaxis.set_major_formatter("{x:,.10g}")
        axis.xaxis.set_minor_formatter(NullFormatter())
    return canvas


def _scheme_label(result: Result, results: Results) -> str:
    name = f"{result.scheme} (inexact)" if not result.exact else result.scheme
    shown = parameters(result, results)
    return f"{name}\n{shown}" if shown else name


def cost_pictures(model: str, results: Results, cost_of: CostOf) -> Canvas:
    """Primitive tests for each pixel, on one logarithmic scale, of the exact schemes but naive."""
    chosen = [
        r for r in fastest(model, results)
        if r.exact and r.scheme != "naive"
    ]  # fmt: skip
    pictures = [(r, cost_of(r.configuration)) for r in chosen]
    columns = 3
    lines = -(-len(pictures) // columns)
    canvas = Canvas(figsize=(9.6, 3.3 * lines))
    axes = canvas.subplots(lines, columns, squeeze=False)
    norm = LogNorm(1, max(picture.max() for _, picture in pictures))
    for axis in axes.flat:
        axis.axis("off")
    for axis, (result, picture) in zip(axes.flat, pictures, strict=False):
        image = axis.imshow(np.maximum(picture, 1), norm=norm, cmap="magma")
        lines = [_scheme_label(result, results), f"mean {number(picture.mean())}"]
        axis.set_title("\n".join(lines), fontsize=8)
    bar = canvas.colorbar(image, ax=axes, shrink=0.7)
    bar.set_label("primitive tests a pixel, all its rays (log)")
    bar.ax.yaxis.set_major_formatter("{x:,.10g}")
    height, width = pictures[0][1].shape
    canvas.suptitle(f"{model}, {width}×{height}: where the work is")
    return canvas
