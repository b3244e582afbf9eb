"""The settings of the study: each is timed by a sweep, and its errors are measured here once."""

from __future__ import annotations

import dataclasses
import json

from rich.console import Console

from harness import models, results
from harness.accuracy.measure import by_model, measure
from harness.machine import code_version
from harness.results import Result, Results
from harness.schemes import precision
from harness.statistics import Estimate, rate_bound
from harness.store import Errors, Store
from harness.study import Configuration, Study
from harness.worker import utc_now

NAME = "accuracy"  # of the study


@dataclasses.dataclass(frozen=True)
class Setting:
    """One configuration, measured in both ways."""

    result: Result
    knob: str
    value: str
    figures: dict[str, float]

    @property
    def ray_ns(self) -> Estimate:
        return self.result.trace_s.map(lambda seconds: 1e9 * seconds / self.result.rays)

    @property
    def preparation_s(self) -> float:
        """To build, and to make the mesh if there is one."""
        return self.result.build_s.median + (self.result.mesh_s or 0)

    @property
    def label(self) -> str:
        return self.value if self.knob == "exact" else f"{self.knob} {self.value}"

    def per_million(self, key: str) -> float:
        """Of the picture's pixels."""
        return 1e6 * self.figures[key] / self.figures["pixels"]

    def bound_per_million(self, key: str) -> float:
        """Below which that rate lies with 95%."""
        return 1e6 * rate_bound(self.figures[key], self.figures["pixels"])

    @property
    def is_compared(self) -> bool:
        """Of the size of the picture that all are held against."""
        return "pixels" in self.figures


def measure_missing(console: Console, study: Study, store: Store) -> None:
    """Errors of every model of which some configuration has none for this code."""
    known = {_key(row) for row in store.errors(NAME)}
    for model, configurations in by_model(study.configurations).items():
        hashed = models.content_hash(model)
        records = [
            Errors(NAME, c.model, hashed, c.shape, c.scheme, c.params, c.width, c.height,
                   code_version(), {}, "")
            for c in configurations
        ]  # fmt: skip
        if {_key(dataclasses.asdict(record)) for record in records} <= known:
            continue
        told = lambda label: console.print(f"errors: {label}", highlight=False)  # noqa: E731
        figures = measure(configurations, told)
        for record, found in zip(records, figures, strict=True):
            store.add_errors(dataclasses.replace(record, figures=found, measured_utc=utc_now()))


def _key(row: dict) -> tuple:
    names = ("model", "model_hash", "shape", "scheme", "params", "width", "height", "code_version")
    return tuple(row[name] for name in names)


def load(study: Study, store: Store) -> list[Setting]:
    """What has been measured in both ways, by the same code."""
    found: Results = results.load(store, study)
    errors = {_key(row): row["figures"] for row in store.errors(NAME)}
    first = {model: group[0] for model, group in by_model(study.configurations).items()}
    settings = []
    for r in found.tabled:
        row, c = r.rows.iloc[-1], r.configuration
        figures = errors.get(_key({**dataclasses.asdict(c), **row[["model_hash", "code_version"]]}))
        if figures is not None:
            settings.append(Setting(r, *_knob(c, first[c.model]), figures))
    return settings


def _knob(c: Configuration, exact: Configuration) -> tuple[str, str]:
    """What is turned, and to which value."""
    ours, theirs = json.loads(c.params), json.loads(exact.params)
    if c.scheme != exact.scheme:
        told = [key for key in ("segments", "tolerance") if key in ours]
        return c.scheme, " ".join(str(ours[key]) for key in told) or precision(ours)
    turned = [key for key in ours if ours[key] != theirs.get(key)]
    if turned:
        return turned[0], str(ours[turned[0]])
    if (c.width, c.height) != (exact.width, exact.height):
        return "size", f"{c.width}×{c.height}"
    return "exact", "float64"
