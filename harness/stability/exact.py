"""Truth for the rows on single primitives: surfaces, root counts and clearances.

All in numpy's longdouble, which must carry 64 bits: residuals are good to E/1000 of float64. Signs
are wrong only where less than that is left, deep within the guard of 4 E, so no ray needs more; the
tests hold this against rationals. Lines are given in the primitive's frame, o + s·d, both (N, 3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Long = np.longdouble
UNIT_ROUNDOFF = {"float64": 2.0**-53, "float32": 2.0**-24}
GUARD = 4  # in E: a flip is excused where less clearance is left


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (a * b).sum(axis=-1)


def norm(a: np.ndarray) -> np.ndarray:
    return np.sqrt(dot(a, a))


def nearest(o: np.ndarray, d: np.ndarray) -> np.ndarray:
    """(N,) parameter of the line's point nearest 0. The second step takes off the first's error."""
    dd = dot(d, d)
    s = -dot(o, d) / dd
    return s - dot(o + s[:, None] * d, d) / dd


def at(o: np.ndarray, d: np.ndarray, s: np.ndarray) -> np.ndarray:
    return o + s[:, None] * d


@dataclass(frozen=True)
class Rays:
    """Lines as the kernels get them, and the same in extended precision."""

    rows: np.ndarray  # (N, 8)
    o: np.ndarray
    d: np.ndarray
    E: np.ndarray  # (N,) model units

    @classmethod
    def of(cls, origin: np.ndarray, dir: np.ndarray, radius: float, precision: str) -> Rays:
        rows = np.empty((len(origin), 8))
        rows[:, :3], rows[:, 3:6], rows[:, 6], rows[:, 7] = origin, dir, 0, np.inf
        E = UNIT_ROUNDOFF[precision] * (np.linalg.norm(origin, axis=1) + radius)
        return cls(rows, rows[:, :3].astype(Long), rows[:, 3:6].astype(Long), E)


class Convex:
    """A convex primitive around 0 of sizes as in tracers/csg/csg_tree.hpp."""

    kind: str

    def __init__(self, *size: float):
        self.size = np.array([*size, 0, 0][:3], float)
        self._long = self.size.astype(Long)

    @property
    def radius(self) -> float:
        """Distance of the farthest point from the centre: the `size` in E."""
        raise NotImplementedError

    def faces(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Signed distances (K, N) from the surfaces, of which the largest is that from the solid,
        and their unit gradients (K, N, 3)."""
        raise NotImplementedError

    def enters(self, o: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(N,) whether the line meets the interior, and (N, K) parameters of points on it, the
        first where it is deepest within the sides; not all need be inside, nor finite."""
        raise NotImplementedError

    def support(self, n: np.ndarray) -> np.ndarray:
        """(N,) greatest n·p of the solid."""
        raise NotImplementedError

    def outlines(self, d: np.ndarray) -> list[np.ndarray]:
        """Normals (N, 3) ⟂ d of the surface where it is round."""
        return []

    def depth(self, p: np.ndarray) -> np.ndarray:
        """(N,) signed distance to the surface, to first order; negative inside."""
        return self.faces(p)[0].max(axis=0)

    def normal(self, p: np.ndarray) -> np.ndarray:
        """(N, 3) of the nearest face, outward."""
        distances, gradients = self.faces(p)
        return np.take_along_axis(gradients, distances.argmax(axis=0)[None, :, None], 0)[0]

    def width(self, o: np.ndarray, d: np.ndarray) -> np.ndarray:
        """(N,) an upper bound, tight for small ones, of how far a line must be moved to miss.

        That is support(n) − n·o at the best n ⟂ d; tried are the normals of the faces and, for the
        edges, the combinations of two of them.
        """
        origin = at(o, d, nearest(o, d))
        gradients = self.faces(at(o, d, self.enters(o, d)[1][:, 0]))[1]
        tried = [*gradients, *self.outlines(d)]
        for i, a in enumerate(gradients):
            tried += [dot(b, d)[:, None] * a - dot(a, d)[:, None] * b for b in gradients[:i]]
        least = np.full(len(o), np.inf, Long)
        for n in tried:
            n = n - (dot(n, d) / dot(d, d))[:, None] * d
            length = norm(n)
            n /= np.where(length > 0, length, np.nan)[:, None]
            for side in (n, -n):
                least = np.fmin(least, self.support(side) - dot(side, origin))
        return least

    def flips(self, rays: Rays, count: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(N,) bool each: where the number of roots is wrong, or they do not embrace a point well
        inside; and where that is certainly within the guard."""
        o, d, guard = rays.o, rays.d, GUARD * rays.E
        inside, points = self.enters(o, d)
        wrong = count != np.where(inside, 2, 0)
        for s in points.T:
            finite = np.isfinite(s)
            deep = finite & (self.depth(at(o, d, np.where(finite, s, 0))) < -guard)
            wrong |= deep & ((t[:, 0] > s) | (t[:, 1] < s))
        missed, phantom = wrong & inside, wrong & ~inside & (count == 2)
        excused = np.zeros(len(wrong), bool)
        excused[missed] = self.width(o[missed], d[missed]) < guard[missed]
        # Nor can t tell the ends of a chord apart that reaches no farther than its rounding.
        middle = points[missed, 0]
        reach = guard[missed] / norm(d[missed])
        beyond = [self.depth(at(o[missed], d[missed], middle + k * reach)) > 0 for k in (-1, 1)]
        excused[missed] |= beyond[0] & beyond[1]
        touched = at(o[phantom], d[phantom], t[phantom, 0].astype(Long))
        excused[phantom] = self.depth(touched) < guard[phantom]
        return wrong, excused


class Sphere(Convex):
    kind = "sphere"

    @property
    def radius(self):
        return self.size[0]

    def faces(self, p):
        far = norm(p)
        return (far - self._long[0])[None], (p / far[:, None])[None]

    def enters(self, o, d):
        s = nearest(o, d)
        return norm(at(o, d, s)) < self._long[0], s[:, None]

    def support(self, n):
        return self._long[0] * norm(n)


def _slab(x: np.ndarray, dx: np.ndarray, half: np.longdouble) -> tuple[np.ndarray, np.ndarray]:
    """(N,) where the line enters and leaves |x| ≤ half; lower ≥ upper where it does not."""
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (-half - x) / dx, (half - x) / dx
    within, inf = np.abs(x) < half, Long(np.inf)
    lower = np.where(dx == 0, np.where(within, -inf, inf), np.minimum(a, b))
    upper = np.where(dx == 0, np.where(within, inf, -inf), np.maximum(a, b))
    return lower, upper


class Block(Convex):
    kind = "block"

    @property
    def radius(self):
        return float(np.linalg.norm(self.size))

    def faces(self, p):
        sides = [(sign, i) for i in range(3) for sign in (-1, 1)]
        distances = [sign * p[:, i] - self._long[i] for sign, i in sides]
        gradients = [np.broadcast_to(sign * np.eye(3, dtype=Long)[i], p.shape) for sign, i in sides]
        return np.stack(distances), np.stack(gradients)

    def enters(self, o, d):
        slabs = [_slab(o[:, i], d[:, i], self._long[i]) for i in range(3)]
        enter = np.max([lower for lower, _ in slabs], axis=0)
        leave = np.min([upper for _, upper in slabs], axis=0)
        with np.errstate(invalid="ignore"):
            middle = enter + (leave - enter) / 2
        return self.width(o, d) > 0, middle[:, None]

    def support(self, n):
        return dot(np.abs(n), self._long)

    def width(self, o, d):
        """Exact but for rounding, and negative for a miss: the block's shadow along d is a hexagon,
        whose sides have the normals d × an edge."""
        least = np.full(len(o), np.inf, Long)
        for edge in np.eye(3, dtype=Long):
            n = np.cross(d, edge[None])
            length = norm(n)
            room = (self.support(n) - np.abs(dot(n, o))) / np.where(length > 0, length, np.nan)
            least = np.fmin(least, room)
        return least


class Round(Convex):
    """Around z, between caps at z = ±h: a wall ρ ≤ w(z) = middle + slope·z. ρ − w is convex along
    a line, so its least value between the caps tells whether the line enters."""

    def wall(self) -> tuple[np.longdouble, np.longdouble, np.longdouble]:
        """middle, slope, h."""
        raise NotImplementedError

    def faces(self, p):
        middle, slope, h = self.wall()
        flat, up = p * np.array([1, 1, 0], Long), np.array([0, 0, 1], Long)
        rho, steep = norm(flat), np.sqrt(1 + slope * slope)
        out = (flat / np.where(rho > 0, rho, 1)[:, None] - slope * up) / steep
        up = np.broadcast_to(up, p.shape)
        side = (rho - (middle + slope * p[:, 2])) / steep
        return np.stack([side, -p[:, 2] - h, p[:, 2] - h]), np.stack([out, -up, up])

    def outlines(self, d):
        """(x, y, −slope) ⟂ d: two, but for directions steeper than the wall."""
        slope, up = self.wall()[1], np.array([0, 0, 1], Long)
        flat = d * np.array([1, 1, 0], Long)
        speed = norm(flat)
        with np.errstate(divide="ignore", invalid="ignore"):
            along = slope * d[:, 2] / speed
            across = np.sqrt(1 - along * along)
            ahead = flat / speed[:, None]
        aside = np.cross(up[None], ahead)
        return [
            along[:, None] * ahead + side * across[:, None] * aside - slope * up for side in (1, -1)
        ]

    def enters(self, o, d):
        middle, slope, h = self.wall()
        lower, upper = _slab(o[:, 2], d[:, 2], h)
        flat = np.array([1, 1, 0], Long)
        speed, narrowing = norm(d * flat), slope * d[:, 2]
        along_axis = speed == 0
        across = np.where(along_axis[:, None], flat, d * flat)
        s = np.where(along_axis, 0, nearest(o * flat, across))
        rho = norm(at(o * flat, d * flat, s))
        # From the point nearest the axis to where d(ρ − w)/ds = 0, or for ever.
        a = (speed - np.abs(narrowing)) * (speed + np.abs(narrowing))
        forever = np.where(narrowing == 0, 0, np.copysign(Long(np.inf), narrowing))
        with np.errstate(divide="ignore", invalid="ignore"):
            s = s + np.where(a > 0, narrowing * rho / (speed * np.sqrt(a)), forever)
        s = np.clip(s, lower, upper)
        p = at(o, d, np.where(np.isfinite(s), s, 0))
        inside = norm(p * flat) < middle + slope * p[:, 2]
        with np.errstate(invalid="ignore"):
            points = np.stack([np.where(np.isfinite(s), s, 0), (lower + s) / 2, (s + upper) / 2], 1)
        return inside & (lower < upper), points


class Cylinder(Round):
    kind = "cylinder"

    @property
    def radius(self):
        return float(np.hypot(*self.size[:2]))

    def wall(self):
        return self._long[0], Long(0), self._long[1]

    def support(self, n):
        return self._long[0] * np.hypot(n[:, 0], n[:, 1]) + self._long[1] * np.abs(n[:, 2])


class Cone(Round):
    kind = "cone"

    @property
    def radius(self):
        return float(np.hypot(max(self.size[:2]), self.size[2]))

    def wall(self):
        r0, r1, h = self._long
        return (r0 + r1) / 2, (r1 - r0) / (2 * h), h

    def support(self, n):
        r0, r1, h = self._long
        flat = np.hypot(n[:, 0], n[:, 1])
        return np.maximum(r0 * flat - h * n[:, 2], r1 * flat + h * n[:, 2])
