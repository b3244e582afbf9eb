"""From rows in the store to tables: what is judged, what is left out, what is printed."""

import csv
import dataclasses
import io
import json

import pytest
from fake_sweep import first, session

from harness import claims, figures, report, results, scheme_tables, tables
from harness.figures import printed
from harness.schemes import catalogue
from harness.store import Check, Outcome, Store
from harness.study import FOLDER, load

PAPER = load(FOLDER / "paper.toml")
GRID = load(FOLDER / "grid.toml")
NOISE = (1.0, 1.01, 0.99, 1.02, 0.98)  # the machine's, the same for all in a round


def times(configuration):
    """Made-up build and trace times: a bound saves 10% of the trace, and costs half the build."""
    params = json.loads(configuration.params)
    base = {"naive": 50.0, "embree_mesh": 0.1}.get(configuration.scheme, 1.0)
    trace_s = base * (1 + 0.1 * abs(params.get("d", 5) - 5) + 0.01 * abs(params.get("h", 10) - 10))
    return (0.3, 0.9 * trace_s) if "bound" in params else (0.2, trace_s)


def fill(path, study=PAPER, times=times, change=lambda trial, outcome: outcome):
    """A store with five repeats of every configuration of a study."""
    store = Store(path)
    store._db.execute("PRAGMA synchronous=OFF")  # nothing here outlives the test
    store.add_session(session("s"))
    for repeat, noise in enumerate(NOISE):
        for configuration in study.configurations:
            trial = dataclasses.replace(first(configuration), repeat=repeat)
            build_s, trace_s = times(configuration)
            counted = {key: 20 for key in ("cells_entered", "bounds_tested", "primitives_tested")}
            outcome = Outcome(
                "ok", started_utc=f"{repeat}", build_s=build_s, trace_s=trace_s * noise,
                structure_bytes=1000, rays=10, facts={},
                mesh_s=7.0 if configuration.scheme == "embree_mesh" else None,
                picture_hash="mesh" if configuration.scheme == "embree_mesh" else "right",
                counters=counted | {"booleans_evaluated": 5} if repeat == 0 else None,
            )  # fmt: skip
            store.add_trial("s", trial, change(trial, outcome))
    return store


def read(store, study=PAPER):
    return results.load(store, study)


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    return fill(tmp_path_factory.mktemp("store") / "trials.sqlite")


@pytest.fixture(scope="module")
def paper(store):
    return read(store)


# --- The study and the paper's numbers ------------------------------------------------------------


@pytest.mark.parametrize("name", figures.FIGURES)
def test_the_printed_totals_are_sums_and_every_row_is_in_the_study(name, paper):
    for row in printed()[name]["rows"]:
        assert row["build_s"] + row["trace_s"] == pytest.approx(row["total_s"], abs=1e-9)
    fig = figures.figure(name, paper)
    assert len(fig.rows) == 18
    assert all(row.ours for row in fig.rows)
    assert sum(row.paper is not None for row in fig.rows) == 12
    studied = {
        c.params for c in PAPER.configurations if c.model == fig.model and c.scheme == "sdsm"
    }
    assert len(studied) == 6


def test_the_paper_study_is_as_the_paper_measured():
    settings = {(c.width, c.height, c.repeats) for c in PAPER.configurations}
    assert settings == {(512, 512, 5)}


# --- Judging rows ---------------------------------------------------------------------------------


def test_all_is_tabled_where_all_is_right(paper):
    assert len(paper.tabled) == len(PAPER.configurations)
    assert paper.refusals() == []
    assert paper.unchecked == ["ball", "ngk", "ngkcut"]


