"""Pictures written and read back."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import OpenImageIO as oiio
import pytest

from harness import images
from harness.atomic import replacing
from harness.images import ImageError


def picture(cost=None):
    """Five by three pixels, no two values alike, the last pixel a miss."""
    rng = np.random.default_rng(2)
    depth = rng.uniform(1, 9, (3, 5))
    leaf = np.arange(15, dtype=np.int32).reshape(3, 5)
    depth[2, 4], leaf[2, 4] = np.inf, -1
    return SimpleNamespace(
        rgb=rng.uniform(size=(3, 5, 3)),
        normal=rng.normal(size=(3, 5, 3)),
        depth=depth,
        leaf=leaf,
        lit=(leaf % 4).astype(np.uint8),
        cost=cost,
    )


def test_a_png_is_srgb_and_clipped(tmp_path):
    linear = np.zeros((1, 5, 3))
    linear[0] = np.array([-1.0, 0.002, 0.2140, 1.0, 7.0])[:, None]
    images.write_png(tmp_path / "a.png", linear)
    codes = oiio.ImageBuf(str(tmp_path / "a.png")).get_pixels(oiio.UINT8)
    assert codes[0, :, 0].tolist() == [0, 7, 127, 255, 255]


def test_an_exr_gives_back_every_channel_by_name(tmp_path):
    written = picture(cost=np.arange(15.0).reshape(3, 5))
    images.write_picture(tmp_path / "a.exr", written)
    read = images.read_exr(tmp_path / "a.exr")
    expected = {
        **{name: written.rgb[..., i] for i, name in enumerate("RGB")},
        **{f"normal.{axis}": written.normal[..., i] for i, axis in enumerate("xyz")},
        "depth": written.depth,
        "leaf": written.leaf,
        "lit": written.lit,
        "cost": written.cost,
    }
    assert read.keys() == expected.keys()
    for name, values in expected.items():
        assert np.array_equal(read[name], values.astype(np.float32)), name


def test_cost_is_left_out_where_it_was_not_counted(tmp_path):
    images.write_picture(tmp_path / "a.exr", picture())
    assert "cost" not in images.read_exr(tmp_path / "a.exr")


@pytest.mark.parametrize("suffix", [".png", ".exr"])
def test_the_same_pixels_are_the_same_bytes(tmp_path, suffix):
    first, second = tmp_path / f"a{suffix}", tmp_path / "deeper" / f"b{suffix}"
    images.write_picture(first, picture())
    images.write_picture(second, picture())
    assert first.read_bytes() == second.read_bytes()


def test_another_suffix_is_refused(tmp_path):
    with pytest.raises(ImageError, match=r"written as \.png or \.exr, not as '\.gif'"):
        images.write_picture(tmp_path / "a.gif", picture())
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_is_no_picture_is_named(tmp_path):
    (tmp_path / "a.exr").write_text("no picture")
    with pytest.raises(ImageError, match=r"a\.exr: "):
        images.read_exr(tmp_path / "a.exr")


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")

    def fail_halfway():
        with replacing(path) as scratch:
            scratch.write_text("half")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail_halfway()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
