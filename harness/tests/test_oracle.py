"""The oracle: known answers, its second way, the judge, and naive against it."""

from __future__ import annotations

import math
import zlib
from io import StringIO
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

import tracers
from harness import UserError, models
from harness.adversaries import FAMILIES
from harness.adversaries.aim import all_rays, rays_for
from harness.adversaries.families import DIFFERENCE, INTERSECTION, UNION, Solid, placed, rotation
from harness.openscad import to_csg
from harness.oracle.check import check
from harness.oracle.explain import explain
from harness.oracle.judge import GUARD, Verdict, judge
from harness.oracle.roots import compare, sign_changes
from harness.oracle.solid import ExactSolid
from harness.oracle.tally import Tally, judge_rays


def ray(*values: float) -> np.ndarray:
    return np.array([*values, 0.0, math.inf][:8] if len(values) == 6 else values, dtype=np.float64)


def moved(x: float | str, text: str) -> str:
    return f"multmatrix([[1,0,0,{x}],[0,1,0,0],[0,0,1,0],[0,0,0,1]]) {{ {text} }}"


def from_text(text: str) -> ExactSolid:
    return ExactSolid.from_csg(text, tracers.parse_csg(text))


def of(root: list, solid: Solid) -> ExactSolid:
    return ExactSolid.from_tree(solid.tree(root))


# --- Roots --------------------------------------------------------------------------------------


def test_equal_roots_of_different_polynomials_are_proven_equal() -> None:
    from flint import fmpz_poly

    two = fmpz_poly([-2, 0, 1])  # x² − 2, also times x² + 3
    quadratic = sign_changes([*two.coeffs()])[1]
    quartic = sign_changes([*(two * fmpz_poly([3, 0, 1])).coeffs()])[1]
    assert compare(quadratic, quartic) == 0
    assert quadratic.low < math.sqrt(2) < quadratic.high


def test_roots_closer_than_any_double_are_ordered() -> None:
    from flint import fmpz

    near = fmpz(10) ** 60
    third = sign_changes([fmpz(-1), fmpz(3)])[0]
    beyond = sign_changes([-near - 1, 3 * near])[0]
    assert (third.low, third.high) == (beyond.low, beyond.high)
    assert compare(third, beyond) == -1
    assert compare(beyond, third) == 1


def test_a_root_of_even_multiplicity_is_no_crossing() -> None:
    from flint import fmpz_poly

    touching = fmpz_poly([-1, 1]) ** 2 * fmpz_poly([-2, 0, 1])
    assert [round(root.low, 9) for root in sign_changes([*touching.coeffs()])] == [
        -1.414213562,
        1.414213562,
    ]


# --- Known answers ------------------------------------------------------------------------------


def test_a_minus_a_is_empty() -> None:
    for kind, size in (("sphere", [1]), ("block", [1, 2, 3]), ("torus", [1, 0.3])):
        solid = Solid()
        root = [DIFFERENCE, solid.leaf(kind, size), solid.leaf(kind, size)]
        answer = of(root, solid).answer(ray(-5, 0.1, 0.2, 1, 0.01, 0.02))
        assert answer.hit is None
        assert answer.crossings
        assert all(len(crossing.leaves) == 2 for crossing in answer.crossings)


def test_a_tie_names_all_leaves_and_the_lowest_is_the_hit() -> None:
    solid = Solid()
    root = [UNION, solid.leaf("sphere", [1]), solid.leaf("block", [1, 1, 1])]
    answer = of(root, solid).answer(ray(-3, 0, 0, 1, 0, 0))
    assert (answer.leaves, answer.leaf, answer.entering) == ((0, 1), 0, True)
    assert answer.enclosure[0] < 2 < answer.enclosure[1]
    assert answer.span_end == 4


