"""The loader: text → tree, by OpenSCAD's rules; and one line for everything that it refuses."""

import math
import random
import re
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest

import tracers
from harness.openscad import evaluate

IDENTITY = "[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]"
SYMBOL = {1: "u", 2: "n", 3: "-"}


def parse(text: str, shape: str = "as_written") -> tracers.CsgTree:
    return tracers.parse_csg(text, "m.csg", shape)


def refusal(text: str) -> str:
    with pytest.raises(tracers.ModelError) as caught:
        parse(text)
    message = str(caught.value)
    assert "\n" not in message
    return message


def moved(x: float, y: float, z: float, child: str) -> str:
    matrix = f"[[1, 0, 0, {x}], [0, 1, 0, {y}], [0, 0, 1, {z}], [0, 0, 0, 1]]"
    return f"multmatrix({matrix}) {{ {child} }}"


def torus(x: float, y: float, r: float, angle: float = 360) -> str:
    circle = moved(x, y, 0, f"circle(r = {r});")
    return f"rotate_extrude(angle = {angle}, convexity = 2) {{ {circle} }}"


def infix(tree: tracers.CsgTree) -> str:
    """The tree as a string: leaves as letters in the order of their numbers."""
    stack: list[str] = []
    for op, left, _ in tree.operators:
        if op == 0:
            stack.append("abcdefghijklmnopqrstuvwxyz"[left])
        else:
            right = stack.pop()
            stack.append(f"({stack.pop()}{SYMBOL[op]}{right})")
    return stack.pop()


# Primitives.


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


# Transforms and colors.


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
    assert tree.bounds[1].tolist() == [scale, 1e-9 * scale, scale]


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


# Operators: OpenSCAD's rules, against OpenSCAD itself.

A = "cube(size = [2, 2, 2], center = false);"
B = moved(1, 0, 0, A)
RULES = {
    "the file is a union": f"{A} {B}",
    "union": f"union() {{ {A} {B} }}",
    "group": f"intersection() {{ group() {{ {A} {B} }} {B} }}",
    "multmatrix is a union": f"difference() {{ multmatrix({IDENTITY}) {{ {A} {B} }} {A} }}",
    "color is a union": f"difference() {{ color([1, 0, 0, 1]) {{ {A} {B} }} {A} }}",
    "render is a union": f"difference() {{ render(convexity = 1) {{ {A} {B} }} {A} }}",
    "difference of one": f"difference() {{ {A} }}",
    "intersection of one": f"intersection() {{ {A} }}",
    "difference of many": f"difference() {{ {A} {B} {moved(0, 1, 0, A)} }}",
    "intersection of many": f"intersection() {{ {A} {B} {moved(0, 1, 0, A)} }}",
    "difference, first empty": f"difference() {{ group(); {A} }}",
    "difference, second empty": f"difference() {{ {A} group(); {B} }}",
    "difference, first of no volume": f"difference() {{ sphere(r = 0); {A} }}",
    "difference, second of no volume": f"difference() {{ {A} sphere(r = 0); {B} }}",
    "intersection, first empty": f"intersection() {{ group(); {A} }}",
    "intersection, last empty": f"intersection() {{ {A} {B} group(); }}",
    "intersection, one of no volume": f"intersection() {{ {A} sphere(r = 0); }}",
    "intersection, deeply empty": f"intersection() {{ {A} group() {{ group() {{ group(); }} }} }}",
    "intersection, empty difference": f"intersection() {{ {A} difference() {{ group(); {A} }} }}",
    "intersection, empty multmatrix": f"intersection() {{ {A} multmatrix({IDENTITY}); }}",
    "intersection, empty color": f"intersection() {{ {A} color([1, 0, 0, 1]); }}",
    "intersection, empty render": f"intersection() {{ {A} render(convexity = 1); }}",
    "intersection, empty torus": f"intersection() {{ {A} rotate_extrude() {{ circle(r = 0); }} }}",
    "union with empties": f"union() {{ group(); {A} intersection(); }}",
    "# counts": f"difference() {{ #{A} {B} }}",
    "% first": f"difference() {{ %{A} {B} }}",
    "% second": f"difference() {{ {A} %{B} }}",
    "% in an intersection": f"intersection() {{ %{A} {B} }}",
    "% alone in a group": f"intersection() {{ group() {{ %{A} }} {B} }}",
    "% alone first": f"difference() {{ group() {{ %{A} }} {B} }}",
    "* first": f"difference() {{ *{A} {B} }}",
    "* alone first": f"difference() {{ group() {{ *{A} }} {B} }}",
    "%# before the indentation": f"difference() {{ {A}\n%#\t\t{B} }}",
    "comments": f"/* {B} */ {A} // {B}",
}
ROOTS = {
    "!": f"difference() {{ {A} !{B} }}",
    "! leaves the transforms around it": moved(9, 9, 9, f"!{A}"),
    "! of an operator": f"{A} !difference() {{ {A} {B} }}",
    "!%": f"!%{A} {B}",
    "%!": f"%!{A} {B}",
    "! in %": f"%group() {{ !{A} {B} }} {B}",
    "! in *": f"*group() {{ !{A} }} {B} {A}",
    "*!": f"*!{A} {B}",
    "! and % within": f"!group() {{ %{A} {B} }} {A}",
}


