"""`make stability`: runs the rows, and shows them as one table and a plot."""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Canvas
from rich.console import Console
from rich.progress import Progress

from harness import UserError
from harness.atomic import replacing
from harness.machine import code_version
from harness.plots import save
from harness.stability import Finding, rows
from harness.stability.planted import Catch, catch_all
from harness.stability.povray import Peer, compare
from harness.stability.run import run_row
from harness.statistics import rate_bound
from harness.table import Column, Table, integer, write_forms

PLANTED = "X18"
POVRAY = "povray"  # beside ours, on the rays of X3, X7 and X11
NAME = "stability"
LEAST = 1e-3  # of its bar: where a worst error of less, such as 0, is drawn
COLOURS = {True: "#009E73", False: "#D55E00"}


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What has been run of the present code."""

    findings: list[Finding]
    catches: list[Catch]
    peers: list[Peer]

    @property
    def red(self) -> list[str]:
        """A line for everything that is not met."""
        lines = [f"{f.row} {f.case}: {verdict(f)}" for f in self.findings if not f.met]
        return lines + [f"{PLANTED} {c.name}: {c.how}" for c in self.catches if not c.row]


def run(console: Console, names: Sequence[str], most: int, folder: Path) -> None:
    """The named rows, or all that have no result of this code with as many rays. Each is kept in
    `folder`/stability/rows when it is done."""
    kept = folder / NAME / "rows"
    every = [*rows(), POVRAY, PLANTED]
    names = [name.upper() if name.upper() in every else name for name in names]
    for name in set(names) - set(every):
        raise UserError(f"no row '{name}'; known: X1 to {PLANTED}, {POVRAY}")
    wanted = [name for name in every if name in names or not (names or _is_kept(kept, name, most))]
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("", total=len(wanted))
        for name in wanted:
            progress.update(task, description=name)
            start = time.monotonic()
            if name == PLANTED:
                found: Sequence = catch_all(lambda done, total, bug: console.print(
                    f"{PLANTED}: bug {done + 1} of {total}, {bug}", highlight=False
                ))  # fmt: skip
                said = f"{sum(bool(c.row) for c in found)} of {len(found)} caught"
            elif name == POVRAY:
                found = compare(most)
                said = f"{sum(p.povray_failures for p in found)} of its rays failed"
                said += f", {sum(p.our_failures for p in found)} of ours"
            else:
                found = run_row(name, most)
                said = f"{sum(f.met for f in found)} of {len(found)} cases met"
                count, excused = (
                    sum(getattr(f, key) for f in found) for key in ("rays", "excused")
                )
                said += f"; {count:,} rays, {excused / max(count, 1):.2%} excused"
            if most >= _kept(kept, name).get("rays", -1):  # few cost no result with many
                _keep(kept, name, most, found)
            console.print(f"{name}: {said}, {time.monotonic() - start:.0f} s", highlight=False)
            progress.advance(task)


def titles() -> dict[str, str]:
    """Every row by name, what is beside ours and what is planted included."""
    others = {POVRAY: "POV-Ray on the rays of X3, X7 and X11", PLANTED: "planted bugs"}
    return {name: row.title for name, row in rows().items()} | others


def _keep(folder: Path, name: str, most: int, found: Sequence) -> None:
    values = [dataclasses.asdict(value) for value in found]
    kept = {"code_version": code_version(), "rays": most, "found": values}
    with replacing(folder / f"{name}.json") as scratch:
        scratch.write_text(json.dumps(kept, indent=1))


def _kept(folder: Path, name: str) -> dict:
    file = folder / f"{name}.json"
    kept = json.loads(file.read_text()) if file.exists() else {}
    return kept if kept.get("code_version") == code_version() else {}


def _is_kept(folder: Path, name: str, most: int) -> bool:
    enough = min(most, rows()[name].full) if name in rows() else most
    return _kept(folder, name).get("rays", -1) >= enough


def load(folder: Path) -> Outcome:
    """All that is kept of the present code."""
    kept = folder / NAME / "rows"

    def values(name: str, kind: type) -> list:
        return [kind(**value) for value in _kept(kept, name).get("found", [])]

    findings = [f for name in rows() for f in values(name, Finding)]
    return Outcome(findings, values(PLANTED, Catch), values(POVRAY, Peer))


def verdict(finding: Finding) -> str:
    """`met`, or what failed."""
    if finding.met:
        return "met"
    parts = [f"{finding.failures} failed"] if finding.failures else []
    if finding.worst is not None and not finding.worst <= finding.bar:
        parts.append("over the bar")
    return ", ".join(parts) + (f": {finding.red}" if finding.red else "")


def findings_table(findings: Iterable[Finding]) -> Table:
    """Every case of every row."""
    titles = {name: row.title for name, row in rows().items()}
    values = [
        [
            f.row, titles[f.row], f.case, f.rays, f.measured, f.worst,
            f.bar if f.bar is not None and np.isfinite(f.bar) else None,
            f.failures, f.excused, f.rate_bound, verdict(f),
        ]
        for f in findings
    ]  # fmt: skip
    columns = [
        Column("row", "row", align="l"),
        Column("extreme", "extreme", align="l"),
        Column("case", "case", align="l"),
        Column("rays", "rays", integer),
        Column("measured", "measured", align="l"),
        Column("worst", "worst", "{:.3g}".format),
        Column("bar", "bar", "{:g}".format),
        Column("failures", "failures", integer),
        Column("excused", "excused", integer),
        Column("rate_bound", "failure rate <", "{:.1e}".format),
        Column("verdict", "verdict", align="l"),
    ]
    notes = [
        "E = u·(|o| + size), times the condition of the transform; u is 2⁻⁵³ for float64 and 2⁻²⁴ "
        "for float32. A failure is a flip, a false miss, a phantom layer, a hit seen twice…, as "
        "the row says; excused are rays within the guard of where the answer changes: 4 E, or two "
        "tie bands between crossings. Rays are aimed at tangents to 1e-16, so many are, above all "
        "for float32, which cannot tell those apart. X1 to X4 take E with the precision's u; the "
        "other rows take u of double, and add float's times the size. The failure rate's 95% "
        "bound is 3/N where none was seen."
    ]
    title = "Numerical stability at the extremes, case by case"
    return Table(f"{NAME}_cases", title, columns, values, notes, keys=3)


def summary_table(outcome: Outcome) -> Table:
    """A line a row: rays, the worst relative to its bar, failures, verdict."""
    values = []
    for name, row in rows().items():
        of_row = [f for f in outcome.findings if f.row == name]
        if not of_row:
            values.append([name, row.title, None, None, None, None, "not run"])
            continue
        rated = [f for f in of_row if f.worst is not None]
        worst = max(rated, key=lambda f: f.worst / f.bar if f.bar else np.inf, default=None)
        unmet = [f for f in of_row if not f.met]
        values.append([
            name, row.title, sum(f.rays for f in of_row if not f.measured.startswith("time")),
            worst and f"{worst.worst:.3g} of {worst.bar:g} {worst.measured.rpartition(', ')[2]}",
            sum(f.failures for f in of_row), sum(f.excused for f in of_row),
            "green" if not unmet else f"red: {len(unmet)} of {len(of_row)} cases: "
            + "; ".join(dict.fromkeys(f.red or verdict(f) for f in unmet)),
        ])  # fmt: skip
    if outcome.catches:
        caught = sum(bool(c.row) for c in outcome.catches)
        values.append([
            PLANTED, "planted bugs, caught by a row", None, f"{caught} of {len(outcome.catches)}",
            len(outcome.catches) - caught, 0, "green" if caught == len(outcome.catches) else "red",
        ])  # fmt: skip
    columns = [
        Column("row", "row", align="l"),
        Column("extreme", "extreme", align="l"),
        Column("rays", "rays", integer),
        Column("worst", "worst of its bar", align="l"),
        Column("failures", "failures", integer),
        Column("excused", "excused", integer),
        Column("verdict", "verdict", align="l"),
    ]
    return Table(NAME, "Numerical stability at the extremes", columns, values)


def planted_table(catches: Iterable[Catch]) -> Table:
    values = [[c.name, c.file, c.row or "none", c.how] for c in catches]
    columns = [
        Column("bug", "planted bug", align="l"),
        Column("file", "file", align="l"),
        Column("row", "caught by", align="l"),
        Column("how", "which said", align="l"),
    ]
    return Table(
        "planted", "Bugs planted one at a time, and the row that caught each", columns, values
    )


def peers_table(peers: Iterable[Peer]) -> Table:
    """POV-Ray's failures beside ours."""
    values = [
        [
            p.row, p.case, p.rays, p.povray_failures, p.our_failures,
            p.povray_failures / p.rays, p.our_failures / p.rays, p.povray_worst_E, p.our_worst_E,
        ]
        for p in peers
    ]  # fmt: skip
    rate = "{:.1e}".format
    columns = [
        Column("row", "row", align="l"),
        Column("case", "case", align="l"),
        Column("rays", "rays", integer),
        Column("povray_failures", "POV-Ray failed", integer),
        Column("our_failures", "ours failed", integer),
        Column("povray_rate", "POV-Ray, a ray", rate),
        Column("our_rate", "ours, a ray", rate),
        Column("povray_worst_E", "POV-Ray's worst, E", "{:.3g}".format),
        Column("our_worst_E", "our worst, E", "{:.3g}".format),
    ]
    notes = [
        "The same rays, first hits. A failure is a hit where there is nothing, a miss where there "
        "is something, or a hit more than 2²⁴ E off, which is another surface; the worst is that "
        "of the other hits. Rays within 4 E of where the answer changes are left out. X3 and X7 "
        "are at the scale that POV-Ray's absolute tolerances are made for, X11 is not."
    ]
    title = "POV-Ray on the same rays"
    return Table(f"{NAME}_povray", title, columns, values, notes, keys=2)


