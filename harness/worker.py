"""The process that measures: one long-lived child of the sweep.

A trial that crashes, hangs or runs out of memory takes down this process alone; the sweep notes
why and starts another. Trials go in and outcomes come out as lines of JSON.
"""

from __future__ import annotations

import ctypes
import dataclasses
import importlib
import json
import os
import resource
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime

from harness.store import Outcome, Trial

RunTrial = Callable[[Trial], Outcome]
SHARE_OF_MEMORY = 0.75  # of the machine's, that a trial may take before it is refused


class Worker:
    """Runs trials with the function named `module:function`, in a child process."""

    def __init__(self, run: str = "harness.trials:run") -> None:
        self._run = run
        self._child: subprocess.Popen[str] | None = None
        self._errors = tempfile.TemporaryFile("w+")  # noqa: SIM115

    def run(self, trial: Trial, timeout_s: float) -> Outcome:
        """The outcome of a trial, whatever happens to the child."""
        started_utc, begin = utc_now(), time.monotonic()
        child = self._child = self._child or self._start()
        try:
            child.stdin.write(json.dumps(dataclasses.asdict(trial)) + "\n")
            child.stdin.flush()
            answered, _, _ = select.select([child.stdout], [], [], timeout_s)
            answer = child.stdout.readline() if answered else None
        except BrokenPipeError:
            answer = ""
        if answer:
            outcome = Outcome(**json.loads(answer))
        elif answer is None:
            self.stop()
            outcome = Outcome("timeout", f"no answer in {timeout_s:g} s")
        else:
            outcome = Outcome("error", self._cause_of_death())
        outcome.started_utc = started_utc
        outcome.duration_s = time.monotonic() - begin
        return outcome

    def stop(self) -> None:
        """End the child; the next trial starts another."""
        if self._child:
            with suppress(ProcessLookupError):
                os.killpg(self._child.pid, signal.SIGKILL)  # and programs that it runs
            self._child.wait()
            self._child.stdin.close()
            self._child.stdout.close()
            self._child = None

    def _start(self) -> subprocess.Popen[str]:
        self._errors.seek(0)
        self._errors.truncate()
        threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
        path = os.pathsep.join(filter(None, sys.path))
        return subprocess.Popen(
            [sys.executable, "-m", "harness.worker", self._run],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
            bufsize=1,
            env=os.environ | threads | {"PYTHONPATH": path},
            start_new_session=True,  # Ctrl-C is for the sweep, which then stops us
        )

    def _cause_of_death(self) -> str:
        code = self._child.wait()
        self.stop()
        if code < 0:
            return f"killed by {signal.Signals(-code).name}"
        self._errors.seek(0)
        lines = self._errors.read().strip().splitlines() or ["no message"]
        return f"ended with exit code {code}: {lines[-1]}"


def utc_now() -> str:
    """ISO 8601, to the microsecond, so that it sorts as text."""
    return datetime.now(UTC).isoformat(timespec="microseconds")


def _attempt(run: RunTrial, trial: Trial) -> Outcome:
    try:
        return run(trial)
    except MemoryError:
        return Outcome("error", "out of memory")
    except Exception as error:  # whatever it was: it is this trial's outcome, the others go on
        message = " ".join(str(error).split())
        return Outcome("error", f"{type(error).__name__}: {message}")


def _die_with_parent() -> None:
    """An orphan must not go on computing: it would disturb the next sweep's times."""
    pr_set_pdeathsig = 1
    ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGKILL)


def _limit_memory() -> None:
    """Fail with bad_alloc before the machine swaps or the kernel picks a victim."""
    total = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    limit = int(total * SHARE_OF_MEMORY)
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


def main() -> None:
    _die_with_parent()
    _limit_memory()
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what a trial prints is not an answer
    sys.stdout.reconfigure(line_buffering=True)  # and stands before its last words
    module, _, function = sys.argv[1].partition(":")
    run: RunTrial = getattr(importlib.import_module(module), function)
    for line in sys.stdin:
        outcome = _attempt(run, Trial(**json.loads(line)))
        print(json.dumps(dataclasses.asdict(outcome)), file=answers, flush=True)


if __name__ == "__main__":
    main()
