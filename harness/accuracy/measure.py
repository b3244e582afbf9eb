"""What a setting errs, on the whole picture of a model: against the exact scheme in double, and
against the oracle wherever the two do not agree.

The exact scheme itself is held against the oracle on a sample of pixels and on every pixel on which
any two settings, or POV-Ray, disagree.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from types import SimpleNamespace

import flip_evaluator
import numpy as np

from harness import models
from harness.images import srgb_from_linear
from harness.oracle import ExactSolid, Tally, judge_rays
from harness.oracle.leaf import Line
from harness.oracle.surface import SurfacePoint
from harness.povray import render_reference
from harness.schemes import precision
from harness.study import Configuration

SAMPLE = 20_000  # pixels of the exact picture that the oracle is asked about
MOST_JUDGED = 3_000  # differing pixels of a setting that it is asked about: a random choice of them
MOST_MEASURED = 20_000  # hits whose distance from the true surface is measured
SHOWN = 512  # pictures of other sizes are compared as they look at this one
SUPERSAMPLED = 2048  # with the exact picture of this one

Told = Callable[[str], None]


@dataclass(frozen=True)
class View:
    """A model at a size: its rays, and the exact picture."""

    solid: ExactSolid
    rays: np.ndarray  # (H * W, 8)
    exact: SimpleNamespace  # see _flat


def measure(configurations: list[Configuration], told: Told) -> list[dict[str, float]]:
    """The figures of settings of one model. The first is the exact one, that all are held against.

    Figures are of pixels a picture, lengths relative to the model's size, angles in degrees."""
    first = configurations[0]
    tree = models.tree(first.model, first.shape)
    scene = models.scene(first.model)
    rng = np.random.default_rng(0)
    view = View(
        ExactSolid.from_csg(models.csg(first.model), tree),
        scene.view(first.width, first.height).primary_rays(),
        _flat(_picture(first)),
    )
    figures, disputed = [], np.zeros(len(view.rays), bool)
    for configuration in configurations:
        told(configuration.label())
        picture = _picture(configuration)
        if (configuration.width, configuration.height) == (first.width, first.height):
            found, differs = _errors(view, configuration, picture, rng)
            disputed |= differs
        else:
            found = {}
        if configuration.scheme == first.scheme and configuration.params == first.params:
            found["flip_shown"] = _flip_shown(configuration, picture)
        figures.append(found)
    disputed |= _differs_from_povray(first, view)
    told("the oracle on a sample and on every disputed pixel")
    sample = rng.choice(len(view.rays), min(SAMPLE, len(view.rays)), replace=False)
    figures[0] |= _against_oracle("sampled", view, np.sort(sample))
    figures[0] |= _against_oracle("disputed", view, np.flatnonzero(disputed))
    return figures


def _picture(c: Configuration):
    tracer, _ = models.build(c.scheme, models.tree(c.model, c.shape), json.loads(c.params))
    return tracer.render(models.scene(c.model).view(c.width, c.height))


def _flat(picture) -> SimpleNamespace:
    """Its planes by pixel, as hits: t (N,), leaf (N,), normal (N, 3), lit (N,)."""
    return SimpleNamespace(
        t=picture.depth.ravel(),
        leaf=picture.leaf.ravel(),
        normal=picture.normal.reshape(-1, 3),
        lit=picture.lit.ravel(),
        rgb=picture.rgb,
    )


def _at(hits: SimpleNamespace, pixels: np.ndarray) -> SimpleNamespace:
    return SimpleNamespace(t=hits.t[pixels], leaf=hits.leaf[pixels], normal=hits.normal[pixels])


