"""CsgTree: what it derives, what it refuses, and that it scales without rounding."""

import numpy as np
import pytest

import tracers

IDENTITY = np.eye(3, 4)
SIZES = {
    "sphere": (1.3,),
    "block": (0.5, 1.1, 2.0),
    "cylinder": (0.7, 1.9),
    "cone": (1.5, 0.4, 0.8),
    "torus": (2.0, 0.6),
}
LEAF, UNION, INTERSECTION, DIFFERENCE = range(4)


def build(leaves: list[tuple], operators: list[tuple[int, int, int]]) -> tracers.CsgTree:
    sizes = np.array([[*size, 0, 0][:3] for _, size, _ in leaves], dtype=np.float64)
    matrices = np.array([matrix for _, _, matrix in leaves], dtype=np.float64)
    return tracers.CsgTree.build(
        [kind for kind, _, _ in leaves],
        sizes.reshape(-1, 3),
        matrices.reshape(-1, 3, 4),
        np.array(operators, dtype=np.int32).reshape(-1, 3),
    )


def single(kind: str, size: tuple, matrix: np.ndarray = IDENTITY) -> tracers.CsgTree:
    return build([(kind, size, matrix)], [(LEAF, 0, -1)])


def block(x: float, half: float = 1) -> tuple:
    return ("block", (half, half, half), np.column_stack([np.eye(3), [x, 0, 0]]))


def surface(kind: str, size: tuple, n: int = 400) -> np.ndarray:
    """Points of the surface that hold every extreme of the primitive, to about (π/n)²."""
    turn = np.linspace(0, 2 * np.pi, n, endpoint=False)
    u, v = (angle.ravel() for angle in np.meshgrid(turn, turn))
    ring = np.stack([np.cos(u), np.sin(u)], axis=1)
    match kind:
        case "sphere":
            return size[0] * np.column_stack([ring * np.cos(v)[:, None], np.sin(v)])
        case "torus":
            return np.column_stack(
                [ring * (size[0] + size[1] * np.cos(v))[:, None], size[1] * np.sin(v)]
            )
        case "block":
            return np.array(size) * np.stack(np.meshgrid(*[[-1, 1]] * 3), -1).reshape(-1, 3)
        case "cylinder":
            bottom, top, half = size[0], size[0], size[1]
        case "cone":
            bottom, top, half = size
    ends = [
        np.column_stack([r * ring, np.full(len(ring), z)])
        for r, z in [(bottom, -half), (top, half)]
    ]
    return np.concatenate(ends)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("kind", SIZES)
def test_bounds_of_a_placed_primitive_are_tight(kind, seed):
    matrix = np.random.default_rng(seed).normal(size=(3, 4))  # sheared, often mirrored
    tree = single(kind, SIZES[kind], matrix)
    points = surface(kind, SIZES[kind]) @ matrix[:, :3].T + matrix[:, 3]
    extent = tree.bounds[1] - tree.bounds[0]
    below, above = points.min(axis=0) - tree.bounds[0], tree.bounds[1] - points.max(axis=0)
    for slack in (below, above):
        assert (slack > -1e-14 * extent).all(), "a point of the surface is out of bounds"
        assert (slack < 2e-4 * extent).all(), "the bounds are loose"


def test_bounds_of_operators_are_figure_5s():
    leaves = [block(0), block(1), block(5)]
    first = [(LEAF, 0, -1), (LEAF, 1, -1)]
    x = {
        op: build(leaves[:2], [*first, (op, 0, 1)]).bounds[:, 0].tolist()
        for op in (UNION, INTERSECTION, DIFFERENCE)
    }
    assert x == {UNION: [-1, 2], INTERSECTION: [0, 1], DIFFERENCE: [-1, 1]}
    apart = build(leaves, [*first, (UNION, 0, 1), (LEAF, 2, -1), (INTERSECTION, 2, 3)])
    assert (apart.bounds[0] > apart.bounds[1]).all()  # nothing
    touching = build([block(0), block(2)], [*first, (INTERSECTION, 0, 1)])
    assert touching.bounds[:, 0].tolist() == [1, 1]


def test_size_is_the_diagonal_of_all_leaves_and_their_distance():
    tree = build([block(10), block(16)], [(LEAF, 0, -1), (LEAF, 1, -1), (DIFFERENCE, 0, 1)])
    assert tree.size == pytest.approx(np.sqrt(8**2 + 2**2 + 2**2) + 13, rel=1e-15)


