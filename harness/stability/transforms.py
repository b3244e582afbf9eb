"""X14: transforms that mirror, shear, squeeze, and chains of them."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction

import numpy as np

import tracers
from harness.stability import Finding, Findings, row
from harness.stability.exact import (
    GUARD,
    UNIT_ROUNDOFF,
    Block,
    Cone,
    Convex,
    Cylinder,
    Long,
    Sphere,
    at,
    dot,
    norm,
)
from harness.stability.exact_torus import Torus
from harness.stability.judged import chunks, powers, unit

Matrix = list[list[Fraction]]  # 3 by 4

_DEPTH = 50  # of a chain
_HARDEST = {"float64": 12, "float32": 6}  # decimal exponents of the condition
_PER_TREE = 250  # rays


def rotation(rng: np.random.Generator) -> np.ndarray:
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.linalg.det(q)


def placed(linear: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Somewhere within a few sizes. The offset has few binary digits: E knows of no distance from
    the world's origin, and so of no rounding of an offset's decimals."""
    step = 2.0 ** (np.round(np.log2(np.linalg.norm(linear))) - 8)
    return np.column_stack([linear, np.round(rng.normal(size=3) * 2**8) * step])


def mirror(rng: np.random.Generator, hardest: int) -> list[np.ndarray]:
    flip = np.diag(rng.permutation([-1.0, 1, 1])) * powers(rng, -3, 3, ())
    return [placed(rotation(rng) @ flip, rng)]


def shear(rng: np.random.Generator, hardest: int) -> list[np.ndarray]:
    linear = np.eye(3)
    i, j = rng.permutation(3)[:2]
    linear[i, j] = rng.normal() * powers(rng, -1, 1, ())
    return [placed(linear, rng)]


def squeeze(rng: np.random.Generator, hardest: int) -> list[np.ndarray]:
    """Of any condition up to the hardest, flat or like a needle."""
    smallest = powers(rng, -hardest, 0, ())
    scale = np.diag([1, rng.choice([1, smallest, np.sqrt(smallest)]), smallest])
    return [placed(rotation(rng) @ scale @ rotation(rng), rng)]


def chain(rng: np.random.Generator, hardest: int) -> list[np.ndarray]:
    """Rotations in six digits, as OpenSCAD writes them."""
    steps = [np.column_stack([rotation(rng), np.zeros(3)]) for _ in range(_DEPTH)]
    return [np.array([[float(f"{x:.6g}") for x in line] for line in step]) for step in steps]


_TRANSFORMS = {"mirror": mirror, "shear": shear, "squeeze": squeeze, "chain of 50": chain}


def solids(rng: np.random.Generator) -> Iterator[tuple[str, Convex | Torus]]:
    """Each primitive as it is written in .csg, and as it is."""
    a, b, c = rng.uniform(0.2, 1, 3).tolist()
    r0, r1 = rng.permutation([a, a * rng.choice([0.0, 0.5])]).tolist()
    aside = f"[[1, 0, 0, {a!r}], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]"
    circle = f"multmatrix({aside}) {{ circle(r = {a * b!r}); }}"
    yield f"sphere(r = {a!r});", Sphere(a)
    yield f"cube(size = [{2 * a!r}, {2 * b!r}, {2 * c!r}], center = true);", Block(a, b, c)
    yield f"cylinder(h = {2 * b!r}, r1 = {a!r}, r2 = {a!r}, center = true);", Cylinder(a, b)
    yield f"cylinder(h = {2 * b!r}, r1 = {r0!r}, r2 = {r1!r}, center = true);", Cone(r0, r1, b)
    yield f"rotate_extrude(convexity = 2) {{ {circle} }}", Torus(a, a * b)


def written(child: str, steps: list[np.ndarray]) -> str:
    """The .csg text; every number is its shortest decimal."""
    for step in reversed(steps):
        lines = [", ".join(repr(float(x)) for x in line) for line in step] + ["0, 0, 0, 1"]
        child = f"multmatrix([{', '.join(f'[{line}]' for line in lines)}]) {{ {child} }}"
    return child


def product(steps: list[np.ndarray]) -> Matrix:
    """Of the decimals, exactly."""
    total: Matrix = [[Fraction(int(i == j)) for j in range(4)] for i in range(3)]
    for step in steps:
        right = [[Fraction(repr(float(x))) for x in line] for line in step]
        right.append([Fraction(0), Fraction(0), Fraction(0), Fraction(1)])
        total = [[sum(line[k] * right[k][j] for k in range(4)) for j in range(4)] for line in total]
    return total


