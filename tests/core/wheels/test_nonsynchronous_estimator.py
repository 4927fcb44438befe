"""Nonsynchronous signals through the whole pipeline."""

import math

import numpy as np
import pytest

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.estimates.estimator import Status
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.core.reasons import CoreCode, Reason, codes_of
from gateway.core.wheels.wheels import Pipeline
from gateway.forces.nonsynchronous import NonsynchronousEstimator
from gateway.forces.reasons import ForceCode
from tests.testkit.revolution_data import settled
from tests.testkit.simulated_wheel import last, simulated

SETUP = WheelSetup("FL", 0, 0, 0.32)
NAMES = ("asynchronous_rms_mps2", "asynchronous_line_hz", "asynchronous_line_rms_mps2")


def with_cavity(roll, to_frames, frequency_hz: float, rms: float, noise: float = 3.4):
    """Return the estimates of a wheel at 65 km/h with a tone that is not locked to it."""
    signal = roll(65.0, 14.0, noise_mps2=noise).radial_mps2
    tone = rms * math.sqrt(2.0) * np.sin(2.0 * math.pi * frequency_hz * np.arange(len(signal)) / 9600.0)
    pipeline = Pipeline((SETUP,), SETUP, ("kinematic", "asynchronous"))
    return last(tuple(pipeline.frames("link", to_frames(signal + tone), 10**18)))


@pytest.mark.parametrize(("frequency_hz", "rms"), [(221.7, 5.0), (231.2, 1.0), (60.3, 2.0)])
def test_cavity_resonance_is_found(roll, to_frames, frequency_hz: float, rms: float) -> None:
    result = with_cavity(roll, to_frames, frequency_hz, rms)
    assert result[NAMES[1]].status is Status.VALID
    assert result[NAMES[1]].value == pytest.approx(frequency_hz, abs=0.2)
    assert result[NAMES[2]].value == pytest.approx(rms, rel=0.1)


def test_line_at_wheel_order_is_provisional(roll, to_frames) -> None:
    order_25 = 25 * 65.0 / 3.6 / 0.32 / (2.0 * math.pi)
    result = with_cavity(roll, to_frames, order_25 + 0.3, 3.0)
    assert result[NAMES[1]].status is Status.PROVISIONAL
    assert result[NAMES[1]].reasons == (Reason(ForceCode.AT_WHEEL_ORDER, order=25),)


def test_smooth_road_gives_sensor_noise() -> None:
    result = last(simulated("", 16.0, SETUP, ("kinematic", "asynchronous"))[0])
    density = 5e-3 * STANDARD_GRAVITY_MPS2
    assert result[NAMES[0]].value == pytest.approx(density * math.sqrt(795.0), rel=0.08)
    assert result[NAMES[1]].status is Status.INVALID
    assert codes_of(result[NAMES[1]].reasons) == (ForceCode.NO_LINE,)


def test_road_vibration_is_measured() -> None:
    result = last(simulated("[road]\nrms_mps2 = 5", 16.0, SETUP, ("kinematic", "asynchronous"))[0])
    assert result[NAMES[0]].value == pytest.approx(5.15, rel=0.06)


def test_too_few_revolutions_are_invalid() -> None:
    results, _ = simulated("", 3.0, SETUP, ("kinematic", "asynchronous"))
    for estimate in results[-1].estimates[-3:]:
        assert estimate.reasons[0].code in (ForceCode.NEEDS_UNINTERRUPTED_ROLLING, CoreCode.NOT_SETTLED)


def test_gap_restarts_the_spectrum() -> None:
    results, _ = simulated("", 16.0, SETUP, ("kinematic", "asynchronous"))
    estimator = NonsynchronousEstimator()
    # Every tenth revolution is missing, so there are never four seconds without a gap.
    for result in results:
        if result.revolution.index % 10 == 0:
            continue
        actual = estimator.update(result.revolution, settled(result.revolution, 20), result.conditions)
    assert all(estimate.status is Status.INVALID for estimate in actual)
