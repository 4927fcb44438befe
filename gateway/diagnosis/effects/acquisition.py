"""Signal acquisition behind the sensing element: clipping, anti-alias filter, AC coupling, delays, sample clock."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.special import ndtr

from gateway.core.constants import AXIS_NAMES, STANDARD_GRAVITY_MPS2
from gateway.core.types import ComplexArray, FloatArray
from gateway.diagnosis.effects.belt_geometry import belt_inertia
from gateway.diagnosis.effects.effect import (
    CIRCUMFERENTIAL,
    LATERAL,
    RADIAL,
    Confounder,
    GroupConditions,
    InverseDisplay,
    ModelledBlock,
    Parameter,
    SignalEffect,
    Stage,
)
from gateway.diagnosis.effects.periodic_filter import ORDER, AxisAhead, filtered, from_fine_grid, on_fine_grid, order_hz

_ROOT_2PI: Final = math.sqrt(2.0 * math.pi)
# Least width of a knee over the limit, so that the ends of the clipped part stay differentiable.
_MIN_KNEE: Final = 1e-4
# Clipping levels that a fit starts from, over R omega^2 of the fastest group: below the free arc to the tip of the
# overshoot.
_CLIPPING_LEVELS: Final = (0.6, 0.9, 1.1, 1.2, 1.3, 1.4)
_START_KNEE: Final = 0.01
# Ends of p within which a low-pass has a corner at half its power, 1 -+ sqrt(2), with room.
_MIN_SECOND_POLE: Final = -0.4
_MAX_SECOND_POLE: Final = 2.4


class ClockError(SignalEffect):
    """Relative amount by which the sampling clock runs fast against true time.

    A fast clock counts more time for a revolution, so omega as measured is too small by (1 + share), and domega/dt by
    its square. The waveforms do not separate this from a wrong rolling radius; `Campaign.clock_error`, the clock
    against the host's, does.
    """

    name = "sample clock error"
    rank = 240
    summary = "The clock that timed the samples runs fast, so the wheel turns faster than measured."
    equation = "adds ((1 + share)^2 - 1) (a - gravity): the true omega is (1 + share) times the measured one"
    source = "kinematics: inertia grows with omega^2, gravity does not"
    # Crystals 1e-4, ceramic resonators 5e-3, a sensor's own unmeasured oscillator or a wrongly noted rate 2 %.
    parameters = (Parameter("share", "", -0.06, 0.06, 0.02, 1e-5, factor=1e6, display_unit="ppm"),)
    axes = (CIRCUMFERENTIAL, RADIAL)
    observed_in = (
        "the hub's clock against the host's; radial axis at any speed, where it is the same as the rolling radius"
    )
    confounders = (
        Confounder(("rolling radius",), "a second clock or the stated speed; every waveform is the same"),
        Confounder(("gain",), "it scales gravity too: slow recordings"),
    )
    # Linear up to a thousand ppm.
    start_values = ((1e-3,),)
    stage = Stage.BELT

    def contribution(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return what the true speed adds."""
        share = float(parameters[0])
        return (share * (2.0 + share)) * belt_inertia(block)

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the derivative by the share."""
        return 2.0 * (1.0 + float(parameters[0])) * belt_inertia(block)[None]


class Clipping(SignalEffect):
    """Limit of the radial axis that is the same at all speeds.

    The mean of many revolutions is not cut off sharply: noise, the range of speeds within a group and jitter of the
    contact spread the signal about its mean. With a normal spread of standard deviation knee * limit the mean of the
    clipped signal is a - [w phi(z) + (a - limit) Phi(z)], w = knee * limit, z = (a - limit) / w; the same below
    -limit.

    A clipped signal has a corner at each steep edge, and orders beyond those of the model's grid. On that grid they
    would fold into the highest orders, by some 1e-3 of what is cut off, which resembles a low-pass: the fine grid has
    them.
    """

    name = "clipping"
    rank = 340
    summary = "The radial axis saturates at a level below its declared range."
    equation = (
        "the radial axis reads no more than the limit, blurred over knee times the limit by the scatter between "
        "revolutions"
    )
    source = "mean of a clipped normal variable"
    # Elements and amplifiers saturate at 10 g and more; a tire needs more. Spread: noise, and a speed that varies by
    # 3 % within a group.
    parameters = (
        Parameter(
            "inverse_limit_s2pm",
            "s^2/m",
            0.0,
            0.01,
            1e-3,
            1e-7,
            inverse_display=InverseDisplay(1.0 / STANDARD_GRAVITY_MPS2, "g"),
        ),
        Parameter("knee", "", -0.1, 0.1, 0.01, 1e-4, prior_mean=0.01, factor=100.0, display_unit="%", varies=True),
    )
    axes = (RADIAL,)
    observed_in = "radial axis, the fastest recordings: overshoot at the contact edges, then the whole free arc"
    confounders = (
        Confounder(("bending stiffness (Bs)", "shear flexibility"), "they round the overshoot at every speed alike"),
        Confounder(("anti-alias filter",), "it rounds rises and falls alike"),
    )
    stage = Stage.ELECTRIC

    def starts(self, conditions: Sequence[GroupConditions]) -> tuple[tuple[float, ...], ...]:
        """Return limits from below the free arc of the fastest group to the tip of its overshoot."""
        steady = max((c.radius_m * c.omega_radps**2 for c in conditions), default=0.0)
        if not steady > 0.0:
            return ()
        return tuple((1.0 / (level * steady), _START_KNEE) for level in _CLIPPING_LEVELS)

    def contribution(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the negative of what exceeds the limit."""
        change = block.zeros()
        inverse = float(parameters[0])
        if inverse > 0.0:
            limit, width = self._limit(parameters)
            radial = on_fine_grid(block.signal_mps2[RADIAL])
            change[RADIAL] = from_fine_grid(_excess(-radial - limit, width) - _excess(radial - limit, width))
        return change

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the derivatives by the inverse limit and by the knee."""
        change = np.zeros((2, *block.signal_mps2.shape))
        inverse, knee = float(parameters[0]), float(parameters[1])
        if inverse > 0.0:
            limit, width = self._limit(parameters)
            radial = on_fine_grid(block.signal_mps2[RADIAL])
            above, below = (radial - limit) / width, (-radial - limit) / width
            by_limit = from_fine_grid(ndtr(above) - ndtr(below))
            by_width = from_fine_grid(_normal_density(below) - _normal_density(above))
            change[0, RADIAL] = -limit * limit * (by_limit + by_width * width / limit)
            if abs(knee) > _MIN_KNEE:
                change[1, RADIAL] = by_width * math.copysign(limit, knee)
        return change

    @staticmethod
    def _limit(parameters: FloatArray) -> tuple[float, float]:
        """Return the limit and the width of its knee, m/s^2."""
        limit = 1.0 / float(parameters[0])
        return limit, max(abs(float(parameters[1])), _MIN_KNEE) * limit


class AntiAliasFilter(SignalEffect):
    """Low-pass of one or two poles on all three axes; its first parameter is 1 / corner, 0 for no filter.

    The corner is where half the power passes. With x = f / corner the gain is 1 / (1 + i d x - p x^2), so that
    d^2 = 1 + 2 p - p^2. p, the second parameter, is 0 for one pole, 1 for Butterworth's two (Q = 0.71), and in between
    two real or nearly real poles; Q = sqrt(p) / d.

    The contact centre is found behind the filter and is as late as the low orders are. The contribution is therefore
    relative to a signal with the same delay, and a corner does not move the centre.
    """

    name = "anti-alias filter"
    rank = 350
    summary = "An undeclared low-pass in front of the converter delays all axes and attenuates their highest orders."
    equation = (
        "order n times exp(i d x) / (1 + i d x - p x^2), x = n omega / (2 pi corner), d^2 = 1 + 2 p - p^2, p = 0 for "
        "one pole and 1 for two of Butterworth; the centre is as late as the filter's delay"
    )
    source = "low-pass of first and second order with its corner at half the power"
    # Bandwidths of inner-liner elements: 400 Hz to 24 kHz; below 150 Hz no contact would be visible.
    parameters = (
        Parameter(
            "inverse_corner_s",
            "s",
            -1e-5,
            1.0 / 150.0,
            1e-3,
            1e-6,
            factor=1e3,
            display_unit="ms",
            inverse_display=InverseDisplay(1.0, "Hz"),
        ),
        # From one pole, with room for its error, to a little beyond Butterworth: only a mounting resonance rings more.
        Parameter("second_pole", "", -0.2, 1.3, 0.4, 1e-4, prior_mean=0.8),
    )
    axes = (CIRCUMFERENTIAL, LATERAL, RADIAL)
    observed_in = "contact edges, all axes, best at high speed; two speeds separate Hz from orders"
    confounders = (
        Confounder(
            ("bending stiffness (Bs)", "shear flexibility", "tread damping (shifted pressure)"),
            "two speeds: they go with the angle, the filter with frequency",
        ),
        Confounder(("contact centre",), "the rounding of the edges; the delay alone looks like another centre"),
        Confounder(("mounting resonance",), "it amplifies high orders, a filter attenuates them"),
        Confounder(("sensor length",), "two speeds: a length goes with the angle, the filter with frequency"),
    )
    # Corners of 1400 and 700 Hz, with two poles and with one. The effect goes with the square or the cube: a linear
    # step from far below would overshoot.
    start_values = ((7e-4, 1.0), (1.5e-3, 1.0), (7e-4, 0.1), (1.5e-3, 0.1))
    stage = Stage.ELECTRIC

    def contribution(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the change by the filter."""
        return filtered(block.signal_mps2, _low_pass(order_hz(block.conditions), parameters)[0] - 1.0)

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the derivatives by the inverse corner and by p."""
        _, by_corner, by_pole = _low_pass(order_hz(block.conditions), parameters)
        return np.stack([filtered(block.signal_mps2, by_corner), filtered(block.signal_mps2, by_pole)])


class AcCoupling(SignalEffect):
    """One-pole high-pass on all three axes; a corner of 0 is a DC-coupled sensor."""

    name = "AC coupling"
    rank = 360
    summary = "A high-pass behind the element: the mean is lost and the plateaus droop."
    equation = "order n times i n omega / (i n omega + 2 pi corner); of order 0 its rate of change times a lag is left"
    source = "one-pole high-pass"
    # Charge amplifiers and coupling capacitors: 0.01 to 10 Hz, beyond that the free arc would droop to nothing.
    # The lag is 1 / (2 pi corner) once the change of speed has lasted for several times that, and less before.
    parameters = (
        Parameter("corner_hz", "Hz", 0.0, 20.0, 2.0, 1e-3),
        Parameter("mean_lag_s", "s", 0.0, 10.0, 2.0, 1e-2, other_stds=(0.0,)),
    )
    axes = (CIRCUMFERENTIAL, LATERAL, RADIAL)
    observed_in = "lowest orders of all axes, best at low speed; the lost mean of a sensor declared as DC-coupled"
    confounders = (
        Confounder(("speed drift",), "its droop follows the sign of the acceleration and grows with speed"),
        Confounder(("zero-g offset",), "it changes the mean alone"),
    )
    start_values = ((0.5, 0.0),)
    stage = Stage.ELECTRIC

    def contribution(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the change by the filter; any corner but 0 removes the mean, also of a sensor declared as DC."""
        corner = float(parameters[0])
        if corner == 0.0:
            return block.zeros()
        decay = self._decay(block) * corner
        change = filtered(block.signal_mps2, -decay / (1j * ORDER + decay))
        return change + float(parameters[1]) * self._rate_of_mean(block)

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the derivatives by the corner, which the mean does not depend on, and by the lag, (2, 3, n)."""
        decay = self._decay(block)
        denominator = 1j * ORDER + decay * float(parameters[0])
        denominator[0] = 1.0
        by_corner = filtered(block.signal_mps2, -decay * 1j * ORDER / denominator**2)
        return np.stack([by_corner, self._rate_of_mean(block)])

    @staticmethod
    def _rate_of_mean(block: ModelledBlock) -> FloatArray:
        """Return d/dt of the means, which grow with omega^2, on the grid, (3, n) m/s^3."""
        conditions = block.conditions
        means = block.signal_mps2.mean(axis=1, keepdims=True)
        return np.broadcast_to(
            2.0 * conditions.omega_dot_radps2 / conditions.omega_radps * means, block.signal_mps2.shape
        )

    @staticmethod
    def _decay(block: ModelledBlock) -> float:
        """Return the droop of a plateau per radian and Hz of corner."""
        return 2.0 * math.pi / block.conditions.omega_radps


class AxisDelay(AxisAhead):
    """Delay of an axis against the radial one, by which the contact's centre is timed."""

    source = "sampling of the axes one after the other"
    # A multiplexer is some microseconds later at each axis; axes of separate converters or filters are up to a sample
    # or two of 1 kHz apart.
    parameters = (Parameter("delay_s", "s", -2e-3, 2e-3, 1e-4, 1e-9, factor=1e6, display_unit="us"),)
    confounders = (
        Confounder(
            ("contact asymmetry", "structural damping", "tread damping (shifted pressure)"),
            "they change the radial axis too; two speeds: the angle of a delay grows with omega",
        ),
        Confounder(("anti-alias filter",), "it delays all axes alike, and rounds the contact edges"),
    )
    start_values = ((5e-5,),)
    stage = Stage.ELECTRIC
    scaling = "the same time at every speed: the angle grows with omega"

    def __init__(self, axis: int, rank: int) -> None:
        """Take the axis and the place in the catalogue."""
        self.axis, self.rank = axis, rank
        self.axes = (axis,)
        name = AXIS_NAMES[axis]
        self.name = f"{name} delay"
        self.summary = f"The {name} axis is read later (or earlier) than the radial one."
        self.equation = f"{name} a(t - delay): order n times exp(-i n omega delay)"
        self.observed_in = f"{name} axis, best at high speed: its contact edges come later than those of the radial one"

    @staticmethod
    def rate(block: ModelledBlock) -> ComplexArray:
        """Return minus i n omega of every order."""
        return -2j * math.pi * order_hz(block.conditions)


