"""A table of results, and its three forms: Markdown and LaTeX to read, CSV to compute with."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from harness.statistics import Estimate

NOTHING = "–"
Value = str | int | float | Estimate | None


@dataclass(frozen=True)
class Column:
    key: str  # in the CSV, with its SI unit: trace_s
    heading: str  # for people, with the unit that `show` converts to
    show: Callable[[Any], str] = str
    align: str = "r"
    group: str = ""  # a word for this and the neighbours of the same group: "paper", "ours"


@dataclass(frozen=True)
class Table:
    name: str  # of its files
    title: str
    columns: list[Column]
    rows: list[list[Value]]
    notes: list[str] = field(default_factory=list)
    keys: int = 1  # this many leading columns say what a row is about

    def markdown(self) -> str:
        rule = ["---:" if column.align == "r" else "---" for column in self.columns]
        headings = [": ".join(filter(None, (c.group, c.heading))) for c in self.columns]
        lines = [headings, rule, *self._shown()]
        table = "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
        notes = "".join(f"\n{note}\n" for note in self.notes)
        return f"### {self.title}\n\n{table}\n{notes}"

    def csv(self) -> str:
        """Unrounded, in SI units; an estimate takes four columns."""
        cells: dict[str, list] = {}
        for i, column in enumerate(self.columns):
            values = [row[i] for row in self.rows]
            if any(isinstance(value, Estimate) for value in values):
                for part in ("median", "low", "high", "n"):
                    key = column.key if part == "median" else f"{column.key}_{part}"
                    cells[key] = [getattr(value, part, None) for value in values]
            else:
                cells[column.key] = values
        # As objects, so that no column of integers with a gap in it turns into floats.
        return pd.DataFrame(cells, dtype=object).to_csv(index=False, lineterminator="\n")

    def latex(self) -> str:
        """A tabular with booktabs rules; the caption is the paper's business."""
        shown = [[latex_text(cell) for cell in cells] for cells in self._shown()]
        widest = [max(map(len, cells)) for cells in zip(*self._shown(), strict=True)]
        widest = widest or [0] * len(self.columns)
        headings = [_latex_heading(*of) for of in zip(self.columns, widest, strict=True)]
        lines = [
            rf"% {self.title}",
            rf"\begin{{tabular}}{{{''.join(c.align for c in self.columns)}}}",
            r"\toprule",
            *_latex_groups(self.columns),
        ]
        lines += [_latex_row(headings), r"\midrule", *map(_latex_row, shown)]
        return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", ""])

    def values(self) -> Iterator[tuple[str, str]]:
        """Every cell as shown, by its path `name/row/column` without %; ends of intervals too."""
        for row in self.rows:
            about = " ".join(str(key) for key in row[: self.keys] if key != "").replace("%", "")
            for column, value in zip(self.columns[self.keys :], row[self.keys :], strict=True):
                path = f"{self.name}/{about}/{column.key}"
                if isinstance(value, Estimate):
                    yield path, column.show(value.median)
                    yield f"{path}/low", _show(column, value.low)
                    yield f"{path}/high", _show(column, value.high)
                else:
                    yield path, _show(column, value)

    def _shown(self) -> list[list[str]]:
        return [
            [_show(column, value) for column, value in zip(self.columns, row, strict=True)]
            for row in self.rows
        ]


def write_forms(tables: Iterable[Table], folder: Path) -> None:
    """Each as Markdown, CSV and LaTeX."""
    folder.mkdir(parents=True, exist_ok=True)
    for table in tables:
        (folder / f"{table.name}.md").write_text(table.markdown())
        (folder / f"{table.name}.csv").write_text(table.csv())
        (folder / f"{table.name}.tex").write_text(table.latex())


def _is_nothing(value: Any) -> bool:
    return value is None or (isinstance(value, float) and math.isnan(value))


def _show(column: Column, value: Value) -> str:
    if isinstance(value, Estimate):
        text = _show(column, value.median)
        if _is_nothing(value.low):
            return text
        return f"{text} [{column.show(value.low)}, {column.show(value.high)}]"
    if _is_nothing(value):
        return NOTHING
    return value if isinstance(value, str) else column.show(value)


def _latex_row(cells: list[str]) -> str:
    return " & ".join(cells) + r" \\"


def _latex_groups(columns: list[Column]) -> list[str]:
    """The words above the headings and the rules under them; nothing where there are none."""
    cells, rules, first = [], [], 1
    for group, members in itertools.groupby(columns, key=lambda column: column.group):
        last = first + len(list(members)) - 1
        if group:
            cells.append(rf"\multicolumn{{{last - first + 1}}}{{c}}{{{latex_text(group)}}}")
            rules.append(rf"\cmidrule(lr){{{first}-{last}}}")
        else:
            cells += [""] * (last - first + 1)
        first = last + 1
    return [_latex_row(cells), "".join(rules)] if rules else []


def _latex_heading(column: Column, widest: int) -> str:
    """On two lines where it is wider than what stands below; the break nearest the middle."""
    heading = column.heading
    spaces = [i for i, mark in enumerate(heading) if mark == " "]
    if column.align != "r" or len(heading) <= widest or not spaces:
        return latex_text(heading)
    at = min(spaces, key=lambda i: abs(2 * i + 1 - len(heading)))
    above, below = latex_text(heading[:at]), latex_text(heading[at + 1 :])
    # \hfill and not \shortstack[r]: in paper.tex a bracket starts an interval.
    return rf"\shortstack{{\hfill\strut {above}\\\hfill\strut {below}}}"


def latex_text(text: str) -> str:
    for mark in "&%#_$":
        text = text.replace(mark, "\\" + mark)
    text = re.sub(r"\b(\d\.\d)e([+-]\d+)\b", _power_of_ten, text)
    text = re.sub(r"(?<![\w.{-])-(?=\d)", "$-$", text)
    return text.replace(NOTHING, "--").replace("×", r"$\times$").replace("∞", r"$\infty$")


def _power_of_ten(found: re.Match) -> str:
    return rf"${found[1]}\times10^{{{int(found[2])}}}$" if int(found[2]) else found[1]


# How values are shown. All take SI units or shares of one.


def number(value: float) -> str:
    """Three significant digits, or all before the point; never an exponent."""
    if value == 0 or math.isinf(value):
        return "0" if value == 0 else "∞"
    value = float(f"{value:.3g}") if abs(value) < 1000 else value
    decimals = max(0, 2 - math.floor(math.log10(abs(value))))
    return f"{value:,.{decimals}f}"


def milliseconds(value: float) -> str:
    return number(1e3 * value)


def percent(value: float) -> str:
    return f"{100 * value:.1f}"


def megabytes(value: float) -> str:
    return number(value / 1e6)


def integer(value: float) -> str:
    return "∞" if math.isinf(value) else f"{round(value):,}"


def scientific(value: float) -> str:
    return f"{value:.1e}" if value else "0"


def times(value: float) -> str:
    """How many times; 1 only for what is compared with itself."""
    return "1" if value == 1 else number(value)
