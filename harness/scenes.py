"""Scenes: a model, the camera and the lights. Those of our models stand in models/scenes.toml.

Lengths are model units, colours linear RGB, angles degrees.
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import tracers
from harness import ROOT, UserError

SCENES = ROOT / "models" / "scenes.toml"

Triple = tuple[float, float, float]
Light = tuple[float, float, float, float, float, float]  # position x y z, colour r g b


@dataclass(frozen=True)
class Scene:
    """Its `repr` says what is seen, and not which file it came from."""

    name: str = field(repr=False)
    model: Path = field(repr=False)  # a .scad or .csg
    halfspaces: int  # what the loader must find in it
    nodes: int
    kinds: tuple[str, ...]  # in use, sorted
    eye: Triple
    look_at: Triple
    up: Triple
    fov_deg: float  # from bottom to top
    lights: tuple[Light, ...]
    ambient: Triple
    background: Triple
    albedo: Triple  # of what has no colour in the model
    width: int  # pixels
    height: int

    def view(self, width: int | None = None, height: int | None = None) -> tracers.View:
        """What a tracer renders, at the scene's own size or another, in pixels."""
        return tracers.View(
            self.eye, self.look_at, self.up, self.fov_deg,
            width or self.width, height or self.height,
            list(self.lights), self.ambient, self.background, self.albedo,
        )  # fmt: skip


def load_scenes(path: Path = SCENES) -> dict[str, Scene]:
    """All scenes of the file, by name. A key that is missing, unknown or malformed is an error."""
    try:
        tables = tomllib.loads(path.read_text())
    except tomllib.TOMLDecodeError as error:
        raise UserError(f"{path}: {error}") from None
    return {name: _scene(path, name, table) for name, table in tables.items()}


def frame(tree: tracers.CsgTree, model: Path = Path()) -> Scene:
    """A scene for any model: all of it, from the front, the right and above, in 512×512."""
    low, high = np.asarray(tree.bounds)
    if not (np.all(np.isfinite([low, high])) and np.all(low <= high) and np.any(low < high)):
        raise UserError(f"{model}: the solid is empty or has no size: there is nothing to see")
    centre, radius = (low + high) / 2, np.linalg.norm(high - low) / 2
    fov_deg = 25.0

    back = np.array([1.0, -2.0, 1.4]) / np.linalg.norm([1.0, -2.0, 1.4])
    right = np.array([2.0, 1.0, 0.0]) / math.sqrt(5)
    above = np.cross(back, right)
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, 8).T - centre
    aside = np.maximum(np.abs(corners @ right), np.abs(corners @ above))
    distance = np.max(aside / math.tan(math.radians(fov_deg / 2)) + corners @ back)

    key = centre + radius * np.array([-2.0, -4.0, 5.0])
    fill = centre + radius * np.array([5.0, -3.0, 2.0])
    return Scene(
        name=model.stem,
        model=model,
        halfspaces=tree.halfspaces,
        nodes=tree.nodes,
        kinds=tuple(sorted(set(tree.kinds))),
        eye=tuple((centre + 1.05 * distance * back).tolist()),
        look_at=tuple(centre.tolist()),
        up=(0.0, 0.0, 1.0),
        fov_deg=fov_deg,
        lights=((*key.tolist(), 0.65, 0.62, 0.58), (*fill.tolist(), 0.30, 0.33, 0.38)),
        ambient=(0.15, 0.15, 0.17),
        background=(0.93, 0.94, 0.96),
        albedo=(0.8, 0.8, 0.8),
        width=512,
        height=512,
    )


# --- Reading the file, strictly -----------------------------------------------------------------

_TRIPLE = (float, float, float)
_FORM = {
    "file": str,
    "halfspaces": int,
    "nodes": int,
    "kinds": [str],
    "camera": {"eye": _TRIPLE, "look_at": _TRIPLE, "up": _TRIPLE, "fov_deg": float},
    "lights": [{"position": _TRIPLE, "color": _TRIPLE}],
    "ambient": _TRIPLE,
    "background": _TRIPLE,
    "albedo": _TRIPLE,
    "size": (int, int),
}


def _scene(path: Path, name: str, table: Any) -> Scene:
    read = _read(f"{path}: {name}", table, _FORM)
    camera, (width, height) = read.pop("camera"), read.pop("size")
    return Scene(
        name=name,
        model=path.parent / read.pop("file"),
        kinds=tuple(sorted(read.pop("kinds"))),
        lights=tuple((*light["position"], *light["color"]) for light in read.pop("lights")),
        width=width,
        height=height,
        **camera,
        **read,
    )


def _read(where: str, value: Any, form: Any) -> Any:
    """The value, if it has the form: a table of just these keys, a list, a tuple, or a scalar."""
    if isinstance(form, dict) and isinstance(value, dict):
        for key in [*form, *value]:
            if key not in value:
                raise UserError(f"{where}.{key} is missing")
            if key not in form:
                raise UserError(f"{where}.{key} is unknown; known: {', '.join(form)}")
        return {key: _read(f"{where}.{key}", value[key], form[key]) for key in form}
    if isinstance(form, list) and isinstance(value, list):
        return [_read(f"{where}[{i}]", item, form[0]) for i, item in enumerate(value)]
    if isinstance(form, tuple) and isinstance(value, list) and len(value) == len(form):
        return tuple(_read(f"{where}[{i}]", value[i], form[i]) for i in range(len(form)))
    if form is float and type(value) in (int, float) and math.isfinite(value):
        return float(value)
    if form in (int, str) and type(value) is form:
        return value
    raise UserError(f"{where}: {value!r} should be {_describe(form)}")


def _describe(form: Any) -> str:
    if isinstance(form, tuple):
        return f"{len(form)} numbers"
    if isinstance(form, type):
        return {int: "a whole number", float: "a number", str: "text"}[form]
    return "a list" if isinstance(form, list) else "a table"
