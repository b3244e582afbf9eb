"""The tables that compare schemes: times, speed-up, work a ray and memory; and where measured."""

from __future__ import annotations

import json

from harness.figures import equally_fast
from harness.results import Result, Results, ratio
from harness.table import (
    Column,
    Table,
    integer,
    megabytes,
    milliseconds,
    number,
    scientific,
    times,
)

COUNTERS = {
    "cells_entered": "cells",
    "bounds_tested": "bounds",
    "primitives_tested": "primitives",
    "booleans_evaluated": "Booleans",
}
INTERVAL = "In brackets: 95% interval of the median, from three values on."
AS_FAST = (
    '"as fast": the 95% interval of the paired ratio to the fastest contains 1; where too few '
    "rounds give one, the times overlap."
)
_SCHEME = Column("scheme", "scheme", align="l")
_PARAMETERS = Column("parameters", "parameters", align="l")


def schemes(model: str, results: Results) -> Table:
    """All schemes on one model, each with its fastest parameters; what failed says why."""
    naive, best = results.find(model, "naive"), fastest(model, results)
    rows = []
    for r in best:
        speedup = ratio(naive, r, "trace_s") if naive else None
        inexact = not r.exact
        rows.append([
            f"{r.scheme} (inexact)" if inexact else r.scheme, parameters(r, results),
            r.mesh_s, r.build_s, r.trace_s, speedup,
            1e9 * r.trace_s.median / r.rays, r.structure_bytes, *per_ray(r), repeats(r),
        ])  # fmt: skip
    measured = {r.scheme for r in best}
    missing = {r.scheme: r for r in results.all if r.model == model and r.scheme not in measured}
    notes = [f"{name}: {r.status}{r.reason and f' ({r.reason})'}." for name, r in missing.items()]
    columns = [
        _SCHEME,
        _PARAMETERS,
        Column("mesh_s", "mesh s", number),
        Column("build_s", "build ms", milliseconds),
        Column("trace_s", "trace ms", milliseconds),
        Column("speedup", "times naive", times),
        Column("ray_ns", "ns/ray", number),
        Column("structure_bytes", "MB", megabytes),
        *per_ray_columns(),
        Column("repeats", "repeats"),
    ]
    notes = [
        f"Each scheme with the fastest of its parameters in this study. {INTERVAL} Work is a "
        "ray's, primary and shadow rays alike. An inexact scheme answers another question: where a "
        "mesh is, or where a surface is nearer than a tolerance. Making the mesh takes the time "
        "under mesh, on all cores and once; it is not in the build time.",
        *_constants(results),
        *notes,
    ]
    return Table(f"schemes_{model}", f"All schemes on {model}", columns, rows, notes)


def fastest(model: str, results: Results) -> list[Result]:
    """Each scheme at the fastest of its parameters, the fastest scheme first."""
    ordered = sorted(
        (r for r in results.tabled if r.model == model), key=lambda r: r.trace_s.median
    )
    best: dict[str, Result] = {}
    for result in ordered:
        best.setdefault(result.scheme, result)
    return list(best.values())


def fastest_exact(results: Results) -> Table:
    """The winner on each model, and what the measurement cannot tell from it."""
    rows = []
    for model in results.study.models:
        ranked = [r for r in fastest(model, results) if r.exact]
        if not ranked:
            continue
        best, others = ranked[0], ranked[1:]
        naive = results.find(model, "naive")
        ties = ", ".join(r.scheme for r in others if equally_fast(best, r))
        rows.append([
            model, best.scheme, parameters(best, results), best.trace_s,
            naive and ratio(naive, best, "trace_s"), ties or None,
            *((others[0].scheme, ratio(others[0], best, "trace_s")) if others else (None, None)),
        ])  # fmt: skip
    columns = [
        Column("model", "model", align="l"),
        _SCHEME,
        _PARAMETERS,
        Column("trace_s", "trace ms", milliseconds),
        Column("speedup", "times naive", times),
        Column("ties", "as fast", align="l"),
        Column("next", "scheme", align="l", group="next"),
        Column("lead", "times the fastest's time", number, group="next"),
    ]
    title = "The fastest exact scheme on each model"
    return Table("fastest", title, columns, rows, [f"{INTERVAL} {AS_FAST}"])


