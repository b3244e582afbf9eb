"""The comparison as one picture: time to trace of every peer on every model."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from harness.bench.entries import EMBREE, Bench, Entry

_EXACT, _POVRAY, _MESH = "#0072B2", "#555555", "#D55E00"
_MARKS = {"float64": "o", "float32": "D"}
_SIZE = 5.5


def plot(bench: Bench) -> Canvas:
    """A panel a model, a line a peer; filled on one thread, hollow on all; 95% intervals."""
    peers = _peers(bench)
    models = [m for m in bench.results.study.models if bench.of(m)]
    canvas = Canvas(figsize=(10.5, 1.6 + 0.3 * len(peers)))
    panels = np.atleast_1d(canvas.subplots(1, len(models), sharey=True))
    for axis, model in zip(panels, models, strict=True):
        for threads in sorted({1, bench.all_threads}):
            for entry in bench.of(model, threads):
                _mark(axis, entry, peers[::-1].index(entry.peer))
        if embree := bench.embree(model):
            axis.axvline(1e3 * embree.result.trace_s.median, color=_MESH, alpha=0.35, linewidth=1)
        axis.set_xscale("log")
        axis.xaxis.set_major_locator(LogLocator(subs=(1,)))
        axis.xaxis.set_major_formatter(lambda ms, _: f"{ms:,.10g}")
        axis.xaxis.set_minor_formatter(NullFormatter())
        axis.set_xlabel("ms a picture (log)")
        axis.set_title(model)
        axis.grid(axis="x", alpha=0.3)
        for y in range(len(peers)):
            axis.axhline(y, color="black", alpha=0.07, linewidth=0.8, zorder=0)
        axis.tick_params(axis="y", length=0)
    panels[0].set_yticks(range(len(peers)), peers[::-1])
    panels[0].set_ylim(-0.6, len(peers) - 0.4)
    for label in panels[0].get_yticklabels():
        label.set_color(_colour_of(label.get_text()))
    canvas.legend(
        handles=_legend(bench), loc="outside lower center", ncols=4, fontsize=8, frameon=False
    )
    size = bench.results.study.configurations[0]
    canvas.suptitle(
        f"Time to trace {size.width}×{size.height} pixels, and their shadow rays to two lights",
        fontsize=11,
    )
    return canvas


def _peers(bench: Bench) -> list[str]:
    """The fastest first, over the models."""
    logs: dict[str, list[float]] = {}
    for model in bench.results.study.models:
        best: dict[str, Entry] = {}
        for entry in bench.of(model):
            best.setdefault(entry.peer, entry)
        for peer, entry in best.items():
            logs.setdefault(peer, []).append(math.log(entry.result.trace_s.median))
    return sorted(logs, key=lambda peer: np.mean(logs[peer]))


def _mark(axis: Axes, entry: Entry, line: int) -> None:
    traced = entry.result.trace_s.map(lambda seconds: 1e3 * seconds)
    colour = _colour_of(entry.peer)
    reach = np.nan_to_num([[traced.median - traced.low], [traced.high - traced.median]]).clip(0)
    y = line + (0.13 if entry.precision == "float64" else -0.13) * entry.is_ours
    axis.errorbar(
        traced.median, y, xerr=reach, fmt=_MARKS[entry.precision], color=colour, capsize=2,
        markersize=_SIZE, linewidth=1, markeredgewidth=1,
        markerfacecolor=colour if entry.threads == 1 else "white",
    )  # fmt: skip


def _colour_of(peer: str) -> str:
    if peer.startswith("POV-Ray"):
        return _POVRAY
    return _MESH if peer.startswith("Embree,") else _EXACT


def _legend(bench: Bench) -> list[Line2D]:
    def key(label: str, colour: str, mark: str = "o", fill: str | None = None) -> Line2D:
        return Line2D(
            [], [], linestyle="", marker=mark, color=colour, label=label, markersize=_SIZE,
            markerfacecolor=fill or colour,
        )  # fmt: skip

    some = "#888888"
    return [  # column by column
        key("exact, ours: same bits as brute force", _EXACT, "s"),
        key("inexact: triangles, 64 segments a circle", _MESH, "s"),
        key("POV-Ray: exact within fixed tolerances", _POVRAY, "s"),
        Line2D([], [], color=_MESH, alpha=0.35, label=f"{EMBREE}, one thread"),
        key("ours in float64; others", some),
        key("ours in float32", some, "D"),
        key("one thread", some),
        key(f"all threads ({bench.all_threads})", some, fill="white"),
    ]
