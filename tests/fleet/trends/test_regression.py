"""Standard errors of trends cover the truth, outliers are rarely false, steps are found."""

import numpy as np
import pytest
from scipy import stats

from gateway.fleet.trends.level_steps import find_steps
from gateway.fleet.trends.outlier_detection import find_outliers
from gateway.fleet.trends.regression import fit, weights_of


def line(count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    position = np.sort(rng.uniform(0.0, 1.0, count))
    return position, np.column_stack([np.ones(count), position - position.mean()])


@pytest.mark.parametrize("count", [8, 25, 100])
@pytest.mark.parametrize("kind", ["normal", "unequal", "following", "heavy"])
def test_intervals_cover_the_truth(count, kind):
    rng = np.random.default_rng(count)
    covered, tries = 0, 300
    for _ in range(tries):
        position, design = line(count, rng)
        noise = rng.standard_t(4, count) if kind == "heavy" else rng.normal(size=count)
        if kind == "unequal":
            noise *= 0.3 + 2.0 * position
        if kind == "following":
            for i in range(1, count):
                noise[i] = 0.4 * noise[i - 1] + np.sqrt(1.0 - 0.16) * noise[i]
        values = 3.0 + 2.0 * position + noise
        fitted = fit(design, values, weights_of(design, values, np.ones(count)), np.ones(count, dtype=bool))
        assert fitted is not None
        covered += abs(fitted.coefficients[1] - 2.0) < stats.t.ppf(0.975, fitted.freedom) * fitted.std(1)
    # 95 % are asked for; a correlation cannot be seen in eight points.
    assert covered / tries > (0.85 if kind == "following" else 0.90)


def test_errors_are_not_inflated():
    rng = np.random.default_rng(3)
    ratios = []
    for _ in range(200):
        position, design = line(60, rng)
        values = rng.normal(size=60)
        fitted = fit(design, values, np.ones(60), np.ones(60, dtype=bool))
        assert fitted is not None
        ratios.append(fitted.std(1) * np.sqrt(((position - position.mean()) ** 2).sum()))
    assert 0.95 < np.mean(ratios) < 1.15


@pytest.mark.parametrize(("is_shared", "low", "high"), [(True, 1.0, 1.07), (False, 0.5, 0.8)])
def test_stated_errors_count_as_far_as_points_scatter(is_shared, low, high):
    # Errors that all points share say nothing about a slope: weights by them would make it scatter by a further 13 %.
    rng = np.random.default_rng(3)
    weighted, unweighted = [], []
    for _ in range(400):
        _, design = line(60, rng)
        stds = np.exp(rng.uniform(np.log(0.13), np.log(0.37 if is_shared else 0.8), 60))
        values = (0.05 if is_shared else stds) * rng.normal(size=60)
        for slopes, weights in ((weighted, weights_of(design, values, stds)), (unweighted, np.ones(60))):
            fitted = fit(design, values, weights, np.ones(60, dtype=bool))
            assert fitted is not None
            slopes.append(fitted.coefficients[1])
    assert low < np.std(weighted) / np.std(unweighted) < high


def test_unknown_errors_do_not_change_what_known_ones_count():
    rng = np.random.default_rng(5)
    _, design = line(20, rng)
    values = 0.05 * rng.normal(size=20)
    stds = np.exp(rng.uniform(np.log(0.13), np.log(0.37), 20))
    for unknown in (9, 11):
        stds[:unknown] = np.nan
        weights = weights_of(design, values, stds)
        assert (weights[unknown:] > 0.1 * weights[0]).all()


def test_too_few_points_determine_nothing():
    design = np.column_stack([np.ones(4), np.arange(4.0)])
    assert fit(design, np.arange(4.0), np.ones(4), np.ones(4, dtype=bool)) is None
    same = np.column_stack([np.ones(9), np.ones(9)])
    assert fit(same, np.arange(9.0), np.ones(9), np.ones(9, dtype=bool)) is None


def test_false_outliers_have_the_stated_rate():
    rng = np.random.default_rng(11)
    false, tries = 0, 300
    for _ in range(tries):
        _, design = line(25, rng)
        values = rng.normal(size=25)
        false += find_outliers(design, values, np.ones(25), family=1, false_rate=0.05).is_outlier.any()
    assert 0.015 < false / tries < 0.09


def test_outliers_do_not_hide_each_other():
    rng = np.random.default_rng(12)
    position, design = line(80, rng)
    values = 5.0 * position + rng.normal(size=80)
    planted = [3, 40, 41, 42, 79]
    values[planted] += [9.0, 30.0, 31.0, 29.0, -9.0]
    result = find_outliers(design, values, np.ones(80), family=100)
    assert np.flatnonzero(result.is_outlier).tolist() == planted
    assert result.fit is not None
    assert abs(result.fit.coefficients[1] - 5.0) < 4.0 * result.fit.std(1)


def test_steps_are_found_and_outliers_are_none():
    rng = np.random.default_rng(13)
    position, design = line(100, rng)
    values = 3.0 * position + rng.normal(size=100) + 8.0 * (np.arange(100) >= 50) - 6.0 * (np.arange(100) >= 80)
    values[[1, 20, 98]] += 25.0
    assert find_steps(design, values) == [50, 80]
    assert find_steps(design, values, min_size=7.0) == [50]


def test_steady_series_have_no_steps():
    rng = np.random.default_rng(14)
    result = 0
    for _ in range(150):
        _, design = line(60, rng)
        result += bool(find_steps(design, rng.normal(size=60)))
    assert result <= 4
