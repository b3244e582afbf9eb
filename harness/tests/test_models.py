"""The models have the paper's counts, generated ones the size asked for, scenes a strict form."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import tracers
from generators import FAMILIES, synthesize
from harness import UserError, models, trials
from harness.openscad import evaluate
from harness.scenes import SCENES, frame, load_scenes
from harness.study import Configuration

MODELS = load_scenes()


@pytest.fixture(scope="module")
def trees(tmp_path_factory) -> dict[str, tracers.CsgTree]:
    folder = tmp_path_factory.mktemp("models")
    for name, scene in MODELS.items():
        evaluate(scene.model, folder / f"{name}.csg")
    return {name: tracers.load_csg(str(folder / f"{name}.csg")) for name in MODELS}


@pytest.mark.parametrize("name", MODELS)
def test_counts_are_those_of_scenes_toml(name, trees):
    scene, tree = MODELS[name], trees[name]
    assert (tree.halfspaces, tree.nodes) == (scene.halfspaces, scene.nodes)
    assert sorted(set(tree.kinds)) == list(scene.kinds)
    assert tree.warnings == []


def test_the_papers_counts():
    assert {name: (s.halfspaces, s.nodes, s.kinds) for name, s in MODELS.items()} == {
        "ball": (612, 1223, ("cylinder", "sphere")),
        "ngk": (3948, 7895, ("block", "cone", "cylinder", "torus")),
        "ngkcut": (3949, 7897, ("block", "cone", "cylinder", "torus")),
    }


def test_the_plugs_are_alike(trees):
    tree = trees["ngk"]
    assert all(count % 42 == 0 for count in Counter(tree.kinds).values())
    tori = tree.sizes[np.array(tree.kinds) == "torus"]
    assert np.all(tori[:, 0] > tori[:, 1])  # R > r: no torus crosses its own axis


def test_the_bore_is_subtracted_last(trees):
    difference = 3
    op, _, right = trees["ngkcut"].operators[-1]
    assert op == difference
    assert trees["ngkcut"].operators[right][0] == 0


@pytest.mark.parametrize("name", MODELS)
def test_the_model_fills_the_picture(name, trees):
    """Between half and three quarters of the pixels, by the tracer that is simplest."""
    view = MODELS[name].view(64, 64)
    hit = np.isfinite(tracers.make("naive", trees[name]).render(view).depth)
    assert 0.5 < hit.mean() < 0.75


SIZES = {
    "ball": [2, 3, 10, 74, 75, 101, 612, 613, 1225, 5001],
    "ngk": [10, 11, 29, 30, 59, 60, 74, 75, 94, 95, 997, 5003],
    "ngkcut": [11, 96, 1000],
}


@pytest.mark.parametrize(("family", "n"), [(f, n) for f in FAMILIES for n in SIZES[f]])
def test_a_generated_model_has_the_size_asked_for(family, n, tmp_path):
    tree = tracers.load_csg(str(synthesize(family, n, 1, tmp_path / "made.csg")))
    assert (tree.halfspaces, tree.nodes) == (n, 2 * n - 1)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_hundred_thousand_halfspaces(family, tmp_path):
    tree = tracers.load_csg(str(synthesize(family, 100_000, 1, tmp_path / "made.csg")))
    assert tree.halfspaces == 100_000


@pytest.mark.parametrize("family", FAMILIES)
def test_a_seed_gives_the_same_bytes_and_another_seed_others(family, tmp_path):
    first, again, other = (
        synthesize(family, 700, seed, tmp_path / f"{i}.csg").read_bytes()
        for i, seed in enumerate([5, 5, 6])
    )
    assert first == again != other


def test_a_generated_scad_evaluates_to_the_generated_csg(tmp_path):
    scad = synthesize("ball", 200, 3, tmp_path / "made.scad")
    evaluate(scad, tmp_path / "of_scad.csg")
    csg = synthesize("ball", 200, 3, tmp_path / "made.csg")
    assert (tmp_path / "of_scad.csg").read_bytes() == csg.read_bytes()


@pytest.mark.parametrize(
    ("family", "n", "name", "complaint"),
    [
        ("cube", 100, "x.csg", "no family 'cube'; known: ball, ngk, ngkcut"),
        ("ngk", 9, "x.csg", "9 halfspaces are too few"),
        ("ball", 100, "x.stl", "written as .scad or .csg"),
    ],
)
def test_what_cannot_be_made_is_one_line(family, n, name, complaint, tmp_path):
    with pytest.raises(UserError, match=complaint) as error:
        synthesize(family, n, 1, tmp_path / name)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("written", "instead", "complaint"),
    [
        ("nodes = 1223\n", "", "ball.nodes is missing"),
        ("nodes = 1223\n", "nodes = 1223\nshade = 1\n", "ball.shade is unknown; known: file, "),
        ("fov_deg = ", "fov = ", "ball.camera.fov_deg is missing"),
        ("nodes = 1223", "nodes = 1223.5", "ball.nodes: 1223.5 should be a whole number"),
        ("size = [512, 512]", "size = [512]", r"ball.size: \[512\] should be 2 numbers"),
        ("[ball]", "[ball", "scenes.toml: "),
    ],
)
def test_scenes_are_read_strictly(written, instead, complaint, tmp_path):
    text = SCENES.read_text()
    assert written in text
    path = tmp_path / "scenes.toml"
    path.write_text(text.replace(written, instead, 1))
    with pytest.raises(UserError, match=complaint):
        load_scenes(path)


def test_a_structure_that_is_too_large_is_one_line_and_a_row(monkeypatch):
    def make(*_):
        raise RuntimeError("the structure would exceed 4 GiB")  # what std::runtime_error becomes

    monkeypatch.setattr(tracers, "make", make)
    with pytest.raises(UserError, match="naive: the structure would exceed 4 GiB"):
        models.build("naive", models.tree("ball"), {})
    trial = trials.first(Configuration("ball", "naive", "{}", 8, 8, "as_written", 1, 1, 1.0, 1.0))
    outcome = trials.run(trial)
    assert (outcome.status, outcome.reason) == ("error", "naive: the structure would exceed 4 GiB")


def test_any_model_gets_a_camera_that_sees_all_of_it(trees):
    scene = frame(trees["ball"], Path("mine.csg"))
    low, high = trees["ball"].bounds
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, 8).T
    eye, forward = np.array(scene.eye), np.array(scene.look_at) - np.array(scene.eye)
    right = np.cross(forward, scene.up)
    above = np.cross(right, forward)
    for axis in (right, above):
        aside = (corners - eye) @ axis / np.linalg.norm(axis)
        depth = (corners - eye) @ forward / np.linalg.norm(forward)
        assert np.all(np.abs(aside / depth) <= np.tan(np.radians(scene.fov_deg / 2)))
    assert scene.view(64, 32).width == 64