def test_a_face_in_common_is_no_boundary_within_a_union() -> None:
    solid = Solid()
    parts = [solid.leaf("block", [1, 1, 1], placed(x, 0, 0)) for x in (0, 2)]
    answer = of([UNION, *parts], solid).answer(ray(0, 0, 0, 1, 0, 0))
    assert answer.starts_inside
    assert (answer.t, answer.leaf, answer.entering) == (3, 1, False)


def test_along_an_edge_and_in_a_face_the_ray_is_outside() -> None:
    solid = Solid()
    block = of(solid.leaf("block", [1, 1, 1]), solid)
    for origin in ((-3, 1, 1), (-3, 0, 1)):
        answer = block.answer(ray(*origin, 1, 0, 0))
        assert answer.hit is None
        assert answer.coplanar == (0,)
    assert block.answer(ray(-3, 0, 1, 1, 0, -(2.0**-60))).hit is not None


def test_a_tangent_sphere_is_missed_and_one_an_ulp_larger_is_hit() -> None:
    for radius, hits in ((1.0, False), (math.nextafter(1, 2), True), (math.nextafter(1, 0), False)):
        solid = Solid()
        answer = of(solid.leaf("sphere", [radius]), solid).answer(ray(-3, 1, 0, 1, 0, 0))
        assert (answer.hit is not None) == hits


def test_a_sphere_that_fits_the_hole_of_a_torus() -> None:
    """They touch along the sphere's equator, from which a ray along x goes on inside the union."""
    solid = Solid()
    root = [UNION, solid.leaf("torus", [1.0, 0.5]), solid.leaf("sphere", [0.5])]
    answer = of(root, solid).answer(ray(-3, 0, 0, 1, 0, 0))
    assert [c.t for c in answer.crossings] == [1.5, 2.5, 3.5, 4.5]
    assert [c.leaves for c in answer.crossings] == [(0,), (0, 1), (0, 1), (0,)]
    assert (answer.t, answer.span_end) == (1.5, 4.5)


def test_through_the_middle_of_a_torus_without_a_hole() -> None:
    """The quartic touches 0 halfway between its other roots, just where one would look."""
    solid = Solid()
    answer = of(solid.leaf("torus", [1.0, 1.0]), solid).answer(ray(-3, 0, -3, 1, 0, 1))
    assert len(answer.crossings) == 2
    assert answer.entering


def test_ends_of_a_ray_are_open() -> None:
    solid = Solid()
    block = of(solid.leaf("block", [1, 1, 1]), solid)
    assert block.answer(ray(-3, 0, 0, 1, 0, 0, 2, 10)).t == 4
    assert block.answer(ray(-3, 0, 0, 1, 0, 0, math.nextafter(2, 0), 10)).t == 2
    assert block.answer(ray(-3, 0, 0, 1, 0, 0, 0, 2)).hit is None
    assert block.answer(ray(-3, 0, 0, 1, 0, 0, 0, math.nextafter(2, 3))).t == 2


def test_rays_that_are_none_miss() -> None:
    solid = Solid()
    block = of(solid.leaf("block", [1, 1, 1]), solid)
    for values in ((0, 0, 0, 0, 0, 0), (math.nan, 0, 0, 1, 0, 0), (0, 0, 0, math.inf, 0, 0)):
        answer = block.answer(ray(*values))
        assert answer.hit is None
        up = np.array([0.0, 0, 1])
        assert judge(block, answer, ray(*values), math.inf, -1, up).verdict is Verdict.AGREE
        assert judge(block, answer, ray(*values), 1.0, 0, up).verdict is Verdict.FLIP


# --- Decimals -----------------------------------------------------------------------------------

A = "cube(size = [0.1, 1, 1], center = true);"


def test_a_third_tenth_by_other_translates_is_the_same_plane() -> None:
    """In doubles 0.1 + 0.2 > 0.3, and a sliver of 5e-17 stays."""
    text = f"difference() {{ {moved('0.1', moved('0.2', A))} {moved('0.3', A)} }}"
    forth = ray(-1, 0, 0, 1, 0, 0)
    assert from_text(text).answer(forth).hit is None
    answer = from_text(text).answer(forth)
    assert [c.leaves for c in answer.crossings] == [(0, 1), (0, 1)]
    in_doubles = ExactSolid.from_tree(tracers.parse_csg(text)).answer(forth)
    assert in_doubles.hit is not None


