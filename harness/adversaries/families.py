"""Families of trees that broke simpler hit rules: the first wave.

Each family is a function of a numpy Generator that returns a `tracers.CsgTree`.
"""

from collections.abc import Callable

import numpy as np

import tracers

LEAF, UNION, INTERSECTION, DIFFERENCE = range(4)
Family = Callable[[np.random.Generator], "tracers.CsgTree"]


class Solid:
    """Collects leaves and operators in post-order; `a`, `b` are indices that it returned."""

    def __init__(self) -> None:
        self.kinds: list[str] = []
        self.sizes: list[list[float]] = []
        self.matrices: list[np.ndarray] = []

    def leaf(self, kind: str, size: list[float], matrix: np.ndarray | None = None) -> list:
        self.kinds.append(kind)
        self.sizes.append([*size, 0.0, 0.0][:3])
        self.matrices.append(np.eye(3, 4) if matrix is None else matrix[:3])
        return ["leaf", len(self.kinds) - 1]

    def tree(self, root: list) -> "tracers.CsgTree":
        """`root` is a nested list [operator, left, right] over leaves; leaves are renumbered."""
        rows: list[tuple[int, int, int]] = []
        order: list[int] = []

        waiting, done = [(root, False)], []  # no recursion: chains are a thousand deep
        while waiting:
            node, below = waiting.pop()
            if node[0] == "leaf":
                order.append(node[1])
                rows.append((LEAF, len(order) - 1, -1))
            elif not below:
                waiting += [(node, True), (node[2], False), (node[1], False)]
                continue
            else:
                right, left = done.pop(), done.pop()
                rows.append((node[0], left, right))
            done.append(len(rows) - 1)
        return tracers.CsgTree.build(
            [self.kinds[i] for i in order],
            np.array([self.sizes[i] for i in order], dtype=np.float64),
            np.array([self.matrices[i] for i in order], dtype=np.float64),
            np.array(rows, dtype=np.int32),
        )


def placed(x: float, y: float, z: float, linear: np.ndarray | None = None) -> np.ndarray:
    """(3, 4) affine map."""
    return np.column_stack([np.eye(3) if linear is None else linear, [x, y, z]])


def six_digits(m: np.ndarray) -> np.ndarray:
    """As OpenSCAD prints numbers."""
    return np.vectorize(lambda v: float(f"{v:.6g}"))(m)


def rotation(rng: np.random.Generator) -> np.ndarray:
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q if np.linalg.det(q) > 0 else -q


def random_size(rng: np.random.Generator, kind: str, scale: float = 0.6) -> list[float]:
    s = list(rng.uniform(0.15, 1.0, 3) * scale)
    if kind == "torus":
        return [s[0] + s[1], s[1]]
    if kind == "cone" and rng.random() < 0.3:
        s[rng.integers(2)] = 0.0
    return s


def combine(rng: np.random.Generator, parts: list) -> list:
    """A random binary tree over the parts, in order."""
    parts = list(parts)
    while len(parts) > 1:
        i = rng.integers(len(parts) - 1)
        operator = int(rng.choice([UNION, INTERSECTION, DIFFERENCE], p=[0.5, 0.2, 0.3]))
        parts[i : i + 2] = [[operator, parts[i], parts[i + 1]]]
    return parts[0]


KINDS = ["sphere", "block", "cylinder", "cone", "torus"]


def random_solid(rng: np.random.Generator) -> "tracers.CsgTree":
    """All primitives, all operators, any rotation, some mirrored or sheared."""
    solid = Solid()
    parts = []
    for _ in range(rng.integers(2, 25)):
        kind = KINDS[rng.integers(5)]
        linear = rotation(rng)
        if rng.random() < 0.3:
            linear = linear @ np.diag(rng.choice([-1.0, 0.5, 1.0, 2.0], 3))
        if rng.random() < 0.2:
            linear[0, 1] += rng.uniform(-1, 1)
        parts.append(
            solid.leaf(kind, random_size(rng, kind), placed(*rng.uniform(-1, 1, 3), linear))
        )
    return solid.tree(combine(rng, parts))


