"""The trade as tables and plots: each setting's cost beside its errors, and which to choose."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import LogLocator, NullFormatter

from harness.accuracy.settings import NAME, Setting
from harness.plots import save
from harness.statistics import rate_bound
from harness.table import Column, Table, milliseconds, number, scientific, write_forms

KNOBS = {  # colour, mark; what is not a knob of the exact scheme is another scheme
    "exact": ("#000000", "*"),
    "precision": ("#0072B2", "s"),
    "torus": ("#009E73", "D"),
    "tie_band": ("#CC79A7", "v"),
    "shadow": ("#56B4E9", "P"),
    "size": ("#999999", "x"),
    "packet_sdsm": ("#332288", "h"),
    "embree_mesh": ("#D55E00", "o"),
    "sphere_tracing": ("#E69F00", "^"),
}
OTHER = ("#777777", ".")


# --- Tables -------------------------------------------------------------------------------------


def settings_table(model: str, settings: Iterable[Setting]) -> Table:
    """Every setting of a model: cost and errors."""
    rows, pixels = [], 1
    for s in settings:
        if s.result.model != model or not s.is_compared:
            continue
        pixels = s.figures["pixels"]
        rates = [
            s.per_million(key)
            for key in ("flips", "unexcused_flips", "wrong_leaves", "unexcused_wrong_leaves",
                        "wrong_light")
        ]  # fmt: skip
        f = s.figures
        rows.append([
            s.knob, s.value, s.ray_ns, s.preparation_s, f["surface_p999"], f["surface_max"],
            f["depth_rmse"], *rates, f["normal_p999_deg"], f["flip"],
        ])  # fmt: skip

    def rate(per_million: float) -> str:
        bound = 1e6 * rate_bound(0, pixels)
        return number(per_million) if per_million else f"< {number(bound)}"

    columns = [
        Column("knob", "knob", align="l"),
        Column("value", "value", align="l"),
        Column("ray_ns", "ns/ray", number),
        Column("preparation_s", "preparation ms", milliseconds),
        Column("surface_p999", "p99.9", scientific, group="surface error"),
        Column("surface_max", "most", scientific, group="surface error"),
        Column("depth_rmse", "depth RMSE", scientific),
        Column("flips", "raw", rate, group="mask flips a million"),
        Column("unexcused_flips", "unexcused", rate, group="mask flips a million"),
        Column("wrong_leaves", "raw", rate, group="wrong leaves a million"),
        Column("unexcused_wrong_leaves", "unexcused", rate, group="wrong leaves a million"),
        Column("wrong_light", "wrong light a million", rate),
        Column("normal_p999_deg", "normal p99.9 °", scientific),
        Column("flip", "mean FLIP", scientific),
    ]
    notes = [
        "Lengths are relative to the model's size. Surface error: distance of a hit from the true "
        "surface of its leaf. Raw: against the exact scheme in double, over all pixels; unexcused: "
        "what remains after asking the oracle, which excuses what lies within the rounding of the "
        "setting's own precision. Where none was seen, the 95% bound 3/N stands."
    ]
    title = f"Speed for accuracy on {model}, one knob at a time"
    return Table(f"{NAME}_{model}", title, columns, rows, notes, keys=2)


def oracle_table(settings: Iterable[Setting]) -> Table:
    """The exact scheme against the oracle."""
    rows = []
    for s in settings:
        f = s.figures
        if s.knob == "exact":
            rows.append([
                s.result.model, *(f[f"{where}{what}"] for where in ("sampled", "disputed")
                                  for what in ("", "_excused", "_unexcused", "_worst_E")),
            ])  # fmt: skip
    columns = [Column("model", "model", align="l")]
    for where, group in (("sampled", "a random sample"), ("disputed", "every disputed pixel")):
        columns += [
            Column(where, "pixels", group=group),
            Column(f"{where}_excused", "excused", group=group),
            Column(f"{where}_unexcused", "unexcused", group=group),
            Column(f"{where}_worst_E", "worst error, E", number, group=group),
        ]
    notes = [
        "Disputed is a pixel whose leaf, or whether anything is hit, differs between the exact "
        "scheme and any setting above, or POV-Ray."
    ]
    return Table("oracle", "The exact scheme in double against the certified oracle", columns, rows,
                 notes)  # fmt: skip


def sizes_table(settings: Iterable[Setting]) -> Table:
    """What the size of the picture buys."""
    rows = [
        [s.result.model, f"{s.result.configuration.width}×{s.result.configuration.height}",
         s.result.trace_s, s.figures["flip_shown"]]
        for s in sorted(settings, key=lambda s: (s.result.model, s.result.configuration.width))
        if "flip_shown" in s.figures
    ]  # fmt: skip
    columns = [
        Column("model", "model", align="l"),
        Column("size", "size"),
        Column("trace_s", "trace ms", milliseconds),
        Column("flip_shown", "mean FLIP", scientific),
    ]
    notes = ["FLIP of the picture shown at 512×512, against one of 2048×2048 averaged down."]
    return Table("sizes", "Speed for accuracy: the size of the picture", columns, rows, notes, 2)


@dataclasses.dataclass(frozen=True)
class Need:
    words: str
    is_met: Callable[[Setting], bool]


def _right(s: Setting) -> bool:
    return not s.figures["unexcused_flips"] and not s.figures["unexcused_wrong_leaves"]


NEEDS = [
    Need("right to rounding: no pixel wrong, surfaces within 1e-14 of the size",
         lambda s: _right(s) and s.figures["surface_max"] <= 1e-14
         and not s.figures["wrong_light"]),
    Need("surfaces within a millionth, no hit wrong beyond rounding, light right on 99.8%",
         lambda s: _right(s) and s.figures["surface_max"] <= 1e-6
         and s.per_million("wrong_light") <= 2000),
    Need("surfaces within a thousandth, masks right but for 100 pixels a million, light on 99.8%",
         lambda s: s.figures["surface_p999"] <= 1e-3 and s.per_million("flips") <= 100
         and s.per_million("wrong_light") <= 2000),
    Need("a picture in which nobody sees the difference: mean FLIP ≤ 0.01",
         lambda s: s.figures["flip"] <= 1e-2),
]  # fmt: skip


def choice_table(settings: Sequence[Setting]) -> Table:
    """Which setting for which need, and what it costs, by model."""
    rows = []
    for model in dict.fromkeys(s.result.model for s in settings):
        compared = [s for s in settings if s.result.model == model and s.is_compared]
        exact = next((s for s in compared if s.knob == "exact"), None)
        if exact is None:
            continue
        for need in NEEDS:
            fit = [s for s in compared if need.is_met(s)]
            if not fit:
                rows.append([model, need.words, None, None, None, None, None, None])
                continue
            fastest = min(fit, key=lambda s: s.ray_ns.median)
            soonest = min(fit, key=lambda s: s.preparation_s + s.result.trace_s.median)
            first = soonest.preparation_s + soonest.result.trace_s.median
            rows.append([
                model, need.words, fastest.label, fastest.ray_ns,
                exact.ray_ns.median / fastest.ray_ns.median, fastest.preparation_s,
                soonest.label, first,
            ])  # fmt: skip
    columns = [
        Column("model", "model", align="l"),
        Column("need", "need", align="l"),
        Column("fastest", "setting", align="l", group="fastest to trace"),
        Column("ray_ns", "ns/ray", number, group="fastest to trace"),
        Column("speedup", "times the exact's speed", number, group="fastest to trace"),
        Column("preparation_s", "preparation ms", milliseconds, group="fastest to trace"),
        Column("soonest", "setting", align="l", group="soonest for one picture"),
        Column("first_s", "all in all ms", milliseconds, group="soonest for one picture"),
    ]
    notes = [
        "Of the settings tried on this picture. What errs nowhere here may err elsewhere: "
        "see the extremes. Preparation is building, and making the mesh where there is one."
    ]
    title = "Which setting for which need, and what it costs"
    return Table("choice", title, columns, rows, notes, keys=2)


# --- Plots --------------------------------------------------------------------------------------

_PANELS = {
    "surface_p999": "surface error p99.9, of the size",
    "flips": "mask flips a million pixels: 95% bound",
    "flip": "mean FLIP",
}


def plot(model: str, settings: Iterable[Setting]) -> Canvas:
    """Time a ray against three errors; the line joins what nothing beats in both.

    All flips are drawn at their bound: beside plain rates, "none seen" would stand too high. Of the
    other errors 0 is drawn below all that is not.
    """
    shown = [s for s in settings if s.result.model == model and s.is_compared]
    canvas = Canvas(figsize=(12, 4.6))
    for axes, (key, what) in zip(canvas.subplots(1, 3), _PANELS.items(), strict=True):
        points: list[tuple[float, float]] = []
        zero = min((s.figures[key] for s in shown if s.figures[key]), default=1) / 3
        for s in shown:
            colour, mark = KNOBS.get(s.knob, OTHER)
            x = s.ray_ns
            none_seen = s.figures[key] == 0
            y = s.bound_per_million(key) if key == "flips" else s.figures[key] or zero
            points.append((x.median, y))
            reach = [[max(0, x.median - x.low)], [max(0, x.high - x.median)]]
            axes.errorbar(x.median, y, xerr=np.nan_to_num(reach), fmt=mark, color=colour,
                          markersize=8 if s.knob == "exact" else 5, linewidth=0.8,
                          markerfacecolor="white" if none_seen else colour)  # fmt: skip
        names = [re.sub("algorithm_", "", s.value) for s in shown]
        for i in _apart(points, names):
            colour, _ = KNOBS.get(shown[i].knob, OTHER)
            axes.annotate(names[i], points[i], xytext=(4, 3), textcoords="offset points",
                          fontsize=7, color=colour)  # fmt: skip
        front = _pareto(points)
        axes.step(*zip(*front, strict=True), where="post", color="#BBBBBB", linewidth=1, zorder=0)
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_xlabel("ns a ray")
        axes.set_title(what)
        axes.grid(alpha=0.3)
    used = [knob for knob in KNOBS if any(s.knob == knob for s in shown)]
    marks = [canvas.axes[0].plot([], [], KNOBS[k][1], color=KNOBS[k][0])[0] for k in used]
    canvas.legend(marks, used, loc="outside lower center", ncols=len(used), fontsize=8)
    canvas.suptitle(
        f"{model}: speed for accuracy. Hollow: no error seen (0 is drawn below all others). "
        "Grey line: what no setting beats in both"
    )
    return canvas


def _apart(points: Sequence[tuple[float, float]], names: Sequence[str]) -> list[int]:
    """Which names can stand beside their points on logarithmic axes and not print over each other:
    where marks crowd, the first is named, the rest are told by colour."""
    places = np.log(points)
    places = (places - places.min(axis=0)) / np.maximum(np.ptp(places, axis=0), 1e-9)
    chosen: list[int] = []
    for i, (x, y) in enumerate(places):
        free = all(
            abs(y - places[j, 1]) > 0.033
            or x > places[j, 0] + 0.022 * len(names[j])
            or places[j, 0] > x + 0.022 * len(names[i])
            for j in chosen
        )
        chosen += [i] if free else []
    return chosen


def _pareto(points: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """Those that no other beats in both coordinates, by the first."""
    front: list[tuple[float, float]] = []
    for x, y in sorted(points):
        if not front or y < front[-1][1]:
            front.append((x, y))
    return front


# --- Writing ------------------------------------------------------------------------------------


def tables(settings: Sequence[Setting]) -> list[Table]:
    every = dict.fromkeys(s.result.model for s in settings)
    made = [choice_table(settings), *(settings_table(model, settings) for model in every),
            oracle_table(settings), sizes_table(settings)]  # fmt: skip
    return [table for table in made if table.rows]


def write(settings: Sequence[Setting], folder: Path) -> Path:
    """Tables and plots, to `folder`/accuracy; the document of all tables is named."""
    target = folder / NAME
    made = tables(settings)
    write_forms(made, target / "tables")
    document = target / f"{NAME}.md"
    document.write_text("\n".join(table.markdown() for table in made))
    for model in dict.fromkeys(s.result.model for s in settings):
        save(plot(model, settings), target / "plots" / f"{NAME}_{model}")
    return document
