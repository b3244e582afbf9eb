"""The loader: one line, with its place, for everything that it refuses."""

import re

import pytest
from loader_text import moved, parse, refusal

import tracers
from harness.openscad import evaluate

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
    assert message.startswith(f"m.csg:2:1: unsupported: {kind}")


def test_one_message_names_all_kinds_how_often_and_where_first():
    text = (
        "sphere(r = 1);\n"
        "group() {\n\thull() { sphere(r = 1); minkowski(convexity = 0) { hull(); } }\n}\n"
        '%\timport(file = "background.stl");\n'
        "minkowski(); hull();  resize(newsize = [1,2,3], auto = [0,0,0], convexity = 0);"
    )
    assert refusal(text) == (
        "m.csg:3:2: unsupported: hull (the first of 3), minkowski (the first of 2 at m.csg:3:26), "
        "resize (at m.csg:6:23)"
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "m.csg: the model is empty"),
        ("\n", "m.csg: the model is empty"),
        ("group();\n", "m.csg: the model is empty"),
        ("difference() { group(); sphere(r = 1); }", "m.csg: the model is empty"),
        (
            "sphere(r = -1);",
            "m.csg: the model is empty; m.csg:1:1: sphere of zero or negative size is empty",
        ),
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
