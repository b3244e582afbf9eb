"""The comparison as tables: every peer, the targets, and what each part of a scheme is worth."""

from __future__ import annotations

from harness.bench.entries import Bench, Entry
from harness.bench.targets import TARGETS, Measured, Target
from harness.results import Result, ratio
from harness.scheme_tables import COUNTERS, INTERVAL, per_ray_columns, repeats
from harness.table import Column, Table, milliseconds, number, scientific, times

_MODEL = Column("model", "model", align="l")


def all_tables(bench: Bench) -> list[Table]:
    measured = [(target, target.measure(bench)) for target in TARGETS]
    made = [targets_table(measured), peers_table(bench, measured), ablation_table(bench)]
    return [table for table in made if table.rows]


def peers_table(bench: Bench, measured: list[tuple[Target, Measured | None]]) -> Table:
    """Every peer on every model, on one thread and on all."""
    rows = []
    for entry in bench.entries:
        r, errors = entry.result, bench.errors_of(entry)
        embree, povray = bench.embree(r.model, entry.threads), bench.povray(r.model, entry.threads)
        ngk = bench.embree("ngk", entry.threads) if r.model == "ngkcut" else None
        verdicts = [
            f"{t.short} {t.shown}: {t.verdict(m)}" for t, m in measured if m and m[0] == entry
        ]
        rays = bench.rays(r.model)
        flips = errors.get("flips")
        rows.append([
            r.model, entry.peer, entry.precision if entry.is_ours else None, entry.threads,
            entry.setting() or None, r.mesh_s, r.build_s, r.trace_s,
            embree and embree.times(entry), ngk and ngk.times(entry),
            povray and entry.times(povray), rays / r.trace_s.median,
            *_per_ray(r, rays), errors.get("depth_p999"), flips and 1e6 * flips,
            "; ".join(verdicts) or None, repeats(r),
        ])  # fmt: skip
    columns = [
        _MODEL,
        Column("peer", "peer", align="l"),
        Column("precision", "precision", align="l"),
        Column("threads", "threads"),
        Column("setting", "parameters", align="l"),
        Column("mesh_s", "mesh s", number, group="prepare"),
        Column("build_s", "build ms", milliseconds, group="prepare"),
        Column("trace_s", "trace ms", milliseconds),
        Column("embree_ratio", "own mesh", times, group="time / Embree's, 16 rays"),
        Column("embree_ratio_ngk", "ngk's mesh", times, group="time / Embree's, 16 rays"),
        Column("povray_speedup", "times as fast as POV-Ray's best", times),
        Column("rays_per_s", "Mray/s", lambda per_s: number(per_s / 1e6)),
        *per_ray_columns(),
        Column("depth_p999", "depth p99.9", scientific, group="error"),
        Column("flips_per_million", "flips a million", number, group="error"),
        Column("targets", "targets", align="l"),
        Column("repeats", "repeats"),
    ]
    notes = [
        "Each scheme with the fastest d:h of the [[runs]] that harness/sweeps/bench.toml lists for "
        "it, which the sweep and grid studies suggested; the ablation and the paper's study may "
        "have another. "
        f"Primary rays and shadow rays to two lights. Ratios are paired by round. {INTERVAL} "
        "POV-Ray times itself: parsing and its hierarchy are its build, and its work is put into "
        "our terms; flat is without bounds, bounded with a box at every operator. A mesh is made "
        "by Manifold, on all cores and once, with 64 segments a circle; Embree splits its "
        "packets of 16 rays where the machine has no AVX-512. Errors are against naive in double "
        "over the pixels of the picture: depths relative to the model's size, a flip is "
        "a hit where there is none or the reverse. 0 is naive's picture to the bit."
    ]
    title = "The same pictures by our schemes, POV-Ray and Embree"
    return Table("bench", title, columns, rows, notes, keys=4)


def _per_ray(result: Result, rays: int) -> list[float | None]:
    counted = result.counters if result.scheme != "embree_mesh" else {}  # Embree counts nothing
    return [counted[key] / rays if counted else None for key in COUNTERS]


def targets_table(measured: list[tuple[Target, Measured | None]]) -> Table:
    """Met or not met."""
    rows = [
        [
            target.model, target.words, target.shown, found and found[1],
            target.verdict(found), found and _who(found[0]),
        ]
        for target, found in measured
    ]  # fmt: skip
    columns = [
        _MODEL,
        Column("target", "figure", align="l"),
        Column("bar", "target"),
        Column("measured", "measured", number),
        Column("verdict", "verdict", align="l"),
        Column("by", "by", align="l"),
    ]
    notes = [
        "Set before it was measured; the median decides. Ours is the fastest exact scheme, in "
        f"double unless it says float32, on one thread unless it says all. {INTERVAL}"
    ]
    title = "Was it fast enough?"
    return Table("bench_targets", title, columns, rows, notes, keys=2)


def _who(entry: Entry) -> str:
    return f"{entry.peer} {entry.setting()}".strip()


def ablation_table(bench: Bench) -> Table:
    """Each scheme taken apart: what a part gains is the time without it over the time with it."""
    rows = []
    for ablation in bench.results.study.ablations:
        base = bench.results.of(ablation.base)
        if not base:
            continue
        about = [base.model, f"{base.scheme} {Entry(base).setting()}"]
        rows.append([*about, "nothing", *_cost(base, base)])
        for what, configuration in ablation.without.items():
            if found := bench.results.of(configuration):
                rows.append([*about, what, *_cost(found, base)])
    columns = [
        _MODEL,
        Column("setting", "scheme", align="l"),
        Column("without", "without", align="l"),
        Column("build_s", "build ms", milliseconds),
        Column("build_ratio", "times the build", times),
        Column("trace_s", "trace ms", milliseconds),
        Column("gain", "its gain: times the trace", times),
        *per_ray_columns(),
    ]
    notes = [f"One thread; one thing less at a time. Ratios are paired by round. {INTERVAL}"]
    title = "What each part is worth"
    return Table("ablation", title, columns, rows, notes, keys=3)


def _cost(result: Result, base: Result) -> list:
    return [
        result.build_s, ratio(result, base, "build_s"), result.trace_s,
        ratio(result, base, "trace_s"), *_per_ray(result, result.rays),
    ]  # fmt: skip
