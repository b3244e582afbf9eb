"""The store of everything measured: one SQLite file, append only, safe against kill -9.

A row is on disk when `add_trial` returns (WAL, synchronous=FULL). Triggers refuse to change or to
delete a trial, and a unique index on its key refuses to write one twice.
"""

from __future__ import annotations

import dataclasses
import fcntl
import json
import sqlite3
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness import UserError

if TYPE_CHECKING:
    import pandas as pd

VERSION = 3


@dataclass(frozen=True)
class Trial:
    """The key of one measurement."""

    model: str
    model_hash: str  # of the evaluated .csg, camera and lights
    shape: str
    scheme: str
    params: str  # canonical JSON
    precision: str
    width: int
    height: int
    threads: int
    repeat: int  # from 0
    attempt: int  # 0; more when a failed trial was asked for again
    code_version: str  # hash of the sources of `tracers`


@dataclass
class Outcome:
    """What came of a trial. What was not measured is None."""

    status: str  # ok | unsupported | timeout | error
    reason: str = ""
    started_utc: str = ""
    duration_s: float | None = None  # of the whole trial, loading and counting included
    build_s: float | None = None
    trace_s: float | None = None
    mesh_s: float | None = None  # to tessellate, where the scheme traces a mesh
    structure_bytes: int | None = None
    rays: int | None = None  # primary and shadow
    picture_hash: str | None = None
    counters: dict[str, int] | None = None  # from a render of its own, for repeat 0 only
    facts: dict[str, float] | None = None


@dataclass(frozen=True)
class Session:
    """One invocation of a sweep, and the machine it ran on."""

    session: str
    study: str
    seed: int
    session_started_utc: str
    git_commit: str  # with "+" after it where files differed from the commit
    machine: dict[str, Any]
    compiler: str
    flags: str
    versions: dict[str, str]


@dataclass(frozen=True)
class Check:
    """A picture compared with a reference made by other code."""

    model: str
    model_hash: str
    width: int
    height: int
    picture_hash: str
    reference: str  # what made the reference, and with which settings
    passed: bool
    reason: str
    figures: dict[str, float]
    checked_utc: str


@dataclass(frozen=True)
class Errors:
    """What a configuration errs; which figures, is up to the study that asks."""

    study: str
    model: str
    model_hash: str
    shape: str
    scheme: str
    params: str
    width: int
    height: int
    code_version: str
    figures: dict[str, float]
    measured_utc: str


_TYPES = {"str": "TEXT", "int": "INTEGER", "float": "REAL", "bool": "INTEGER", "dict": "TEXT"}


def _names(record: type) -> list[str]:
    return [field.name for field in dataclasses.fields(record)]


def _columns(record: type) -> str:
    """SQL column definitions of a dataclass; dictionaries are kept as JSON."""
    columns = []
    for field in dataclasses.fields(record):
        kind, *optional = field.type.split(" | ")
        null = "" if optional else " NOT NULL"
        columns.append(f"{field.name} {_TYPES[kind.partition('[')[0]]}{null}")
    return ", ".join(columns)


_TRIALS = f"""
CREATE TABLE trials (
  {_columns(Trial)}, {_columns(Outcome)}, session TEXT NOT NULL REFERENCES sessions,
  UNIQUE ({", ".join(_names(Trial))}),
  CHECK (status IN ('ok', 'unsupported', 'timeout', 'error')));
CREATE TRIGGER trials_never_change BEFORE UPDATE ON trials
  BEGIN SELECT RAISE(ABORT, 'a trial is never rewritten'); END;
CREATE TRIGGER trials_never_go BEFORE DELETE ON trials
  BEGIN SELECT RAISE(ABORT, 'a trial is never deleted'); END;
CREATE VIEW records AS SELECT * FROM trials JOIN sessions USING (session);
"""
_SCHEMA = f"""
CREATE TABLE sessions ({_columns(Session)}, PRIMARY KEY (session));
{_TRIALS}
CREATE TABLE checks ({_columns(Check)});
CREATE TABLE errors ({_columns(Errors)});
"""
_OLD_TRIALS = ", ".join(
    name for name in (*_names(Trial), *_names(Outcome), "session") if name != "threads"
)
# From each version to the next: 1 had no errors; 2 had no threads, and errors of one study only. A
# key cannot be extended in place, so the rows move to a new table.
_MIGRATIONS = {
    1: f"CREATE TABLE errors ({_columns(Errors).removeprefix('study TEXT NOT NULL, ')});",
    2: f"""
DROP VIEW records;
DROP TRIGGER trials_never_change;
DROP TRIGGER trials_never_go;
ALTER TABLE trials RENAME TO old_trials;
{_TRIALS}
INSERT INTO trials ({_OLD_TRIALS}, threads) SELECT {_OLD_TRIALS}, 1 FROM old_trials;
DROP TABLE old_trials;
ALTER TABLE errors ADD COLUMN study TEXT NOT NULL DEFAULT 'accuracy';
""",
}


