"""A halfspace as integer polynomials, and where a line crosses its boundary."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from flint import fmpq, fmpq_mat, fmpz, fmpz_mat

from harness.oracle.roots import Root, at, between, in_order, quotient, sign_changes


class OnPiece(NamedTuple):
    """A leaf that changes at a crossing, and the pieces of its surface that meet the ray there."""

    leaf: int
    pieces: tuple[int, ...]
    inside: bool  # of the leaf, after the crossing


class Line:
    """A ray in integers: (origin + t·dir)·2ᵏ."""

    def __init__(self, ray: Sequence[float]) -> None:
        ratios = [float(v).as_integer_ratio() for v in ray[:6]]
        self.scale = max(denominator for _, denominator in ratios)
        whole = [n * (self.scale // d) for n, d in ratios]
        o, d = whole[:3], whole[3:]
        self.matrix = fmpz_mat(4, 2, [o[0], d[0], o[1], d[1], o[2], d[2], self.scale, 0])


class Leaf:
    """A halfspace over one common denominator q: q·local = linear·world + offset, and q·size."""

    def __init__(self, kind: str, sizes: Sequence[fmpq], world_from_local: fmpq_mat) -> None:
        """world_from_local: 4x4."""
        self.kind = kind
        self.exact_sizes = tuple(sizes)
        self.world_from_local = world_from_local
        local = world_from_local.inv()
        numbers = [local[i, j] for i in range(3) for j in range(4)] + list(sizes)
        q = fmpz(1)
        for number in numbers:
            q = q.lcm(number.q)
        whole = [number.p * (q // number.q) for number in numbers]
        self.matrix = fmpz_mat(3, 4, whole[:12])
        self.sizes = whole[12:]
        self.denominator = q
        #: (3, 3) float64, local from world
        self.local_linear = np.array(
            [[quotient(local[i, j].p, local[i, j].q) for j in range(3)] for i in range(3)]
        )

    def pieces(self, line: Line) -> list[tuple]:
        """Of each piece of surface f the coefficients of f(t), ascending; f < 0 inside. They are
        numbered as in the kernels: blocks 2·axis and 2·axis + 1; else 0 side, 1 bottom, 2 top."""
        x0, x1, y0, y1, z0, z1 = (self.matrix * line.matrix).entries()
        a, b, c = (size * line.scale for size in self.sizes)
        if self.kind == "block":
            axes = ((x0, x1, a), (y0, y1, b), (z0, z1, c))
            return [piece for o, d, half in axes for piece in ((-o - half, -d), (o - half, d))]
        # ρ² = x² + y² along the line
        r0, r1, r2 = x0 * x0 + y0 * y0, 2 * (x0 * x1 + y0 * y1), x1 * x1 + y1 * y1
        if self.kind == "sphere":
            return [(r0 + z0 * z0 - a * a, r1 + 2 * z0 * z1, r2 + z1 * z1)]
        if self.kind == "cylinder":
            return [(r0 - a * a, r1, r2), (-z0 - b, -z1), (z0 - b, z1)]
        if self.kind == "cone":  # ρ² ≤ w², all times (2h)², w = 2h · (the radius at z)
            h4 = 4 * c * c
            w0, w1 = (a + b) * c + (b - a) * z0, (b - a) * z1
            side = (h4 * r0 - w0 * w0, h4 * r1 - 2 * w0 * w1, h4 * r2 - w1 * w1)
            return [side, (-z0 - c, -z1), (z0 - c, z1)]
        # Torus, R ≥ r: (ρ² + z² + R² − r²)² ≤ 4R²ρ².
        k0, k1, k2 = r0 + z0 * z0 + a * a - b * b, r1 + 2 * z0 * z1, r2 + z1 * z1
        f = 4 * a * a
        quartic = (
            k0 * k0 - f * r0,
            2 * k0 * k1 - f * r1,
            2 * k0 * k2 + k1 * k1 - f * r2,
            2 * k1 * k2,
            k2 * k2,
        )
        return [quartic]

    def changes(self, line: Line) -> tuple[list[tuple[Root, OnPiece]], bool]:
        """Where the line enters and leaves the leaf, ascending; leaf numbers are left at -1. And
        whether the line runs in the leaf's surface."""
        pieces = self.pieces(line)
        roots: list[Root] = []
        for number, piece in enumerate(pieces):
            if any(piece[1:]):
                found = sign_changes(piece, number)
                if not found and not _negative_somewhere(piece):
                    return [], False
                roots += found
            elif piece[0] > 0:
                return [], False
            elif piece[0] == 0:
                return [], _inside_somewhere([p for p in pieces if any(p)])
        groups = in_order(roots)
        out: list[tuple[Root, OnPiece]] = []
        inside = False  # a leaf is bounded
        for i, group in enumerate(groups):
            root = roots[group[0]]
            now = False
            if i + 1 < len(groups):
                now = _is_inside(pieces, root, roots[groups[i + 1][0]])
            if now != inside:
                on = tuple(sorted({roots[j].piece for j in group}))
                out.append((root, OnPiece(-1, on, now)))
                inside = now
        return out, False


def _negative_somewhere(piece: tuple) -> bool:
    """Of a polynomial without a change of sign: it is negative almost everywhere."""
    leading = next(c for c in reversed(piece) if c != 0)
    return leading < 0


def _is_inside(pieces: list[tuple], a: Root, b: Root) -> bool:
    """Between two roots with no change of sign between them. A point where a piece only touches 0
    (the middle of a torus with R = r) says nothing: then another one is taken."""
    t = between(a, b)
    while True:
        signs = [sign_at(piece, t.p, t.q) for piece in pieces]
        if max(signs) != 0:
            return max(signs) < 0
        t = between(a, at(t))


def _inside_somewhere(pieces: list[tuple]) -> bool:
    """Whether all of these, none of which is constant 0, are negative anywhere."""
    roots = [root for piece in pieces if any(piece[1:]) for root in sign_changes(piece)]
    groups = in_order(roots)
    ends = [roots[group[0]] for group in groups]
    return any(_is_inside(pieces, a, b) for a, b in pairwise(ends))


def sign_at(coefficients: tuple, n: fmpz, d: fmpz) -> fmpz:
    """The polynomial at n/d, d > 0, times d^degree."""
    value, power = coefficients[-1], d
    for c in coefficients[-2::-1]:
        value = value * n + c * power
        power *= d
    return value
