"""Differences planted in a copy of our own picture: each must be found, and called what it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import OpenImageIO as oiio
import pytest

import tracers
from harness import compare as module
from harness.compare import SHADOW_EDGE, SILHOUETTE, UNEXPLAINED, compare, difference_picture
from harness.povray import Reference
from harness.scenes import frame

SIZE = 96
MODEL = """
cube(size = [8, 8, 1], center = true);
multmatrix([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 3], [0, 0, 0, 1]]) { sphere(r = 1.5); }
"""


@pytest.fixture(scope="module")
def ours():
    """A ball over a plate, with its shadows on it."""
    tree = tracers.parse_csg(MODEL)
    return tracers.make("naive", tree).render(frame(tree).view(SIZE, SIZE))


@pytest.fixture
def theirs(ours):
    mask = np.isfinite(ours.depth)
    return Reference(ours.rgb.copy(), ours.depth.copy(), ours.normal.copy(), mask)


@pytest.fixture
def smooth(ours):
    """Pixels where nothing changes within two pixels: (N, 2), y and x."""
    flat = ~module.edges(ours) & ~module._changes(ours.lit) & (ours.leaf >= 0)
    for _ in range(2):
        flat = np.all([flat, *module._neighbours(flat)], axis=0)
    return np.argwhere(flat)


def steps(values):
    """Pixels (y, x) whose right neighbour has another value."""
    return [tuple(pixel) for pixel in np.argwhere(values[:, 1:] != values[:, :-1])]


def classes_of(comparison):
    return {int(kind) for kind in np.unique(comparison.classes)} - {0}


def test_the_same_picture_passes(ours, theirs):
    comparison = compare(ours, theirs)
    assert comparison.passed
    assert comparison.figures["depth_max"] == comparison.figures["rgb_max"] == 0
    assert comparison.figures["hits"] == np.count_nonzero(theirs.mask) > 1000


def test_a_wrong_depth_fails(ours, theirs, smooth):
    y, x = smooth[0]
    theirs.depth[y, x] *= 1 + 1e-6
    comparison = compare(ours, theirs)
    assert classes_of(comparison) == {UNEXPLAINED}
    assert comparison.figures["depth_max"] == pytest.approx(1e-6, rel=1e-3)
    assert len(comparison.reasons) == 1
    assert f"1 pixels differ and are at no edge; the first, x {x} y {y}" in comparison.reasons[0]


def test_a_wrong_normal_fails(ours, theirs, smooth):
    y, x = smooth[0]
    nx, ny, nz = theirs.normal[y, x]
    angle = np.radians(0.01)
    c, s = np.cos(angle), np.sin(angle)
    theirs.normal[y, x] = (c * nx - s * nz, ny, s * nx + c * nz)
    comparison = compare(ours, theirs)
    assert classes_of(comparison) == {UNEXPLAINED}
    assert 0.003 < comparison.figures["normal_deg_max"] < 0.0101


def test_a_hole_in_the_middle_of_a_face_fails(ours, theirs, smooth):
    y, x = smooth[0]
    theirs.mask[y, x], theirs.depth[y, x] = False, np.inf
    comparison = compare(ours, theirs)
    assert comparison.figures["mask_flips"] == 1
    assert classes_of(comparison) == {UNEXPLAINED}


@pytest.mark.parametrize("name", ["rgb", "depth", "normal"])
def test_not_a_number_fails(ours, theirs, smooth, name):
    y, x = smooth[0]
    getattr(theirs, name)[y, x] = np.nan
    assert classes_of(compare(ours, theirs)) == {UNEXPLAINED}


def test_a_light_that_reaches_a_shadow_fails(ours, theirs, smooth):
    lit = np.array([ours.lit[y, x] for y, x in smooth])
    (y, x), (from_y, from_x) = smooth[lit == lit.min()][0], smooth[lit == lit.max()][0]
    theirs.rgb[y, x] = ours.rgb[from_y, from_x]
    comparison = compare(ours, theirs)
    assert classes_of(comparison) == {UNEXPLAINED}
    assert comparison.figures["rgb_over"] > 0


def test_a_shift_of_all_depths_too_small_to_see_fails(ours, theirs):
    comparison = compare(ours, replace(theirs, depth=theirs.depth * (1 + 1e-11)))
    assert comparison.figures["unexplained"] == 0
    assert len(comparison.reasons) == 1
    assert "1 depth in 1000 is off by more than 1e-11" in comparison.reasons[0]


def test_a_silhouette_one_pixel_aside_is_explained(ours, theirs):
    y, x = steps(ours.leaf)[0]
    for name in ("rgb", "depth", "normal"):
        getattr(theirs, name)[y, x] = getattr(ours, name)[y, x + 1]
    theirs.mask[y, x] = np.isfinite(theirs.depth[y, x])
    comparison = compare(ours, theirs)
    assert comparison.passed
    assert classes_of(comparison) == {SILHOUETTE}


def test_a_value_from_elsewhere_is_not_explained_by_an_edge(ours, theirs):
    y, x = steps(ours.leaf)[0]
    theirs.depth[y, x], theirs.mask[y, x] = 0.5 * np.min(ours.depth), True
    assert classes_of(compare(ours, theirs)) == {UNEXPLAINED}


def test_a_shadow_edge_one_pixel_aside_is_explained(ours, theirs):
    flat = ~module.edges(ours)
    y, x = next((y, x) for y, x in steps(ours.lit) if flat[y, x] and flat[y, x + 1])
    theirs.rgb[y, x] = ours.rgb[y, x + 1]
    comparison = compare(ours, theirs)
    assert comparison.passed
    assert classes_of(comparison) == {SHADOW_EDGE}


def test_too_many_explained_pixels_fail(ours, theirs):
    for y, x in steps(ours.leaf)[:20]:
        for name in ("rgb", "depth", "normal"):
            getattr(theirs, name)[y, x] = getattr(ours, name)[y, x + 1]
        theirs.mask[y, x] = np.isfinite(theirs.depth[y, x])
    comparison = compare(ours, theirs)
    assert comparison.reasons == ["20 pixels differ at a silhouette; 1 are allowed"]


def test_pictures_of_two_sizes_do_not_compare(ours):
    other = Reference(np.zeros((4, 8, 3)), np.ones((4, 8)), np.zeros((4, 8, 3)), np.ones((4, 8)))
    with pytest.raises(ValueError, match="96×96 and 8×4"):
        compare(ours, other)


def test_nothing_in_sight_compares(ours):
    nowhere = np.full((SIZE, SIZE), np.inf)
    empty = Reference(ours.rgb, nowhere, np.zeros((SIZE, SIZE, 3)), np.isfinite(nowhere))
    comparison = compare(ours, empty)
    assert not comparison.passed
    assert comparison.figures["depth_max"] == 0


def test_the_difference_picture_colours_the_pixel_by_its_class(ours, theirs, smooth, tmp_path):
    y, x = smooth[0]
    theirs.depth[y, x] *= 2
    difference_picture(tmp_path / "d.png", ours, theirs, compare(ours, theirs))
    pixels = oiio.ImageBuf(str(tmp_path / "d.png")).get_pixels(oiio.UINT8)[..., :3]
    zoom, gap, head = 400 // SIZE, 10, 30
    left = 3 * gap + 2 * SIZE * zoom
    middle = pixels[head + y * zoom + zoom // 2, left + x * zoom + zoom // 2]
    assert middle.tolist() == [0xD5, 0x5E, 0x00]
