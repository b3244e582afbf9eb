"""Meshes against the solids that they stand for."""

from __future__ import annotations

import math

import numpy as np
import pytest

import tracers
from harness import mesh as module
from harness.mesh import MeshError, tessellate
from harness.nary import DIFFERENCE, INTERSECTION, LEAF, UNION

ROTATION = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
MAPS = {
    "as it is": np.eye(3),
    "rotated": ROTATION,
    "mirrored": np.diag([1.0, 1.0, -1.0]),
    "sheared": np.array([[1.0, 0.4, 0.2], [0.0, 0.8, 0.3], [0.0, 0.0, 1.2]]),
}
PI = math.pi
PRIMITIVES = [
    ("sphere", (1.0, 0, 0), 4 / 3 * PI),
    ("block", (1.0, 0.5, 0.25), 1.0),
    ("cylinder", (1.0, 0.5, 0), PI),
    ("cone", (1.0, 0.5, 0.5), 7 / 12 * PI),
    ("cone", (0.0, 1.0, 0.5), PI / 3),
    ("cone", (1.0, 0.0, 0.5), PI / 3),
    ("torus", (2.0, 0.5, 0), PI**2),
]


def leaf(kind, size, linear):
    matrix = np.column_stack([linear, [3.0, -2.0, 1.0]])
    return tracers.CsgTree.build(
        [kind], np.array([size]), matrix[None], np.array([[LEAF, 0, -1]], np.int32)
    )


def volume(mesh):
    """Positive where the triangles are counter-clockwise from outside."""
    a, b, c = (mesh.vertices[mesh.triangles[:, corner]] for corner in range(3))
    return np.sum(a * np.cross(b, c)) / 6


@pytest.mark.parametrize("linear", MAPS.values(), ids=MAPS)
@pytest.mark.parametrize(("kind", "size", "expected"), PRIMITIVES)
def test_a_primitive_has_its_volume(kind, size, expected, linear, tmp_path):
    mesh = tessellate(leaf(kind, size, linear), 64, tmp_path)
    expected *= abs(np.linalg.det(linear))
    assert 0.99 * expected < volume(mesh) <= expected * (1 + 1e-12)
    assert (mesh.leaf_of_triangle == 0).all()


def test_more_segments_come_closer(tmp_path):
    errors = [
        1 - volume(tessellate(leaf("torus", (2.0, 0.5, 0), ROTATION), count, tmp_path)) / PI**2
        for count in (16, 32, 64)
    ]
    assert errors[0] > 3 * errors[1] > 9 * errors[2] > 0


def test_triangles_know_their_leaf(tmp_path):
    """A block with a cylinder through it and a ball on top."""
    tree = tracers.parse_csg("""
        union() {
          difference() {
            cube(size = [4, 4, 2], center = true);
            cylinder(h = 5, r1 = 1, r2 = 1, center = true);
          }
          multmatrix([[1, 0, 0, 1.5], [0, 1, 0, 1.5], [0, 0, 1, 1], [0, 0, 0, 1]]) {
            sphere(r = 0.4);
          }
        }""")
    mesh = tessellate(tree, 64, tmp_path)
    assert volume(mesh) == pytest.approx(4 * 4 * 2 - 2 * PI + 2 / 3 * PI * 0.4**3, rel=2e-3)
    assert mesh.vertices.dtype == np.float64
    assert mesh.triangles.dtype == np.uint32
    assert mesh.leaf_of_triangle.dtype == np.int32

    centroid = mesh.vertices[mesh.triangles].mean(axis=1)
    away = {
        0: np.max(np.abs(centroid) - [2, 2, 1], axis=1),
        1: np.hypot(centroid[:, 0], centroid[:, 1]) - 1,
        2: np.linalg.norm(centroid - [1.5, 1.5, 1], axis=1) - 0.4,
    }
    for index, distance in away.items():
        assert np.abs(distance[mesh.leaf_of_triangle == index]).max() < 2e-3
    assert set(mesh.leaf_of_triangle) == {0, 1, 2}


