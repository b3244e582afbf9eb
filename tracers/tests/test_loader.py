"""The loader: nodes → leaves. Kinds, sizes, transforms, colors, warnings."""

import math
import re

import numpy as np
import pytest
from loader_text import infix, moved, parse, refusal, torus

import tracers
from harness.openscad import evaluate


@pytest.mark.parametrize(
    ("node", "kind", "size", "centre"),
    [
        ("sphere($fn = 0, $fa = 12, $fs = 2, r = 1.5);", "sphere", (1.5,), (0, 0, 0)),
        ("cube(size = [1, 2, 3], center = true);", "block", (0.5, 1, 1.5), (0, 0, 0)),
        ("cube(size = [1, 2, 3], center = false);", "block", (0.5, 1, 1.5), (0.5, 1, 1.5)),
        ("cylinder(h = 4, r1 = 2, r2 = 2, center = true);", "cylinder", (2, 2), (0, 0, 0)),
        ("cylinder(h = 4, r1 = 2, r2 = 2, center = false);", "cylinder", (2, 2), (0, 0, 2)),
        ("cylinder(h = 4, r1 = 2, r2 = 1, center = true);", "cone", (2, 1, 2), (0, 0, 0)),
        ("cylinder(h = 4, r1 = 0, r2 = 1, center = false);", "cone", (0, 1, 2), (0, 0, 2)),
        ("cylinder(h = 4, r1 = 1, r2 = 0, center = false);", "cone", (1, 0, 2), (0, 0, 2)),
        (torus(5, 3, 2), "torus", (5, 2), (0, 0, 3)),
        (torus(-5, 3, 2), "torus", (5, 2), (0, 0, 3)),
        (torus(2, 0, 2), "torus", (2, 2), (0, 0, 0)),
    ],
)
def test_primitives(node, kind, size, centre):
    tree = parse(node)
    assert tree.kinds == [kind]
    assert tree.sizes[0, : len(size)].tolist() == list(size)
    assert tree.matrices[0, :, :3].tolist() == np.eye(3).tolist()
    assert tree.matrices[0, :, 3].tolist() == list(centre)
    assert (tree.halfspaces, tree.nodes, tree.warnings) == (1, 1, [])
    assert np.isnan(tree.colors).all()


def test_openscads_forms_of_a_primitive(tmp_path):
    """r and d, defaults, vectors and scalars: OpenSCAD has evaluated them all."""
    scad = tmp_path / "m.scad"
    scad.write_text(
        "sphere(d = 3); sphere(2); cube(2); cube(); cylinder(d = 3, h = 4, center = true);"
        "cylinder(4, 2, 0); cylinder(d1 = 2, d2 = 6, h = 1);"
        "rotate_extrude() translate([5, 1]) circle(d = 3);"
    )
    evaluate(scad, tmp_path / "m.csg")
    tree = tracers.load_csg(str(tmp_path / "m.csg"))
    expected = [
        ("sphere", (1.5,)),
        ("sphere", (2,)),
        ("block", (1, 1, 1)),
        ("block", (0.5, 0.5, 0.5)),
        ("cylinder", (1.5, 2)),
        ("cone", (2, 0, 2)),
        ("cone", (1, 3, 0.5)),
        ("torus", (5, 1.5)),
    ]
    assert tree.kinds == [kind for kind, _ in expected]
    for row, (_, size) in zip(tree.sizes, expected, strict=True):
        assert row[: len(size)].tolist() == list(size)


def test_the_circle_of_a_torus_may_be_wrapped_turned_and_mirrored():
    turned = "[[0.866025, -0.5, 0, 0], [0.5, 0.866025, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]"
    mirrored = (
        "[[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 7, 9], [0, 0, 0, 1]]"  # its z counts for nothing
    )
    tree = parse(
        f"rotate_extrude(angle = 360) {{ group() {{ multmatrix({turned}) {{ color([1, 0, 0, 1]) {{"
        f"multmatrix({mirrored}) {{ union() {{ {moved(5, 1, 4, 'circle(r = 1);')} }}"
        f"%\tcircle(r = 8);\n*\tcircle(r = 9);\n }} }} }} }} }}"
    )
    # (5, 1) mirrored is (-5, 1), and turned (-5 c - s, -5 s + c); six digits scale by 1 - 3e-7.
    assert tree.kinds == ["torus"]
    assert tree.sizes[0, 0] == pytest.approx(5 * 0.866025 + 0.5, rel=1e-15)
    assert tree.sizes[0, 1] == pytest.approx(math.hypot(0.866025, 0.5), rel=1e-15)
    assert tree.matrices[0, 2, 3] == pytest.approx(-5 * 0.5 + 0.866025, rel=1e-15)


