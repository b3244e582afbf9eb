"""A model in POV-Ray's language: the tree as real primitives, and the three scenes made of it.

POV-Ray's tolerances are absolute (1e-3 for shadows, 1e-7 to 1e-4 for hits, 1e7 is far), so the
model is centred and scaled by a power of two to an extent of about 10.
"""

from __future__ import annotations

import math

import numpy as np

from harness import UserError
from harness.nary import DIFFERENCE, INTERSECTION, LEAF, UNION, operands

CODES = 65535  # highest code of a 16-bit channel

# Which nodes are bounded by their boxes: none, or every operator but the root, whose bound would
# only hide a union from POV-Ray. Operators are n-ary: bounds within a long union, at the nodes of a
# binary tree or around neighbours, cost more than they save.
BOUNDS = ("none", "operators")

_EXTENT = 10.0  # of the scaled model
_REACH_MAX = 1e5  # scaled distance from the eye to the model's far end
_NESTING_MAX = 5000  # POV-Ray recurses: 10,000 nested operators pass, 40,000 crash it


class PovrayError(UserError):
    """A reference that POV-Ray cannot give; one line, with POV-Ray's own message."""


class Frame:
    """A model scaled to POV-Ray's liking: p ↦ (p − centre)·scale."""

    def __init__(self, tree, eye_is_inside: bool = False) -> None:
        low, high = np.asarray(tree.bounds, float)
        self.tree, self.eye_is_inside = tree, eye_is_inside
        self.centre = (low + high) / 2
        self.scale = 2.0 ** round(math.log2(_EXTENT / (high - low).max()))

    def scaled(self, point) -> np.ndarray:
        return (np.asarray(point, float) - self.centre) * self.scale


class Shot(Frame):
    """One model seen by one camera."""

    def __init__(self, tree, scene, width: int, height: int) -> None:
        super().__init__(tree, contains(tree, scene.eye))
        low, high = np.asarray(tree.bounds, float)
        self.scene = scene
        self.aspect = width / height
        self.eye = self.scaled(scene.eye)
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


# --- The three scenes ---------------------------------------------------------------------------


def final(shot: Shot, bounds: str = "operators") -> str:
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
        lights="\n".join(lights),
        solid=solid(shot, [f"pigment {{ rgb {_vector(color)} }}" for color in colors], bounds),
    )


def depth(shot: Shot) -> str:
    """The distance is Coarse codes, of which the reach has 65,534. Red is 1 + their whole part, so
    that 0 is a miss; green and blue are the rest as two more digits of base 65535."""
    ex, ey, ez = (f"({value!r})" for value in shot.eye.tolist())
    distance = f"sqrt(pow(x-{ex},2) + pow(y-{ey},2) + pow(z-{ez},2))"
    return _measurement(
        shot,
        f"#declare Coarse = function {{ {distance} * {(CODES - 1) / shot.reach!r} }}\n"
        f"#declare Fine = function {{ (Coarse(x,y,z) - floor(Coarse(x,y,z))) * {CODES} }}",
        f"function {{ (1 + floor(Coarse(x,y,z))) / {CODES} }}",
        f"function {{ floor(Fine(x,y,z)) / {CODES} }}",
        "function { Fine(x,y,z) - floor(Fine(x,y,z)) }",
    )


def normal(shot: Shot) -> str:
    """`slope` is linear in the angle between the normal, turned towards the eye, and an axis."""
    return _measurement(shot, "", "slope { x }", "slope { y }", "slope { z }")


def _measurement(shot: Shot, declarations: str, red: str, green: str, blue: str) -> str:
    """A scene that glows by three patterns with values in 0..1. An average divides by three."""
    glowing = solid(shot)
    pigment = f"""pigment {{
  average pigment_map {{
    [1 {red} color_map {{ [0 rgb 0] [1 rgb <3, 0, 0>] }}]
    [1 {green} color_map {{ [0 rgb 0] [1 rgb <0, 3, 0>] }}]
    [1 {blue} color_map {{ [0 rgb 0] [1 rgb <0, 0, 3>] }}]
  }}
}}"""
    return _scene(
        shot,
        finish="ambient 0 diffuse 0 emission 1",
        background="0",
        lights="",
        solid=f"{declarations}\nobject {{\n{glowing}\n{pigment}\n}}",
    )


