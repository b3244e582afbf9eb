"""The accuracy study on a small picture: the exact scheme is right, what is turned shows."""

import dataclasses
import json
import math

import pytest

from harness import models, results
from harness.accuracy import measure, report
from harness.accuracy.settings import NAME, Setting, load
from harness.machine import code_version
from harness.report import load_study
from harness.schemes import precision
from harness.store import Errors, Outcome, Session, Store, Trial
from harness.study import Configuration

STUDY = load_study("accuracy")
SIDE = 64


def small(knob: str) -> Configuration:
    """ball's configuration with this in its parameters, as a small picture."""
    found = next(
        c for c in STUDY.configurations if c.model == "ball" and knob in c.params and c.width == 512
    )
    return dataclasses.replace(found, width=SIDE, height=SIDE)


@pytest.fixture(scope="module")
def figures() -> dict[str, dict]:
    patched = pytest.MonkeyPatch()
    patched.setattr(measure, "SHOWN", SIDE)
    patched.setattr(measure, "SUPERSAMPLED", 2 * SIDE)
    knobs = [
        "", "float32", "fixed_5e-4", '"shadow":"0"', '"boxes"', '"segments":8', '"tolerance":3'
    ]  # fmt: skip
    found = measure.measure([small(knob) for knob in knobs], lambda label: None)
    patched.undo()
    return dict(zip(knobs, found, strict=True))


def test_the_exact_scheme_errs_nowhere(figures) -> None:
    exact = figures[""]
    assert exact["sampled"] == SIDE * SIDE
    assert exact["disputed"] > 100  # the mesh and the spheres differ somewhere
    assert exact["sampled_unexcused"] == exact["disputed_unexcused"] == 0
    assert 0 < exact["sampled_worst_E"] < 4
    for figures_of in (exact, figures['"boxes"']):  # the latter of packet_sdsm
        for key in ("flips", "wrong_leaves", "wrong_light", "flip"):
            assert figures_of[key] == 0
    assert 0 < exact["surface_max"] < 1e-15


def test_errors_grow_as_settings_get_coarser(figures) -> None:
    surface = [figures[k]["surface_max"] for k in ("", "float32", '"tolerance":3', '"segments":8')]
    assert surface == sorted(surface)
    assert 1e-9 < figures["float32"]["surface_max"] < 1e-6
    assert figures['"segments":8']["flips"] > figures["float32"]["flips"]
    assert figures['"segments":8']["unexcused_flips"] > 0
    assert figures["float32"]["unexcused_flips"] == 0
    assert figures["fixed_5e-4"]["wrong_light"] > 0
    assert figures['"segments":8']["flip"] > 0.1


@pytest.fixture
def settings(tmp_path, figures) -> list[Setting]:
    """As `csgbench accuracy` would load them, with made-up times."""
    store = Store(tmp_path / "trials.sqlite")
    store.add_session(Session("s", "accuracy", 0, "", "", {}, "", "", {}))
    configurations = []
    for n, (knob, found) in enumerate(figures.items(), start=1):
        c = small(knob)
        configurations.append(dataclasses.replace(c, repeats=3))
        trial = Trial(
            "ball", models.content_hash("ball"), c.shape, c.scheme, c.params,
            precision(json.loads(c.params)),
            SIDE, SIDE, threads=1, repeat=0, attempt=0, code_version=code_version(),
        )  # fmt: skip
        for repeat in range(3):
            seconds = n * (1 + repeat / 100)
            picture = "exact" if knob in ("", '"boxes"') else knob
            outcome = Outcome(
                "ok", "", f"{n}{repeat}", seconds, 0.5, seconds, None, 1, 1000, picture
            )
            store.add_trial("s", dataclasses.replace(trial, repeat=repeat), outcome)
        record = Errors(
            NAME, *dataclasses.astuple(trial)[:5], SIDE, SIDE, trial.code_version, found, ""
        )
        store.add_errors(record)
    study = dataclasses.replace(STUDY, configurations=tuple(configurations))
    return load(study, store)


def test_report_says_what_was_turned_and_what_it_costs(settings, tmp_path) -> None:
    assert [s.knob for s in settings] == [
        "exact", "precision", "tie_band", "shadow", "packet_sdsm", "embree_mesh",
        "sphere_tracing",
    ]  # fmt: skip
    assert settings[0].ray_ns.median == pytest.approx(1.01e6)
    table = report.settings_table("ball", settings)
    assert "< 7" in table.markdown()  # 3/N of 4096 pixels, where none was seen
    values = dict(report.choice_table(settings).values())
    assert values[f"choice/ball {report.NEEDS[0].words}/fastest"] == "float64"
    report.write(settings, tmp_path)
    for file in ("accuracy.md", "tables/choice.csv", "tables/oracle.md", "plots/accuracy_ball.svg"):
        assert (tmp_path / "accuracy" / file).stat().st_size > 0


def test_plotted_flips_are_bounds_and_no_zero_stands_above_an_error(settings) -> None:
    _, flips, flip = report.plot("ball", settings).axes[:3]
    drawn = lambda axes: [float(line.get_ydata()[0]) for line in axes.lines[: len(settings)]]  # noqa: E731
    of = {key: [s.figures[key] for s in settings] for key in ("flips", "flip")}
    assert sorted(drawn(flips)) == sorted(s.bound_per_million("flips") for s in settings)
    positive = [x for x in of["flip"] if x]
    assert 0 < min(drawn(flip)) < min(positive)
    assert drawn(flip).count(min(drawn(flip))) == of["flip"].count(0) > 0


def test_names_that_would_print_over_each_other_are_left_out() -> None:
    points = [(1, 1), (1.1, 1.1), (1, 100), (100, 1)]
    assert report._apart(points, ["long name"] * 4) == [0, 2, 3]


def test_pareto_front() -> None:
    points = [(1, 5), (2, 3), (3, 4), (4, 1), (5, 1), (6, math.inf)]
    assert report._pareto(points) == [(1, 5), (2, 3), (4, 1)]


def test_a_turned_knob_promises_nothing() -> None:
    assert results.is_exact("sdsm", {"precision": "float32"})
    assert not results.is_exact("sdsm", {"tie_band": "0"})
    assert not results.is_exact("embree_mesh", {})
