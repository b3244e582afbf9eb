"""Every exact scheme of the registry gives naive's leaf, normal and bits of t for every ray, in
float64 and in float32 (where all agree with a naive that computes in float32).

There is no list of schemes here: what schemes.def names is tested, over the values that its
parameters declare. `make conformance` runs 1,000,000 rays a family and scheme; `make test` a part
of them.
"""

import itertools
import zlib

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import tracers
from harness.adversaries import FAMILIES
from harness.adversaries.aim import all_rays, rays_for
from harness.adversaries.families import UNION, Solid, combine, placed, rotation
from harness.adversaries.walls import tie_past_an_edge

EXACT = [scheme for scheme in tracers.schemes() if scheme.exact and scheme.name != "naive"]
RAYS_PER_TREE = 1000


def grid(scheme: "tracers.Scheme") -> list[dict]:
    """All combinations of the values that the scheme wants tried."""
    names = [p.name for p in scheme.parameters]
    values = [p.trial_values for p in scheme.parameters]
    return [
        dict(zip(names, combination, strict=True)) for combination in itertools.product(*values)
    ]


def test_every_parameter_has_values_to_try() -> None:
    for scheme in tracers.schemes():
        for parameter in [*scheme.parameters, *tracers.numerics_parameters()]:
            assert parameter.trial_values, f"{scheme.name}: {parameter.name} has no trial_values"


def differing(expected: "tracers.Hits", got: "tracers.Hits") -> np.ndarray:
    """Indices of rays whose leaf or normal, or any bit of whose t, differs."""
    same_t = expected.t.view(np.uint64) == got.t.view(np.uint64)
    same_normal = (expected.normal == got.normal).all(axis=1)
    return np.flatnonzero(~(same_t & same_normal & (expected.leaf == got.leaf)))


def assert_same(tree, name: str, params: dict, tracer, rays: np.ndarray, expected) -> None:
    wrong = differing(expected, tracer.trace(rays))
    if len(wrong):
        i = wrong[0]
        got = tracer.trace(rays[i : i + 1])
        pytest.fail(
            f"{name} {params}: {len(wrong)} of {len(rays)} rays differ; the first:"
            f" ray {rays[i].tolist()} naive t={expected.t[i].hex()} leaf={expected.leaf[i]}"
            f" normal={expected.normal[i].tolist()}, got t={got.t[0].hex()} leaf={got.leaf[0]}"
            f" normal={got.normal[0].tolist()}; {tree.halfspaces} halfspaces"
        )
    blocked = tracer.occluded(rays)
    assert np.array_equal(blocked.astype(bool), expected.leaf >= 0), (
        f"{name} {params}: occluded ≠ trace"
    )


