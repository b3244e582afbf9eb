"""The bench: what is compared with what, and what is said of it."""

import dataclasses
import json

import pytest
from fake_sweep import session

import tracers
from harness import models, povray_timing, schemes, study
from harness.bench import errors, report, tables, targets
from harness.bench.entries import Bench
from harness.plots import save
from harness.povray_scene import BOUNDS, Shot, solid
from harness.results import load
from harness.store import Errors, Outcome, Store, Trial
from harness.study import FOLDER

STUDY = study.load(FOLDER / "bench.toml")
NOISE = (1.0, 1.01, 0.99, 1.02, 0.98, 1.03, 0.97)


def trace_s(c) -> float:
    """Made-up: ours 1 s, in float 0.5 s, Embree's packets 2 s, POV-Ray 100 s, flat 900 s; all
    threads share the work evenly but for Embree's single rays."""
    params = json.loads(c.params)
    base = {"naive": 50.0, "hybrid_sdsm": 1.0, "povray": 100.0}.get(c.scheme, 4.0)
    if c.scheme == "embree_mesh":
        base = 2.0 if params["packet"] == 16 else 3.0
    if params.get("bounds") == "none":
        base = 900.0
    if params.get("precision") == "float32":
        base /= 2
    return base if params.get("packet") == 1 else base / c.threads


@pytest.fixture(scope="module")
def bench(tmp_path_factory) -> Bench:
    store = Store(tmp_path_factory.mktemp("store") / "trials.sqlite")
    store._db.execute("PRAGMA synchronous=OFF")
    store.add_session(session("s"))
    for repeat, noise in enumerate(NOISE):
        for c in STUDY.configurations:
            trial = Trial(
                c.model, "hash", c.shape, c.scheme, c.params,
                schemes.precision(json.loads(c.params)), c.width, c.height, c.threads, repeat, 0,
                "code",
            )  # fmt: skip
            store.add_trial("s", trial, outcome(c, repeat, trace_s(c) * noise))
    return Bench(load(store, STUDY), {})


def outcome(c, repeat: int, seconds: float) -> Outcome:
    counters = ("cells_entered", "bounds_tested", "primitives_tested", "booleans_evaluated")
    is_povray, is_mesh = c.scheme == "povray", c.scheme == "embree_mesh"
    return Outcome(
        "ok", started_utc=f"{repeat}", build_s=0.3, trace_s=seconds,
        mesh_s=6.0 if is_mesh else None, structure_bytes=None if is_povray else 9,
        rays=None if is_povray else 500, facts={},
        picture_hash=None if is_povray else f"{is_mesh} {json.loads(c.params).get('precision')}",
        counters=dict.fromkeys(counters, 1000) if repeat == 0 else None,
    )  # fmt: skip


def test_the_fastest_of_each_peer_stands_in_the_table(bench):
    assert not bench.results.refusals()
    assert bench.winner("ngk").result.scheme == "hybrid_sdsm"
    assert bench.winner("ngk", "float32").precision == "float32"
    assert bench.povray("ball").peer == "POV-Ray, bounded"
    assert bench.embree("ball").result.params["packet"] == 16
    with_ablations = {c.params for c in STUDY.configurations if c.scheme == "hybrid_sdsm"}
    compared = {e.result.configuration.params for e in bench.entries}
    assert with_ablations - compared  # ablations take no part
    made = tables.peers_table(bench, [])
    rows = [dict(zip((c.key for c in made.columns), row, strict=True)) for row in made.rows]
    ours = next(r for r in rows if (r["model"], r["peer"]) == ("ngkcut", "hybrid_sdsm"))
    assert ours["embree_ratio"].median == ours["embree_ratio_ngk"].median == 0.25  # in float32
    assert ours["povray_speedup"].median == pytest.approx(200)
    assert ours["primitives_tested_per_ray"] == 2.0
    assert "| ngkcut | hybrid_sdsm | float32 |" in made.markdown()


def test_packets_that_go_alone_stand_by_themselves(bench):
    alone = next(e for e in bench.of("ball") if e.peer == "packet_sdsm, single rays")
    together = next(e for e in bench.of("ball") if e.peer == "packet_sdsm")
    assert alone.is_scalar
    assert not together.is_scalar
    assert alone.result.params["packet"] == 1
    assert bench.scalar("ball").result.scheme == "hybrid_sdsm"  # the fastest of them here
    assert tables._who(alone).startswith("packet_sdsm, single rays boxes=tight d=6")


