"""Differences of means: their errors, and how often chance is called significant."""

import math

import numpy as np
import pytest
from scipy.stats import t

from gateway.estimators.mean_comparison import FALSE_ALARM, Radius, compared_means
from gateway.estimators.weighted_mean import WeightedMean, mean_estimate


def mean(values, std=math.nan, scatter_std=0.0):
    collected = WeightedMean()
    for value in values:
        collected.add(float(value), std, scatter_std)
    return mean_estimate(collected)


def scattering(values):
    """Return the mean of values whose errors scatter only, and are stated half as large as they are."""
    half = float(values.std(ddof=1)) / 2.0
    return mean(values, half, half)


def test_errors_of_both_add_in_squares_and_only_shared_quantities_are_compared():
    first = {("FL", "Cw"): mean([0.2, 0.2], 0.003), ("FL", "Bs"): mean([1.0], 0.1)}
    second = {("FL", "Cw"): mean([0.25, 0.25], 0.004), ("FR", "Bs"): mean([1.0], 0.1)}
    (difference,) = compared_means(first, second)
    assert (difference.wheel, difference.name) == ("FL", "Cw")
    assert difference.difference == pytest.approx(0.05)
    assert difference.std == pytest.approx(0.005)
    assert difference.significance == pytest.approx(10.0)
    assert difference.is_significant


def test_error_of_one_radius_is_not_counted_twice():
    """Speeds of one wheel by one radius known to 1 % differ by what they scatter, and by 1 % of the difference."""
    before, after = (
        {("FL", "speed_mps"): mean([value] * 4, math.hypot(0.01 * value, 0.02), 0.02)} for value in (20, 22)
    )
    radius = {"FL": Radius(0.32, 0.0032)}
    scatter = 0.02 / math.sqrt(4.0) * math.sqrt(2.0)
    (same,) = compared_means(before, after, radius, radius)
    assert same.std == pytest.approx(math.hypot(scatter, 0.01 * 2.0), rel=1e-6)
    (other,) = compared_means(before, after, radius, {"FL": Radius(0.33, 0.0032)})
    assert other.std == pytest.approx(math.hypot(scatter, 0.2, 0.22), rel=1e-6)
    assert compared_means(before, after) == [other]
    # A depth has nothing of it, and no more than all of a constant part is common.
    deep = {("FL", "sensor_offset_m"): mean([0.002] * 4, 0.0003)}
    assert compared_means(deep, deep, radius, radius) == compared_means(deep, deep)
    exact = {("FL", "speed_mps"): mean([20.0] * 4, 0.02)}
    assert compared_means(exact, exact, radius, radius)[0].std == pytest.approx(0.0, abs=1e-9)


def test_difference_without_known_error_is_not_significant():
    (difference,) = compared_means({("FL", "Cw"): mean([0.2, 0.2])}, {("FL", "Cw"): mean([0.3, 0.3])})
    assert math.isnan(difference.significance)
    assert not difference.is_significant


def test_few_revolutions_count_by_students_t():
    """With little but scatter, the degrees of freedom are those of Welch."""
    rng = np.random.default_rng(3)
    pairs = [(rng.normal(0.0, 1.0, 4), rng.normal(0.0, 3.0, 5)) for _ in range(200)]
    for a, b in pairs[:20]:
        (difference,) = compared_means({("FL", "Cw"): scattering(a)}, {("FL", "Cw"): scattering(b)})
        errors = a.var(ddof=1) / 4, b.var(ddof=1) / 5
        freedom = sum(errors) ** 2 / (errors[0] ** 2 / 3 + errors[1] ** 2 / 4)
        assert difference.is_significant == (2.0 * t.sf(abs(difference.significance), freedom) < FALSE_ALARM)
    marked = [compared_means({("FL", "Cw"): scattering(a)}, {("FL", "Cw"): scattering(b)})[0] for a, b in pairs]
    assert sum(difference.is_significant for difference in marked) <= 8


def test_more_comparisons_need_more_significance():
    single = compared_means({("FL", "Cw"): mean([0.0], 1.0)}, {("FL", "Cw"): mean([4.2], 1.0)})
    many = {("FL", f"q{number}"): mean([0.0], 1.0) for number in range(99)}
    among = compared_means({("FL", "Cw"): mean([0.0], 1.0), **many}, {("FL", "Cw"): mean([4.2], 1.0), **many})
    assert single[0].is_significant
    assert not any(difference.is_significant for difference in among)
