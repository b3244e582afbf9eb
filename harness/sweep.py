"""A sweep: every trial of a study that has no row yet, each leaving one, in a fair order.

The order is a randomized block design: round r runs repeat r of every configuration, each round
shuffled anew. What drifts on the machine (heat, neighbours) then falls on all configurations
alike, and values with the same repeat number were taken close together, so their ratio is fair.
"""

from __future__ import annotations

import random
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

from harness.store import Outcome, Store, Trial
from harness.study import Configuration
from harness.worker import Worker


class Reporter(Protocol):
    """Told what is going on; see progress.py."""

    def running(self, label: str, done: int, total: int, left_s: float | None) -> None: ...
    def finished(self, label: str, outcome: Outcome) -> None: ...


@dataclass
class _Plan:
    """One configuration: what it has done, and what it still has to do."""

    configuration: Configuration
    attempts: dict[int, Trial]  # the trial to run for each repeat
    done: set[int] = field(default_factory=set)
    failed: bool = False
    spent_s: float = 0.0  # build and trace times, which the budget is about
    last_s: float = 0.0

    def note(self, repeat: int, status: str, build_s: float | None, trace_s: float | None) -> None:
        self.done.add(repeat)
        self.failed |= status != "ok"
        self.last_s = (build_s or 0) + (trace_s or 0)
        self.spent_s += self.last_s

    def remaining(self) -> int:
        """Repeats still to run: none after a failure, and only what the budget has room for."""
        if self.failed:
            return 0
        missing = self.configuration.repeats - len(self.done)
        if self.last_s == 0:
            return missing
        return max(0, min(missing, int((self.configuration.budget_s - self.spent_s) / self.last_s)))


def sweep(
    configurations: Sequence[Configuration],
    first_trial: Callable[[Configuration], Trial],
    store: Store,
    session: str,
    report: Reporter,
    *,
    seed: int = 0,
    retry: bool = False,
    run: str = "harness.trials:run",
) -> None:
    """Run what is missing. Killed at any moment, it can be called again and goes on from there.

    `first_trial` gives the key of a configuration's repeat 0. `retry` runs failed trials once
    more, as a further attempt. `run` names the function that measures, `module:function`; it is
    called in the worker process.
    """
    plans = _plans(configurations, first_trial, store, retry)
    worker = Worker(run)
    try:
        for plan, repeat in _rounds(plans, seed):
            label = plan.configuration.label()
            done = sum(len(p.done) for p in plans)
            total = done + sum(p.remaining() for p in plans)
            report.running(label, done, total, _time_left_s(plans))
            trial = plan.attempts[repeat]
            outcome = worker.run(trial, plan.configuration.timeout_s)
            store.add_trial(session, trial, outcome)
            plan.note(repeat, outcome.status, outcome.build_s, outcome.trace_s)
            report.finished(label, outcome)
    finally:
        worker.stop()


def _plans(
    configurations: Sequence[Configuration],
    first_trial: Callable[[Configuration], Trial],
    store: Store,
    retry: bool,
) -> list[_Plan]:
    """What the store has already, taken into account."""
    firsts = [first_trial(configuration) for configuration in configurations]
    rows: dict[Trial, dict[Trial, Mapping]] = defaultdict(dict)
    for trial, row in store.trials({first.code_version for first in firsts}).items():
        rows[replace(trial, repeat=0, attempt=0)][trial] = row
    plans = []
    for configuration, first in zip(configurations, firsts, strict=True):
        attempts = {
            repeat: replace(first, repeat=repeat) for repeat in range(configuration.repeats)
        }
        plan = _Plan(configuration, attempts)
        latest = {trial.repeat: trial for trial in sorted(rows[first], key=lambda t: t.attempt)}
        for repeat, trial in latest.items():
            row = rows[first][trial]
            if retry and row["status"] != "ok":
                attempts[repeat] = replace(trial, attempt=trial.attempt + 1)
            else:
                plan.note(repeat, row["status"], row["build_s"], row["trace_s"])
        plans.append(plan)
    return plans


def _rounds(plans: list[_Plan], seed: int) -> Iterator[tuple[_Plan, int]]:
    """What to run next, decided when asked: a failure or the budget may have ended a plan."""
    for repeat in range(max((plan.configuration.repeats for plan in plans), default=0)):
        order = [plan for plan in plans if repeat in plan.attempts]
        random.Random(f"{seed} {repeat}").shuffle(order)
        for plan in order:
            if repeat not in plan.done and plan.remaining():
                yield plan, repeat


def _time_left_s(plans: list[_Plan]) -> float | None:
    """Every configuration is taken to cost what it did last time, a new one the mean of all."""
    known = [plan.last_s for plan in plans if plan.last_s]
    if not known:
        return None
    mean_s = sum(known) / len(known)
    return sum(plan.remaining() * (plan.last_s or mean_s) for plan in plans)