def lattice(rng: np.random.Generator) -> "tracers.CsgTree":
    """Blocks and cylinders on a dyadic lattice: faces on one another and on cells' walls."""
    solid = Solid()
    parts = [solid.leaf("block", [1, 1, 1])]
    for _ in range(rng.integers(3, 16)):
        centre = rng.integers(-4, 5, 3) / 4
        if rng.random() < 0.7:
            parts.append(solid.leaf("block", list(rng.integers(1, 5, 3) / 4), placed(*centre)))
        else:
            parts.append(solid.leaf("cylinder", list(rng.integers(1, 5, 2) / 4), placed(*centre)))
    return solid.tree(combine(rng, parts))


def kin(rng: np.random.Generator) -> "tracers.CsgTree":
    """A − A, A ∩ A, A ∪ A and mixtures of the same few primitives many times over."""
    solid = Solid()
    parts = []
    chosen = []
    for _ in range(rng.integers(1, 4)):
        kind = KINDS[rng.integers(5)]
        linear = np.eye(3) if rng.random() < 0.5 else six_digits(rotation(rng))
        chosen.append(
            (kind, random_size(rng, kind, 1.0), placed(*rng.uniform(-0.5, 0.5, 3), linear))
        )
    for _ in range(rng.integers(2, 10)):
        parts.append(solid.leaf(*chosen[rng.integers(len(chosen))]))
    return solid.tree(combine(rng, parts))


def decimals(rng: np.random.Generator) -> "tracers.CsgTree":
    """The same planes reached through different decimals: 0.1 + 0.2 and 0.3."""
    solid = Solid()
    step = float(rng.choice([0.1, 0.3, 0.7, 1.1]))
    parts = []
    for _ in range(rng.integers(3, 12)):
        n = rng.integers(1, 6, 3)
        half = [sum([step] * int(k)) / 2 if rng.random() < 0.5 else step * k / 2 for k in n]
        corner = [
            sum([step] * int(k)) if rng.random() < 0.5 else step * k for k in rng.integers(-3, 3, 3)
        ]
        shift = placed(*[c + h for c, h in zip(corner, half, strict=True)])
        parts.append(solid.leaf("block", half, shift))
    return solid.tree(combine(rng, parts))


def tangent(rng: np.random.Generator) -> "tracers.CsgTree":
    """Spheres that touch, cylinders that rest on planes, spheres in the holes of tori."""
    solid = Solid()
    parts = [solid.leaf("block", [1, 1, 0.25], placed(0, 0, -0.25))]
    for _ in range(rng.integers(2, 9)):
        r = float(rng.choice([0.1, 0.25, 0.3, 0.5]))
        x, y = rng.integers(-3, 4, 2) * r
        pick = rng.integers(4)
        if pick == 0:
            parts.append(solid.leaf("sphere", [r], placed(x, y, r)))
        elif pick == 1:
            lying = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
            parts.append(solid.leaf("cylinder", [r, 0.5], placed(x, y, r, lying)))
        elif pick == 2:
            parts.append(solid.leaf("torus", [2 * r, r], placed(x, y, r)))
        else:
            parts.append(solid.leaf("sphere", [r], placed(x, y, -r)))
    return solid.tree(combine(rng, parts))


def near_coincident(rng: np.random.Generator) -> "tracers.CsgTree":
    """Copies that differ by 1e-16 to 1e-8."""
    solid = Solid()
    parts = []
    kind = KINDS[rng.integers(5)]
    size = random_size(rng, kind, 1.0)
    linear = np.eye(3) if rng.random() < 0.5 else rotation(rng)
    for _ in range(rng.integers(2, 10)):
        off = 10.0 ** rng.uniform(-16, -8, 3) * rng.choice([-1, 0, 1], 3)
        grown = [s * (1 + 10.0 ** rng.uniform(-16, -8) * rng.choice([-1, 0, 1])) for s in size]
        if kind == "torus":
            grown[0] = max(grown[0], grown[1])
        parts.append(solid.leaf(kind, grown, placed(*off, linear)))
    return solid.tree(combine(rng, parts))


