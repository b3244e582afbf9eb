"""Our pictures against POV-Ray's: render both, compare, and keep the verdict in the store."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

import tracers
from harness import models
from harness.compare import compare, difference_picture
from harness.povray import render_reference
from harness.store import Check, Store
from harness.worker import utc_now

SCHEME = "hybrid_sdsm"  # results.py sees to it that all exact schemes draw the same


def check(
    console: Console,
    store: Store,
    pictures: Sequence[tuple[str, int, int]],
    missing_only: bool = False,
) -> bool:
    """Whether every picture (model, width, height) passes; the verdicts go to the store, and
    pictures of the differences to `reference/` beside it.

    `missing_only`: a picture that has been compared keeps its verdict.
    """
    done = {
        (row["model_hash"], row["width"], row["height"], row["picture_hash"]): bool(row["passed"])
        for row in store.checks()
    }
    passed = []
    for model, width, height in pictures:
        ours = tracers.make(SCHEME, models.tree(model)).render(
            models.scene(model).view(width, height)
        )
        known = done.get((models.content_hash(model), width, height, ours.hash))
        if known is None or not missing_only:
            drawing = store.path.parent / "reference" / f"{model}_{width}x{height}.png"
            verdict = _compare(model, width, height, ours, drawing)
            store.add_check(verdict)
            _print(console, verdict)
            known = verdict.passed
        passed.append(known)
    return all(passed)


def _compare(model: str, width: int, height: int, ours: tracers.Picture, drawing: Path) -> Check:
    tree, scene = models.tree(model), models.scene(model)
    theirs = render_reference(tree, scene, models.CACHE, width, height)
    comparison = compare(ours, theirs)
    difference_picture(drawing, ours, theirs, comparison)
    return Check(
        model, models.content_hash(model), width, height, ours.hash, "POV-Ray",
        comparison.passed, "; ".join(comparison.reasons), comparison.figures, utc_now(),
    )  # fmt: skip


def _print(console: Console, verdict: Check) -> None:
    shown = {name: verdict.figures[name] for name in ("depth_max", "normal_deg_max", "rgb_max")}
    figures = ", ".join(f"{name} {value:.2g}" for name, value in shown.items())
    line = f"{verdict.model} {verdict.width}×{verdict.height} against {verdict.reference}"
    if verdict.passed:
        console.print(f"{line}: same picture; {figures}", markup=False)
    else:
        console.print(f"{line}: {verdict.reason}", style="red", markup=False)
