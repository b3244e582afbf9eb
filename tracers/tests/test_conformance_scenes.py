"""The models of models/scenes.toml: every exact scheme, over its grid of parameters, against naive,
for every primary ray and every shadow ray of a picture (32×32; 256×256 in `make conformance`)."""

from pathlib import Path

import numpy as np
import pytest
from test_conformance import EXACT, assert_same, grid

import tracers
from harness.openscad import to_csg
from harness.scenes import load_scenes

SCENES = load_scenes()


def shadow_rays(primary: np.ndarray, hits: "tracers.Hits", lights: list) -> np.ndarray:
    """(M, 8): from a little off every point hit to every light."""
    hit = hits.leaf >= 0
    point = primary[hit, :3] + hits.t[hit, None] * primary[hit, 3:6]
    start = point + 1e-9 * np.linalg.norm(point, axis=1)[:, None] * hits.normal[hit]
    segments = [np.column_stack([start, np.array(light[:3]) - start]) for light in lights]
    rows = np.concatenate(segments)
    return np.column_stack([rows, np.zeros(len(rows)), np.ones(len(rows))])


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("name", SCENES)
def test_scene(
    name: str,
    precision: str,
    request: pytest.FixtureRequest,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    size = 32 if request.config.getoption("--rays") < 1_000_000 else 256
    cache: Path = tmp_path_factory.getbasetemp()
    scene = SCENES[name]
    tree = tracers.load_csg(str(to_csg(scene.model, cache)))
    view = scene.view(size, size)
    naive = tracers.make("naive", tree, {"precision": precision})
    primary = view.primary_rays()
    rays = np.concatenate([primary, shadow_rays(primary, naive.trace(primary), scene.lights)])
    expected = naive.trace(rays)
    assert (expected.leaf >= 0).sum() > size * size / 2
    picture = naive.render(view).hash
    for scheme in EXACT:
        for params in grid(scheme):
            params = params | {"precision": precision}
            tracer = tracers.make(scheme.name, tree, params)
            assert_same(tree, scheme.name, params, tracer, rays, expected)
            assert tracer.render(view).hash == picture, f"{scheme.name} {params}: another picture"


def test_what_the_margin_of_a_cell_does_not_tell(tmp_path: Path) -> None:
    """Two rays of ball in doubt in the margin of a cell that they never enter: a boundary lies
    before, in a cell that comes later."""
    tree = tracers.load_csg(str(to_csg(SCENES["ball"].model, tmp_path)))
    eye = [24.1, -42.1, 35.3]
    ways = [
        [-0.52684981197621705, 0.70138999575172911, -0.48008473156310039],
        [-0.51230567740301669, 0.67514014005586775, -0.53078120180162702],
    ]
    rays = np.array([[*eye, *way, 0, np.inf] for way in ways])
    expected = tracers.make("naive", tree, {}).trace(rays)
    assert expected.leaf.tolist() == [0, 0]
    for packet in (16, 1):
        params = {"d": 6, "h": 5, "packet": packet}
        tracer = tracers.make("packet_sdsm", tree, params)
        assert_same(tree, "packet_sdsm", params, tracer, rays, expected)
