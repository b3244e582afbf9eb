"""`python -m generators`: a model of the size asked for."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from generators import FAMILIES, synthesize
from harness import UserError

EXAMPLES = """\
examples:
  python -m generators --family ngk --halfspaces 10000 -o /tmp/plugs.csg
  python -m generators --family ball --halfspaces 100000 --seed 7 -o /tmp/balls.csg
  python -m generators --family ngkcut --halfspaces 500 -o /tmp/few.scad && openscad /tmp/few.scad

A .csg is what `csgbench trace` and the loader read; a .scad is a few lines over models/*.scad, to
look at and to edit. The same family, size and seed give the same bytes.
"""


def main(arguments: list[str] | None = None) -> int:
    families = "\n".join(
        f"  {name:8}from {family.smallest:2} halfspaces; the seed draws {family.varies}"
        for name, family in FAMILIES.items()
    )
    parser = argparse.ArgumentParser(
        prog="python -m generators",
        description="Make a CSG model of exactly the size asked for, with OpenSCAD.",
        epilog=f"families:\n{families}\n\n{EXAMPLES}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--family", required=True, choices=FAMILIES)
    parser.add_argument("--halfspaces", required=True, type=int, metavar="N", help="primitives")
    parser.add_argument("--seed", type=int, default=1, help="default: 1")
    parser.add_argument("-o", "--output", required=True, type=Path, help="a .csg or a .scad file")
    asked = parser.parse_args(arguments)
    try:
        synthesize(asked.family, asked.halfspaces, asked.seed, asked.output)
    except (UserError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
