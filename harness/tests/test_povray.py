"""POV-Ray's pictures against formulas and against our own tracer."""

from __future__ import annotations

import dataclasses
from functools import reduce
from types import SimpleNamespace

import numpy as np
import pytest

import tracers
from harness import povray, povray_scene
from harness.compare import compare
from harness.nary import DIFFERENCE, INTERSECTION, LEAF, UNION
from harness.povray import PovrayError, render_reference
from harness.scenes import frame

SIZE = 64
ROTATION = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
BALL = ("sphere", (1.0, 0, 0), np.eye(3), (0, 0, 0))
SHEAR = np.array([[1.0, 0.4, 0.2], [0.0, 0.8, 0.3], [0.0, 0.0, 1.2]])


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("povray")


def tree_of(solid):
    """solid: a leaf (kind, size, linear map, offset) or an operation (operator, solid, solid)."""
    leaves, rows = [], []

    def add(solid):
        if isinstance(solid[0], str):
            leaves.append(solid)
            rows.append((LEAF, len(leaves) - 1, -1))
        else:
            operator, left, right = solid
            rows.append((operator, add(left), add(right)))
        return len(rows) - 1

    add(solid)
    kinds, sizes, linear, offsets = zip(*leaves, strict=True)
    matrices = np.concatenate([np.array(linear), np.array(offsets, float)[:, :, None]], axis=2)
    return tracers.CsgTree.build(
        list(kinds), np.array(sizes, float), matrices, np.array(rows, np.int32)
    )


def union(*solids):
    return reduce(lambda left, right: (UNION, left, right), solids)


def ours_and_reference(tree, scene, cache, size=SIZE):
    picture = tracers.make("naive", tree).render(scene.view(size, size))
    return picture, render_reference(tree, scene, cache, size, size)


def test_a_sphere_is_the_formula(cache):
    radius, centre = 1.3, np.array([5.0, -3.0, 2.0])
    tree = tree_of(("sphere", (radius, 0, 0), np.eye(3), centre))
    scene = frame(tree)
    seen = render_reference(tree, scene, cache, SIZE, SIZE)

    eye = np.array(scene.eye) - centre
    rays = scene.view(SIZE, SIZE).primary_rays().reshape(SIZE, SIZE, 8)[..., 3:6]
    along = rays @ eye
    gap = radius**2 - np.sum((eye - along[..., None] * rays) ** 2, axis=-1)
    hit = gap > 0
    depth = -along[hit] - np.sqrt(gap[hit])
    normal = (eye + depth[:, None] * rays[hit]) / radius
    light = np.array(scene.ambient)
    for *position, red, green, blue in scene.lights:
        towards = np.array(position) - centre - radius * normal
        towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
        facing = np.maximum(0, np.sum(normal * towards, axis=-1, keepdims=True))
        light = light + facing * np.array([red, green, blue])

    assert np.array_equal(seen.mask, hit)
    assert np.all(np.isinf(seen.depth[~hit]))
    np.testing.assert_allclose(seen.depth[hit], depth, rtol=1e-12)
    assert angle_deg(seen.normal[hit], normal).max() < 0.0025
    np.testing.assert_allclose(seen.rgb[hit], light * scene.albedo, atol=1e-5)
    np.testing.assert_allclose(seen.rgb[~hit], [scene.background] * (~hit).sum(), atol=1e-5)


def angle_deg(a, b):
    return np.degrees(2 * np.arcsin(np.linalg.norm(a - b, axis=-1) / 2))


def test_every_primitive_under_every_map_is_ours(cache):
    primitives = [
        ("sphere", (0.9, 0, 0)),
        ("block", (0.9, 0.6, 0.4)),
        ("cylinder", (0.6, 0.8, 0)),
        ("cone", (0.9, 0.3, 0.7)),
        ("cone", (0, 0.8, 0.7)),
        ("torus", (0.7, 0.2, 0)),
    ]
    maps = [ROTATION, np.diag([1, 1, -1]) @ ROTATION, ROTATION @ SHEAR, 0.01 * SHEAR]
    leaves = []
    for row, linear in enumerate(maps):
        for column, (kind, size) in enumerate(primitives):
            scaled = np.array(size) * (100 if row == 3 else 1)
            leaves.append((kind, scaled, linear, (2.5 * column, 2.5 * row, 0)))
    tree = tree_of(union(*leaves))
    picture, reference = ours_and_reference(tree, frame(tree), cache, 128)
    assert compare(picture, reference).reasons == []
    assert len(np.unique(picture.leaf)) == len(leaves) + 1


