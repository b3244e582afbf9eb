"""Reference pictures by POV-Ray 3.7: independent code, the same tree, camera, lights and shading.

Every leaf becomes POV-Ray's own primitive under a matrix, never a mesh. Three renders give a Reference:

- final    linear 16-bit colour;
- depth    distance from the eye, and where there is one, as a number of three 16-bit digits;
- normal   n.x, n.y and n.z in three channels, by the `slope` pattern.

POV-Ray's tolerances are absolute (1e-3 for shadows, 1e-7 to 1e-4 for hits, 1e7 is far), so the model is
centred and scaled by a power of two to an extent of about 10. It is a tolerant reference, not the truth.
"""

from __future__ import annotations

import hashlib
import math
import re
import subprocess
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from harness import images
from harness.nary import DIFFERENCE, INTERSECTION, LEAF, UNION, operands

_EXTENT = 10.0  # of the scaled model
_REACH_MAX = 1e5  # scaled distance from the eye to the model's far end
_NESTING_MAX = 5000  # POV-Ray recurses: 10,000 nested operators pass, 40,000 crash it
_CODES = 65535  # highest code of a 16-bit channel
_COMMAND = ("povray", "+FN16", "File_Gamma=1.0", "-D", "-A", "Dither=off")


class PovrayError(RuntimeError):
    """A reference that POV-Ray cannot give; one line, with POV-Ray's own message."""


@dataclass(frozen=True)
class Reference:
    """What POV-Ray sees, in the terms of a `tracers.Picture`."""

    rgb: np.ndarray  # (H, W, 3) linear
    depth: np.ndarray  # (H, W) float64, model units from the eye along the ray; inf where it misses
    normal: np.ndarray  # (H, W, 3) unit, out of the solid; 0 where it misses
    mask: np.ndarray  # (H, W) bool: the ray hits


def render_reference(tree, scene, out_dir: str | Path, width: int, height: int) -> Reference:
    """Renders a `tracers.CsgTree` as seen in a `harness.scenes.Scene`, or finds it in the cache.

    The cache is `out_dir/<key>.exr`. The key is a hash of the three POV-Ray scenes, POV-Ray's version
    and this file: whatever could change the pictures changes the key.
    """
    shot = _Shot(tree, scene, width, height)
    texts = {"final": _final(shot), "depth": _depth(shot), "normal": _normal(shot)}
    path = Path(out_dir) / f"{_key(texts)}.exr"
    if not path.exists():
        codes = {name: _render(name, text, width, height) for name, text in texts.items()}
        _store(path, _decode(shot, **codes))
    return _load(path)


# --- The model in POV-Ray's units ---------------------------------------------------------------------


class _Shot:
    """One model seen by one camera, scaled to POV-Ray's liking: p ↦ (p - centre)·scale."""

    def __init__(self, tree, scene, width: int, height: int) -> None:
        low, high = np.asarray(tree.bounds, float)
        self.tree, self.scene = tree, scene
        self.aspect = width / height
        self.centre = (low + high) / 2
        self.scale = 2.0 ** round(math.log2(_EXTENT / (high - low).max()))
        self.eye = self.scaled(scene.eye)
        self.eye_is_inside = contains(tree, scene.eye)
        self.reach = math.dist(self.eye, (0, 0, 0)) + math.dist(low, high) * self.scale
        if self.reach > _REACH_MAX:
            raise PovrayError(
                f"the eye stands {self.reach / _EXTENT:.2g} model sizes away; POV-Ray's absolute "
                f"tolerances serve up to {_REACH_MAX / _EXTENT:.0f}"
            )
        # A PNG holds nothing above 1: light is divided by the gain, and the picture multiplied.
        albedo = max(np.nanmax(tree.colors, initial=0.0), *scene.albedo)
        light = np.sum([light[3:] for light in scene.lights], axis=0) + np.asarray(scene.ambient)
        self.gain = max(1.0, albedo * np.max(light), *scene.background)

    def scaled(self, point) -> np.ndarray:
        return (np.asarray(point, float) - self.centre) * self.scale


