"""Response of the sensing element: gain, its drift with temperature, nonlinearity, hysteresis and zero-g offset."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from gateway.core.constants import AXIS_NAMES, STANDARD_GRAVITY_MPS2
from gateway.core.types import FloatArray
from gateway.diagnosis.effects.effect import (
    CIRCUMFERENTIAL,
    LATERAL,
    RADIAL,
    Confounder,
    GroupConditions,
    LinearSignalEffect,
    ModelledBlock,
    Parameter,
    SignalEffect,
    Stage,
)

# Smallest range of temperatures that shows a drift.
_MIN_TEMPERATURE_RANGE_K: Final = 2.0
# R omega^2 of a car tire at 65 km/h, a typical operating point, at which nonlinearity is displayed.
_DISPLAY_LEVEL_MPS2: Final = 1000.0
# Data sheets of high-g elements allow 0.5 to 2 % of full scale. 3 % of the reading at 2000 m/s^2 (200 g) by either term
# exceeds any product; two larger terms of opposite sign would imitate any gain at one speed.
_MAX_NONLINEARITY: Final = 0.03
_NONLINEARITY_LEVEL_MPS2: Final = 2000.0


class Gain(LinearSignalEffect):
    """Relative gain error of the radial axis."""

    name = "gain"
    rank = 300
    summary = "The radial axis reads too much in proportion to the true acceleration, gravity included."
    equation = "adds error times the radial acceleration to the radial axis"
    source = "definition of sensitivity error"
    # Data sheets of high-g elements allow 5 to 15 % over lots and life.
    parameters = (Parameter("error", "", -0.2, 0.2, 0.05, 1e-4, factor=100.0, display_unit="%"),)
    axes = (RADIAL,)
    observed_in = (
        "radial axis, any speed and load: a closed belt's mean is R omega^2; needs a DC-coupled sensor or a contact"
    )
    confounders: tuple[Confounder, ...] = (
        Confounder(
            ("rolling radius", "sample clock error"),
            "they leave gravity (order 1 at low speed) unchanged and scale the circumferential axis too",
        ),
        Confounder(("mounting offset",), "the circumferential axis, or several loads"),
        Confounder(("zero-g offset",), "two speeds"),
    )
    start_values = ((0.01,),)
    stage = Stage.ELEMENT

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the axis."""
        (axis,) = self.axes
        change = block.zeros()
        change[axis] = block.signal_mps2[axis]
        return change[None]


class CircumferentialGain(Gain):
    """Relative gain error of the circumferential axis."""

    name = "circumferential gain"
    rank = 305
    summary = "The circumferential axis reads too much in proportion to the true acceleration, gravity included."
    equation = "adds error times the circumferential acceleration to the circumferential axis"
    axes = (CIRCUMFERENTIAL,)
    observed_in = (
        "circumferential axis: gravity, order 1 of g at every speed, and e/R ds/dtheta below the neutral layer"
    )
    confounders = (
        Confounder(("mounting offset",), "gravity, which it leaves unchanged: a slow recording; or the radial axis"),
        Confounder(("shear flexibility",), "gravity, which it leaves unchanged"),
    )


