"""Errors of a sensor's axis that the catalogue does not have: other gain below zero, powers, another axis."""

from typing import Final

import numpy as np

from gateway.core.constants import AXIS_NAMES, STANDARD_GRAVITY_MPS2
from gateway.core.types import FloatArray
from gateway.diagnosis.effects.effect import (
    CIRCUMFERENTIAL,
    Confounder,
    LinearSignalEffect,
    ModelledBlock,
    Parameter,
    Stage,
)

# Circumferential and lateral axes are chosen for +-16 g or more; they deviate by up to 2 % of that.
_LEVEL_MPS2: Final = 16.0 * STANDARD_GRAVITY_MPS2
_DEVIATION: Final = 0.02


class _OfAxis(LinearSignalEffect):
    """An error of one axis with a unit reading."""

    stage = Stage.ELECTRIC
    scaling = "goes with the signal itself, whatever speed, load and pressure"
    source = "definition of the error"
    observed_in = "one axis"
    confounders: tuple[Confounder, ...] = ()
    rank = 0

    def __init__(self, axis: int, other: int | None = None) -> None:
        """Take the axis, and the one that it reads, if any."""
        self.axis, self.other = axis, axis if other is None else other
        self.axes = (axis,)

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:  # noqa: ARG002 - linear
        """Return the reading of a unit."""
        rows = np.zeros((1, *block.signal_mps2.shape))
        # In reverse the data's circumferential axis points against the sensor's own.
        axis_sign, other_sign = (
            -1.0 if block.conditions.reverse and axis == CIRCUMFERENTIAL else 1.0 for axis in (self.axis, self.other)
        )
        rows[0, self.axis] = axis_sign * self.unit(other_sign * block.signal_mps2[self.other])
        return rows

    def unit(self, signal: FloatArray) -> FloatArray:
        """Return the error of a unit by the signal that it depends on."""
        return signal


class GainBelowZero(_OfAxis):
    """An axis whose gain is another one for negative readings."""

    parameters = (Parameter("error", "", -0.5, 0.5, 0.05, 1e-5, factor=100.0, display_unit="%"),)
    start_values = ((0.02,),)

    def __init__(self, axis: int) -> None:
        """Take the axis."""
        super().__init__(axis)
        self.name = f"gain below zero of the {AXIS_NAMES[axis]} axis"
        self.summary = f"The {AXIS_NAMES[axis]} axis has another gain below zero than above."
        self.equation = f"{AXIS_NAMES[axis]} a + e min(a, 0)"

    def unit(self, signal: FloatArray) -> FloatArray:
        """Return the negative part."""
        return np.minimum(signal, 0.0)


class AxisSquare(_OfAxis):
    """Quadratic error of an axis."""

    parameters = (
        Parameter(
            "square_s2pm", "s^2/m", -1e-3, 1e-3, _DEVIATION / _LEVEL_MPS2, 1e-8,
            factor=100.0 * _LEVEL_MPS2, display_unit=f"% at {_LEVEL_MPS2:.0f} m/s^2",
        ),
    )  # fmt: skip
    start_values = ((1e-5,),)

    def __init__(self, axis: int) -> None:
        """Take the axis."""
        super().__init__(axis)
        self.name = f"square of the {AXIS_NAMES[axis]} axis"
        self.summary = f"The sensitivity of the {AXIS_NAMES[axis]} axis changes with the acceleration itself."
        self.equation = f"{AXIS_NAMES[axis]} a + q a^2"

    def unit(self, signal: FloatArray) -> FloatArray:
        """Return the square."""
        return np.square(signal)


class AxisCube(_OfAxis):
    """Cubic error of an axis: symmetric elements, which harden or saturate on both sides."""

    parameters = (
        Parameter(
            "cube_s4pm2", "s^4/m^2", -8e-6, 8e-6, _DEVIATION / _LEVEL_MPS2**2, 1e-10,
            factor=100.0 * _LEVEL_MPS2**2, display_unit=f"% at {_LEVEL_MPS2:.0f} m/s^2",
        ),
    )  # fmt: skip
    start_values = ((1e-7,),)

    def __init__(self, axis: int) -> None:
        """Take the axis."""
        super().__init__(axis)
        self.name = f"cube of the {AXIS_NAMES[axis]} axis"
        self.summary = f"The {AXIS_NAMES[axis]} axis hardens or saturates on both sides."
        self.equation = f"{AXIS_NAMES[axis]} a + q a^3"

    def unit(self, signal: FloatArray) -> FloatArray:
        """Return the cube."""
        result: FloatArray = signal**3
        return result


class CrossAxis(_OfAxis):
    """An axis that reads a share of another one."""

    parameters = (Parameter("share", "", -0.3, 0.3, 0.03, 1e-5, factor=100.0, display_unit="%"),)
    start_values = ((0.01,),)

    def __init__(self, axis: int, other: int) -> None:
        """Take the axis and the one that it reads."""
        super().__init__(axis, other)
        self.name = f"{AXIS_NAMES[other]} in the {AXIS_NAMES[axis]} axis"
        self.summary = f"The {AXIS_NAMES[axis]} axis also reads a share of the {AXIS_NAMES[other]} acceleration."
        self.equation = f"{AXIS_NAMES[axis]} + k {AXIS_NAMES[other]}"
