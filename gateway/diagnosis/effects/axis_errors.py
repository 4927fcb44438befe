"""Errors of one axis of the sensor: other gain below zero, powers, what another axis does to it, another place."""

from abc import abstractmethod
from typing import Final

import numpy as np

from gateway.core.constants import AXIS_NAMES, STANDARD_GRAVITY_MPS2
from gateway.core.types import ComplexArray, FloatArray
from gateway.diagnosis.effects.effect import (
    CIRCUMFERENTIAL,
    LATERAL,
    RADIAL,
    Confounder,
    LinearSignalEffect,
    ModelledBlock,
    Parameter,
    Stage,
)
from gateway.diagnosis.effects.periodic_filter import ORDER, AxisAhead

# Circumferential and lateral axes are chosen for +-16 g or more; they deviate by up to 2 % of that.
_LEVEL_MPS2: Final = 16.0 * STANDARD_GRAVITY_MPS2
_DEVIATION: Final = 0.02


_RESEMBLING: Final = {
    CIRCUMFERENTIAL: Confounder(
        ("mounting offset", "circumferential gain"),
        "they keep the shape of the axis; a slow recording, or the radial axis",
    ),
    LATERAL: Confounder(("roll tilt", "ply steer"), "they keep the shape of the axis; two speeds and two loads"),
    RADIAL: Confounder(("drum curvature", "pitch tilt"), "they act on the circumferential axis too; two speeds"),
}


