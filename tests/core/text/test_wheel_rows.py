"""Rows of recordings: a mean is as valid as the revolutions it comes from, and no impossible reading is in it."""

import pytest

from firmware_protocol.messages import Environment
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.reasons import Reason
from gateway.core.text.wheel_rows import _Quantity
from gateway.core.wheels.possible_readings import possible_reading
from gateway.fleet.recording_estimation import _concerns

DOUBT = Reason(EstimateCode.TEMPERATURE_NOT_COMPENSATED, difference_k=15.0)


def quantity(valid: int, provisional: int = 0, invalid: int = 0, *, first: int = 0, step: float = 0.0) -> _Quantity:
    """Return an estimate of 1.0 ± 0.1, after `first` revolutions without one; the second half is higher by `step`."""
    result = _Quantity(is_steady=True)
    for _ in range(first):
        result.add(Estimate.invalid("Bs", DOUBT))
    for number in range(valid):
        result.add(Estimate("Bs", 1.0 + step * (number >= valid // 2), 0.1, Status.VALID, ()))
    for _ in range(provisional):
        result.add(Estimate("Bs", 1.0, 0.1, Status.PROVISIONAL, (DOUBT,)))
    for _ in range(invalid):
        result.add(Estimate.invalid("Bs", DOUBT))
    return result


@pytest.mark.parametrize(
    ("counts", "status"),
    [
        ({"valid": 60, "provisional": 40}, "valid"),
        ({"valid": 1, "provisional": 99}, "provisional"),
        ({"valid": 10, "invalid": 30}, "provisional"),
        ({"valid": 10, "first": 30}, "valid"),
        ({"valid": 0, "provisional": 5}, "provisional"),
        ({"valid": 0, "invalid": 5}, "invalid"),
    ],
)
def test_status_is_that_of_most_revolutions(counts, status):
    *_, result, reason = quantity(**counts).cells()
    assert result == status
    if counts["valid"] and status == "provisional":
        assert f"only {counts['valid']} of" in reason
        assert "not corrected for temperature" in reason


def test_scatter_beyond_the_errors_is_in_the_error():
    value, std, scatter, count, status, reason = quantity(40, step=2.0).cells()
    assert (value, count, status) == (pytest.approx(2.0), 40, "provisional")
    assert scatter == pytest.approx(1.013, abs=0.01)
    assert std == pytest.approx((0.1**2 + scatter**2) ** 0.5)
    assert "varied within the recording" in reason
    assert quantity(40, step=0.3).cells()[4] == "valid"


def test_impossible_readings_are_not_used():
    assert possible_reading(Environment(-300e3, 30.0, None)) is None
    assert possible_reading(Environment(220e3, 200.0, None)) == Environment(220e3, None, None)
    assert possible_reading(Environment(220e3, 90.0, None)) == Environment(220e3, 90.0, None)


def test_false_statements_concern_their_wheel_or_all():
    concerned = [_concerns(subject, "FL", ("FL", "FR")) for subject in ("FL", "FR", "hub 0", "serial, FL", "")]
    assert concerned == [True, False, True, True, True]
