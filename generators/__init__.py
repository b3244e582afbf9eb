"""Models of any size: the sources of models/, run through OpenSCAD with other parameters.

A larger model has more of the same (balls in a lattice, spark plugs in a tray); what does not
divide evenly goes into dimples or thread turns, so every size is met exactly. The same family, size
and seed give the same bytes.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field
from pathlib import Path

from harness import ROOT, UserError
from harness.openscad import evaluate


@dataclass(frozen=True)
class Family:
    """A source whose parameters `halfspaces` and `seed` say how much of it there is."""

    source: Path
    smallest: int  # halfspaces
    varies: str  # what the seed draws
    defines: dict[str, object] = field(default_factory=dict)  # beside those two


MODELS = ROOT / "models"
FAMILIES = {
    "ball": Family(
        MODELS / "ball.scad", 2, "the sizes of dimples and ports, by 15 percent", {"vary": 0.15}
    ),
    "ngk": Family(MODELS / "ngk.scad", 10, "how each plug is turned"),
    "ngkcut": Family(MODELS / "ngkcut.scad", 11, "how each plug is turned"),
}

_PRIMITIVE = re.compile(r"\b(?:sphere|cylinder|cube|rotate_extrude)\(")


def synthesize(family: str, halfspaces: int, seed: int, output: Path) -> Path:
    """Write a model of exactly so many halfspaces.

    `output` is a .csg, evaluated and counted, or a .scad, which includes the family's source.
    """
    if family not in FAMILIES:
        raise UserError(f"no family '{family}'; known: {', '.join(FAMILIES)}")
    source, smallest = FAMILIES[family].source, FAMILIES[family].smallest
    if halfspaces < smallest:
        raise UserError(f"{family}: {halfspaces} halfspaces are too few; it takes {smallest}")
    defines = {"halfspaces": halfspaces, "seed": seed, **FAMILIES[family].defines}

    output = output.resolve()
    if output.suffix == ".csg":
        evaluate(source, output, defines)
        made = len(_PRIMITIVE.findall(output.read_text()))
        if made != halfspaces:
            raise UserError(f"{source}: made {made} primitives where {halfspaces} were asked for")
    elif output.suffix == ".scad":
        lines = [f"include <{os.path.relpath(source, output.parent)}>"]
        lines += [f"{name} = {value};" for name, value in defines.items()]
        output.write_text("\n".join(lines) + "\n")
    else:
        raise UserError(f"{output}: a model is written as .scad or .csg")
    return output
