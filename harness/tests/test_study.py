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


RUN = "[[runs]]\nmodels = 'ball'\nschemes = 'sdsm'\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("repeats = \n", "mine.toml:1:11: Invalid value"),
        ("[[runs]]\n[[runs]\n", "mine.toml:2:"),
        ("title = 'x'\n", r"mine.toml: needs at least one \[\[runs\]\]"),
        ("runs = 3\n", "needs at least one"),
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
    with pytest.raises(UserError, match="known: accuracy, grid, paper"):
        find("papers")


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.toml")), ids=lambda path: path.stem)
def test_the_studies_of_the_project_are_read(path):
    assert load(path).configurations
