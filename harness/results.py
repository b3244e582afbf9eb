"""What the store says about a study: for each configuration its repeats, or why it is not tabled.

Nothing wrong is tabled. A picture of an exact scheme that differs in one bit of t, leaf or light
from naive's (or, without naive, from most configurations') is wrong; and a model whose picture
failed against the POV-Ray reference is left out altogether.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import pandas as pd

from harness import statistics
from harness.schemes import is_exact
from harness.statistics import Estimate, estimate
from harness.store import Store
from harness.study import KEY, Configuration, Study

# What all exact schemes must agree on: the model as seen, at a size.
_PICTURE = ["model_hash", "width", "height"]
_SAME_BITS = [*_PICTURE, "precision"]
_CONFIGURATION = list(KEY)


@dataclass(frozen=True)
class Result:
    """One configuration, measured."""

    configuration: Configuration
    status: str  # ok | not run | unsupported | timeout | error | wrong | refused
    reason: str
    rows: pd.DataFrame = field(repr=False)  # of the store: a row a repeat; none unless ok

    @property
    def exact(self) -> bool:
        """Whether its picture must be naive's to the bit."""
        return is_exact(self.scheme, self.params)

    @property
    def ok(self) -> bool:
        return self.status == "ok"

    @property
    def model(self) -> str:
        return self.configuration.model

    @property
    def scheme(self) -> str:
        return self.configuration.scheme

    @cached_property
    def params(self) -> dict[str, int | str]:
        return json.loads(self.configuration.params)

    @property
    def rays(self) -> int:
        """Primary and shadow rays of the picture."""
        return int(self.rows["rays"].iat[0])

    @property
    def structure_bytes(self) -> int:
        return int(self.rows["structure_bytes"].iat[0])

    @cached_property
    def counters(self) -> dict[str, int]:
        """Of one picture; empty if repeat 0 has no row."""
        return next(map(json.loads, self.rows["counters"].dropna()), {})

    @property
    def mesh_s(self) -> float | None:
        """To make the mesh that the scheme traces, if it traces one."""
        made = self.rows["mesh_s"].dropna()
        return None if made.empty else float(made.median())

    @cached_property
    def build_s(self) -> Estimate:
        return estimate(self.rows["build_s"])

    @cached_property
    def trace_s(self) -> Estimate:
        return estimate(self.rows["trace_s"])

    @cached_property
    def total_s(self) -> Estimate:
        return estimate(self.rows["build_s"] + self.rows["trace_s"])


def paired(a: Result, b: Result, key: str) -> tuple[pd.Series, pd.Series]:
    """The values of two results that were measured in the same round of the same session."""
    pairs = a.rows.merge(b.rows, on=["session", "repeat"], suffixes=("_a", "_b"))
    return pairs[f"{key}_a"], pairs[f"{key}_b"]


def ratio(a: Result, b: Result, key: str) -> Estimate:
    """How many times b's value a's is: the median over the rounds that measured both. Where these
    are too few, the ratio of the medians, without an interval; so is 1 to itself."""
    if a.configuration == b.configuration:
        return Estimate(1.0, math.nan, math.nan, len(a.rows))
    of_a, of_b = paired(a, b, key)
    if len(of_a) >= statistics.LEAST:
        return statistics.ratio(of_a, of_b)
    medians = (getattr(result, key).median for result in (a, b))
    return statistics.ratio(*([median] for median in medians))


@dataclass(frozen=True)
class Results:
    """A study's results, all of one version of the code."""

    study: Study
    all: list[Result]
    unchecked: list[str]  # models whose picture was compared with no reference
    checks: list[dict[str, Any]]  # the verdict on each picture that was compared
    rows: pd.DataFrame  # all that is tabled, as stored, oldest first

    @property
    def code_version(self) -> str | None:
        """Of the code that all rows were measured by."""
        return None if self.rows.empty else str(self.rows["code_version"].iat[0])

    @property
    def tabled(self) -> list[Result]:
        return [result for result in self.all if result.ok]

    @cached_property
    def constant(self) -> dict[str, dict[str, int | str]]:
        """By scheme, the parameters that have one value in the whole study."""
        values: dict[str, dict[str, set]] = {}
        for result in self.all:
            of_scheme = values.setdefault(result.scheme, {})
            for name, value in result.params.items():
                of_scheme.setdefault(name, set()).add(value)
        return {
            scheme: {name: next(iter(found)) for name, found in params.items() if len(found) == 1}
            for scheme, params in values.items()
        }

    def refusals(self) -> list[str]:
        """One line for everything that was measured and is not tabled."""
        left_out = [r for r in self.all if not r.ok and r.status != "not run"]
        lines = [f"{r.configuration.label()}: {r.status}: {r.reason}" for r in left_out]
        return list(dict.fromkeys(lines))

    def of(self, configuration: Configuration) -> Result | None:
        """The tabled result of a configuration."""
        return next((r for r in self.tabled if r.configuration == configuration), None)

    def find(self, model: str, scheme: str, **params: int | str) -> Result | None:
        """The tabled result whose parameters include `params`."""
        for result in self.tabled:
            same = (result.model, result.scheme) == (model, scheme)
            if same and params.items() <= result.params.items():
                return result
        return None


