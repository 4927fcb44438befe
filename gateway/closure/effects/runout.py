"""Run-out: a tire that is not round carries the sensor on a longer radius and presses harder at its high spot."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from gateway.closure.effects.base import NOWHERE, Conditions, Parameter
from gateway.closure.ring_options import RingOptions
from gateway.types import FloatArray

# New car tires: 0.5 mm first harmonic, 1 to 1.5 mm the usual limit; a bent rim or flat spot gives 3 mm.
_LARGEST_M: Final = 3e-3
_MM: Final = 1e3


class RunOut:
    """First harmonic of the tire's radius, fixed to the tire and so to the sensor."""

    name = "run-out"
    summary = "The tire's radius swings once around: the sensor's own radius, and more load when the high spot comes."
    equation = "s (1 + x / R) at load Q + kz (x cos(theta) + y sin(theta)), the axle keeping its height"
    parameters = (
        Parameter("cosine_m", "m", -_LARGEST_M, _LARGEST_M, 1e-3, 1e-5, factor=_MM, display_unit="mm"),
        Parameter("sine_m", "m", -_LARGEST_M, _LARGEST_M, 1e-3, 1e-5, factor=_MM, display_unit="mm"),
    )
    seen_by = (
        "Radial, the smooth shape away from the contact, as the load on the contact swings against it; it is fixed to "
        "the sensor and never averages out."
    )
    confused_with = (
        "Gain and rolling radius (0.9 alike: a fifth of the cosine part is left beside the ring's own numbers), onset "
        "of clipping, ripple of order 1 (0.7). A second sensor half around, or the load's swing at the axle, decides."
    )
    already_in = NOWHERE
    needs_exact = True

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return one start: it is nearly linear."""
        return ((3e-4, 3e-4),)

    def options(self, options: RingOptions, parameters: FloatArray, conditions: Conditions) -> RingOptions:
        """Return the options with the high spot; rolling the other way it comes after what it came before."""
        cosine, sine = (float(value) for value in parameters)
        return replace(options, runout_cosine_m=cosine, runout_sine_m=-sine if conditions.reverse else sine)


EFFECT = RunOut()
