"""A table of results, and its three forms: Markdown and LaTeX to read, CSV to compute with."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
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
        lines = [[column.heading for column in self.columns], rule, *self._shown()]
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
        lines = [
            rf"% {self.title}",
            rf"\begin{{tabular}}{{{''.join(c.align for c in self.columns)}}}",
        ]
        lines += [r"\toprule", _latex_row([column.heading for column in self.columns]), r"\midrule"]
        lines += [_latex_row(cells) for cells in self._shown()]
        return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", ""])

    def values(self) -> Iterator[tuple[str, str]]:
        """Every cell as shown, by its path `name/row/column` without %; ends of intervals too."""
        for row in self.rows:
            about = " ".join(map(str, row[: self.keys])).replace("%", "")
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


def _is_nothing(value: Any) -> bool:
    return value is None or (isinstance(value, float) and math.isnan(value))


def _show(column: Column, value: Value) -> str:
    if isinstance(value, Estimate):
        text = _show(column, value.median)
        if _is_nothing(value.low):
            return text
        return f"{text} [{column.show(value.low)}, {column.show(value.high)}]"
    return NOTHING if _is_nothing(value) else column.show(value)


def _latex_row(cells: list[str]) -> str:
    return " & ".join(map(latex_text, cells)) + r" \\"


def latex_text(text: str) -> str:
    for mark in "&%#_$":
        text = text.replace(mark, "\\" + mark)
    return text.replace(NOTHING, "--").replace("×", r"$\times$").replace("∞", r"$\infty$")


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
    return f"{value:.1e}"
