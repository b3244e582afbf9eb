import dataclasses
import json
import sqlite3

import pytest
from fake_sweep import configuration, first, session

from harness import UserError
from harness.store import Check, Outcome, Store

TRIAL = first(configuration("sdsm"))


@pytest.fixture
def store(tmp_path):
    store = Store(tmp_path / "new folder" / "trials.sqlite")
    store.add_session(dataclasses.replace(session("s"), machine={"cores": 2}))
    yield store
    store.close()


def test_what_goes_in_comes_out_unrounded(store):
    outcome = Outcome("ok", trace_s=0.1 + 0.2, structure_bytes=2**40, counters={"cells": 2**53})
    store.add_trial("s", TRIAL, outcome)
    (row,) = store.records().to_dict("records")
    assert row["trace_s"] == 0.1 + 0.2
    assert row["structure_bytes"] == 2**40
    assert json.loads(row["counters"]) == {"cells": 2**53}
    assert json.loads(row["machine"]) == {"cores": 2}
    assert row["build_s"] is None


def test_integers_and_hashes_stay_what_they_are_beside_gaps(store):
    hashes = ["0012345678901234", "12345678901234e5", None]
    for repeat, (value, picture_hash) in enumerate(zip([2**53 + 1, None, 3], hashes, strict=True)):
        outcome = Outcome("ok", structure_bytes=value, picture_hash=picture_hash, trace_s=2.0)
        store.add_trial("s", dataclasses.replace(TRIAL, repeat=repeat), outcome)
    rows = store.records()
    assert rows["picture_hash"].dropna().tolist() == hashes[:2]
    assert rows["structure_bytes"].dropna().tolist() == [2**53 + 1, 3]
    written = rows[["structure_bytes", "picture_hash", "trace_s"]].to_csv(index=False)
    assert written.splitlines()[1:] == [
        "9007199254740993,0012345678901234,2.0",
        ",12345678901234e5,2.0",
        "3,,2.0",
    ]


@pytest.mark.parametrize("field", [f.name for f in dataclasses.fields(TRIAL)])
def test_a_key_has_one_row_and_every_field_is_part_of_the_key(store, field):
    store.add_trial("s", TRIAL, Outcome("ok"))
    with pytest.raises(sqlite3.IntegrityError):
        store.add_trial("s", TRIAL, Outcome("error"))
    other = getattr(TRIAL, field) + (1 if isinstance(getattr(TRIAL, field), int) else "x")
    store.add_trial("s", dataclasses.replace(TRIAL, **{field: other}), Outcome("ok"))
    assert len(store.records()) == 2


@pytest.mark.parametrize("change", ["UPDATE trials SET trace_s = 1", "DELETE FROM trials"])
def test_a_row_is_never_changed(store, change):
    store.add_trial("s", TRIAL, Outcome("ok", trace_s=2.0))
    with pytest.raises(sqlite3.IntegrityError, match="never"):
        sqlite3.connect(store.path, isolation_level=None).execute(change)
    assert store.records()["trace_s"].tolist() == [2.0]


def test_it_is_durable_and_readable_while_written(store):
    store.add_trial("s", TRIAL, Outcome("ok"))
    assert store._db.execute("PRAGMA journal_mode").fetchone()[0] == "wal"
    assert store._db.execute("PRAGMA synchronous").fetchone()[0] == 2  # FULL
    assert len(Store(store.path).records()) == 1


def test_checks_keep_their_order_and_figures(store):
    for passed in (True, False):
        store.add_check(Check("ball", "h", 8, 8, "p", "POV-Ray", passed, "", {"rms": 0.5}, "now"))
    assert [(c["passed"], c["figures"]) for c in store.checks()] == [
        (1, {"rms": 0.5}),
        (0, {"rms": 0.5}),
    ]


def test_a_file_that_is_no_store_is_refused_in_one_line(tmp_path):
    path = tmp_path / "trials.sqlite"
    path.write_text("not a database, and longer than the header of one is" * 10)
    with pytest.raises(UserError, match="not a database"):
        Store(path)


def test_an_older_store_is_brought_up_to_date_and_its_rows_are_kept(tmp_path):
    """Version 2 had no threads, and errors of one study only."""
    store = Store(tmp_path / "trials.sqlite")
    store.add_session(session("s"))
    store.add_trial("s", TRIAL, Outcome("ok", trace_s=0.1 + 0.2, counters={"cells": 3}))
    old = store._db
    old.executescript("""
        DROP TRIGGER trials_never_change; DROP TRIGGER trials_never_go; DROP VIEW records;
        CREATE TABLE kept AS SELECT * FROM trials; DROP TABLE trials;
        ALTER TABLE kept RENAME TO trials; ALTER TABLE trials DROP COLUMN threads;
        CREATE TRIGGER trials_never_change BEFORE UPDATE ON trials BEGIN SELECT 1; END;
        CREATE TRIGGER trials_never_go BEFORE DELETE ON trials BEGIN SELECT 1; END;
        CREATE VIEW records AS SELECT * FROM trials JOIN sessions USING (session);
        ALTER TABLE errors DROP COLUMN study;
        PRAGMA user_version = 2;""")
    store.close()
    for _ in range(2):
        store = Store(tmp_path / "trials.sqlite")
        (row,) = store.records().to_dict("records")
        assert (row["threads"], row["trace_s"], row["scheme"]) == (1, 0.1 + 0.2, "sdsm")
        assert list(store.trials({TRIAL.code_version})) == [TRIAL]
        assert store.errors("accuracy") == []
    with pytest.raises(sqlite3.IntegrityError, match="never"):
        store._db.execute("DELETE FROM trials")
    with pytest.raises(sqlite3.IntegrityError, match="UNIQUE"):
        store.add_trial("s", TRIAL, Outcome("ok"))
    store.add_trial("s", dataclasses.replace(TRIAL, threads=2), Outcome("ok"))


def test_a_store_of_another_version_is_refused(tmp_path):
    path = tmp_path / "trials.sqlite"
    sqlite3.connect(path).execute("PRAGMA user_version = 99")
    with pytest.raises(UserError, match="version 99"):
        Store(path)
