"""What is true of a belt's lateral shape: the slopes that docs/ply-steer.md defines, taken from the solution itself."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from gateway.simulator.tire_model import TireModel
from gateway.types import ComplexArray, FloatArray

# The solution's slope is drawn on so many angles; a peak is then known to 1e-6 of itself.
_FINE = 16384


class LateralSlopes(NamedTuple):
    """Slopes dy/ds of the belt's centre line in the contact, s = R theta, positive to the left.

    Attributes:
        peak_rad: steepest with the sign of the line through the whole contact.
        first_half_rad: mean from the leading edge to the contact's middle.
        adhesion_line_rad: line through y where the slope around the peak keeps its sign.
    """

    peak_rad: float
    first_half_rad: float
    adhesion_line_rad: float


@lru_cache(maxsize=512)
def lateral_slopes(
    tire: TireModel, load_n: float, pressure_pa: float, omega_radps: float, slip_angle_rad: float
) -> LateralSlopes:
    """Return the slopes of a tire solved under these conditions.

    Raises:
        RingNotConvergedError: the ring has no equilibrium.
        BrushNotConvergedError: nor has its tread under slip.
    """
    ring = tire.solve(load_n, pressure_pa, omega_radps)
    shape = tire.solve_lateral(ring, slip_angle_rad).y_m
    return slopes_of(shape, ring.ring.radius_m, ring.leading_edge_rad, ring.trailing_edge_rad)


def slopes_of(y_m: FloatArray, radius_m: float, leading_rad: float, trailing_rad: float) -> LateralSlopes:
    """Return the slopes of a lateral shape given over theta = -pi + 2 pi i / N, (N,)."""
    spectrum = np.fft.rfft(y_m)[: len(y_m) // 2] / len(y_m)
    order = np.arange(len(spectrum))
    theta = -np.pi + 2.0 * np.pi * np.arange(_FINE) / _FINE

    def synthesised(coefficients: ComplexArray) -> FloatArray:
        padded = np.zeros(_FINE // 2 + 1, np.complex128)
        padded[: len(coefficients)] = coefficients
        return np.fft.irfft(padded, n=_FINE) * _FINE

    shape, slope = synthesised(spectrum), synthesised(1j * order * spectrum) / radius_m
    contact = np.flatnonzero((theta >= leading_rad) & (theta <= trailing_rad))
    sign = np.sign(_line(theta[contact], shape[contact])) or 1.0
    steep = int(contact[np.argmax(sign * slope[contact])])
    first, last = steep, steep
    while first > contact[0] and sign * slope[first - 1] > 0.0:
        first -= 1
    while last < contact[-1] and sign * slope[last + 1] > 0.0:
        last += 1
    middle = 0.5 * (leading_rad + trailing_rad)
    ends = np.interp([leading_rad, middle], theta, shape)
    return LateralSlopes(
        peak_rad=float(slope[steep]),
        first_half_rad=float(ends[1] - ends[0]) / (radius_m * (middle - leading_rad)),
        adhesion_line_rad=_line(theta[first : last + 1], shape[first : last + 1]) / radius_m,
    )


def _line(x: FloatArray, y: FloatArray) -> float:
    """Return the slope of the least-squares line, 0 through a single point."""
    centred = x - x.mean()
    return float(centred @ y / (centred @ centred)) if len(x) > 1 else 0.0