def test_every_operator_is_ours(cache):
    def parts(x):
        ball = ("sphere", (1.0, 0, 0), np.eye(3), (x, 0, 0))
        bar = ("cylinder", (0.5, 2.0, 0), ROTATION, (x, 0, 0.3))
        other = ("sphere", (1.0, 0, 0), np.eye(3), (x, 0, 0.6))
        return ball, bar, other

    a, b, c = parts(0.0)
    left_difference = (DIFFERENCE, (DIFFERENCE, a, b), c)
    a, b, c = parts(3.0)
    right_difference = (DIFFERENCE, a, (DIFFERENCE, b, c))
    a, b, c = parts(6.0)
    intersection = (INTERSECTION, a, (UNION, b, c))
    a, b, c = parts(9.0)
    cut_union = (DIFFERENCE, (UNION, a, b), c)
    tree = tree_of(union(left_difference, right_difference, intersection, cut_union))
    picture, reference = ours_and_reference(tree, frame(tree), cache, 96)
    assert compare(picture, reference).reasons == []
    assert picture.lit.max() == 3
    assert (picture.lit[picture.leaf >= 0] < 3).any(), "no shadow to compare"


def test_an_eye_inside_sees_only_the_outer_walls(cache):
    balls = [("sphere", (1.0, 0, 0), np.eye(3), (x, 0, 0)) for x in (0.0, 1.2)]
    hole = ("block", (0.2, 0.2, 0.2), ROTATION, (0.4, 0.5, 0))
    tree = tree_of((DIFFERENCE, union(*balls), hole))
    scene = dataclasses.replace(frame(tree), eye=(-0.3, -0.2, 0.1), look_at=(1, 0.3, 0), fov_deg=90)
    assert povray_scene.contains(tree, scene.eye)
    picture, reference = ours_and_reference(tree, scene, cache)
    assert compare(picture, reference).reasons == []
    rays = scene.view(SIZE, SIZE).primary_rays().reshape(SIZE, SIZE, 8)[..., 3:6]
    assert np.all(np.sum(rays * reference.normal, axis=-1) > 0), "normals point out of the solid"


def test_bright_light_is_not_clipped(cache):
    tree = tree_of(BALL)
    scene = dataclasses.replace(frame(tree), ambient=(2.0, 3.0, 4.0), background=(5.0, 0.0, 0.0))
    reference = render_reference(tree, scene, cache, 16, 16)
    assert reference.rgb[0, 0] == pytest.approx([5, 0, 0], abs=1e-4)
    assert reference.rgb[8, 8, 2] > 3


def test_a_second_run_reads_the_first_ones_picture(cache, monkeypatch):
    tree = tree_of(("torus", (1.0, 0.4, 0), ROTATION, (0, 0, 0)))
    scene = frame(tree)
    first = render_reference(tree, scene, cache, 24, 16)
    monkeypatch.setattr(povray, "_render", lambda *_: pytest.fail("rendered again"))
    second = render_reference(tree, scene, cache, 24, 16)
    for name in ("rgb", "depth", "normal", "mask"):
        assert np.array_equal(getattr(first, name), getattr(second, name))
    with pytest.raises(pytest.fail.Exception, match="rendered again"):
        render_reference(tree, dataclasses.replace(scene, fov_deg=20.0), cache, 24, 16)


def test_a_failure_is_one_line_with_the_message_of_povray():
    with pytest.raises(
        PovrayError, match=r"on the final picture: File .* Parse Error: .*'sph'"
    ) as failure:
        povray._render("final", "#version 3.7;\nsph { 0, 1 }", 8, 8)
    assert "\n" not in str(failure.value)


def test_povray_missing_is_said(monkeypatch):
    monkeypatch.setenv("PATH", "")
    with pytest.raises(PovrayError, match="povray is not installed"):
        povray._render("final", "", 8, 8)


def fake_chain(rows):
    """What the exporter reads of a tree, without building one that deep."""
    leaves = sum(1 for op, _, _ in rows if op == 0)
    return SimpleNamespace(
        kinds=["sphere"] * leaves,
        sizes=np.tile([1.0, 0, 0], (leaves, 1)),
        matrices=np.tile(np.eye(3, 4), (leaves, 1, 1)),
        colors=np.full((leaves, 3), np.nan, np.float32),
        operators=np.array(rows, np.int32),
        bounds=np.array([[-1.0] * 3, [1.0] * 3]),
    )


def chain(length, operator_of):
    """((leaf op leaf) op leaf) op …, `length` operators."""
    rows = [(0, 0, -1)]
    for i in range(length):
        rows += [(0, i + 1, -1), (operator_of(i), 2 * i, 2 * i + 1)]
    return fake_chain(rows)


def test_a_long_chain_of_one_operator_is_flat():
    tree = chain(20_000, lambda _: UNION)
    text = povray_scene.final(povray_scene.Shot(tree, frame(tree_of(BALL)), 8, 8))
    assert text.count("union {") == 1
    assert text.count("sphere {") == 20_001


def test_a_chain_that_povray_cannot_nest_is_refused():
    tree = chain(6_000, lambda i: (UNION, INTERSECTION)[i % 2])
    shot = povray_scene.Shot(tree, frame(tree_of(BALL)), 8, 8)
    with pytest.raises(PovrayError, match="nested 5000 deep"):
        povray_scene.final(shot)


def test_an_eye_too_far_is_refused(cache):
    tree = tree_of(BALL)
    scene = dataclasses.replace(frame(tree), eye=(0, -1e6, 0))
    with pytest.raises(PovrayError, match="model sizes away"):
        render_reference(tree, scene, cache, 8, 8)
