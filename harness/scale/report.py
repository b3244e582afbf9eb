"""Growth with the model as tables and plots: fitted exponents, and what laziness saves."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Canvas

from harness.plots import save
from harness.results import Result, Results
from harness.scale import lazy
from harness.scale.plan import BUDGET_S, FAMILIES, NAME, SIZES, SLOW_S, TIMEOUT_S
from harness.schemes import catalogue
from harness.statistics import Estimate
from harness.table import (
    Column,
    Table,
    integer,
    megabytes,
    milliseconds,
    number,
    write_forms,
)

COLOURS = [
    "#000000", "#E69F00", "#56B4E9", "#D55E00", "#009E73", "#999999", "#0072B2", "#F0E442",
    "#CC79A7", "#8B4513",
]  # fmt: skip
MARKS = "osD^vPX*<>"


def size_of(result: Result) -> int:
    return int(result.model.partition("@")[2])


def ray_ns(result: Result) -> Estimate:
    return result.trace_s.map(lambda seconds: 1e9 * seconds / result.rays)


MEASURES = (  # of a result, and the title of its panel
    (lambda r: r.build_s.median, "build, s"),
    (lambda r: float(r.structure_bytes), "structure, bytes"),
    (lambda r: ray_ns(r).median, "ns a ray"),
)


def primitives_per_ray(result: Result) -> float | None:
    """Primitives or atoms tested a ray, by the counters."""
    return _per_ray(result, "primitives_tested")


def steps_per_ray(result: Result) -> float | None:
    """Boxes tested and cells entered a ray, by the counters."""
    return _per_ray(result, "bounds_tested", "cells_entered")


def _per_ray(result: Result, *names: str) -> float | None:
    counted = sum(result.counters.get(name, 0) for name in names)
    return counted / result.rays if counted else None


def finished(family: str, scheme: str, grown: Results) -> list[Result]:
    """By size; without those of no structure for the measure in question."""
    of = [r for r in grown.tabled if r.scheme == scheme and r.model.startswith(f"{family}@")]
    return sorted(of, key=size_of)


def exponent(results: Sequence[Result], measure: Callable[[Result], float | None]) -> float | None:
    """Of n in the power law nearest to the measurements, by least squares of logarithms; None of
    fewer than three sizes."""
    values = [measure(r) for r in results]
    if len(results) < 3 or None in values:
        return None
    return power(values, [size_of(r) for r in results])


def power(values: Sequence[float], sizes: Sequence[int]) -> float:
    """The exponent of the power law nearest to values over sizes."""
    return float(np.polyfit(np.log(sizes), np.log(values), 1)[0])


# --- Tables -------------------------------------------------------------------------------------


def growth_table(family: str, grown: Results) -> Table:
    """Every scheme at every size."""
    rows = []
    for r in grown.all:
        if not r.model.startswith(f"{family}@"):
            continue
        n = size_of(r)
        if r.ok:
            bytes_each = r.structure_bytes / n
            measured = [r.build_s, bytes_each, ray_ns(r), primitives_per_ray(r), steps_per_ray(r)]
            rows.append([_name(r.scheme), n, *measured, len(r.rows), ""])
        else:
            rows.append([_name(r.scheme), n, *[None] * 5, 0, _why_not(r, grown)])
    order = [_name(scheme) for scheme in catalogue()]
    rows.sort(key=lambda row: (order.index(row[0]), row[1]))
    columns = [
        Column("scheme", "scheme", align="l"),
        Column("halfspaces", "halfspaces", integer),
        Column("build_s", "build ms", milliseconds),
        Column("bytes_per_halfspace", "bytes a halfspace", number),
        Column("ray_ns", "ns/ray", number),
        Column("primitives_per_ray", "primitives/ray", number),
        Column("steps_per_ray", "boxes and cells/ray", number),
        Column("repeats", "repeats"),
        Column("not_finished", "not finished", align="l"),
    ]
    one = grown.study.configurations[0]
    notes = [
        f"{one.width}×{one.height} pixels, two lights; built by all cores, traced by one. "
        f"Subdivision by h alone. A trial has {TIMEOUT_S:g} s for loading, building, tracing and "
        "tracing again to count, and three quarters of the machine's memory; repeats end at "
        f"{BUDGET_S:g} s. A scheme that did not finish, or took more than {SLOW_S:g} s to build "
        "and trace, is not tried on a larger model. In brackets: 95% interval of the median."
    ]
    return Table(f"{NAME}_{family}", f"Growth with the model: {family}", columns, rows, notes, 2)


def _name(scheme: str) -> str:
    return scheme if catalogue()[scheme].exact else f"{scheme} (inexact)"


def _why_not(result: Result, grown: Results) -> str:
    if result.status != "not run":
        return f"{result.status}: {result.reason}"
    family, _, n = result.model.partition("@")
    smaller = {f"{family}@{size}" for size in SIZES if size < int(n)}
    of = [r for r in grown.all if r.scheme == result.scheme and r.model in smaller]
    if any(r.status not in ("ok", "not run") for r in of):
        return "not tried: a smaller one did not finish"
    slow = any(r.ok and r.build_s.median + r.trace_s.median > SLOW_S for r in of)
    return f"not tried: a smaller one took more than {SLOW_S:g} s" if slow else "not measured yet"


def exponent_table(grown: Results) -> Table:
    """How each scheme grows."""
    rows = []
    for family in FAMILIES:
        for scheme in catalogue():
            if not (results := finished(family, scheme, grown)):
                continue
            fitted = [exponent(results, of) for of, _ in MEASURES]
            counted = [exponent(results, of) for of in (primitives_per_ray, steps_per_ray)]
            last = results[-1]
            bytes_each = last.structure_bytes / size_of(last)
            at_last = [bytes_each, ray_ns(last)]
            rows.append([family, _name(scheme), size_of(last), *fitted, *counted, *at_last])
    fitted_exponent: dict = {"show": "{:.2f}".format, "group": "exponent of n"}
    columns = [
        Column("family", "family", align="l"),
        Column("scheme", "scheme", align="l"),
        Column("largest", "finished up to", integer),
        Column("build_exponent", "build", **fitted_exponent),
        Column("bytes_exponent", "bytes", **fitted_exponent),
        Column("ray_exponent", "ray", **fitted_exponent),
        Column("primitives_exponent", "primitives/ray", **fitted_exponent),
        Column("steps_exponent", "boxes and cells/ray", **fitted_exponent),
        Column("bytes_per_halfspace", "bytes a halfspace", number, group="at the largest"),
        Column("ray_ns", "ns/ray", number, group="at the largest"),
    ]
    notes = [
        "The power of n nearest to the sizes that finished, from three on, by least squares of the "
        f"logarithms. By it, n log n has {power([n * math.log(n) for n in SIZES], SIZES):.2f}. "
        "Times hang on what else the machine does; counters do not."
    ]
    return Table(NAME, "How each scheme grows with n halfspaces", columns, rows, notes, 2)


def _percent(share: float) -> str:
    """To three digits, for shares down to a detail's of a large model."""
    return number(100 * share)


