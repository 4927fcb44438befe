"""Specific force at the sensor from the belt's shape: speed, gravity, angular acceleration and mounting."""

import math
from dataclasses import replace
from typing import Final

import numpy as np

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.types import FloatArray
from gateway.diagnosis.effects.angle_orders import THETA
from gateway.diagnosis.effects.effect import CIRCUMFERENTIAL, FIELD_SIZE, RADIAL, GroupConditions, ModelledBlock
from gateway.diagnosis.model.baseline import Core, Shape

# Angle since mid revolution: a revolution runs from one contact's centre to the next, so its middle is at the top.
_FROM_MIDDLE: Final = np.where(THETA >= 0.0, THETA - math.pi, THETA + math.pi)


def base_signal(core: Core, shape: Shape, conditions: GroupConditions) -> ModelledBlock:
    """Return the signal of the baseline model alone along the belt's own directions.

    omega^2 shape + g gravity + domega/dt (spin + 2 theta' shape), theta' from mid revolution: omega^2 at theta' is
    omega^2 + 2 theta' domega/dt.
    """
    wave = shape.waveform
    signal = np.zeros((3, FIELD_SIZE))
    square = conditions.omega_radps**2
    signal[RADIAL] = square * wave.radial_m
    signal[CIRCUMFERENTIAL] = square * wave.circumferential_m
    if core.gravity:
        signal[RADIAL] += STANDARD_GRAVITY_MPS2 * wave.gravity_radial
        signal[CIRCUMFERENTIAL] += STANDARD_GRAVITY_MPS2 * wave.gravity_circumferential
    if core.drift and conditions.omega_dot_radps2:
        drift = 2.0 * conditions.omega_dot_radps2 * _FROM_MIDDLE
        signal[RADIAL] += drift * wave.radial_m + conditions.omega_dot_radps2 * wave.spin_radial_m
        signal[CIRCUMFERENTIAL] += (
            drift * wave.circumferential_m + conditions.omega_dot_radps2 * wave.spin_circumferential_m
        )
    edges = shape.leading_edge_rad, shape.trailing_edge_rad
    return ModelledBlock(conditions, THETA, signal, wave, *edges, shape.belt)


def with_signal(block: ModelledBlock, signal_mps2: FloatArray) -> ModelledBlock:
    """Return the same block with another signal."""
    return replace(block, signal_mps2=signal_mps2)


def mounting_matrix(roll_rad: float, pitch_rad: float) -> FloatArray:
    """Return the matrix from the belt's directions to the sensor's axes, (3, 3).

    Roll, about the circumferential axis, lets the radial axis leak into +lateral; pitch, about the lateral axis, lets
    it leak into +circumferential.
    """
    cos_roll, sin_roll = math.cos(roll_rad), math.sin(roll_rad)
    cos_pitch, sin_pitch = math.cos(pitch_rad), math.sin(pitch_rad)
    rolled = np.array([[1.0, 0.0, 0.0], [0.0, cos_roll, sin_roll], [0.0, -sin_roll, cos_roll]])
    pitched = np.array([[cos_pitch, 0.0, sin_pitch], [0.0, 1.0, 0.0], [-sin_pitch, 0.0, cos_pitch]])
    result: FloatArray = pitched @ rolled
    return result
