"""X5, X6: the walls of cells. A ray may run through cells' vertices, along their edges and inside
their walls, and faces of the solid may lie on them; no hit is lost, none is seen twice."""

from __future__ import annotations

import numpy as np

import tracers
from harness.adversaries.families import DIFFERENCE, UNION, Solid, placed
from harness.adversaries.walls import offsets, part
from harness.stability import Findings, row
from harness.stability.scenes import (
    EXCUSED_COSINE,
    GUARD,
    LIMITS,
    PRECISIONS,
    Tally,
    check_layers,
    chunks,
    directions,
    error_unit,
    joined,
    rays_through,
    same_bits,
    walk,
)

OCTREES = ("sdsm", "hybrid_sdsm", "packet_sdsm", "embree_cells")
DEEPEST, VOXELS = 10, 256


def world(tree: tracers.CsgTree, precision: str) -> np.ndarray:
    """(2, 3) corners of the padded world, to the bit, where leaves are only shifted."""
    pad = LIMITS[precision]["pad"] * tree.size
    return tree.bounds + np.array([[-pad], [pad]])


def octree_walls(tree, precision: str, rng: np.random.Generator, count: int, deepest: int):
    """(count, 3) vertices of the octree's cells down to a level, by the descent's additions."""
    lo, hi = world(tree, precision)
    centre = np.broadcast_to(0.5 * (lo + hi), (count, 3)).copy()
    half = (0.5 * (hi - lo)).max()
    level = rng.integers(0, deepest, (count, 3))
    for step in range(deepest):
        half *= 0.5
        centre += np.where(step < level, rng.choice([-half, half], (count, 3)), 0)
    return centre


def grid_walls(tree, precision: str, rng: np.random.Generator, count: int, voxels: int):
    """(count, 3) vertices of the grid's voxels."""
    lo, hi = world(tree, precision)
    voxel = (hi - lo).max() / voxels
    size = np.clip(np.floor((hi - lo) / voxel + 0.5), 1, voxels)
    return lo + rng.integers(0, size + 1, (count, 3)) * ((hi - lo) / size)


def wall_rays(tree, precision: str, rng: np.random.Generator, count: int) -> np.ndarray:
    """(count, 8) rays through cells' vertices: in any direction, inside a wall, along an edge,
    diagonally; half of them exactly, the others by an offset off. Some start at the vertex."""
    half = count // 2
    through = np.concatenate(
        [
            octree_walls(tree, precision, rng, half, DEEPEST),
            grid_walls(tree, precision, rng, count - half, VOXELS),
        ]
    )
    off = rng.random((count, 1)) < 0.5
    through += np.where(off, rng.choice(offsets(tree.size, precision), (count, 3)), 0)
    kind = rng.integers(4, size=(count, 1))
    axis = np.eye(3)[rng.integers(3, size=count)]
    any_way, signs = directions(rng, count), rng.choice([-1.0, 1.0], (count, 3))
    along = np.where(kind == 0, any_way, np.where(kind == 1, any_way * (axis == 0), signs))
    along = np.where(kind == 2, axis * signs + 0.0 * signs, along)  # ±0 across the edge
    along = np.where((kind == 3) & (rng.random((count, 1)) < 0.5), signs * (axis == 0), along)
    rays = rays_through(through, along, rng.choice([0, 0, 2, 4, 16], count))
    rays[:, 6] = np.where(rng.random(count) < 0.5, 0, -8)
    return rays


def plate(rng: np.random.Generator, halfspaces: int, thickness: float) -> tracers.CsgTree:
    """A block full of holes and bodies: the world is the block and a pad, to the bit."""
    solid = Solid()
    block = solid.leaf("block", [1, 1, thickness])
    parts = [part(solid, rng, 0.12) for _ in range(halfspaces - 1)]
    for matrix in solid.matrices[1:]:
        matrix[2, 3] *= thickness
    return solid.tree([DIFFERENCE, block, joined(UNION, parts)])


