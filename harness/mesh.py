"""Triangle meshes of CSG trees, by Manifold: what a user would trace instead of the solid itself.

Round primitives become polyhedra with their vertices on the true surface, as in OpenSCAD, with
`segments` edges to a full circle. A torus has them around its axis, and around its tube as many as
give edges the same sagitta: 20 of 64 for a tube a tenth as thick. With 64 both ways ngk takes more
than twice as long and deviates as much. Manifold makes a sphere from an octahedron; the edges
around it and around a tube are a multiple of four.
"""

from __future__ import annotations

import hashlib
import math
import time
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np
from manifold3d import CrossSection, Error, Manifold, OpType

from harness import RESULTS, UserError
from harness.atomic import replacing
from harness.nary import DIFFERENCE, INTERSECTION, LEAF, UNION, operands

_OP_TYPES = {UNION: OpType.Add, INTERSECTION: OpType.Intersect, DIFFERENCE: OpType.Subtract}


class MeshError(UserError):
    """A tree that has no mesh; one line."""


@dataclass(frozen=True)
class Mesh:
    vertices: np.ndarray  # (V, 3) float64, model units
    triangles: np.ndarray  # (T, 3) uint32, counter-clockwise from outside
    leaf_of_triangle: np.ndarray  # (T,) int32
    mesh_s: float  # wall seconds to make it, when it was made; Manifold uses all cores


def tessellate(tree, segments: int, cache: Path = RESULTS / "cache") -> Mesh:
    """The mesh of a `tracers.CsgTree`, from the cache if it was made before.

    The cache is `cache/mesh-<key>.npz`; the key is a hash of the tree, the segments, Manifold's
    version and this file.
    """
    path = cache / f"mesh-{_key(tree, segments)}.npz"
    if path.exists():
        with np.load(path) as stored:
            arrays = dict(stored)
        return Mesh(**arrays | {"mesh_s": float(arrays["mesh_s"])})
    mesh = _tessellate(tree, segments)
    with replacing(path) as scratch:
        np.savez_compressed(scratch, **vars(mesh))
    return mesh


def _tessellate(tree, segments: int) -> Mesh:
    started = time.monotonic()
    sizes = tree.sizes.tolist()
    local = [_primitive(kind, *sizes[leaf], segments) for leaf, kind in enumerate(tree.kinds)]
    leaf_of_original = {solid.original_id(): leaf for leaf, solid in enumerate(local)}
    placed = [solid.transform(tree.matrices[leaf]) for leaf, solid in enumerate(local)]
    mesh = _combine(tree.operators.tolist(), placed).to_mesh64()
    leaf_of_run = [leaf_of_original[original] for original in mesh.run_original_id]
    if not leaf_of_run:
        raise MeshError(f"the solid is empty at {segments} segments a circle")
    return Mesh(
        vertices=np.array(mesh.vert_properties[:, :3], np.float64),
        triangles=np.array(mesh.tri_verts, np.uint32),
        leaf_of_triangle=np.repeat(leaf_of_run, np.diff(mesh.run_index) // 3).astype(np.int32),
        mesh_s=time.monotonic() - started,
    )


def _primitive(kind: str, a: float, b: float, c: float, segments: int) -> Manifold:
    """A leaf in its own space: centred on the origin, axis z."""
    if kind == "sphere":
        return Manifold.sphere(a, segments)
    if kind == "block":
        return Manifold.cube((2 * a, 2 * b, 2 * c), center=True)
    if kind == "cylinder":
        return Manifold.cylinder(2 * b, a, a, segments, center=True)
    if kind == "cone":
        return Manifold.cylinder(2 * c, a, b, segments, center=True)
    tube = max(8, math.ceil(segments * math.sqrt(b / (a + b)) / 4) * 4)
    return CrossSection.circle(b, tube).translate((a, 0)).revolve(segments)


def _combine(operators: list[list[int]], leaves: list[Manifold]) -> Manifold:
    """The root's solid. Each n-ary operator is one batch, evaluated when its operands are: Manifold
    would defer them all and then recurse."""
    batches, pending = [], [len(operators) - 1]
    while pending:
        node = pending.pop()
        if operators[node][0] != LEAF:
            batches.append((node, operands(operators, node)))
            pending += batches[-1][1]
    solids = {node: leaves[left] for node, (op, left, _) in enumerate(operators) if op == LEAF}
    for node, parts in reversed(batches):
        operation = _OP_TYPES[operators[node][0]]
        solid = Manifold.batch_boolean([solids.pop(part) for part in parts], operation)
        if solid.status() != Error.NoError:
            raise MeshError(f"Manifold fails on operator {node}: {solid.status().name}")
        solids[node] = solid
    return solids[len(operators) - 1]


def _key(tree, segments: int) -> str:
    digest = hashlib.sha256()
    for part in (version("manifold3d"), Path(__file__).read_text(), segments, *tree.kinds):
        digest.update(f"{part}\0".encode())
    for array in (tree.sizes, tree.matrices, tree.operators):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:32]
