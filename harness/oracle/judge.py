"""A tracer's hits against the oracle's answers.

A hit agrees if it lies on the right boundary, within a guard, and names the right leaf. What does
not is excused only where the oracle's own crossings say that rounding may decide: two of them, or
one and an end of the ray, less than 2·bb apart (the hit rule's band), or a surface that the ray
grazes within the guard:

- edge       the leaf is right, and from the true boundary to the hit the ray is nowhere farther
             than the guard from that leaf: one face was hit, the next, grazed, is as near;
- thin       a leaf's crossings are missed, and between them the ray is nowhere farther than the
             guard from its surface: E times the condition is more than the leaf is thick;
- neighbour  another leaf, to whose surface the ray comes within the guard inside the band, as far
             as rule 6 looks.

All else is unexcused.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from harness.oracle.leaf import Line
from harness.oracle.solid import Answer, Crossing, ExactSolid, is_ray
from harness.oracle.surface import SurfacePoint

GUARD = 4.0  # in E: a flip is excused only if the certified clearance is less
_BAND = 16.0  # in E, at a right angle
_U = 2.0**-53
#: Of a precision: what its kernels add to u, relative to the primitive (the way there is in
#: double), and the cosine up to which bands excuse. Fixed here: the tracers' own limits are theirs.
_SINGLE = {"float64": 0.0, "float32": 2.0**-24}
_LEAST_COSINE = {"float64": 2.0**-10, "float32": 2.0**-5}


class Verdict(StrEnum):
    AGREE = "agree"
    EXCUSED = "excused"
    FLIP = "flip"  # hit against miss, or a hit on a wrong boundary
    WRONG_LEAF = "wrong_leaf"


@dataclass(frozen=True)
class Judgement:
    verdict: Verdict
    raw: Verdict  # before excuses
    reason: str = ""  # of the excuse
    error: float = math.nan  # distance from the true surface, in E of the leaf; not of flips
    normal_deg: float = math.nan  # angle to the true normal, where boundary and leaf agree


class Judge:
    """One ray, its answer, and the yardsticks that belong to them."""

    def __init__(self, solid: ExactSolid, answer: Answer, ray: np.ndarray, precision: str) -> None:
        self.solid, self.answer, self.ray = solid, answer, ray
        self.single, self.least_cosine = _SINGLE[precision], _LEAST_COSINE[precision]
        self.line = Line(ray)
        self.speed = math.hypot(*ray[3:6])
        size = solid.tree.size
        unit = _U * (math.hypot(*ray[:3]) + size) + self.single * size
        self.band = _BAND * unit / self.speed

    def unit(self, leaf: int) -> float:
        """E of the leaf, world units: u·(|o| + size)·condition, o from its centre. The roundings of
        its decimals, if any, count by its distance from the world's origin."""
        solid, centre = self.solid, self.solid.centres[leaf]
        away = math.hypot(*(self.ray[:3] - centre)) + solid.reach[leaf]
        if solid.is_rounded:
            away += math.hypot(*centre)
        return (_U * away + self.single * solid.reach[leaf]) * solid.condition[leaf]

    def point(self, leaf: int, t: float) -> SurfacePoint:
        return SurfacePoint(self.solid.leaf(leaf), self.line, t)

    def clearance(self, leaf: int, t: float) -> float:
        """Distance of the ray's point from the leaf's surface, in E of the leaf, signed."""
        return max(self.point(leaf, t).distances()) / self.unit(leaf)

    def cosine(self, crossing: Crossing, guard: float = 0.0) -> float:
        """Of the angle at which the ray meets the surfaces there: the least. `guard`, in E, is how
        near a further piece of a leaf that changes may be to be met as well."""
        cosines = []
        for change in crossing.changes:
            point, met = self.point(change.leaf, crossing.t), {*change.pieces}
            if guard and point.piece_count > 1:
                near = guard * self.unit(change.leaf)
                met |= {i for i, off in enumerate(point.distances()) if abs(off) <= near}
            cosines += [abs(point.normal(piece) @ self.ray[3:6]) / self.speed for piece in met]
        return min(cosines)

    def wide_band(self, crossing: Crossing) -> float:
        """bb of the hit rule, in t. At an edge, within the guard, it may be that of either face."""
        return self.band / max(self.cosine(crossing, GUARD), self.least_cosine)

    # --- Judging --------------------------------------------------------------------------------

    def judge(self, t: float, leaf: int, normal: np.ndarray) -> Judgement:
        truth = self.answer.hit
        if truth is None and leaf < 0:
            return Judgement(Verdict.AGREE, Verdict.AGREE)
        error = angle = math.nan
        if truth is not None and leaf >= 0:
            error, angle, on_boundary = self._compare(truth, t, normal)
            if on_boundary and leaf in self.answer.decisive:
                return Judgement(Verdict.AGREE, Verdict.AGREE, "", error, angle)
            if on_boundary:
                tie = "tie" if leaf in self.answer.leaves else ""
                reason = tie or self._near_tie(truth.t) or self._grazed_near(truth.t)
                reason = reason or self._neighbour(truth, leaf)
                verdict = Verdict.EXCUSED if reason else Verdict.WRONG_LEAF
                return Judgement(verdict, Verdict.WRONG_LEAF, reason, error)
        reason = self._excuse_of_flip(truth, t, leaf) or self._edge(truth, t, leaf)
        return Judgement(Verdict.EXCUSED if reason else Verdict.FLIP, Verdict.FLIP, reason)

    def _compare(self, truth: Crossing, t: float, normal: np.ndarray) -> tuple[float, float, bool]:
        """Surface error in E, angle in degrees, and whether t lies on this very boundary: as near
        along the ray as the guard allows, or, where the ray grazes, with all between within the
        guard and the normal on the right side. (The far side of a ball is on its surface, too.)"""
        speed, direction = self.speed, self.ray[3:6]
        faces_ray = (normal @ direction < 0) == truth.inside
        places = [truth.t + (t - truth.t) * share for share in (0.25, 0.5, 0.75)]
        found, angles = [], []
        for change in truth.changes:
            unit = self.unit(change.leaf)
            here, exact = self.point(change.leaf, t), self.point(change.leaf, truth.t)
            # The guard of a badly conditioned leaf may be wider than the leaf.
            of_leaf = [c for c in self.answer.crossings if change.leaf in c.leaves]
            is_nearest = min(of_leaf, key=lambda c: abs(c.t - t)) is truth
            for piece in change.pieces:
                error = abs(here.distance(piece)) / unit
                cosine = max(abs(exact.normal(piece) @ direction) / speed, self.least_cosine)
                on_boundary = error <= GUARD and (
                    (is_nearest and abs(t - truth.t) * speed * cosine <= 2 * GUARD * unit)
                    or (
                        faces_ray
                        and all(
                            abs(self.point(change.leaf, at).distance(piece)) <= GUARD * unit
                            for at in places
                        )
                    )
                )
                found.append((not on_boundary, error))
            # At an edge, within the guard, any of the faces' normals is right; the leaf's normal
            # points out of the solid if leaf and solid change alike.
            sign = 1.0 if change.inside == truth.inside else -1.0
            near = [
                min(map(abs, pair))
                for pair in zip(here.distances(), exact.distances(), strict=True)
            ]
            angles += [
                _angle_deg(sign * exact.normal(piece), normal)
                for piece, off in enumerate(near)
                if off <= GUARD * unit
            ]
        elsewhere, error = min(found)
        return error, min(angles, default=math.nan), not elsewhere

    # --- Excuses --------------------------------------------------------------------------------

    def _excuse_of_flip(self, truth: Crossing | None, t: float, leaf: int) -> str:
        """Why rounding may have decided, or nothing. The discrepancy is at the earlier of the two
        boundaries; and what the tracer hit must be a surface in any case."""
        if leaf >= 0 and not self._is_on_surface(leaf, t):
            return ""
        if truth is None or (leaf >= 0 and t < truth.t):
            following = [c.t for c in self.answer.crossings if c.low > t]
            places = [t, *((t + x) / 2 for x in following[:1])]
            return self._near_tie(t) or self._grazed_at(places)
        return self._near_tie(truth.t) or self._grazed_near(truth.t) or self._thin(truth)

    def _thin(self, crossing: Crossing) -> str:
        """A leaf that changes there and again so soon that the ray, in between, is nowhere farther
        than the guard from its surface: rounding may lose both. Few leaves are, but under a
        transform of a high condition."""
        for leaf in crossing.leaves:
            for other in self.answer.crossings:
                if other is crossing or leaf not in other.leaves:
                    continue
                between = np.linspace(crossing.t, other.t, 9)
                if all(abs(self.clearance(leaf, at)) <= GUARD for at in between):
                    return "thin"
        return ""

    def _edge(self, truth: Crossing | None, t: float, leaf: int) -> str:
        if truth is None or leaf not in self.answer.decisive:
            return ""
        between = np.linspace(truth.t, t, 9)
        return "edge" if all(abs(self.clearance(leaf, at)) <= GUARD for at in between) else ""

    def _neighbour(self, truth: Crossing, leaf: int) -> str:
        band = truth.t + np.linspace(0, 1, 65) * self.wide_band(truth)
        return "neighbour" if any(abs(self.clearance(leaf, at)) <= GUARD for at in band) else ""

    def _is_on_surface(self, leaf: int, t: float) -> bool:
        """Within the guard, or in a band with a crossing of it (rule 6 looks as far)."""
        if not 0 <= leaf < len(self.solid.kinds):
            return False
        if abs(self.clearance(leaf, t)) <= GUARD:
            return True
        near = [
            (c, 2 * self.wide_band(c)) for c in self.answer.crossings if self._could_matter(c, t)
        ]
        # The band is that of the boundary hit, which may be another leaf's.
        reach = max((bb for c, bb in near if abs(c.t - t) <= bb), default=0.0)
        return any(leaf in c.leaves and abs(c.t - t) <= reach for c, _ in near)

    def _near_tie(self, t: float) -> str:
        """A gap between crossings, or between one and an end of the ray, of less than 2·bb at t."""
        crossings = self.answer.crossings
        bands = [self.wide_band(c) if self._could_matter(c, t) else 0.0 for c in crossings]
        for i, (c, bb) in enumerate(zip(crossings, bands, strict=True)):
            if abs(c.t - t) > 2 * bb:
                continue
            if abs(c.t - self.ray[6]) < 2 * bb:
                return "start"
            if abs(c.t - self.ray[7]) < 2 * bb:
                return "end"
            for j in (i - 1, i + 1):
                if 0 <= j < len(crossings) and abs(crossings[j].t - c.t) < 2 * max(bb, bands[j]):
                    return "gap"
        return ""

    def _could_matter(self, crossing: Crossing, t: float) -> bool:
        return abs(crossing.t - t) <= 8 * self.band / self.least_cosine

    def _grazed_near(self, t: float) -> str:
        """The middles of the intervals between crossings on both sides of a boundary that was
        missed, and of the solid's and the leaves' spans that begin or end there."""
        crossings = self.answer.crossings
        here = min(range(len(crossings)), key=lambda i: abs(crossings[i].t - t))
        others = {here - 1, here + 1}
        for leaf in crossings[here].leaves:
            changing = [i for i, c in enumerate(crossings) if leaf in c.leaves]
            k = changing.index(here)
            others.update(changing[max(0, k - 1) : k + 2])
        solid = [
            i
            for i in range(here + 1, len(crossings))
            if crossings[i].inside != crossings[here].inside
        ]
        others.update(solid[:1])
        ends = [crossings[i].t for i in others if 0 <= i < len(crossings) and i != here]
        start = float(self.ray[6])
        if crossings[here].t > start > -math.inf:
            ends.append(start)
        return self._grazed_at(
            [crossings[here].t, *((crossings[here].t + end) / 2 for end in ends)]
        )

    def _grazed_at(self, places: Iterable[float]) -> str:
        """A leaf within the guard of its surface, where no crossing of it explains that."""
        for t in places:
            for leaf in self.solid.candidates(self.ray):
                distances = self.point(leaf, t).distances()
                piece = int(np.argmax(distances))
                if abs(distances[piece]) > GUARD * self.unit(leaf):
                    continue
                if not self._crosses_near(leaf, piece, t):
                    return "grazing"
        return ""

    def _crosses_near(self, leaf: int, piece: int, t: float) -> bool:
        """Whether the ray crosses this piece of the leaf's surface, and does not graze it, so near
        that its distance there is small. A cap that is crossed explains no nearness to the side."""
        for crossing in self.answer.crossings:
            if (
                not any(c.leaf == leaf and piece in c.pieces for c in crossing.changes)
                or (cosine := self.cosine(crossing)) <= self.least_cosine
            ):
                continue
            if abs(crossing.t - t) * self.speed * cosine <= 4 * GUARD * self.unit(leaf):
                return True
        return False


def judge(
    solid: ExactSolid,
    answer: Answer,
    ray: np.ndarray,
    t: float,
    leaf: int,
    normal: np.ndarray,
    precision: str = "float64",
) -> Judgement:
    """A tracer's hit (leaf -1 for a miss) against the oracle's answer for the same ray, (8,)."""
    if not answer.crossings and leaf < 0:
        return Judgement(Verdict.AGREE, Verdict.AGREE)
    if leaf >= 0 and not (is_ray(ray) and math.isfinite(t)):
        return Judgement(Verdict.FLIP, Verdict.FLIP)
    return Judge(solid, answer, ray, precision).judge(t, leaf, normal)


def _angle_deg(a: np.ndarray, b: np.ndarray) -> float:
    """Between unit vectors; exact for small angles, too."""
    return math.degrees(2 * math.asin(min(1.0, float(np.linalg.norm(a - b)) / 2)))
