"""Laws of the sensor chain: delay, hysteresis, other gain below zero, square, cross axis, averaging along the belt."""

from __future__ import annotations

from typing import Final

import numpy as np

from gateway.closure.effects.acquisition import CIRCUMFERENTIAL_DELAY, LATERAL_DELAY
from gateway.closure.effects.effect import (
    CIRCUMFERENTIAL,
    LATERAL,
    RADIAL,
    ModelledBlock,
    Parameter,
    SignalEffect,
    Stage,
)
from gateway.closure.effects.mounting import SENSOR_LENGTH
from gateway.closure.laws.law import Law
from gateway.constants import AXIS_NAMES
from gateway.types import FloatArray

_LEVEL_MPS2: Final = 1000.0
_WITH_SIGNAL: Final = "goes with the signal itself, whatever speed, load and pressure"


class _AxisLaw(Law):
    """A law of one axis; `linear` ones have a unit reading."""

    stage = Stage.ELECTRIC
    linear = True
    scaling = _WITH_SIGNAL
    source = "definition of the error"

    def __init__(self, axis: int) -> None:
        """Take the axis."""
        self.axis = axis
        self.axes = (axis,)

    def contribution(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the size times the reading of a unit."""
        result: FloatArray = float(parameters[0]) * self.derivative(block, parameters)[0]
        return result


class Hysteresis(_AxisLaw):
    """An axis that lags behind by a constant, whichever way it moves."""

    def __init__(self, axis: int) -> None:
        """Take the axis."""
        super().__init__(axis)
        self.title = f"hysteresis of the {AXIS_NAMES[axis]} axis"
        self.name = f"law: {self.title}"
        self.summary = f"The {AXIS_NAMES[axis]} axis lags behind by a constant: it reads less while it rises."
        self.equation = f"{AXIS_NAMES[axis]} a - h sign(da/dt)"
        self.scaling = "the same at every speed, load and pressure"
        self.parameters = (Parameter("lag_mps2", "m/s^2", -200.0, 200.0, 5.0, 1e-3),)
        self.start_values = ((2.0,),)

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:  # noqa: ARG002 - linear
        """Return minus the sign of the rate."""
        rows = np.zeros((1, *block.signal_mps2.shape))
        signal = block.signal_mps2[self.axis]
        rows[0, self.axis] = -np.sign(np.roll(signal, -1) - np.roll(signal, 1))
        return rows


class GainBelowZero(_AxisLaw):
    """An axis whose gain is another one for negative readings."""

    def __init__(self, axis: int) -> None:
        """Take the axis."""
        super().__init__(axis)
        self.title = f"gain below zero of the {AXIS_NAMES[axis]} axis"
        self.name = f"law: {self.title}"
        self.summary = f"The {AXIS_NAMES[axis]} axis has another gain below zero than above."
        self.equation = f"{AXIS_NAMES[axis]} a + e min(a, 0)"
        self.parameters = (Parameter("error", "", -0.5, 0.5, 0.05, 1e-5, factor=100.0, display_unit="%"),)
        self.start_values = ((0.02,),)

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:  # noqa: ARG002 - linear
        """Return the negative part."""
        rows = np.zeros((1, *block.signal_mps2.shape))
        # In reverse the data's circumferential axis points against the sensor's own.
        flip = -1.0 if block.conditions.reverse and self.axis == CIRCUMFERENTIAL else 1.0
        rows[0, self.axis] = flip * np.minimum(flip * block.signal_mps2[self.axis], 0.0)
        return rows


class AxisSquare(_AxisLaw):
    """Quadratic error of an axis."""

    def __init__(self, axis: int) -> None:
        """Take the axis."""
        super().__init__(axis)
        self.title = f"square of the {AXIS_NAMES[axis]} axis"
        self.name = f"law: {self.title}"
        self.summary = f"The sensitivity of the {AXIS_NAMES[axis]} axis changes with the acceleration itself."
        self.equation = f"{AXIS_NAMES[axis]} a + q a^2"
        self.parameters = (
            Parameter(
                "square_s2pm", "s^2/m", -1e-3, 1e-3, 1e-5, 1e-8,
                factor=100.0 * _LEVEL_MPS2, display_unit=f"% at {_LEVEL_MPS2:.0f} m/s^2",
            ),
        )  # fmt: skip
        self.start_values = ((1e-5,),)

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:  # noqa: ARG002 - linear
        """Return the square."""
        rows = np.zeros((1, *block.signal_mps2.shape))
        flip = -1.0 if block.conditions.reverse and self.axis == CIRCUMFERENTIAL else 1.0
        rows[0, self.axis] = flip * np.square(block.signal_mps2[self.axis])
        return rows


class CrossAxis(_AxisLaw):
    """An axis that reads a share of another one."""

    def __init__(self, axis: int, other: int) -> None:
        """Take the axis and the one that it reads."""
        super().__init__(axis)
        self.other = other
        self.title = f"{AXIS_NAMES[other]} in the {AXIS_NAMES[axis]} axis"
        self.name = f"law: {self.title}"
        self.summary = f"The {AXIS_NAMES[axis]} axis also reads a share of the {AXIS_NAMES[other]} acceleration."
        self.equation = f"{AXIS_NAMES[axis]} + k {AXIS_NAMES[other]}"
        self.parameters = (Parameter("share", "", -0.3, 0.3, 0.03, 1e-5, factor=100.0, display_unit="%"),)
        self.start_values = ((0.01,),)

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:  # noqa: ARG002 - linear
        """Return the other axis."""
        rows = np.zeros((1, *block.signal_mps2.shape))
        flip = -1.0 if block.conditions.reverse and CIRCUMFERENTIAL in (self.axis, self.other) else 1.0
        rows[0, self.axis] = flip * block.signal_mps2[self.other]
        return rows


class EffectLaw(Law):
    """An effect of the catalogue as a law, for a base without it."""

    def __init__(self, effect: SignalEffect, title: str, scaling: str) -> None:
        """Take the effect, the title of the law and its growth in words."""
        self.effect = effect
        self.name, self.title = f"law: {title}", title
        self.summary, self.equation, self.source = effect.summary, effect.equation, effect.source
        self.parameters, self.start_values = effect.parameters, effect.start_values
        self.axes, self.stage, self.linear = effect.axes, effect.stage, effect.linear
        self.scaling = scaling

    def contribution(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return that of the effect."""
        return self.effect.contribution(block, parameters)

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return that of the effect."""
        return self.effect.derivative(block, parameters)


def sensor_laws() -> tuple[Law, ...]:
    """Return the laws of the sensor chain."""
    every = (CIRCUMFERENTIAL, LATERAL, RADIAL)
    return (
        *(
            EffectLaw(
                delay,
                f"delay of the {AXIS_NAMES[delay.axis]} axis",
                "the same time at every speed: the angle grows with omega",
            )
            for delay in (CIRCUMFERENTIAL_DELAY, LATERAL_DELAY)
        ),
        *(Hysteresis(axis) for axis in every),
        *(GainBelowZero(axis) for axis in every),
        *(AxisSquare(axis) for axis in (CIRCUMFERENTIAL, LATERAL)),
        CrossAxis(LATERAL, CIRCUMFERENTIAL),
        CrossAxis(RADIAL, CIRCUMFERENTIAL),
        EffectLaw(SENSOR_LENGTH, "mean over a length", "the same angle at every speed, load and pressure"),
    )
