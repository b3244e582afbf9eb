"""Models of any size: the sources of models/, run through OpenSCAD with other parameters.

A larger model has more of the same (balls in a lattice, spark plugs in a tray); what does not
divide evenly goes into dimples or thread turns, so every size is met exactly. The same family, size
and seed give the same bytes.

OpenSCAD refuses loops of more than 10,000 turns, and its time grows faster than the model. So a
large model is evaluated some balls or plugs at a time, on all cores, and put together as text: the
same bytes as in one piece.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

from harness import ROOT, UserError
from harness.atomic import replacing
from harness.openscad import evaluate


@dataclass(frozen=True)
class Family:
    """A source whose parameters `halfspaces` and `seed` say how much of it there is."""

    source: Path
    smallest: int  # halfspaces
    varies: str  # what the seed draws
    defines: dict[str, object] = field(default_factory=dict)  # beside those two
    most_per_part: int | None = None  # halfspaces; the source makes those parts that `made` lists
    groups: int = 1  # that the parts stand in, in the .csg


MODELS = ROOT / "models"
FAMILIES = {
    "ball": Family(
        MODELS / "ball.scad", 2, "the sizes of dimples and ports, by 15 percent",
        {"vary": 0.15}, most_per_part=612,
    ),
    "ngk": Family(MODELS / "ngk.scad", 10, "how each plug is turned", most_per_part=94, groups=2),
    "ngkcut": Family(MODELS / "ngkcut.scad", 11, "how each plug is turned"),
}  # fmt: skip
AT_ONCE = 10_000  # halfspaces, about, that OpenSCAD is given in a piece

_PRIMITIVE = re.compile(rb"\b(?:sphere|cylinder|cube|rotate_extrude)\(")


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
        pieces = _pieces(FAMILIES[family], halfspaces)
        made = 0
        with TemporaryDirectory() as scratch, replacing(output) as whole:
            files = [Path(scratch, f"{i}.csg") for i in range(len(pieces))]
            with ThreadPoolExecutor(os.cpu_count()) as pool:  # OpenSCAD is a process of its own
                list(pool.map(lambda of: evaluate(source, of[0], defines | of[1]),
                              zip(files, pieces, strict=True)))  # fmt: skip
            with whole.open("wb") as text:
                for chunk in _joined(files, FAMILIES[family].groups):
                    made += len(_PRIMITIVE.findall(chunk))
                    text.write(chunk)
            if made != halfspaces:
                raise UserError(
                    f"{source}: made {made} primitives where {halfspaces} were asked for"
                )
    elif output.suffix == ".scad":
        lines = [f"include <{os.path.relpath(source, output.parent)}>"]
        lines += [f"{name} = {value};" for name, value in defines.items()]
        output.write_text("\n".join(lines) + "\n")
    else:
        raise UserError(f"{output}: a model is written as .scad or .csg")
    return output


def _pieces(family: Family, halfspaces: int) -> list[dict[str, object]]:
    """What to define beside the rest for each piece of the model."""
    if family.most_per_part is None or halfspaces <= 2 * AT_ONCE:
        return [{}]
    parts = range(-(-halfspaces // family.most_per_part))
    step = AT_ONCE // family.most_per_part
    return [{"made": list(parts[i : i + step])} for i in range(0, len(parts), step)]


def _joined(files: list[Path], groups: int) -> Iterator[bytes]:
    """The text of all pieces as one: parts of all stand in the same `groups` nested groups."""
    for i, file in enumerate(files):
        text = file.read_bytes()
        begin, end = 0, len(text)
        for _ in range(groups):
            if i > 0:
                begin = text.index(b"\n", begin) + 1  # after `group() {`
            if i < len(files) - 1:
                end = text.rindex(b"\n", 0, text.rindex(b"}", 0, end)) + 1
        yield text[begin:end]
