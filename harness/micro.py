"""`make bench-micro`: the microbenchmarks of tracers/bench on real models, and their tables.

Google Benchmark repeats each several times in random order; what is kept is every repetition.
"""

from __future__ import annotations

import dataclasses
import json
import shutil
import subprocess
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from rich.console import Console

from harness import ROOT, UserError, models
from harness.atomic import replacing
from harness.machine import code_version, session
from harness.mesh import Mesh, tessellate
from harness.scenes import Scene
from harness.statistics import Estimate, estimate
from harness.table import Column, Table, megabytes, number, write_forms

NAME = "micro"
PROGRAM = ROOT / "build" / NAME / NAME
MODELS = ("ball", "ngk")
REPETITIONS = 6  # the least with an interval free of a distribution
PER = "s_per_"  # begins the counter of seconds an item
SEGMENTS = 32  # of the mesh, as in the paper's study


@dataclass(frozen=True)
class Measured:
    """One benchmark: its name in parts, and seconds an item of what `per` says."""

    #: kernel/solid/precision/mix, structure/part/model, or scheme/name/model/rays
    name: tuple[str, ...]
    per: str
    item_s: Estimate
    primitives: float | None = None  # entered by a ray, of the least that a scheme could do


@dataclass(frozen=True)
class Outcome:
    measured: list[Measured]  # in the order of their registration
    refused: dict[str, str]  # benchmarks that a scheme does not support, and why
    machine: dict[str, Any]


def run(
    console: Console, folder: Path, chosen: Sequence[str] = MODELS, options: Sequence[str] = ()
) -> None:
    """Run all, or what `options` of Google Benchmark say, and keep the outcome in `folder`."""
    if not is_built():
        raise UserError("microbenchmarks: not built of these sources; run `make bench-micro`")
    with TemporaryDirectory() as inputs, replacing(_record(folder)) as outcome:
        for model in chosen:
            console.print(f"{NAME}: preparing {model}", highlight=False)
            _prepare(Path(inputs), model)
        command = [
            PROGRAM, inputs, *chosen, f"--benchmark_repetitions={REPETITIONS}",
            "--benchmark_enable_random_interleaving=true", "--benchmark_min_time=0.05",
            "--benchmark_out_format=json", f"--benchmark_out={outcome}", *options,
        ]  # fmt: skip
        console.print(f"{NAME}: running", highlight=False)
        finished = subprocess.run(command, capture_output=True, text=True, check=False)
        if finished.returncode:
            raise UserError(f"{NAME}: {finished.stderr.strip()}")
        measured = json.loads(outcome.read_text())["benchmarks"]
        about = vars(session(NAME, 0)) | {"code_version": code_version()}
        outcome.write_text(json.dumps({"session": about, "benchmarks": measured}, indent=1))


def is_built() -> bool:
    """Since the sources were last changed."""
    changed = max(file.stat().st_mtime for file in (ROOT / "tracers").rglob("*.?pp"))
    return PROGRAM.exists() and PROGRAM.stat().st_mtime >= changed


def _record(folder: Path) -> Path:
    return folder / NAME / f"{NAME}.json"


def _prepare(folder: Path, model: str) -> None:
    """What tracers/bench/main.cpp reads."""
    shutil.copy(models.csg(model), folder / f"{model}.csg")
    (folder / f"{model}.view").write_text(_view(models.scene(model)))
    (folder / f"{model}.mesh").write_bytes(_mesh(tessellate(models.tree(model), SEGMENTS)))


def _view(scene: Scene) -> str:
    numbers = [*scene.eye, *scene.look_at, *scene.up, scene.fov_deg, scene.width, scene.height]
    return " ".join(map(repr, [*numbers, *(x for light in scene.lights for x in light)]))


def _mesh(mesh: Mesh) -> bytes:
    counts = np.array([len(mesh.vertices), len(mesh.triangles)], np.uint64)
    arrays = (counts, mesh.vertices, mesh.triangles, mesh.leaf_of_triangle)
    return b"".join(array.tobytes() for array in arrays)


def load(folder: Path) -> Outcome | None:
    """What is kept there of the present code."""
    record = _record(folder)
    kept = json.loads(record.read_text()) if record.exists() else None
    if not kept or kept["session"]["code_version"] != code_version():
        return None
    repeats: dict[str, list[dict]] = {}
    for row in sorted(kept["benchmarks"], key=lambda row: row["family_index"]):
        if row["run_type"] == "iteration":
            repeats.setdefault(row["run_name"], []).append(row)
    refused = {
        name: rows[0]["error_message"]
        for name, rows in repeats.items()
        if "error_message" in rows[0]
    }
    measured = [_measured(name, rows) for name, rows in repeats.items() if name not in refused]
    return Outcome(measured, refused, kept["session"]["machine"])