def contains(tree, point) -> bool:
    """Whether a point, in model units, lies in the solid."""
    linear, offset = tree.matrices[:, :, :3], tree.matrices[:, :, 3]
    local = np.linalg.solve(linear, (np.asarray(point, float) - offset)[:, :, None])[:, :, 0]
    radius, z = np.hypot(local[:, 0], local[:, 1]), local[:, 2]
    a, b, c = np.asarray(tree.sizes).T
    in_kind = {
        "sphere": np.hypot(radius, z) < a,
        "block": (np.abs(local) < tree.sizes).all(axis=1),
        "cylinder": (radius < a) & (np.abs(z) < b),
        "cone": (2 * c * radius < a * (c - z) + b * (c + z)) & (np.abs(z) < c),
        "torus": np.hypot(radius - a, z) < b,
    }
    inside: list[bool] = []
    for op, left, right in tree.operators.tolist():
        if op == LEAF:
            inside.append(bool(in_kind[tree.kinds[left]][left]))
        elif op == UNION:
            inside.append(inside[left] or inside[right])
        elif op == INTERSECTION:
            inside.append(inside[left] and inside[right])
        else:
            inside.append(inside[left] and not inside[right])
    return inside[-1]


def _solid(shot: _Shot, pigments: list[str]) -> str:
    """The tree in POV-Ray's language; pigments: one a leaf, or '' for that of the whole.

    A union is POV-Ray's `union`, which keeps the surfaces that its parts have inside each other: from
    outside the solid they are never the first, and what they shade is inside. `merge` drops them and
    is far slower; it is used only where the eye is inside the solid and would see them.

    Every operator is bounded by its box: POV-Ray has a hierarchy for the scene's objects, and none
    inside an object (ngkcut: 6 times faster, the same pixels).
    """
    words = {
        UNION: "merge" if shot.eye_is_inside else "union",
        INTERSECTION: "intersection",
        DIFFERENCE: "difference",
    }
    operators = shot.tree.operators.tolist()
    leaves, boxes = _leaves(shot, pigments), _boxes(shot)
    lines: list[str] = []
    nesting = 0
    pending: list[int | str] = [len(operators) - 1]  # nodes to write, and texts that close them
    while pending:
        item = pending.pop()
        if isinstance(item, str):
            lines.append(item)
            nesting -= 1
        elif operators[item][0] == LEAF:
            lines.append(leaves[operators[item][1]])
        else:
            nesting += 1
            if nesting > _NESTING_MAX:
                raise PovrayError(f"POV-Ray cannot parse operators nested {_NESTING_MAX} deep")
            low, high = boxes[item]
            lines.append(f"{words[operators[item][0]]} {{")
            pending.append(f"bounded_by {{ box {{ {_vector(low)}, {_vector(high)} }} }} }}")
            pending += reversed(operands(operators, item))
    return "\n".join(lines)


def _boxes(shot: _Shot) -> list[np.ndarray]:
    """For every node, the (2, 3) low and high corner of a box around its solid, with some room."""
    tree = shot.tree
    half = np.array([_half_extents(*leaf) for leaf in zip(tree.kinds, tree.sizes.tolist())])
    reach = np.einsum("nij,nj->ni", np.abs(tree.matrices[:, :, :3]), half) * shot.scale + 1e-3
    centre = shot.scaled(tree.matrices[:, :, 3])
    of_leaf = np.stack([centre - reach, centre + reach], axis=1)
    boxes: list[np.ndarray] = []
    for op, left, right in tree.operators.tolist():
        if op == LEAF:
            boxes.append(of_leaf[left])
        elif op == DIFFERENCE:
            boxes.append(boxes[left])
        else:
            pair = np.array([boxes[left], boxes[right]])
            low, high = pair.min(axis=0), pair.max(axis=0)
            boxes.append(np.array([low[0], high[1]] if op == UNION else [high[0], low[1]]))
    return boxes


def _half_extents(kind: str, size: list[float]) -> tuple[float, float, float]:
    """Of a leaf in its own space."""
    a, b, c = size
    return {
        "sphere": (a, a, a),
        "block": (a, b, c),
        "cylinder": (a, a, b),
        "cone": (max(a, b), max(a, b), c),
        "torus": (a + b, a + b, b),
    }[kind]


