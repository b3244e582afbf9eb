"""X18: would the rows notice? Twenty bugs, planted one at a time; each must be caught by a row.

Each bug is one that tracers have had: in the papers, in the literature on robustness, or here.
`planted.toml` lists them with the rows that are tried, most likely first; a bug is caught by the
first row with a finding that is not met.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from harness import UserError
from harness.stability.build import Edit, build

LIST = Path(__file__).with_name("planted.toml")
TIMEOUT_S = 300


@dataclass(frozen=True)
class Bug:
    name: str
    edit: Edit
    rows: tuple[str, ...]  # tried, in this order


@dataclass(frozen=True)
class Catch:
    name: str  # of the bug
    file: str
    row: str  # "" if none of them noticed
    how: str


def bugs() -> list[Bug]:
    tables = tomllib.loads(LIST.read_text())["bugs"]
    return [Bug(b["name"], Edit(b["file"], b["old"], b["new"]), tuple(b["rows"])) for b in tables]


def catch_all(told: Callable[[int, int, str], None]) -> list[Catch]:
    """About a minute a bug, most of it compiling. `told(done, total, name)` is called before."""
    every = bugs()
    catches = []
    for number, bug in enumerate(every):
        told(number, len(every), bug.name)
        catches.append(catch(bug))
    return catches


def catch(bug: Bug) -> Catch:
    module = build("planted", [bug.edit], optimization="-O1")
    for row in bug.rows:
        if how := _notices(module, row):
            return Catch(bug.name, bug.edit.file, row, how)
    return Catch(bug.name, bug.edit.file, "", "no row noticed")


def _notices(module: Path, row: str) -> str:
    """What the row says of this build: its first finding that is not met, or ""."""
    command = [sys.executable, "-m", "harness.stability.planted", str(module), row]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=TIMEOUT_S, check=False
        )
    except subprocess.TimeoutExpired:
        return f"did not end in {TIMEOUT_S} s"
    if done.returncode < 0:
        return f"crashed with signal {-done.returncode}"
    if done.returncode:
        raise UserError(f"{row}: {done.stderr.strip().splitlines()[-1]}")
    return json.loads(done.stdout)


def _main(module: str, row: str) -> None:
    from harness.stability import build as builds

    builds.load(Path(module))
    from harness.stability.run import run_row

    unmet = [f for f in run_row(row) if not f.met and not f.red]
    said = ""
    if unmet:
        f = unmet[0]
        worst = "" if f.worst is None else f", worst {f.worst:.3g} of {f.bar:g} {f.measured}"
        said = f"{f.case}: {f.failures} of {f.rays}{worst}"
    print(json.dumps(said))


if __name__ == "__main__":
    _main(*sys.argv[1:])
