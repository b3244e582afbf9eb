"""OpenSCAD's failures are all seen, and nothing is evaluated twice."""

from __future__ import annotations

import os
import shutil
import stat
import time
from pathlib import Path

import pytest

from harness import openscad
from harness.openscad import OpenScadError, evaluate, literal, to_csg


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """The current folder, a relative one: paths in messages are those that were given."""
    monkeypatch.chdir(tmp_path)
    return Path(".")


def write(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def refusal(scad: Path, **defines: object) -> str:
    """The one line, after checking that nothing was written."""
    with pytest.raises(OpenScadError) as caught:
        evaluate(scad, Path("out.csg"), defines)
    assert not list(Path(".").glob("*.csg")), "a failure left a file"
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_a_model_is_written_to_a_relative_path_in_another_folder(folder):
    scad = write(folder / "parts" / "a.scad", "cube(size);\nsize = 1;")
    evaluate(scad, folder / "out" / "a.csg", {"size": [1, 2.5, 3]})
    assert (folder / "out" / "a.csg").read_text().split("\n")[0] == (
        "cube(size = [1, 2.5, 3], center = false);"
    )
    assert [p.name for p in (folder / "parts").iterdir()] == ["a.scad"]
    assert [p.name for p in (folder / "out").iterdir()] == ["a.csg"]


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ('\nassert(1 > 2, "no");', "m.scad:2: Assertion '(1 > 2)' failed: \"no\""),
        ("cube(1);\nspere(1);", "m.scad:2: Ignoring unknown module 'spere'"),
        ("cube(1);\ncube(s);", "m.scad:2: Ignoring unknown variable 's'"),
        ("cube(1);\n\ncube(", "m.scad:4: Parser error: syntax error"),
        ("module m() m(); m();", "m.scad:1: Recursion detected calling module 'm'"),
        ("for (i = [0:2e6]) cube(i);", "m.scad:1: Bad range parameter in for statement: too many"),
        ("include <absent.scad>", "m.scad: Can't open include file 'absent.scad'."),
        ("use <absent.scad>", "m.scad: Can't open library 'absent.scad'."),
        ("foo(); bar();", "m.scad:1: Ignoring unknown module 'foo' (and 1 more)"),
        ("!cube(1); !cube(2);", "m.scad:1: More than one Root Modifier (!)"),
    ],
)
def test_what_openscad_complains_of_is_an_error_with_its_place(folder, source, message):
    assert refusal(write(folder / "m.scad", source)).startswith(message)


def test_a_complaint_about_an_included_file_names_that_file(folder):
    write(folder / "models" / "lib" / "part.scad", "\n\nmodule part() { nut(); }")
    scad = write(folder / "models" / "m.scad", "use <lib/part.scad>\npart();")
    assert refusal(scad) == "models/lib/part.scad:3: Ignoring unknown module 'nut'"


def test_a_syntax_error_elsewhere_names_the_file_as_it_was_given(folder):
    scad = write(folder / "models" / "m.scad", "cube(1);\ncube(")
    assert refusal(scad).startswith("models/m.scad:3: Parser error")
    assert refusal(scad.resolve()).startswith(f"{scad.resolve()}:3: Parser error")
    write(folder / "models" / "lib" / "part.scad", "module part( {}")
    using = write(folder / "models" / "n.scad", "use <lib/part.scad>\npart();")
    assert refusal(using).startswith("models/lib/part.scad:1: Parser error")


def test_a_word_that_a_model_prints_is_no_complaint(folder):
    scad = write(folder / "m.scad", 'echo("WARNING: ERROR: all is well"); cube(1);')
    evaluate(scad, folder / "m.csg")
    assert (folder / "m.csg").is_file()


def test_missing_files(folder):
    assert refusal(folder / "absent.scad") == "absent.scad: no such file"
    (folder / "d.scad").mkdir()
    assert refusal(folder / "d.scad") == "d.scad: not a file"


def test_a_failed_run_keeps_the_file_of_the_run_before(folder):
    write(folder / "m.csg", "before")
    with pytest.raises(OpenScadError):
        evaluate(write(folder / "m.scad", "nothing();"), folder / "m.csg")
    assert (folder / "m.csg").read_text() == "before"
    assert sorted(p.name for p in folder.iterdir()) == ["m.csg", "m.scad"]


def fake_openscad(folder: Path, monkeypatch, script: str) -> None:
    program = write(folder / "bin" / "openscad", "#!/bin/sh\n" + script)
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{program.parent.resolve()}:{os.environ['PATH']}")


@pytest.mark.parametrize(
    ("script", "message"),
    [
        ("exit 0", "out.csg: OpenSCAD could not write all of it"),
        ('printf "cube(size = [1, 1, 1], cen" >"$2"', "out.csg: OpenSCAD could not write all"),
        ("kill -SEGV $$", "m.scad: OpenSCAD was ended by signal 11"),
        ("echo; echo 'Cannot so-and-so' >&2; exit 1", "m.scad: Cannot so-and-so"),
        ("exit 3", "m.scad: OpenSCAD failed (3)"),
    ],
)
def test_failures_that_say_nothing(folder, monkeypatch, script, message):
    fake_openscad(folder, monkeypatch, script)
    assert refusal(write(folder / "m.scad", "cube(1);")).startswith(message)


