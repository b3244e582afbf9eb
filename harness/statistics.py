"""Medians, their 95% intervals, and what is derived from pairs of measurements.

The interval of a median is distribution-free where the number of values allows it: a pair of order
statistics. Five values do not: even minimum to maximum covers the median with 1 - 2 / 2^5 = 93.75%.
Below six values it is therefore Student's t on the logarithms (timing noise is multiplicative), a
little wider than minimum to maximum; it always contains the median of so few values. Fewer than
three values get none: with one degree of freedom it would span orders of magnitude.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

CONFIDENCE = 0.95
LEAST = 3  # this many values, or pairs of values, for an interval
# 97.5% quantiles of Student's t, by degrees of freedom.
_STUDENT_T = {2: 4.3027, 3: 3.1824, 4: 2.7764}


@dataclass(frozen=True)
class Estimate:
    """A median of n values and its 95% interval, whose ends are NaN where n < LEAST."""

    median: float
    low: float
    high: float
    n: int

    def map(self, function) -> Estimate:
        """Through a monotonic function; the ends swap where it falls."""
        ends = sorted((function(self.low), function(self.high)))
        return Estimate(function(self.median), *ends, self.n)


def estimate(values: Sequence[float]) -> Estimate:
    """Median and interval of positive values, such as times or ratios of times."""
    x = np.sort(np.asarray(values, float))
    if len(x) == 0:
        return Estimate(math.nan, math.nan, math.nan, 0)
    median = float(np.median(x))
    if len(x) < LEAST:
        return Estimate(median, math.nan, math.nan, len(x))
    if len(x) - 1 in _STUDENT_T:
        logs = np.log(x)
        reach = _STUDENT_T[len(x) - 1] * logs.std(ddof=1) / math.sqrt(len(x))
        low, high = np.exp(logs.mean() - reach), np.exp(logs.mean() + reach)
    else:
        rank = _lower_rank(len(x))
        low, high = x[rank - 1], x[-rank]
    return Estimate(median, float(low), float(high), len(x))


def _lower_rank(n: int) -> int:
    """Largest r such that the r-th smallest to the r-th largest covers the median with 95%."""
    tail, rank = 0.0, 0
    while True:
        tail += math.comb(n, rank) / 2**n
        if 1 - 2 * tail < CONFIDENCE:
            return rank
        rank += 1


def ratio(numerators: Sequence[float], denominators: Sequence[float]) -> Estimate:
    """Median of the ratios of values measured side by side."""
    return estimate(np.asarray(numerators, float) / np.asarray(denominators, float))


def rate_bound(seen: int, tried: int) -> float:
    """95% upper bound of the rate of what was seen so often in so many tries: 3/N if never."""
    return (3 if seen == 0 else seen + 2 * math.sqrt(seen) + 2) / max(tried, 1)


def break_even(build_cost: float, trace_gain: float) -> float:
    """How many pictures must be traced until what was spent on building is gained back.

    build_cost: further seconds to build; trace_gain: seconds saved a picture. Infinite if there is
    no gain, 0 if there is one and building costs nothing more.
    """
    return max(build_cost, 0.0) / trace_gain if trace_gain > 0 else math.inf
