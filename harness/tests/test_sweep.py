import os
import random
import sqlite3
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import fake_sweep
import pytest
from fake_sweep import configuration

from harness import ROOT, UserError
from harness.store import Store
from harness.worker import Worker


@pytest.fixture
def store(tmp_path):
    store = Store(tmp_path / "trials.sqlite")
    yield store
    store.close()


def statuses(store: Store) -> Counter:
    return Counter(store.records()[["scheme", "status"]].itertuples(index=False, name=None))


def test_every_configuration_is_run_as_often_as_asked(store):
    fake_sweep.fake_sweep(store, "s", [configuration("a"), configuration("b", repeats=2)])
    assert statuses(store) == {("a", "ok"): 3, ("b", "ok"): 2}


def test_repeats_are_interleaved_in_shuffled_rounds(store):
    schemes = [f"scheme{i}" for i in range(8)]
    fake_sweep.fake_sweep(store, "s", [configuration(s) for s in schemes], seed=4)
    order = list(store.records()[["repeat", "scheme"]].itertuples(index=False, name=None))
    rounds = [[s for repeat, s in order if repeat == r] for r in range(3)]
    assert [repeat for repeat, _ in order] == sorted(repeat for repeat, _ in order)
    assert all(sorted(r) == schemes for r in rounds)
    assert rounds[0] != rounds[1] != rounds[2]


def test_a_failing_trial_is_a_row_with_its_reason_and_the_others_go_on(store):
    bad = ["crash", "exit", "raise", "greedy", "unsupported"]
    hang = configuration("hang", timeout_s=0.5)
    fine = [configuration("fine"), configuration("fine too")]
    fake_sweep.fake_sweep(store, "s", [*map(configuration, bad), hang, *fine])
    rows = store.records().to_dict("records")
    reasons = {r["scheme"]: (r["status"], r["reason"]) for r in rows if r["reason"]}
    assert reasons == {
        "crash": ("error", "killed by SIGSEGV"),
        "exit": ("error", "ended with exit code 1: ran out of luck"),
        "raise": ("error", "ValueError: no such thing"),
        "greedy": ("error", "out of memory"),
        "unsupported": ("unsupported", "no torus here"),
        "hang": ("timeout", "no answer in 0.5 s"),
    }
    assert statuses(store)["fine", "ok"] == statuses(store)["fine too", "ok"] == 3


def test_no_repeat_is_begun_that_would_exceed_the_budget(store):
    fake_sweep.fake_sweep(store, "s", [configuration("ten seconds", repeats=5, budget_s=25)])
    assert statuses(store) == {("ten seconds", "ok"): 2}
    fake_sweep.fake_sweep(store, "again", [configuration("ten seconds", repeats=5, budget_s=25)])
    assert statuses(store) == {("ten seconds", "ok"): 2}


def test_retry_adds_an_attempt_and_keeps_the_first(store):
    for name, retry in (("first", False), ("idle", False), ("retried", True)):
        fake_sweep.fake_sweep(store, name, [configuration("raise")], retry=retry)
    rows = store.records().to_dict("records")
    assert [(r["session"], r["attempt"]) for r in rows] == [("first", 0), ("retried", 1)]


def test_two_sweeps_never_measure_at_once(store):
    refused = pytest.raises(UserError, match="another sweep")
    with store.alone(), refused, Store(store.path).alone():
        pass


def test_killed_at_any_moment_it_resumes_and_loses_or_doubles_nothing(tmp_path):
    path, dots, trials, kills = tmp_path / "trials.sqlite", tmp_path / "dots", 300, 12
    program = [sys.executable, fake_sweep.__file__, str(path), str(trials)]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    chance = random.Random(1)
    with dots.open("ab") as output:
        for kill in range(kills + 1):
            child = subprocess.Popen(program, env=environment, stdout=output)
            if kill < kills:
                time.sleep(chance.uniform(0.1, 0.5))
                child.kill()
            child.wait()
            rows, written = _rows(path), dots.stat().st_size
            assert len(rows) == len(set(rows)), "a trial has two rows"
            assert written <= len(rows) <= written + kill + 1, "a row is gone, or came from nowhere"
    assert child.returncode == 0
    assert len(rows) == trials


def _rows(path: Path) -> list[tuple]:
    if not path.exists():
        return []
    try:
        query = "SELECT scheme, params, repeat, attempt FROM trials"
        return sqlite3.connect(path).execute(query).fetchall()
    except sqlite3.OperationalError:  # killed before the tables were made
        return []


def test_the_worker_dies_with_its_parent(tmp_path):
    """An orphan would go on computing beside the resumed sweep."""
    program = (
        "import sys, os, threading, time; sys.path[:0] = sys.argv[1:]\n"
        "import fake_sweep; from harness.worker import Worker\n"
        "worker = Worker('fake_sweep:run'); trial = fake_sweep.first\n"
        "c = fake_sweep.configuration\n"
        "worker.run(trial(c('fine')), 30); print(worker._child.pid, flush=True)\n"
        "worker.run(trial(c('hang')), 30)\n"
    )
    arguments = [str(ROOT), str(Path(fake_sweep.__file__).parent)]
    parent = subprocess.Popen([sys.executable, "-c", program, *arguments], stdout=subprocess.PIPE)
    worker = int(parent.stdout.readline())
    parent.kill()
    parent.wait()
    parent.stdout.close()
    deadline = time.monotonic() + 10
    while _running(worker) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not _running(worker)


def _running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_the_worker_is_one_process_until_a_trial_breaks_it():
    worker = Worker("fake_sweep:run")
    try:
        pids = []
        for scheme in ("fine", "raise", "fine", "crash", "fine"):
            outcome = worker.run(fake_sweep.first(configuration(scheme)), 30)
            assert outcome.duration_s > 0
            pids.append(worker._child and worker._child.pid)
    finally:
        worker.stop()
    assert pids[0] == pids[1] == pids[2]
    assert pids[3] is None
    assert pids[4] not in (None, pids[0])