class Store:
    """An open store. `path` is made, with its folder, if it does not exist."""

    def __init__(self, path: Path) -> None:
        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        self._db = sqlite3.connect(path, isolation_level=None, timeout=30)
        self._db.row_factory = sqlite3.Row
        try:
            self._db.executescript("PRAGMA journal_mode=WAL; PRAGMA synchronous=FULL;")
            self._make_schema()
        except sqlite3.DatabaseError as error:
            raise UserError(f"{path}: {error}; move it away to begin a new one") from None

    def _make_schema(self) -> None:
        self._db.execute("BEGIN IMMEDIATE")  # two processes may open a new store at once
        version = self._db.execute("PRAGMA user_version").fetchone()[0]
        if version > VERSION:
            raise UserError(
                f"{self.path}: written by version {version} of the store, this is {VERSION}; "
                "move it away to begin a new one"
            )
        scripts = [_MIGRATIONS[old] for old in range(version, VERSION)] if version else [_SCHEMA]
        for script in scripts:
            for statement in _statements(script):
                self._db.execute(statement)
        self._db.execute(f"PRAGMA user_version = {VERSION}")
        self._db.execute("COMMIT")

    def close(self) -> None:
        self._db.close()

    def add_session(self, session: Session) -> None:
        self._insert("sessions", session)

    def add_trial(self, session: str, trial: Trial, outcome: Outcome) -> None:
        """Durable when it returns. sqlite3.IntegrityError if the trial has a row already."""
        self._insert("trials", trial, outcome, session=session)

    def add_check(self, check: Check) -> None:
        self._insert("checks", check)

    def add_errors(self, errors: Errors) -> None:
        self._insert("errors", errors)

    def _insert(self, table: str, *records: Any, **more: Any) -> None:
        row = {
            field.name: getattr(record, field.name)
            for record in records
            for field in dataclasses.fields(record)
        } | more
        values = [json.dumps(v, sort_keys=True) if isinstance(v, dict) else v for v in row.values()]
        marks = ", ".join("?" * len(row))
        self._db.execute(f"INSERT INTO {table} ({', '.join(row)}) VALUES ({marks})", values)

    def trials(self, code_versions: Collection[str]) -> dict[Trial, sqlite3.Row]:
        """Every trial that has a row for one of these versions of the code."""
        marks = ", ".join("?" * len(code_versions))
        query = f"SELECT * FROM trials WHERE code_version IN ({marks})"
        rows = self._db.execute(query, list(code_versions))
        return {Trial(**{name: row[name] for name in _names(Trial)}): row for row in rows}

    def records(self) -> pd.DataFrame:
        """All trials with their sessions, oldest first; dictionaries stay JSON."""
        import pandas as pd  # here, for the worker imports this module and must stay small

        # Nullable types: a column of integers stays one where something was not measured.
        query = "SELECT * FROM records ORDER BY started_utc"
        return pd.read_sql_query(query, self._db, dtype_backend="numpy_nullable")

    def checks(self) -> list[dict[str, Any]]:
        """All comparisons with references, oldest first."""
        rows = map(dict, self._db.execute("SELECT * FROM checks ORDER BY rowid"))
        return [row | {"figures": json.loads(row["figures"])} for row in rows]

    def errors(self, study: str) -> list[dict[str, Any]]:
        """All errors of configurations that a study asked for, oldest first."""
        query = "SELECT * FROM errors WHERE study = ? ORDER BY rowid"
        rows = map(dict, self._db.execute(query, [study]))
        return [row | {"figures": json.loads(row["figures"])} for row in rows]

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Held while measuring: two sweeps at once would disturb each other's times."""
        with open(self.path.with_suffix(".lock"), "w") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise UserError(f"another sweep is writing to {self.path}") from None
            yield


def _statements(script: str) -> Iterator[str]:
    """Split a script into statements; executescript would commit our transaction."""
    statement = ""
    for line in script.splitlines():
        statement += line + "\n"
        if sqlite3.complete_statement(statement):
            yield statement
            statement = ""
