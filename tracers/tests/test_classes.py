"""The premise of all pruning: a leaf called Empty or Full for a cell is so on any ray in it."""

import zlib

import numpy as np
import pytest

import tracers
from harness.adversaries import FAMILIES
from harness.adversaries.aim import rays_for, targets


def cells_for(tree, rng: np.random.Generator, count: int) -> np.ndarray:
    """(count, 8) boxes of all sizes, many with corners or faces exactly on those of leaves."""
    lo, hi = tree.bounds
    centre = np.where(
        rng.random((count, 1)) < 0.5, targets(tree, rng, count), rng.uniform(lo, hi, (count, 3))
    )
    half = (
        np.linalg.norm(hi - lo)
        * 2.0 ** rng.uniform(-12, 0, (count, 1))
        * rng.uniform(0.3, 1, (count, 3))
    )
    flush = rng.choice([-1.0, 0.0, 1.0], (count, 3)) * (rng.random((count, 1)) < 0.5)
    centre = centre + flush * half
    return np.ascontiguousarray(
        np.column_stack([centre - half, centre + half, np.zeros((count, 2))])
    )


@pytest.mark.parametrize("family", FAMILIES)
def test_classes_hold_along_rays(family: str) -> None:
    called = 0
    for number in range(40):
        rng = np.random.default_rng([number, zlib.crc32(family.encode())])
        tree = FAMILIES[family](rng)
        if not np.isfinite(tree.bounds).all():
            continue
        cells = cells_for(tree, rng, 500)
        rays = rays_for(tree, rng, 500)
        through = rng.uniform(cells[:, :3], cells[:, 3:6])
        aimed = through - rays[:, :3]
        rays[:, 3:6] = np.where(np.abs(aimed).max(axis=1)[:, None] > 1e-9, aimed, rays[:, 3:6])
        constants, violations = tracers.audit_classes(tree, cells, rays)
        assert violations == 0, f"{family} {number}: {violations} of {constants}"
        called += constants
    assert called > 1000
