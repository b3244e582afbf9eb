"""`csgbench trace`: one picture of one model by one scheme, and what it took."""

from __future__ import annotations

import os
import re
from pathlib import Path

from rich.console import Console
from rich.table import Table

import tracers
from harness import UserError, models
from harness.images import write_picture
from harness.scenes import Scene, load_scenes
from harness.schemes import is_exact, parse_settings
from harness.table import NOTHING, integer, megabytes, milliseconds, number

MAX_PIXELS = 1 << 26


def trace(
    out: Console,
    err: Console,
    model: str,
    scheme: str,
    settings: list[str],
    size: str,
    output: Path | None,
    threads: int = 1,
) -> None:
    """Trace by so many threads, 0: one a core; write `output` if it is asked for, and print times,
    memory and counters; what should be known of the model goes to `err`."""
    params = parse_settings(scheme, settings)
    width, height = parse_size(size)
    if output and output.suffix.lower() not in (".png", ".exr"):
        raise UserError(f"{output}: a picture is written as .png or .exr")

    tree, scene = load(err, model)
    try:
        tracer, mesh = models.build(scheme, tree, params)
    except ValueError as error:
        raise UserError(str(error)) from None
    view = scene.view(width, height)
    threads = threads or os.cpu_count()
    picture = tracer.render(view, threads=threads)
    counted = tracer.render(view, count=True, cost=True, threads=threads)
    if undivided := tracer.facts.get("cells_over_budget"):
        _warn(err, f"the memory budget was spent, {integer(undivided)} cells stay undivided")
    if output:
        write_picture(output, counted)
    if (picture.leaf < 0).all():
        _warn(err, f"{model}: no ray hits anything: the solid is empty, or smaller than a pixel")

    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_row("model", f"{model}: {tree.halfspaces:,} halfspaces, {tree.nodes:,} nodes")
    shown = " ".join(f"{name}={value}" for name, value in params.items())
    exact = "" if is_exact(scheme, params) else " (inexact)"
    table.add_row("scheme", f"{scheme} {shown}{exact}")
    if mesh:
        table.add_row("mesh", f"{len(mesh.triangles):,} triangles in {number(mesh.mesh_s)} s")
    table.add_row("build", f"{milliseconds(tracer.build_s)} ms, {megabytes(tracer.bytes)} MB")
    speed = 1e9 * picture.trace_s / picture.rays
    on = "1 thread" if threads == 1 else f"{threads} threads"
    table.add_row("trace", f"{milliseconds(picture.trace_s)} ms, {number(speed)} ns a ray, {on}")
    table.add_row("rays", f"{picture.rays:,}, {width}×{height} primary and the rest shadow rays")
    for name, count in counted.counters.items():
        per_ray = f"{number(count / picture.rays)} a ray" if count else NOTHING
        table.add_row(name.replace("_", " "), f"{integer(count)}, {per_ray}")
    for name, value in tracer.facts.items():
        shown = integer(value) if value.is_integer() else number(value)
        table.add_row(name.replace("_", " "), shown)
    table.add_row("picture", f"{picture.hash}{f', written to {output}' if output else ''}")
    out.print(table)


def load(err: Console, model: str) -> tuple[tracers.CsgTree, Scene]:
    """A scene or a generated model by its name, or any .scad or .csg; the loader's warnings are
    passed on."""
    if model in load_scenes() or "@" in model:
        tree, scene = models.tree(model), models.scene(model)
    else:
        tree, scene = models.from_file(Path(model))
    for warning in tree.warnings:
        _warn(err, warning)
    return tree, scene


def _warn(err: Console, text: str) -> None:
    err.print(f"warning: {text}", style="yellow", markup=False)


def parse_size(text: str) -> tuple[int, int]:
    """`512x512` to width and height."""
    match = re.fullmatch(r"0*([1-9][0-9]*)[x×]0*([1-9][0-9]*)", text)
    if not match:
        raise UserError(f"size '{text}' is not of the form 512x512")
    if max(map(len, match.groups())) > 9 or int(match[1]) * int(match[2]) > MAX_PIXELS:
        raise UserError(f"size '{text}' has more than {MAX_PIXELS:,} pixels")
    return int(match[1]), int(match[2])
