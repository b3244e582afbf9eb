"""The commands as typed: what they print, what they write, and how they refuse."""

import os
import re

import numpy as np
import pytest
from typer.testing import CliRunner

from harness import STORE, images
from harness.cli import app, main
from harness.store import Store

COMMANDS = ("sweep", "trace", "schemes", "doctor", "reference", "tables", "plots")
TINY = """
title = "Two schemes and the truth on a small picture"
width = 48
height = 40
repeats = 2
[[runs]]
models = "ball"
schemes = ["naive", "embree_cells"]
[[runs]]
models = "ball"
schemes = "hybrid_sdsm"
params = { d = 4, h = 10, bound = ["root", "all"] }
"""


def run(*arguments):
    return CliRunner().invoke(app, [str(a) for a in arguments])


def plain(text: str) -> str:
    return " ".join(re.sub(r"\x1b\[[0-9;]*m", "", text).split())


def test_help_teaches():
    assert all(command in run("--help").output for command in COMMANDS)
    for command in ("sweep", "trace"):
        assert "csgbench " + command in run(command, "--help").output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["trace", "nope"], "no scene 'nope'; known: ball, ngk, ngkcut, or the path of"),
        (["trace", "nope.scad"], "nope.scad: no such file"),
        (["trace", "folder.csg"], "folder.csg: a folder, not a file"),
        (["trace", "ball", "--scheme", "fast"], "unknown scheme 'fast'; known: naive, "),
        (["trace", "ball", "--set", "d"], "'d' is not of the form name=value"),
        (["trace", "ball", "--set", "d=5", "d=6"], "parameter 'd' is set twice"),
        (["oracle", "ball", "--set", "d=5"], "naive: unknown parameter 'd'"),
        (["oracle", "ball", "--scheme", "sdsm", "--set", "k=5"], "unknown parameter 'k'; known: d"),
        (["trace", "ball", "--set", "d=x"], "parameter 'd' wants a whole number, not 'x'"),
        (["trace", "ball", "--set", "d=6,h=7"], "not '6,h=7'; settings are separated by spaces"),
        (["trace", "ball", "--set", f"d={1 << 63}"], "hybrid_sdsm: parameter 'd' is 9223372036854"),
        (
            ["trace", "ball", "--set", "k=5"],
            "hybrid_sdsm: unknown parameter 'k'; known: d, h, ",
        ),
        (["trace", "ball", "--set", "bound=no"], "parameter 'bound' is 'no'; known: root, all"),
        (["trace", "ball", "--size", "huge"], "size 'huge' is not of the form 512x512"),
        (["trace", "ball", "--size", "0x9"], "size '0x9'"),
        (["trace", "ball", "--size", "999999x999999"], "has more than 67,108,864 pixels"),
        (["trace", "ball", "--size", "9999999999x1"], "has more than 67,108,864 pixels"),
        (["stability", "X99"], "no row 'X99'; known: X1 to X18, povray"),
        (["trace", "ball", "-o", "ball.gif"], "ball.gif: a picture is written as .png or .exr"),
        (["sweep", "nope"], "no study 'nope'; known: accuracy, bench, grid, paper"),
        (["reference", "nope"], "no scene 'nope'"),
        (["tables", "--results", "/nonexistent"], "nothing measured yet; run `csgbench sweep`"),
        (["plots", "--results", "/nonexistent"], "nothing measured yet"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(arguments, message, tmp_path, monkeypatch):
    (tmp_path / "folder.csg").mkdir()
    monkeypatch.chdir(tmp_path)
    result = run(*arguments)
    assert result.exit_code == 2
    assert result.stdout == ""
    assert message in plain(result.stderr)
    assert result.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("cube(", "bad.scad:2: Parser error: syntax"),
        (
            "hull() { cube(); sphere(); }",
            "bad.scad (as evaluated by OpenSCAD):1:1: unsupported: hull",
        ),
        ("", "bad.scad (as evaluated by OpenSCAD): the model is empty"),
        (
            "intersection() { cube(1); translate([5, 0, 0]) cube(1); }",
            "bad.scad: the solid is empty",
        ),
    ],
)
def test_a_model_that_cannot_be_read_is_one_line_too(tmp_path, text, message):
    path = tmp_path / "bad.scad"
    path.write_text(text)
    result = run("trace", path)
    assert result.exit_code == 2
    assert message in plain(result.stderr)
    assert result.stderr.count("\n") == 1


def test_schemes_lists_every_scheme_with_its_parameters():
    shown = plain(run("schemes").output)
    for word in ("naive", "hybrid_sdsm", "bound", "root all", "embree_mesh", "(inexact)"):
        assert word in shown


def test_trace_takes_settings_in_both_forms_and_draws_the_same(tmp_path):
    path = tmp_path / "ball.exr"
    first = run("trace", "ball", "--size", "40x30", "--set", "d=4", "h=10", "-o", path)
    second = run("trace", "ball", "--size", "40x30", "--set", "d=4", "--set", "h=10")
    third = run("trace", "--size", "40x30", "--set", "d=4", "h=10", "ball")
    for result in (first, second, third):
        assert result.exit_code == 0
        assert "hybrid_sdsm bound=all d=4 h=10" in plain(result.stdout)
        assert re.search(r"primitives tested [\d,]+, [\d.]+ a ray", plain(result.stdout))
    channels = images.read_exr(path)
    assert {"R", "G", "B", "depth", "normal.x", "leaf", "cost"} <= channels.keys()
    assert channels["depth"].shape == (30, 40)
    assert np.isfinite(channels["depth"]).any()


