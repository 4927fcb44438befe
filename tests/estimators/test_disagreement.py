"""Errors by a disagreement that is no contradiction."""

import numpy as np
import pytest

from gateway.estimators.determination import FittedNumbers, number_estimates
from gateway.estimators.disagreement import CONTRADICTION, disagreement_std
from gateway.estimators.estimator import Estimate, Status, TireConditions
from gateway.estimators.tire_data import ReferenceNumbers, TireData
from gateway.quantity_catalogue import RING_NUMBERS
from gateway.reasons import Code, codes_of

VALUES = np.array([3e-3, 0.195, 2.97, 2.5])


def numbers(width: float) -> dict[str, Estimate]:
    """Return numbers whose Cw is `width` times that of the new tire."""
    reference = ReferenceNumbers(Cw=0.195 / width, Cw_std=0.01 * 0.195, estimator="weak-form")
    conditions = TireConditions(
        0.32, 5000.0, 210e3, load_std_n=50.0, pressure_std_pa=1e3, tire=TireData(reference=reference)
    )
    fitted = FittedNumbers(VALUES, np.ones(4, dtype=np.bool_), np.diag((0.002 * VALUES) ** 2), np.zeros((4, 4)))
    return {
        number_estimate.name: number_estimate
        for number_estimate in number_estimates("weak-form", fitted, conditions, ())
    }


def test_disagreement_grows_towards_a_contradiction() -> None:
    results = [disagreement_std(errors * 0.02, 0.02) for errors in (1.01, 1.5, 2.0, 2.9)]
    assert results == sorted(results)
    assert results[0] < 0.02 * 0.02
    assert results[2] == pytest.approx(0.24 * 0.04, rel=0.02)


def test_disagreement_within_one_error_adds_nothing() -> None:
    assert disagreement_std(-0.02, 0.02) == 0.0
    assert disagreement_std(0.0, 0.0) == 0.0


def test_disagreement_at_the_limit_is_as_likely_wrong_as_right() -> None:
    assert disagreement_std(CONTRADICTION, 1.0) ** 2 == pytest.approx(0.5 * (CONTRADICTION**2 - 1.0))
    assert disagreement_std(-30.0, 1.0) == pytest.approx(30.0 / 2.0**0.5, rel=1e-3)


def test_width_near_a_contradiction_widens_the_numbers() -> None:
    """A load stated 4 % too low, with an error of 1 %, is within three errors of the new tire's width."""
    plain, off = numbers(1.0), numbers(1.04)
    for name in RING_NUMBERS:
        assert off[name].status is Status.VALID
        assert codes_of(off[name].reasons) == (Code.WIDTH_DISAGREES,)
        assert 3.0 * off[name].std > 0.04 * off[name].value > 3.0 * plain[name].std
    assert off["Bs/Cw"] == plain["Bs/Cw"]


def test_width_that_agrees_changes_no_error() -> None:
    for name in RING_NUMBERS:
        assert numbers(1.01)[name].std == numbers(1.0)[name].std
        assert numbers(1.01)[name].reasons == ()
