"""Differences of means: their errors, and how often chance is called significant."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import t

from gateway.estimators.mean_comparison import FALSE_ALARM, compared_means
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
    one = compared_means({("FL", "Cw"): mean([0.0], 1.0)}, {("FL", "Cw"): mean([4.2], 1.0)})
    many = {("FL", f"q{number}"): mean([0.0], 1.0) for number in range(99)}
    among = compared_means({("FL", "Cw"): mean([0.0], 1.0), **many}, {("FL", "Cw"): mean([4.2], 1.0), **many})
    assert one[0].is_significant
    assert not any(difference.is_significant for difference in among)
