"""The radial axis' gain drifts with temperature."""

from __future__ import annotations

import numpy as np

from gateway.closure.effects.base import (
    NOWHERE,
    RADIAL,
    Conditions,
    Here,
    Parameter,
    Stage,
    StartModel,
)
from gateway.types import FloatArray

# Temperatures nearer to each other than this say nothing of a drift.
_LEAST_RANGE_K = 2.0


class GainTemperature:
    """Relative change of the radial gain per kelvin, from the temperature at which the sensor was calibrated."""

    name = "gain-temperature drift"
    summary = "The gain of the radial axis changes with temperature."
    equation = "adds drift (T - calibrated) times the radial acceleration, T the temperature"
    parameters: tuple[Parameter, ...] = (
        # Capacitive elements 0.01 to 0.05 %/K, piezoelectric and piezoresistive ones uncompensated 0.1 to 0.3 %/K.
        Parameter("drift_per_k", "1/K", -5e-3, 5e-3, 1e-3, 1e-6, factor=100.0, display_unit="%/K"),
        # Data sheets state the gain at 20 to 25 degC; calibration in a laboratory is not far from it.
        Parameter("calibrated_degc", "degC", 10.0, 40.0, 5.0, 1e-3, prior_mean=25.0),
    )
    seen_by = "radial axis at two temperatures or more, ten kelvin apart or more"
    confused_with = (
        "gain: one temperature cannot tell them; pressure, which rises with temperature: it changes the shape of the "
        "waveform, the gain does not"
    )
    already_in: frozenset[StartModel] = NOWHERE
    stage = Stage.ELEMENT
    axes: tuple[int, ...] = (RADIAL,)
    linear = False

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return 0.03 %/K, and nothing where all was recorded at one temperature."""
        degc = [c.temperature_degc for c in conditions]
        return ((3e-4, 25.0),) if degc and max(degc) - min(degc) >= _LEAST_RANGE_K else ()

    def contribution(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return the share of the radial axis at the block's temperature."""
        change: FloatArray = float(parameters[0]) * self.derivative(here, parameters)[0]
        return change

    def derivative(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return its derivatives by the drift and by the temperature of calibration."""
        drift, calibrated = float(parameters[0]), float(parameters[1])
        change = np.zeros((2, *here.signal_mps2.shape))
        change[0, RADIAL] = (here.conditions.temperature_degc - calibrated) * here.signal_mps2[RADIAL]
        change[1, RADIAL] = -drift * here.signal_mps2[RADIAL]
        return change


EFFECT = GainTemperature()
