"""`csgbench doctor`: what is installed, and whether one scheme draws the smallest scene."""

from __future__ import annotations

from rich.console import Console

import tracers
from harness.machine import versions
from harness.models import scene, tree
from harness.scenes import load_scenes
from harness.schemes import catalogue

# What a missing one costs. Everything else is needed to run at all.
CONSEQUENCES = {
    "openscad": "no .scad file can be read",
    "povray": "pictures cannot be checked",
    "OpenImageIO": "no picture can be read or written",
    "manifold3d": "the schemes that trace a mesh cannot run",
    "matplotlib": "no plots",
}


def examine(console: Console) -> bool:
    """Print the findings; whether all is well."""
    built = dict(tracers.machine())
    compiler, flags = built.pop("compiler"), built.pop("flags")
    found = versions() | built
    for name, version in found.items():
        if version:
            console.print(f"[green]✓[/green] {name} {version}")
        else:
            console.print(f"[red]✗ {name}: {CONSEQUENCES.get(name, 'missing')}[/red]")
    console.print(f"[green]✓[/green] tracers: {compiler}", markup=True)
    console.print(f"  {flags}", markup=False)
    console.print(f"[green]✓[/green] schemes: {', '.join(catalogue())}")

    if not found["openscad"]:
        return False
    trees = {name: tree(name) for name in load_scenes()}
    smallest = min(trees, key=lambda name: trees[name].halfspaces)
    tracer = tracers.make("hybrid_sdsm", trees[smallest])
    picture = tracer.render(scene(smallest).view(64, 64))
    hits = int((picture.leaf >= 0).sum())
    mark = "[green]✓[/green]" if hits else "[red]✗[/red]"
    console.print(f"{mark} hybrid_sdsm on {smallest}, 64×64: {hits} pixels hit")
    return bool(hits) and all(found.values())
