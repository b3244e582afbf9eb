"""What is measured: every scheme of the registry on both families at every size, as long as it
finishes."""

from __future__ import annotations

from collections.abc import Callable

from harness import models
from harness.machine import code_version
from harness.schemes import Params, canonical, catalogue, complete
from harness.store import Store
from harness.study import Configuration, Study

NAME = "scale"
FAMILIES = ("ball", "ngk")
SIZES = (1_000, 10_000, 100_000, 1_000_000)
SIDE = 512  # pixels of the square picture
REPEATS = 7
BUDGET_S = 60.0  # no further repeat once build and trace times would add up to more
TIMEOUT_S = 120.0  # for one trial: load, build, trace, trace again to count
SLOW_S = 12.0  # to build and trace; ten times as large it would run into the timeout

# Subdivision by h alone: d is so deep that no cell gets there. At the paper's h of 7 cells divide
# on around what cannot be separated, and ngk takes 3 kB a halfspace.
DEPTH, HALFSPACES = 20, 24
FACETS = 32  # a circle, as in the paper's study
CUTS = 40  # of a binary subdivision: 2⁴⁰ regions


def settings(scheme: str, size: int) -> Params:
    """Of a scheme at a size; what is not named here has its default."""
    declared = {p.name: p for p in catalogue()[scheme].parameters}
    chosen: Params = {"build_threads": 0} if "build_threads" in declared else {}
    if catalogue()[scheme].needs_mesh:
        chosen["segments"] = FACETS
    elif scheme == "uniform_grid":  # about as many voxels a halfspace at every size
        chosen["n"] = round(4 * size ** (1 / 3))
    elif {"d", "h"} <= declared.keys():
        chosen["d"] = CUTS if declared["d"].maximum > 2 * DEPTH else DEPTH
        chosen["h"] = HALFSPACES
    return chosen


def configurations(family: str, size: int, schemes: list[str]) -> list[Configuration]:
    return [
        Configuration(
            f"{family}@{size}", scheme, canonical(complete(scheme, settings(scheme, size))),
            SIDE, SIDE, "as_written", threads=1, repeats=REPEATS,
            budget_s=BUDGET_S, timeout_s=TIMEOUT_S,
        )
        for scheme in schemes
    ]  # fmt: skip


def study() -> Study:
    """All of it, also what will not finish."""
    every = [
        c for family in FAMILIES for n in SIZES for c in configurations(family, n, [*catalogue()])
    ]
    return Study(NAME, "Growth with the model, 10³ to 10⁶ halfspaces", tuple(every))


def step(number: int, store: Store) -> list[Configuration]:
    """What to run after so many steps, size by size: a scheme that has failed or taken long on a
    family, with this code, is not tried on a larger model of it."""
    n, family = SIZES[number // len(FAMILIES)], FAMILIES[number % len(FAMILIES)]
    smaller = {f"{family}@{size}" for size in SIZES if size < n}
    ended = {
        trial.scheme
        for trial, row in store.trials({code_version()}).items()
        if trial.model in smaller
        and (row["status"] != "ok" or row["build_s"] + row["trace_s"] > SLOW_S)
    }
    return configurations(family, n, [s for s in catalogue() if s not in ended])


def make_models(told: Callable[[str], None]) -> None:
    """Before anything is timed: the worker would run out of time over it."""
    for n in SIZES:
        for family in FAMILIES:
            model = f"{family}@{n}"
            told(f"{model}: {models.generated(model).stat().st_size / 1e6:,.1f} MB of .csg")