def test_a_picture_that_differs_from_naive_is_wrong_even_if_it_has_the_majority(tmp_path):
    def change(trial, outcome):
        right = trial.scheme in ("naive", "sdsm", "embree_mesh")
        return outcome if right else dataclasses.replace(outcome, picture_hash="bad")

    found = read(fill(tmp_path / "t.sqlite", change=change))
    inexact = {name for name, scheme in catalogue().items() if not scheme.exact}
    assert {r.scheme for r in found.tabled} == {"naive", "sdsm"} | inexact
    assert "ball uniform_grid n=48: wrong: picture bad where naive has right" in found.refusals()


def test_one_wrong_repeat_is_enough(tmp_path):
    def change(trial, outcome):
        bad = trial.scheme == "chuang_hwang" and trial.repeat == 3
        return dataclasses.replace(outcome, picture_hash="bad") if bad else outcome

    found = read(fill(tmp_path / "t.sqlite", change=change))
    assert {r.scheme for r in found.all if not r.ok} == {"chuang_hwang"}


def test_a_failed_trial_is_left_out_with_its_reason(tmp_path):
    def change(trial, outcome):
        bad = trial.scheme == "embree_cells" and trial.model == "ngk"
        return Outcome("timeout", "no answer in 5 s") if bad else outcome

    found = read(fill(tmp_path / "t.sqlite", change=change))
    assert found.find("ngk", "embree_cells") is None
    assert any(line.endswith("timeout: no answer in 5 s") for line in found.refusals())
    shown = report.all_tables(found, read(Store(tmp_path / "t.sqlite"), GRID), COUNTED)
    (table,) = (table for table in shown if table.name == "schemes_ngk")
    assert "embree_cells: timeout (no answer in 5 s)." in table.notes


def test_a_model_that_failed_against_the_reference_is_refused(tmp_path):
    store = fill(tmp_path / "t.sqlite")
    for passed in (True, False):  # the newest counts
        store.add_check(
            Check("ball", "hash", 512, 512, "right", "POV-Ray", passed, "9% differ", {}, "now")
        )
    found = read(store)
    assert found.tabled == []  # in this store all models have the same hash
    assert found.refusals()[0].endswith("refused: against POV-Ray: 9% differ")
    assert [row[3] for row in scheme_tables.references(found).rows] == ["9% differ"]


