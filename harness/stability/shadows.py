"""X10: shadow rays that start as the renderer's do. None finds the surface that it left, and none
misses a wall between that surface and the light.

Every primitive, under maps of condition 1 to 1e6 and scales of 1e-3 to 1e3. Its own surface must
not hide a light above the tangent plane; a thin shell around it, a gap away, must hide every light
that is outside, and none in the gap. The rule resolves 18 bands, the start's 16 and one at either
end of the ray, and 4 E times the condition for the surface: gaps below twice that are not tried.
"""

from __future__ import annotations

import itertools

import numpy as np

import tracers
from harness.adversaries.families import DIFFERENCE, UNION, Solid, placed, rotation
from harness.stability import Findings, row
from harness.stability.gaps import SHELLS, inradius
from harness.stability.scenes import (
    BAND,
    GUARD,
    PRECISIONS,
    Tally,
    directions,
    error_unit,
    rays_through,
)

CONDITIONS = (1.0, 1e2, 1e4, 1e6)
SCALES = (1e-3, 0.1, 1.0, 30.0, 1e3)
GAPS = 10.0 ** -np.arange(0, 13, 2)  # of the primitive's size
START = 16  # bands off the surface: rule 12
# In the primitive's frame: an eye, and lights that light what faces them; a torus, too, if they are
# on its axis, for their rays keep to half-planes that it cuts in a circle. GRAZING lights a plane
# or a wall at about 89° to its normal, where it is easiest to hit the surface that was left.
EYE = (1.6, -1.1, 1.3)
FAR = {kind: (0.0, 0.0, 6.0) if kind == "torus" else (3.0, 2.0, 6.0) for kind in SHELLS}
GRAZING = {
    "sphere": (1.1, 0.0, 0.3),
    "block": (4.0, -0.5, 0.52),
    "cylinder": (0.8, -0.2, 6.0),
    "cone": (2.3, -0.2, -4.0),
    "torus": (0.0, 0.0, 0.3),
}


def shadow_starts(tree, rays: np.ndarray, t: np.ndarray, normal: np.ndarray, precision: str):
    """(N, 3) where the renderer starts shadow rays, and (N, 3) the normal on the viewer's side."""
    backwards = (normal * rays[:, 3:6]).sum(axis=1) > 0
    seen = np.where(backwards[:, None], -normal, normal)
    offset = START * BAND * error_unit(tree, rays, precision)
    return rays[:, :3] + t[:, None] * rays[:, 3:6] + offset[:, None] * seen, seen


