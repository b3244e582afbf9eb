"""A trial: build one scheme on one model, trace one picture, and say what it took.

Runs in the worker process. Models and meshes are kept between trials; what is timed never is.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from functools import cache

import numpy as np

import tracers
from harness import RESULTS, UserError
from harness.machine import code_version
from harness.mesh import Mesh, tessellate
from harness.openscad import to_csg
from harness.scenes import Scene, load_scenes
from harness.schemes import catalogue
from harness.store import Outcome, Trial
from harness.study import Configuration

PRECISION = "float64"
MESH_SEGMENTS = 64  # around a full circle, for the schemes that trace a mesh
CACHE = RESULTS / "cache"


@cache
def scene(model: str) -> Scene:
    scenes = load_scenes()
    if model not in scenes:
        raise UserError(f"no model '{model}' in models/scenes.toml; known: {', '.join(scenes)}")
    return scenes[model]


@cache
def load_model(model: str, shape: str) -> tracers.CsgTree:
    return tracers.load_csg(str(to_csg(scene(model).model, CACHE)), shape)


@cache
def _mesh(model: str, shape: str) -> Mesh:
    return tessellate(load_model(model, shape), MESH_SEGMENTS)


@cache
def model_hash(model: str) -> str:
    """Changes with the solid, the camera and the lights; not with comments or file names."""
    solid = to_csg(scene(model).model, CACHE).read_bytes()
    return hashlib.sha256(solid + repr(scene(model)).encode()).hexdigest()[:16]


def first(configuration: Configuration) -> Trial:
    """The key of a configuration's repeat 0."""
    model, c = configuration.model, configuration
    return Trial(
        model, model_hash(model), c.shape, c.scheme, c.params, PRECISION, c.width, c.height,
        repeat=0, attempt=0, code_version=code_version(),
    )  # fmt: skip


def run(trial: Trial) -> Outcome:
    """Measure. Counters come from a second, untimed render, so that counting slows nothing."""
    try:
        tree = load_model(trial.model, trial.shape)
    except tracers.ModelError as error:
        return Outcome("unsupported", str(error))
    mesh = _mesh(trial.model, trial.shape) if catalogue()[trial.scheme].needs_mesh else None
    arrays = mesh and (mesh.vertices, mesh.triangles, mesh.leaf_of_triangle)
    try:
        tracer = tracers.make(trial.scheme, tree, json.loads(trial.params), arrays)
    except ValueError as error:
        return Outcome("unsupported", str(error))

    view = scene(trial.model).view(trial.width, trial.height)
    picture = tracer.render(view)
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


def cost_picture(configuration: Configuration) -> np.ndarray:
    """(H, W) float64: primitives tested for each pixel, by all its rays."""
    c = configuration
    tracer = tracers.make(c.scheme, load_model(c.model, c.shape), json.loads(c.params))
    return tracer.render(scene(c.model).view(c.width, c.height), cost=True).cost


def describe(models: Iterable[str]) -> dict[str, dict]:
    """What Figure 7 says of a model, counted in its tree."""
    trees = {model: load_model(model, "as_written") for model in models}
    return {
        model: {"halfspaces": tree.halfspaces, "nodes": tree.nodes, "kinds": tree.kinds}
        for model, tree in trees.items()
    }
