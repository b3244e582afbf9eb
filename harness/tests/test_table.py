"""The forms of a table, and how its numbers are shown."""

import pytest

from harness.statistics import Estimate
from harness.table import Column, Table, integer, number, percent, scientific


def test_cells_are_rounded_for_people_and_whole_for_machines():
    columns = [Column("name", "name", align="l"), Column("part", "saved %", percent)]
    estimate = Estimate(0.123456789, 0.1, 0.15, 5)
    table = Table("t", "A title", columns, [["a_b", estimate], ["c", None]])
    assert "| a_b | 12.3 [10.0, 15.0] |\n| c | – |" in table.markdown()
    assert "name,part,part_low,part_high,part_n\na_b,0.123456789,0.1,0.15,5\n" in table.csv()
    assert r"a\_b & 12.3 [10.0, 15.0] \\" in table.latex()
    assert dict(table.values()) == {
        "t/a_b/part": "12.3",
        "t/a_b/part/low": "10.0",
        "t/a_b/part/high": "15.0",
        "t/c/part": "–",
    }


def test_latex_groups_and_breaks_headings_and_sets_numbers_as_mathematics():
    columns = [
        Column("name", "name", align="l"),
        Column("a", "saved %", percent, group="ours"),
        Column("b", "error", scientific, group="ours"),
    ]
    latex = Table("t", "A title", columns, [["x86-64", -0.015, 1.9e-3]]).latex()
    assert r" & \multicolumn{2}{c}{ours} \\" in latex
    assert r"\cmidrule(lr){2-3}" in latex
    assert r"name & \shortstack{\hfill\strut saved\\\hfill\strut \%} & error \\" in latex
    assert r"x86-64 & $-$1.5 & $1.9\times10^{-3}$ \\" in latex
    assert "| name | ours: saved % | ours: error |" in Table("t", "", columns, []).markdown()


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (0, "0"),
        (7.6, "7.60"),
        (0.0123456, "0.0123"),
        (99.96, "100"),
        (9.996, "10.0"),
        (22, "22.0"),
        (12345.6, "12,346"),
        (1e-7, "0.000000100"),
        (-1.5, "-1.50"),
        (float("inf"), "∞"),
    ],
)
def test_numbers_have_three_digits_and_no_exponent(value, shown):
    assert number(value) == shown


def test_integers():
    assert [integer(v) for v in (1234567.0, float("inf"))] == ["1,234,567", "∞"]
