import math

import numpy as np
import pytest

from harness.statistics import break_even, estimate, rate_bound, ratio


def test_five_values_get_students_t_on_logarithms():
    found = estimate([1.0, 2.0, 4.0, 8.0, 16.0])
    reach = 2.776445 * math.log(2) * math.sqrt(2.5) / math.sqrt(5)
    assert found.median == 4.0
    assert found.low == pytest.approx(4 / math.exp(reach), rel=1e-4)
    assert found.high == pytest.approx(4 * math.exp(reach), rel=1e-4)


@pytest.mark.parametrize(("n", "low", "high"), [(6, 1, 6), (8, 1, 8), (9, 2, 8), (20, 6, 15)])
def test_six_and_more_get_order_statistics(n, low, high):
    found = estimate(range(1, n + 1))
    assert (found.low, found.high) == (low, high)  # the published table of ranks


@pytest.mark.parametrize("n", [3, 5, 6, 11])
def test_the_interval_covers_the_true_median_as_often_as_it_says(n):
    random = np.random.default_rng(n)
    samples = np.exp(random.normal(0.0, 0.1, (2000, n)))
    covered = np.mean([found.low <= 1.0 <= found.high for found in map(estimate, samples)])
    assert covered >= 0.935


def test_the_interval_contains_the_median_whatever_the_outlier():
    random = np.random.default_rng(0)
    for n in (3, 4, 5, 6, 7):
        for _ in range(300):
            found = estimate(np.exp(random.standard_cauchy(n).clip(-50, 50)))
            assert found.low <= found.median <= found.high


def test_two_values_have_no_interval_and_none_no_median():
    assert estimate([3.0]).median == 3.0
    assert estimate([3.0, 5.0]).median == 4.0
    assert math.isnan(estimate([3.0, 5.0]).low)
    assert math.isnan(estimate([]).median)


def test_ratios_are_paired_so_that_drift_cancels():
    drift = np.array([1.0, 1.5, 2.0, 3.0, 9.0])
    found = ratio(0.5 * drift, drift)
    assert (found.low, found.median, found.high) == pytest.approx((0.5, 0.5, 0.5))


def test_the_ends_stay_in_order_under_a_falling_function():
    found = ratio([9, 8, 9, 8, 9], [10, 10, 10, 10, 10]).map(lambda r: 1 - r)
    assert found.median == pytest.approx(0.1)
    assert found.low < found.median < found.high


def test_break_even():
    assert break_even(2.0, 0.5) == 4.0
    assert break_even(2.0, -0.5) == math.inf
    assert break_even(2.0, 0.0) == math.inf
    assert break_even(-1.0, 0.5) == 0.0
    assert break_even(-1.0, -0.5) == break_even(0.0, 0.0) == math.inf


def test_the_bound_of_a_rate_grows_with_what_was_seen():
    assert rate_bound(0, 1000) == 0.003
    assert rate_bound(4, 1000) == 0.01
    bounds = [rate_bound(seen, 1000) for seen in range(6)]
    assert bounds == sorted(bounds)
