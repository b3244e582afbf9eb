"""What must not change an answer: units, the length of a direction, a far origin, which rays are
traced together and by which thread; and bad input.

Each was broken once: cbrt and thresholds made a torus' bits depend on the scale, floats overflowed
in Embree where directions were long, a moved ray found the hit at its own t_min again, and a miss
came back with a NaN.
"""

import zlib
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from test_conformance import EXACT, assert_same, differing, grid

import tracers
from harness.adversaries import FAMILIES
from harness.adversaries.aim import all_rays, rays_for
from harness.adversaries.families import INTERSECTION, Solid, placed

INF, NAN = np.inf, np.nan


def seeded(family: str, number: int = 0) -> "tuple[tracers.CsgTree, np.random.Generator]":
    rng = np.random.default_rng([number, zlib.crc32(family.encode()), 7])
    return FAMILIES[family](rng), rng


def all_tracers(tree, number: int):
    """One setting of each exact scheme, naive first."""
    yield "naive", {}, tracers.make("naive", tree)
    for scheme in EXACT:
        params = grid(scheme)[number % len(grid(scheme))]
        yield scheme.name, params, tracers.make(scheme.name, tree, params)


def without_denormals(rays: np.ndarray) -> np.ndarray:
    """Scaling takes bits from these."""
    rays[np.abs(rays) < 1e-100] = 0
    return rays


class Scaled:
    """Hits whose t is multiplied by 2**exponent."""

    def __init__(self, hits, exponent: int) -> None:
        self.t, self.leaf = np.ldexp(hits.t, exponent), hits.leaf
        self.normal = hits.normal


@pytest.mark.parametrize("family", FAMILIES)
def test_other_units_give_the_same_bits(family: str) -> None:
    for number, exponent in enumerate([-100, -37, -3, -1, 1, 2, 7, 100]):
        tree, rng = seeded(family, number)
        rays = without_denormals(all_rays(tree, rng, 300))
        expected = Scaled(tracers.make("naive", tree).trace(rays), exponent)
        scaled = rays.copy()
        scaled[:, [0, 1, 2, 6, 7]] = np.ldexp(rays[:, [0, 1, 2, 6, 7]], exponent)
        for name, params, tracer in all_tracers(tree.scaled(exponent), number):
            assert_same(tree, name, params, tracer, scaled, expected)


@pytest.mark.parametrize("family", FAMILIES)
def test_directions_of_any_length_give_the_same_bits(family: str) -> None:
    """1e-300 to 1e300: squares of lengths under- and overflow well before."""
    tree, rng = seeded(family)
    rays = without_denormals(all_rays(tree, rng, 300))
    rays[:, 6:] *= np.linalg.norm(rays[:, 3:6], axis=1)[:, None]
    rays[:, 3:6] /= np.linalg.norm(rays[:, 3:6], axis=1)[:, None]
    hits = tracers.make("naive", tree).trace(rays)
    built = list(all_tracers(tree, 1))
    for exponent in [-900, -465, -200, -60, -1, 1, 60, 200, 498, 900]:
        scaled = rays.copy()
        scaled[:, 3:6] = np.ldexp(rays[:, 3:6], exponent)
        scaled[:, 6:] = np.ldexp(rays[:, 6:], -exponent)
        for name, params, tracer in built:
            assert_same(tree, name, params, tracer, scaled, Scaled(hits, -exponent))


