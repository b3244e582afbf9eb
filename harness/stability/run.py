"""Running rows: the same rays for the same row, whatever else is run."""

from __future__ import annotations

import zlib

import numpy as np

from harness import UserError
from harness.stability import Finding, rows


def run_row(name: str, most: int = 0) -> list[Finding]:
    """A row's findings: at its full number of rays or `most`, and no fewer than the tests have."""
    known = rows()
    if name not in known:
        raise UserError(f"no row '{name}'; known: {', '.join(known)}")
    row = known[name]
    count = max(row.tests, min(row.full, most))
    return list(row.run(count, np.random.default_rng(zlib.crc32(name.encode()))))