def test_openscad_not_installed(folder, monkeypatch):
    monkeypatch.setenv("PATH", str(folder))
    assert "apt-get install openscad" in refusal(write(folder / "m.scad", "cube(1);"))


def test_literals():
    values = [True, 3, 0.1, 'a "b" \\', [1, [False, None]]]
    assert [literal(v) for v in values] == [
        "true",
        "3",
        "0.1",
        '"a \\"b\\" \\\\"',
        "[1, [false, undef]]",
    ]


def test_literals_arrive_in_openscad(folder):
    scad = write(folder / "m.scad", 't=0; b=0; assert(t == "a\\"b\\\\"); assert(b == [true]);')
    evaluate(scad, folder / "m.csg", {"t": 'a"b\\', "b": [True]})


# The cache.


@pytest.fixture
def runs(monkeypatch) -> list[list[str]]:
    """The arguments of every evaluation."""
    real, seen = openscad._openscad, []

    def counted(arguments):
        if "-o" in arguments:
            seen.append(arguments)
        return real(arguments)

    monkeypatch.setattr(openscad, "_openscad", counted)
    return seen


def test_a_csg_is_returned_as_it_is(folder, runs):
    csg = write(folder / "m.csg", "whatever")
    assert to_csg(csg, folder / "cache") == csg
    assert runs == []
    assert not (folder / "cache").exists()


def test_other_files_are_refused(folder):
    with pytest.raises(OpenScadError, match=r"^m\.stl: a model is a \.scad or a \.csg file$"):
        to_csg(write(folder / "m.stl", ""), folder)
    for name in ("absent.scad", "absent.csg"):
        with pytest.raises(OpenScadError, match=f"^{name}: no such file$"):
            to_csg(folder / name, folder)


def test_the_second_time_is_immediate(folder, runs):
    scad = write(folder / "m.scad", "cube(1);")
    first = to_csg(scad, folder / "cache")
    started = time.monotonic()
    assert to_csg(scad.resolve(), folder / "cache") == first
    assert time.monotonic() - started < 0.5
    assert len(runs) == 1
    assert first.read_text().startswith("cube(size = [1, 1, 1], center = false);")


def test_a_change_anywhere_evaluates_again(folder, runs):
    deep = write(folder / "li b" / "de$ep.scad", "function size() = 1;")
    part = write(folder / "li b" / "part.scad", "include <de$ep.scad>\nmodule part() cube(size());")
    scad = write(folder / "m.scad", "use <li b/part.scad>\npart();")
    cache = folder / "cache"
    first = to_csg(scad, cache)
    assert to_csg(scad, cache) == first
    assert len(runs) == 1

    write(deep, "function size() = 2;")
    second = to_csg(scad, cache)
    assert "[2, 2, 2]" in second.read_text()
    assert "[1, 1, 1]" in first.read_text()
    write(part, "include <de$ep.scad>\nmodule part() cube([size(), 1, 1]);")
    assert "[2, 1, 1]" in to_csg(scad, cache).read_text()
    write(scad, "sphere(1);")
    assert to_csg(scad, cache).read_text().startswith("sphere(")
    assert len(runs) == 4

    part.unlink()  # no longer read
    to_csg(scad, cache)
    assert len(runs) == 4


def test_a_file_that_disappears_is_seen(folder):
    write(folder / "part.scad", "module part() cube(1);")
    scad = write(folder / "m.scad", "use <part.scad>\npart();")
    to_csg(scad, folder / "cache")
    (folder / "part.scad").unlink()
    with pytest.raises(OpenScadError, match="part"):
        to_csg(scad, folder / "cache")


def test_another_openscad_evaluates_again(folder, runs, monkeypatch):
    scad = write(folder / "m.scad", "cube(1);")
    to_csg(scad, folder / "cache")
    monkeypatch.setattr(openscad, "version", lambda: "OpenSCAD version 2099.01")
    to_csg(scad, folder / "cache")
    assert len(runs) == 2


@pytest.mark.parametrize("damage", ["", "{", "[]", '{"csg": 1}', '{"csg": "x", "inputs": 0}'])
def test_a_damaged_cache_is_made_again(folder, runs, damage):
    scad = write(folder / "m.scad", "cube(1);")
    csg = to_csg(scad, folder / "cache")
    text = csg.read_text()
    for record in (folder / "cache").glob("*.json"):
        record.write_text(damage)
    csg.unlink()
    assert to_csg(scad, folder / "cache").read_text() == text
    assert len(runs) == 2


def test_models_of_the_same_name_do_not_meet(folder):
    one = to_csg(write(folder / "a" / "m.scad", "cube(1);"), folder / "cache")
    two = to_csg(write(folder / "b" / "m.scad", "cube(2);"), folder / "cache")
    assert "[1, 1, 1]" in one.read_text()
    assert "[2, 2, 2]" in two.read_text()


def test_a_failure_is_not_remembered(folder):
    scad = write(folder / "m.scad", "nothing();")
    for _ in range(2):
        with pytest.raises(OpenScadError, match=r"^m\.scad:1: "):
            to_csg(scad, folder / "cache")
    assert not (folder / "cache").exists()


def test_the_version_is_openscads():
    assert shutil.which("openscad")
    assert openscad.version().startswith("OpenSCAD version 20")