def lazy_table(rows: Iterable[dict]) -> Table:
    """What a lazy octree builds and takes, for each task."""
    shown = []
    for row in rows:
        for task, what in TASKS.items():
            t = row[task]
            shown.append([
                row["family"], row["halfspaces"], what, t["fraction_built"], t["fraction_bytes"],
                t["build_s"], t["eager_s"], t["lazy_s"], t["lazy_s"] / t["eager_s"], t["rays"],
                t["break_even_rays"],
            ])  # fmt: skip
    columns = [
        Column("family", "family", align="l"),
        Column("halfspaces", "halfspaces", integer),
        Column("task", "task", align="l"),
        Column("fraction_built", "cells built %", _percent),
        Column("fraction_bytes", "bytes %", _percent),
        Column("build_s", "eager build s", number),
        Column("eager_s", "eager", number, group="build and trace s"),
        Column("lazy_s", "lazy", number, group="build and trace s"),
        Column("lazy_over_eager", "lazy / eager", number),
        Column("rays", "rays", integer),
        Column("break_even_rays", "eager is ahead from rays", integer),
    ]
    notes = [
        f"{lazy.SCHEME}, h={lazy.HALFSPACES}, {lazy.SIDE}×{lazy.SIDE}, all cores, wall time, the "
        f"least of {lazy.ROUNDS} rounds (fly-around: one). Cells built: divided, or given their "
        "S-bounds. Close-up: one ball or plug through a long lens. Eager is ahead from the number "
        "of rays at which the sums of build and trace times cross, extrapolated from the last view "
        "if they have not; ∞: not with these rays. Pictures are the same to the bit."
    ]
    return Table(f"{NAME}_lazy", "Built as rays need it", columns, shown, notes, 3)