def _scene(shot: Shot, finish: str, background: str, lights: str, solid: str) -> str:
    """The camera's vectors are explicit, so POV-Ray's left-handedness never enters: a pixel at
    (x, y), each in −1/2..1/2, looks along direction + x·right + y·up."""
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


# --- The solid ----------------------------------------------------------------------------------


def solid(frame: Frame, pigments: list[str] | None = None, bounds: str = "operators") -> str:
    """The tree as one POV-Ray object; pigments: one a leaf, or none for one of the whole.

    A union is POV-Ray's `union`, which keeps the surfaces that its parts have inside each other:
    from outside the solid they are never the first, and what they shade is inside. `merge` drops
    them and is far slower; it is used only where the eye is inside the solid and would see them.

    POV-Ray has a hierarchy over the scene's objects, which splits a bare union, and none inside an
    object; there the scene can help it, see BOUNDS. It makes ngkcut 7 times as fast, and the pixels
    are the same.
    """
    words = {
        UNION: "merge" if frame.eye_is_inside else "union",
        INTERSECTION: "intersection",
        DIFFERENCE: "difference",
    }
    operators = frame.tree.operators.tolist()
    leaves = _leaves(frame, pigments or [""] * len(frame.tree.kinds))
    boxes = _boxes(frame)
    lines: list[str] = []
    nesting = 0
    root = len(operators) - 1
    pending: list[int | str] = [root]  # nodes to write, and texts that close them
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
            low, high = (_vector(corner) for corner in boxes[item])
            lines.append(f"{words[operators[item][0]]} {{")
            bare = item == root or bounds == "none"
            pending.append("}" if bare else f"bounded_by {{ box {{ {low}, {high} }} }} }}")
            pending += reversed(operands(operators, item))
    return "\n".join(lines)


def _leaves(frame: Frame, pigments: list[str]) -> list[str]:
    """Each leaf as a POV-Ray primitive. What its matrix scales evenly goes into its size, because
    POV-Ray's tolerances act in the primitive's own space."""
    tree = frame.tree
    linear = np.array(tree.matrices[:, :, :3], float)
    stretch = np.cbrt(np.abs(np.linalg.det(linear)))
    linear /= stretch[:, None, None]
    sizes = np.asarray(tree.sizes) * (stretch * frame.scale)[:, None]
    offsets = frame.scaled(tree.matrices[:, :, 3])
    lines = []
    for leaf, kind in enumerate(tree.kinds):
        a, b, c = sizes[leaf].tolist()
        columns = linear[leaf].T
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
        matrix = _vector([*columns.ravel(), *offsets[leaf]])
        lines.append(f"{shape} matrix {matrix} {pigments[leaf]} }}")
    return lines


def _boxes(frame: Frame) -> list[np.ndarray]:
    """For every node, the (2, 3) low and high corner of a box around its solid, with some room."""
    tree = frame.tree
    sizes = tree.sizes.tolist()
    half = np.array([_half_extents(kind, *sizes[leaf]) for leaf, kind in enumerate(tree.kinds)])
    reach = np.einsum("nij,nj->ni", np.abs(tree.matrices[:, :, :3]), half) * frame.scale + 1e-3
    centre = frame.scaled(tree.matrices[:, :, 3])
    of_leaf = np.stack([centre - reach, centre + reach], axis=1)
    boxes: list[np.ndarray] = []
    for op, left, right in tree.operators.tolist():
        if op == LEAF:
            boxes.append(of_leaf[left])
        elif op == DIFFERENCE:
            boxes.append(boxes[left])
        else:
            (low, high), (other_low, other_high) = boxes[left], boxes[right]
            pick_low, pick_high = np.minimum, np.maximum
            if op == INTERSECTION:
                pick_low, pick_high = pick_high, pick_low
            boxes.append(np.array([pick_low(low, other_low), pick_high(high, other_high)]))
    return boxes


def _half_extents(kind: str, a: float, b: float, c: float) -> tuple[float, float, float]:
    """Of a leaf in its own space."""
    return {
        "sphere": (a, a, a),
        "block": (a, b, c),
        "cylinder": (a, a, b),
        "cone": (max(a, b), max(a, b), c),
        "torus": (a + b, a + b, b),
    }[kind]