def segments(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(N, 8) rays with t from 0 to 1."""
    n = len(start)
    return np.column_stack([start, end - start, np.zeros(n), np.ones(n)])


class Body:
    """A primitive under an affine map, alone and in a thin shell of its own shape, a gap away."""

    def __init__(self, kind: str, condition: float, scale: float, rng: np.random.Generator) -> None:
        stretch = rng.permutation([1, condition ** -rng.random(), 1 / condition])
        self.kind, self.condition = kind, condition
        self.linear = scale * rotation(rng) @ np.diag(stretch) @ rotation(rng)
        self.centre = scale * rng.uniform(-1, 1, 3)
        self.thinnest = scale / condition * inradius(kind, SHELLS[kind])

    def leaf(self, solid: Solid, grown: float):
        a, b, c = [*SHELLS[self.kind], 0, 0][:3]
        size = [a if self.kind == "torus" else a * grown, b * grown, c * grown]
        return solid.leaf(self.kind, size, placed(*self.centre, self.linear))

    def at(self, local) -> np.ndarray:
        return self.centre + self.linear @ local

    def alone(self) -> tracers.CsgTree:
        solid = Solid()
        return solid.tree(self.leaf(solid, 1))

    def in_shell(self, gap: float) -> tracers.CsgTree:
        """Hollow from 1 + gap to 1 + 1.5 gap times the size (of a torus: of its minor radius)."""
        solid = Solid()
        shell = [DIFFERENCE, self.leaf(solid, 1 + 1.5 * gap), self.leaf(solid, 1 + gap)]
        return solid.tree([UNION, self.leaf(solid, 1), shell])

    def outward(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(N, 3) from points of the surface straight away from the centre, or a torus' ring, as
        long as the radius there; and (N,) how often this can be done without meeting a torus."""
        local = np.linalg.solve(self.linear, (points - self.centre).T).T
        if self.kind != "torus":
            return points - self.centre, np.full(len(points), np.inf)
        major, minor = SHELLS["torus"]
        ring = local * [1, 1, 0]
        ring *= major / np.linalg.norm(ring, axis=1)[:, None]
        inwards = -((local - ring) * ring).sum(axis=1) / (major * minor)
        with np.errstate(divide="ignore"):
            free = np.where(inwards > 0, major / (minor * np.abs(inwards)) - 1, np.inf)
        return (local - ring) @ self.linear.T, free


def camera_rays(body: Body, tree, rng: np.random.Generator, count: int) -> np.ndarray:
    """(count, 8) rays from outside at points in the body, which bounds of thin ones hardly hold."""
    turn = rng.uniform(0, 2 * np.pi, count)
    ring = SHELLS["torus"][0] * np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    local = ring if body.kind == "torus" else rng.uniform(-0.3, 0.3, (count, 3))
    back = rng.uniform(0.6, 4, count) * tree.size
    return rays_through(body.centre + local @ body.linear.T, directions(rng, count), back)


def guard(tree, rays: np.ndarray, precision: str, condition: float) -> np.ndarray:
    """(N,) model units: what the shadow rule does not resolve."""
    return ((START + 2) * BAND + GUARD * condition) * error_unit(tree, rays, precision)


def own_surface(body: Body, precision: str, rng: np.random.Generator, count: int):
    """(self-hits, rays): lights above the tangent plane of a convex body or of a torus' outer half,
    or straight away from a torus' ring where it is inside."""
    tree = body.alone()
    tracer = tracers.make("naive", tree, {"precision": precision})
    rays = camera_rays(body, tree, rng, count)
    hits = tracer.trace(rays)
    rays, t, normal = (a[hits.leaf == 0] for a in (rays, hits.t, hits.normal))
    start, seen = shadow_starts(tree, rays, t, normal, precision)
    at = rays[:, :3] + t[:, None] * rays[:, 3:6]
    straight, free = body.outward(at)
    far = tree.size * 10.0 ** rng.uniform(-3, 3, (len(at), 1))
    aside = np.cross(seen, directions(rng, len(at)))
    aside /= np.linalg.norm(aside, axis=1)[:, None]
    slope = np.cos(np.deg2rad(rng.choice([0, 30, 60, 80, 89, 89.9], (len(at), 1))))
    light = at + far * (slope * seen + np.sqrt(1 - slope**2) * aside)
    away = np.minimum(0.9 * free, 1e3)[:, None] * rng.random((len(at), 1))
    light = np.where((free < np.inf)[:, None], at + away * straight, light)
    height = ((light - at) * seen).sum(axis=1)
    clear = height > 2 * guard(tree, rays, precision, body.condition)
    return int(tracer.occluded(segments(start, light)[clear]).sum()), int(clear.sum())


def walls(body: Body, gap: float, precision: str, rng: np.random.Generator, count: int):
    """(leaks, blocked in the gap, rays), or nothing if the gap is too narrow."""
    alone, tree = body.alone(), body.in_shell(gap)
    rays = camera_rays(body, tree, rng, count)
    if gap * body.thinnest < 2 * guard(tree, rays, precision, body.condition).max():
        return 0, 0, 0
    numerics = {"precision": precision}
    hits = tracers.make("naive", alone, numerics).trace(rays)
    rays, t, normal = (a[hits.leaf == 0] for a in (rays, hits.t, hits.normal))
    start, seen = shadow_starts(tree, rays, t, normal, precision)
    at = rays[:, :3] + t[:, None] * rays[:, 3:6]
    tracer = tracers.make("naive", tree, numerics)
    around = directions(rng, len(at))
    around *= np.sign((around * seen).sum(axis=1))[:, None]
    outside = tracer.occluded(segments(start, at + 8 * tree.size * around))
    straight, _ = body.outward(at)
    inside = tracer.occluded(segments(start, at + gap / 2 * straight))
    return int((outside == 0).sum()), int(inside.sum()), 2 * len(at)


def seen_from(eye, look_at, side: int, light) -> tracers.View:
    rows = [(*light, 1.0, 1.0, 1.0)]
    up, black = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    return tracers.View(eye, look_at, up, 60, side, side, rows, black, black, (1.0, 1.0, 1.0))


def under_a_roof(scale: float, gap: float) -> tuple[tracers.CsgTree, tuple, tuple, tuple]:
    """A floor, a thin roof a gap above it, an eye between them and a light above: all is dark."""
    solid, extent = Solid(), 3 * scale
    floor = solid.leaf("block", [extent, extent, scale / 2], placed(0, 0, -scale / 2))
    roof = solid.leaf("block", [extent, extent, gap / 4], placed(0, 0, 1.25 * gap))
    light = (0.3 * scale, 0.2 * scale, 2 * scale)
    return solid.tree([UNION, floor, roof]), (0, 0, gap / 2), (1, 0, gap / 2), light


def rendered(precision: str, rng: np.random.Generator, pixels: int) -> Findings:
    """Pictures of which the light is known: dark under a roof; of a lone body, what faces the light
    is lit. And the rule here against the renderer's: the same pixels are lit."""
    side = max(int(np.sqrt(pixels)), 64) // 2 * 2
    dark = Tally("X10", f"render under a roof, {precision}", "pixels lit")
    lone = Tally("X10", f"render of a lone body, {precision}", "pixels lit otherwise")
    rule = Tally("X10", f"this rule and the renderer's, {precision}", "pixels lit otherwise")
    for scale in SCALES:
        for gap in GAPS:
            tree, eye, look_at, light = under_a_roof(scale, scale * gap)
            view = seen_from(eye, look_at, side, light)
            if scale * gap < 4 * guard(tree, view.primary_rays(), precision, 1).max():
                continue
            picture = tracers.make("naive", tree, {"precision": precision}).render(view)
            dark.add(side * side, (picture.lit != 0).sum())
        for kind, far in itertools.product(SHELLS, (False, True)):
            body = Body(kind, 3.0, scale, rng)
            tree = body.alone()
            light = body.at(FAR[kind] if far else GRAZING[kind])
            view = seen_from(tuple(body.at(EYE)), tuple(body.centre), side, tuple(light))
            tracer = tracers.make("naive", tree, {"precision": precision})
            lit, rays = tracer.render(view).lit.ravel(), view.primary_rays()
            hits = tracer.trace(rays)
            hit = hits.leaf >= 0
            start, seen = shadow_starts(tree, rays[hit], hits.t[hit], hits.normal[hit], precision)
            height = ((light - start) * seen).sum(axis=1)
            blocked = tracer.occluded(segments(start, np.broadcast_to(light, start.shape)))
            rule.add(len(rays), ((height > 0) & (blocked == 0) != lit[hit]).sum())
            clear = np.abs(height) > guard(tree, rays[hit], precision, body.condition)
            lone.add(clear.sum(), ((height > 0) != lit[hit])[clear].sum())
    yield from (tally.finding() for tally in (dark, lone, rule))


@row("X10", "shadow rays: self-hits and leaks", tests=200_000, full=8_000_000)
def shadow_rays(rays: int, rng: np.random.Generator) -> Findings:
    share = max(rays // (2 * len(SHELLS) * len(CONDITIONS) * len(SCALES) * (1 + len(GAPS))), 8)
    for precision in PRECISIONS:
        yield from rendered(precision, rng, share)
        for kind in SHELLS:
            for condition in CONDITIONS:
                case = f"{kind}, condition {condition:.0e}, {precision}"
                own = Tally("X10", case, "self-hits")
                leak = Tally("X10", f"{case}, in a shell", "leaks, and lights in the gap lost")
                for scale in SCALES:
                    body = Body(kind, condition, scale, rng)
                    failures, tried = own_surface(body, precision, rng, share)
                    own.add(tried, failures)
                    for gap in GAPS:
                        leaks, lost, tried = walls(body, gap, precision, rng, share)
                        leak.add(tried, leaks + lost)
                # Nothing is decided where E times the condition exceeds the body (float32, 1e6).
                yield from (tally.finding() for tally in (own, leak) if tally.rays)
