"""Reference pictures by POV-Ray 3.7: independent code, the same tree, camera, lights and shading.

Every leaf becomes POV-Ray's own primitive under a matrix, never a mesh (harness/povray_scene.py).
Three renders give a Reference:

- final    linear 16-bit colour;
- depth    distance from the eye, and where there is one, as a number of three 16-bit digits;
- normal   n.x, n.y and n.z in three channels, by the `slope` pattern.

They resolve a depth to 2e-15 of the scene's reach, a normal to 0.0024°, and a colour to 7.6e-6 of
the brightest; harness/tests/test_povray.py measures it. POV-Ray is a tolerant reference, not the
truth: its tolerances are absolute, and it solves quartics by radicals.
"""

from __future__ import annotations

import hashlib
import re
import subprocess
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from harness import images, povray_scene
from harness.povray_scene import CODES, PovrayError, Shot

_COMMAND = ("povray", "+FN16", "File_Gamma=1.0", "-D", "-A", "Dither=off")


@dataclass(frozen=True)
class Reference:
    """What POV-Ray sees, in the terms of a `tracers.Picture`."""

    rgb: np.ndarray  # (H, W, 3) linear
    depth: np.ndarray  # (H, W) float64, model units from the eye along the ray; inf where it misses
    normal: np.ndarray  # (H, W, 3) unit, out of the solid; 0 where it misses
    mask: np.ndarray  # (H, W) bool: the ray hits


def render_reference(tree, scene, out_dir: str | Path, width: int, height: int) -> Reference:
    """Renders a `tracers.CsgTree` as seen in a `harness.scenes.Scene`, or finds it in the cache.

    The cache is `out_dir/<key>.exr`. The key is a hash of the three POV-Ray scenes, POV-Ray's
    version, the size and this file: whatever could change the pictures changes the key.
    """
    shot = Shot(tree, scene, width, height)
    texts = {
        "final": povray_scene.final(shot),
        "depth": povray_scene.depth(shot),
        "normal": povray_scene.normal(shot),
    }
    path = Path(out_dir) / f"povray-{_key(texts, width, height)}.exr"
    if not path.exists():
        with ThreadPoolExecutor() as pool:  # POV-Ray sleeps for most of a small picture
            codes = pool.map(lambda name: _render(name, texts[name], width, height), texts)
            _store(path, _decode(shot, **dict(zip(texts, codes, strict=True))))
    return _load(path)


# --- Running POV-Ray ----------------------------------------------------------------------------


def _render(name: str, text: str, width: int, height: int) -> np.ndarray:
    """(H, W, 3) uint16 codes. POV-Ray may only touch its working folder, so it is given one."""
    with tempfile.TemporaryDirectory(prefix="povray-") as folder:
        (Path(folder) / "scene.pov").write_text(text)
        size = (f"+W{width}", f"+H{height}")
        run = run_povray([*_COMMAND, *size, "+Iscene.pov", "+Opicture.png"], folder)
        if run.returncode != 0:
            raise PovrayError(f"POV-Ray failed on the {name} picture: {complaint(run)}")
        return images.read_codes(Path(folder) / "picture.png")


def run_povray(command: list[str], folder: str | None = None) -> subprocess.CompletedProcess[str]:
    try:
        return subprocess.run(command, cwd=folder, capture_output=True, text=True)
    except FileNotFoundError:
        raise PovrayError("povray is not installed") from None


def complaint(run: subprocess.CompletedProcess[str]) -> str:
    """POV-Ray's own message, which it breaks over lines, as one line."""
    if run.returncode < 0:
        return f"killed by signal {-run.returncode}"
    found = re.search(r"^(?!.*Possible).*Error:.*(?:\n .*)*", run.stderr, re.MULTILINE)
    return " ".join(found[0].split()) if found else f"exit code {run.returncode}"


@cache
def _version() -> str:
    said = run_povray(["povray", "--version"]).stderr
    return next((line for line in said.splitlines() if "POV-Ray" in line), said)


def _key(texts: dict[str, str], width: int, height: int) -> str:
    parts = [_version(), f"{width}x{height}", Path(__file__).read_text(), *texts.values()]
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:32]


# --- From codes to a Reference ------------------------------------------------------------------


def _decode(shot: Shot, final: np.ndarray, depth: np.ndarray, normal: np.ndarray) -> Reference:
    red, green, blue = np.moveaxis(depth.astype(float), -1, 0)
    mask = red > 0
    codes = red - 1 + (green + blue / CODES) / CODES
    distance = codes * (shot.reach / (CODES - 1) / shot.scale)
    towards_eye = -np.cos(np.pi / CODES * normal.astype(float))
    outward = -towards_eye if shot.eye_is_inside else towards_eye
    with np.errstate(invalid="ignore"):
        outward /= np.linalg.norm(outward, axis=-1, keepdims=True)
    return Reference(
        rgb=final * (shot.gain / CODES),
        depth=np.where(mask, distance, np.inf),
        normal=np.where(mask[..., None], outward, 0.0),
        mask=mask,
    )


def _store(path: Path, reference: Reference) -> None:
    """An EXR's floats have 24 bits, so a depth is kept as two: their sum has 48."""
    rounded = reference.depth.astype(np.float32)
    rest = np.where(reference.mask, reference.depth, 0) - np.where(reference.mask, rounded, 0)
    channels = images.rgb_channels(reference.rgb) | images.normal_channels(reference.normal)
    images.write_exr(path, channels | {"depth": rounded, "depth.rest": rest})


def _load(path: Path) -> Reference:
    channels = {name: pixels.astype(float) for name, pixels in images.read_exr(path).items()}
    depth = channels["depth"] + channels["depth.rest"]
    return Reference(
        rgb=np.stack([channels[name] for name in "RGB"], axis=-1),
        depth=depth,
        normal=np.stack([channels[f"normal.{axis}"] for axis in "xyz"], axis=-1),
        mask=np.isfinite(depth),
    )
