"""Every quantity that the estimators give: name, description, what it rests on, and the values that it can have.

One declaration a quantity. Tables, schemas, units and the rules of doubt are derived from it. It stands apart from the
estimators, since recordings, tables and `--help` need it without the numerical libraries. Signs follow ISO 8855: x
forward, y to the left, z up; angles of the contact count from its centre, positive behind it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import lru_cache
from math import inf
from typing import Final

from gateway.constants import RING_NUMBERS, RING_RATIOS, STANDARD_GRAVITY_MPS2, TIRE_DEGC


class Basis(StrEnum):
    """What an estimate rests on."""

    # Statements that may be wrong: that an axis is the lateral one, or the one along the belt, and in time.
    AXES = "axes"
    ALONG = "along"
    COUPLING = "coupling"
    GAIN = "gain"
    HUB = "hub"
    OFFSET = "offset"
    RADIUS = "radius"
    RATE = "rate"
    ZERO = "zero"
    # Measurements.
    PRESSURE = "pressure"
    SAMPLES = "samples"  # more than the times of the contacts
    WAVEFORM = "waveform"  # what repeats with the wheel's angle, and so contains known effects


@dataclass(frozen=True, slots=True)
class Quantity:
    """A quantity that an estimator gives.

    Attributes:
        name: with its unit where it has one, as in `Estimate`.
        description: noun phrase, in one line.
        powers: exponents in the ratios (true over stated) of belt radius, sampling rate and gain, and of the share of
            the true signal in its axis.
        rests_on: what else it needs; what changes it in a way that no power describes.
        possible: least and greatest value that a tire, a sensor or a road can have.
        origin: value at which what the powers scale is zero.
        is_steady: whether it is of the tire or the sensor, so that driving does not change it.
        memory_revolutions: of the running average that it is made of; 0 for none.
    """

    name: str
    description: str
    powers: Mapping[Basis, float] = field(default_factory=dict)
    rests_on: frozenset[Basis] = frozenset()
    possible: tuple[float, float] = (-inf, inf)
    origin: float = 0.0
    is_steady: bool = False
    memory_revolutions: int = 0

    @property
    def is_radius_times_angle(self) -> bool:
        """Whether it is the stated radius times something measured much better."""
        return self.powers.get(Basis.RADIUS) == 1.0 and Basis.COUPLING not in self.rests_on


# Times of contacts need nothing else; a high-pass passes contact edges and what is not locked to the wheel.
_SIGNAL: Final = frozenset({Basis.SAMPLES})
_LOCKED: Final = frozenset({Basis.SAMPLES, Basis.WAVEFORM, Basis.COUPLING})
# A density over frequencies rests on the whole band.
_BAND: Final = frozenset({Basis.SAMPLES, Basis.COUPLING})
_SHAPE: Final = _LOCKED | {Basis.OFFSET, Basis.ZERO, Basis.HUB}
_FORCE: Final = _LOCKED | {Basis.HUB}
_BY_PRESSURE: Final = _LOCKED | {Basis.PRESSURE}
_POSITIVE: Final = (0.0, inf)
# Memories of the running averages of the radial and of the lateral axis.
_AVERAGE: Final = 50
_LATERAL_AVERAGE: Final = 100
# A lateral slope dy/dx with y = a / Omega^2 and x = R theta.
_SLOPE: Final = {Basis.RADIUS: -1.0, Basis.RATE: -2.0, Basis.GAIN: -1.0, Basis.AXES: 1.0}
_LATERAL_SHIFT: Final = {Basis.RATE: -2.0, Basis.GAIN: -1.0, Basis.AXES: 1.0}
# Both are what a steady value of R Omega^2 leaves.
_STEADY_VALUE: Final = {Basis.RADIUS: 1.0, Basis.RATE: 2.0}
# Accelerometers keep their sensitivity within a few percent and their zero within some g over temperature and shocks;
# self-calibration takes ten times as much for another fault.
_GAINS: Final = (0.5, 1.5)
LARGEST_ZERO_MPS2: Final = 6.0 * STANDARD_GRAVITY_MPS2
"""Zero-g offset that no sensor exceeds."""
_ZEROS: Final = (-LARGEST_ZERO_MPS2, LARGEST_ZERO_MPS2)
# A sensor glued by hand is within some degrees.
_TILTS: Final = (-0.35, 0.35)

_ABOUT_NUMBERS: Final = {
    "Bs": "bending stiffness number EI / (R^4 p0)",
    "Cw": "contact width number b / R",
    "Rs": "radial sidewall stiffness number kw / p0",
    "Ts": "tangential sidewall stiffness number kv / p0",
}
_RING: Final = (
    *(
        Quantity(
            name,
            _ABOUT_NUMBERS[name],
            powers={Basis.RADIUS: -2.0},
            rests_on=_SHAPE | {Basis.PRESSURE},
            possible=_POSITIVE,
            is_steady=True,
            memory_revolutions=_AVERAGE,
        )
        for name in RING_NUMBERS
    ),
    *(
        Quantity(
            name,
            "ratio of the numbers, which needs neither load nor pressure",
            rests_on=_SHAPE,
            possible=_POSITIVE,
            is_steady=True,
            memory_revolutions=_AVERAGE,
        )
        for name in RING_RATIOS
    ),
)


def _slope(name: str, description: str, memory_revolutions: int = 0) -> Quantity:
    return Quantity(name, description, powers=_SLOPE, rests_on=_LOCKED, memory_revolutions=memory_revolutions)


def _ply_steer(name: str, description: str) -> Quantity:
    return _slope(name, description, _LATERAL_AVERAGE)


CATALOGUE: Final[dict[str, tuple[Quantity, ...]]] = {
    "kinematic": (
        Quantity("speed_mps", "rolling speed", powers={Basis.RADIUS: 1.0, Basis.RATE: 1.0}, possible=_POSITIVE),
        Quantity("angular_speed_radps", "angular speed", powers={Basis.RATE: 1.0}, possible=_POSITIVE),
        Quantity("rotation_rpm", "revolutions per minute", powers={Basis.RATE: 1.0}, possible=_POSITIVE),
        Quantity("leading_edge_rad", "angle of the leading contact edge, negative", rests_on=_SIGNAL),
        Quantity("trailing_edge_rad", "angle of the trailing contact edge", rests_on=_SIGNAL),
        Quantity(
            "contact_length_m",
            "contact length",
            powers={Basis.RADIUS: 1.0},
            rests_on=_SIGNAL,
            possible=_POSITIVE,
        ),
    ),
    "distance": (
        Quantity(
            "distance_m", "distance rolled since the first revolution", powers={Basis.RADIUS: 1.0}, possible=_POSITIVE
        ),
    ),
    "self-calibration": (
        Quantity(
            "gain",
            "gain of the radial axis, 1 reads true",
            powers=_STEADY_VALUE,
            rests_on=_LOCKED,
            possible=_GAINS,
            is_steady=True,
        ),
        Quantity(
            "zero_g_offset_mps2",
            "zero-g offset of the radial axis",
            powers=_STEADY_VALUE,
            rests_on=_LOCKED,
            possible=_ZEROS,
            is_steady=True,
        ),
        Quantity("gain_per_degc", "temperature coefficient of the gain, 1/K", rests_on=_LOCKED),
        Quantity(
            "roll_tilt_rad",
            "tilt of the sensor about the circumferential axis",
            rests_on=_LOCKED,
            possible=_TILTS,
            is_steady=True,
        ),
        Quantity(
            "pitch_tilt_rad",
            "tilt of the sensor about the lateral axis",
            powers={Basis.ALONG: 1.0},
            rests_on=_LOCKED,
            possible=_TILTS,
            is_steady=True,
        ),
        Quantity(
            "sensor_offset_m",
            "distance of the sensor below the neutral layer of the belt",
            powers={Basis.GAIN: -1.0, Basis.RATE: -2.0, Basis.ALONG: 1.0},
            rests_on=_LOCKED,
            is_steady=True,
        ),
    ),
    "weak-form": _RING,
    "ring-modal": _RING,
    "ring-paper": _RING,
    "forward": (
        *_RING,
        Quantity("half_angle_rad", "contact half angle of the fitted ring", rests_on=_SHAPE, possible=_POSITIVE),
        Quantity(
            "edge_wave_before", "amplitude of the wave packet before the contact over R Omega^2", rests_on=_LOCKED
        ),
        Quantity("edge_wave_after", "amplitude of the wave packet after the contact over R Omega^2", rests_on=_LOCKED),
    ),
    "wear": (
        # A tread does not grow.
        Quantity(
            "wear_mm",
            "loss of ring thickness since the reference",
            rests_on=_BY_PRESSURE,
            possible=_POSITIVE,
            is_steady=True,
        ),
        Quantity("wear_number", "wear over R", rests_on=_BY_PRESSURE, possible=_POSITIVE, is_steady=True),
        Quantity("wear_drift_mm", "change of the wear since its first valid value", rests_on=_BY_PRESSURE),
    ),
    "load": (
        # By the width: Q0 Cw_new / Cw.
        Quantity(
            "load_n",
            "estimated vertical load, the better of the next two",
            powers={Basis.RADIUS: 2.0},
            rests_on=_BY_PRESSURE,
            possible=_POSITIVE,
        ),
        Quantity(
            "load_by_angle_n",
            "vertical load from contact angle and pressure",
            rests_on=_BY_PRESSURE,
            possible=_POSITIVE,
        ),
        Quantity(
            "load_by_width_n",
            "vertical load from Cw of the new tire",
            powers={Basis.RADIUS: 2.0},
            rests_on=_BY_PRESSURE,
            possible=_POSITIVE,
        ),
        Quantity(
            "pressure_number",
            "Q / (2 p0 theta R^2)",
            powers={Basis.RADIUS: -2.0},
            rests_on=_BY_PRESSURE,
            possible=_POSITIVE,
        ),
    ),
    "longitudinal-force": (
        Quantity("longitudinal_force_n", "force of the road on the tire, positive forward", rests_on=_FORCE),
        Quantity("axle_torque_nm", "torque at the axle, positive when it drives", rests_on=_FORCE),
        Quantity("longitudinal_ratio", "longitudinal force over load", rests_on=_FORCE, possible=(-2.0, 2.0)),
        Quantity("rolling_resistance", "coefficient of rolling resistance", rests_on=_FORCE, possible=_POSITIVE),
        Quantity(
            "damping_loss",
            "part of the rolling resistance that the deformation of belt and sidewall loses",
            rests_on=_FORCE,
        ),
    ),
    "ply-steer": (
        _ply_steer("ply_steer_peak_rad", "steepest slope of the lateral shape of the belt in the contact"),
        _ply_steer("ply_steer_first_half_rad", "mean slope from the leading edge to the middle of the contact"),
        _ply_steer("ply_steer_adhesion_line_rad", "slope of a line through the part of the contact that adheres"),
        _ply_steer("ply_steer_contact_line_rad", "slope of a line through the whole contact"),
        _ply_steer("conicity_slope_rad", "half the change of slope from the first to the second half of the contact"),
        Quantity(
            "sensor_roll_rad",
            "roll of the sensor, from the means of two axes",
            powers={Basis.AXES: 1.0},
            rests_on=_LOCKED,
            possible=_TILTS,
        ),
        Quantity(
            "lateral_offset_mps2",
            "constant in the mean of the lateral axis: zero-g offset and camber",
            powers={Basis.GAIN: -1.0, Basis.AXES: 1.0},
            rests_on=_LOCKED,
            possible=_ZEROS,
        ),
        _ply_steer(
            "ply_steer_ahead_rad", "steepest slope of the free belt ahead of the contact, which leans the other way"
        ),
        # Of the stated plies alone.
        Quantity(
            "ply_steer_laminate_rad",
            "slope of a belt of the stated plies that is bent flat, 2 phi_z of Eq. 18",
            powers={Basis.RADIUS: -1.0},
        ),
        Quantity("laminate_b16_n", "B16 of the stated plies"),
        Quantity("laminate_a66_npm", "A66 of the stated plies"),
    ),
    "slip-angle": (
        _slope("slip_apparent_rad", "first-half slope of this revolution less that at zero slip"),
        _slope("slip_angle_rad", "slip angle, with a slip calibration"),
        _slope("slip_angle_mean_rad", "slip angle of the mean of the latest revolutions, with a slip calibration"),
        _slope("slip_direction", "direction of slip, -1, 0 or 1"),
        Quantity(
            "lateral_asymmetry",
            "(max + min) / (max - min) of the lateral waveform",
            powers={Basis.AXES: 1.0},
            rests_on=_LOCKED,
        ),
        Quantity(
            "left_right_asymmetry",
            "sum of the means of the asymmetry at left and right slip",
            powers={Basis.AXES: 1.0},
            rests_on=_LOCKED,
        ),
    ),
    "side-force": (
        Quantity(
            "belt_shift_m",
            "mean lateral displacement of the belt against the wheel, positive to the left",
            powers=_LATERAL_SHIFT,
            rests_on=_LOCKED,
        ),
        Quantity("belt_yaw_rad", "yaw of the belt against the wheel", powers=_SLOPE, rests_on=_LOCKED),
        Quantity(
            "side_force_n",
            "lateral force of the road on the tire, positive to the left",
            powers=_LATERAL_SHIFT,
            rests_on=_BY_PRESSURE,
        ),
        Quantity(
            "aligning_moment_nm",
            "moment of the road about the vertical axis, positive turns the tire to the left",
            powers=_LATERAL_SHIFT,
            rests_on=_BY_PRESSURE,
        ),
    ),
    "friction": (
        Quantity(
            "friction_used",
            "horizontal force of the road over the vertical one",
            rests_on=_BY_PRESSURE,
            possible=(0.0, 2.0),
        ),
        Quantity(
            "sliding_share",
            "share of the contact in which the tread slides, by the brush model",
            rests_on=_BY_PRESSURE,
            possible=(0.0, 1.0),
        ),
    ),
    "asynchronous": (
        Quantity(
            "asynchronous_rms_mps2",
            "root mean square of what is not locked to the wheel, 5 to 800 Hz",
            powers={Basis.GAIN: -1.0},
            rests_on=_SIGNAL,
            possible=_POSITIVE,
        ),
        Quantity(
            "asynchronous_line_hz",
            "frequency of the strongest line",
            powers={Basis.RATE: 1.0},
            rests_on=_SIGNAL,
            possible=_POSITIVE,
        ),
        Quantity(
            "asynchronous_line_rms_mps2",
            "root mean square of the strongest line",
            powers={Basis.GAIN: -1.0},
            rests_on=_SIGNAL,
            possible=_POSITIVE,
        ),
    ),
    "cavity": (
        Quantity(
            "cavity_hz",
            "resonance frequency of the tire cavity",
            powers={Basis.RATE: 1.0},
            rests_on=_SIGNAL,
            possible=_POSITIVE,
        ),
        # The square of the speed of sound is proportional to the absolute temperature, and to gamma / M.
        Quantity(
            "cavity_temperature_degc",
            "temperature of the gas in the tire, if it is air",
            powers={Basis.RATE: 2.0},
            rests_on=_SIGNAL,
            possible=TIRE_DEGC,
            origin=-273.15,
        ),
        Quantity(
            "cavity_gas_ratio",
            "gamma / M of the gas over that of air, at the measured temperature",
            powers={Basis.RATE: 2.0},
            rests_on=_SIGNAL,
            possible=_POSITIVE,
        ),
    ),
    "road": (
        Quantity(
            "road_class",
            "class of the road's roughness after ISO 8608, 1 in the middle of A, 8 in that of H",
            rests_on=_BAND,
        ),
        Quantity(
            "road_roughness_m3",
            "density of the road's height at 0.1 cycles per m",
            powers={Basis.RADIUS: 2.0},
            rests_on=_BAND,
            possible=_POSITIVE,
        ),
    ),
    "water-wedge": (
        Quantity(
            "leading_edge_shift_rad",
            "shift of the leading edge into the contact, against the contacts before",
            rests_on=_SIGNAL,
        ),
        Quantity(
            "trailing_edge_shift_rad",
            "shift of the trailing edge into the contact, against the contacts before",
            rests_on=_SIGNAL,
        ),
        Quantity("water_wedge_rad", "shift of the leading edge less that of the trailing edge", rests_on=_SIGNAL),
    ),
}
"""Quantities of each estimator of this package, in the order of their columns."""

_BY_NAME: Final = {quantity.name: quantity for quantities in CATALOGUE.values() for quantity in quantities}


# Suffix of a name -> unit. Longer suffixes first: `_mps2` must not be read as `_mps`.
_UNITS: Final = {
    "_per_degc": "1/K", "_radps2": "rad/s^2", "_radps": "rad/s", "_mps2": "m/s^2", "_mps": "m/s", "_rpm": "1/min",
    "_degc": "degC", "_rad": "rad", "_npm": "N/m", "_nm": "N m", "_bytes": "B", "_pa": "Pa", "_mm": "mm", "_m3": "m^3",
    "_hz": "Hz", "_ns": "ns", "_n": "N", "_m": "m", "_s": "s", "_v": "V",
}  # fmt: skip


@lru_cache(maxsize=1024)
def unit_of(name: str) -> str:
    """Return the unit in the name of a quantity as ASCII text, `m/s^2`; empty for a pure number."""
    return next((unit for suffix, unit in _UNITS.items() if name.endswith(suffix) and len(name) > len(suffix)), "")


@lru_cache(maxsize=1024)
def quantity_of(name: str) -> Quantity:
    """Return what is declared of an estimate by its name, with or without the prefix of its estimator.

    An estimate that is not declared, such as one of a plug-in, rests on the whole signal.
    """
    plain = name.rpartition(":")[2]
    return _BY_NAME.get(plain) or Quantity(plain, plain, rests_on=_LOCKED)


def rests_on_times_alone(estimator: str) -> bool:
    """Return whether all that an estimator gives follows from the times of contacts, whatever the waveform."""
    quantities = CATALOGUE.get(estimator, ())
    return bool(quantities) and not any(Basis.SAMPLES in quantity.rests_on for quantity in quantities)