TASKS = {
    "picture": "one picture",
    "close_up": "close-up",
    "fly_around": f"{lazy.VIEWS} views around",
}


def load_table(rows: Iterable[dict]) -> Table:
    """From the .csg to the picture."""
    shown = []
    for row in rows:
        t = row["picture"]
        load_s = row["load_s"]
        shown.append([
            row["family"], row["halfspaces"], row["csg_bytes"], load_s,
            row["csg_bytes"] / load_s, row["csg_bytes"] / row["load_cpu_s"],
            t["build_s"], t["eager_s"] - t["build_s"],
            load_s + t["eager_s"], load_s + t["lazy_s"],
        ])  # fmt: skip
    columns = [
        Column("family", "family", align="l"),
        Column("halfspaces", "halfspaces", integer),
        Column("csg_bytes", ".csg MB", megabytes),
        Column("load_s", "load s", number),
        Column("load_bytes_per_s", "load MB/s", megabytes),
        Column("load_bytes_per_cpu_s", "load MB a CPU second", megabytes),
        Column("build_s", "build s", number),
        Column("trace_s", "trace s", number),
        Column("total_s", "eager", number, group="in all s"),
        Column("lazy_total_s", "lazy", number, group="in all s"),
    ]
    notes = [
        f"{lazy.SCHEME}; build and trace by all cores, reading by one. Wall times, the least of "
        f"{lazy.ROUNDS}; where the machine is shared, CPU time tells more."
    ]
    return Table(f"{NAME}_load", "From .csg to picture", columns, shown, notes, 2)


# --- Plots --------------------------------------------------------------------------------------


def plot(family: str, grown: Results) -> Canvas:
    """Build, bytes and ns a ray over n, each scheme with its exponent."""
    canvas = Canvas(figsize=(12, 6))
    for axes, (of, title) in zip(canvas.subplots(1, 3), MEASURES, strict=True):
        for i, scheme in enumerate(catalogue()):
            results = finished(family, scheme, grown)
            if not results:
                continue
            fitted = exponent(results, of)
            label = f"– {scheme}" if fitted is None else f"{fitted:.2f} {scheme}"
            x, y = [size_of(r) for r in results], [of(r) for r in results]
            axes.plot(
                x, y, marker=MARKS[i % len(MARKS)], color=COLOURS[i % len(COLOURS)], markersize=4,
                linewidth=1, label=label, linestyle="-" if catalogue()[scheme].exact else ":",
            )  # fmt: skip
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlim(SIZES[0] / 1.5, SIZES[-1] * 1.5)
        axes.set_xlabel("n halfspaces")
        axes.set_title(title)
        axes.grid(alpha=0.3)
        axes.legend(
            fontsize=7, title="exponent of n", title_fontsize=7, ncols=2, frameon=False,
            loc="upper center", bbox_to_anchor=(0.5, -0.12),
        )  # fmt: skip
    canvas.suptitle(f"{family}: growth with the model (dotted: inexact)")
    return canvas


# --- Writing ------------------------------------------------------------------------------------


def write(grown: Results, lazy_rows: list[dict], folder: Path) -> Path:
    """Tables and plots, to `folder`/scale; the document of all tables is named."""
    target = folder / NAME
    made = [
        exponent_table(grown), lazy_table(lazy_rows), load_table(lazy_rows),
        *(growth_table(family, grown) for family in FAMILIES),
    ]  # fmt: skip
    made = [table for table in made if table.rows]
    write_forms(made, target / "tables")
    document = target / f"{NAME}.md"
    document.write_text("\n".join(table.markdown() for table in made))
    for family in FAMILIES:
        save(plot(family, grown), target / "plots" / f"{NAME}_{family}")
    return document