def _measured(name: str, rows: list[dict]) -> Measured:
    (counter,) = (key for key in rows[0] if key.startswith(PER))
    seconds = estimate([row[counter] for row in rows])
    return Measured(
        tuple(name.split("/")), counter.removeprefix(PER), seconds, rows[0].get("primitives")
    )


# --- Tables -------------------------------------------------------------------------------------


def nanoseconds(seconds: float) -> str:
    return number(1e9 * seconds)


def kernels_table(measured: Iterable[Measured]) -> Table:
    rows, mixes = _crosswise(m for m in measured if m.name[0] == "kernel")
    headings = {"hit": "hits", "miss": "misses its ball", "graze": "grazes"}
    columns = [Column("kernel", "kernel", align="l"), Column("precision", "precision", align="l")]
    columns += [Column(f"{mix}_s", f"{headings[mix]}, ns", nanoseconds) for mix in mixes]
    notes = [
        "One call for one line, with the test of the primitive's ball and the change of frame. A "
        "line grazes if it passes the surface within a millionth of the size; half of those miss."
    ]
    return Table("micro_kernels", "Kernels", columns, rows, notes, keys=2)


def structures_table(measured: Iterable[Measured]) -> Table:
    rows = [
        [*m.name[1:], m.item_s, m.per, m.item_s.map(lambda s: 1 / s) if m.per == "byte" else None]
        for m in measured
        if m.name[0] == "structure"
    ]
    columns = [
        Column("part", "part", align="l"),
        Column("model", "model", align="l"),
        Column("item_s", "ns", nanoseconds),
        Column("per", "for one", align="l"),
        Column("bytes_per_s", "MB/s", megabytes),
    ]
    notes = [
        "Of an octree with d=6 and h=7. A search is of one cell on a primary ray, kernels "
        "included; a toggle has its share of putting the tree back. Classes are those of an octant "
        "of a Partial cell, with respect to a leaf in that cell's tree."
    ]
    return Table("micro_structures", "Parts of the schemes", columns, rows, notes, keys=2)


_LEAST = (
    "least: what remains if it cost nothing to know which primitives a ray enters before its hit; "
    "their kernels alone, in double, and the normal of what is shaded."
)


def schemes_table(outcome: Outcome) -> Table:
    rows, cases = _crosswise(
        dataclasses.replace(m, name=(*m.name[:2], "/".join(m.name[2:])))
        for m in outcome.measured
        if m.name[0] == "scheme"
    )
    columns = [Column("scheme", "scheme", align="l")]
    for case in cases:
        model, rays = case.split("/")
        columns.append(Column(f"{model}_{rays}_s", f"{rays}, ns", nanoseconds, group=model))
    entered = ", ".join(
        f"{m.primitives:.1f} on {m.name[2]} ({m.name[3]})"
        for m in outcome.measured
        if m.primitives is not None
    )
    notes = [
        *([_LEAST + f" A ray enters {entered}."] if entered else []),
        "One ray, every scheme at its defaults but for the mesh, which has "
        f"{SEGMENTS} segments a circle: each 13th tile of the 512×512 picture, in the batches and "
        "the order of rendering.",
        *(f"{name}: {why}." for name, why in outcome.refused.items()),
    ]
    return Table("micro_schemes", "Schemes", columns, rows, notes)


def _crosswise(measured: Iterable[Measured]) -> tuple[list[list], list[str]]:
    """Rows by all but the family and the last part of the name, with a column for each of those."""
    rows: dict[tuple[str, ...], dict[str, Estimate]] = {}
    for m in measured:
        rows.setdefault(m.name[1:-1], {})[m.name[-1]] = m.item_s
    last = list(dict.fromkeys(key for cells in rows.values() for key in cells))
    return [[*about, *map(cells.get, last)] for about, cells in rows.items()], last


def csv_table(measured: Iterable[Measured]) -> Table:
    """A line a benchmark."""
    rows = [["/".join(m.name), m.per, m.item_s] for m in measured]
    return Table(NAME, "", [Column("name", ""), Column("per", ""), Column("item_s", "")], rows)


def write(outcome: Outcome, folder: Path) -> Path:
    """To `folder`/tables: each table, micro.md with all, and micro.csv, a line a benchmark."""
    target = folder / "tables"
    made = [
        kernels_table(outcome.measured), structures_table(outcome.measured), schemes_table(outcome)
    ]  # fmt: skip
    made = [table for table in made if table.rows]
    write_forms(made, target)
    machine = outcome.machine
    head = (
        "# Microbenchmarks\n\nCPU time, medians with their 95% intervals. Measured on "
        f"{machine['cores']} cores of {machine['cpu']}, load average {machine['load_average']:.1f} "
        "at the start.\n"
    )
    document = target / f"{NAME}.md"
    document.write_text("\n".join([head, *(table.markdown() for table in made)]))
    (target / f"{NAME}.csv").write_text(csv_table(outcome.measured).csv())
    return document
