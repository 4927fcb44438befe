"""Run-out: a tire that is not round carries the sensor on a longer radius and presses harder at its high spot."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.closure.effects.base import NOWHERE, RADIAL, Conditions, Here, Parameter, Stage, bare
from gateway.closure.effects.belt import closed_shape, inclination, slopes

FloatArray = NDArray[np.float64]

# New car tires: 0.5 mm first harmonic, 1 to 1.5 mm the usual limit; a bent rim or flat spot gives 3 mm.
_LARGEST_M: Final = 3e-3
_MM: Final = 1e3
# Of the exact ring over Bs, Cw, Rs within a factor of 2 and half angles of 0.12 to 0.33 rad: vertical stiffness times
# deflection over load is 1.02 to 1.26; the change of the waveform with ln(load) is 0.8 of its stretch about the contact
# and 1.15 of its deviation from a circle beyond, which leaves 5 to 15 % of it.
_STIFFNESS: Final = 1.18
_STRETCH: Final = 0.82
_GROWTH: Final = 1.15
_REACH: Final = 2.5


class RunOut:
    """First harmonic of the tire's radius, fixed to the tire and so to the sensor."""

    name = "run-out"
    summary = "The tire's radius swings once around: the sensor's own radius, and more load when the high spot comes."
    equation = "s x / R + (kz / Q)(x cos(theta) + y sin(theta)) ds/dlnQ, x cos + y sin: height of the spot on the road"
    parameters = (
        Parameter("cosine_m", "m", -_LARGEST_M, _LARGEST_M, 1e-3, 1e-6, factor=_MM, display_unit="mm"),
        Parameter("sine_m", "m", -_LARGEST_M, _LARGEST_M, 1e-3, 1e-6, factor=_MM, display_unit="mm"),
    )
    seen_by = (
        "Hardly: what is alike before and after the contact (cosine) looks like gain and load; the sine part is a "
        "slight fore-and-aft difference of the smooth shape. It is fixed to the sensor and never averages out."
    )
    confused_with = (
        "Gain and an error of the stated load (cosine), damping and traction (sine). A second sensor half around, or "
        "the load's swing at the axle, decides."
    )
    already_in = NOWHERE
    stage = Stage.BELT
    axes = (RADIAL,)
    linear = True

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return one start: the effect is linear."""
        return ((3e-4, 3e-4),)

    def contribution(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return gain and change of load on the radial axis."""
        result: FloatArray = np.tensordot(parameters, self.derivative(here, parameters), 1)
        return result

    def derivative(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return what a metre of cosine and of sine height does. Rolling the other way turns the sine's sign."""
        rows = np.stack([bare(here)] * 2)
        conditions = here.conditions
        square = conditions.omega_radps**2
        swing = square * _STIFFNESS / deflection(here) * by_load(here)
        rows[0, RADIAL] = square * closed_shape(here) / conditions.radius_m + np.cos(here.theta_rad) * swing
        rows[1, RADIAL] = (-1.0 if conditions.reverse else 1.0) * np.sin(here.theta_rad) * swing
        return rows


def deflection(here: Here) -> float:
    """Return how far the belt is pressed flat, m: a circle's diameter less the height of the belt's shape."""
    radius = here.conditions.radius_m
    rise = np.cumsum(np.sin(inclination(here))) * (radius * (here.theta_rad[1] - here.theta_rad[0]))
    height = float(rise.max() - rise.min())
    return max(2.0 * radius - height, 1e-3 * radius)


def by_load(here: Here) -> FloatArray:
    """Return how the radial shape changes with the logarithm of the load, m, as rings of many kinds do."""
    shape, radius = closed_shape(here), here.conditions.radius_m
    middle = 0.5 * (here.leading_edge_rad + here.trailing_edge_rad)
    half = 0.5 * (here.trailing_edge_rad - here.leading_edge_rad)
    away = here.theta_rad - middle
    near = 0.5 * (1.0 + np.cos(np.pi * np.clip(np.abs(away) / (_REACH * half), 0.0, 1.0)))
    result: FloatArray = -_STRETCH * near * away * slopes(shape)[0] + _GROWTH * (1.0 - near) * (shape - radius)
    return result


EFFECT = RunOut()
