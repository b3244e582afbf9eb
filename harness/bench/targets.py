"""What was to be reached, set before it was measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from harness.bench.entries import Bench, Entry
from harness.statistics import Estimate

Measured = tuple[Entry, Estimate]  # whose it is, and the figure


@dataclass(frozen=True)
class Target:
    model: str
    words: str
    sign: str  # ≥ or ≤
    bar: float
    measure: Callable[[Bench], Measured | None]

    def is_met(self, figure: Estimate) -> bool:
        """By the median."""
        return figure.median >= self.bar if self.sign == "≥" else figure.median <= self.bar

    def verdict(self, measured: Measured | None) -> str:
        if measured is None:
            return "not measured"
        return "met" if self.is_met(measured[1]) else "not met"


def _faster_than_povray(model: str, peer: str | None = None) -> Callable[[Bench], Measured | None]:
    def measure(b: Bench) -> Measured | None:
        ours, theirs = b.winner(model), b.povray(model, peer=peer)
        return (ours, ours.times(theirs)) if ours and theirs else None

    return measure


def _of_embrees_time(
    ours: Callable[[Bench], Entry | None], mesh_of: str
) -> Callable[[Bench], Measured | None]:
    def measure(b: Bench) -> Measured | None:
        mine, theirs = ours(b), b.embree(mesh_of)
        return (mine, theirs.times(mine)) if mine and theirs else None

    return measure


def _of_manifolds_time(model: str) -> Callable[[Bench], Measured | None]:
    def measure(b: Bench) -> Measured | None:
        ours, theirs = b.winner(model), b.embree(model)
        if not ours or not theirs or not theirs.result.mesh_s:
            return None
        mesh_s = theirs.result.mesh_s
        return ours, ours.result.build_s.map(lambda build_s: build_s / mesh_s)

    return measure


def _gain_by_threads(model: str) -> Callable[[Bench], Measured | None]:
    def measure(b: Bench) -> Measured | None:
        one = b.winner(model)
        several = one and b.on_all_threads(one)
        if not several or several.threads == 1:
            return None
        return several, several.times(one).map(lambda gain: gain / several.threads)

    return measure


def _targets() -> list[Target]:
    targets = []
    # model, its mesh, of Embree's time in double and in float, times POV-Ray's best, scalar
    for model, mesh_of, double, single, povray, scalar in (
        ("ball", "ball", 0.25, 0.16, 300, 1.2),
        ("ngk", "ngk", 0.70, 0.50, 8, 2.0),
        ("ngkcut", "ngk", 0.70, 0.50, 60, None),
    ):
        mesh = "the 64-segment mesh" + (f" of {mesh_of}" if mesh_of != model else "")
        embree = f"time / Embree's, 16 rays on {mesh}"
        targets += [
            Target(model, "times as fast as POV-Ray's best", "≥", povray,
                   _faster_than_povray(model)),
            Target(model, f"{embree}, float64", "≤", double,
                   _of_embrees_time(lambda b, m=model: b.winner(m), mesh_of)),
            Target(model, f"{embree}, float32", "≤", single,
                   _of_embrees_time(lambda b, m=model: b.winner(m, "float32"), mesh_of)),
            *([Target(model, f"{embree}, one ray at a time, float64", "≤", scalar,
                      _of_embrees_time(lambda b, m=model: b.scalar(m), mesh_of))]
              if scalar else []),
            Target(model, "build / Manifold's time to make the mesh", "≤", 0.10,
                   _of_manifolds_time(model)),
            Target(model, "times as fast on all threads / their number: 1.9 on two", "≥", 0.95,
                   _gain_by_threads(model)),
        ]  # fmt: skip
    flat = Target("ngkcut", "times as fast as POV-Ray, flat", "≥", 800,
                  _faster_than_povray("ngkcut", "POV-Ray, flat"))  # fmt: skip
    return [*targets, flat]


TARGETS = _targets()