def test_the_reader_knows_modifiers_and_emptiness() -> None:
    """What of a file is the model is OpenSCAD's to say. test_loader_operators.py holds the loader
    to that, and the reader must find the loader's halfspaces."""
    ball = "sphere($fn = 0, $fa = 12, $fs = 2, r = 1.5);"
    torus = f"rotate_extrude(convexity = 2) {{ {moved(3, 'circle(r = 0.7);')} }}"
    cone = "cylinder($fn = 0, h = 1e1, r1 = 2.50, r2 = .5, center = false);"
    for text in (
        f"*{ball} %{A} #{cone} {torus}",
        f"{A} !{moved(1, ball + cone)} {torus}",
        f"{moved(5, '!' + ball)}",
        f"!%{A} {ball}",
        f"{A} *group() {{ !{ball} }}",
        f"{A} difference() {{ sphere(r = 0); {ball} }} {cone}",
        f"{A} intersection() {{ {ball} group(); }} {torus}",
        f"difference() {{ {A} sphere(r = 0); {ball} }}",
        f"/* {ball} */ color([1, 0.5, 0, 1]) {A} // {cone}".replace(A, f"{{ {A} }}"),
    ):
        tree = tracers.parse_csg(text)
        solid = ExactSolid.from_csg(text, tree)
        assert solid.kinds == tree.kinds, text


def test_another_file_than_the_trees_is_refused() -> None:
    tree = tracers.parse_csg(moved(3, A))
    for other in (moved(3.000001, A), moved(3, A.replace("0.1", "0.2")), A + A, "sphere(r = 1);"):
        with pytest.raises(UserError, match="loaded"):
            ExactSolid.from_csg(other, tree)


# --- The second way -----------------------------------------------------------------------------


def test_bisection_with_intervals_finds_the_same_boundaries() -> None:
    undecided = total = 0
    for family in FAMILIES:
        rng = np.random.default_rng([7, zlib.crc32(family.encode())])
        tree = FAMILIES[family](rng)
        if tree.halfspaces > 40:
            continue
        found = check(tree, rays_for(tree, rng, 16))
        assert not found.disagreeing, f"{family}: rays {found.disagreeing}"
        undecided += found.undecided
        total += found.rays
    assert total >= 250
    assert undecided <= 0.15 * total  # rays in faces, and starts on surfaces


def test_both_ways_take_no_ray_for_a_miss() -> None:
    solid = Solid()
    tree = solid.tree(solid.leaf("sphere", [1]))
    row = ray(-3, 0, 0, 1, 0, 0)
    rows = np.tile(row, (16, 1))
    np.fill_diagonal(rows[:8], np.nan)
    np.fill_diagonal(rows[8:14], np.inf)
    rows[14, 3] = 0
    rows[15, 3] = 1e-310  # one, but a hit lies beyond all doubles
    found = check(tree, rows)
    assert (found.rays, found.disagreeing) == (16, ())
    assert found.undecided <= 1


# --- The judge ----------------------------------------------------------------------------------


def judged(solid: ExactSolid, rays: np.ndarray) -> Tally:
    return judge_rays(solid, rays, tracers.make("naive", solid.tree).trace(rays))


@pytest.mark.parametrize("family", FAMILIES)
def test_naive_has_no_unexcused_ray(family: str) -> None:
    agree = total = 0
    for number in range(3):
        rng = np.random.default_rng([number, zlib.crc32(family.encode())])
        tree = FAMILIES[family](rng)
        tally = judged(ExactSolid.from_tree(tree), all_rays(tree, rng, 60))
        assert not len(tally.unexcused), f"tree {number}: rays {tally.unexcused.tolist()}"
        assert tally.worst_error() <= GUARD
        agree += tally.verdicts[Verdict.AGREE]
        total += tally.rays
    # Nearly all excused rays were made to start or to end on a surface.
    assert total - agree <= 0.3 * total