def volume_by_tree(text: str) -> int:
    """Volume of a solid of unit cells within [0, 12]^3, block by block."""
    try:
        tree = parse(text)
    except tracers.ModelError as error:
        if str(error) != "m.csg: the model is empty":
            raise
        return 0
    cells = np.stack(np.meshgrid(*[np.arange(12) + 0.5] * 3), axis=-1).reshape(-1, 3)
    stack: list[np.ndarray] = []
    for op, left, _ in tree.operators:
        if op == 0:
            assert tree.kinds[left] == "block"
            matrix = tree.matrices[left]
            local = np.linalg.solve(matrix[:, :3], (cells - matrix[:, 3]).T).T
            stack.append((np.abs(local) < tree.sizes[left]).all(axis=1))
        else:
            right = stack.pop()
            stack.append({1: stack[-1] | right, 2: stack[-1] & right, 3: stack[-1] & ~right}[op])
            stack.pop(-2)
    return int(stack.pop().sum())


def volume_by_openscad(folder: Path, text: str) -> float:
    (folder / "m.scad").write_text(text)
    stl = folder / "m.stl"
    command = ["openscad", "-o", str(stl), str(folder / "m.scad")]
    finished = subprocess.run(command, capture_output=True, text=True, check=False)
    if "Current top level object is empty." in finished.stderr:
        return 0
    vertices = re.findall(r"vertex (\S+) (\S+) (\S+)", stl.read_text())
    triangles = np.array(vertices, dtype=np.float64).reshape(-1, 3, 3)
    return float(np.linalg.det(triangles).sum() / 6)


@pytest.mark.parametrize("rule", [*RULES, *ROOTS])
def test_the_solid_is_the_one_that_openscad_renders(tmp_path, rule):
    text = {**RULES, **ROOTS}[rule]
    assert volume_by_tree(text) == pytest.approx(volume_by_openscad(tmp_path, text), abs=1e-9)


def test_more_than_one_root_is_warned_of():
    tree = parse("!sphere(r = 1);\n !sphere(r = 2);")
    assert tree.sizes[0, 0] == 1
    assert tree.warnings == ["m.csg:2:3: more than one '!': the first is the model"]


@pytest.mark.parametrize(
    ("text", "as_written", "balanced"),
    [
        ("union(){%s}", "((((aub)uc)ud)ue)", "(((aub)uc)u(due))"),
        ("%s", "((((aub)uc)ud)ue)", "(((aub)uc)u(due))"),
        ("intersection(){%s}", "((((anb)nc)nd)ne)", "(((anb)nc)n(dne))"),
        ("difference(){%s}", "((((a-b)-c)-d)-e)", "(a-((buc)u(due)))"),
    ],
)
def test_operators_become_binary_by_the_rule_asked_for(text, as_written, balanced):
    five = "sphere(r = 1);" * 5
    assert infix(parse(text % five)) == as_written
    assert infix(parse(text % five, "balanced")) == balanced


