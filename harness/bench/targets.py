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
    short: str
    sign: str  # ≥ or ≤
    bar: float
    measure: Callable[[Bench], Measured | None]

    @property
    def shown(self) -> str:
        return f"{self.sign} {self.bar:g}"

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
    # Model, its mesh; of Embree's time: in double, in float, in double one ray at a time; times
    # POV-Ray's best.
    for model, mesh_of, double, single, scalar, povray in (
        ("ball", "ball", 0.25, 0.16, 1.2, 300),
        ("ngk", "ngk", 0.70, 0.50, 2.0, 8),
        ("ngkcut", "ngk", 0.70, 0.50, None, 60),
    ):
        mesh = "the mesh" if mesh_of == model else f"the mesh of {mesh_of}"
        embree = f"time / Embree's on {mesh}, 16 rays at once"
        of_embree = [
            ("float64", double, lambda b, m=model: b.winner(m)),
            ("float32", single, lambda b, m=model: b.winner(m, "float32")),
            ("one ray at a time", scalar, lambda b, m=model: b.scalar(m)),
        ]
        targets += [
            Target(model, "times as fast as POV-Ray's best", "POV-Ray", "≥", povray,
                   _faster_than_povray(model)),
            *(Target(model, f"{embree}: ours {how}", f"Embree, {how}", "≤", bar,
                     _of_embrees_time(ours, mesh_of))
              for how, bar, ours in of_embree if bar),
            Target(model, "build / Manifold's time to make the mesh", "Manifold", "≤", 0.10,
                   _of_manifolds_time(model)),
            Target(model, "gain by all threads / their number; 0.95 is 1.9 on two", "threads",
                   "≥", 0.95, _gain_by_threads(model)),
        ]  # fmt: skip
    flat = Target("ngkcut", "times as fast as POV-Ray, flat", "POV-Ray, flat", "≥", 800,
                  _faster_than_povray("ngkcut", "POV-Ray, flat"))  # fmt: skip
    return [*targets, flat]


TARGETS = _targets()
