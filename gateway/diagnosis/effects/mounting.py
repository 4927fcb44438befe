"""Sensor mounting: depth, length, yaw, roll and pitch beyond those declared, and its resonance.

A tilt is a rotation of the sensor. In reverse the data's circumferential axis is turned to point along the rotation, so
the sign of yaw and pitch changes.
"""

import math
from collections.abc import Sequence
from typing import ClassVar, Final

import numpy as np

from gateway.core.types import ComplexArray, FloatArray
from gateway.diagnosis.effects.effect import (
    CIRCUMFERENTIAL,
    LATERAL,
    RADIAL,
    Confounder,
    GroupConditions,
    InverseDisplay,
    ModelledBlock,
    Parameter,
    RingEffect,
    SignalEffect,
    Stage,
)
from gateway.diagnosis.effects.periodic_filter import ORDER, filtered, order_hz
from gateway.diagnosis.effects.ring_options import RingOptions

# Rubber's smallest loss factor, with room; a resonance without any would have no finite response.
_LEAST_LOSS: Final = 0.02
# Below, sin(x) / x is 1 - x^2 / 6 to the last digit.
_SMALL_ANGLE_RAD: Final = 1e-4


def _angle(name: str) -> Parameter:
    # A sensor glued by hand sits within 5 deg. Beyond 20 deg the pipeline reports a wrong mounting.
    return Parameter(f"{name}_rad", "rad", -0.35, 0.35, 0.05, 1e-4, factor=math.degrees(1.0), display_unit="deg")


class MountingOffset(RingEffect):
    """Distance of the sensor from the neutral layer, beyond the declared one."""

    name = "mounting offset"
    rank = 120
    summary = "The sensor sits farther below the belt's neutral layer than declared (negative: less far)."
    equation = (
        "e = declared depth + offset: radial V^2 kappa (1 - e kappa), circumferential -(e / R) times the radial's slope"
    )
    source = "kinematics of a point below the neutral layer of an inextensible belt"
    # From the steel belts to a sensor on the liner 3 to 6 mm, in a housing up to 30 mm; declared wrongly or not at all.
    parameters = (Parameter("offset_m", "m", -0.03, 0.04, 0.01, 1e-4, factor=1e3, display_unit="mm"),)
    observed_in = "circumferential axis, at any speed; radial axis alone only with several loads"
    confounders = (
        Confounder(("gain", "rolling radius"), "the circumferential axis, or several loads"),
        Confounder(("circumferential gain",), "it scales gravity too: a slow recording; or the radial axis"),
        Confounder(("shear flexibility",), "it adds to the circumferential axis only"),
    )
    # Deeper and less deep than declared.
    start_values = ((0.004,), (-0.004,))
    needs_exact = False
    option = "sensor_offset_m"

    def expected(self, conditions: Sequence[GroupConditions]) -> bool:
        """Return whether the declared depth is assumed somewhere: sensors on the liner sit some mm below the belts."""
        return any(not condition.offset_known for condition in conditions)


class MeasuredDepth(MountingOffset):
    """Depth of a sensor that no statement gives, against the one that its recordings measured: one for all of them.

    It is no effect but a parameter of the sensor, free in every fit: an effect that the samples contain has pulled what
    they measured.
    """

    name = "measured depth"

    def options(self, options: RingOptions, parameters: FloatArray, conditions: GroupConditions) -> RingOptions:
        """Return the options at the depth; those of a recording with a stated depth stay."""
        return super().options(options, parameters, conditions) if conditions.offset_measured else options


MEASURED_DEPTH: Final = MeasuredDepth()