class GainTemperature(SignalEffect):
    """Relative change of the radial gain per kelvin, from the temperature at which the sensor was calibrated."""

    name = "gain-temperature drift"
    rank = 310
    summary = "The gain of the radial axis changes with temperature."
    equation = "adds drift (T - calibrated) times the radial acceleration, T the temperature"
    source = "definition of the temperature coefficient of sensitivity"
    parameters = (
        # Capacitive elements 0.01 to 0.05 %/K, piezoelectric and piezoresistive ones uncompensated 0.1 to 0.3 %/K.
        Parameter("drift_per_k", "1/K", -5e-3, 5e-3, 1e-3, 1e-6, factor=100.0, display_unit="%/K"),
        # Data sheets state the gain at 20 to 25 degC; calibration in a laboratory is not far from it.
        Parameter("calibrated_degc", "degC", 10.0, 40.0, 5.0, 1e-3, prior_mean=25.0),
    )
    axes = (RADIAL,)
    observed_in = "radial axis at two temperatures or more, ten kelvin apart or more"
    confounders = (
        Confounder(("gain",), "recordings at several temperatures"),
        Confounder(
            ("inflation pressure, which rises with temperature",),
            "pressure changes the shape of the waveform, gain does not",
        ),
    )
    start_values = ((3e-4, 25.0),)
    stage = Stage.ELEMENT

    def starts(self, conditions: Sequence[GroupConditions]) -> tuple[tuple[float, ...], ...]:
        """Return the start values; none where everything was recorded at one temperature."""
        degc = [c.temperature_degc for c in conditions]
        return self.start_values if degc and max(degc) - min(degc) >= _MIN_TEMPERATURE_RANGE_K else ()

    def contribution(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the share of the radial axis at the block's temperature."""
        change: FloatArray = float(parameters[0]) * self.derivative(block, parameters)[0]
        return change

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the derivatives by the drift and by the temperature of calibration."""
        drift, calibration_degc = float(parameters[0]), float(parameters[1])
        change = np.zeros((2, *block.signal_mps2.shape))
        change[0, RADIAL] = (block.conditions.temperature_degc - calibration_degc) * block.signal_mps2[RADIAL]
        change[1, RADIAL] = -drift * block.signal_mps2[RADIAL]
        return change


def _term(name: str, unit: str, power: int) -> Parameter:
    limit = _MAX_NONLINEARITY / _NONLINEARITY_LEVEL_MPS2**power
    return Parameter(
        name,
        unit,
        low=-limit,
        high=limit,
        prior_std=0.4 * limit,
        step=1e-3 * limit,
        factor=100.0 * _DISPLAY_LEVEL_MPS2**power,
        display_unit=f"% at {_DISPLAY_LEVEL_MPS2:.0f} m/s^2",
        # Symmetric elements have a cube alone, most others a square alone.
        other_stds=(0.0,),
    )


class SensorNonlinearity(LinearSignalEffect):
    """Quadratic and cubic error of the radial axis."""

    name = "sensor nonlinearity"
    rank = 320
    summary = "The sensitivity of the radial axis changes with the acceleration itself."
    equation = "adds square * a^2 + cube * a^3 to the radial axis, a its acceleration"
    source = "second- and third-order expansion of the response"
    parameters = (_term("square_s2pm", "s^2/m", 1), _term("cube_s4pm2", "s^4/m^2", 2))
    axes = (RADIAL,)
    observed_in = (
        "radial axis: free arc, overshoot and contact by different shares; two speeds: the square is a gain that grows "
        "with omega^2, the cube one with omega^4; needs a DC-coupled sensor"
    )
    confounders = (
        Confounder(("gain", "rolling radius", "run-out"), "they scale overshoot and free arc alike, and all speeds"),
        Confounder(("clipping",), "it leaves everything below its limit unchanged"),
        Confounder(("belt extension",), "overshoot and contact; order 0 of both grows with omega^4"),
    )
    # Half a percent at the limit's level, by either term.
    start_values = (tuple(0.005 / _NONLINEARITY_LEVEL_MPS2**power for power in (1, 2)),)
    stage = Stage.ELEMENT

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the square and the cube of the radial axis."""
        radial = block.signal_mps2[RADIAL]
        change = np.zeros((2, *block.signal_mps2.shape))
        change[0, RADIAL] = radial * radial
        change[1, RADIAL] = radial * change[0, RADIAL]
        return change


def _offset(axis: str) -> Parameter:
    # Elements for 200 to 2000 g: 1 to 2 g as a rule, 1 % of full scale at worst. Where it was zeroed at rest, some
    # 30 mg are left: the drift with temperature and time. Or the axis has none.
    return Parameter(
        f"{axis}_mps2",
        "m/s^2",
        -300.0,
        300.0,
        20.0,
        0.01,
        factor=1.0 / STANDARD_GRAVITY_MPS2,
        display_unit="g",
        other_stds=(0.0, 0.3),
    )


class ZeroGOffset(LinearSignalEffect):
    """Constant added to each axis."""

    name = "zero-g offset"
    rank = 330
    summary = "The sensor adds a constant to each axis, independent of speed."
    equation = "adds a constant to each axis"
    source = "definition of zero-g offset"
    parameters = (_offset("circumferential"), _offset("lateral"), _offset("radial"))
    axes = (CIRCUMFERENTIAL, LATERAL, RADIAL)
    observed_in = "order 0 of a DC-coupled sensor; the radial axis needs two speeds"
    confounders = (
        Confounder(("gain", "rolling radius"), "on the radial axis they grow with the square of speed"),
        Confounder(("roll tilt",), "on the lateral axis it grows with the square of speed"),
        Confounder(("pitch tilt",), "on the circumferential axis it grows with the square of speed"),
        Confounder(("camber",), "the sensor at rest with the axle level; both are constants of the lateral axis"),
    )
    start_values = ((5.0, 5.0, 5.0),)
    stage = Stage.ELEMENT

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return ones, each on its axis; an AC-coupled sensor does not pass them."""
        change = np.zeros((3, *block.signal_mps2.shape))
        if not block.conditions.ac_coupled:
            change[[0, 1, 2], [0, 1, 2]] = 1.0
            if block.conditions.reverse:
                # The data's circumferential axis points against the sensor's own.
                change[CIRCUMFERENTIAL, CIRCUMFERENTIAL] = -1.0
        return change


class Hysteresis(SignalEffect):
    """Play of one axis: it follows the acceleration only once that has moved by the half width."""

    source = "play operator (Prandtl): dry friction in the element or its suspension"
    # Data sheets allow 0.1 to 1 % of full scale: 2 to 50 m/s^2 of elements for 200 to 500 g.
    parameters = (Parameter("half_width_mps2", "m/s^2", 0.0, 100.0, 5.0, 1e-6, other_stds=(0.5,)),)
    start_values = ((2.0,),)
    stage = Stage.ELEMENT
    scaling = "the same at every speed, load and pressure"
    # Any small lag lowers what rises and raises what falls; only at other speeds it is not of the same size.
    needs_other_conditions = True

    def __init__(self, axis: int, rank: int) -> None:
        """Take the axis and the place in the catalogue."""
        self.axis, self.rank = axis, rank
        self.axes = (axis,)
        name = AXIS_NAMES[axis]
        self.name = f"{name} hysteresis"
        self.summary = f"The {name} axis lags behind by a constant: it reads less while it rises, more while it falls."
        self.equation = f"{name} reads r, |a - r| <= h, and r stands still while it can"
        self.observed_in = f"{name} axis: minus h while it rises, plus h while it falls, at every speed alike"
        delay = (f"{name} delay",) if axis != RADIAL else ("structural damping", "tread damping (shifted pressure)")
        self.confounders = (
            Confounder(delay, "its change is in proportion to the slope of the signal, and grows with speed"),
            Confounder(("zero-g offset",), "it does not change sign where the signal turns"),
        )

    def contribution(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return what is read less the signal."""
        change = block.zeros()
        half_width = float(parameters[0])
        if half_width:
            change[self.axis] = math.copysign(1.0, half_width) * self._play(block, abs(half_width))[0]
        return change

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the derivative by the half width."""
        change = block.zeros()
        change[self.axis] = self._play(block, abs(float(parameters[0])))[1]
        return change[np.newaxis]

    def _play(self, block: ModelledBlock, half_width: float) -> tuple[FloatArray, FloatArray]:
        """Return what play adds to a signal that repeats, and its derivative, (FIELD_SIZE,) each."""
        signal = block.signal_mps2[self.axis]
        reading, slope = float(signal[0]), 0.0
        readings, slopes = np.empty_like(signal), np.empty_like(signal)
        # The first turn forgets where it began.
        for _ in range(2):
            for index, value in enumerate(signal.tolist()):
                if reading <= value - half_width:
                    reading, slope = value - half_width, -1.0
                elif reading >= value + half_width:
                    reading, slope = value + half_width, 1.0
                readings[index], slopes[index] = reading, slope
        return readings - signal, slopes


CIRCUMFERENTIAL_HYSTERESIS: Final = Hysteresis(CIRCUMFERENTIAL, 322)
LATERAL_HYSTERESIS: Final = Hysteresis(LATERAL, 324)
RADIAL_HYSTERESIS: Final = Hysteresis(RADIAL, 326)
EFFECTS: Final = (
    Gain(),
    CircumferentialGain(),
    GainTemperature(),
    SensorNonlinearity(),
    CIRCUMFERENTIAL_HYSTERESIS,
    LATERAL_HYSTERESIS,
    RADIAL_HYSTERESIS,
    ZeroGOffset(),
)
