"""What each setting of the study errs, against the exact scheme in double: depths and masks."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable
from functools import cache

import numpy as np
from rich.console import Console

from harness import models
from harness.machine import code_version
from harness.povray import render_reference
from harness.schemes import PEERS, is_exact, precision
from harness.store import Errors, Store
from harness.study import Configuration, Study
from harness.worker import utc_now

Key = tuple[str, str, str]  # model, scheme, params: threads change no bit


def measure_missing(console: Console, study: Study, store: Store) -> None:
    """Of what is not naive's to the bit, and has no figures for this code yet."""
    known = load(study, store, code_version())
    for c in study.configurations:
        if _is_naives(c) or _key(c) in known:
            continue
        known[_key(c)] = {}
        console.print(f"errors: {c.label()}", highlight=False)
        figures = _figures(c, _exact(study, c.model))
        store.add_errors(
            Errors(
                study.name, c.model, models.content_hash(c.model), c.shape, c.scheme, c.params,
                c.width, c.height, code_version(), figures, utc_now(),
            )
        )  # fmt: skip


def load(study: Study, store: Store, code: str | None) -> dict[Key, dict[str, float]]:
    """The figures of a version of the code: see `_figures`."""
    return {
        (row["model"], row["scheme"], row["params"]): row["figures"]
        for row in store.errors(study.name)
        if row["code_version"] == code and row["model_hash"] == models.content_hash(row["model"])
    }


def _key(c: Configuration) -> Key:
    return c.model, c.scheme, c.params


def _is_naives(c: Configuration) -> bool:
    params = json.loads(c.params)
    return is_exact(c.scheme, params) and precision(params) == "float64"


def _exact(study: Study, model: str) -> Configuration:
    """Any will do, and brute force takes longest."""
    of_model: Iterable[Configuration] = (c for c in study.configurations if c.model == model)
    exact = [c for c in of_model if _is_naives(c)]
    return min(exact, key=lambda c: c.scheme == "naive")


def _figures(c: Configuration, exact: Configuration) -> dict[str, float]:
    """depth_p999: over pixels that both hit, relative to the model's size. flips: hits where there
    are none, or the reverse, of all pixels."""
    ours = _depth(c)
    true = _exact_depth(dataclasses.replace(exact, width=c.width, height=c.height))
    both = np.isfinite(ours) & np.isfinite(true)
    off = np.abs(ours[both] - true[both]) / models.tree(c.model, c.shape).size
    return {
        "depth_p999": float(np.quantile(off, 0.999, method="higher")) if len(off) else 0.0,
        "flips": float(np.mean(np.isfinite(ours) != np.isfinite(true))),
    }


@cache
def _exact_depth(c: Configuration) -> np.ndarray:
    """Once a model, for all that is held against it."""
    return _depth(c)


def _depth(c: Configuration) -> np.ndarray:
    """(H, W), inf where nothing is hit."""
    tree, scene = models.tree(c.model, c.shape), models.scene(c.model)
    if c.scheme in PEERS:
        return render_reference(tree, scene, models.CACHE, c.width, c.height).depth
    tracer, _ = models.build(c.scheme, tree, json.loads(c.params))
    return tracer.render(scene.view(c.width, c.height)).depth
