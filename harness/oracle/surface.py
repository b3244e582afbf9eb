"""How far a point of a ray is from a leaf's surface, and the normal there, to first order.

The residual is exact and only then rounded, so that a distance of 1e-20 of the size has its digits.
Each piece of surface is judged by its own distance function, never by an expanded polynomial's
slope: ρ − w for a cone, hypot(ρ − R, z) − r for a torus.
"""

from __future__ import annotations

import math

import numpy as np
from flint import fmpz

from harness.oracle.leaf import Leaf, Line
from harness.oracle.roots import quotient


class SurfacePoint:
    """A point origin + t·dir as a leaf sees it. `t` is taken as the rational that it is."""

    def __init__(self, leaf: Leaf, line: Line, t: float) -> None:
        n, d = t.as_integer_ratio()
        self._leaf = leaf
        x0, x1, y0, y1, z0, z1 = (leaf.matrix * line.matrix).entries()
        self._x, self._y, self._z = (fmpz(o * d + v * n) for o, v in ((x0, x1), (y0, y1), (z0, z1)))
        self._scale = fmpz(line.scale * d)  # of the sizes
        self._unit = leaf.denominator * self._scale
        self.local = [self._rounded(v) for v in (self._x, self._y, self._z)]

    def distances(self) -> list[float]:
        """Signed, world units, one a piece of surface; negative inside. The leaf's own is the
        greatest."""
        return [self.distance(piece) for piece in range(self.piece_count)]

    @property
    def piece_count(self) -> int:
        return {"block": 6, "cylinder": 3, "cone": 3}.get(self._leaf.kind, 1)

    def distance(self, piece: int) -> float:
        """Signed, world units: the local one by the stretch along the normal."""
        slope = float(np.linalg.norm(self._leaf.local_linear.T @ self._local_normal(piece)))
        return self._local_distance(piece) / slope

    def normal(self, piece: int) -> np.ndarray:
        """(3,) outward unit normal of the leaf, world."""
        normal = self._leaf.local_linear.T @ self._local_normal(piece)
        return normal / np.linalg.norm(normal)

    def _rounded(self, whole: fmpz, degree: int = 1) -> float:
        return quotient(whole, self._unit**degree)

    def _plane(self, piece: int) -> tuple[int, int]:
        """Axis and side, ±1, of a plane piece."""
        if self._leaf.kind == "block":
            return piece // 2, 1 if piece % 2 else -1
        return 2, -1 if piece == 1 else 1

    def _is_plane(self, piece: int) -> bool:
        return self._leaf.kind == "block" or piece > 0

    def _local_distance(self, piece: int) -> float:
        kind = self._leaf.kind
        a, b, c = (size * self._scale for size in self._leaf.sizes)
        x, y, z = self._x, self._y, self._z
        if self._is_plane(piece):
            axis, side = self._plane(piece)
            half = {"block": (a, b, c)[axis], "cylinder": b, "cone": c}[kind]
            return self._rounded(side * (x, y, z)[axis] - half)
        rho2 = x * x + y * y
        rho = math.hypot(self.local[0], self.local[1])
        if kind == "sphere":
            length = math.hypot(rho, self.local[2])
            return self._rounded(rho2 + z * z - a * a, 2) / (length + self._rounded(a))
        if kind == "cylinder":
            return self._rounded(rho2 - a * a, 2) / (rho + self._rounded(a))
        if kind == "cone":  # (ρ − |w|)·cos of the half angle
            w = (a + b) * c + (b - a) * z  # times 2c
            width = abs(quotient(w, 2 * c * self._unit))
            residual = quotient(4 * c * c * rho2 - w * w, 4 * c * c * self._unit**2)
            off = residual / (rho + width) if residual else 0.0
            return off / math.hypot(1, quotient(b - a, 2 * c))
        # ((ρ − R)² + z² − r²)·((ρ + R)² + z² − r²) is the quartic; the second factor has no
        # cancellation, for R ≥ r.
        k = rho2 + z * z + a * a - b * b
        residual = self._rounded(k * k - 4 * a * a * rho2, 4)
        major, minor = self._rounded(a), self._rounded(b)
        other = self._rounded(k, 2) + 2 * major * rho
        from_circle = math.hypot(rho - major, self.local[2])
        return residual / (other * (from_circle + minor)) if residual else 0.0

    def _local_normal(self, piece: int) -> np.ndarray:
        """Unit, local; along z where the surface has none (an apex, a centre)."""
        x, y, z = self.local
        normal = np.zeros(3)
        if self._is_plane(piece):
            axis, side = self._plane(piece)
            normal[axis] = side
            return normal
        kind = self._leaf.kind
        rho = math.hypot(x, y)
        cosine, sine = (x / rho, y / rho) if rho > 0 else (0.0, 0.0)
        if kind == "sphere":
            normal[:] = x, y, z
        elif kind == "cylinder":
            normal[:] = cosine, sine, 0
        elif kind == "cone":
            a, b, c = self._leaf.sizes
            normal[:] = cosine, sine, -quotient(b - a, 2 * c)
        else:
            major = quotient(self._leaf.sizes[0], self._leaf.denominator)
            normal[:] = (rho - major) * cosine, (rho - major) * sine, z
        length = math.hypot(*normal)
        return normal / length if length > 0 else np.array([0.0, 0.0, 1.0])