def _low_pass(frequency_hz: ComplexArray, parameters: FloatArray) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Return a low-pass's gain without its delay, and its derivatives by the inverse corner and by p."""
    inverse, second = float(parameters[0]), min(max(float(parameters[1]), _MIN_SECOND_POLE), _MAX_SECOND_POLE)
    first = math.sqrt(1.0 + second * (2.0 - second))
    x = frequency_hz * inverse
    denominator = 1.0 + x * (1j * first - second * x)
    gain = np.exp(1j * first * x) / denominator
    by_x = gain * (1j * first - (1j * first - 2.0 * second * x) / denominator)
    phase_slope = 1j * ((1.0 - second) / first) * x
    return gain, frequency_hz * by_x, gain * (phase_slope - (phase_slope - x * x) / denominator)


def _excess(mean: FloatArray, width: float) -> FloatArray:
    """Return the mean of max(x, 0) of a normal x of mean `mean` and standard deviation `width`."""
    z = mean / width
    result: FloatArray = width * _normal_density(z) + mean * ndtr(z)
    return result


def _normal_density(z: FloatArray) -> FloatArray:
    result: FloatArray = np.exp(-0.5 * z * z) / _ROOT_2PI
    return result


CIRCUMFERENTIAL_DELAY: Final = AxisDelay(CIRCUMFERENTIAL, 345)
LATERAL_DELAY: Final = AxisDelay(LATERAL, 347)
EFFECTS: Final = (ClockError(), Clipping(), CIRCUMFERENTIAL_DELAY, LATERAL_DELAY, AntiAliasFilter(), AcCoupling())