def test_naive_aimed_from_outside_is_seldom_excused() -> None:
    rng = np.random.default_rng(3)
    tree = FAMILIES["random_solid"](rng)
    away = rng.normal(size=(300, 3))
    origin = 5 * away / np.linalg.norm(away, axis=1)[:, None]
    ends = np.tile([0.0, np.inf], (300, 1))
    rays = np.column_stack([origin, rng.uniform(-1, 1, (300, 3)) - origin, ends])
    tally = judged(ExactSolid.from_tree(tree), rays)
    assert tally.verdicts[Verdict.AGREE] == 300
    assert tally.normal_p999_deg() < 1e-6


@pytest.mark.parametrize("model", ["ball", "ngk", "ngkcut"])
def test_naive_on_pixels_of_the_models(model: str) -> None:
    tree, scene = models.tree(model), models.scene(model)
    solid = ExactSolid.from_csg(to_csg(scene.model, models.CACHE), tree)
    pixels = np.random.default_rng(0).choice(512 * 512, 300, replace=False)
    tally = judged(solid, scene.view(512, 512).primary_rays()[pixels])
    assert not len(tally.unexcused)
    assert tally.verdicts[Verdict.EXCUSED] <= 3
    assert tally.worst_error() <= GUARD


def test_planted_answers_are_caught() -> None:
    solid = Solid()
    drilled = [DIFFERENCE, solid.leaf("block", [1, 1, 1]), solid.leaf("cylinder", [0.5, 2])]
    exact = of([INTERSECTION, drilled, solid.leaf("sphere", [1.5])], solid)
    row = ray(-3, 0.1, 0.2, 1, 0, 0)
    answer = exact.answer(row)
    true = SimpleNamespace(t=answer.t, leaf=answer.leaf, normal=np.array([-1.0, 0, 0]))

    def verdict(t=true.t, leaf=true.leaf) -> Verdict:
        found = judge(exact, answer, row, t, leaf, true.normal)
        assert found.raw is found.verdict
        return found.verdict

    assert verdict() is Verdict.AGREE
    assert verdict(t=np.nextafter(true.t, 0)) is Verdict.AGREE
    assert verdict(t=math.inf, leaf=-1) is Verdict.FLIP
    assert verdict(leaf=2) is Verdict.WRONG_LEAF
    assert verdict(t=true.t * (1 + 1e-12)) is Verdict.FLIP  # beyond the guard
    assert verdict(t=math.nan) is Verdict.FLIP
    assert verdict(t=1.5, leaf=99) is Verdict.FLIP
    for crossing in answer.crossings:
        if crossing is not answer.hit:
            assert verdict(t=crossing.t, leaf=crossing.leaves[0]) is Verdict.FLIP
    turned = judge(exact, answer, row, true.t, true.leaf, -true.normal)
    assert turned.normal_deg == 180


def test_a_false_hit_is_a_flip_unless_the_surface_is_grazed() -> None:
    solid = Solid()
    ball = of(solid.leaf("sphere", [1]), solid)
    up = np.array([0.0, 0, 1])
    for height, expected in ((1 + 2.0**-52, Verdict.EXCUSED), (1 + 1e-13, Verdict.FLIP)):
        row = ray(-3, 0, height, 1, 0, 0)
        answer = ball.answer(row)
        assert answer.hit is None
        assert judge(ball, answer, row, 3.0, 0, up).verdict is expected


MISS = (math.inf, -1, np.zeros(3))