@pytest.mark.parametrize("sizes_away", [40, 100, 1e3, 1e5, 1e8])
def test_a_hit_is_not_found_again_from_far_away(sizes_away: float) -> None:
    """t_min and t_max bound a hit also where the ray is moved first, which rounds t."""
    for number, family in enumerate(["random_solid", "lattice", "tori", "far_from_origin"]):
        tree, rng = seeded(family)
        rays = rays_for(tree, rng, 2000)
        rays[:, 6:] = 0, INF
        speed = np.linalg.norm(rays[:, 3:6], axis=1)
        rays[:, :3] -= sizes_away * tree.size * rays[:, 3:6] / speed[:, None]
        rays = rays[tracers.make("naive", tree).trace(rays).leaf >= 0]
        assert len(rays) > 100
        for name, params, tracer in all_tracers(tree, number):
            t = tracer.trace(rays).t
            later, ending = rays.copy(), rays.copy()
            later[:, 6] = ending[:, 7] = t
            again = tracer.trace(later)
            assert (again.t > t).all(), f"{name} {params}: t ≤ t_min"
            assert (tracer.trace(ending).leaf < 0).all(), f"{name} {params}: t ≥ t_max"
            assert not tracer.occluded(ending).any(), f"{name} {params}: occluded ≠ trace"
            assert np.array_equal(tracer.occluded(later), again.leaf >= 0), f"{name} {params}"


class Joined:
    """Hits of several calls as those of one."""

    def __init__(self, parts: list) -> None:
        self.t = np.concatenate([part.t for part in parts])
        self.leaf = np.concatenate([part.leaf for part in parts])
        self.normal = np.concatenate([part.normal for part in parts])


@pytest.mark.parametrize("family", ["random_solid", "lattice", "tangent"])
def test_other_batches_by_several_threads_give_the_same_bits(family: str) -> None:
    """Tracers keep memory from batch to batch, each for the next thread that comes."""
    tree, rng = seeded(family)
    rays = rays_for(tree, rng, 3000)
    expected = tracers.make("naive", tree).trace(rays)
    for name, params, tracer in all_tracers(tree, 3):
        with ThreadPoolExecutor(4) as threads:
            parts = threads.map(tracer.trace, np.array_split(rays, 300))
            wrong = differing(expected, Joined(list(parts)))
        assert len(wrong) == 0, f"{name} {params}: the first of {len(wrong)}: {rays[wrong[0]]}"


@pytest.mark.parametrize("family", ["random_solid", "lattice", "tori", "tangent"])
def test_rays_that_are_none(family: str) -> None:
    """NaN, infinite, zero, denormal: a miss, or a hit on which all agree, and never a NaN t."""
    tree, rng = seeded(family)
    large = [1e-320, 1e-200, 1e-100, 1e-30, 1, 1e30, 1e100, 1e150, 1e160, 1e308, INF]
    rays = rays_for(tree, rng, 6000)
    weird = rng.random(rays.shape) < 0.15
    rays[weird] = rng.choice([0.0, *large, *(-x for x in large), NAN, -0.0], int(weird.sum()))
    expected = tracers.make("naive", tree).trace(rays)
    assert not np.isnan(expected.t).any()
    assert (expected.leaf >= 0).sum() > 20
    bad = ~np.isfinite(rays[:, :6]).all(axis=1) | ~rays[:, 3:6].any(axis=1)
    assert (expected.leaf[bad | np.isnan(rays).any(axis=1)] < 0).all()
    for name, params, tracer in all_tracers(tree, 2):
        assert_same(tree, name, params, tracer, rays, expected)


@pytest.mark.parametrize("drift", [1e-155, -1e-158, 1e-161])
def test_a_drift_of_1e_155_does_not_reach_a_cylinder(drift: float) -> None:
    """A ray beside a cylinder: naive hit it, and schemes that pruned it did not."""
    solid = Solid()
    tree = solid.tree(solid.leaf("cylinder", [0.25, 1.0]))
    ray = np.array([[0.3, 0.05, 2, drift, 0, -1, 0, INF]])
    assert tracers.make("naive", tree).trace(ray).leaf[0] == -1


def empty_solid() -> "tracers.CsgTree":
    solid = Solid()
    far = solid.leaf("sphere", [1.0], placed(5, 0, 0))
    return solid.tree([INTERSECTION, solid.leaf("sphere", [1.0]), far])