def chain(length, operator_of):
    """((a op b) op c) op …: unit cubes, each half a unit further along x."""
    rows = [(LEAF, 0, -1)]
    for i in range(length):
        rows += [(LEAF, i + 1, -1), (operator_of(i), 2 * i, 2 * i + 1)]
    matrices = np.tile(np.eye(3, 4), (length + 1, 1, 1))
    matrices[:, 0, 3] = np.arange(length + 1) / 2
    return tracers.CsgTree.build(
        ["block"] * (length + 1), np.full((length + 1, 3), 0.5), matrices, np.array(rows, np.int32)
    )


def test_a_long_chain_of_one_operator(tmp_path):
    assert volume(tessellate(chain(3000, lambda _: UNION), 8, tmp_path)) == pytest.approx(1501)


def test_a_long_chain_of_changing_operators(tmp_path):
    """Each union but the first adds a unit, and the difference after it takes half of it away."""
    tree = chain(300, lambda i: (UNION, DIFFERENCE)[i % 2])
    assert volume(tessellate(tree, 8, tmp_path)) == pytest.approx(1 + 149 / 2)


def test_an_empty_solid_is_refused(tmp_path):
    tree = chain(2, lambda _: INTERSECTION)
    with pytest.raises(MeshError, match="the solid is empty at 8 segments"):
        tessellate(tree, 8, tmp_path)


def test_the_second_time_it_is_read(tmp_path, monkeypatch):
    tree = leaf("sphere", (1.0, 0, 0), ROTATION)
    made = tessellate(tree, 16, tmp_path)
    monkeypatch.setattr(module, "_tessellate", lambda *_: pytest.fail("made again"))
    read = tessellate(tree, 16, tmp_path)
    assert read.mesh_s == made.mesh_s > 0
    for name in ("vertices", "triangles", "leaf_of_triangle"):
        assert np.array_equal(getattr(read, name), getattr(made, name))
        assert getattr(read, name).dtype == getattr(made, name).dtype
    with pytest.raises(pytest.fail.Exception, match="made again"):
        tessellate(tree, 17, tmp_path)


def test_a_tracer_takes_it(tmp_path):
    tree = leaf("sphere", (1.0, 0, 0), np.eye(3))
    mesh = tessellate(tree, 64, tmp_path)
    arrays = (mesh.vertices, mesh.triangles, mesh.leaf_of_triangle)
    inexact = [scheme.name for scheme in tracers.schemes() if scheme.needs_mesh]
    ray = np.array([[3.0, -2.0, 9.0, 0.0, 0.0, -1.0, 0.0, np.inf]])
    for name in inexact:
        hits = tracers.make(name, tree, {}, arrays).trace(ray)
        assert hits.t[0] == pytest.approx(7.0, abs=1e-3)
        assert hits.leaf[0] == 0


def test_packets_find_what_single_rays_find(tmp_path):
    """Of every length, and with rays among them that are none."""
    tree = leaf("torus", (2.0, 0.5, 0), ROTATION)
    mesh = tessellate(tree, 64, tmp_path)
    arrays = (mesh.vertices, mesh.triangles, mesh.leaf_of_triangle)
    one, sixteen = (tracers.make("embree_mesh", tree, {"packet": n}, arrays) for n in (1, 16))
    rng = np.random.default_rng(0)
    rays = np.zeros((1003, 8))
    rays[:, :3] = [3.0, -2.0, 9.0]
    rays[:, 3:6] = rng.normal((0, 0, -1), 0.2, (1003, 3))
    rays[:, 7] = np.where(rng.random(1003) < 0.2, rng.uniform(-1, 9, 1003), np.inf)
    rays[::50, 3:6] = 0
    for some in (rays, rays[:17], rays[:1]):
        alone, together = one.trace(some), sixteen.trace(some)
        assert (alone.leaf == together.leaf).all()
        assert np.allclose(alone.t, together.t, rtol=1e-6)
        assert np.allclose(alone.normal, together.normal, atol=1e-5)
        assert (one.occluded(some) == sixteen.occluded(some)).all()
    assert 100 < (one.trace(rays).leaf == 0).sum() < 900
    with pytest.raises(ValueError, match="'packet' is 1 or 16"):
        tracers.make("embree_mesh", tree, {"packet": 4}, arrays)