def inverse(m: Matrix) -> Matrix:
    """Of the linear part, exactly."""

    def minor(i: int, j: int) -> Fraction:
        a, b = (i + 1) % 3, (i + 2) % 3
        c, d = (j + 1) % 3, (j + 2) % 3
        return m[a][c] * m[b][d] - m[a][d] * m[b][c]

    volume = sum(m[0][j] * minor(0, j) for j in range(3))
    return [[minor(j, i) / volume for j in range(3)] for i in range(3)]


def rounded(m: Matrix) -> np.ndarray:
    """To extended precision."""
    high = np.array([[float(x) for x in line] for line in m])
    pairs = [list(zip(*lines, strict=True)) for lines in zip(m, high, strict=True)]
    low = np.array([[float(x - Fraction(h)) for x, h in line] for line in pairs])
    return high.astype(Long) + low


class Placed:
    """A primitive where the text puts it, in extended precision."""

    def __init__(self, solid: Convex | Torus, steps: list[np.ndarray]):
        matrix = product(steps)
        self.solid, self.matrix, self.inverse = solid, rounded(matrix), rounded(inverse(matrix))
        linear = self.matrix[:, :3].astype(float)
        self.condition = float(np.linalg.cond(linear))
        self.radius = float(np.linalg.norm(linear, 2)) * solid.radius

    def faces(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As of a primitive, distances and normals in the world."""
        local = (p - self.matrix[:, 3]) @ self.inverse.T
        if isinstance(self.solid, Torus):
            distances, gradients = self.solid.depth(local)[None], self.solid.normal(local)[None]
        else:
            distances, gradients = self.solid.faces(local)
        gradients = gradients @ self.inverse
        length = norm(gradients)
        return distances / length, gradients / length[..., None]


@row("X14", "mirror, shear, condition to 1e12, chains of 50", tests=40_000, full=1_000_000)
def transforms(n: int, rng: np.random.Generator) -> Findings:
    kinds = 5
    for precision, hardest in _HARDEST.items():
        for name, transform in _TRANSFORMS.items():
            worst = angle = 0.0
            rays = inward = 0
            few = n // (2 * len(_TRANSFORMS))
            for _, count in chunks(few, max(1, few // (kinds * _PER_TREE))):
                for text, solid in solids(rng):
                    steps = transform(rng, hardest)
                    tree = tracers.parse_csg(written(text, steps))
                    off, wrong, degrees = _hits(
                        tree, Placed(solid, steps), count // kinds, precision, rng
                    )
                    worst, angle = max(worst, off), max(angle, degrees)
                    rays, inward = rays + count // kinds, inward + wrong
            case = f"{name}, {precision}"
            yield Finding("X14", case, rays, "surface error, E × condition", worst, GUARD)
            yield Finding("X14", case, rays, "normal's angle, degrees", angle, 90, inward)


def _hits(tree, placed: Placed, n: int, precision: str, rng) -> tuple[float, int, float]:
    """Worst surface error in E × condition, the normals that point in, the worst angle of one."""
    local = placed.solid.radius * unit(rng.normal(size=(n, 3))) * rng.random((n, 1))
    aim = local @ placed.matrix[:, :3].T.astype(float)
    back = placed.radius * powers(rng, 0.2, 3, (n, 1))
    origin = aim + back * unit(rng.normal(size=(n, 3)))
    along = (aim - origin) * powers(rng, -3, 0, (n, 1))
    rays = np.column_stack(
        [origin + placed.matrix[:, 3].astype(float), along, np.zeros(n), np.full(n, np.inf)]
    )
    hits = tracers.make("naive", tree, {"precision": precision}).trace(rays)
    hit = hits.leaf >= 0
    E = UNIT_ROUNDOFF[precision] * (np.linalg.norm(origin, axis=1) + placed.radius)
    E = E[hit] * placed.condition
    p = at(rays[hit, :3].astype(Long), rays[hit, 3:6].astype(Long), hits.t[hit].astype(Long))
    distances, normals = placed.faces(p)
    off = np.abs(distances.max(axis=0))
    # Near an edge, any of the faces that meet there may be meant.
    meant = np.abs(distances) <= np.maximum(GUARD * E, off)
    cosine = np.where(meant, dot(normals, hits.normal[hit]), -1)
    cosine = np.clip(cosine.max(axis=0).astype(float), -1, 1)
    degrees = np.degrees(np.arccos(cosine))
    return float((off / E).max(initial=0)), int((cosine <= 0).sum()), float(degrees.max(initial=0))
