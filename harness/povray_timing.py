"""What a picture takes POV-Ray, and the work that it counts: a peer here, not a reference."""

from __future__ import annotations

import re
import tempfile
from dataclasses import dataclass
from pathlib import Path

from harness import povray_scene
from harness.povray import complaint, run_povray
from harness.povray_scene import PovrayError, Shot

# An orphan would disturb the next sweep's times for minutes.
_DYING_WITH_US = ("setpriv", "--pdeathsig", "KILL")


@dataclass(frozen=True)
class Timing:
    """What POV-Ray says that a picture took: colour and shadows, no antialiasing, not written."""

    parse_s: float  # and the building of its hierarchy
    trace_s: float
    counters: dict[str, int]  # in the terms of our own


def timed(tree, scene, width: int, height: int, bounds: str, threads: int) -> Timing:
    """bounds: one of povray_scene.BOUNDS."""
    text = povray_scene.final(Shot(tree, scene, width, height), bounds)
    with tempfile.TemporaryDirectory(prefix="povray-") as folder:
        (Path(folder) / "scene.pov").write_text(text)
        options = [f"+W{width}", f"+H{height}", f"+WT{threads}", "-F", "-D", "-A", "+Iscene.pov"]
        run = run_povray([*_DYING_WITH_US, "povray", *options], folder)
    if run.returncode != 0:
        raise PovrayError(f"POV-Ray failed to time a picture: {complaint(run)}")
    seconds = {
        what: float(s) for what, s in re.findall(r"(\w+) Time: .*\(([\d.]+) seconds\)", run.stderr)
    }
    tests = {
        what.strip(): int(n)
        for what, n in re.findall(r"^([A-Z][\w/ ]+?) +(\d+) +\d+ +[\d.]+ *$", run.stderr, re.M)
    }
    return Timing(
        seconds["Parse"] + seconds.get("Bounding", 0.0), seconds["Trace"], _counters(tests)
    )


def _counters(tests: dict[str, int]) -> dict[str, int]:
    """From POV-Ray's table of tests by shape. A node's bound is a box, and counted as one, too."""
    booleans = sum(n for shape, n in tests.items() if shape.startswith("CSG"))
    bounds = tests.get("Bounding Object", 0)
    shapes = sum(tests.get(shape, 0) for shape in ("Box", "Cone/Cylinder", "Sphere", "Torus"))
    return {
        "cells_entered": 0,
        "bounds_tested": bounds + tests.get("Bounding Box", 0),
        "primitives_tested": shapes - bounds,
        "booleans_evaluated": booleans,
    }
