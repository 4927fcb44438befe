"""Means over revolutions: what averaging makes smaller, and how often chance calls a difference significant."""

import math

import numpy as np
import pytest
from scipy.stats import t

from gateway.compare.mean_comparison import FALSE_ALARM, Radius, compared_means
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.weighted_mean import MeanEstimate, WeightedMean, mean_estimate


def mean_of(values: np.ndarray, std: float, memory: float = 0.0, scatter_std: float = 0.0) -> MeanEstimate:
    mean = WeightedMean()
    for value in values.tolist():
        mean.add(value, std, scatter_std)
    return mean_estimate(mean, memory)


def test_interval_contains_the_truth_as_often_as_stated() -> None:
    """Values with an error that all share and one of each, stated too small, ten at a time."""
    rng = np.random.default_rng(5)
    hits = {0.68: 0, 0.95: 0, 0.99: 0}
    for _ in range(2000):
        mean = mean_of(7.0 + rng.normal(0.0, 0.2) + rng.normal(0.0, 1.0, 10), math.hypot(0.2, 0.6), scatter_std=0.6)
        for probability in hits:
            hits[probability] += abs(mean.value - 7.0) < mean.expanded(probability)[0]
    for probability, count in hits.items():
        assert count / 2000 == pytest.approx(probability, abs=0.025)


def test_shared_error_does_not_fall_with_the_number_of_revolutions() -> None:
    rng = np.random.default_rng(1)
    many = mean_of(rng.normal(3.0, 0.1, 10_000), 0.5)
    assert many.constant_std == pytest.approx(0.5)
    assert many.std == pytest.approx(0.5, rel=1e-3)
    assert many.expanded(0.95)[1] == pytest.approx(1.96, abs=0.001)


def test_running_average_counts_as_few_values() -> None:
    """Values smoothed over 20 revolutions: the scatter of their mean over many series is what is stated."""
    rng = np.random.default_rng(2)
    memory, means, stated = 20.0, [], []
    for _ in range(300):
        smooth, series = rng.normal(0.0, math.sqrt(1.0 / 39.0)), []
        for noise in rng.normal(0.0, 1.0, 1000).tolist():
            smooth += (noise - smooth) / memory
            series.append(smooth)
        size = float(np.std(series)) / 2.0
        mean = mean_of(np.array(series), size, memory, size)
        means.append(mean.value)
        stated.append(mean.scatter_std)
    assert np.median(stated) == pytest.approx(float(np.std(means)), rel=0.15)


def test_a_single_value_has_its_own_error_and_no_scatter() -> None:
    single = mean_of(np.array([2.0]), 0.3)
    assert (single.value, single.std, single.count, single.freedom) == (2.0, 0.3, 1, math.inf)
    assert math.isnan(single.scatter)
    with pytest.raises(ValueError, match="within 0 and 1"):
        single.expanded(95.0)


def test_scattering_part_of_the_errors_falls_and_the_constant_part_stays() -> None:
    mean, rng = WeightedMean(), np.random.default_rng(3)
    for value in rng.normal(5.0, 0.4, 400).tolist():
        mean.add(value, 0.5, 0.4)
    estimate = mean_estimate(mean)
    assert estimate.constant_std == pytest.approx(0.3)
    assert estimate.scatter_std == pytest.approx(0.4 / 20.0, rel=0.1)
    assert mean.std == pytest.approx(0.5)


def test_mean_of_what_driving_changes_is_not_weighted_and_contains_the_scatter() -> None:
    """Speeds of one accelerating drive, whose errors grow with the speed."""
    speed_mps = np.linspace(8.0, 28.0, 201)
    mean = WeightedMean()
    for value in speed_mps.tolist():
        mean.add(value, 0.02 * value)
    estimate = mean_estimate(mean)
    assert [reason.code for reason in estimate.reasons] == [EstimateCode.ROW_SCATTERS]
    assert estimate.value == mean.value == pytest.approx(18.0)
    assert estimate.std == pytest.approx(mean.std) == pytest.approx(math.hypot(0.02 * 14.3, mean.scatter), rel=0.01)
    steady = mean_of(np.linspace(17.9, 18.1, 11), 0.1)
    assert not steady.reasons


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
