"""Pictures on disk, through OpenImageIO: PNG to look at, EXR to measure from.

A PNG is sRGB-encoded, 8 bits. An EXR holds linear float channels by name. Both are stable: the same
arrays give the same bytes, and a file appears whole or not at all.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from harness import UserError
from harness.atomic import replacing

_EPOCH = "1970:01:01 00:00:00"  # in every file: its bytes depend on the pixels alone


class ImageError(UserError):
    """A picture that cannot be read or written; one line, with the path."""


def srgb_from_linear(linear: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1 encoding of linear values, clipped to 0..1."""
    linear = np.clip(linear, 0.0, 1.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def write_png(path: str | Path, rgb: np.ndarray) -> None:
    """rgb: (H, W, 3), linear 0..1; what is outside is clipped."""
    pixels = np.round(255 * srgb_from_linear(rgb)).astype(np.uint8)
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], 3, oiio.UINT8)
    spec.attribute("oiio:ColorSpace", "sRGB")
    _write(Path(path), spec, pixels)


def write_exr(path: str | Path, channels: dict[str, np.ndarray]) -> None:
    """channels: name → (H, W) array, kept as 32-bit float (so integers are exact up to 2^24)."""
    pixels = np.stack([np.asarray(c, np.float32) for c in channels.values()], axis=-1)
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], oiio.FLOAT)
    spec.channelnames = tuple(channels)
    spec.attribute("compression", "zip")
    _write(Path(path), spec, pixels)


def read_exr(path: str | Path) -> dict[str, np.ndarray]:
    """Name → (H, W) float32. OpenEXR sorts its channels, so they are found by name alone."""
    image = _read(path)
    pixels = image.get_pixels(oiio.FLOAT)
    return {name: pixels[..., i] for i, name in enumerate(image.spec().channelnames)}


def read_codes(path: str | Path) -> np.ndarray:
    """(H, W, 3) uint16: the code values of a 16-bit PNG, with no gamma undone."""
    return _read(path).get_pixels(oiio.UINT16)


def picture_channels(picture) -> dict[str, np.ndarray]:
    """The EXR channels of a `tracers.Picture`. depth: model units along the ray, inf where it
    misses; leaf: -1 where it misses; lit: bit i set where light i arrives; cost: primitive tests
    a pixel, if they were counted."""
    channels = {
        **rgb_channels(picture.rgb),
        **normal_channels(picture.normal),
        "depth": picture.depth,
        "leaf": picture.leaf,
        "lit": picture.lit,
    }
    if picture.cost is not None:
        channels["cost"] = picture.cost
    return channels


def rgb_channels(rgb: np.ndarray) -> dict[str, np.ndarray]:
    """rgb: (H, W, 3) → R, G, B."""
    return {name: rgb[..., i] for i, name in enumerate("RGB")}


def normal_channels(normal: np.ndarray) -> dict[str, np.ndarray]:
    """normal: (H, W, 3) → normal.x, normal.y, normal.z."""
    return {f"normal.{axis}": normal[..., i] for i, axis in enumerate("xyz")}


def write_picture(path: str | Path, picture) -> None:
    """Writes a `tracers.Picture`, by its suffix: .png to look at, .exr with all channels."""
    suffix = Path(path).suffix.lower()
    if suffix == ".png":
        write_png(path, picture.rgb)
    elif suffix == ".exr":
        write_exr(path, picture_channels(picture))
    else:
        raise ImageError(f"{path}: a picture is written as .png or .exr, not as '{suffix}'")


def _write(path: Path, spec: oiio.ImageSpec, pixels: np.ndarray) -> None:
    spec.attribute("DateTime", _EPOCH)
    with replacing(path) as scratch:
        output = oiio.ImageOutput.create(str(scratch))
        if output is None:
            raise ImageError(f"{path}: {oiio.geterror()}")
        written = output.open(str(scratch), spec) and output.write_image(pixels)
        if not (output.close() and written):
            raise ImageError(f"{path}: {output.geterror()}")


def _read(path: str | Path) -> oiio.ImageBuf:
    image = oiio.ImageBuf(str(path))
    if not image.read(convert=oiio.UNKNOWN) or image.has_error:
        raise ImageError(f"{path}: {image.geterror()}")
    return image