def test_targets_are_met_or_not_met_by_the_median(bench):
    found = {(t.model, t.short): (t.verdict(m), m and m[1].median) for t in targets.TARGETS
             for m in [t.measure(bench)]}  # fmt: skip
    assert found["ball", "POV-Ray"] == ("not met", pytest.approx(100))
    assert found["ngk", "POV-Ray"] == ("met", pytest.approx(100))
    assert found["ngkcut", "POV-Ray, flat"] == ("met", pytest.approx(900))
    assert found["ball", "Embree, float64"] == ("not met", pytest.approx(0.5))
    assert found["ngk", "Embree, float32"] == ("met", pytest.approx(0.25))
    assert found["ball", "Manifold"] == ("met", pytest.approx(0.05))
    if bench.all_threads > 1:
        assert found["ball", "threads"] == ("met", pytest.approx(1))
    nothing = Bench(dataclasses.replace(bench.results, all=[]), {})
    assert {t.verdict(t.measure(nothing)) for t in targets.TARGETS} == {"not measured"}
    assert tables.all_tables(nothing)[0].name == "bench_targets"


def test_an_ablation_says_what_each_part_gains(bench):
    table = tables.ablation_table(bench)
    rows = {(row[0], row[1].split()[0], row[2]): row for row in table.rows}
    assert rows["ngk", "hybrid_sdsm", "nothing"][6].median == 1
    assert rows["ngk", "hybrid_sdsm", "S-bounds"][6].median == 4
    assert rows["ngk", "hybrid_sdsm", "double: float32"][6].median == 0.5
    assert ("ball", "packet_sdsm", "tight boxes") in rows
    ablations = [a for a in STUDY.ablations if a.base.model == "ngk"]
    assert len([key for key in rows if key[0] == "ngk"]) == sum(
        1 + len(a.without) for a in ablations
    )


def test_it_is_drawn_and_written(bench, tmp_path):
    document = report.write(bench, tmp_path)
    assert "Was it fast enough?" in document.read_text()
    for name in ("bench", "bench_targets", "ablation"):
        assert (tmp_path / "bench" / "tables" / f"{name}.md").exists()
    save(report.plot(bench), tmp_path / "again")
    drawn = tmp_path / "bench" / "plots" / "bench"
    for form in (".svg", ".png"):
        assert drawn.with_suffix(form).read_bytes() == (tmp_path / f"again{form}").read_bytes()


# --- What a setting errs --------------------------------------------------------------------------


@pytest.fixture
def small(monkeypatch):
    """ball is two balls."""
    tree = tracers.parse_csg("union() { sphere(r = 1); translate(); sphere(r = 0.5); }".replace(
        "translate(); ", ""))  # fmt: skip
    from harness.scenes import frame

    monkeypatch.setattr(models, "tree", lambda *_: tree)
    monkeypatch.setattr(models, "scene", lambda *_: frame(tree))
    return tree


def test_errors_are_against_the_exact_picture(small):
    def small_one(scheme, **params):
        params = schemes.canonical(schemes.complete(scheme, params))
        return dataclasses.replace(
            STUDY.configurations[0], scheme=scheme, params=params, width=48, height=48
        )

    exact = small_one("sdsm")
    of = {
        "none": errors._figures(exact, exact),
        "float32": errors._figures(small_one("sdsm", precision="float32"), exact),
        "coarse": errors._figures(small_one("embree_mesh", segments=8), exact),
        "povray": errors._figures(small_one("povray"), exact),
    }
    assert of["none"] == {"depth_p999": 0.0, "flips": 0.0}
    assert 0 < of["float32"]["depth_p999"] < 1e-6
    assert of["coarse"]["flips"] > 0.01
    assert of["povray"]["depth_p999"] < 1e-9


# --- POV-Ray as a peer ----------------------------------------------------------------------------


def test_povray_times_itself_and_counts(small):
    tree, scene = models.tree("ball"), models.scene("ball")
    timing = povray_timing.timed(tree, scene, 64, 64, "none", 2)
    assert 0 <= timing.parse_s < 60 > timing.trace_s >= 0
    assert timing.counters["primitives_tested"] > 1000
    assert timing.counters["bounds_tested"] > 0
    bounds = {b: solid(Shot(tree, scene, 8, 8), bounds=b).count("bounded_by") for b in BOUNDS}
    assert bounds["none"] == 0


def test_a_peer_has_parameters_like_a_scheme():
    assert schemes.complete("povray", {}) == {"bounds": "operators"}
    assert not schemes.is_exact("povray", {})
    with pytest.raises(schemes.UserError, match="povray: no parameter 'bounds' with value 'all'"):
        schemes.complete("povray", {"bounds": "all"})
    with pytest.raises(schemes.UserError, match="known: bounds: operators, none"):
        schemes.complete("povray", {"d": 3})
    assert "povray" not in schemes.catalogue()  # no study gets it by "others"


def test_errors_are_of_the_code_that_was_timed(tmp_path):
    store = Store(tmp_path / "trials.sqlite")
    for n, code in enumerate(("old", "new")):
        store.add_errors(
            Errors(
                "bench", "ball", models.content_hash("ball"), "as_written", "povray", "{}",
                8, 8, code, {"flips": float(n)}, "",
            )
        )  # fmt: skip
    assert errors.load(STUDY, store, "old") == {("ball", "povray", "{}"): {"flips": 0.0}}
    assert errors.load(STUDY, store, None) == {}