@pytest.mark.parametrize(
    ("node", "fault"),
    [
        (torus(5, 0, 2, angle=90), "rotate_extrude by an angle other than 360"),
        (
            "rotate_extrude(angle = 360) { square(size = [1, 1], center = false); }",
            "something other",
        ),
        ("rotate_extrude() { circle(r = 1); circle(r = 1); }", "something other"),
        ("rotate_extrude() { offset(r = 1) { circle(r = 1); } }", "something other"),
        ("rotate_extrude() { sphere(r = 1); }", "something other"),
        (
            "rotate_extrude() { multmatrix("
            "[[1, 0, 0, 9], [0, 2, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]) { circle(r = 1); } }",
            "stretched to an ellipse",
        ),
    ],
)
def test_other_rotate_extrudes_are_refused_by_name(node, fault):
    message = refusal(" " + node)
    assert message.startswith("m.csg:1:2: unsupported: rotate_extrude ")
    assert fault in message


def test_a_torus_that_meets_its_axis_is_refused():
    assert refusal("group(){\n" + torus(1, 0, 2) + "}") == (
        "m.csg:2:1: a torus whose major radius is less than its minor radius"
    )


@pytest.mark.parametrize(
    "node",
    [
        "sphere(r = 0);",
        "sphere(r = -1);",
        "cube(size = [1, 0, 1], center = false);",
        "cube(size = [-1, 1, 1], center = false);",
        "cylinder(h = 0, r1 = 1, r2 = 1, center = false);",
        "cylinder(h = 1, r1 = 0, r2 = 0, center = false);",
        "cylinder(h = 1, r1 = -1, r2 = 1, center = false);",
        "rotate_extrude() { group() { circle(r = 0); } }",
    ],
)
def test_a_primitive_without_volume_is_empty_and_said_to_be(node):
    tree = parse(f"sphere(r = 1);\ndifference() {{ sphere(r = 2); {node} {node} }}")
    assert infix(tree) == "(aub)"
    name = re.search(r"sphere|cube|cylinder|circle", node).group()
    column = 31 + node.index(name)
    assert tree.warnings == [
        f"m.csg:2:{column}: {name} of zero or negative size is empty (the first of 2)"
    ]


@pytest.mark.parametrize(
    ("node", "warning"),
    [
        (
            "cylinder($fn = 6, h = 1, r1 = 1, r2 = 1);",
            "cylinder with $fn=6 is read as a round cylinder, not as a prism",
        ),
        (
            "cylinder($fn = 12, h = 1, r1 = 1, r2 = 0);",
            "cylinder with $fn=12 is read as a round cone, not as a pyramid",
        ),
        (
            "sphere($fn = 1, r = 1);",
            "sphere with $fn=3 is read as a round sphere, not as a polyhedron",
        ),
        (
            "sphere($fn = 5.9, r = 1);",
            "sphere with $fn=5 is read as a round sphere, not as a polyhedron",
        ),
        ("sphere($fn = 13, r = 1);", None),
        ("sphere($fn = 0, $fa = 120, $fs = 9, r = 1);", None),
        ("sphere($fn = -3, r = 1);", None),
        ("cube(size = [1, 1, 1], center = true);", None),
    ],
)
def test_a_small_fn_is_warned_of_once_with_a_count(node, warning):
    tree = parse("\n\t" + node + 99 * ("\n" + node))
    if warning is None:
        assert tree.warnings == []
    else:
        (line,) = tree.warnings
        assert line.startswith(f"m.csg:2:2: {warning} of ")
        assert line.endswith(" sides (the first of 100)")


