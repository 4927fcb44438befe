"""Rates of camber and steering at the sensor, against positions that are differentiated twice."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gateway.ring.turning_wheel import turning_acceleration

RADIUS_M = 0.32
OMEGA = 50.0
STEP_S = 2e-5


def specific_force_of_positions(time_s: np.ndarray, camber_radps: float, steer_radps: float) -> np.ndarray:
    """Return circumferential, lateral, radial at a point of a rigid wheel by numeric derivatives, without gravity."""
    begin_rad = np.array([0.02, -0.03])
    angles = begin_rad + np.outer(time_s, [camber_radps, steer_radps])
    spin = Rotation.from_euler("y", (OMEGA * time_s)[:, None])
    wheel = Rotation.from_euler("x", angles[:, :1]) * Rotation.from_euler("z", angles[:, 1:]) * spin
    position = wheel.apply([0.0, 0.0, -RADIUS_M])
    acceleration = (position[2:] - 2.0 * position[1:-1] + position[:-2]) / STEP_S**2
    axes = ([-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0])
    return np.stack([np.sum(acceleration * wheel[1:-1].apply(axis), axis=1) for axis in axes], axis=1)


@pytest.mark.parametrize(("camber_radps", "steer_radps"), [(0.5, 0.0), (0.0, 0.8), (-0.4, 0.6)])
def test_rates_add_what_a_rigid_wheel_feels(camber_radps: float, steer_radps: float) -> None:
    time_s = np.arange(-1, 6284) * STEP_S
    felt = specific_force_of_positions(time_s, camber_radps, steer_radps)
    felt -= np.array([0.0, 0.0, RADIUS_M * OMEGA**2])
    inner = time_s[1:-1]
    added = turning_acceleration(
        OMEGA * inner,
        OMEGA,
        RADIUS_M,
        steer_rad=-0.03 + steer_radps * inner,
        steer_radps=steer_radps,
        camber_radps=camber_radps,
    )
    # 2 omega R times the rate, on the lateral axis: the rest is small.
    assert np.abs(added).max() == pytest.approx(2.0 * OMEGA * RADIUS_M * np.hypot(camber_radps, steer_radps), rel=0.05)
    np.testing.assert_allclose(felt, added, atol=2e-3)