def _leaves(shot: _Shot, pigments: list[str]) -> list[str]:
    """Each leaf as a POV-Ray primitive. What its matrix scales evenly goes into its size, because
    POV-Ray's tolerances act in the primitive's own space."""
    tree = shot.tree
    linear = np.array(tree.matrices[:, :, :3], float)
    stretch = np.cbrt(np.abs(np.linalg.det(linear)))
    linear /= stretch[:, None, None]
    sizes = np.asarray(tree.sizes) * (stretch * shot.scale)[:, None]
    offsets = shot.scaled(tree.matrices[:, :, 3])
    lines = []
    for kind, size, columns, offset, pigment in zip(
        tree.kinds, sizes.tolist(), linear.swapaxes(1, 2), offsets, pigments
    ):
        a, b, c = size
        if kind == "sphere":
            shape = f"sphere {{ 0, {a}"
        elif kind == "block":
            shape = f"box {{ <{-a}, {-b}, {-c}>, <{a}, {b}, {c}>"
        elif kind == "cylinder":
            shape = f"cylinder {{ <0, 0, {-b}>, <0, 0, {b}>, {a}"
        elif kind == "cone":
            shape = f"cone {{ <0, 0, {-c}>, {a}, <0, 0, {c}>, {b}"
        else:
            shape = f"torus {{ {a}, {b}"
            columns = columns[[0, 2, 1]]  # POV-Ray's torus turns around y
        lines.append(f"{shape} matrix {_vector([*columns.ravel(), *offset])} {pigment} }}")
    return lines


# --- The three scenes ---------------------------------------------------------------------------------


def _final(shot: _Shot) -> str:
    """Matte: pigment · (ambient + Σ light · max(0, n·l)), no falloff, with shadows."""
    scene, gain = shot.scene, shot.gain
    colors = np.where(np.isnan(shot.tree.colors), scene.albedo, shot.tree.colors)
    lights = [
        f"light_source {{ {_vector(shot.scaled(light[:3]))}, rgb {_vector(light[3:], gain)} }}"
        for light in scene.lights
    ]
    return _scene(
        shot,
        finish=f"ambient rgb {_vector(scene.ambient, gain)} diffuse 1",
        background=_vector(scene.background, gain),
        solid=_solid(shot, [f"pigment {{ rgb {_vector(color)} }}" for color in colors]),
        lights="\n".join(lights),
    )


def _depth(shot: _Shot) -> str:
    """The distance in codes of the reach is Coarse; red is 1 + its integer part, so that 0 is a miss,
    green and blue are the rest in two more digits of base 65535: 48 bits in all."""
    ex, ey, ez = (f"({value!r})" for value in shot.eye.tolist())
    distance = f"sqrt(pow(x-{ex},2) + pow(y-{ey},2) + pow(z-{ez},2))"
    return _measurement(
        shot,
        f"#declare Coarse = function {{ {distance} * {(_CODES - 1) / shot.reach!r} }}\n"
        f"#declare Fine = function {{ (Coarse(x,y,z) - floor(Coarse(x,y,z))) * {_CODES} }}",
        f"function {{ (1 + floor(Coarse(x,y,z))) / {_CODES} }}",
        f"function {{ floor(Fine(x,y,z)) / {_CODES} }}",
        "function { Fine(x,y,z) - floor(Fine(x,y,z)) }",
    )


def _normal(shot: _Shot) -> str:
    """`slope` is linear in the angle between the normal, turned towards the eye, and an axis."""
    return _measurement(shot, "", "slope { x }", "slope { y }", "slope { z }")


def _measurement(shot: _Shot, declarations: str, *patterns: str) -> str:
    """A scene whose three emissive channels are three patterns, each 0..1."""
    channels = "\n".join(
        f"[1 {pattern} color_map {{ [0 rgb 0] [1 rgb <{red}, {green}, {blue}>] }}]"  # 3: an average
        for pattern, (red, green, blue) in zip(patterns, [(3, 0, 0), (0, 3, 0), (0, 0, 3)])
    )
    pigment = f"pigment {{ average pigment_map {{\n{channels} }} }}"
    solid = _solid(shot, [""] * len(shot.tree.kinds))
    return _scene(
        shot,
        finish="ambient 0 diffuse 0 emission 1",
        background="0",
        solid=f"{declarations}\nobject {{ {solid}\n{pigment} }}",
        lights="",
    )


