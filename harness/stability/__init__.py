"""Numerical stability at the extremes: the rows X1 to X18, each an exact construction with a bar.

A row is a function that is given a number of rays and a random generator and yields findings. The
rows register themselves; `csgbench stability` runs them all, the tests run each with fewer rays.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from harness import statistics


@dataclass(frozen=True)
class Finding:
    """What one case of a row came to. It is met if nothing unexcused happened and worst ≤ bar."""

    row: str  # "X1"
    case: str  # "sphere, float64"
    rays: int  # how many were tried
    measured: str  # what `worst` is: "surface error, E"
    worst: float | None  # None where there is only a count
    bar: float | None
    failures: int = 0  # flips, false misses, phantoms…: what the row counts; the bar is always 0
    excused: int = 0  # of those beside `failures`, within the guard
    red: str = ""  # the cause, where a bar is known not to be met

    @property
    def met(self) -> bool:
        return self.failures == 0 and (self.worst is None or self.worst <= self.bar)

    @property
    def rate_bound(self) -> float:
        """95% upper bound of the rate of failures."""
        return statistics.rate_bound(self.failures, self.rays)


Findings = Iterator[Finding]


@dataclass(frozen=True)
class Row:
    name: str
    title: str  # a line for the table
    tests: int  # rays in `make test`
    full: int  # rays in `make stability`
    run: Callable[[int, np.random.Generator], Findings]


_ROWS: dict[str, Row] = {}
_MODULES = (
    "quadrics", "torus", "blocks", "walls", "layers", "gaps", "contacts",
    "shadows", "invariance", "instruction_sets", "truth", "transforms", "no_rays",
)  # fmt: skip


def row(name: str, title: str, *, tests: int, full: int) -> Callable:
    """Registers a generator of findings as a row."""

    def register(run: Callable[[int, np.random.Generator], Findings]) -> Callable:
        _ROWS[name] = Row(name, title, tests, full, run)
        return run

    return register


def rows() -> dict[str, Row]:
    """All rows by name, in order."""
    for module in _MODULES:
        importlib.import_module(f"harness.stability.{module}")
    return dict(sorted(_ROWS.items(), key=lambda item: int(item[0][1:])))
