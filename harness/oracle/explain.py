"""`csgbench oracle`: one ray explained, from its crossings to what each scheme answered."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from rich.console import Console
from rich.table import Table

import tracers
from harness import UserError, models
from harness.openscad import to_csg
from harness.oracle.judge import Judgement, Verdict, judge
from harness.oracle.solid import Answer, Crossing, ExactSolid
from harness.scenes import Scene
from harness.schemes import Params, catalogue, complete, parse_settings, precision
from harness.trace import load, parse_size

_FACES = {
    "block": ("x low", "x high", "y low", "y high", "z low", "z high"),
    "cylinder": ("side", "bottom", "top"),
    "cone": ("side", "bottom", "top"),
}


def explain(
    out: Console,
    err: Console,
    model: str,
    pixel: tuple[int, int] | None = None,
    ray: np.ndarray | None = None,
    size: str | tuple[int, int] | None = None,
    scheme: str | None = None,
    settings: Sequence[str] = (),
) -> None:
    """Print all that happens on one ray of a scene, or of a .scad or .csg.

    pixel: x from the left, y from the top; without one, and without a ray, the middle. ray: (6,) or
    (8,) as in the tracers. size: `512x512` or (width, height) in pixels; the scene's own if None.
    scheme: whose answer is judged, set as the settings say; without one every exact scheme's, for
    which the settings are those that all have in common.
    """
    params = parse_settings(scheme or "naive", list(settings))
    tree, scene = load(err, model)
    solid = ExactSolid.from_csg(to_csg(scene.model, models.CACHE), tree)
    row = _checked(ray) if ray is not None else _pixel_ray(out, scene, pixel, size)
    answer = solid.answer(row)
    out.print(
        f"{model}: {tree.halfspaces:,} halfspaces, exact for the decimals in the .csg; "
        f"{len(solid.candidates(row))} near the ray"
    )
    out.print(f"origin    ({_triple(row[:3])})")
    out.print(f"direction ({_triple(row[3:6])}), {row[6]:g} < t < {row[7]:g}")
    if answer.coplanar:
        names = ", ".join(_name(solid, leaf) for leaf in answer.coplanar)
        out.print(
            f"The ray runs in the surface of {names}: taken as outside of it.", style="yellow"
        )
    out.print()
    out.print(_sentence(solid, answer))
    out.print()
    if params:
        out.print(f"Set: {' '.join(f'{name}={value}' for name, value in params.items())}")
    out.print(_schemes_table(solid, answer, row, scheme, params))
    out.print("E = u·(|o| + size): rounding of the way from the ray's origin to the halfspace.")
    if precision(params) == "float32":
        out.print("float32 adds 2⁻²⁴ of the halfspace's size: the way there is in double.")
    out.print()
    out.print(_crossings_table(solid, answer))


def _pixel_ray(
    out: Console,
    scene: Scene,
    pixel: tuple[int, int] | None,
    size: str | tuple[int, int] | None,
) -> np.ndarray:
    wanted = parse_size(size) if isinstance(size, str) else size
    width, height = wanted or (scene.width, scene.height)
    x, y = pixel or (width // 2, height // 2)
    if not (0 <= x < width and 0 <= y < height):
        raise UserError(f"pixel {x},{y} is not in a picture of {width}x{height}")
    out.print(f"pixel {x},{y} of {width}×{height}")
    return scene.view(width, height).primary_rays()[y * width + x]


def _checked(ray: np.ndarray) -> np.ndarray:
    row = np.array(ray, dtype=np.float64)
    if row.shape == (6,):
        row = np.append(row, [0.0, math.inf])
    if row.shape != (8,) or not np.isfinite(row[:6]).all() or not row[3:6].any():
        raise UserError("a ray is ox oy oz dx dy dz [t_min t_max], finite, its direction not zero")
    return row


def _name(solid: ExactSolid, leaf: int) -> str:
    return f"{solid.kinds[leaf]} {leaf}"


def _triple(values: np.ndarray) -> str:
    return ", ".join(f"{value:.17g}" for value in values)


def _add_column(table: Table, heading: str, right: bool) -> None:
    """Words of a narrow terminal go to the next line, and nothing is cut; numbers stay whole."""
    justify = "right" if right else "left"
    table.add_column(heading, justify=justify, overflow="fold", no_wrap=right)


# --- The crossings ------------------------------------------------------------------------------


def _crossings_table(solid: ExactSolid, answer: Answer) -> Table:
    table = Table(
        box=None, pad_edge=False, title="Crossings of the whole line", title_justify="left"
    )
    for heading in ("", "t", "halfspace", "face", "", "inside of", "the solid"):
        _add_column(table, heading, right=heading == "t")
    within: set[int] = set()
    for i, crossing in enumerate(answer.crossings):
        for change in crossing.changes:
            (within.add if change.inside else within.discard)(change.leaf)
        for j, change in enumerate(crossing.changes):
            faces = _FACES.get(solid.kinds[change.leaf], ("surface",))
            last = j + 1 == len(crossing.changes)
            table.add_row(
                "hit →" if i == answer.first and j == 0 else "",
                f"{crossing.t:.17g}" if j == 0 else "=",
                _name(solid, change.leaf),
                ", ".join(faces[piece] for piece in change.pieces),
                "enters" if change.inside else "leaves",
                str(len(within)) if last else "",
                _state(answer, i) if last else "",
            )
    return table


def _state(answer: Answer, i: int) -> str:
    inside = answer.crossings[i].inside
    before = answer.crossings[i - 1].inside if i else False
    return ("inside" if inside else "outside") + (", changed" if inside != before else "")


def _sentence(solid: ExactSolid, answer: Answer) -> str:
    start = "inside" if answer.starts_inside else "outside"
    hit = answer.hit
    if hit is None:
        return f"The ray starts {start} and meets no boundary: a certified miss."
    others = [_name(solid, leaf) for leaf in hit.leaves if leaf != answer.leaf]
    tie = f", at exactly the same t as {', '.join(others)}" if others else ""
    end = answer.span_end
    ends = "" if end is None else f" The solid changes next at t = {end:.17g}."
    return (
        f"The ray starts {start} and {'enters' if answer.entering else 'leaves'} the solid at "
        f"{_name(solid, answer.leaf)}{tie}, {_enclosure(hit)}.{ends}"
    )


def _enclosure(crossing: Crossing) -> str:
    return f"{crossing.low:.17g} < t < {crossing.high:.17g}, certified"


# --- The schemes --------------------------------------------------------------------------------


def _schemes_table(
    solid: ExactSolid, answer: Answer, ray: np.ndarray, scheme: str | None, params: Params
) -> Table:
    table = Table(box=None, pad_edge=False)
    for heading in ("scheme", "t", "halfspace", "verdict", "error, E", "normal, °"):
        _add_column(table, heading, right=heading in ("t", "error, E", "normal, °"))
    for name, hits in _answers(solid.tree, ray, scheme, params):
        if isinstance(hits, str):
            table.add_row(name, "", "", hits)
            continue
        t, leaf = float(hits.t[0]), int(hits.leaf[0])
        judgement = judge(solid, answer, ray, t, leaf, hits.normal[0], precision(params))
        table.add_row(
            name,
            f"{t:.17g}",
            "none" if leaf < 0 else _name(solid, leaf),
            _verdict(judgement) if catalogue()[name].exact else _off(answer, t),
            _figure(judgement.error),
            _figure(judgement.normal_deg),
        )
    return table


def _answers(
    tree: tracers.CsgTree, ray: np.ndarray, scheme: str | None, params: Params
) -> Iterator[tuple[str, tracers.Hits | str]]:
    """The scheme's, or every exact scheme's, or why it has none."""
    exact = [s.name for s in tracers.schemes() if s.exact and not s.needs_mesh]
    for name in [scheme] if scheme else exact:
        try:
            tracer, _ = models.build(name, tree, complete(name, params))
            yield name, tracer.trace(ray[None])
        except (ValueError, UserError) as error:
            yield name, str(error)


def _verdict(judgement: Judgement) -> str:
    shown = judgement.verdict.value.replace("_", " ")
    if judgement.verdict is Verdict.AGREE:
        return f"[green]{shown}[/green]"
    if judgement.verdict is Verdict.EXCUSED:
        return f"[yellow]{shown}: {judgement.reason}[/yellow]"
    return f"[red]{shown}[/red]"


def _off(answer: Answer, t: float) -> str:
    """Of a scheme that is not exact and promises no boundary to be met to E."""
    if (answer.hit is None) != math.isinf(t):
        return "[red]flip[/red]"
    return (
        "[green]agree[/green]"
        if answer.hit is None
        else f"inexact: off by {abs(t - answer.hit.t):.2g} in t"
    )


def _figure(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.2g}"
