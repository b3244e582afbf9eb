"""The models of models/scenes.toml as tracers see them, and generated ones: `ball@1000` is a model
of the family ball with 1000 halfspaces. Trees and meshes are kept in memory."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import tracers
from generators import MODELS, synthesize
from harness import RESULTS, UserError
from harness.mesh import Mesh, tessellate
from harness.openscad import to_csg, version
from harness.scenes import Scene, frame, load_scenes
from harness.schemes import Params, catalogue

CACHE = RESULTS / "cache"


@cache
def scene(model: str) -> Scene:
    if "@" in model:
        return frame(tree(model), csg(model))
    scenes = load_scenes()
    if model not in scenes:
        raise UserError(f"no scene '{model}' in models/scenes.toml; known: {', '.join(scenes)}")
    return scenes[model]


def csg(model: str) -> Path:
    """The .csg that OpenSCAD makes of it."""
    return generated(model) if "@" in model else to_csg(scene(model).model, CACHE)


def generated(model: str) -> Path:
    """Made anew only when a source of models/, or OpenSCAD, has changed."""
    family, _, halfspaces = model.partition("@")
    if not halfspaces.isdecimal():
        raise UserError(f"'{model}' is not of the form family@halfspaces, such as ball@1000")
    sources = b"".join(file.read_bytes() for file in sorted(MODELS.glob("*.scad")))
    of = hashlib.sha256(sources + version().encode()).hexdigest()[:16]
    path = CACHE / f"{family}-{halfspaces}-{of}.csg"
    if not path.exists():
        CACHE.mkdir(parents=True, exist_ok=True)
        synthesize(family, int(halfspaces), 1, path)
    return path


@cache
def tree(model: str, shape: str = "as_written") -> tracers.CsgTree:
    return tracers.load_csg(str(csg(model)), shape)


@cache
def content_hash(model: str) -> str:
    """Changes with the solid, the camera and the lights; not with comments or file names."""
    solid = csg(model).read_bytes()
    return hashlib.sha256(solid + repr(scene(model)).encode()).hexdigest()[:16]


def from_file(path: Path) -> tuple[tracers.CsgTree, Scene]:
    """Any .scad or .csg, with a camera that sees all of it."""
    if path.suffix not in (".scad", ".csg"):
        names = ", ".join(load_scenes())
        raise UserError(f"no scene '{path}'; known: {names}, or the path of a .scad or .csg file")
    if not path.is_file():
        raise UserError(f"{path}: {'a folder, not a file' if path.is_dir() else 'no such file'}")
    csg = to_csg(path, CACHE)
    # Places in messages are those in what OpenSCAD made of the file, which the user has never seen.
    name = str(path) if csg == path else f"{path} (as evaluated by OpenSCAD)"
    loaded = tracers.load_csg(str(csg), name=name)
    return loaded, frame(loaded, path)


def build(scheme: str, of: tracers.CsgTree, params: Params) -> tuple[tracers.Tracer, Mesh | None]:
    """A scheme's structure, and the mesh if it traces one.

    ValueError if the scheme does not support the model, UserError if the structure is too large.
    """
    mesh = _mesh(of, params["segments"]) if catalogue()[scheme].needs_mesh else None
    arrays = mesh and (mesh.vertices, mesh.triangles, mesh.leaf_of_triangle)
    try:
        return tracers.make(scheme, of, params, arrays), mesh
    except RuntimeError as error:
        raise UserError(f"{scheme}: {error}") from None


@cache
def _mesh(of: tracers.CsgTree, segments: int) -> Mesh:
    return tessellate(of, segments)


def characteristics(models: Iterable[str]) -> dict[str, dict]:
    """What Figure 7 says of a model, counted in its tree."""
    trees = {model: tree(model) for model in models}
    return {
        model: {"halfspaces": t.halfspaces, "nodes": t.nodes, "kinds": t.kinds}
        for model, t in trees.items()
    }
