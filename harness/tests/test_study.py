from pathlib import Path

import pytest

from harness import UserError
from harness.study import FOLDER, find, load


def study(tmp_path: Path, text: str):
    path = tmp_path / "mine.toml"
    path.write_text(text)
    return load(path)


def test_lists_stand_for_every_value_and_defaults_are_filled_in(tmp_path):
    read = study(
        tmp_path,
        """
        title = "T"
        repeats = 2
        [[runs]]
        models = ["ball", "ngk"]
        schemes = "sdsm"
        params = [{ d = [3, 4], h = [7, 10] }, { d = 9 }]
        [[runs]]
        models = "ball"
        schemes = "naive"
        repeats = 1
        width = 64
        """,
    )
    assert (read.name, read.title) == ("mine", "T")
    assert [c.params for c in read.configurations if c.model == "ngk"] == [
        '{"d":3,"h":7}',
        '{"d":3,"h":10}',
        '{"d":4,"h":7}',
        '{"d":4,"h":10}',
        '{"d":9,"h":7}',
    ]
    *others, naive = read.configurations
    assert {(c.width, c.repeats) for c in others} == {(512, 2)}
    assert (naive.width, naive.height, naive.repeats) == (64, 512, 1)
    assert others[0].label() == "ball sdsm d=3 h=7"


def test_threads_are_a_dimension_and_all_are_the_machines(tmp_path, monkeypatch):
    monkeypatch.setattr("os.cpu_count", lambda: 6)
    text = (
        "threads = [1, 'all']\n" + RUN + "[[runs]]\nmodels = 'ngk'\nschemes = 'sdsm'\nthreads = 2\n"
    )
    read = study(tmp_path, text)
    assert [(c.model, c.threads) for c in read.configurations] == [
        ("ball", 1),
        ("ball", 6),
        ("ngk", 2),
    ]
    assert read.configurations[1].label() == "ball sdsm d=6 h=7 on 6 threads"
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    assert [c.threads for c in study(tmp_path, text).configurations] == [1, 2]


def test_an_ablation_is_a_configuration_and_it_with_one_thing_changed(tmp_path):
    read = study(
        tmp_path,
        RUN
        + """
        [[ablations]]
        models = ["ball", "ngk"]
        scheme = "hybrid_sdsm"
        params = { d = 6, h = 7, bound = "all" }
        repeats = 9
        [ablations.without]
        "levels" = { d = 2 }
        "bounds" = { scheme = "sdsm", d = 6, h = 7 }
        """,
    )
    assert [c.label() for c in read.runs] == ["ball sdsm d=6 h=7"]
    assert len(read.configurations) == 6  # what a run has already is not measured twice
    on_ball, on_ngk = read.ablations
    assert on_ngk.base.label() == "ngk hybrid_sdsm bound=all d=6 h=7 passes=one"
    assert {what: c.label() for what, c in on_ngk.without.items()} == {
        "levels": "ngk hybrid_sdsm bound=all d=2 h=7 passes=one",
        "bounds": "ngk sdsm d=6 h=7",
    }
    assert on_ball.without["bounds"] is read.runs[0]
    assert on_ngk.base.repeats == 9


RUN = "[[runs]]\nmodels = 'ball'\nschemes = 'sdsm'\n"
ABLATION = "[[ablations]]\nmodels = 'ball'\nscheme = 'sdsm'\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("repeats = \n", "mine.toml:1:11: Invalid value"),
        ("[[runs]]\n[[runs]\n", "mine.toml:2:"),
        ("title = 'x'\n", r"mine.toml: needs at least one \[\[runs\]\]"),
        ("runs = 3\n", r"'runs' is written as \[\[runs\]\], at least one"),
        (RUN + "threads = 0\n", "runs 1: 'threads' is a positive number, \"all\", or a list"),
        (RUN + "threads = []\n", "runs 1: 'threads' is"),
        (RUN + "threads = 'most'\n", "runs 1: 'threads' is"),
        (RUN + "[ablations]\n", r"'ablations' is written as \[\[ablations\]\]"),
        (RUN + "[[ablations]]\nwithouts = 1\n", "ablations 1: unknown key 'withouts'"),
        (RUN + "[[ablations]]\nmodels = 'ball'\n", "ablations 1: 'scheme' is a name"),
        (RUN + ABLATION + "without = { x = 3 }\n", "'without' a table of tables"),
        (
            RUN + ABLATION + "without = { x = { d = 99 } }\n",
            "ablations 1: sdsm: parameter 'd' is 99",
        ),
        ("repeat = 2\n", "mine.toml: unknown key 'repeat'; known: .*repeats"),
        (RUN + "scheme = 'naive'\n", "mine.toml: runs 1: unknown key 'scheme'; known: .*schemes"),
        (RUN + RUN, "runs 2: 'ball sdsm d=6 h=7' is listed twice"),
        (RUN + "params = { d = 99 }\n", "runs 1: sdsm: parameter 'd' is 99, outside 0..20"),
        (RUN + "params = { d = 'x' }\n", "sdsm: parameter 'd' wants a whole number"),
        (RUN + "params = { d = true }\n", "sdsm: parameter 'd' is True, not a whole"),
        (RUN + "params = { d = 5.0 }\n", "sdsm: parameter 'd' is 5.0, not a whole"),
        (RUN + "params = { d = 4294967301 }\n", "sdsm: parameter 'd' is 4294967301, outside 0..20"),
        (RUN + "params = { e = 1 }\n", "unknown parameter 'e'; known: d, h"),
        (RUN + "params = 3\n", "'params' is a table or a list of tables"),
        (RUN + "repeats = 0\n", "'repeats' is a positive number, not 0"),
        (RUN + "repeats = 1.5\n", "'repeats' is a positive number, not 1.5"),
        (RUN + "budget_s = nan\n", "'budget_s' is a positive number, not nan"),
        (RUN + "shape = 'round'\n", "'shape' is one of as_written, balanced"),
        ("[[runs]]\nschemes = 'naive'\n", "'models' is a name or a list of names"),
        ("[[runs]]\nmodels = 'ball'\nschemes = 'fast'\n", "unknown scheme 'fast'; known: naive"),
    ],
)
def test_mistakes_are_one_line_with_the_file_and_the_key(tmp_path, text, message):
    with pytest.raises(UserError, match=message) as caught:
        study(tmp_path, text)
    assert "\n" not in str(caught.value)


def test_a_binary_file_and_a_missing_one(tmp_path):
    (tmp_path / "b.toml").write_bytes(b"\xff\x00")
    with pytest.raises(UserError, match="UTF-8"):
        load(tmp_path / "b.toml")
    with pytest.raises(UserError, match="known: accuracy, bench, grid, paper"):
        find("papers")


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.toml")), ids=lambda path: path.stem)
def test_the_studies_of_the_project_are_read(path):
    assert load(path).configurations
