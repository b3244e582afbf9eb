import dataclasses

import numpy as np
import pytest
from test_tables import GRID, fill, read

from harness.plots import all_plots, heat_maps, save


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    folder = tmp_path_factory.mktemp("store")
    return read(fill(folder / "paper.sqlite")), read(fill(folder / "grid.sqlite", GRID), GRID)


def cost(configuration):
    return np.arange(12.0).reshape(3, 4)


def test_everything_measured_is_drawn(measured):
    names = [name for name, canvas in all_plots(*measured, cost)]
    expected = {"figure8_ball", "figure9_ngk", "grid_ball", "grid_ngk"}
    models = ("ball", "ngk", "ngkcut")
    assert set(names) == expected | {f"{kind}_{m}" for kind in ("schemes", "cost") for m in models}


def test_a_grid_of_one_cell_is_not_drawn_and_one_of_other_code_says_so(measured):
    paper, grid = measured
    lone = dataclasses.replace(grid, all=grid.all[:1])
    assert not [name for name, _ in all_plots(paper, lone, cost) if name.startswith("grid")]
    title = heat_maps("ball", grid, "now").get_suptitle()
    assert title.endswith("measured by an earlier version of the code, code")
    assert "earlier" not in heat_maps("ball", grid, "code").get_suptitle()


def test_the_same_numbers_give_the_same_bytes(measured, tmp_path):
    for folder in ("once", "again"):
        for name, canvas in all_plots(*measured, cost):
            if name in ("figure8_ball", "cost_ball"):
                save(canvas, tmp_path / folder / name)
    files = sorted((tmp_path / "once").iterdir())
    assert len(files) == 4
    for file in files:
        assert file.read_bytes() == (tmp_path / "again" / file.name).read_bytes()