def _scene(shot: _Shot, finish: str, background: str, solid: str, lights: str) -> str:
    """The camera's vectors are explicit, so POV-Ray's left-handedness never enters: a pixel at
    (x, y), each in -1/2..1/2, looks along direction + x·right + y·up."""
    scene = shot.scene
    forward = _unit(np.asarray(scene.look_at, float) - np.asarray(scene.eye, float))
    right = _unit(np.cross(forward, np.asarray(scene.up, float)))
    up = np.cross(right, forward)
    side = 2 * math.tan(math.radians(scene.fov_deg) / 2)
    return f"""#version 3.7;
global_settings {{ assumed_gamma 1.0 ambient_light rgb 1 }}
camera {{
  perspective
  location {_vector(shot.eye)}
  direction {_vector(forward)}
  right {_vector(right * side * shot.aspect)}
  up {_vector(up * side)}
}}
#default {{ finish {{ {finish} }} }}
background {{ rgb {background} }}
{lights}
{solid}
"""


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)


def _vector(values, divisor: float = 1.0) -> str:
    """POV-Ray's <a, b, …>, of any length, with every bit."""
    return f"<{', '.join(repr(float(value / divisor)) for value in values)}>"


# --- Running POV-Ray ----------------------------------------------------------------------------------


def _render(name: str, text: str, width: int, height: int) -> np.ndarray:
    """(H, W, 3) uint16 codes. POV-Ray may only touch its working folder, so it is given one."""
    with tempfile.TemporaryDirectory(prefix="povray-") as folder:
        (Path(folder) / "scene.pov").write_text(text)
        size = (f"+W{width}", f"+H{height}")
        run = _run([*_COMMAND, *size, "+Iscene.pov", "+Opicture.png"], folder)
        if run.returncode != 0:
            raise PovrayError(f"POV-Ray failed on the {name} picture: {_complaint(run)}")
        return images.read_codes(Path(folder) / "picture.png")


def _run(command: list[str], folder: str | None = None) -> subprocess.CompletedProcess[str]:
    try:
        return subprocess.run(command, cwd=folder, capture_output=True, text=True)
    except FileNotFoundError:
        raise PovrayError("povray is not installed") from None


def _complaint(run: subprocess.CompletedProcess[str]) -> str:
    """POV-Ray's own message, which it breaks over lines, as one line."""
    if run.returncode < 0:
        return f"killed by signal {-run.returncode}"
    found = re.search(r"^(?!.*Possible).*Error:.*(?:\n .*)*", run.stderr, re.MULTILINE)
    return " ".join(found[0].split()) if found else f"exit code {run.returncode}"


@cache
def _version() -> str:
    return next(line for line in _run(["povray", "--version"]).stderr.splitlines() if "POV-Ray" in line)


def _key(texts: dict[str, str]) -> str:
    parts = [_version(), Path(__file__).read_text(), *texts.values()]
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:32]


# --- From codes to a Reference ------------------------------------------------------------------------


def _decode(shot: _Shot, final: np.ndarray, depth: np.ndarray, normal: np.ndarray) -> Reference:
    red, green, blue = np.moveaxis(depth.astype(float), -1, 0)
    mask = red > 0
    codes = red - 1 + (green + blue / _CODES) / _CODES
    distance = codes * (shot.reach / (_CODES - 1) / shot.scale)
    towards_eye = -np.cos(np.pi / _CODES * normal.astype(float))
    outward = -towards_eye if shot.eye_is_inside else towards_eye
    with np.errstate(invalid="ignore"):
        outward /= np.linalg.norm(outward, axis=-1, keepdims=True)
    return Reference(
        rgb=final * (shot.gain / _CODES),
        depth=np.where(mask, distance, np.inf),
        normal=np.where(mask[..., None], outward, 0.0),
        mask=mask,
    )


def _store(path: Path, reference: Reference) -> None:
    """An EXR's floats have 24 bits, so a depth is kept as two: their sum has 48."""
    rounded = reference.depth.astype(np.float32)
    rest = np.where(reference.mask, reference.depth, 0) - np.where(reference.mask, rounded, 0)
    channels = images.rgb_channels(reference.rgb) | images.normal_channels(reference.normal)
    images.write_exr(path, channels | {"depth": rounded, "depth.rest": rest})


def _load(path: Path) -> Reference:
    channels = {name: pixels.astype(float) for name, pixels in images.read_exr(path).items()}
    depth = channels["depth"] + channels["depth.rest"]
    return Reference(
        rgb=np.stack([channels[name] for name in "RGB"], axis=-1),
        depth=depth,
        normal=np.stack([channels[f"normal.{axis}"] for axis in "xyz"], axis=-1),
        mask=np.isfinite(depth),
    )
