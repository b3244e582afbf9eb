"""A .csg read once more, by other means than the tracers' loader, with its decimals as rationals.

Only leaves are read: kind, sizes, transform, in the order of the source. The Boolean structure is
the loaded tree's, and leaf by leaf the two must agree up to rounding.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from flint import fmpq, fmpq_mat, fmpz

import tracers
from harness import UserError
from harness.oracle.roots import quotient

_TOKEN = re.compile(
    r"""\s+ | //[^\n]* | /\*.*?\*/
    | (?P<number>[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)
    | (?P<word>[A-Za-z_$][\w$]*)
    | (?P<string>"(?:[^"\\]|\\.|"(?!\s*[,)\]]))*")
    | (?P<symbol>[-()\[\]{},;=!\#%*])""",
    re.VERBOSE | re.DOTALL,
)
_UNIONS = {"group", "union", "multmatrix", "color", "render"}
_PASSES_ON = {*_UNIONS, "difference", "intersection"}  # a lone child as it is
_ROUNDINGS = 2.0**-44  # 512 u: of a chain of transforms, relative to the product of magnitudes

Placed = tuple[str, list[fmpq], fmpq_mat, np.ndarray]


@dataclass
class _Node:
    kind: str
    modifiers: str
    arguments: dict[str, object]
    children: list[_Node] = field(default_factory=list)

    @property
    def left_out(self) -> bool:
        return bool(set("%*") & set(self.modifiers))


def read_csg(
    source: Path | str, tree: tracers.CsgTree
) -> tuple[list[str], list[list[fmpq]], list[fmpq_mat]]:
    """Kinds, three sizes each, and 4x4 matrices, world from local. `source`: a Path, or the text.
    UserError if it is not the source of the tree, or means an irrational size."""
    name = str(source) if isinstance(source, Path) else "<text>"
    text = source.read_text(errors="surrogateescape") if isinstance(source, Path) else source
    leaves = _Lowering(name).leaves(_model(_parse(name, text)))
    kinds = [kind for kind, *_ in leaves]
    if kinds != tree.kinds:
        raise UserError(f"{name}: its {len(kinds)} halfspaces are not the {tree.halfspaces} loaded")
    for i, (kind, sizes, matrix, magnitude) in enumerate(leaves):
        rounded = np.array([[_double(matrix[r, c]) for c in range(4)] for r in range(3)])
        off_place = np.abs(rounded - tree.matrices[i]) > _ROUNDINGS * magnitude[:3]
        size = np.array([_double(s) for s in sizes])
        off_size = np.abs(size - tree.sizes[i]) > _ROUNDINGS * size
        if off_place.any() or off_size.any():
            raise UserError(f"{name}: halfspace {i} ({kind}) is not the one loaded")
    return kinds, [sizes for _, sizes, _, _ in leaves], [matrix for _, _, matrix, _ in leaves]


def decimal(text: str) -> fmpq:
    """`-1.25e-3` as the rational that it says."""
    mantissa, _, exponent = text.lower().partition("e")
    whole, _, fraction = mantissa.partition(".")
    power = int(exponent or 0) - len(fraction)
    digits = fmpz(int(whole + fraction))
    ten = fmpz(10) ** abs(power)
    return fmpq(digits * ten) if power >= 0 else fmpq(digits, ten)


# --- Text to nodes ------------------------------------------------------------------------------


def _tokens(name: str, text: str) -> Iterator[tuple[str, str]]:
    offset = 0
    while offset < len(text):
        match = _TOKEN.match(text, offset)
        if not match:
            line = text.count("\n", 0, offset) + 1
            raise UserError(f"{name}:{line}: unexpected {text[offset]!r}")
        offset = match.end()
        if match.lastgroup:
            yield match.lastgroup, match[0]


def _parse(name: str, text: str) -> _Node:
    """The file as a union of its nodes."""
    tokens = list(_tokens(name, text))
    numbers: dict[str, fmpq] = {}
    at = 0

    def value() -> object:
        nonlocal at
        kind, word = tokens[at]
        at += 1
        if kind == "number":
            if word not in numbers:
                numbers[word] = decimal(word)
            return numbers[word]
        if word != "[":
            return word  # true, undef, a string, nan
        entries = []
        while tokens[at][1] != "]":
            entries.append(value())
            at += tokens[at][1] == ","
        at += 1
        return entries

    file = _Node("group", "", {})
    opened = [file]
    try:
        while at < len(tokens):
            if tokens[at][1] == "}":
                opened.pop()
                at += 1
                continue
            modifiers = ""
            while tokens[at][1] in "!#%*":
                modifiers += tokens[at][1]
                at += 1
            node = _Node(tokens[at][1], modifiers, {})
            at += 2
            while tokens[at][1] != ")":
                key = ""
                if tokens[at + 1][1] == "=":
                    key = tokens[at][1]
                    at += 2
                node.arguments[key] = value()
                at += tokens[at][1] == ","
            at += 1
            opened[-1].children.append(node)
            if tokens[at][1] == "{":
                opened.append(node)
            at += 1
    except IndexError:
        raise UserError(f"{name}: unexpected end") from None
    return file


def _model(file: _Node) -> _Node:
    """What ! says is the model, else the file. Nothing under * counts."""
    waiting = [file]
    while waiting:
        node = waiting.pop()
        if "*" in node.modifiers:
            continue
        if "!" in node.modifiers:
            return _Node("group", "", {}, [_Node(node.kind, "", node.arguments, node.children)])
        waiting += reversed(node.children)
    return file


# --- Nodes to leaves ----------------------------------------------------------------------------


class _Lowering:
    def __init__(self, name: str) -> None:
        self.name = name

    def leaves(self, model: _Node) -> list[Placed]:
        """In the order of the source. An operator whose operands are empty, or whose first one is,
        or of an intersection any, is empty: its leaves are none."""
        identity = fmpq_mat(4, 4, [int(i == j) for i in range(4) for j in range(4)])
        frames: list[dict] = []
        finished: list[Placed] = []

        def enter(node: _Node, place: fmpq_mat, magnitude: np.ndarray) -> None:
            if node.kind == "multmatrix":
                own = _matrix(node.arguments[""])
                place = place * own
                magnitude = magnitude @ np.abs(
                    [[_double(own[r, c]) for c in range(4)] for r in range(4)]
                )
            children = iter([child for child in node.children if not child.left_out])
            frames.append(
                {"node": node, "place": place, "magnitude": magnitude, "children": children}
                | {"leaves": [], "operands": 0, "void": False}
            )

        def hand_up(leaves: list[Placed]) -> None:
            if not frames:
                finished.extend(leaves)
                return
            parent = frames[-1]
            kind = parent["node"].kind
            if leaves:
                parent["operands"] += 1
                parent["leaves"] += leaves
            elif kind == "intersection" or (kind == "difference" and parent["operands"] == 0):
                parent["void"] = True

        enter(model, identity, np.eye(4))
        while frames:
            frame = frames[-1]
            child = next(frame["children"], None)
            if child is None:
                frames.pop()
                hand_up([] if frame["void"] else frame["leaves"])
            elif child.kind in _PASSES_ON:
                enter(child, frame["place"], frame["magnitude"])
            else:
                leaf = self._leaf(child)
                hand_up([_placed(leaf, frame["place"], frame["magnitude"])] if leaf else [])
        return finished

    def _leaf(self, node: _Node) -> tuple[str, list[fmpq], list[fmpq]] | None:
        """Kind, sizes, centre; None if it is empty."""
        given, zero = node.arguments, fmpq(0)
        is_centred = given.get("center") == "true"
        if node.kind == "sphere":
            return ("sphere", [given["r"], zero, zero], [zero] * 3) if given["r"] > 0 else None
        if node.kind == "cube":
            half = [side / 2 for side in given["size"]]
            return ("block", half, [zero] * 3 if is_centred else half) if min(half) > 0 else None
        if node.kind == "cylinder":
            h, r1, r2 = given["h"], given["r1"], given["r2"]
            if h <= 0 or min(r1, r2) < 0 or r1 + r2 == 0:
                return None
            centre = [zero, zero, zero if is_centred else h / 2]
            if r1 == r2:
                return "cylinder", [r1, h / 2, zero], centre
            return "cone", [r1, r2, h / 2], centre
        if node.kind == "rotate_extrude":
            return self._torus(node)
        raise UserError(f"{self.name}: unsupported: {node.kind}")

    def _torus(self, node: _Node) -> tuple[str, list[fmpq], list[fmpq]] | None:
        """One circle in the plane, by similarities; the plane's y becomes z."""
        a, b, c, d, x, y = map(fmpq, (1, 0, 0, 1, 0, 0))  # columns (a, b), (c, d), offset (x, y)
        while node.kind != "circle":
            node = next((child for child in node.children if not child.left_out), None)
            if node is None:
                return None
            if node.kind == "multmatrix":
                m = _matrix(node.arguments[""])
                x, y = x + a * m[0, 3] + c * m[1, 3], y + b * m[0, 3] + d * m[1, 3]
                a, b, c, d = (
                    a * m[0, 0] + c * m[1, 0],
                    b * m[0, 0] + d * m[1, 0],
                    a * m[0, 1] + c * m[1, 1],
                    b * m[0, 1] + d * m[1, 1],
                )
        squared = a * a + b * b
        try:
            stretch = squared.sqrt()
        except Exception:  # flint's own, of no public type
            raise UserError(f"{self.name}: a torus' minor radius is irrational") from None
        minor = node.arguments["r"] * stretch
        if minor <= 0:
            return None
        return "torus", [abs(x), minor, fmpq(0)], [fmpq(0), fmpq(0), y]


def _placed(leaf: tuple, place: fmpq_mat, magnitude: np.ndarray) -> Placed:
    kind, sizes, centre = leaf
    rows = [[int(i == j) for j in range(3)] + [centre[i]] for i in range(3)]
    own = fmpq_mat(4, 4, [entry for row in [*rows, [0, 0, 0, 1]] for entry in row])
    shift = np.eye(4)
    shift[:3, 3] = [abs(_double(v)) for v in centre]
    return kind, sizes, place * own, magnitude @ shift


def _matrix(rows: list[list[fmpq]]) -> fmpq_mat:
    return fmpq_mat(4, 4, [entry for row in rows for entry in row])


def _double(value: fmpq) -> float:
    return quotient(value.p, value.q)