def test_newer_code_is_read_once_it_has_half_of_what_older_code_has(tmp_path):
    store = fill(tmp_path / "t.sqlite")
    half = -(-len(PAPER.configurations) // 2)
    for count, configuration in enumerate(PAPER.configurations[:half]):
        assert read(store).code_version == "code", count
        newer = dataclasses.replace(first(configuration), code_version="newer")
        store.add_trial("s", newer, Outcome("ok", started_utc="9", trace_s=1, picture_hash="p"))
    found = read(store)
    assert [r.configuration for r in found.tabled] == list(PAPER.configurations[:half])
    assert {r.status for r in found.all if not r.ok} == {"not run"}


def test_repeats_name_the_plan_where_it_was_not_kept(paper):
    one = paper.tabled[0]
    assert scheme_tables.repeats(one) == "5"
    assert scheme_tables.repeats(dataclasses.replace(one, rows=one.rows[:2])) == "2 of 5"


def test_values_of_different_rounds_and_sessions_are_not_paired(paper):
    a, b = paper.tabled[:2]
    assert len(results.paired(a, b, "trace_s")[0]) == 5
    other = dataclasses.replace(b, rows=b.rows.assign(session=["s", *"tttt"]))
    assert len(results.paired(a, other, "trace_s")[0]) == 1


def test_too_few_common_rounds_give_a_ratio_of_medians_without_interval(paper):
    a, b = paper.find("ball", "naive"), paper.find("ball", "uniform_grid")
    assert results.ratio(a, b, "trace_s").low == pytest.approx(50)
    few = dataclasses.replace(a, rows=a.rows[:2])
    for found in (results.ratio(few, b, "trace_s"), results.ratio(b, few, "trace_s").map(_inverse)):
        assert found.median == pytest.approx(50 * 1.005)
        assert found.low != found.low
    assert not figures.equally_fast(few, b)
    assert figures.equally_fast(dataclasses.replace(b, rows=b.rows[:2]), b)


def _inverse(value):
    return 1 / value


# --- Figures and claims ---------------------------------------------------------------------------


def test_reductions_are_paired_and_the_papers_are_from_its_own_rows(paper):
    fig = figures.figure("figure8", paper)
    row = next(row for row in fig.rows if (row.name, row.bound) == ("5:10", "root"))
    assert row.paper_reduction == pytest.approx(1 - 112.45 / 125.38)
    assert (row.reduction.low, row.reduction.high) == pytest.approx((0.1, 0.1))


def test_every_claim_is_judged_against_the_paper_and_against_us(paper):
    verdicts = {(row[0], row[1]): row[2:] for row in claims.claims(paper).rows}
    assert len(verdicts) == 15
    ball = "ball: bounds save 25% of the trace time"
    assert verdicts[ball, "the paper's own rows"] == [
        "fails",
        "10.3 to 12.2%: less in 6 of 6 rows",
    ]
    assert verdicts[ball, "our rows, bound: Yes (root)"][0] == "fails"
    ngk = "ngk: bounds save 8% of the trace time"
    assert verdicts[ngk, "the paper's own rows"][1] == (
        "5.3 to 15.3%: more in 3 of 6 rows, as claimed in 2, less in 1"
    )
    optimum = "{}: the optimal d:h is 5:10".format
    assert verdicts[optimum("ball"), "the paper's own rows"][0] == "holds"
    assert verdicts[optimum("ngk"), "the paper's own rows"] == [
        "fails",
        "6:7 is the fastest; 5:10 takes 64.5% longer",
    ]
    assert verdicts[optimum("ngk"), "our rows, bound: Yes (every node)"][0] == "holds"
    faster = "bounds make tracing faster in every row"
    assert {verdicts[faster, judge.name][0] for judge in claims.JUDGES} == {"holds"}
    assert "5:10 with bounds against 5:15 without saves 25.0%" in claims.claims(paper).notes[0]


def test_noise_neither_proves_nor_refutes(tmp_path):
    def change(trial, outcome):
        bounded = trial.scheme == "hybrid_sdsm"
        return dataclasses.replace(
            outcome, trace_s=8 ** ((0, 1, -1, 1, -1)[trial.repeat] * bounded)
        )

    found = claims.claims(read(fill(tmp_path / "t.sqlite", change=change)))
    assert {row[2] for row in found.rows if row[1].startswith("our")} == {"open"}


def test_a_claim_about_what_was_not_measured_is_not_judged(tmp_path):
    empty = read(Store(tmp_path / "t.sqlite"))
    ours = [row for row in claims.claims(empty).rows if row[1].startswith("our")]
    assert {row[3] for row in ours} == {"not measured"}


def test_break_even_of_the_paper_and_of_ours(paper):
    figs = [figures.figure(name, paper) for name in figures.FIGURES]
    rows = {tuple(row[:3]): row[3:] for row in tables.break_even(figs).rows}
    paper_pictures, pictures, rays = rows["ngk", "6:7", "Yes (root)"]
    assert paper_pictures == pytest.approx(4.15 / 10.17)
    assert pictures == pytest.approx(0.1 / (0.1 * 1.13), rel=0.01)
    assert rays == pictures * 10


@pytest.mark.parametrize(
    ("build", "trace", "shown"),
    [(0.5, 0.5, "0"), (2, 0.5, "0.400"), (0.5, 2, "never"), ("noise", 0.5, "open"),
     (2, "noise", "open")],
)  # fmt: skip
def test_break_even_says_never_and_open(tmp_path, build, trace, shown):
    def factor(wanted, repeat):
        return 8 ** (0, 1, -1, 1, -1)[repeat] if wanted == "noise" else wanted

    def change(trial, outcome):
        if trial.scheme != "hybrid_sdsm":
            return dataclasses.replace(outcome, build_s=0.2, trace_s=1.0)
        times = 0.2 * factor(build, trial.repeat), factor(trace, trial.repeat)
        return dataclasses.replace(outcome, build_s=times[0], trace_s=times[1])

    found = read(fill(tmp_path / "t.sqlite", change=change))
    values = dict(tables.break_even([figures.figure("figure9", found)]).values())
    assert values["break_even/ngk 6:7 Yes (root)/pictures"] == shown


def test_the_fastest_exact_scheme_and_what_no_label_shows(paper):
    values = dict(scheme_tables.fastest_exact(paper).values())
    assert values["fastest/ball/scheme"] == "hybrid_sdsm"
    assert values["fastest/ball/parameters"] == "bound=root d=5 h=10"
    values = dict(scheme_tables.constants(paper).values())
    assert values["constant/hybrid_sdsm/parameters"] == "passes=one"
    assert values["constant/uniform_grid/parameters"] == "n=48"


def test_the_optimum_is_taken_from_the_grid_too(tmp_path, paper):
    grid = read(fill(tmp_path / "t.sqlite", GRID), GRID)
    table = tables.optimum([figures.figure("figure9", paper)], grid)
    (row,) = (row for row in table.rows if row[1] == "Yes (root)")
    assert row == ["ngk", "Yes (root)", "6:7", "6:7", "5:10", None, "5:10", "5:10", "5:10"]


def test_a_cell_of_a_newer_code_neither_hides_the_grid_nor_is_one(tmp_path, paper):
    cell = dataclasses.replace(first(GRID.configurations[0]), code_version="newer")
    measured = Outcome("ok", started_utc="9", build_s=1, trace_s=1, picture_hash="p")
    full, alone = fill(tmp_path / "full.sqlite", GRID), Store(tmp_path / "alone.sqlite")
    alone.add_session(session("s"))
    for store in (full, alone):
        store.add_trial("s", cell, measured)
    whole, lone = (results.load(store, GRID) for store in (full, alone))
    assert (whole.code_version, len(whole.tabled)) == ("code", len(GRID.configurations))
    assert (lone.code_version, len(lone.tabled)) == ("newer", 1)
    assert len(tables.grid_of(whole, "ball", "none")) == 90
    assert tables.grid_of(lone, "ball", "none") == {}
    figs = [figures.figure("figure8", paper)]
    (earlier,) = tables.optimum(figs, whole, "now").notes[1:]
    assert "measured by an earlier version of the code, code; the rest by now" in earlier
    assert tables.optimum(figs, lone, "now").notes[1:] == []


# --- Forms ----------------------------------------------------------------------------------------

COUNTED = {
    model: {"halfspaces": 3, "nodes": 5, "kinds": ["torus"]} for model in ("ball", "ngk", "ngkcut")
}


def test_every_table_has_its_three_forms_and_the_inexact_scheme_its_label(tmp_path, store, paper):
    shown = report.all_tables(paper, read(store, GRID), COUNTED)
    for table in shown:
        assert all(len(row) == len(table.columns) for row in table.rows), table.name
        assert table.markdown().count("\n|") == len(table.rows) + 2
        assert len(list(csv.reader(io.StringIO(table.csv())))) == len(table.rows) + 1
        lines = table.latex().splitlines()
        assert sum(line.endswith(r" \\") for line in lines) == len(table.rows) + 1 + any(
            column.group for column in table.columns
        )
    (schemes,) = (table for table in shown if table.name == "schemes_ball")
    assert schemes.rows[0][0] == "embree_mesh (inexact)"
    assert schemes.rows[-1][0] == "naive"
    assert dict(schemes.values())["schemes_ball/naive/speedup"] == "1"
    assert schemes.rows[0][2] == 7.0  # to make the mesh
    assert schemes.rows[0][8:12] == [2.0, 2.0, 2.0, 0.5]  # operations a ray