@pytest.mark.parametrize("exponent", [-500, -30, -1, 0, 1, 7, 500])
@pytest.mark.parametrize("kind", SIZES)
def test_a_power_of_two_scales_to_the_bit(kind, exponent):
    matrix = np.random.default_rng(1).normal(size=(3, 4))
    tree = single(kind, SIZES[kind], matrix)
    scaled = tree.scaled(exponent)
    factor = 2.0**exponent
    assert scaled.size == tree.size * factor
    np.testing.assert_array_equal(scaled.bounds, tree.bounds * factor)
    np.testing.assert_array_equal(scaled.sizes, tree.sizes * factor)
    np.testing.assert_array_equal(scaled.matrices[..., :3], tree.matrices[..., :3])
    np.testing.assert_array_equal(scaled.matrices[..., 3], tree.matrices[..., 3] * factor)
    np.testing.assert_array_equal(scaled.scaled(-exponent).bounds, tree.bounds)


@pytest.mark.parametrize("exponent", [-1100, 1100])
def test_a_scale_out_of_range_is_refused(exponent):
    with pytest.raises(tracers.ModelError, match=r"leaf 0 \(sphere\): a size is not"):
        single("sphere", (1,)).scaled(exponent)


NAN, INF = float("nan"), float("inf")


@pytest.mark.parametrize(
    ("kind", "size", "fault"),
    [
        *[(kind, (NAN, *size[1:]), "a size is not finite") for kind, size in SIZES.items()],
        *[(kind, (*size[:-1], INF), "a size is not finite") for kind, size in SIZES.items()],
        *[(kind, (*size[:-1], 0), "a size is not positive") for kind, size in SIZES.items()],
        *[(kind, (-1, *size[1:]), "a size is not positive") for kind, size in SIZES.items()],
        ("cone", (0, 0, 1), "a size is not positive"),
        ("cone", (1, -1, 1), "a size is not positive"),
        ("torus", (1, 2), "major radius is less than its minor radius"),
    ],
)
def test_sizes_that_are_refused(kind, size, fault):
    with pytest.raises(tracers.ModelError, match=rf"^leaf 0 \({kind}\): .*{fault}"):
        single(kind, size)


@pytest.mark.parametrize(
    ("linear", "fault"),
    [
        (np.diag([1, 1, 0]), "singular"),
        (np.zeros((3, 3)), "singular"),
        (np.diag([1, 1, 1e-16]), "singular"),
        (np.diag([1, NAN, 1]), "singular or not finite"),
        (np.diag([1, INF, 1]), "singular or not finite"),
    ],
)
def test_transforms_that_are_refused(linear, fault):
    with pytest.raises(tracers.ModelError, match=rf"^leaf 0 \(sphere\): .*{fault}"):
        single("sphere", (1,), np.column_stack([linear, np.zeros(3)]))


def test_offsets_that_are_refused():
    for x in (NAN, INF, 1.7e308):
        with pytest.raises(tracers.ModelError, match="not finite"):
            single("sphere", (1e308,), np.column_stack([np.eye(3), [x, 0, 0]]))


@pytest.mark.parametrize("scale", [1e-200, 1e-100, 1.0, 1e100, 1e200])
def test_a_transform_is_judged_by_its_shape_not_by_its_scale(scale):
    for fine, accepted in [(1e-14, True), (1e-16, False)]:
        matrix = scale * np.column_stack([np.diag([1, fine, 1]), np.zeros(3)])
        if accepted:
            assert single("sphere", (1,), matrix).bounds[1, 0] == scale
        else:
            with pytest.raises(tracers.ModelError, match="singular"):
                single("sphere", (1,), matrix)


@pytest.mark.parametrize(
    ("operators", "fault"),
    [
        ([], "the model is empty"),
        ([(LEAF, 2, -1)], "node 0: no such leaf"),
        ([(LEAF, -1, -1)], "node 0: no such leaf"),
        ([(LEAF, 0, -1)], "some leaves stand in no node"),
        ([(LEAF, 0, -1), (LEAF, 0, -1), (UNION, 0, 1)], "node 1: its leaf is used twice"),
        ([(LEAF, 0, -1), (LEAF, 1, -1)], "the nodes are not one tree"),
        ([(LEAF, 0, -1), (LEAF, 1, -1), (UNION, 0, 0)], "node 2: its children do not stand"),
        ([(LEAF, 0, -1), (LEAF, 1, -1), (UNION, 1, 0)], "node 2: its children do not stand"),
        ([(LEAF, 0, -1), (LEAF, 1, -1), (UNION, 0, 2)], "node 2: its children do not stand"),
        ([(LEAF, 0, -1), (LEAF, 1, -1), (UNION, 0, 9)], "node 2: its children do not stand"),
        ([(LEAF, 0, -1), (LEAF, 1, -1), (UNION, -1, 1)], "node 2: its children do not stand"),
        ([(UNION, 1, 2), (LEAF, 0, -1), (LEAF, 1, -1)], "node 0: its children do not stand"),
    ],
)
def test_nodes_that_are_no_tree_are_refused(operators, fault):
    with pytest.raises(tracers.ModelError, match=f"^{fault}"):
        build([block(0), block(1)], operators)


def test_a_tree_without_leaves_is_refused():
    with pytest.raises(tracers.ModelError, match=r"^the model is empty$"):
        build([], [])
