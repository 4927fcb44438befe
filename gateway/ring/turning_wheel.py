"""Acceleration of a sensor on a wheel that is steered and cambered while it rolls: Eq. 5 of the ply steer paper."""

import numpy as np
from numpy.typing import ArrayLike

from gateway.core.types import FloatArray


def turning_acceleration(
    angle_rad: FloatArray,
    omega_radps: ArrayLike,
    radius_m: float,
    *,
    steer_rad: ArrayLike,
    steer_radps: ArrayLike,
    camber_radps: ArrayLike,
) -> FloatArray:
    """Return what the rates of steering and camber add to the specific force at a rigid rim, (n, 3) in m/s^2.

    Along circumferential, lateral and radial, as a sensor reads: in the direction of its travel, to the left, toward
    the wheel centre. The wheel turns about its hub: first camber, then steering, then spin; the printed cos(psi) of
    Eq. 5 is cos(phi). The rates are constant.

    Args:
        angle_rad: (n,) angle of the sensor, 0 at the contact centre.
        omega_radps: rate of spin.
        radius_m: of the sensor.
        steer_rad: angle of the wheel plane about the vertical, positive to the left; minus the slip angle where the
            wheel moves straight on.
        steer_radps: its rate.
        camber_radps: rate of camber, positive where the left side rises.
    """
    spin = np.asarray(omega_radps, dtype=np.float64)
    camber, steer = np.asarray(camber_radps), np.asarray(steer_radps)
    forward, about_axle = camber * np.cos(steer_rad), spin - camber * np.sin(steer_rad)
    sine, cosine = np.sin(angle_rad), np.cos(angle_rad)
    outward, along = -forward * sine - steer * cosine, steer * sine - forward * cosine
    both = camber * steer
    return radius_m * np.stack(
        [
            along * outward - both * np.cos(steer_rad),
            outward * (spin + about_axle) - both * np.sin(steer_rad) * cosine,
            along**2 + about_axle**2 - spin**2,
        ],
        axis=-1,
    )
