"""Who takes part: for each model, peer, precision and number of threads its fastest setting."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

from harness.bench.errors import Key
from harness.results import Result, Results, ratio
from harness.schemes import PEERS, precision
from harness.statistics import Estimate

EMBREE = "Embree, 16 rays"
_NAMES = {
    ("povray", "none"): "POV-Ray, flat",
    ("povray", "operators"): "POV-Ray, bounded",
    ("embree_mesh", 1): "Embree, single rays",
    ("embree_mesh", 16): EMBREE,
    ("packet_sdsm", 1): "packet_sdsm, single rays",
}


@dataclass(frozen=True)
class Entry:
    """One row of the comparison."""

    result: Result

    @property
    def peer(self) -> str:
        r = self.result
        return _NAMES.get((r.scheme, r.params.get("bounds", r.params.get("packet"))), r.scheme)

    @property
    def precision(self) -> str:
        return precision(self.result.params)

    @property
    def threads(self) -> int:
        return self.result.configuration.threads

    @property
    def is_ours(self) -> bool:
        """An exact scheme, no other program and no mesh."""
        return self.result.exact

    @property
    def is_povray(self) -> bool:
        return self.result.scheme in PEERS

    @property
    def is_scalar(self) -> bool:
        """Ours, one ray at a time."""
        r = self.result
        return self.is_ours and (not r.scheme.startswith("packet_") or r.params.get("packet") == 1)

    def setting(self) -> str:
        shown = {k: v for k, v in self.result.params.items() if k not in ("packet", "bounds")}
        return " ".join(f"{name}={value}" for name, value in shown.items() if name != "precision")

    def times(self, other: Entry) -> Estimate:
        """How many times this one's trace time the other's is, paired by round."""
        return ratio(other.result, self.result, "trace_s")


@dataclass(frozen=True)
class Bench:
    """A measured study, and what its settings err."""

    results: Results
    errors: dict[Key, dict[str, float]]

    @cached_property
    def entries(self) -> list[Entry]:
        """By model, as the study has them, and threads; the fastest first. No ablations."""
        best: dict[tuple, Entry] = {}
        runs = [Entry(r) for r in self.results.tabled if r.configuration in self.results.study.runs]
        for entry in sorted(runs, key=_trace_s):
            best.setdefault((entry.result.model, entry.threads, entry.peer, entry.precision), entry)
        order = self.results.study.models.index
        return sorted(best.values(), key=lambda e: (order(e.result.model), e.threads))

    @property
    def all_threads(self) -> int:
        return max((c.threads for c in self.results.study.configurations), default=1)

    def of(self, model: str, threads: int = 1) -> list[Entry]:
        """The fastest first."""
        return [e for e in self.entries if (e.result.model, e.threads) == (model, threads)]

    def winner(self, model: str, precision: str = "float64", threads: int = 1) -> Entry | None:
        """The fastest exact scheme."""
        return _first(e for e in self.of(model, threads) if e.is_ours and e.precision == precision)

    def scalar(self, model: str) -> Entry | None:
        """The fastest exact scheme in double that traces one ray at a time."""
        return _first(e for e in self.of(model) if e.is_scalar and e.precision == "float64")

    def embree(self, model: str, threads: int = 1) -> Entry | None:
        return _first(e for e in self.of(model, threads) if e.peer == EMBREE)

    def povray(self, model: str, threads: int = 1, peer: str | None = None) -> Entry | None:
        """POV-Ray's best, or one of its scenes."""
        return _first(e for e in self.of(model, threads) if e.is_povray and peer in (None, e.peer))

    def on_all_threads(self, entry: Entry) -> Entry | None:
        """The same setting."""
        return _first(
            other
            for other in map(Entry, self.results.tabled)
            if other.threads == self.all_threads
            and (other.result.model, other.result.scheme)
            == (entry.result.model, entry.result.scheme)
            and other.result.params == entry.result.params
        )

    def rays(self, model: str) -> int:
        """Primary and shadow rays of the picture; POV-Ray does not say how many its own has."""
        return next(e.result.rays for e in self.entries if e.result.model == model and e.is_ours)

    def errors_of(self, entry: Entry) -> dict[str, float]:
        """0 for what is naive's to the bit."""
        r = entry.result
        found = self.errors.get((r.model, r.scheme, r.configuration.params), {})
        if entry.is_ours and entry.precision == "float64":
            return {"depth_p999": 0.0, "flips": 0.0}
        return found


def _trace_s(entry: Entry) -> float:
    return entry.result.trace_s.median


def _first(entries: Iterable[Entry]) -> Entry | None:
    return next(iter(entries), None)
