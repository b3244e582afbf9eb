"""Growth with the model: models in pieces, budgets, lazy octrees, and the study's tables."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

import generators
import tracers
from generators import FAMILIES, synthesize
from harness import models, results
from harness.scale import lazy, plan, report
from harness.schemes import catalogue
from harness.store import Outcome, Session, Store, Trial

LAZY = [s.name for s in tracers.schemes() if "build" in {p.name for p in s.parameters}]


@pytest.fixture(scope="module")
def trees(tmp_path_factory) -> dict[str, tracers.CsgTree]:
    """A few balls, and the plugs; some ten thousand halfspaces each."""
    folder = tmp_path_factory.mktemp("scale")
    return {
        family: tracers.load_csg(str(synthesize(family, 10_000, 1, folder / f"{family}.csg")))
        for family in ("ball", "ngk")
    }


# --- Generators ---------------------------------------------------------------------------------


@pytest.mark.parametrize("family", ["ball", "ngk"])
def test_a_model_made_in_pieces_has_the_same_bytes(family, tmp_path, monkeypatch):
    assert FAMILIES[family].most_per_part
    whole = synthesize(family, 3_000, 4, tmp_path / "whole.csg").read_bytes()
    monkeypatch.setattr(generators, "AT_ONCE", 700)
    assert synthesize(family, 3_000, 4, tmp_path / "pieces.csg").read_bytes() == whole


def test_ten_thousand_halfspaces(trees):
    assert {family: tree.halfspaces for family, tree in trees.items()} == dict.fromkeys(
        trees, 10_000
    )


def test_a_generated_model_has_a_name(tmp_path, monkeypatch):
    monkeypatch.setattr(models, "CACHE", tmp_path / "cache")
    first = models.generated("ball@100")
    assert tracers.load_csg(str(first)).halfspaces == 100
    stamp = first.stat().st_mtime_ns
    assert models.generated("ball@100").stat().st_mtime_ns == stamp  # not made again


# --- Structures built by all cores, and lazily ----------------------------------------------------


@pytest.mark.parametrize("family", ["ball", "ngk"])
@pytest.mark.parametrize("scheme", LAZY)
def test_lazy_draws_the_eager_picture(scheme, family, trees):
    tree, limits = trees[family], {"d": 12, "h": 12}
    view = models.frame(tree).view(48, 48)
    eager = tracers.make(scheme, tree, limits)
    expected = eager.render(view)
    every_cell = eager.facts["divided_cells"] + eager.facts["partial_cells"]
    for threads in (1, 2):
        tracer = tracers.make(scheme, tree, limits | {"build": "lazy"})
        assert tracer.facts["cells"] == 1
        assert tracer.render(view, threads=threads).hash == expected.hash
        assert tracer.render(view, threads=threads).hash == expected.hash  # from what is built
        facts = tracer.facts
        assert 0 < facts["divided_cells"] + facts["partial_cells"] < 0.8 * every_cell
        assert facts["pending_cells"] > 0


def test_threads_that_enter_the_same_cells_at_once(trees):
    """Many threads, few cells: they wait for each other, and what they built is one octree."""
    tree = trees["ngk"]
    view = models.frame(tree).view(96, 96)
    given = {"d": 5, "h": 4, "build": "lazy"}
    once = tracers.make("hybrid_sdsm", tree, given)
    expected = once.render(view).hash
    for _ in range(5):
        tracer = tracers.make("hybrid_sdsm", tree, given)
        assert tracer.render(view, threads=8).hash == expected
        assert (tracer.facts, tracer.bytes) == (once.facts, once.bytes)


THREADED = [
    scheme
    for scheme, declared in catalogue().items()
    if "build_threads" in {p.name for p in declared.parameters}
]
FINE = {"uniform_grid": {"n": 60}, "chuang_hwang": {"d": 20, "h": 6}}  # others are octrees


def test_all_that_build_do_so_by_threads():
    assert set(THREADED) == set(catalogue()) - {"naive"}
    assert set(BUDGETED) <= set(THREADED)


@pytest.mark.parametrize("budget_mb", [4000, 1])
@pytest.mark.parametrize("scheme", THREADED)
def test_a_structure_does_not_depend_on_the_threads_that_built_it(scheme, budget_mb, trees):
    tree = trees["ngk"]
    rays = np.asarray(models.frame(tree).view(32, 32).primary_rays())
    declared = {p.name: p for p in catalogue()[scheme].parameters}
    wanted = FINE.get(scheme, {"d": 12, "h": 12}) | {"budget_mb": budget_mb, "segments": 16}
    limits = {name: value for name, value in wanted.items() if name in declared}
    orders = declared["order"].choices if "order" in declared else []
    for given in [limits | {"order": order} for order in orders] or [limits]:
        one, _ = models.build(scheme, tree, given)
        expected = one.trace(rays, count=True)
        for threads in (0, 2, 5):
            tracer, _ = models.build(scheme, tree, given | {"build_threads": threads})
            hits = tracer.trace(rays, count=True)
            assert tracer.facts == one.facts
            # What Embree takes for a mesh is no more certain than what its threads do.
            assert tracer.bytes == one.bytes or catalogue()[scheme].needs_mesh
            assert hits.counters == expected.counters
            np.testing.assert_array_equal(hits.t.view(np.uint64), expected.t.view(np.uint64))
            np.testing.assert_array_equal(hits.leaf, expected.leaf)


# --- The budget -----------------------------------------------------------------------------------


BUDGETED = [
    scheme.name
    for scheme in tracers.schemes()
    if scheme.exact and "budget_mb" in {p.name for p in scheme.parameters}
]


@pytest.mark.parametrize("scheme", BUDGETED)
def test_a_budget_ends_subdivision_and_changes_no_answer(scheme, trees):
    tree = trees["ball"]
    rays = np.asarray(models.frame(tree).view(16, 16).primary_rays())
    names = {p.name for p in catalogue()[scheme].parameters}
    fine = {"d": 16, "h": 2} if "h" in names else {"n": 100}
    free = tracers.make(scheme, tree, fine)
    assert "cells_over_budget" not in free.facts
    expected = free.trace(rays)
    for megabytes in (0, 1):
        tracer = tracers.make(scheme, tree, fine | {"budget_mb": megabytes})
        hits = tracer.trace(rays)
        assert tracer.facts["cells_over_budget"] > 0
        assert tracer.bytes < free.bytes
        np.testing.assert_array_equal(hits.t.view(np.uint64), expected.t.view(np.uint64))
        np.testing.assert_array_equal(hits.leaf, expected.leaf)


@pytest.mark.parametrize(
    ("scheme", "fine"),
    [("sdsm", {"d": 12, "h": 2}), ("chuang_hwang", {"d": 40, "h": 2}), ("uniform_grid", {"n": 70})],
)
def test_a_budget_is_kept_to_a_round_of_cells(scheme, fine, trees):
    for threads in (1, 2):
        given = fine | {"budget_mb": 2, "build_threads": threads}
        tracer = tracers.make(scheme, trees["ball"], given)
        assert tracer.facts["cells_over_budget"] > 0
        assert 1e6 < tracer.bytes < 2.5e6


def test_what_is_implied_is_not_part_of_a_trials_name():
    """Rows measured before there were such parameters keep their keys."""
    assert tracers.complete("sdsm", {}) == {"d": 6, "h": 7}
    assert tracers.complete("sdsm", {"build": "eager", "budget_mb": 4000}) == {"d": 6, "h": 7}
    assert tracers.complete("sdsm", {"build": "lazy"}) == {"d": 6, "h": 7, "build": "lazy"}


# --- The study ------------------------------------------------------------------------------------


def test_every_scheme_is_in_the_study_at_every_size():
    planned = {(c.model, c.scheme) for c in plan.study().configurations}
    assert planned == {
        (f"{family}@{n}", scheme)
        for family in plan.FAMILIES for n in plan.SIZES for scheme in catalogue()
    }  # fmt: skip


def store_of(folder, seconds) -> Store:
    """Rows of all configurations but those for which `seconds(scheme, n)` is None: these fail."""
    store = Store(folder / "trials.sqlite")
    session = Session("s", plan.NAME, 0, "now", "commit", {}, "gcc", "-O3", {})
    store.add_session(session)
    for c in plan.study().configurations:
        n = int(c.model.partition("@")[2])
        taken = seconds(c.scheme, n)
        trial = Trial(c.model, c.model, c.shape, c.scheme, c.params, "float64", c.width, c.height,
                      c.threads, 0, 0, plan.code_version())  # fmt: skip
        if taken is None:
            store.add_trial("s", trial, Outcome("timeout", "no answer"))
            continue
        counted = {"primitives_tested": n // 10}
        ok = Outcome("ok", build_s=taken, trace_s=taken, structure_bytes=10 * n, rays=1000,
                     picture_hash="0", counters=counted, facts={})  # fmt: skip
        store.add_trial("s", trial, ok)
    return store


def test_a_scheme_that_failed_is_not_tried_on_a_larger_model(tmp_path):
    store = store_of(tmp_path, lambda scheme, n: None if scheme == "naive" and n > 1000 else 1.0)
    tried = [{c.scheme for c in plan.step(i, store)} for i in range(8)]
    assert ["naive" in schemes for schemes in tried] == [True] * 4 + [False] * 4
    assert all("sdsm" in schemes for schemes in tried)


def test_a_scheme_that_took_long_is_not_tried_on_a_larger_model(tmp_path):
    store = store_of(tmp_path, lambda scheme, n: 0.002 * n if scheme == "naive" else 1.0)
    tried = [{c.scheme for c in plan.step(i, store)} for i in range(8)]
    assert ["naive" in schemes for schemes in tried] == [True] * 4 + [False] * 4


def test_exponents_and_reasons_are_tabled(tmp_path):
    store = store_of(
        tmp_path, lambda scheme, n: None if scheme == "naive" and n > 10_000 else 1e-6 * n**0.5
    )
    grown = results.load(store, plan.study())
    rows = {(r[0], r[1]): r for r in report.exponent_table(grown).rows}
    size, build, per_byte, ray = rows["ball", "sdsm"][2:6]
    assert size == 1_000_000
    assert [build, per_byte, ray] == pytest.approx([0.5, 1.0, 0.5])
    assert rows["ball", "sdsm"][6:8] == [pytest.approx(1.0), None]  # no box was counted
    assert rows["ngk", "naive"][2:6] == [10_000, None, None, None]  # two sizes tell no power
    table = report.growth_table("ball", grown)
    assert [row[5] for row in table.rows if row[0] == "sdsm"] == [0.1, 1, 10, 100]
    naive = [row for row in table.rows if row[0] == "naive"]
    assert [row[-1] for row in naive] == ["", "", "timeout: no answer", "timeout: no answer"]
    report.write(grown, [], tmp_path)
    assert (tmp_path / "scale" / "plots" / "scale_ball.svg").exists()
    assert "| naive |" in (tmp_path / "scale" / "scale.md").read_text()


def test_lazy_against_eager_is_measured(tmp_path, monkeypatch):
    monkeypatch.setattr(lazy, "SIDE", 16)
    monkeypatch.setattr(lazy, "VIEWS", 3)
    monkeypatch.setattr(lazy, "SIZES", (1_000,))
    monkeypatch.setattr(lazy, "FAMILIES", ("ball",))
    lazy.measure_missing(tmp_path, lambda line: None)
    (row,) = lazy.load(tmp_path)
    assert row["close_up"]["fraction_built"] < row["picture"]["fraction_built"] < 1
    assert row["picture"]["fraction_built"] < row["fly_around"]["fraction_built"] <= 1
    written = (tmp_path / "scale" / "lazy.json").read_text()
    lazy.measure_missing(tmp_path, lambda line: pytest.fail("measured twice"))
    assert json.loads(written) == lazy.load(tmp_path)
    monkeypatch.setattr(lazy, "SIDE", 17)  # what was measured at another size will not do
    lazy.measure_missing(tmp_path, lambda line: None)
    (again,) = lazy.load(tmp_path)
    assert (row["side"], again["side"]) == (16, 17)
    for table in (report.lazy_table([row]), report.load_table([row])):
        assert table.rows
        assert "| ball | 1,000 |" in table.markdown()


@pytest.mark.parametrize(
    ("eager", "lazy_s", "rays"),
    [
        ([5, 1, 1], [0, 2, 2], 50),  # gains one a view of ten rays: three more views would do
        ([5, 1, 1], [0, 8, 1], 10 * 5 / 7),  # between the start and the first view
        ([1, 1, 1], [2, 1, 1], 0),  # eager is built sooner
        ([5, 1, 1], [0, 1, 1], math.inf),
    ],
)
def test_break_even(eager, lazy_s, rays):
    got = lazy._break_even(np.cumsum(eager), np.cumsum(lazy_s), np.array([0, 10, 20]))
    assert got == pytest.approx(rays)