def test_a_chord_is_excused_by_the_band_of_either_face_at_an_edge() -> None:
    """float32, of a large scene, may take a ray into an edge for one that meets the grazed face,
    whose band is longer than the chord."""
    solid = Solid()
    far = solid.leaf("sphere", [1], placed(0, 0, 3.1e5))
    exact = of([UNION, solid.leaf("block", [1, 1, 1]), far], solid)
    for off, expected in ((1e-8, Verdict.EXCUSED), (1e-5, Verdict.FLIP)):
        row = ray(-1.2 + off, -3, 0, 0.1, 1, 0)
        answer = exact.answer(row)
        assert answer.hit.changes[0].pieces == (2,)
        assert judge(exact, answer, row, *MISS, "float32").verdict is expected
        assert judge(exact, answer, row, *MISS, "float64").verdict is Verdict.FLIP


def test_a_leaf_thinner_than_its_own_unit_of_error_may_be_missed() -> None:
    row = ray(-0.3, 0.2, 3, 0.1, 0.05, -1)
    for thickness, expected in ((1e-9, Verdict.EXCUSED), (1e-6, Verdict.FLIP)):
        solid = Solid()
        tilted = rotation(np.random.default_rng(0)) @ np.diag([1, 1, thickness])
        plate = of(solid.leaf("block", [2, 2, 1], placed(0, 0, 0, tilted)), solid)
        answer = plate.answer(row)
        assert len(answer.crossings) == 2
        found = judge(plate, answer, row, *MISS)
        assert found.verdict is expected
        assert found.reason == ("thin" if expected is Verdict.EXCUSED else "")


def test_bulk_judging_counts_and_reports_progress() -> None:
    rng = np.random.default_rng(11)
    tree = FAMILIES["coplanar_blocks"](rng)
    solid, rays = ExactSolid.from_tree(tree), rays_for(tree, rng, 200)
    hits = tracers.make("naive", tree).trace(rays)
    lost = np.flatnonzero(hits.leaf >= 0)[:5]
    planted = SimpleNamespace(t=hits.t.copy(), leaf=hits.leaf.copy(), normal=hits.normal)
    planted.t[lost], planted.leaf[lost] = math.inf, -1
    seen = []
    tally = judge_rays(solid, rays, planted, progress=lambda done, total: seen.append(done))
    assert seen[-1] == tally.rays == 200
    assert set(tally.unexcused) <= set(lost)
    assert tally.raw[Verdict.FLIP] >= 5
    both = judge_rays(solid, rays, planted, processes=2)
    assert both.verdicts == tally.verdicts
    assert np.array_equal(both.errors, tally.errors, equal_nan=True)


# --- The explanation ----------------------------------------------------------------------------


def test_explanation_names_crossings_hit_and_schemes(tmp_path) -> None:
    path = tmp_path / "drilled.csg"
    path.write_text(f"difference() {{ cube(size = [2, 2, 2], center = true); {A} }}")
    text = StringIO()
    out = Console(file=text, width=200, highlight=False)
    explain(out, out, str(path), ray=np.array([-3.0, 0.1, 0.2, 1, 0, 0]))
    shown = text.getvalue()
    assert "enters the solid at block 0" in shown
    assert "1.9999999999999998 < t < 2.0000000000000004, certified" in shown
    assert "changes next at t = 2.95" in shown
    for scheme in tracers.schemes():
        assert (scheme.name in shown) == (scheme.exact and not scheme.needs_mesh)
    assert "flip" not in shown
    with pytest.raises(UserError, match="not in a picture of 8x8"):
        explain(out, out, str(path), pixel=(8, 0), size="8x8")


def test_an_inexact_hit_is_off_by_so_much_and_no_flip():
    text = StringIO()
    out = Console(file=text, width=200, highlight=False)
    explain(out, out, "ball", (200, 310), size="512x512", scheme="sphere_tracing")
    assert "inexact: off by 8.9e-05 in t" in text.getvalue()
    assert "flip" not in text.getvalue()


def test_a_narrow_terminal_cuts_nothing():
    text = StringIO()
    out = Console(file=text, width=70, highlight=False)
    explain(out, out, "ball", (200, 310), size="512x512")
    assert "…" not in text.getvalue()
    assert "50.410138876579815" in text.getvalue()