def test_matrices_multiply_outermost_first_and_keep_their_six_digits():
    outer = "[[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]"
    inner = "[[0.866025, -0.5, 0, 4], [0.5, 0.866025, 0, 5], [0, 0, -2, 6], [0, 0, 0, 1]]"
    tree = parse(
        f"multmatrix({outer}) {{ group() {{ multmatrix({inner}) {{"
        "cube(size = [2, 2, 2], center = false); sphere(r = 1); } sphere(r = 2); } } sphere(r = 3);"
    )
    a = np.array([[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])
    b = np.array([[0.866025, -0.5, 0, 4], [0.5, 0.866025, 0, 5], [0, 0, -2, 6], [0, 0, 0, 1]])
    half = np.eye(4)
    half[:3, 3] = 1
    for matrix, expected in zip(tree.matrices, [a @ b @ half, a @ b, a, np.eye(4)], strict=True):
        np.testing.assert_allclose(matrix, expected[:3], rtol=0, atol=1e-15)
    assert tree.matrices[1, 0, 0] == -0.5
    assert tree.matrices[1, 1, 0] == 0.866025


@pytest.mark.parametrize("scale", [1e-120, 1.0, 1e120])
def test_a_transform_is_judged_by_its_shape_not_by_its_scale(scale):
    rows = [[scale, 0, 0], [0, 1e-9 * scale, 0], [0, 0, scale]]
    text = ", ".join(str([*row, 0]) for row in rows)
    tree = parse(f"multmatrix([{text}, [0, 0, 0, 1]]) {{ sphere(r = 1); }}")
    # Bounds are tight up to rounding.
    assert tree.bounds[1].tolist() == pytest.approx([scale, 1e-9 * scale, scale], rel=4e-16)


@pytest.mark.parametrize(
    ("rows", "fault"),
    [
        (
            "[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1]",
            "m.csg:1:1: multmatrix: a singular matrix",
        ),
        (
            "[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1]",
            "m.csg:1:1: multmatrix: a singular matrix",
        ),
        (
            "[1, 2, 3, 0], [2, 4, 6, 0], [0, 0, 1, 0], [0, 0, 0, 1]",
            "m.csg:1:1: multmatrix: a singular matrix",
        ),
        (
            "[1, 0, 0, 0], [0, 1e-16, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]",
            "m.csg:1:1: multmatrix: a singular matrix",
        ),
        (
            "[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 2]",
            "m.csg:1:12: multmatrix: the argument is not affine",
        ),
        (
            "[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]",
            "m.csg:1:12: multmatrix: the argument is not a 4x4 matrix",
        ),
        (
            "[1, 0, 0, 0], [0, 1, 0], [0, 0, 1, 0], [0, 0, 0, 1]",
            "m.csg:1:27: multmatrix: the argument is not a list of 4",
        ),
        (
            "[1, 0, 0, 0], [0, 1, 0, nan], [0, 0, 1, 0], [0, 0, 0, 1]",
            "m.csg:1:37: multmatrix: the argument is not finite",
        ),
        (
            "[1, 0, 0, 0], [0, 1, 0, -inf], [0, 0, 1, 0], [0, 0, 0, 1]",
            "m.csg:1:37: multmatrix: the argument is not finite",
        ),
        (
            "[1, 0, 0, 0], [0, 1, 0, [0]], [0, 0, 1, 0], [0, 0, 0, 1]",
            "m.csg:1:37: multmatrix: the argument is not a number",
        ),
    ],
)
def test_matrices_that_are_refused(rows, fault):
    assert refusal(f"multmatrix([{rows}]) {{ sphere(r = 1); }}").startswith(fault)


def test_transforms_that_are_singular_together():
    flat = "[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1e-9, 0], [0, 0, 0, 1]]"
    far = "[[1, 0, 0, 1e308], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]"
    fault = "m.csg:2:1: multmatrix: singular or not finite with those around it"
    for matrix in (flat, far):
        assert (
            refusal(f"multmatrix({matrix}) {{\nmultmatrix({matrix}) {{ sphere(r = 1); }} }}")
            == fault
        )


def test_colors_the_outermost_valid_one_wins():
    tree = parse(
        "color([0.1, 0.2, 0.3, 0.5]) { color([1, 0, 0, 1]) { sphere(r = 1); }"
        "render(convexity = 2) { sphere(r = 2); } }"
        "color([-1, -1, -1, 1]) { color([0, 0, 1, 1]) { sphere(r = 3); } sphere(r = 4); }"
        "color([2, 0, 0.5, 1]) { sphere(r = 5); } sphere(r = 6);"
    )
    expected = [
        [0.1, 0.2, 0.3],
        [0.1, 0.2, 0.3],
        [0, 0, 1],
        [np.nan] * 3,
        [1, 0, 0.5],
        [np.nan] * 3,
    ]
    np.testing.assert_array_equal(tree.colors, np.array(expected, dtype=np.float32))
