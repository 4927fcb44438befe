"""Lateral axis of a measured tire: five revolutions on a drum, AC-coupled."""

from pathlib import Path

import numpy as np
import pytest

from firmware_protocol.messages import Coupling
from gateway.constants import STANDARD_GRAVITY_MPS2
from gateway.estimators.estimator import Status
from gateway.estimators.lateral_shape import lateral_record, slopes
from tools.generators.lateral_signals import RADIUS_M, Sensor, through_pipeline

RECORDING = Path(__file__).parents[2] / ".." / "shared" / "measured" / "innerliner_drum_80kmh.csv"


@pytest.mark.skipif(not RECORDING.exists(), reason="the measured recording is not at hand")
def test_measured_deformation_repeats_but_roll_tilt_is_unknown() -> None:
    columns = np.genfromtxt(RECORDING, delimiter=",", names=True)
    values = np.stack([columns[axis] for axis in ("x_g", "y_g", "z_g")], axis=1) * STANDARD_GRAVITY_MPS2
    sensor = Sensor(rate_hz=25600.0)
    results = through_pipeline(values, sensor, ["ply-steer"], coupling=Coupling.AC)
    good = [r.revolution for r in results if not r.revolution.faults]
    assert len(good) >= 4
    angles = np.degrees(
        [slopes(lateral_record(r, 0.0), (r.leading_edge_rad, r.trailing_edge_rad), RADIUS_M).values_rad for r in good]
    )
    assert np.all(angles.std(axis=0, ddof=1) < 0.05)
    assert np.all((angles > 0.1) & (angles < 0.4))
    last = {e.name: e for e in results[-1].estimates}
    assert last["ply_steer_first_half_rad"].status is Status.PROVISIONAL
    assert last["sensor_roll_rad"].status is Status.INVALID
    # The tilt is not known; one degree of it changes the slope by a third.
    assert np.degrees(last["ply_steer_first_half_rad"].std) > 0.05
