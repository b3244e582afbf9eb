"""Truth for tori, as in exact.py: the sign of g between the critical points of the quartic."""

from __future__ import annotations

import numpy as np

from harness.stability.exact import GUARD, Long, at, dot, nearest, norm


class Torus:
    """Around z; g(p) = hypot(ρ − R, z) − r. A line crosses it where g changes sign between the
    critical points of the quartic, which has the sign of g."""

    kind = "torus"

    def __init__(self, major: float, minor: float):
        self.size = np.array([major, minor, 0.0])
        self._major, self._minor = Long(major), Long(minor)

    @property
    def radius(self):
        return self.size[0] + self.size[1]

    def depth(self, p):
        rho = np.hypot(p[:, 0], p[:, 1])
        return np.hypot(rho - self._major, p[:, 2]) - self._minor

    def normal(self, p):
        rho = np.hypot(p[:, 0], p[:, 1])
        s = (rho - self._major) / np.where(rho > 0, rho, 1)
        n = p * np.stack([s, s, np.ones_like(s)], axis=1)
        return n / norm(n)[:, None]

    def critical_points(self, o, d):
        """(N, 3) ascending, in the line's parameter; nan where there are fewer."""
        shift, speed = nearest(o, d), norm(d)
        q, e = at(o, d, shift) / self._major, d / speed[:, None]
        ratio = self._minor / self._major
        flat = 1 - e[:, 2] * e[:, 2]
        p3 = dot(q, q) + (1 - ratio) * (1 + ratio) - 2 * flat
        q3 = -2 * (q[:, 0] * e[:, 0] + q[:, 1] * e[:, 1])
        roots = _cubic(p3, q3)
        return shift[:, None] + roots * (self._major / speed)[:, None]

    def flips(self, rays, count, t):
        """(N,) bool each: where the roots are not one at each change of sign along the critical
        points; and where those are right, and the middles of the claimed spans and gaps, that lie
        farther from the surface than the guard."""
        o, d, guard = rays.o, rays.d, GUARD * rays.E

        def g(s):
            return np.where(np.isfinite(s), self.depth(at(o, d, np.where(np.isfinite(s), s, 0))), 0)

        wrong, clear = count % 2 != 0, count % 2 == 0
        expected, last = np.zeros(len(o), int), np.zeros(len(o), bool)
        for s in self.critical_points(o, d).T:
            depth, claimed = g(s), (t < s[:, None]).sum(axis=1) % 2 == 1
            inside = np.where(np.isnan(s), last, depth < 0)
            expected += inside != last
            wrong |= ~np.isnan(s) & (claimed != inside)
            clear &= (claimed == inside) | (np.abs(depth) < guard)
            last = inside
        wrong |= count != expected + last
        for i in range(3):
            with np.errstate(invalid="ignore"):
                depth = g((t[:, i] + t[:, i + 1]) / 2)
            clear &= depth * (-1) ** i < guard
        return wrong, wrong & clear


def _cubic(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """(N, 3) real roots of s³ + p·s + q, ascending, nan where there are fewer."""
    third, half = p / 3, q / 2
    discriminant = half * half + third**3
    three = discriminant < 0
    u = np.cbrt(-half - np.copysign(np.sqrt(np.maximum(discriminant, 0)), half))
    single = np.where(u == 0, 0, u - third / np.where(u == 0, 1, u))
    scale = np.sqrt(np.maximum(-third, 0))
    cosine = np.clip(-half / np.where(scale > 0, scale, 1) ** 3, -1, 1)
    angle = np.arccos(cosine) / 3
    turns = 2 * np.arccos(Long(-1)) / 3 * np.array([1, -1, 0], Long)
    roots = 2 * scale[:, None] * np.cos(angle[:, None] + turns)
    roots = np.where(three[:, None], roots, np.stack([single, single * np.nan, single * np.nan], 1))
    for _ in range(2):
        slope = 3 * roots**2 + p[:, None]
        value = (roots**2 + p[:, None]) * roots + q[:, None]
        roots = roots - np.where(slope == 0, 0, value / np.where(slope == 0, 1, slope))
    return np.sort(roots, axis=1)