def test_nesting_is_kept_and_lone_children_are_no_operators():
    text = (
        "group(){ group(){ difference(){"
        "union(){ cube(size=[1,1,1]); } group(){ sphere(r=2); sphere(r=3); }"
        "intersection(){ group(); sphere(r=9); } } } union(); } cylinder(h=1, r1=1, r2=1);"
    )
    tree = parse(text)
    assert infix(tree) == "((a-(buc))ud)"
    assert tree.kinds == ["block", "sphere", "sphere", "cylinder"]
    assert tree.operators.tolist() == [
        [0, 0, -1],
        [0, 1, -1],
        [0, 2, -1],
        [1, 1, 2],
        [3, 0, 3],
        [0, 3, -1],
        [1, 4, 5],
    ]
    assert (tree.halfspaces, tree.nodes) == (4, 7)


def test_an_unknown_shape_is_refused():
    with pytest.raises(ValueError, match="as_written, balanced"):
        parse("sphere(r = 1);", "round")


# What is refused.

UNSUPPORTED = {
    "hull": "hull() { cube(1); }",
    "minkowski": "minkowski() { cube(1); sphere(1); }",
    "resize": "resize([1, 2, 3]) cube(1);",
    "polyhedron": "polyhedron([[0,0,0],[1,0,0],[0,1,0],[0,0,1]], [[0,2,1],[0,1,3]]);",
    "linear_extrude": "linear_extrude(3, twist = 30, scale = [1, 2]) square(2);",
    "projection": "projection(cut = true) cube(1);",
    "offset": "offset(r = 1) square(1);",
    "import": 'import("x.stl");',
    "surface": 'surface("y.dat");',
    "2D square": "square(2);",
    "2D circle": "circle(2);",
    "2D polygon": "polygon([[0, 0], [1, 0], [0, 1]]);",
    "2D text": r'text("a \"quoted\" b\\ \n é");',  # written without escapes
    "rotate_extrude by an angle other than 360": (
        "rotate_extrude(angle = 90) translate([5, 0]) circle(1);"
    ),
}


@pytest.mark.parametrize("kind", UNSUPPORTED)
def test_each_kind_that_openscad_writes_and_we_do_not_support_is_named(tmp_path, kind):
    scad = tmp_path / "m.scad"
    scad.write_text(f"cube(1); {UNSUPPORTED[kind]}")
    (tmp_path / "x.stl").write_text("solid x\nendsolid x\n")
    (tmp_path / "y.dat").write_text("1 2\n3 4\n")
    evaluate(scad, tmp_path / "m.csg")
    message = refusal((tmp_path / "m.csg").read_text())
    assert message.startswith(f"m.csg:2:1: unsupported: {kind} (at m.csg:2:1)")


