"""The loader: OpenSCAD's rules, against OpenSCAD itself; and n-ary operators made binary."""

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from loader_text import IDENTITY, infix, moved, parse

import tracers

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
        if not str(error).startswith("m.csg: the model is empty"):
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