def test_trace_by_several_threads_draws_the_same():
    typed = ("trace", "ball", "--size", "40x30", "--set", "d=4")
    shown = [plain(run(*typed, "--threads", n).stdout) for n in (1, 3, 0)]
    assert "1 thread rays" in shown[0]
    assert "3 threads rays" in shown[1]
    assert f"{os.cpu_count()} thread" in shown[2]
    assert len({re.search(r"picture (\w+)", text)[1] for text in shown}) == 1
    assert run(*typed, "--threads", -1).exit_code == 2


def test_trace_shows_any_file_and_the_warnings_of_the_loader(tmp_path):
    path = tmp_path / "prism.csg"
    path.write_text("cylinder($fn = 6, h = 2, r1 = 1, r2 = 1, center = true);\n")
    result = run("trace", path, "--size", "20x20", "-o", tmp_path / "prism.png")
    assert result.exit_code == 0
    assert "warning: " in plain(result.stderr)
    assert "warning" not in result.stdout
    assert (tmp_path / "prism.png").stat().st_size > 0


def test_a_warning_names_the_file_that_the_user_knows(tmp_path):
    path = tmp_path / "prism.scad"
    path.write_text("cylinder(1, $fn = 6);")
    result = run("trace", path, "--size", "8x8")
    assert "prism.scad (as evaluated by OpenSCAD):1:1: cylinder with" in plain(result.stderr)


def test_a_picture_of_nothing_is_warned_of(tmp_path):
    path = tmp_path / "nothing.csg"
    block = "cube(size = [1, 1, 1], center = false);"
    path.write_text(f"difference() {{ {block} {block} }}")
    result = run("trace", path, "--size", "8x8")
    assert result.exit_code == 0
    assert "nothing.csg: no ray hits anything" in plain(result.stderr)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["trac"], "csgbench: No such command 'trac'. Did you mean 'trace'"),
        (["trace"], "csgbench trace: Missing argument 'model'"),
        (["trace", "ball", "--sort"], "csgbench trace: No such option: --sort"),
        (["sweep", "--seed", "x"], "csgbench sweep: Invalid value for '--seed'"),
        (["trace", "ball", "--threads", f"{1 << 31}"], "csgbench trace: Invalid value for '--th"),
    ],
)
def test_misuse_is_one_line_that_says_where_help_is(arguments, message, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["csgbench", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    shown = capsys.readouterr()
    assert ended.value.code == 2
    assert not shown.out
    assert plain(shown.err).startswith(message)
    assert "Usage" not in shown.err
    assert plain(shown.err).endswith("--help)")


@pytest.mark.parametrize("command", ["tables", "plots"])
def test_a_store_without_the_study_is_said(command, tmp_path):
    Store(tmp_path / STORE)
    result = run(command, "--results", tmp_path)
    assert "nothing of the study 'paper' measured yet" in plain(result.stderr)
    assert "run `csgbench sweep paper`" in plain(result.stderr)
    assert not (tmp_path / "plots").exists()


def test_help_is_wrapped_to_the_terminal(monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    lines = [line.strip() for line in run("stability", "--help").output.splitlines()]
    first = next(i for i, line in enumerate(lines) if line.startswith("X18"))
    paragraph = lines[first : lines.index("", first)]
    assert len(paragraph) > 5
    assert all(40 < len(line) <= 60 for line in paragraph[:-1])


def test_the_oracle_judges_one_scheme_as_it_is_set():
    at = ("--pixel", "8,8", "--size", "16x16")
    one = plain(run("oracle", "ball", *at, "--scheme", "sdsm", "--set", "d=4", "h=9").stdout)
    assert "Set: d=4 h=9 scheme" in one
    assert "naive" not in one
    every = plain(run("oracle", "--set", "precision=float32", "ball", *at).stdout)
    assert "Set: precision=float32 scheme" in every
    assert "naive" in every
    assert "embree_cells" in every
    assert "float32 adds" in every
    assert "flip" not in one + every
    assert "Usage" not in one + every


def test_a_tiny_sweep_from_end_to_end(tmp_path):
    study, results = tmp_path / "tiny.toml", tmp_path / "results"
    study.write_text(TINY)
    done = run("sweep", study, "--results", results)
    assert done.exit_code == 0, done.output
    assert "tiny: 8 ok" in done.stdout
    assert "not tabled" not in done.stderr
    tables = (results / "tiny" / "tables.md").read_text()
    for scheme in ("naive", "embree_cells", "hybrid_sdsm"):
        assert scheme in tables
    assert "Not tabled, or not checked" not in tables
    assert (results / "tiny" / "plots" / "schemes_ball.svg").exists()
    assert "nothing was left to run" in run("sweep", study, "--results", results).stdout
