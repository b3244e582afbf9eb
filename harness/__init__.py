"""The measuring side: trials, sweeps of trials, their store, references, tables and plots."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "results"
STORE = "trials.sqlite"  # in a folder of results
PUBLISHED = RESULTS / "published"


class UserError(Exception):
    """Something the user can put right: the CLI prints the one line and exits with 2."""