def test_one_message_names_all_kinds_how_often_and_where_first():
    text = (
        "sphere(r = 1);\n"
        "group() {\n\thull() { sphere(r = 1); minkowski(convexity = 0) { hull(); } }\n}\n"
        '%\timport(file = "background.stl");\n'
        "hull();  resize(newsize = [1,2,3], auto = [0,0,0], convexity = 0);"
    )
    assert refusal(text) == (
        "m.csg:3:2: unsupported: hull (3, the first at m.csg:3:2), minkowski (at m.csg:3:26), "
        "resize (at m.csg:6:10)"
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "m.csg: the model is empty"),
        ("\n", "m.csg: the model is empty"),
        ("group();\n", "m.csg: the model is empty"),
        ("difference() { group(); sphere(r = 1); }", "m.csg: the model is empty"),
        ("foo();", "m.csg:1:1: unknown node kind 'foo'"),
        ("group() {\n\tfoo(r = 1);\n}", "m.csg:2:2: unknown node kind 'foo'"),
        ("sphere(r = 1)", "m.csg:1:14: expected ';' or '{', found end of file"),
        ("sphere(r = 1;", "m.csg:1:13: expected ',' or ')', found ';'"),
        ("sphere(r = 1,);", "m.csg:1:14: expected a value, found ')'"),
        ("sphere(r = );", "m.csg:1:12: expected a value, found ')'"),
        ("sphere(r = one);", "m.csg:1:12: expected a value, found 'one'"),
        ("sphere r = 1;", "m.csg:1:8: expected '(', found 'r'"),
        ("sphere", "m.csg:1:7: expected '(', found end of file"),
        ("sphere(r = 1); }", "m.csg:1:16: '}' without its '{'"),
        (
            "\n group() { sphere(r = 1);\n",
            "m.csg:3:1: end of file, but the group of m.csg:2:2 is not closed",
        ),
        ("sphere(r = 1); trailing", "m.csg:1:16: unknown node kind 'trailing'"),
        ("sphere(r = 1); 7", "m.csg:1:16: expected a node, found '7'"),
        ('sphere(r = 1); "x"', "m.csg:1:16: expected a node, found a string"),
        ("%#", "m.csg:1:3: expected a node, found end of file"),
        ("sphere(r = 1);;", "m.csg:1:15: expected a node, found ';'"),
        ("sphere(r = 1) { cube(size = [1, 1, 1]); }", "m.csg:1:17: a sphere has no children"),
        ("sphere();", "m.csg:1:1: sphere: r is missing"),
        ("sphere(1);", "m.csg:1:8: sphere: the argument is not known here"),
        ("sphere(d = 1);", "m.csg:1:12: sphere: d is not known here"),
        ("sphere(r = 1, r = 2);", "m.csg:1:19: sphere: r is given twice"),
        ("sphere(r = true);", "m.csg:1:12: sphere: r is not a number"),
        ("sphere(r = undef);", "m.csg:1:12: sphere: r is not a number"),
        ('sphere(r = "1");', "m.csg:1:12: sphere: r is not a number"),
        ("sphere(r = [1]);", "m.csg:1:12: sphere: r is not a number"),
        ("sphere(r = nan);", "m.csg:1:12: sphere: r is not finite"),
        ("sphere(r = -nan);", "m.csg:1:12: sphere: r is not finite"),
        ("sphere(r = inf);", "m.csg:1:12: sphere: r is not finite"),
        ("sphere(r = -inf);", "m.csg:1:12: sphere: r is not finite"),
        ("sphere(r = 1e+400);", "m.csg:1:12: a number beyond the range of double"),
        ("sphere(r = 1e-400);", "m.csg:1:12: a number beyond the range of double"),
        ("sphere(r = 1.2.3);", "m.csg:1:12: a malformed number"),
        ("sphere(r = 0x1p3);", "m.csg:1:12: a malformed number"),
        ("sphere(r = 1e);", "m.csg:1:12: a malformed number"),
        ("sphere(r = --1);", "m.csg:1:12: a malformed number"),
        ("sphere(r = +-1);", "m.csg:1:12: a malformed number"),
        ("sphere(r = -);", "m.csg:1:12: a malformed number"),
        ("cube(size = 1, center = true);", "m.csg:1:13: cube: size is not a list of 3 numbers"),
        (
            "cube(size = [1, 2], center = true);",
            "m.csg:1:13: cube: size is not a list of 3 numbers",
        ),
        ("cube(size = [1, 2, 3, 4]);", "m.csg:1:13: cube: size is not a list of 3 numbers"),
        ("cube(size = [1, 2, [3]]);", "m.csg:1:20: cube: size is not a number"),
        ("cube(size = [1, 2 3]);", "m.csg:1:19: expected ',' or ']', found '3'"),
        ("cube(size = [1, 2, 3);", "m.csg:1:21: expected ',' or ']', found ')'"),
        ("cube(size = [,]);", "m.csg:1:14: expected a value, found ','"),
        ("cube(size = [1, 2, 3], center = 1);", "m.csg:1:33: cube: center is not true or false"),
        ("cylinder(h = 1, r1 = 1);", "m.csg:1:1: cylinder: r2 is missing"),
        (
            "color([1, 0, 0]) { sphere(r = 1); }",
            "m.csg:1:7: color: the argument is not a list of 4 numbers",
        ),
        ("color() { sphere(r = 1); }", "m.csg:1:1: color: the argument is missing"),
        ("multmatrix() { sphere(r = 1); }", "m.csg:1:1: multmatrix: the argument is missing"),
        ("group(7) { sphere(r = 1); }", "m.csg:1:7: group: the argument is not known here"),
        ('import(file = "x.stl', "m.csg:1:15: string without an end"),
        ("/* sphere(r = 1);", "m.csg:1:1: comment without an end"),
        ("sphere(r = 1);\n\x00", "m.csg:2:1: unexpected byte 0x00"),
        ("sphere(r = 1);\n  \x7fELF", "m.csg:2:3: unexpected byte 0x7f"),
        ("é", "m.csg:1:1: unexpected byte 0xc3"),
        ("sphere(r = 1) @", "m.csg:1:15: unexpected '@'"),
        ("x" * 100 + "();", "m.csg:1:1: unknown node kind '" + "x" * 40 + "...'"),
        (
            "sphere(r = 1e308);" + moved(1e308, 0, 0, "sphere(r = 1e308);"),
            "m.csg: leaf 1 (sphere): its bounds are not finite",
        ),
    ],
)
def test_malformed_input_is_one_line_with_its_place(text, message):
    assert refusal(text) == message