def work(results: Results) -> Table:
    """Work a ray, memory and build time of every configuration."""
    rows = [
        [
            r.model, r.scheme, parameters(r, results), *per_ray(r),
            r.build_s, r.trace_s, r.structure_bytes,
        ]
        for r in results.tabled
    ]  # fmt: skip
    columns = [
        Column("model", "model", align="l"),
        _SCHEME,
        _PARAMETERS,
        *per_ray_columns(),
        Column("build_s", "build ms", milliseconds),
        Column("trace_s", "trace ms", milliseconds),
        Column("structure_bytes", "MB", megabytes),
    ]
    title = "Work a ray, build time and memory of every configuration"
    return Table("work", title, columns, rows, [INTERVAL, *_constants(results)], keys=3)


def per_ray_columns() -> list[Column]:
    return [
        Column(f"{key}_per_ray", word, number, group="per ray") for key, word in COUNTERS.items()
    ]


def repeats(result: Result) -> str:
    """`5`, or `2 of 5` where fewer were measured than planned."""
    measured, planned = len(result.rows), result.configuration.repeats
    return str(measured) if measured >= planned else f"{measured} of {planned}"


def per_ray(result: Result) -> list[float | None]:
    counters = result.counters
    return [counters[key] / result.rays if counters else None for key in COUNTERS]


def parameters(result: Result, results: Results) -> str:
    """`bound=root d=5 h=10`: those that the study varies."""
    constant = results.constant[result.scheme]
    return _listed({k: v for k, v in result.params.items() if k not in constant})


def _listed(params: dict[str, int | str]) -> str:
    return " ".join(f"{name}={value}" for name, value in params.items())


def _constants(results: Results) -> list[str]:
    """A note on the parameters that no label has."""
    constant = [f"{s} {_listed(params)}" for s, params in results.constant.items() if params]
    return [f"The same in the whole study: {'; '.join(constant)}."] if constant else []


def constants(results: Results) -> Table:
    rows = [[scheme, _listed(params)] for scheme, params in results.constant.items() if params]
    columns = [_SCHEME, _PARAMETERS]
    return Table("constant", "Parameters with one value in the whole study", columns, rows)


def references(results: Results) -> Table:
    """How far our pictures are from those of other code."""
    keys = ("mask_flips", "silhouette", "shadow_edge", "unexplained")
    errors = ("depth_max", "normal_deg_max", "rgb_max")
    rows = [
        [
            check["model"], f"{check['width']}×{check['height']}", check["reference"],
            check["reason"] or "passed", check["figures"].get("hits"),
            *(check["figures"].get(key) for key in (*keys, *errors)),
        ]
        for check in results.checks
    ]  # fmt: skip
    columns = [
        Column("model", "model", align="l"),
        Column("size", "size", align="l"),
        Column("reference", "reference", align="l"),
        Column("verdict", "verdict", align="l"),
        Column("hits", "pixels hit", integer),
        *(Column(key, key.replace("_", " "), integer) for key in keys),
        Column("depth_max", "depth, relative", scientific),
        Column("normal_deg_max", "normal, degrees", scientific),
        Column("rgb_max", "colour", scientific),
    ]
    notes = [
        "Pixels that differ, by kind, and the largest error anywhere. All exact schemes draw the "
        "same picture to the bit."
    ]
    title = "Our pictures against pictures by other code"
    return Table("references", title, columns, rows, notes)


def machine(results: Results) -> Table:
    """Where and when it was measured; more than one value where sessions differ."""
    facts: dict[str, dict[str, None]] = {}

    def note(name: str, value: object) -> None:
        facts.setdefault(name, {})[str(value)] = None

    sessions = results.rows.drop_duplicates("session").sort_values("session_started_utc")
    for session in sessions.to_dict("records"):
        about = json.loads(session["machine"])
        for name in ("cpu", "vectors", "cores", "memory_bytes", "system", "kernel"):
            note(name, about.get(name))
        for name in ("compiler", "flags", "git_commit", "code_version"):
            note(name, session[name])
        for name, version in json.loads(session["versions"]).items():
            note(name, version)
        note("started_utc", session["session_started_utc"][:19])
    rows = [[name, "; ".join(values)] for name, values in facts.items()]
    columns = [Column("fact", "", align="l"), Column("value", "", align="l")]
    return Table("machine", "Where it was measured", columns, rows)
