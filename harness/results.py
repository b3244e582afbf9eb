"""What the store says about a study: for each configuration its repeats, or why it is not tabled.

Nothing wrong is tabled. A picture of an exact scheme that differs in one bit of t, leaf or light
from naive's (or, without naive, from most configurations') is wrong; and a model whose picture
failed against the POV-Ray reference is left out altogether.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

from harness.statistics import Estimate, estimate
from harness.store import Store
from harness.study import Configuration, Study

Row = dict[str, Any]


@dataclass(frozen=True)
class Result:
    """One configuration, measured."""

    configuration: Configuration
    status: str  # ok | not run | unsupported | timeout | error | wrong | refused
    reason: str
    rows: list[Row] = field(repr=False)  # the repeats that went well, as stored

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
        return self.rows[0]["rays"]

    @property
    def structure_bytes(self) -> int:
        return self.rows[0]["structure_bytes"]

    @cached_property
    def counters(self) -> dict[str, int]:
        """Of one picture; empty if repeat 0 has no row."""
        return next((row["counters"] for row in self.rows if row["counters"]), {})

    @cached_property
    def build_s(self) -> Estimate:
        return estimate([row["build_s"] for row in self.rows])

    @cached_property
    def trace_s(self) -> Estimate:
        return estimate([row["trace_s"] for row in self.rows])

    @cached_property
    def total_s(self) -> Estimate:
        return estimate([row["build_s"] + row["trace_s"] for row in self.rows])


def paired(a: Result, b: Result, key: str) -> tuple[list[float], list[float]]:
    """The values of two results that were measured in the same round of the same session."""
    by_round = {(row["session"], row["repeat"]): row[key] for row in b.rows}
    pairs = [
        (row[key], by_round[row["session"], row["repeat"]])
        for row in a.rows
        if (row["session"], row["repeat"]) in by_round
    ]
    return [p[0] for p in pairs], [p[1] for p in pairs]


@dataclass(frozen=True)
class Results:
    """A study's results, all of one version of the code."""

    study: Study
    all: list[Result]
    inexact: Collection[str]  # the schemes whose picture may differ
    unchecked: list[str]  # models whose picture was compared with no reference
    checks: list[Row]  # the verdict on each picture that was compared
    sessions: list[Row]  # a row of each session that contributed, oldest first

    @property
    def tabled(self) -> list[Result]:
        return [result for result in self.all if result.ok]

    def refusals(self) -> list[str]:
        """One line for everything that was measured and is not tabled."""
        left_out = [r for r in self.all if not r.ok and r.status != "not run"]
        lines = [f"{r.configuration.label()}: {r.status}: {r.reason}" for r in left_out]
        return list(dict.fromkeys(lines))

    def find(self, model: str, scheme: str, **params: int | str) -> Result | None:
        """The tabled result whose parameters include `params`."""
        for result in self.tabled:
            same = (result.model, result.scheme) == (model, scheme)
            if same and params.items() <= result.params.items():
                return result
        return None


def load(store: Store, study: Study, inexact: Collection[str]) -> Results:
    """Read and judge the rows of a study: those of the newest code and, for each model, of its
    newest form."""
    rows = store.records()
    newest = rows[-1]["code_version"] if rows else None
    rows = [row for row in rows if row["code_version"] == newest]
    model_hashes = {row["model"]: row["model_hash"] for row in rows}
    rows = [row for row in rows if row["model_hash"] == model_hashes[row["model"]]]
    agreed = _agreed_pictures(rows, inexact)
    checks = {_picture(check): check for check in store.checks()}

    by_configuration: dict[tuple, dict[int, Row]] = {}
    for row in rows:  # oldest first: of several attempts at a repeat the last stays
        by_configuration.setdefault(_key(row), {})[row["repeat"]] = row

    results, used = [], {}
    for configuration in study.configurations:
        repeats = by_configuration.get(_key(vars(configuration)), {})
        result = _judge(configuration, list(repeats.values()), agreed, checks, inexact)
        used |= {row["session"]: row for row in result.rows}
        results.append(result)
    unchecked = {r.model for r in results if r.ok and _picture(r.rows[0]) not in checks}
    sessions = sorted(used.values(), key=lambda row: row["session_started_utc"])
    pictures = {(model_hashes.get(m), width, height) for m, width, height in study.pictures}
    verdicts = [check for picture, check in checks.items() if picture in pictures]
    return Results(study, results, inexact, sorted(unchecked), verdicts, sessions)


def _key(row: Row) -> tuple:
    return tuple(row[k] for k in ("model", "scheme", "params", "width", "height", "shape"))


def _picture(row: Row) -> tuple:
    """What all exact schemes must agree on: the model as seen, at a size."""
    return row["model_hash"], row["width"], row["height"]


def _agreed_pictures(rows: list[Row], inexact: Collection[str]) -> dict[tuple, tuple[str, str]]:
    """For each picture, the hash that is held to be right and whose it is."""
    exact = [row for row in rows if row["status"] == "ok" and row["scheme"] not in inexact]
    votes: dict[tuple, Counter[str]] = {}
    for row in exact:
        votes.setdefault(_picture(row), Counter())[row["picture_hash"]] += 1
    agreed = {key: (count.most_common(1)[0][0], "most") for key, count in votes.items()}
    brute_force = [row for row in exact if row["scheme"] == "naive"]
    return agreed | {_picture(row): (row["picture_hash"], "naive") for row in brute_force}


def _judge(
    configuration: Configuration,
    rows: list[Row],
    agreed: dict[tuple, tuple[str, str]],
    checks: dict[tuple, Row],
    inexact: Collection[str],
) -> Result:
    good = Result(configuration, "ok", "", sorted(rows, key=lambda row: row["repeat"]))

    def bad(status: str, reason: str) -> Result:
        return replace(good, status=status, reason=reason, rows=[])

    if not rows:
        return bad("not run", "")
    for row in rows:
        if row["status"] != "ok":
            return bad(row["status"], row["reason"])
        expected, whose = agreed.get(_picture(row), ("", ""))
        if configuration.scheme not in inexact and row["picture_hash"] != expected:
            found = row["picture_hash"]
            return bad("wrong", f"picture {found} where {whose} has {expected}")
    check = checks.get(_picture(rows[0]))
    if check and not check["passed"]:
        return bad("refused", f"against {check['reference']}: {check['reason']}")
    return good