def plot(findings: Sequence[Finding]) -> Canvas:
    """The worst of each case relative to its bar, and the bound on each row's rate of failures."""
    rated = [f for f in findings if f.worst is not None and f.bar and np.isfinite(f.bar)]
    names = list(dict.fromkeys(f.row for f in findings))
    canvas = Canvas(figsize=(11, 6))
    left, right = canvas.subplots(1, 2, sharey=True)
    for f in rated:
        y, worst = names.index(f.row), max(f.worst / f.bar, LEAST)
        left.plot(worst, y, "o", color=COLOURS[f.met], alpha=0.5, markersize=5)
    left.axvline(1, color="black", linewidth=0.8)
    left.annotate("bar", (1, 0), xytext=(3, 8), textcoords="offset points", fontsize=8)
    canvas.suptitle("Numerical stability at the extremes: worst error and failures, by row")
    left.set_xscale("log")
    left.set_xlabel(f"worst error, relative to its bar ({LEAST:g}: that, or less)")
    for y, name in enumerate(names):
        of_row = [f for f in findings if f.row == name]
        failures, rays = sum(f.failures for f in of_row), sum(f.rays for f in of_row)
        whole = Finding(name, "", rays, "", None, None, failures)
        # Where nothing failed the bound is drawn, as an arrow to the left; never a 0.
        right.plot(whole.rate_bound, y, "<" if not failures else "o", color=COLOURS[failures == 0])
    right.set_xscale("log")
    right.set_xlabel("rate of failures a ray: 95% bound (◂ none seen)")
    left.set_yticks(range(len(names)), [f"{name} {titles()[name]}" for name in names])
    left.invert_yaxis()
    for axes in (left, right):
        axes.grid(alpha=0.3)
    return canvas


