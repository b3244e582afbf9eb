"""X3: tori from thin to self-touching, grazed outside, inside, on top and at two points at once."""

from __future__ import annotations

import numpy as np

import tracers
from harness.stability import Finding, Findings, row
from harness.stability.exact_torus import Torus
from harness.stability.judged import Tally, chunks, frames, leaf_tree, near_one, powers, unit
from harness.stability.quadrics import REACH, Aim, backed

_TREES = 16  # tori drawn a case


def _circle(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) unit vectors across the axis and along the circle; a quarter of them the x axis."""
    turn = rng.uniform(0, 2 * np.pi, n) * (rng.random(n) < 0.75)
    out = np.stack([np.cos(turn), np.sin(turn), np.zeros(n)], axis=1)
    return out, np.stack([-out[:, 1], out[:, 0], np.zeros(n)], axis=1)


def _slanted(rng: np.random.Generator, n: int) -> np.ndarray:
    """(n, 1) slopes, a quarter of them 0."""
    return rng.normal(size=(n, 1)) * powers(rng, -3, 1, (n, 1)) * (rng.random((n, 1)) < 0.75)


_UP = np.array([0.0, 0.0, 1.0])


def outer(rng: np.random.Generator, major: float, minor: float, n: int) -> Aim:
    """Past the equator at (R + r)(1 ± 1e-16..1e-1)."""
    out, tangent = _circle(rng, n)
    return (major + minor) * near_one(rng, -16, -1, (n, 1)) * out, tangent + _slanted(rng, n) * _UP


def inner(rng: np.random.Generator, major: float, minor: float, n: int) -> Aim:
    """Through the hole, R − r from the axis but for ± 1e-16..1e-1 of R or of r."""
    out, tangent = _circle(rng, n)
    off = rng.choice([major, minor], (n, 1)) * powers(rng, -16, -1, (n, 1))
    distance = major - minor + rng.choice([-1, 1], (n, 1)) * off
    return distance * out, _UP + _slanted(rng, n) * tangent


def top(rng: np.random.Generator, major: float, minor: float, n: int) -> Aim:
    """In the plane that lies on top, z = r(1 ± 1e-16..1e-1), or nearly in it."""
    out, tangent = _circle(rng, n)
    point = major * rng.uniform(0, 1.2, (n, 1)) * out
    point += minor * near_one(rng, -16, -1, (n, 1)) * _UP
    tilt = minor / major * powers(rng, -16, -1, (n, 1)) * rng.choice([0, 1], (n, 1))
    return point, tangent + rng.normal(size=(n, 1)) * out + tilt * _UP


def bitangent(rng: np.random.Generator, major: float, minor: float, n: int) -> Aim:
    """Touching the tube on both sides of the hole: from below one to above the other, and the lines
    of Villarceau's planes."""
    out, tangent = _circle(rng, n)
    sine = np.minimum(minor / major * near_one(rng, -16, -1, (n, 1)), 1)
    plane = out * np.sqrt(1 - sine**2) + sine * _UP  # of slope r/R, through the centre
    circle = tangent * minor * rng.choice([0, 1, 1], (n, 1)) * near_one(rng, -16, -1, (n, 1))
    across = np.where(rng.random((n, 1)) < 0.5, plane, plane + tangent * rng.normal(size=(n, 1)))
    return circle, across


def tangent(rng: np.random.Generator, major: float, minor: float, n: int) -> Aim:
    """Touching anywhere, off by 1e-16..1e-1 of r."""
    out, along = _circle(rng, n)
    turn = rng.uniform(0, 2 * np.pi, (n, 1))
    normal = np.cos(turn) * out + np.sin(turn) * _UP
    across = -np.sin(turn) * out + np.cos(turn) * _UP
    off = minor * near_one(rng, -16, -1, (n, 1))
    mix = rng.uniform(0, 2 * np.pi, (n, 1))
    return major * out + off * normal, np.cos(mix) * along + np.sin(mix) * across


def through(rng: np.random.Generator, major: float, minor: float, n: int) -> Aim:
    """At the tube, at any angle."""
    out, _ = _circle(rng, n)
    return major * out + minor * rng.normal(size=(n, 3)), frames(rng, n)[:, 0]


_AIMS = (outer, inner, top, bitangent, tangent, through)
# log10 of R/r, or of R/r − 1
_SHAPES = {
    "R/r to 3": lambda rng: rng.uniform(1, 3),
    "R/r to 1e6": lambda rng: powers(rng, 0.5, 6, ()),
    "R/r to 1+1e-9": lambda rng: 1 + powers(rng, -9, -1, ()),
    "R = r": lambda rng: 1.0,
}


@row("X3", "torus: grazed from far, thin to self-touching", tests=130_000, full=10_000_000)
def tori(n: int, rng: np.random.Generator) -> Findings:
    for precision, (farthest, scales) in REACH.items():
        seconds = rays = 0
        for shape, ratio in _SHAPES.items():
            tally = Tally()
            for _, count in chunks(n // (2 * len(_SHAPES)), _TREES):
                major = float(powers(rng, -scales, scales, ()))
                torus = Torus(major, major / ratio(rng))
                parts = [len(part) for part in np.array_split(np.empty(count), len(_AIMS))]
                aims = [aim(rng, *torus.size[:2], k) for aim, k in zip(_AIMS, parts, strict=True)]
                point, along = (np.concatenate(part) for part in zip(*aims, strict=True))
                lines = backed(rng, (point, unit(along)), torus.radius, farthest)
                tally.judge(torus, *lines, {"precision": precision})
            yield tally.finding("X3", f"torus, {shape}, {precision}", 4)
            seconds, rays = seconds + tally.seconds, rays + tally.rays
        yield Finding(
            "X3", f"torus, {precision}", rays, "time, ns a ray", 1e9 * seconds / rays, np.inf
        )
    yield _spindles(rng)


def _spindles(rng: np.random.Generator) -> Finding:
    """R < r would cross itself: refused, in words that say so."""
    ratios = np.concatenate([1 - powers(rng, -15, -0.01, 1000), powers(rng, -9, 0, 1000) / 2])
    accepted = 0
    for ratio in ratios:
        try:
            leaf_tree("torus", np.array([ratio, 1.0, 0.0]))
            accepted += 1
        except tracers.ModelError as error:
            accepted += not ("torus" in str(error) and "major radius" in str(error))
    return Finding("X3", "torus, R < r", len(ratios), "not refused by name", None, None, accepted)
