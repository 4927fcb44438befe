"""Drum curvature: on a drum the belt in contact bends the other way instead of lying flat."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from gateway.closure.effects.base import NOWHERE, Conditions, Parameter
from gateway.closure.ring_options import RingOptions
from gateway.types import FloatArray

_LEAST_HOLLOW_PM: Final = -0.2
# Errors from 0 at which the road is hollow.
_TOLD: Final = 3.0


class DrumCurvature:
    """Curvature of the road in the rolling direction, 0 on a flat one."""

    name = "drum curvature"
    summary = "The road is a drum: the sensor reads less than zero in the contact (more, inside a drum)."
    equation = "in contact kappa = -1 / R_d, s = -(R omega)^2 / R_d"
    # Drums have radii of 0.5 to 2.5 m, inner drums of 1.9 m and more.
    parameters = (Parameter("curvature_pm", "1/m", low=-0.6, high=2.1, prior_std=1.0, step=0.01),)
    seen_by = "radial axis, level in the contact against the level outside, as Omega^2"
    confused_with = (
        "sidewall stiffening, -0.7 alike; mounting offset, -0.9 alike where neither the mean nor the circumferential "
        "axis is seen; the tread's stiffness"
    )
    already_in = NOWHERE
    needs_exact = True

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return a drum of 1.7 m diameter and an inner drum of 3.8 m."""
        return ((1.2,), (-0.5,))

    def reason_against(self, parameters: FloatArray, std: FloatArray) -> str:
        """Refuse a hollow road that no inner drum is: an outer one may be large, as any road is crowned somewhere."""
        curvature, error = float(parameters[0]), float(std[0])
        if not _LEAST_HOLLOW_PM < curvature < -_TOLD * error:
            return ""
        return f"the road would be hollow with a radius of {-1.0 / curvature:.3g} m, and inner drums have 5 m at most"

    def options(self, options: RingOptions, parameters: FloatArray, conditions: Conditions) -> RingOptions:
        """Return the options with the drum's curvature."""
        return replace(options, drum_curvature_pm=options.drum_curvature_pm + float(parameters[0]))


EFFECT = DrumCurvature()
