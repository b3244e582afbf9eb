"""A sweep of trials that measure nothing: each misbehaves as its scheme's name says.

As a program, `fake_sweep.py STORE TRIALS`, it is what test_sweep.py kills. It prints a dot for
every trial whose row is said to be written.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path
from types import SimpleNamespace

from harness.store import Outcome, Session, Store, Trial
from harness.study import Configuration
from harness.sweep import sweep

SILENT = SimpleNamespace(running=lambda *_: None, finished=lambda *_: None)
DOTS = SimpleNamespace(running=lambda *_: None, finished=lambda *_: print(end=".", flush=True))


def run(trial: Trial) -> Outcome:
    """What the worker calls in place of harness.trials.run."""
    print("a trial may print what it likes")
    if trial.scheme == "crash":
        os.kill(os.getpid(), signal.SIGSEGV)
    if trial.scheme == "exit":
        sys.exit("ran out of luck")
    if trial.scheme == "hang":
        time.sleep(60)
    if trial.scheme == "raise":
        raise ValueError("no such\tthing")
    if trial.scheme == "greedy":
        bytearray(1 << 60)
    if trial.scheme == "unsupported":
        return Outcome("unsupported", "no torus here")
    time.sleep(0.003)
    return Outcome("ok", build_s=1.0, trace_s=9.0, picture_hash="0" * 16, rays=1)


def configuration(scheme: str, **settings) -> Configuration:
    defaults = dict(
        params="{}",
        width=8,
        height=8,
        shape="as_written",
        threads=1,
        repeats=3,
        budget_s=1e9,
        timeout_s=30.0,
    )
    return Configuration("ball", scheme, **(defaults | settings))


def first(c: Configuration) -> Trial:
    return Trial(
        c.model, "hash", c.shape, c.scheme, c.params, "float64", c.width, c.height, c.threads,
        repeat=0, attempt=0, code_version="code",
    )  # fmt: skip


def session(name: str) -> Session:
    return Session(name, "fake", 0, "2000-01-01", "none", {}, "", "", {})


def fake_sweep(store: Store, name: str, configurations: list[Configuration], **options) -> None:
    store.add_session(session(name))
    options = {"report": SILENT, "run": f"{Path(__file__).stem}:run"} | options
    sweep(configurations, first, store, name, **options)


def main() -> None:
    path, trials = Path(sys.argv[1]), int(sys.argv[2])
    many = [configuration("fine", params=f'{{"d":{i}}}') for i in range(trials // 3)]
    store = Store(path)
    with store.alone():
        fake_sweep(store, str(os.getpid()), many, report=DOTS)


if __name__ == "__main__":
    main()
