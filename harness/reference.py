"""Our pictures against POV-Ray's: render both, compare, and keep the verdict in the store."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console

from harness import models
from harness.compare import compare
from harness.povray import render_reference
from harness.schemes import catalogue, complete
from harness.store import Check, Store
from harness.worker import utc_now

SCHEME = "hybrid_sdsm"  # all exact schemes give the same picture; results.py sees to that
Picture = tuple[str, int, int]  # model, width, height


def check(
    console: Console, store: Store, pictures: Sequence[Picture], missing_only: bool = False
) -> bool:
    """Whether all pictures pass. `missing_only`: a picture that has a verdict keeps it."""
    verdicts = {}
    for row in store.checks():
        verdicts[row["model_hash"], row["width"], row["height"], row["picture_hash"]] = row
    passed = True
    for model, width, height in pictures:
        picture = _trace(model, width, height)
        verdict = verdicts.get((models.content_hash(model), width, height, picture.hash))
        if not (missing_only and verdict):
            ...
    return passed
