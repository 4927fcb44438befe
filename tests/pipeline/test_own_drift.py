"""An average that drifts is behind: its change within its memory is in its error."""

import pytest

from gateway.estimators.estimator import Estimate, Status
from gateway.estimators.ply_steer import HORIZON_REVOLUTIONS
from gateway.pipeline.own_drift import OwnDrift
from gateway.quantity_catalogue import quantity_of
from gateway.signal.synchronous_average import DEFAULT_HORIZON_REVOLUTIONS


def test_memories_are_those_of_the_averages() -> None:
    assert quantity_of("Bs").memory_revolutions == DEFAULT_HORIZON_REVOLUTIONS
    assert quantity_of("ply_steer_peak_rad").memory_revolutions == HORIZON_REVOLUTIONS


def estimates(value: float, status: Status = Status.VALID) -> tuple[Estimate, ...]:
    return Estimate("Bs", value, 0.01, status), Estimate("speed_mps", value, 0.01, Status.VALID)


def test_steady_value_keeps_its_error() -> None:
    drift = OwnDrift("weak-form")
    assert drift.applies
    assert not OwnDrift("kinematic").applies
    for _ in range(60):
        number, speed = drift.widened(estimates(1.0))
        assert number.std == pytest.approx(0.01)
        assert speed.std == 0.01


@pytest.mark.parametrize("memory", [50])
def test_ramp_is_in_the_error_within_the_memory(memory: int) -> None:
    drift = OwnDrift("weak-form")
    for index in range(200):
        number, speed = drift.widened(estimates(0.01 * index))
    lag = 0.01 * (memory - 1)
    assert lag < 2.0 * number.std < 2.0 * lag
    assert speed.std == 0.01


def test_step_is_forgotten_with_the_average_and_values_in_doubt_do_not_count() -> None:
    drift = OwnDrift("weak-form")
    drift.widened(estimates(5.0, Status.PROVISIONAL))
    assert drift.widened(estimates(1.0))[0].std == pytest.approx(0.01)
    assert drift.widened(estimates(2.0))[0].std > 0.5
    for _ in range(60):
        number, _ = drift.widened(estimates(2.0))
    assert number.std == pytest.approx(0.01)
    drift.widened(estimates(3.0))
    drift.reset()
    assert drift.widened(estimates(9.0))[0].std == pytest.approx(0.01)
