"""The rows of the stability table, each with the rays that a test can afford; and their truth
against rational arithmetic."""

from __future__ import annotations

from fractions import Fraction

import flint
import numpy as np
import pytest

from harness import ROOT, stability
from harness.stability import blocks, planted, quadrics, torus
from harness.stability.exact import GUARD, Block, Rays, Sphere
from harness.stability.exact_torus import Torus

ROWS = stability.rows()


@pytest.mark.parametrize("name", ROWS)
def test_row_meets_its_bars_or_says_why_not(name):
    row = ROWS[name]
    findings = list(row.run(row.tests, np.random.default_rng(1)))
    assert findings
    assert {finding.row for finding in findings} == {name}
    unmet = [finding for finding in findings if not finding.met]
    assert not [finding for finding in unmet if not finding.red]
    # A known cause explains no more than what it was seen to do: 3 in 10,000 rays.
    assert all(f.failures * 1000 <= f.rays for f in unmet)
    if unmet:
        pytest.xfail("; ".join(sorted({finding.red for finding in unmet})))


def enters(solid, origin: np.ndarray, along: np.ndarray) -> bool:
    """Whether the line meets the interior of a convex solid, by rationals: of the quadratic of its
    wall, in the interval between its planes, an end or the vertex is negative."""
    o, d = ([Fraction(x) for x in v.tolist()] for v in (origin, along))
    size = [Fraction(x) for x in solid.size.tolist()]
    planes = {"sphere": [], "block": [*enumerate(size)], "cylinder": [(2, size[1])]}
    low, high = None, None
    for axis, half in planes.get(solid.kind, [(2, size[2])]):
        if d[axis] == 0:
            if abs(o[axis]) >= half:
                return False
            continue
        a, b = sorted([(-half - o[axis]) / d[axis], (half - o[axis]) / d[axis]])
        low, high = a if low is None else max(low, a), b if high is None else min(high, b)
    if low is not None and low >= high:
        return False
    if solid.kind == "block":
        return True
    middle, slope = size[0], Fraction(0)
    if solid.kind == "cone":
        middle, slope = (size[0] + size[1]) / 2, (size[1] - size[0]) / (2 * size[2])
    round_in = range(3 if solid.kind == "sphere" else 2)
    w, dw = middle + slope * o[2], slope * d[2]
    a = sum(d[i] ** 2 for i in round_in) - dw**2
    b = sum(o[i] * d[i] for i in round_in) - w * dw
    c = sum(o[i] ** 2 for i in round_in) - w**2
    tried = [s for s in (low, high) if s is not None] or [Fraction(0)]
    if a > 0 and (low is None or low < -b / a < high):
        tried.append(-b / a)
    return any((a * s + 2 * b) * s + c < 0 for s in tried)


CONVEX = {
    "sphere": (lambda rng: Sphere(1.0), quadrics._grazing_sphere),
    "cylinder, grazed": (quadrics._cylinder, quadrics._grazing_side),
    "cylinder, along its side": (quadrics._cylinder, quadrics._along_side),
    "cylinder, at its rim": (quadrics._cylinder, quadrics._at_rim),
    "cone, at its apex": (quadrics._pointed, quadrics._at_apex),
    "cone, along a generator": (quadrics._pointed, quadrics._along_generator),
    "frustum, along a generator": (quadrics._frustum, quadrics._along_generator),
    "block, at a corner": (
        lambda rng: Block(1.0, 0.3, 1e-3),
        lambda r, s, n: blocks.corner(r, s.size, n),
    ),
    "block, in a face": (
        lambda rng: Block(1.0, 0.3, 1e-3),
        lambda r, s, n: blocks.face_plane(r, s.size, n),
    ),
}


@pytest.mark.parametrize("name", CONVEX)
def test_truth_of_a_convex_solid_is_that_of_rationals(name):
    rng = np.random.default_rng(2)
    shape, aim = CONVEX[name]
    differ = too_close = 0
    for _ in range(10):
        solid = shape(rng)
        lines = quadrics.backed(rng, aim(rng, solid, 50), solid.radius, 4)
        rays = Rays.of(*lines, solid.radius, "float64")
        inside, _ = solid.enters(rays.o, rays.d)
        exact = np.array([enters(solid, row[:3], row[3:6]) for row in rays.rows])
        wrong = inside != exact
        close = np.abs(solid.width(rays.o, rays.d)) < rays.E * GUARD / 1000
        differ, too_close = differ + wrong.sum(), too_close + (wrong & close).sum()
    assert differ == too_close


def certified_roots(torus: Torus, origin: np.ndarray, along: np.ndarray) -> int:
    """Real roots of odd multiplicity of the quartic, by exact integers and certified isolation."""
    o = [flint.fmpq(*x.as_integer_ratio()) for x in origin.tolist()]
    d = [flint.fmpq(*x.as_integer_ratio()) for x in along.tolist()]
    major, minor = (flint.fmpq(*x.as_integer_ratio()) for x in torus.size[:2].tolist())

    def square(axes) -> flint.fmpq_poly:
        lines = [flint.fmpq_poly([o[i], d[i]]) for i in axes]
        return sum((line * line for line in lines), flint.fmpq_poly([0]))

    whole = square((0, 1, 2)) + (major * major - minor * minor)
    quartic = (whole * whole - 4 * major * major * square((0, 1))).numer()
    roots = quartic.complex_roots()
    return sum(1 for root, times in roots if root.imag == 0 and times % 2)


def test_truth_of_a_torus_is_that_of_certified_roots():
    rng = np.random.default_rng(3)
    checked = 0
    for ratio in (1.0, 1 + 1e-9, 1.5, 3.0, 1e3, 1e6):
        solid = Torus(1.0, 1 / ratio)
        for aim in torus._AIMS:
            lines = quadrics.backed(rng, aim(rng, *solid.size[:2], 20), solid.radius, 4)
            rays = Rays.of(*lines, solid.radius, "float64")
            exact = np.array([certified_roots(solid, r[:3], r[3:6]) for r in rays.rows])
            critical = solid.critical_points(rays.o, rays.d)
            finite = np.isfinite(critical)
            g = np.stack(
                [
                    solid.depth(rays.o + np.where(f, s, 0)[:, None] * rays.d)
                    for s, f in zip(critical.T, finite.T, strict=True)
                ],
                axis=1,
            )
            inside = np.where(finite, g < 0, False)
            count = np.zeros(len(exact), int)
            last = np.zeros(len(exact), bool)
            for i in range(3):
                now = np.where(finite[:, i], inside[:, i], last)
                count, last = count + (now != last), now
            clear = (~finite | (np.abs(g) > rays.E[:, None] * GUARD / 1000)).all(axis=1)
            assert (count + last == exact)[clear].all()
            checked += int(clear.sum())
    assert checked > 400


def test_twenty_bugs_can_be_planted():
    """What they replace stands once in the source; that each is caught is for `make stability`."""
    listed = planted.bugs()
    assert len(listed) == len({bug.name for bug in listed}) == 20
    for bug in listed:
        assert (ROOT / bug.edit.file).read_text().count(bug.edit.old) == 1, bug.name
        assert bug.edit.new != bug.edit.old
        assert set(bug.rows) <= set(ROWS), bug.name