def rotated_flush(rng: np.random.Generator) -> "tracers.CsgTree":
    """Blocks side by side in a frame rotated by a six-digit matrix, faces in common."""
    solid = Solid()
    linear = six_digits(rotation(rng))
    parts = []
    for _ in range(rng.integers(3, 12)):
        half = rng.integers(1, 5, 3) * 0.1
        corner = rng.integers(-5, 5, 3) * 0.1
        centre = six_digits(linear @ (corner + half))
        parts.append(solid.leaf("block", list(half), placed(*centre, linear)))
    return solid.tree(combine(rng, parts))


def chains(rng: np.random.Generator) -> "tracers.CsgTree":
    """Dense chains of near ties: many faces an ulp to a few bands apart."""
    solid = Solid()
    parts = []
    gap = 2.0 ** rng.integers(-53, -38)
    axis = rng.integers(3)
    for i in range(rng.integers(4, 25)):
        half = np.full(3, 0.5)
        half[axis] += gap * (i if rng.random() < 0.5 else rng.integers(0, 30))
        parts.append(solid.leaf("block", list(half)))
    return solid.tree(combine(rng, parts))


def ill_conditioned(rng: np.random.Generator) -> "tracers.CsgTree":
    """Scalings of 1 to 1e±5 along any direction."""
    solid = Solid()
    parts = []
    for _ in range(rng.integers(2, 9)):
        kind = KINDS[rng.integers(5)]
        stretch = np.diag(10.0 ** rng.uniform(-5, 0, 3))
        linear = rotation(rng) @ stretch @ rotation(rng)
        linear = linear / np.abs(linear).max()
        parts.append(
            solid.leaf(
                kind, random_size(rng, kind, 1.5), placed(*rng.uniform(-0.5, 0.5, 3), linear)
            )
        )
    return solid.tree(combine(rng, parts))


def coplanar_blocks(rng: np.random.Generator) -> "tracers.CsgTree":
    """Three blocks, their upper faces in one plane, cut by a fourth; it made POV-Ray speckle."""
    solid = Solid()
    top = float(rng.choice([0.0, 0.3, 1 / 3]))
    parts = []
    for _ in range(3):
        half = rng.uniform(0.2, 0.6, 3)
        parts.append(
            solid.leaf("block", list(half), placed(*rng.uniform(-0.3, 0.3, 2), top - half[2]))
        )
    parts.append(solid.leaf("cylinder", [0.3, 1.0]))
    parts.append(solid.leaf("block", [0.1, 0.1, 0.1], placed(0.2, 0.1, top - 0.1)))
    return solid.tree(combine(rng, parts))


def tori(rng: np.random.Generator) -> "tracers.CsgTree":
    """Stacked, linked and thin tori: threads and rings."""
    solid = Solid()
    parts = []
    for i in range(rng.integers(2, 12)):
        major = rng.uniform(0.3, 0.8)
        minor = major * float(rng.choice([1.0, 0.5, 0.1, 1e-3]))
        linear = np.eye(3) if rng.random() < 0.6 else rotation(rng)
        parts.append(solid.leaf("torus", [major, minor], placed(0, 0, 0.1 * i - 0.5, linear)))
    return solid.tree(combine(rng, parts))


FIRST_WAVE: dict[str, Family] = {
    f.__name__: f
    for f in (
        random_solid,
        lattice,
        kin,
        decimals,
        tangent,
        near_coincident,
        rotated_flush,
        chains,
        ill_conditioned,
        coplanar_blocks,
        tori,
    )
}
