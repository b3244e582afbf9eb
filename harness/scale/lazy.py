"""What a lazy octree saves: cells built and time to the first picture against the eager one, for
one picture, a close-up and a fly-around; and what it takes from the .csg to the picture."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import tracers
from harness import UserError, models
from harness.atomic import replacing
from harness.machine import code_version
from harness.scale.plan import DEPTH, FAMILIES, HALFSPACES, SIDE
from harness.scenes import Scene
from harness.statistics import break_even

SIZES = (10_000, 100_000, 1_000_000)
SCHEME = "hybrid_sdsm"
ROUNDS = 3  # eager and lazy take turns
VIEWS = 36  # of the fly-around, 10° apart
DETAIL = 12.0  # half the width of a close-up in model units: one ball, one plug

Told = Callable[[str], None]


def measure_missing(folder: Path, told: Told) -> None:
    """Rows, one a family and size, that this version of the code has not measured yet."""
    rows = load(folder)
    for family in FAMILIES:
        for n in SIZES:
            model = f"{family}@{n}"
            if any(r["model"] == model and r.items() >= _conditions().items() for r in rows):
                continue
            told(f"{model}: lazy against eager")
            rows = [r for r in rows if r["model"] != model] + [measure(model)]
            with replacing(_file(folder)) as whole:
                whole.write_text(json.dumps(rows, indent=1) + "\n")


def load(folder: Path) -> list[dict]:
    """The rows so far, by family and size."""
    file = _file(folder)
    rows = json.loads(file.read_text()) if file.exists() else []
    return sorted(rows, key=lambda row: (row["family"], row["halfspaces"]))


def _conditions() -> dict:
    """What else a row depends on; with other ones it is measured anew."""
    return {"code_version": code_version(), "side": SIDE, "h": HALFSPACES, "views": VIEWS}


def measure(model: str) -> dict:
    """Times are wall times with all cores, in seconds; the least of the rounds."""
    path, scene = models.csg(model), models.scene(model)
    loads = []
    for _ in range(ROUNDS):
        begin = time.perf_counter(), time.process_time()
        tree = tracers.load_csg(str(path))
        loads.append((time.perf_counter() - begin[0], time.process_time() - begin[1]))
    load_s, load_cpu_s = np.min(loads, axis=0).tolist()
    row = {
        "model": model,
        "family": model.partition("@")[0],
        "halfspaces": tree.halfspaces,
        **_conditions(),
        "csg_bytes": path.stat().st_size,
        "load_s": load_s,
        "load_cpu_s": load_cpu_s,
    }
    close = close_up(tree, scene)
    for name, views, rounds in (
        ("picture", [scene], ROUNDS),
        ("close_up", [close], ROUNDS),
        ("fly_around", fly_around(scene), 1),
    ):
        row[name] = _compare(tree, views, rounds)
    return row


def _compare(tree: tracers.CsgTree, views: list[Scene], rounds: int) -> dict:
    """The views one after the other by a new eager and a new lazy octree; the same pictures."""
    taken: dict[str, list[list[float]]] = {"eager": [], "lazy": []}
    rays: list[int] = []
    built, size, hashes, build_s = {}, {}, {}, math.inf
    for _ in range(rounds):
        for build, all_taken in taken.items():
            given = {"d": DEPTH, "h": HALFSPACES, "build": build, "build_threads": 0}
            tracer = tracers.make(SCHEME, tree, given)
            if build == "eager":
                build_s = min(build_s, tracer.build_s)
            pictures = [
                tracer.render(view.view(SIDE, SIDE), threads=os.cpu_count()) for view in views
            ]
            all_taken.append([tracer.build_s, *(p.trace_s for p in pictures)])
            rays = [p.rays for p in pictures]
            facts = tracer.facts
            built[build] = facts["divided_cells"] + facts["partial_cells"]
            size[build], hashes[build] = tracer.bytes, [p.hash for p in pictures]
    if hashes["eager"] != hashes["lazy"]:
        raise UserError("the lazy octree's pictures are not the eager one's: a bug")
    eager, lazy = (np.min(taken[build], axis=0) for build in ("eager", "lazy"))
    return {
        "build_s": build_s,
        "eager_s": float(eager.sum()),
        "lazy_s": float(lazy.sum()),
        "fraction_built": built["lazy"] / built["eager"],
        "fraction_bytes": size["lazy"] / size["eager"],
        "rays": sum(rays),
        "break_even_rays": _break_even(np.cumsum(eager), np.cumsum(lazy), np.cumsum([0, *rays])),
    }


def _break_even(eager: np.ndarray, lazy: np.ndarray, rays: np.ndarray) -> float:
    """The number of rays from which on eager has taken less time, both times summed up from the
    start of building: between the views where they cross for the last time; beyond the last view,
    as its gain would have it; infinite if it gains nothing."""
    ahead = lazy - eager  # ≥ 0: eager is done sooner
    if ahead[-1] < 0:
        gain = ahead[-1] - ahead[-2]
        return float(rays[-1] + break_even(-ahead[-1], gain) * (rays[-1] - rays[-2]))
    behind = np.flatnonzero(ahead < 0)
    if len(behind) == 0:
        return 0.0
    i = behind[-1]
    share = -ahead[i] / (ahead[i + 1] - ahead[i])
    return float(rays[i] + share * (rays[i + 1] - rays[i]))


def close_up(tree: tracers.CsgTree, scene: Scene) -> Scene:
    """The detail in the middle of the scene, from the same eye through a longer lens."""
    tracer = tracers.make("sdsm", tree, {"d": DEPTH, "h": HALFSPACES, "build": "lazy"})
    view = scene.view(33, 33)
    rays = np.asarray(view.primary_rays())
    hits = tracer.trace(rays)
    from_middle = np.abs(np.arange(33 * 33) - 33 * 33 // 2)
    hit = min(np.flatnonzero(hits.leaf >= 0), key=lambda i: from_middle[i])
    at = rays[hit, :3] + hits.t[hit] * rays[hit, 3:6]
    fov_deg = 2 * math.degrees(math.atan(DETAIL / hits.t[hit]))
    return dataclasses.replace(scene, look_at=tuple(at.tolist()), fov_deg=fov_deg)


def fly_around(scene: Scene) -> list[Scene]:
    """The scene from all sides, at the height of its eye."""
    centre, eye = np.array(scene.look_at), np.array(scene.eye)
    views = []
    for i in range(VIEWS):
        angle = 2 * math.pi * i / VIEWS
        x, y, z = eye - centre
        turned = [
            x * math.cos(angle) - y * math.sin(angle), x * math.sin(angle) + y * math.cos(angle), z,
        ]  # fmt: skip
        views.append(dataclasses.replace(scene, eye=tuple((centre + turned).tolist())))
    return views


def _file(folder: Path) -> Path:
    return folder / "scale" / "lazy.json"