class SensorLength(SignalEffect):
    """Length of the belt over which a stiff board or housing averages its acceleration."""

    name = "sensor length"
    rank = 265
    summary = "The sensor reads the mean acceleration over a length of the belt, as on a stiff board."
    equation = "order n times sin(x) / x, x = n length / (2 R)"
    source = "mean of a wave over a length"
    # Elements 3 mm, boards 15 to 30 mm, housings with a battery up to 50 mm. A length acts by its square: below some
    # millimetres it is not visible.
    parameters = (Parameter("length_m", "m", 0.0, 0.06, 0.02, 1e-6, factor=1e3, display_unit="mm"),)
    axes = (CIRCUMFERENTIAL, LATERAL, RADIAL)
    observed_in = "contact edges and highest orders of all axes, at every speed alike"
    confounders = (
        Confounder(("anti-alias filter",), "two speeds: the filter goes with frequency, a length with the angle"),
        Confounder(
            ("bending stiffness (Bs)", "shear flexibility"),
            "several loads; a length leaves the waves beside the contact as long as they are",
        ),
    )
    start_values = ((0.015,),)
    stage = Stage.BELT
    scaling = "the same angle at every speed, load and pressure"

    def contribution(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the mean less the signal."""
        x = self._half_waves(block) * float(parameters[0])
        return filtered(block.signal_mps2, (np.sinc(x / math.pi) - 1.0).astype(np.complex128))

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the derivative by the length."""
        rate = self._half_waves(block)
        x = rate * float(parameters[0])
        is_small = np.abs(x) < _SMALL_ANGLE_RAD
        safe = np.where(is_small, 1.0, x)
        slope = np.where(is_small, -x / 3.0, (np.cos(safe) - np.sin(safe) / safe) / safe)
        return filtered(block.signal_mps2, (rate * slope).astype(np.complex128))[np.newaxis]

    @staticmethod
    def _half_waves(block: ModelledBlock) -> FloatArray:
        """Return x of a length of 1 m, for every order."""
        return ORDER.real / (2.0 * block.conditions.radius_m)


class _Tilt(SignalEffect):
    """Rotation of the sensor about one axis, by which another leaks into the third.

    Attributes:
        leaking: axis that leaks.
        into: axis that it leaks into, with a positive sign under a positive angle.
    """

    source = "rotation of the sensor frame"
    # Linear to a percent from here.
    start_values = ((0.02,),)
    stage = Stage.MOUNTING
    leaking: ClassVar[int]
    into: ClassVar[int]

    def contribution(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the change by the rotation."""
        angle = self._sense(block) * float(parameters[0])
        # cos - 1 without cancellation.
        cosine_change, sine = -2.0 * math.sin(0.5 * angle) ** 2, math.sin(angle)
        leaking, target = block.signal_mps2[self.leaking], block.signal_mps2[self.into]
        change = block.zeros()
        change[self.into] = cosine_change * target + sine * leaking
        change[self.leaking] = cosine_change * leaking - sine * target
        return change

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the derivative by the angle."""
        sense = self._sense(block)
        angle = sense * float(parameters[0])
        sine, cosine = math.sin(angle), math.cos(angle)
        leaking, target = block.signal_mps2[self.leaking], block.signal_mps2[self.into]
        change = block.zeros()
        change[self.into] = cosine * leaking - sine * target
        change[self.leaking] = -cosine * target - sine * leaking
        return sense * change[None]

    def _sense(self, block: ModelledBlock) -> float:
        """Return -1 in reverse, where the data's circumferential axis points against the sensor's own."""
        return -1.0 if block.conditions.reverse and CIRCUMFERENTIAL in self.axes else 1.0


class YawTilt(_Tilt):
    """Rotation about the radial axis, the first of the three: circumferential leaks into +lateral."""

    name = "yaw tilt"
    rank = 270
    summary = (
        "The sensor is rotated about the radial axis: the circumferential acceleration leaks into the lateral axis."
    )
    equation = (
        "lateral reads cos(yaw) lateral + sin(yaw) circumferential, circumferential reads cos(yaw) circumferential "
        "- sin(yaw) lateral"
    )
    parameters = (_angle("yaw"),)
    axes = (CIRCUMFERENTIAL, LATERAL)
    observed_in = (
        "lateral axis: a copy of the circumferential one, which is gravity, g sin(theta) at every speed, and, below the"
        " neutral layer, e/R ds/dtheta, which grows with speed squared"
    )
    confounders = (
        Confounder(
            ("ply steer",),
            "its waveform has the shape of ds/dtheta; the share of gravity, order 1 that does not grow with speed, "
            "separates the two: two speeds, the lower the better",
            similarity="0.97",
        ),
    )
    leaking, into = CIRCUMFERENTIAL, LATERAL


class RollTilt(_Tilt):
    """Rotation about the circumferential axis: radial leaks into +lateral."""

    name = "roll tilt"
    rank = 280
    summary = (
        "The sensor is rotated about the circumferential axis: the radial acceleration leaks into the lateral axis."
    )
    equation = "lateral reads cos(roll) lateral + sin(roll) radial, radial reads cos(roll) radial - sin(roll) lateral"
    parameters = (_angle("roll"),)
    axes = (LATERAL, RADIAL)
    observed_in = "lateral axis: a copy of the radial waveform, in proportion to it at every speed and load"
    confounders = (
        Confounder(("zero-g offset",), "on the lateral axis it is order 0 alone and does not grow with speed"),
        Confounder(("ply steer", "conicity"), "their waveforms are confined to the contact"),
    )
    leaking, into = RADIAL, LATERAL


class PitchTilt(_Tilt):
    """Rotation about the lateral axis: radial leaks into +circumferential."""

    name = "pitch tilt"
    rank = 290
    summary = (
        "The sensor is rotated about the lateral axis: the radial acceleration leaks into the circumferential axis."
    )
    equation = (
        "circumferential reads cos(pitch) circumferential + sin(pitch) radial, radial reads cos(pitch) radial "
        "- sin(pitch) circumferential"
    )
    parameters = (_angle("pitch"),)
    axes = (CIRCUMFERENTIAL, RADIAL)
    observed_in = "circumferential axis: a copy of the radial waveform, in proportion to it at every speed and load"
    confounders = (
        Confounder(("zero-g offset",), "on the circumferential axis it is order 0 alone and does not grow with speed"),
        Confounder(("mounting offset",), "its leak is the slope of the radial waveform, not the waveform"),
    )
    leaking, into = RADIAL, CIRCUMFERENTIAL


def _inverse_square(resonance_hz: float) -> float:
    """Return 1 / (2 pi resonance)^2, s^2."""
    return (2.0 * math.pi * resonance_hz) ** -2


class MountingResonance(SignalEffect):
    """Resonance of the sensor's mass on its bond; its first parameter is mass over stiffness, 0 for a firm bond.

    The bond is a spring with a loss factor eta. A thin layer is stiffer across than along: the resonance of the axes
    along the inner liner, circumferential and lateral, is lower than the radial one by the factor of the second
    parameter, 1 for a sensor that hangs loose.
    """

    name = "mounting resonance"
    rank = 295
    summary = "The sensor rides on a soft or loose bond: its mass and the bond's stiffness resonate."
    equation = (
        "order n times (1 + i eta) / (1 + i eta - x), x = (n omega / (2 pi resonance))^2, along the inner liner times "
        "the ratio of the resonances"
    )
    source = "transmissibility of a mass on a spring with a loss factor"
    # A gram on a rubber patch: 1 kHz when it comes loose, 10 kHz when it is firm. Loss factors of rubber: 0.05 to 0.5.
    parameters = (
        Parameter(
            "inverse_resonance_s2",
            "s^2",
            -1e-10,
            _inverse_square(400.0),
            _inverse_square(600.0),
            1e-11,
            factor=1e6,
            display_unit="ms^2",
            inverse_display=InverseDisplay(0.5 / math.pi, "Hz", power=2.0),
            other_stds=(_inverse_square(2000.0),),
        ),
        # From a block as high as wide to a thin layer.
        Parameter("radial_over_tangential", "", 0.3, 5.0, 0.5, 1e-3, prior_mean=1.0),
        Parameter("loss_factor", "", 0.0, 1.0, 0.15, 1e-3, prior_mean=0.1),
    )
    axes = (CIRCUMFERENTIAL, LATERAL, RADIAL)
    observed_in = "contact edges, all axes, with the square of the speed; ringing behind them where it is in the band"
    confounders = (
        Confounder(("anti-alias filter",), "it attenuates high orders, a resonance amplifies them"),
        Confounder(
            ("bending stiffness (Bs)", "shear flexibility", "rotary inertia"),
            "two speeds: they go with the angle, the resonance with frequency",
        ),
    )
    start_values = tuple((_inverse_square(hz), 1.0, 0.1) for hz in (3000.0, 1800.0, 1200.0, 800.0))
    stage = Stage.MOUNTING

    def contribution(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return what the resonance adds."""
        changes = [change for change, _, _ in self._gains(block, parameters)]
        return np.stack([filtered(row, change) for row, change in zip(block.signal_mps2, changes, strict=True)])

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the derivatives by mass over stiffness, the ratio and the loss factor."""
        radial, ratio = float(parameters[0]), float(parameters[1])
        rows = np.zeros((3, *block.signal_mps2.shape))
        for axis, (_, by_square, by_loss) in enumerate(self._gains(block, parameters)):
            row = block.signal_mps2[axis]
            slope = filtered(row, by_square)
            rows[0, axis] = slope * (1.0 if axis == RADIAL else ratio**2)
            rows[1, axis] = slope * (0.0 if axis == RADIAL else 2.0 * ratio * radial)
            rows[2, axis] = filtered(row, by_loss)
        return rows

    @staticmethod
    def _gains(block: ModelledBlock, parameters: FloatArray) -> list[tuple[ComplexArray, ComplexArray, ComplexArray]]:
        """Return the change of each axis' gain, and its derivatives by mass over stiffness and the loss factor."""
        radial, ratio, loss = parameters.tolist()
        omega_square = np.square(2.0 * math.pi * order_hz(block.conditions))
        tangential = _resonant(omega_square, ratio**2 * radial, loss)
        return [tangential, tangential, _resonant(omega_square, radial, loss)]


def _resonant(
    omega_square: ComplexArray, mass_over_stiffness_s2: float, loss: float
) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Return the change of the gain by a resonance, and its derivatives by mass over stiffness and the loss factor."""
    lossy = 1.0 + 1j * max(loss, _LEAST_LOSS)
    x = omega_square * mass_over_stiffness_s2
    denominator = lossy - x
    by_loss = -1j * x / denominator**2 if loss > _LEAST_LOSS else 0.0 * x
    return x / denominator, omega_square * lossy / denominator**2, by_loss


SENSOR_LENGTH: Final = SensorLength()
EFFECTS: Final = (MountingOffset(), SENSOR_LENGTH, YawTilt(), RollTilt(), PitchTilt(), MountingResonance())
