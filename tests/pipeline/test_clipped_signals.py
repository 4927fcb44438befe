"""Signals clipped below the stated range, through the whole pipeline."""

import numpy as np
import pytest

from gateway.estimators.estimator import Status
from gateway.pipeline.wheel_setup import WheelSetup
from gateway.pipeline.wheels import Pipeline
from gateway.reasons import Code, Reason, codes_of

SETUP = WheelSetup("FL", 0, 0, 0.32, load_n=5000.0)


@pytest.mark.parametrize("rate_hz", [2000.0, 9600.0])
def test_undeclared_clipping_is_a_fault(roll, to_frames, rate_hz: float) -> None:
    signal = roll(65.0, 5.0, rate_hz).radial_mps2
    estimators = ("kinematic", "self-calibration")
    pipeline = Pipeline((SETUP,), SETUP, estimators)
    results = pipeline.frames("link", to_frames(np.minimum(signal, 1350.0), rate_hz), 10**18)
    assert len(results) > 30
    assert all(Reason(Code.RADIAL_CLIPPED) in result.revolution.faults for result in results)
    assert pipeline.average_mps2("FL") is None
    gain = {estimate.name: estimate for estimate in results[-1].estimates}["gain"]
    assert gain.status is Status.INVALID
    assert codes_of(gain.reasons) == (Code.REVOLUTION_NOT_USED, Code.RADIAL_CLIPPED)
    whole = Pipeline((SETUP,), SETUP, estimators).frames("link", to_frames(signal, rate_hz), 10**18)
    assert not any(result.revolution.faults for result in whole)
