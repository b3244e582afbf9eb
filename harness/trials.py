"""A trial: build one scheme on one model, trace one picture, and say what it took.

Runs in the worker process. Models and meshes are kept between trials; what is timed never is.
"""

from __future__ import annotations

import json

import numpy as np

from harness import UserError, models
from harness.machine import code_version
from harness.schemes import PEERS, precision
from harness.store import Outcome, Trial
from harness.study import Configuration


def first(configuration: Configuration) -> Trial:
    """The key of a configuration's repeat 0."""
    c = configuration
    return Trial(
        c.model, models.content_hash(c.model), c.shape,
        c.scheme, c.params, precision(json.loads(c.params)),
        c.width, c.height, c.threads, repeat=0, attempt=0, code_version=code_version(),
    )  # fmt: skip


def run(trial: Trial) -> Outcome:
    """Measure. Counters come from a second, untimed render, so that counting slows nothing."""
    try:
        tree = models.tree(trial.model, trial.shape)
        if trial.scheme in PEERS:
            return _run_povray(trial, tree)
        tracer, mesh = models.build(trial.scheme, tree, json.loads(trial.params))
    except ValueError as error:  # tracers.ModelError is one
        return Outcome("unsupported", str(error))
    except UserError as error:
        return Outcome("error", str(error))
    view = models.scene(trial.model).view(trial.width, trial.height)
    picture = tracer.render(view, threads=trial.threads)
    counted = tracer.render(view, count=True) if trial.repeat == 0 else None
    return Outcome(
        "ok",
        build_s=tracer.build_s,
        trace_s=picture.trace_s,
        mesh_s=mesh and mesh.mesh_s,
        structure_bytes=tracer.bytes,
        rays=picture.rays,
        picture_hash=picture.hash,
        counters=counted and dict(counted.counters),
        facts=dict(tracer.facts),
    )


def _run_povray(trial: Trial, tree) -> Outcome:
    from harness import povray_timing  # here, for with it comes what trials of schemes do not need

    timing = povray_timing.timed(
        tree, models.scene(trial.model), trial.width, trial.height,
        json.loads(trial.params)["bounds"], trial.threads,
    )  # fmt: skip
    return Outcome(
        "ok", build_s=timing.parse_s, trace_s=timing.trace_s, counters=timing.counters, facts={}
    )


def cost_picture(configuration: Configuration) -> np.ndarray:
    """(H, W) float64: primitives tested for each pixel, by all its rays, at half the size."""
    c = configuration
    tracer, _ = models.build(c.scheme, models.tree(c.model, c.shape), json.loads(c.params))
    return tracer.render(models.scene(c.model).view(c.width // 2, c.height // 2), cost=True).cost