def _errors(
    view: View, configuration: Configuration, picture, rng: np.random.Generator
) -> tuple[dict[str, float], np.ndarray]:
    """The figures, and which pixels show another leaf or a miss."""
    exact, ours = view.exact, _flat(picture)
    size = view.solid.tree.size
    hit, exact_hit = ours.leaf >= 0, exact.leaf >= 0
    flipped, both = hit != exact_hit, hit & exact_hit
    wrong = both & (ours.leaf != exact.leaf)
    right = both & ~wrong
    depth = (ours.t[both] - exact.t[both]) / size
    surface = _surface_errors(view, ours, _some(np.flatnonzero(right), MOST_MEASURED, rng)) / size
    apart = np.linalg.norm(ours.normal[right] - exact.normal[right], axis=1)
    angle = np.degrees(2 * np.arcsin(np.minimum(apart / 2, 1)))
    figures = {
        "pixels": len(hit),
        "flips": int(flipped.sum()),
        "wrong_leaves": int(wrong.sum()),
        "wrong_light": int((right & (ours.lit != exact.lit)).sum()),
        "depth_rmse": float(np.sqrt(np.mean(depth**2))),
        "surface_p999": _p999(surface),
        "surface_max": float(surface.max(initial=0)),
        "normal_p999_deg": _p999(angle),
        "flip": _flip(exact.rgb, ours.rgb),
    }
    of = precision(json.loads(configuration.params))
    for name, pixels in (("flips", flipped), ("wrong_leaves", wrong)):
        asked = _some(np.flatnonzero(pixels), MOST_JUDGED, rng)
        tally = _judged(view, ours, asked, of)
        share = pixels.sum() / max(len(asked), 1)
        figures[f"unexcused_{name}"] = float(share * len(tally.unexcused))
    return figures, flipped | wrong


def _some(pixels: np.ndarray, most: int, rng: np.random.Generator) -> np.ndarray:
    return pixels if len(pixels) <= most else np.sort(rng.choice(pixels, most, replace=False))


def _judged(view: View, hits: SimpleNamespace, pixels: np.ndarray, of: str) -> Tally:
    return judge_rays(view.solid, view.rays[pixels], _at(hits, pixels), of, processes=2)


def _against_oracle(name: str, view: View, pixels: np.ndarray) -> dict[str, float]:
    tally = _judged(view, view.exact, pixels, "float64")
    return {
        name: len(pixels),
        f"{name}_excused": len(pixels) - tally.verdicts["agree"] - len(tally.unexcused),
        f"{name}_unexcused": len(tally.unexcused),
        f"{name}_worst_E": tally.worst_error(),
    }


def _surface_errors(view: View, hits: SimpleNamespace, pixels: np.ndarray) -> np.ndarray:
    """Distance of each hit from the surface of its leaf, model units, evaluated exactly."""
    off = [
        max(
            SurfacePoint(
                view.solid.leaf(int(hits.leaf[i])), Line(view.rays[i]), hits.t[i]
            ).distances()
        )
        for i in pixels
    ]
    return np.abs(np.array(off))


def _p999(values: np.ndarray) -> float:
    return float(np.quantile(values, 0.999, method="higher")) if len(values) else 0.0


def _flip(reference: np.ndarray, picture: np.ndarray) -> float:
    """Mean FLIP of two pictures, (H, W, 3) linear."""
    both = [srgb_from_linear(np.clip(x, 0, 1)).astype(np.float32) for x in (reference, picture)]
    return float(flip_evaluator.evaluate(*both, "LDR")[1])


def _flip_shown(configuration: Configuration, picture) -> float:
    """Of the picture as seen at SHOWN pixels, against the exact one averaged down to that."""
    scene = models.scene(configuration.model)
    tree = models.tree(configuration.model, configuration.shape)
    tracer, _ = models.build(configuration.scheme, tree, json.loads(configuration.params))
    fine = tracer.render(scene.view(SUPERSAMPLED, SUPERSAMPLED), threads=2).rgb
    return _flip(_resized(fine), _resized(picture.rgb))


def _resized(rgb: np.ndarray) -> np.ndarray:
    """To SHOWN × SHOWN: pixels repeated, or averaged."""
    factor = len(rgb) / SHOWN
    if factor <= 1:
        return rgb.repeat(round(1 / factor), 0).repeat(round(1 / factor), 1)
    n = round(factor)
    return rgb.reshape(SHOWN, n, SHOWN, n, 3).mean((1, 3))


def _differs_from_povray(configuration: Configuration, view: View) -> np.ndarray:
    """Where POV-Ray hits and we do not, or the reverse."""
    c = configuration
    tree, scene = models.tree(c.model, c.shape), models.scene(c.model)
    reference = render_reference(tree, scene, models.CACHE, c.width, c.height)
    return reference.mask.ravel() != (view.exact.leaf >= 0)


def by_model(configurations: Iterable[Configuration]) -> dict[str, list[Configuration]]:
    groups: dict[str, list[Configuration]] = {}
    for configuration in configurations:
        groups.setdefault(configuration.model, []).append(configuration)
    return groups