@row("X5", "octree of depth 10 and grid of 256³: rays in walls", tests=1_000_000, full=100_000_000)
def rays_in_walls(rays: int, rng: np.random.Generator) -> Findings:
    """Rays go by the scheme that answers them. The tests' plate is thin: it fills a sixteenth of
    the octree and the grid, which are built in a sixteenth of the time."""
    settings = [(scheme, {"d": DEEPEST, "h": 1}) for scheme in OCTREES]
    settings.append(("uniform_grid", {"n": VOXELS}))
    tree = plate(rng, 300, 1.0) if rays > 1_000_000 else plate(rng, 30, 1 / 16)
    for precision in PRECISIONS:
        numerics = {"precision": precision}
        naive = tracers.make("naive", tree, numerics)
        tallies = [
            Tally("X5", f"{scheme}, {precision}", "first hit unlike naive's")
            for scheme, _ in settings
        ]
        built = [tracers.make(scheme, tree, params | numerics) for scheme, params in settings]
        for count in chunks(-(-rays // (len(settings) * len(PRECISIONS))), 500_000):
            batch = wall_rays(tree, precision, rng, count)
            truth = naive.trace(batch)
            t, leaf = truth.t, truth.leaf
            for tracer, tally in zip(built, tallies, strict=True):
                hits = tracer.trace(batch)
                tally.add(count, ((hits.t != t) | (hits.leaf != leaf)).sum())
        yield from (tally.finding() for tally in tallies)


def comb(faces: np.ndarray) -> tuple[tracers.CsgTree, np.ndarray]:
    """Slabs [faces[0], faces[1]], [faces[2], faces[3]], … across x, and their exact faces."""
    solid, parts, exact = Solid(), [], []
    for lo, hi in faces.reshape(-1, 2):
        half, middle = (hi - lo) / 2, (hi + lo) / 2
        parts.append(solid.leaf("block", [half, 1, 1], placed(middle, 0, 0)))
        exact += [np.longdouble(middle) - half, np.longdouble(middle) + half]
    return solid.tree(joined(UNION, parts)), np.array(exact)


def dyadic_faces(rng: np.random.Generator, precision: str) -> np.ndarray:
    return np.append(np.arange(-8, 8)[:-1] / 8, 1.0)


def decimal_faces(rng: np.random.Generator, precision: str) -> np.ndarray:
    """0.1 + 0.1 + … in place of 0.1·k: planes that a modeller takes for one."""
    return -1 + np.cumsum(np.full(20, 0.1)) - 0.1


def faces_at_walls(rng: np.random.Generator, precision: str) -> np.ndarray:
    """Walls of octree and grid down to level 4, and an offset off them."""
    frame, _ = comb(np.array([-1.0, -0.9, 0.9, 1.0]))
    wall = np.unique(octree_walls(frame, precision, rng, 400, 4)[:, 0])
    inner = wall[np.abs(wall) < 0.85]
    inner = inner[: len(inner) // 2 * 2]
    return np.array([-1.0, *(inner + rng.choice(offsets(frame.size, precision), len(inner))), 1.0])


def plane_layers(rays: np.ndarray, faces: np.ndarray, axis: int = 0):
    """Where rays cross planes, ascending: t (N, K) longdouble and |cosine| (N, 1)."""
    along = rays[:, 3 + axis].astype(np.longdouble)[:, None]
    t = (faces - rays[:, axis].astype(np.longdouble)[:, None]) / along
    return np.sort(t, axis=1), np.abs(rays[:, 3 + axis])[:, None]


def board(step: float) -> tuple[tracers.CsgTree, np.ndarray]:
    """Cubes like the black fields of a chessboard, 4³ fields, and the planes between fields."""
    solid, parts = Solid(), []
    planes = step * np.arange(-2, 3)
    for field in np.argwhere(np.indices((4, 4, 4)).sum(axis=0) % 2 == 0):
        middle = planes[field] + step / 2
        parts.append(solid.leaf("block", [step / 2] * 3, placed(*middle)))
    return solid.tree(joined(UNION, parts)), planes


def board_layers(rays: np.ndarray, planes: np.ndarray):
    """Where rays that start outside cross into or out of a black field: t (N, 15) and |cosine|."""
    origin, along = rays[:, None, :3].astype(np.longdouble), rays[:, None, 3:6]
    t = ((planes[:, None] - origin) / along).reshape(len(rays), -1)
    cosine = np.broadcast_to(np.abs(along), (len(rays), len(planes), 3)).reshape(t.shape)
    order = np.argsort(t, axis=1)
    t, cosine = np.take_along_axis(t, order, 1), np.take_along_axis(cosine, order, 1)
    between = origin + (t[:, :-1] + t[:, 1:])[..., None] / 2 * along
    field = np.floor((between - planes[0]) / (planes[1] - planes[0]))
    black = ((field >= 0) & (field < 4)).all(axis=2) & (field.sum(axis=2) % 2 == 0)
    ends = np.zeros((len(rays), 1), dtype=bool)
    changes = np.diff(np.concatenate([ends, black, ends], axis=1), axis=1)
    t = np.where(changes, t, np.inf)
    order = np.argsort(t, axis=1, kind="stable")
    return np.take_along_axis(t, order, 1), np.take_along_axis(cosine, order, 1)


def comb_rays(rng: np.random.Generator, count: int) -> np.ndarray:
    """(count, 8) rays through all slabs of a comb, from either side, some along the axis."""
    ends = rng.uniform(-0.95, 0.95, (2, count, 3))
    ends[0, :, 0], ends[1, :, 0] = -1.5, 1.5
    straight = rng.random(count) < 0.3
    ends[1, straight, 1:] = ends[0, straight, 1:]
    ends = np.where(rng.random((count, 1)) < 0.5, ends, ends[::-1])
    along = ends[1] - ends[0]
    return rays_through(ends[0], along / np.linalg.norm(along, axis=1)[:, None], 0)


def board_rays(rng: np.random.Generator, count: int) -> np.ndarray:
    at, along = rng.uniform(-1, 1, (count, 3)), directions(rng, count)
    return rays_through(at, along, 6)


SEEN_BY = [("naive", {}), *((s, {"d": 5, "h": 1}) for s in OCTREES), ("uniform_grid", {"n": 32})]


@row("X6", "faces on the walls of cells: each hit is seen once", tests=1_000_000, full=10_000_000)
def faces_on_walls(rays: int, rng: np.random.Generator) -> Findings:
    """Against the known construction, and every scheme's layers against naive's, to the bit. Rays
    go by the scheme that answers them."""
    combs = {"dyadic": dyadic_faces, "decimal": decimal_faces, "at walls": faces_at_walls}
    cases = [*(f"comb, {name}" for name in combs), "board, dyadic", "board, decimal"]
    for case in cases:
        for precision in PRECISIONS:
            numerics = {"precision": precision}
            if case.startswith("comb"):
                tree, faces = comb(combs[case.split(", ")[1]](rng, precision))
            else:
                tree, faces = board(0.5 if case.endswith("dyadic") else 0.3)
            built = [tracers.make(s, tree, p | numerics) for s, p in SEEN_BY]
            known = Tally("X6", f"{case}, {precision}", "surface error, E", GUARD)
            others = Tally("X6", f"{case}, {precision}: schemes", "layers unlike naive's")
            for count in chunks(-(-rays // (2 * len(cases) * len(SEEN_BY)))):
                if case.startswith("comb"):
                    batch = comb_rays(rng, count)
                    truth, cosine = plane_layers(batch, faces)
                    cosine = np.broadcast_to(cosine, truth.shape)
                else:
                    batch = board_rays(rng, count)
                    truth, cosine = board_layers(batch, faces)
                unit = error_unit(tree, batch, precision)
                found = [walk(tracer, tree, batch, precision) for tracer in built]
                check_layers(known, found[0], truth, cosine, unit, EXCUSED_COSINE[precision])
                for other in found[1:]:
                    others.add(count, (~same_bits(found[0], other)).sum())
            yield known.finding()
            yield others.finding()
