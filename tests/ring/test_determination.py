"""The test of which numbers are determined, and the reasons of those that are not."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.core.estimates.estimator import Status, TireConditions
from gateway.core.reasons import CoreCode, Reason, codes_of
from gateway.core.ring_quantities import RING_NUMBERS, RING_RATIOS
from gateway.papers.reasons import PaperCode
from gateway.ring.determination import (
    FittedNumbers,
    all_invalid,
    determination,
    load_number,
    number_estimates,
    scale_error,
)
from gateway.ring.reasons import RingCode

CONDITIONS = TireConditions(0.32, 5000.0, 2.1e5)
VALUES = np.array([3e-3, 0.2, 3.0, 2.5])
FREE = np.ones(4, dtype=bool)


def fitted(relative_noise: object, relative_model: object = 0.0, values: np.ndarray = VALUES) -> FittedNumbers:
    noise, model = (np.diag(np.square(np.broadcast_to(r, 4) * values)) for r in (relative_noise, relative_model))
    return FittedNumbers(values, FREE, noise, model)


def test_determined_means_three_standard_errors_with_model_error() -> None:
    numbers = fitted([0.1, 0.3, 0.3, 0.2], [0.1, 0.1, 0.2, 0.5])
    result = determination(numbers)
    np.testing.assert_allclose(result.relative_error, [0.14142, 0.31623, 0.36056, 0.53852], rtol=1e-4)
    estimates = {e.name: e for e in number_estimates("weak-form", numbers, CONDITIONS, ())}
    assert [estimates[name].status for name in RING_NUMBERS] == [Status.VALID] * 2 + [Status.PROVISIONAL] * 2
    undetermined, share = estimates["Ts"].reasons
    assert undetermined == Reason(CoreCode.NOT_DETERMINED, relative_error=result.relative_error[3])
    assert share["share"] == pytest.approx(0.5**2 / (0.2**2 + 0.5**2))
    assert estimates["Rs"].reasons[1]["share"] < 0.5
    assert estimates["Ts"].std == pytest.approx(0.53852 * 2.5, rel=1e-4)


def test_ratio_needs_its_own_determination() -> None:
    """Bs is determined to 20 %, but Cw to 50 % only, and so their ratio."""
    results = {e.name: e for e in number_estimates("weak-form", fitted([0.2, 0.5, 0.1, 0.1]), CONDITIONS, ())}
    assert results["Bs"].status is Status.VALID
    assert results["Bs/Cw"].status is Status.PROVISIONAL
    assert codes_of(results["Bs/Cw"].reasons)[0] is CoreCode.NOT_DETERMINED


def test_weak_bending_needs_a_smaller_error() -> None:
    weak = np.array([1e-4, 0.2, 3.0, 2.5])
    numbers = fitted(0.25), fitted(0.25, values=weak), fitted(0.15, values=weak)
    statuses = [number_estimates("weak-form", entry, CONDITIONS, ())[0].status for entry in numbers]
    assert statuses == [Status.VALID, Status.PROVISIONAL, Status.VALID]


def test_number_on_its_bound_is_invalid_others_valid() -> None:
    held = replace(fitted(0.1), values=VALUES * [1, 1, 1, 0], free=np.array([True, True, True, False]))
    results = {e.name: e for e in number_estimates("weak-form", held, CONDITIONS, ())}
    assert results["Ts"].status is results["Ts/Cw"].status is Status.INVALID
    assert results["Ts"].reasons == (Reason(RingCode.FIT_AT_ZERO, number="Ts"),)
    assert results["Rs"].status is results["Rs/Cw"].status is Status.VALID
    without_cw = replace(fitted(0.1), values=VALUES * [1, 0, 1, 1], free=np.array([True, False, True, True]))
    results = {e.name: e for e in number_estimates("weak-form", without_cw, CONDITIONS, ())}
    assert {results[name].status for name in RING_RATIOS} == {Status.INVALID}
    assert {results[name].reasons for name in RING_RATIOS} == {(Reason(RingCode.FIT_AT_ZERO, number="Cw"),)}


def test_correlated_numbers_are_reported() -> None:
    std = np.array([0.1, 0.5, 0.5, 0.1]) * VALUES
    correlation = np.eye(4)
    correlation[1, 2] = correlation[2, 1] = -0.98
    both = FittedNumbers(VALUES, FREE, correlation * np.outer(std, std), np.zeros((4, 4)))
    confounded = determination(both).why_not(1)[-1]
    assert (confounded.code, confounded["number"]) == (CoreCode.CORRELATED, "Rs")
    assert confounded["correlation"] == pytest.approx(-0.98)
    assert CoreCode.CORRELATED not in codes_of(determination(fitted(0.5)).why_not(1))


@settings(max_examples=50)
@given(st.lists(st.floats(-1.0, 1.0), min_size=16, max_size=16), st.floats(1e-4, 3.0))
def test_ratio_errors_follow_from_the_covariance(entries: list[float], size: float) -> None:
    root = np.array(entries).reshape(4, 4) * size * 1e-2 * VALUES[:, np.newaxis]
    numbers = FittedNumbers(VALUES, FREE, root @ root.T, np.zeros((4, 4)))
    results = {e.name: e for e in number_estimates("weak-form", numbers, CONDITIONS, ())}
    for name, i in zip(RING_RATIOS, (0, 2, 3), strict=True):
        gradient = np.zeros(4)
        gradient[i], gradient[1] = 1.0 / VALUES[1], -VALUES[i] / VALUES[1] ** 2
        assert results[name].value == pytest.approx(VALUES[i] / VALUES[1])
        assert results[name].std == pytest.approx(math.sqrt(gradient @ root @ root.T @ gradient), rel=1e-6, abs=1e-12)


def test_scale_doubts_notes_and_invalid_estimates() -> None:
    conditions = replace(CONDITIONS, load_std_n=50.0, pressure_std_pa=4.2e3, radius_std_m=0.0016)
    assert load_number(conditions) == pytest.approx(5000.0 / (2.1e5 * 0.32**2))
    assert load_number(TireConditions(0.32)) == 1.0
    assert scale_error(conditions) == pytest.approx(math.hypot(0.01, 0.02, 0.01))
    doubt, note = Reason(RingCode.FIT_NOT_CONVERGED), Reason(PaperCode.LINEAR_RING)
    doubted = number_estimates("weak-form", fitted(0.1), conditions, (doubt,), (note,))
    assert all(e.status is Status.PROVISIONAL and e.reasons == (doubt,) for e in doubted)
    assert all(e.reasons == (note,) for e in number_estimates("weak-form", fitted(0.1), conditions, (), (note,)))
    nothing = all_invalid(doubt)
    assert [e.name for e in nothing] == [*RING_NUMBERS, *RING_RATIOS]
    assert all(e.status is Status.INVALID and math.isnan(e.value) and e.reasons == (doubt,) for e in nothing)
