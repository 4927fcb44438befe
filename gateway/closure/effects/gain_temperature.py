"""The radial axis' gain drifts with temperature."""

from __future__ import annotations

from gateway.closure.effects.base import (
    NOWHERE,
    RADIAL,
    Conditions,
    FloatArray,
    Here,
    Parameter,
    Stage,
    StartModel,
    bare,
)


class GainTemperature:
    """Relative change of the radial gain per kelvin, about the campaign's mean temperature."""

    name = "gain-temperature drift"
    summary = "The gain of the radial axis changes with temperature."
    equation = "radial += drift_per_k * (T - T_reference) * a_rad"
    # Capacitive elements 0.01 to 0.05 %/K, piezoelectric and piezoresistive ones without compensation 0.1 to 0.3 %/K.
    parameters: tuple[Parameter, ...] = (
        Parameter("drift_per_k", "1/K", -5e-3, 5e-3, 1e-3, 1e-6, factor=100.0, display_unit="%/K"),
    )
    seen_by = "radial axis at two temperatures or more, ten kelvin apart or more"
    confused_with = (
        "gain: one temperature cannot tell them; pressure, which rises with temperature: it changes the shape of the "
        "waveform, the gain does not"
    )
    already_in: frozenset[StartModel] = NOWHERE
    stage = Stage.ELEMENT
    axes: tuple[int, ...] = (RADIAL,)
    linear = True

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return 0.03 %/K."""
        return ((3e-4,),)

    def contribution(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return the share of the radial axis at the block's temperature."""
        return float(parameters[0]) * self._per_drift(here)

    def derivative(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return the radial axis times the kelvins above the reference."""
        return self._per_drift(here)[None]

    @staticmethod
    def _per_drift(here: Here) -> FloatArray:
        change = bare(here)
        warmer = here.conditions.temperature_degc - here.conditions.reference_degc
        change[RADIAL] = warmer * here.signal_mps2[RADIAL]
        return change


EFFECT = GainTemperature()