def plot_peers(peers: Sequence[Peer]) -> Canvas:
    """The share of rays that fail, POV-Ray's and ours; where none does, the 95% bound."""
    canvas = Canvas(figsize=(8, 1.2 + 0.3 * len(peers)))
    axes = canvas.subplots()
    axes.set_title("First hits on the same rays, at POV-Ray's own scale but for X11")
    for y, p in enumerate(peers):
        theirs, ours = p.povray_failures / p.rays, p.our_failures / p.rays
        bound = rate_bound(0, p.rays)
        axes.plot(theirs or bound, y - 0.15, "o" if theirs else "<", color="#D55E00", markersize=5)
        axes.plot(ours or bound, y + 0.15, "s" if ours else "<", color="#0072B2", markersize=4)
    axes.plot([], [], "o", color="#D55E00", label="POV-Ray")
    axes.plot([], [], "s", color="#0072B2", label="ours")
    axes.set_xscale("log")
    axes.set_xlabel("share of rays that fail (◂ none seen: the 95% bound)")
    axes.set_yticks(range(len(peers)), [f"{p.row} {p.case}" for p in peers])
    axes.invert_yaxis()
    axes.grid(alpha=0.3)
    canvas.legend(loc="outside lower center", ncols=2)
    return canvas


def write(outcome: Outcome, folder: Path) -> Path:
    """Tables and plots, to `folder`/stability."""
    target = folder / NAME
    tables = [
        summary_table(outcome), planted_table(outcome.catches), peers_table(outcome.peers),
    ]  # fmt: skip
    tables = [table for table in [*tables, findings_table(outcome.findings)] if table.rows]
    write_forms(tables, target / "tables")
    if outcome.findings:
        save(plot(outcome.findings), target / "plots" / NAME)
    if outcome.peers:
        save(plot_peers(outcome.peers), target / "plots" / f"{NAME}_povray")
    document = target / f"{NAME}.md"
    document.write_text("\n".join(table.markdown() for table in tables))
    return document
