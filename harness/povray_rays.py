"""Any rays by POV-Ray, not only a camera's: its scene language has a function `trace`.

Within POV-Ray's own scale, to which models are brought as in povray_scene.py unless one asks for
theirs; its tolerances are absolute. About 50,000 rays a second.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from harness.povray import complaint, run_povray
from harness.povray_scene import Frame, PovrayError, solid

# The parameter of a hit is written with all digits that a double has.
_SCENE = """#version 3.7;
global_settings {{ assumed_gamma 1.0 }}
#declare Solid =
{solid}
#fopen Rays "rays.csv" read
#fopen Hits "hits.csv" write
#while (defined(Rays))
  #read (Rays, Ox, Oy, Oz, Dx, Dy, Dz)
  #local O = <Ox, Oy, Oz>;
  #local D = <Dx, Dy, Dz>;
  #local N = <0, 0, 0>;
  #local P = trace(Solid, O, D, N);
  #if (vlength(N) != 0)
    #write (Hits, str(vdot(P - O, D) / vdot(D, D), 0, 17), "\\n")
  #else
    #write (Hits, "-1\\n")
  #end
#end
#fclose Rays
#fclose Hits
"""


def trace(tree, rays: np.ndarray, own_scale: bool = False) -> np.ndarray:
    """(N,) float64: the parameter of each ray's first hit, inf where it misses. rays: (N, 8)
    float64; t_min and t_max are not heeded, and t is POV-Ray's from |dir| = 1 on. own_scale: leave
    the model and its rays as they are, at the mercy of absolute tolerances."""
    frame = Frame(tree)
    if own_scale:
        frame.centre, frame.scale = np.zeros(3), 1.0
    speed = np.linalg.norm(rays[:, 3:6], axis=1)
    rows = np.column_stack([frame.scaled(rays[:, :3]), rays[:, 3:6] / speed[:, None]])
    with tempfile.TemporaryDirectory(prefix="povray-") as folder:
        lines = (", ".join(map(repr, row)) for row in rows.tolist())
        Path(folder, "rays.csv").write_text(",\n".join(lines) + "\n")
        Path(folder, "scene.pov").write_text(_SCENE.format(solid=solid(frame)))
        run = run_povray(["povray", "+W1", "+H1", "-D", "-F", "+Iscene.pov"], folder)
        if run.returncode != 0:
            raise PovrayError(f"POV-Ray failed to trace rays: {complaint(run)}")
        t = np.loadtxt(Path(folder, "hits.csv"), ndmin=1)
    return np.where(t < 0, np.inf, t / (frame.scale * speed))
