"""What the commands write of what has been measured: tables, plots and what is published."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from rich.console import Console

from harness import PUBLISHED, ROOT, STORE

if TYPE_CHECKING:
    from harness.results import Results

PIPED = 200  # columns where there is no terminal, that tables are whole


def _is_terminal(stream: TextIO | None) -> bool:
    return stream is not None and stream.isatty()  # none: it was closed


out = Console(soft_wrap=True, highlight=False, width=None if _is_terminal(sys.stdout) else PIPED)
err = Console(stderr=True, soft_wrap=True, highlight=False)


def tables(study: str, folder: Path) -> None:
    from harness import report

    paper, grid, target = report.load(study, folder)
    _say_if_nothing(study, grid if study == "grid" else paper)
    out.print(f"tables: {report.write_tables(paper, grid, target)}")
    for line in paper.refusals() + grid.refusals():
        err.print(f"not tabled: {line}", style="red", markup=False)
    for model in paper.unchecked:
        line = f"{model}: not compared with POV-Ray yet; run `csgbench reference`"
        err.print(line, style="yellow", markup=False)


def accuracy(folder: Path) -> None:
    """And its plots, of what `csgbench accuracy` has measured, if it has."""
    from harness.accuracy import report, settings
    from harness.report import load_study
    from harness.store import Store

    if measured := settings.load(load_study(settings.NAME), Store(folder / STORE)):
        out.print(f"accuracy: {report.write(measured, folder)}")


def micro(folder: Path) -> None:
    """Of what `csgbench micro` has measured, if it has."""
    from harness import micro as micros

    if outcome := micros.load(folder):
        out.print(f"micro: {micros.write(outcome, folder)}")


def bench(folder: Path, measure_errors: bool = False) -> None:
    """Tables and plot of what `csgbench sweep bench` has measured, if it has."""
    from harness.bench import errors, report
    from harness.report import load_study
    from harness.store import Store

    planned, store = load_study(report.NAME), Store(folder / STORE)
    if measure_errors:
        errors.measure_missing(out, planned, store)
    if (measured := report.load(planned, store)).entries:
        out.print(f"bench: {report.write(measured, folder)}")
    for line in measured.results.refusals():
        err.print(f"not tabled: {line}", style="red", markup=False)


def scale(folder: Path) -> None:
    """And its plots, of what `csgbench scale` has measured, if it has."""
    from harness import results
    from harness.scale import lazy, plan, report
    from harness.store import Store

    grown = results.load(Store(folder / STORE), plan.study())
    if grown.tabled:
        out.print(f"scale: {report.write(grown, lazy.load(folder), folder)}")


def plots(study: str, folder: Path) -> None:
    from harness import report

    paper, grid, target = report.load(study, folder)
    _say_if_nothing(study, grid if study == "grid" else paper)
    if paper.tabled or grid.tabled:
        out.print(f"plots: {report.write_plots(paper, grid, target)}")


def _say_if_nothing(study: str, measured: Results) -> None:
    if measured.rows.empty:
        line = f"nothing of the study '{study}' measured yet; run `csgbench sweep {study}`"
        err.print(line, style="yellow", markup=False)


def publish(wanted: bool, folder: Path) -> None:
    from harness import readme, report

    if wanted:
        report.publish(folder, PUBLISHED)
        readme.refresh(ROOT / "README.md", PUBLISHED / "tables")
        out.print(f"published: {PUBLISHED}")