def test_an_empty_solid_is_missed_without_any_work() -> None:
    """The octree once divided nothing into 8^7 cells."""
    tree, rng = empty_solid(), np.random.default_rng(3)
    rays = rays_for(tree, rng, 500)
    for name, params, tracer in all_tracers(tree, 1):
        assert (tracer.trace(rays).leaf < 0).all(), f"{name} {params}"
        assert not tracer.occluded(rays).any(), f"{name} {params}"
    for scheme in EXACT:
        deepest = {p.name: 7 for p in scheme.parameters if p.name == "d"}
        tracer = tracers.make(scheme.name, tree, deepest)
        assert tracer.facts.get("cells", 1) == 1, scheme.name
        assert tracer.trace(rays, True).counters["primitives_tested"] == 0, scheme.name


RAY = np.array([[0.2, 0.2, 1, 0, 0, -1, 0, INF]])


@pytest.mark.parametrize(
    "rays",
    [RAY.astype(np.float32), RAY[:, :7], RAY[0], np.repeat(RAY, 4, 0)[::2], RAY.tolist(), None],
    ids=["float32", "7 columns", "1 row", "strided", "list", "none"],
)
def test_arrays_of_a_wrong_kind_are_refused(rays) -> None:
    tracer = tracers.make("naive", empty_solid())
    for method in (tracer.trace, tracer.occluded):
        with pytest.raises(TypeError):
            method(rays)


VERTICES = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype=np.float64)


def mesh_tracer(corners=(0, 1, 2), leaves=(0,)):
    triangles = np.array(corners, dtype=np.uint32).reshape(-1, 3)
    mesh = (VERTICES, triangles, np.array(leaves, dtype=np.int32))
    return tracers.make("embree_mesh", empty_solid(), {}, mesh)


@pytest.mark.parametrize(
    ("corners", "leaves", "message"),
    [
        ((0, 1, 3), (0,), "names a vertex that is not there"),
        ((0, 1, 2), (2,), "names a leaf that is not there"),
        ((0, 1, 2), (-7,), "names a leaf that is not there"),
        ((0, 1, 2), (0, 0), "one leaf a triangle"),
        ((), (), "no triangles"),
    ],
)
def test_a_mesh_with_bad_indices_is_refused(corners, leaves, message: str) -> None:
    """The renderer would read colours, and Embree vertices, out of bounds."""
    with pytest.raises(ValueError, match=message):
        mesh_tracer(corners, leaves)


def test_embree_takes_no_ray_that_makes_it_abort() -> None:
    """Embree's checks abort the process on a negative tnear or a NaN."""
    t_min, t_max = [0, -3, -INF, NAN, 0, 0, 2], [INF, INF, INF, INF, -5, NAN, INF]
    rays = np.repeat(RAY, len(t_min), 0)
    rays[:, 6], rays[:, 7] = t_min, t_max
    tracer = mesh_tracer()
    hit = [True, True, True, False, False, False, False]
    assert (tracer.trace(rays).leaf >= 0).tolist() == hit
    assert tracer.occluded(rays).tolist() == hit
    assert (tracer.trace(np.full((3, 8), NAN)).leaf == -1).all()


def test_a_thin_cone_shell_is_one_answer() -> None:
    """Along a generator, a and b of the quadratic are rounding alone and must agree with it."""
    seed = [802, zlib.crc32(b"thin_shells")]
    tree = FAMILIES["thin_shells"](np.random.default_rng(seed))
    origin = [0.2654752294823054, -0.5762141162695154, -0.3401157480830179]
    direction = [-0.0007012583419383993, 0.0022915656785305093, 0.004556755134074607]
    ray = np.array([[*origin, *direction, 0, 481.42167980323325]])
    expected = tracers.make("naive", tree).trace(ray)
    for name, params, tracer in all_tracers(tree, 0):
        assert_same(tree, name, params, tracer, ray, expected)