def load(store: Store, study: Study) -> Results:
    """Read and judge the rows of a study, of one code and, for each model, of its newest form.

    The code is the newest that has half as many of the study's configurations as any: another
    study's may be planned here too, and a few of them are no study."""
    rows = store.records()
    planned = {tuple(getattr(c, key) for key in _CONFIGURATION) for c in study.configurations}
    is_own = [tuple(row) in planned for row in rows[_CONFIGURATION].itertuples(index=False)]
    own = rows.loc[is_own].drop_duplicates(["code_version", *_CONFIGURATION], keep="last")
    measured = own["code_version"].value_counts()
    enough = own[own["code_version"].map(measured) * 2 >= measured.max()]
    rows = rows[rows["code_version"].isin(enough["code_version"].tail(1))]
    rows = rows[rows["model_hash"] == rows.groupby("model")["model_hash"].transform("last")]
    model_hashes = dict(zip(rows["model"], rows["model_hash"], strict=True))
    checks = {tuple(check[key] for key in _PICTURE): check for check in store.checks()}

    judged = _with_wrong_pictures(rows)
    # Of several attempts at a repeat the last counts.
    judged = judged.drop_duplicates([*_CONFIGURATION, "repeat"], keep="last")
    repeats = dict(iter(judged.groupby(_CONFIGURATION)))
    results = [
        _judge(c, repeats.get(tuple(getattr(c, key) for key in _CONFIGURATION), rows[:0]), checks)
        for c in study.configurations
    ]
    pictures = {(model_hashes.get(m), width, height) for m, width, height in study.pictures}
    verdicts = [check for picture, check in checks.items() if picture in pictures]
    unchecked = {r.model for r in results if r.ok and _picture(r.rows) not in checks}
    tabled = pd.concat([rows[:0], *(r.rows for r in results)]).sort_index()
    return Results(study, results, sorted(unchecked), verdicts, tabled)


def _picture(rows: pd.DataFrame) -> tuple:
    return tuple(rows[_PICTURE].iloc[0])


def _with_wrong_pictures(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows, where those of an exact scheme with another picture than naive's are "wrong"."""
    rows = rows.copy()
    settings = zip(rows["scheme"], rows["params"], strict=True)
    promised = [is_exact(scheme, json.loads(params)) for scheme, params in settings]
    exact = rows[(rows["status"] == "ok") & pd.Series(promised, rows.index, dtype=bool)]
    for _, same in exact.groupby(_SAME_BITS):
        naive = same[same["scheme"] == "naive"]
        votes, whose = (same, "most") if naive.empty else (naive, "naive")
        right = votes["picture_hash"].mode()[0]
        wrong = same.loc[same["picture_hash"] != right, "picture_hash"]
        rows.loc[wrong.index, "status"] = "wrong"
        rows.loc[wrong.index, "reason"] = "picture " + wrong + f" where {whose} has {right}"
    return rows


def _judge(configuration: Configuration, rows: pd.DataFrame, checks: dict[tuple, dict]) -> Result:
    if rows.empty:
        return Result(configuration, "not run", "", rows)
    bad = rows[rows["status"] != "ok"]
    if not bad.empty:
        return Result(configuration, bad["status"].iat[0], bad["reason"].iat[0], rows[:0])
    check = checks.get(_picture(rows))
    if check and not check["passed"]:
        reason = f"against {check['reference']}: {check['reason']}"
        return Result(configuration, "refused", reason, rows[:0])
    return Result(configuration, "ok", "", rows.sort_values("repeat"))