def test_numbers_and_line_ends_of_all_sorts():
    tree = parse("cube(\r\n size=[ +1.5e+0,.5 , 1E1 ] ,center=true )\r\n;\r\n")
    assert tree.sizes[0].tolist() == [0.75, 0.25, 5]


def test_files(tmp_path):
    path = tmp_path / "a b.csg"
    path.write_text("sphere(r = 1);\nfoo();")
    with pytest.raises(tracers.ModelError, match=re.escape(f"{path}:2:1: unknown node kind 'foo'")):
        tracers.load_csg(str(path))
    path.write_text("sphere(r = 1);")
    assert tracers.load_csg(str(path)).halfspaces == 1
    for unreadable in (tmp_path, tmp_path / "absent.csg"):
        with pytest.raises(
            tracers.ModelError, match=f"^{re.escape(str(unreadable))}: cannot be read: "
        ):
            tracers.load_csg(str(unreadable))


# Fuzz: a real file, damaged. Each outcome is a tree or one line.

EVERY_KIND = """
difference() {
  color("red") union() { cube([1, 2, 3]); %sphere(1); #cylinder(r1 = 1, r2 = 0, h = 2); }
  translate([1, 2, 3]) rotate([10, 20, 30]) sphere(2);
  render() { cube(1); cylinder(h = 1, r = 2, $fn = 6); }
}
mirror([1, 1, 0]) rotate_extrude() translate([5, 1]) circle(2);
intersection() { cube(4); sphere(3); }
"""


@pytest.fixture(scope="module")
def real_file(tmp_path_factory) -> bytes:
    folder = tmp_path_factory.mktemp("fuzz")
    (folder / "m.scad").write_text(EVERY_KIND)
    evaluate(folder / "m.scad", folder / "m.csg")
    return (folder / "m.csg").read_bytes()


def survives(folder: Path, damaged: bytes) -> bool:
    """Whether it loads; if not, the refusal is one line with a place."""
    path = folder / "m.csg"
    path.write_bytes(damaged)
    try:
        tree = tracers.load_csg(str(path))
    except tracers.ModelError as error:
        line = str(error).removeprefix(str(path))
        assert re.fullmatch(r":\d+:\d+: [^\n]+|: the model is empty|: leaf \d+ [^\n]+", line), (
            line,
            damaged,
        )
        return False
    assert np.isfinite(tree.sizes).all()
    assert np.isfinite(tree.matrices).all()
    assert tree.nodes == 2 * tree.halfspaces - 1
    return True


