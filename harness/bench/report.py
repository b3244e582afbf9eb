"""The comparison written down: tables, plot and a document of all tables."""

from __future__ import annotations

from pathlib import Path

from harness import results
from harness.bench import errors
from harness.bench.entries import Bench
from harness.bench.plot import plot
from harness.bench.tables import all_tables
from harness.plots import save
from harness.scheme_tables import machine
from harness.store import Store
from harness.study import Study
from harness.table import write_forms

NAME = "bench"


def load(study: Study, store: Store) -> Bench:
    found = results.load(store, study)
    return Bench(found, errors.load(study, store, found.code_version))


def write(bench: Bench, folder: Path) -> Path:
    """Tables, plot and raw rows, to `folder`/bench; the document of all tables is named."""
    target = folder / NAME
    made = all_tables(bench)
    write_forms(made, target / "tables")
    document = target / f"{NAME}.md"
    where = machine(bench.results)
    refused = [f"- {line}\n" for line in bench.results.refusals()]
    document.write_text("\n".join([*(t.markdown() for t in (*made, where)), *refused]))
    rows = target / f"{NAME}_trials.csv"
    bench.results.rows.to_csv(rows, index=False, lineterminator="\n")
    save(plot(bench), target / "plots" / NAME)
    return document