def check_tree(
    tree, rng: np.random.Generator, count: int, settings_of_scheme, precision: str = "float64"
) -> None:
    shared = {"precision": precision}
    naive = tracers.make("naive", tree, shared)
    rays = all_rays(tree, rng, count)
    expected = naive.trace(rays)
    for scheme in EXACT:
        for params in settings_of_scheme(scheme):
            params = params | shared
            assert_same(
                tree, scheme.name, params, tracers.make(scheme.name, tree, params), rays, expected
            )


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("family", FAMILIES)
def test_family(family: str, precision: str, request: pytest.FixtureRequest) -> None:
    """Each tree meets one setting of each scheme; the settings take turns."""
    total = request.config.getoption("--rays")
    trees = max(len(grid(s)) for s in EXACT)
    trees = max(trees, total // RAYS_PER_TREE)
    count = max(1, total // trees)
    for number in range(trees):
        rng = np.random.default_rng([number, zlib.crc32(family.encode())])
        tree = FAMILIES[family](rng)
        check_tree(tree, rng, count, lambda s, n=number: [grid(s)[n % len(grid(s))]], precision)


@settings(max_examples=30, deadline=None, suppress_health_check=list(HealthCheck))
@given(family=st.sampled_from(sorted(FAMILIES)), seed=st.integers(0, 2**32 - 1))
def test_any_seed(family: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    tree = FAMILIES[family](rng)
    pick = lambda s: [grid(s)[seed % len(grid(s))]]  # noqa: E731
    check_tree(tree, rng, 200, pick)


def test_ties_just_past_a_cells_edge() -> None:
    """One ray in a thousand trees met this: so the ray is made together with the tree."""
    for number in range(400):
        rng = np.random.default_rng([number, 21])
        tree, rays = tie_past_an_edge(rng)
        expected = tracers.make("naive", tree).trace(rays)
        for scheme in EXACT:
            names = {p.name for p in scheme.parameters}
            params = {"d": number % 3 + 1, "h": 1} if {"d", "h"} <= names else {}
            tracer = tracers.make(scheme.name, tree, params)
            assert_same(tree, scheme.name, params, tracer, rays, expected)


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("kind", ["sphere", "torus"])
def test_pads_of_bad_condition(kind: str, precision: str) -> None:
    """A shear of condition 3e13: pads make the world many times the solid, and a cell's corners are
    so far away in the torus' frame that rounding costs more than the torus is large. Rays that
    start anywhere along the line, or before it, find the same."""
    solid = Solid()
    sheared = placed(0, 0, 0, np.array([[1e-7, 1, 0], [0, 1e-7, 0], [0, 0, 1e-7]]))
    parts = [solid.leaf("block", [0.3, 0.2, 0.1]), solid.leaf(kind, [1.0, 0.3], sheared)]
    tree = solid.tree([UNION, *parts])
    rng = np.random.default_rng(8)
    local = rng.uniform(-1, 1, (300, 6))
    at, along = local[:, :3] @ sheared[:, :3].T, local[:, 3:] @ sheared[:, :3].T
    away = rng.choice([0, 3, 1e3, 1e9], (300, 1))
    start = rng.choice([-np.inf, -1e5, 0], 300)
    at[::2], along[::2] = local[::2, :3] * [0.3, 0.2, 0.1], local[::2, 3:]  # at the block
    rays = np.column_stack([at - away * along, along, start, np.full(300, np.inf)])
    check_tree(tree, rng, 100, lambda s: grid(s)[:1], precision)
    expected = tracers.make("naive", tree, {"precision": precision}).trace(rays)
    for scheme in EXACT:
        for params in grid(scheme):
            params = params | {"precision": precision}
            tracer = tracers.make(scheme.name, tree, params)
            assert_same(tree, scheme.name, params, tracer, rays, expected)


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_spheres_and_tori_that_are_almost_round(precision: str) -> None:
    """As six digits leave a rotation, and worse: what may be traced as round, and what not."""
    for number in range(200):
        rng = np.random.default_rng([number, 77])
        solid = Solid()
        parts = []
        for _ in range(rng.integers(2, 8)):
            linear = rotation(rng) + 10 ** rng.uniform(-6.2, -5.5) * rng.uniform(-1, 1, (3, 3))
            at = placed(*rng.uniform(-0.7, 0.7, 3), linear * 10 ** rng.uniform(-0.5, 0.3))
            major = rng.uniform(0.2, 0.8)
            minor = major * float(rng.choice([1.0, 0.5, 0.1, 0.01]))
            parts.append(solid.leaf(str(rng.choice(["sphere", "torus"])), [major, minor], at))
        tree = solid.tree(combine(rng, parts))
        check_tree(tree, rng, 800, lambda s, n=number: [grid(s)[n % len(grid(s))]], precision)


def test_small_spheres_that_are_grazed() -> None:
    """A compiler dropped the rounding of a cell's centre, by which its atoms are placed: rays that
    went through a thousandth of the sphere's radius, or less, missed it."""
    for number in range(60):
        rng = np.random.default_rng([number, 392])
        solid, spheres = Solid(), []
        for _ in range(2):
            centre, radius = rng.uniform(-0.7, 0.7, 3), 10 ** rng.uniform(-4, -3)
            spheres.append((centre, radius, solid.leaf("sphere", [radius], placed(*centre))))
        tree = solid.tree([UNION, *(leaf for _, _, leaf in spheres)])
        rays = []
        for centre, radius, _ in spheres:
            out, along = rng.normal(size=(2, 1000, 3))
            out /= np.linalg.norm(out, axis=1)[:, None]
            along = np.cross(out, along)
            along /= np.linalg.norm(along, axis=1)[:, None]
            depth = 10 ** rng.uniform(-10, -4, 1000)
            origin = centre + (radius * (1 - depth))[:, None] * out - along
            rays.append(np.column_stack([origin, along, np.zeros(1000), np.full(1000, np.inf)]))
        rays = np.ascontiguousarray(np.concatenate(rays))
        expected = tracers.make("naive", tree).trace(rays)
        assert (expected.leaf >= 0).mean() > 0.99
        for scheme in EXACT:
            names = {p.name for p in scheme.parameters}
            params = {"d": 3, "h": 1} if {"d", "h"} <= names else {}
            tracer = tracers.make(scheme.name, tree, params)
            assert_same(tree, scheme.name, params, tracer, rays, expected)


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_far_rays_meet_an_ill_conditioned_solid(precision: str) -> None:
    """The pad made the world so large that a ray moved to it was still too far, and missed."""
    solid = Solid()
    thin = {"float64": 1e-12, "float32": 1e-8}[precision]
    disc = solid.leaf("sphere", [1.0], placed(0, 0, 0, np.diag([1, 1, thin])))
    tree = solid.tree(disc)
    rays = np.array([[-away, 0, 0, 1, 0, 0, 0, np.inf] for away in (2, 20, 200, 2e9)])
    hits = tracers.make("naive", tree, {"precision": precision}).trace(rays)
    assert hits.leaf.tolist() == [0, 0, 0, 0]


def test_a_t_beyond_all_doubles_is_a_miss() -> None:
    solid = Solid()
    tree = solid.tree(solid.leaf("sphere", [1.0]))
    rays = np.array([[0, 0, -1e10, 0, 0, 1e-300, 0, np.inf]])
    naive = tracers.make("naive", tree)
    assert (naive.trace(rays).leaf[0], naive.trace(rays).t[0]) == (-1, np.inf)
    assert naive.occluded(rays)[0] == 0


class Planted:
    """A wrong scheme: the right tracer of a model slightly wrong, or right hits changed a bit."""

    def __init__(self, tracer, change=lambda hits: None) -> None:
        self.tracer, self.change = tracer, change

    def trace(self, rays: np.ndarray):
        hits = self.tracer.trace(rays)
        planes = {name: getattr(hits, name).copy() for name in ("t", "leaf", "normal")}
        planted = type("Hits", (), planes)()
        self.change(planted)
        return planted

    def occluded(self, rays: np.ndarray) -> np.ndarray:
        return (self.trace(rays).leaf >= 0).astype(np.uint8)


def grown(tree, by: float) -> "tracers.CsgTree":
    return tracers.CsgTree.build(tree.kinds, tree.sizes * (1 + by), tree.matrices, tree.operators)


def one_ulp(hits) -> None:
    hits.t[-1] = np.nextafter(hits.t[-1], 0)


def turned(hits) -> None:
    hits.normal[0] *= -1


def another_leaf(hits) -> None:
    hits.leaf[np.flatnonzero(hits.leaf >= 0)[0]] += 1


def lost(hits) -> None:
    hits.leaf[np.flatnonzero(hits.leaf >= 0)[-1]] = -1


@pytest.mark.parametrize("change", [one_ulp, turned, another_leaf, lost])
def test_planted_change_of_one_ray_is_caught(change) -> None:
    rng = np.random.default_rng(5)  # a solid that most rays hit
    tree = FAMILIES["coplanar_blocks"](rng)
    rays = rays_for(tree, rng, 500)
    naive = tracers.make("naive", tree)
    rays = rays[naive.trace(rays).leaf >= 0]
    expected = naive.trace(rays)
    assert_same(tree, "right", {}, Planted(naive), rays, expected)
    with pytest.raises(pytest.fail.Exception, match="rays differ; the first: ray"):
        assert_same(tree, "wrong", {}, Planted(naive, change), rays, expected)


def test_planted_scheme_with_a_wrong_model_is_caught() -> None:
    """Sizes wrong by 2e-16: no picture would show it."""
    rng = np.random.default_rng(6)
    tree = FAMILIES["coplanar_blocks"](rng)
    rays = rays_for(tree, rng, 500)
    expected = tracers.make("naive", tree).trace(rays)
    wrong = Planted(tracers.make("sdsm", grown(tree, 2.3e-16)))
    with pytest.raises(pytest.fail.Exception, match="rays differ"):
        assert_same(tree, "wrong", {}, wrong, rays, expected)