def test_fuzz_truncations(tmp_path, real_file):
    assert survives(tmp_path, real_file)
    loaded = sum(survives(tmp_path, real_file[:n]) for n in range(len(real_file)))
    assert 0 < loaded < 20  # only where a top-level node has just ended


@pytest.mark.parametrize("seed", range(3))
def test_fuzz_bytes(tmp_path, real_file, seed):
    draw = random.Random(seed)
    alphabet = b'(){}[],;=!#%*"\\/.-+e0919nai\n\x00\xff'
    outcomes = set()
    for _ in range(1000):
        damaged = bytearray(real_file)
        for _ in range(draw.choice([1, 1, 2, 10])):
            at = draw.randrange(len(damaged))
            match draw.randrange(5):
                case 0:
                    damaged[at] ^= 1 << draw.randrange(8)
                case 1:
                    damaged[at] = draw.choice(alphabet)
                case 2:
                    damaged.insert(at, draw.choice(alphabet))
                case 3:
                    del damaged[at : at + draw.randrange(1, 30)]
                case 4:
                    damaged[at:at] = damaged[: draw.randrange(60)]
        outcomes.add(survives(tmp_path, bytes(damaged)))
    assert outcomes == {True, False}


@pytest.mark.parametrize("seed", range(3))
def test_fuzz_noise(tmp_path, seed):
    draw = random.Random(seed)
    words = [
        b"group",
        b"sphere",
        b"(",
        b")",
        b"{",
        b"}",
        b";",
        b"r",
        b"=",
        b"1",
        b"[",
        b"]",
        b",",
        b"%",
        b"\n",
        b'"',
        b" ",
    ]
    for length in range(300):
        assert not survives(tmp_path, draw.randbytes(length))
        survives(tmp_path, b"".join(draw.choices(words, k=length)))


# Depth and width: nothing recurses.

MILLION = 1_000_000
DEEP = {
    "union, right-deep": (
        "union(){sphere(r=1);" * MILLION + "sphere(r=2);" + "}" * MILLION,
        MILLION + 1,
    ),
    "difference, left-deep": (
        "difference(){" * MILLION + "sphere(r=2);" + "sphere(r=1);}" * MILLION,
        MILLION + 1,
    ),
    "groups": ("group(){" * MILLION + "sphere(r=1);" + "}" * MILLION, 1),
    "multmatrix": (f"multmatrix({IDENTITY}){{" * MILLION + "sphere(r=1);" + "}" * MILLION, 1),
    "side by side": ("sphere(r=1);" * MILLION, MILLION),
    "circle in groups": (
        "rotate_extrude(){" + "group(){" * MILLION + "}" * MILLION + "}sphere(r=1);",
        1,
    ),
}


@pytest.mark.parametrize("shape", ["as_written", "balanced"])
@pytest.mark.parametrize("name", DEEP)
def test_a_million_levels_load(name, shape):
    text, halfspaces = DEEP[name]
    started = time.monotonic()
    tree = parse(text, shape)
    assert (tree.halfspaces, tree.nodes) == (halfspaces, 2 * halfspaces - 1)
    del tree
    assert time.monotonic() - started < 30


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "group(){" * MILLION,
            "m.csg:1:8000001: end of file, but the group of m.csg:1:7999993 is not closed",
        ),
        (
            "hull(" + "[" * MILLION + "]" * MILLION + ");",
            "m.csg:1:1: unsupported: hull (at m.csg:1:1)",
        ),
        ("hull(" + "[" * MILLION, "m.csg:1:1000006: expected a value, found end of file"),
        (
            "hull(){" * MILLION + "}" * MILLION,
            f"m.csg:1:1: unsupported: hull ({MILLION}, the first at m.csg:1:1)",
        ),
        ("%" * MILLION, "m.csg:1:1000001: expected a node, found end of file"),
        ('import("' + '" ' * MILLION + "x", "m.csg:1:8: string without an end"),
    ],
)
def test_a_million_levels_that_are_refused(text, message):
    started = time.monotonic()
    assert refusal(text) == message
    assert time.monotonic() - started < 30