class _SingleAxis(LinearSignalEffect):
    """An error of one axis with a unit reading."""

    stage = Stage.ELEMENT
    scaling = "goes with the signal itself, whatever speed, load and pressure"
    source = "definition of the error"
    observed_in = "one axis"

    def __init__(self, axis: int, rank: int, other: int | None = None) -> None:
        """Take the axis, the place in the catalogue, and the other axis, if any."""
        self.rank = rank
        self.axis, self.other = axis, axis if other is None else other
        self.axes = (axis,)
        self.confounders: tuple[Confounder, ...] = (_RESEMBLING[axis],)

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the reading of a unit."""
        rows = np.zeros((1, *block.signal_mps2.shape))
        # In reverse the data's circumferential axis points against the sensor's own.
        axis_sign, other_sign = (
            -1.0 if block.conditions.reverse and axis == CIRCUMFERENTIAL else 1.0 for axis in (self.axis, self.other)
        )
        axis_mps2, other_mps2 = axis_sign * block.signal_mps2[self.axis], other_sign * block.signal_mps2[self.other]
        rows[0, self.axis] = axis_sign * self.unit(axis_mps2, other_mps2)
        return rows

    @abstractmethod
    def unit(self, axis_mps2: FloatArray, other: FloatArray) -> FloatArray:
        """Return the error of a unit by the axis and the other axis."""


class GainBelowZero(_SingleAxis):
    """An axis whose gain is another one for negative readings."""

    parameters = (Parameter("error", "", -0.5, 0.5, 0.05, 1e-5, factor=100.0, display_unit="%"),)
    start_values = ((0.02,),)

    def __init__(self, axis: int, rank: int) -> None:
        """Take the axis and the place in the catalogue."""
        super().__init__(axis, rank)
        self.name = f"gain below zero of the {AXIS_NAMES[axis]} axis"
        self.summary = f"The {AXIS_NAMES[axis]} axis has another gain below zero than above."
        self.equation = f"{AXIS_NAMES[axis]} a + e min(a, 0)"

    def unit(self, axis_mps2: FloatArray, other: FloatArray) -> FloatArray:
        """Return the negative part."""
        return np.minimum(axis_mps2, 0.0)


class AxisSquare(_SingleAxis):
    """Quadratic error of an axis."""

    parameters = (
        Parameter(
            "square_s2pm", "s^2/m", -1e-3, 1e-3, _DEVIATION / _LEVEL_MPS2, 1e-8,
            factor=100.0 * _LEVEL_MPS2, display_unit=f"% at {_LEVEL_MPS2:.0f} m/s^2",
        ),
    )  # fmt: skip
    start_values = ((1e-5,),)

    def __init__(self, axis: int, rank: int) -> None:
        """Take the axis and the place in the catalogue."""
        super().__init__(axis, rank)
        self.name = f"square of the {AXIS_NAMES[axis]} axis"
        self.summary = f"The sensitivity of the {AXIS_NAMES[axis]} axis changes with the acceleration itself."
        self.equation = f"{AXIS_NAMES[axis]} a + q a^2"

    def unit(self, axis_mps2: FloatArray, other: FloatArray) -> FloatArray:
        """Return the square."""
        return np.square(axis_mps2)


class AxisCube(_SingleAxis):
    """Cubic error of an axis: symmetric elements, which harden or saturate on both sides."""

    parameters = (
        Parameter(
            "cube_s4pm2", "s^4/m^2", -8e-6, 8e-6, _DEVIATION / _LEVEL_MPS2**2, 1e-10,
            factor=100.0 * _LEVEL_MPS2**2, display_unit=f"% at {_LEVEL_MPS2:.0f} m/s^2",
        ),
    )  # fmt: skip
    start_values = ((1e-7,),)

    def __init__(self, axis: int, rank: int) -> None:
        """Take the axis and the place in the catalogue."""
        super().__init__(axis, rank)
        self.name = f"cube of the {AXIS_NAMES[axis]} axis"
        self.summary = f"The {AXIS_NAMES[axis]} axis hardens or saturates on both sides."
        self.equation = f"{AXIS_NAMES[axis]} a + q a^3"

    def unit(self, axis_mps2: FloatArray, other: FloatArray) -> FloatArray:
        """Return the cube."""
        result: FloatArray = axis_mps2**3
        return result


class GainByAxis(_SingleAxis):
    """An axis whose gain another one changes: it strains the element, or the part that holds it."""

    parameters = (
        Parameter(
            "change_s2pm", "s^2/m", -5e-4, 5e-4, 3e-5, 1e-8, factor=1e5, display_unit="% at 1000 m/s^2",
        ),
    )  # fmt: skip
    start_values = ((1e-5,),)
    scaling = "grows with the other axis: with omega^2 and the load"

    def __init__(self, axis: int, rank: int, other: int) -> None:
        """Take the axis, the place in the catalogue, and the axis that changes its gain."""
        super().__init__(axis, rank, other)
        name, cause = AXIS_NAMES[axis], AXIS_NAMES[other]
        self.name = f"{name} gain by the {cause} axis"
        self.summary = f"The gain of the {name} axis changes with the {cause} acceleration."
        self.equation = f"{name} a (1 + k {cause})"
        self.confounders = (
            Confounder((f"{name} gain",), "it is the same in the contact and beside it, and at every speed"),
            Confounder(("sensor nonlinearity",), "of the radial axis: it changes that axis too"),
        )

    def unit(self, axis_mps2: FloatArray, other: FloatArray) -> FloatArray:
        """Return the product of the axes."""
        return axis_mps2 * other


class CrossAxis(_SingleAxis):
    """An axis that reads a share of another one."""

    parameters = (Parameter("share", "", -0.3, 0.3, 0.03, 1e-5, factor=100.0, display_unit="%"),)
    start_values = ((0.01,),)

    def __init__(self, axis: int, rank: int, other: int) -> None:
        """Take the axis, the place in the catalogue, and the axis that it reads."""
        super().__init__(axis, rank, other)
        self.name = f"{AXIS_NAMES[other]} in the {AXIS_NAMES[axis]} axis"
        self.summary = f"The {AXIS_NAMES[axis]} axis also reads a share of the {AXIS_NAMES[other]} acceleration."
        self.equation = f"{AXIS_NAMES[axis]} + k {AXIS_NAMES[other]}"

    def unit(self, axis_mps2: FloatArray, other: FloatArray) -> FloatArray:
        """Return the other axis."""
        return other


class AxisShift(AxisAhead):
    """Distance along the inner liner of an axis' element from the radial one, which times the contact's centre."""

    source = "geometry: elements side by side meet the road one after the other"
    parameters = (Parameter("distance_m", "m", -0.05, 0.05, 0.005, 1e-6, factor=1e3, display_unit="mm"),)
    start_values = ((0.002,),)
    stage = Stage.MOUNTING
    scaling = "the same angle at every speed, load and pressure"

    def __init__(self, axis: int, rank: int) -> None:
        """Take the axis and the place in the catalogue."""
        self.axis, self.rank, self.axes = axis, rank, (axis,)
        name = AXIS_NAMES[axis]
        self.name = f"{name} shift"
        self.summary = f"The element of the {name} axis sits ahead of (or behind) the radial one along the inner liner."
        self.equation = f"{name} a(theta + distance / R): order n times exp(i n distance / R)"
        self.observed_in = f"{name} axis: its contact edges come at another angle than those of the radial one"
        self.confounders = (
            Confounder((f"{name} delay",), "two speeds: the angle of a delay grows with omega, a distance's does not"),
            Confounder(("contact asymmetry", "structural damping"), "they change the radial axis too"),
        )

    @staticmethod
    def rate(block: ModelledBlock) -> ComplexArray:
        """Return i n / R of every order; in reverse the element ahead is behind."""
        return (-1j if block.conditions.reverse else 1j) * ORDER / block.conditions.radius_m


EFFECTS: Final = (
    AxisShift(CIRCUMFERENTIAL, 292),
    AxisShift(LATERAL, 293),
    GainByAxis(CIRCUMFERENTIAL, 306, RADIAL),
    GainByAxis(LATERAL, 307, RADIAL),
    GainBelowZero(CIRCUMFERENTIAL, 311),
    GainBelowZero(LATERAL, 312),
    GainBelowZero(RADIAL, 313),
    AxisSquare(CIRCUMFERENTIAL, 314),
    AxisSquare(LATERAL, 315),
    AxisCube(CIRCUMFERENTIAL, 316),
    AxisCube(LATERAL, 317),
    # In the other planes a share of an axis is a tilt.
    CrossAxis(RADIAL, 318, CIRCUMFERENTIAL),
)
