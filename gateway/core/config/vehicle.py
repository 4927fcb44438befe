"""Vehicle configuration: schema with the user's units in the keys, SI properties, and reading from TOML."""

from __future__ import annotations

import logging
import math
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from enum import StrEnum
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import Field, model_validator

from gateway.core.config.cross_checks import cross_faults
from gateway.core.config.si_values import si_values
from gateway.core.config.toml_writer import toml_text
from gateway.core.config.validation import AddedTable, Section, above, add_keys, parse_document, read_text, within
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.errors import ConfigError
from gateway.core.estimates.wheel_setup import (
    AXIS_GAIN_STD,
    GAIN_STD,
    HAND_MOUNTED_STD_M,
    HAND_MOUNTED_STD_RAD,
    LOAD_STD,
    NONLINEARITY_STD,
    PRESSURE_STD,
    RADIUS_STD,
    RATE_STD,
    RUN_OUT_M,
    SOFTENING_PER_K,
    SOFTENING_STD_PER_K,
    ZERO_G_STD_MPS2,
    LoadCalibration,
    ReferenceNumbers,
    SensorClaims,
    TireData,
    WheelSetup,
)
from gateway.core.reasons import CoreCode, Notice, Reason
from gateway.core.shown_units import ShownUnits

_logger = logging.getLogger(__name__)

CLOCK_STD_PERCENT: Final = 100.0 * RATE_STD
"""Standard error of a sampling rate that is measured against a clock, in percent."""
STATED_RATE_STD_PERCENT: Final = 1.0
"""Standard error of a sampling rate that is only stated, in percent: oscillators of sensors have 1 to 3 %."""
ASSUMED_RADIUS_MM: Final = 320.0
# Belts of passenger cars to trucks.
ASSUMED_RADIUS_STD_MM: Final = 80.0
UNKNOWN_WHEEL: Final = WheelSetup("", 0, 0, ASSUMED_RADIUS_MM * 1e-3, radius_std_m=ASSUMED_RADIUS_STD_MM * 1e-3)
"""A wheel that no configuration describes."""
# The rim's diameter in inches at the end of a size: 205/55 R16, 195R14C, 335/65R22.5.
_RIM_INCHES: Final = re.compile(r"R ?(\d{2}(?:\.\d)?)(?!\d)")
_INCH_M: Final = 0.0254
# Inner liner below the neutral layer of the belt. The rim's well and the round shape of the cross-section change the
# mean circumference by some per cent.
_LINER_BELOW_BELT_M: Final = 0.006
_CAVITY_STD: Final = 0.02
# What a depth gauge and grooves that are worn unequally leave open.
_WEAR_STD_MM: Final = 0.2
_TRACK_STD: Final = 0.02  # camber, toe and load move the middles of the contacts
POSITION_PATTERN: Final = r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,23}$"


class Vehicle(Section):
    """`[vehicle]`: the vehicle or test rig."""

    name: str = Field(default="", description="name of the vehicle or test rig")
    units: ShownUnits = Field(
        default=ShownUnits.SI,
        strict=False,
        description="units of the screen, the page and printed summaries: `si` (km/h, kPa, °C, N), `bar` (km/h, bar, "
        "°C, N) or `us` (mph, psi, °F, lbf); files keep theirs",
    )
    assumed: tuple[str, ...] = Field(
        default=(),
        strict=False,
        description="assumptions made instead of measurements, one text each; shown as notices",
    )


class TestRun(Section):
    """`[test]`: what the recordings are made of; the options of `record` and `live` replace it."""

    __test__ = False  # no test of pytest

    name: str | None = Field(default=None, max_length=2000, description="name of the test")
    driver: str | None = Field(default=None, max_length=2000, description="who drives")
    comment: str | None = Field(default=None, max_length=2000, description="comment on the run")
    tags: tuple[str, ...] | None = Field(default=None, strict=False, description="words to select recordings by")


class Reference(Section):
    """`[tire.reference]`: the four dimensionless numbers of the new tire, as written by `treadlink calibrate`."""

    Bs: float | None = above(None, 0, 1000, "bending stiffness number, dimensionless")
    Cw: float | None = above(None, 0, 1000, "contact width number, dimensionless")
    Rs: float | None = above(None, 0, 1000, "radial stiffness number, dimensionless")
    Ts: float | None = above(None, 0, 1000, "tangential stiffness number, dimensionless")
    Bs_std: float | None = within(None, 0, 1000, "standard error of Bs")
    Cw_std: float | None = within(None, 0, 1000, "standard error of Cw")
    Rs_std: float | None = within(None, 0, 1000, "standard error of Rs")
    Ts_std: float | None = within(None, 0, 1000, "standard error of Ts")
    pressure_kpa: float | None = within(None, 10, 1500, "gauge pressure of the measurement in kPa; default: the tire's")
    temperature_degc: float | None = within(
        None, -60, 200, "inner-liner temperature of the measurement in degrees Celsius; default: not known"
    )
    estimator: str | None = Field(default=None, description="estimator that measured the numbers; default: weak-form")
    softening_percent_per_k: float | None = within(
        None,
        -1,
        5,
        f"loss of the ring's bending stiffness per kelvin in percent; default: {100.0 * SOFTENING_PER_K:g}, assumed",
    )
    softening_std_percent_per_k: float | None = within(
        None,
        0,
        5,
        f"standard error of softening_percent_per_k in percent per kelvin; default: {100.0 * SOFTENING_STD_PER_K:g}",
    )

    def numbers(self, stated_pressure_pa: float | None) -> ReferenceNumbers:
        """Return the numbers in SI, at the tire's stated pressure where the table has none."""
        values = {name: value for name, value in si_values(self).items() if value is not None}
        return ReferenceNumbers(**{"pressure_pa": stated_pressure_pa, **values})


class LoadCalibrationTable(Section):
    """`[tire.load_calibration]`: load from contact half angle and pressure, as written by `treadlink calibrate`."""

    load_n: float = Field(ge=50, le=100_000, description="load at the reference half angle and pressure in N")
    half_angle_rad: float = Field(ge=0.01, le=1.5, description="reference contact half angle in rad")
    pressure_kpa: float = Field(ge=10, le=1500, description="reference gauge pressure in kPa")
    angle_exponent: float = Field(ge=0.1, le=5, description="exponent of the half angle")
    angle_curvature: float = within(0.0, -2, 2, "coefficient of the squared logarithm of the half angle")
    pressure_exponent: float = Field(ge=-2, le=3, description="exponent of the pressure")
    relative_std_percent: float = Field(ge=0, le=100, description="standard error of a calculated load in percent")
    half_angle_min_rad: float = Field(ge=0.01, le=1.5, description="smallest calibrated half angle in rad")
    half_angle_max_rad: float = Field(ge=0.01, le=1.5, description="largest calibrated half angle in rad")
    pressure_min_kpa: float = Field(ge=10, le=1500, description="lowest calibrated gauge pressure in kPa")
    pressure_max_kpa: float = Field(ge=10, le=1500, description="highest calibrated gauge pressure in kPa")
    temperature_degc: float | None = within(
        None,
        -60,
        200,
        "inner-liner temperature of the calibration in degrees Celsius; default: that of [tire.reference]",
    )

    def calibration(self) -> LoadCalibration:
        """Return the calibration in SI."""
        return LoadCalibration(**si_values(self))


class Tire(Section):
    """`[tire]`: the tire of every wheel; `[wheel.tire]`: the deviations of one wheel from it."""

    size: str | None = Field(default=None, description="tire size, such as 205/55 R16; of use is only the rim")
    maker: str | None = Field(default=None, max_length=2000, description="maker and model of the tire")
    dot: str | None = Field(default=None, max_length=2000, description="DOT code of the tire, or its date")
    run_in_km: float | None = within(None, 0, 1e6, "distance the tire has run before in km")
    radius_mm: float | None = within(None, 100, 1200, "belt radius in mm: rolling circumference / (2 pi)")
    radius_std_mm: float | None = within(None, 0, 200, "standard error of radius_mm in mm; default: 1 % of the radius")
    pressure_kpa: float | None = within(None, 10, 1500, "gauge pressure in kPa")
    pressure_std_kpa: float | None = within(
        None, 0, 500, "standard error of the pressure, stated or measured, in kPa; default: 5 % of it"
    )
    temperature_degc: float | None = within(None, -60, 250, "temperature of the inner liner in degrees Celsius")
    ring_thickness_mm: float | None = within(None, 1, 80, "thickness of belt and tread of the new tire in mm")
    ring_thickness_std_mm: float | None = within(None, 0, 40, "standard error of ring_thickness_mm in mm")
    wear_mm: float | None = within(None, 0, 60, "tread worn off since the tire was new in mm, as measured")
    wear_std_mm: float | None = within(None, 0, 20, f"standard error of wear_mm in mm; default: {_WEAR_STD_MM:g}")
    contact_half_angle_deg: float | None = within(
        None,
        1,
        60,
        "half of the angle between the contact edges in degrees, as known from elsewhere; ring-paper uses "
        "it in place of the measured edges",
    )
    contact_half_angle_std_deg: float = within(0.5, 0, 30, "standard error of contact_half_angle_deg in degrees")
    linear_ring: bool = Field(
        default=False,
        description="the signal was computed by Eq. 27 of the ring paper as printed: its order 1 is more than gravity, "
        "and ring-paper has no model error",
    )
    ply_steer: Literal["peak", "first_half", "adhesion_line", "contact_line"] | None = Field(
        default=None,
        description="definition of the ply steer angle that is listed first; adhesion_line is that of the ply steer "
        "paper, the slope behind the leading edge without slip",
    )
    cavity_length_mm: float | None = within(
        None, 500, 5000, "mean circumference of the air in the tire in mm; default: from the belt and the rim of size"
    )
    cavity_length_std_mm: float | None = within(None, 0, 500, "standard error of cavity_length_mm in mm; default: 2 %")
    runout_mm: float | None = within(
        None, 0, 5, f"radial run-out: height of the high spot in mm; default: {1e3 * RUN_OUT_M:g}"
    )
    reference: Reference = Field(default=Reference(), description="dimensionless numbers of the new tire")
    load_calibration: LoadCalibrationTable | None = Field(
        default=None, description="load from contact half angle and pressure"
    )

    def overridden_by(self, other: Tire) -> Tire:
        """Return this tire with the values that `other` states instead of its own.

        A value is replaced with its error: one that is stated without has the default. The error of a pressure is that
        of the gauge, stated or measured, and remains.
        """
        reference = _replaced(self.reference, other.reference)
        fields = _replaced(self, other, retained=("pressure_std_kpa",))
        return Tire(**{**fields, "reference": Reference(**reference)})

    @property
    def radius_m(self) -> float | None:
        """Belt radius in m."""
        return None if self.radius_mm is None else self.radius_mm * 1e-3

    @property
    def radius_std_m(self) -> float:
        """Standard error of the belt radius in m; 0 without a radius."""
        if self.radius_std_mm is not None:
            return self.radius_std_mm * 1e-3
        return RADIUS_STD * (self.radius_m or 0.0)

    @property
    def pressure_pa(self) -> float | None:
        """Stated gauge pressure in Pa."""
        return None if self.pressure_kpa is None else self.pressure_kpa * 1e3

    @property
    def pressure_std_pa(self) -> float:
        """Standard error of the pressure in Pa as stated; 0 where it is not, and `pressure_relative_std` counts."""
        return (self.pressure_std_kpa or 0.0) * 1e3

    @property
    def pressure_relative_std(self) -> float:
        """Standard error of the pressure over its value where none is stated, else 0."""
        return PRESSURE_STD if self.pressure_std_kpa is None else 0.0

    @property
    def ring_thickness_m(self) -> float | None:
        """Thickness of the new ring in m."""
        return None if self.ring_thickness_mm is None else self.ring_thickness_mm * 1e-3

    @property
    def cavity_length_m(self) -> float | None:
        """Mean circumference of the air in the tire in m: as stated, else halfway from the rim to the inner liner."""
        if self.cavity_length_mm is not None:
            return self.cavity_length_mm * 1e-3
        rim = _RIM_INCHES.search(self.size or "")
        if rim is None or self.radius_m is None:
            return None
        return math.pi * (self.radius_m - _LINER_BELOW_BELT_M + 0.5 * float(rim[1]) * _INCH_M)

    @property
    def cavity_length_std_m(self) -> float:
        """Standard error of that circumference in m; 0 without one."""
        if self.cavity_length_std_mm is not None:
            return self.cavity_length_std_mm * 1e-3
        return _CAVITY_STD * (self.cavity_length_m or 0.0)

    def data(self) -> TireData:
        """Return the data for the estimators, in SI."""
        return TireData(
            ring_thickness_m=self.ring_thickness_m,
            ring_thickness_std_m=(self.ring_thickness_std_mm or 0.0) * 1e-3,
            wear_m=None if self.wear_mm is None else self.wear_mm * 1e-3,
            wear_std_m=(_WEAR_STD_MM if self.wear_std_mm is None else self.wear_std_mm) * 1e-3,
            cavity_length_m=self.cavity_length_m,
            cavity_length_std_m=self.cavity_length_std_m,
            runout_m=RUN_OUT_M if self.runout_mm is None else self.runout_mm * 1e-3,
            half_angle_rad=None if self.contact_half_angle_deg is None else math.radians(self.contact_half_angle_deg),
            half_angle_std_rad=math.radians(self.contact_half_angle_std_deg),
            is_linear_ring=self.linear_ring,
            ply_steer_definition=self.ply_steer or "",
            reference=self.reference.numbers(self.pressure_pa),
            load_calibration=None if self.load_calibration is None else self.load_calibration.calibration(),
            added=tuple(value.data() for _, value in self if isinstance(value, AddedTable)),
        )


def _replaced(table: Section, update: Section, retained: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return the keys of a table, those that `update` states from there, each with its own error or none.

    Args:
        table: as it was.
        update: states what replaces it; keys that it does not set count as not stated.
        retained: names of errors that remain where their value is replaced.
    """
    replacements = update.model_dump(exclude_none=True, exclude_unset=True)
    previous = {key: value for key, value in table.model_dump(exclude_unset=True).items() if value is not None}
    lost = {error for key in replacements for error in previous if _is_error_of(error, key) and error not in retained}
    return {**{key: value for key, value in previous.items() if key not in lost}, **replacements}


def _is_error_of(error: str, key: str) -> bool:
    """Return whether a key is the standard error of another: `radius_std_mm` of `radius_mm`, `Bs_std` of `Bs`."""
    return "_std" in error and error.replace("_std", "", 1) == key


add_keys(Tire, "tire")


class Axle(Section):
    """`[[axle]]`: an axle weighed as a whole instead of wheel by wheel, and its track."""

    wheels: tuple[str, ...] = Field(strict=False, min_length=1, description="positions of its wheels, at least one")
    weight_kg: float | None = within(None, 20, 40_000, "weight on the axle in kg")
    weight_std_kg: float | None = within(
        None, 0, 5000, "standard error of the weight in kg; default: 10 % of each wheel's load, as of one not weighed"
    )
    split_std_percent: float = within(5.0, 0, 50, "standard error of the equal split between the wheels, in percent")
    track_width_mm: float | None = within(
        None, 300, 8000, "distance between the middles of its left and right contacts in mm, verifies lateral gains"
    )
    track_width_std_mm: float | None = within(None, 0, 1000, f"its error, mm; default: {100 * _TRACK_STD:.0f} % of it")

    @property
    def wheel_load_n(self) -> float | None:
        """Load of each of its wheels in N: the weight split equally."""
        return None if self.weight_kg is None else self.weight_kg * STANDARD_GRAVITY_MPS2 / len(self.wheels)

    @property
    def wheel_load_std_n(self) -> float:
        """Standard error of that load in N: weight and equal split combined; that of any load where none is stated."""
        if self.wheel_load_n is None:
            return 0.0
        if self.weight_std_kg is None:
            return self.wheel_load_n * max(LOAD_STD, self.split_std_percent * 1e-2)
        scale_n = self.weight_std_kg * STANDARD_GRAVITY_MPS2 / len(self.wheels)
        return math.hypot(scale_n, self.wheel_load_n * self.split_std_percent * 1e-2)


class Mounting(Section):
    """`[wheel.mounting]`: position and orientation of the sensor in the tire."""

    offset_mm: float | None = within(
        None,
        -20,
        80,
        "distance of the sensor below the belt's neutral layer in mm; default: as the circumferential axis measures it",
    )
    offset_std_mm: float = within(HAND_MOUNTED_STD_M * 1e3, 0, 40, "standard error of offset_mm in mm")
    roll_deg: float | None = within(
        None, -45, 45, "rotation about the circumferential axis in degrees; default: as measured, 0 for diagnose"
    )
    roll_std_deg: float = within(math.degrees(HAND_MOUNTED_STD_RAD), 0, 45, "standard error of roll_deg in degrees")
    pitch_deg: float = within(0.0, -45, 45, "rotation about the lateral axis in degrees")
    lateral_is_left: bool = Field(
        default=False,
        description="whether the lateral axis is known to point to the left; curves verify it (`treadlink doctor`)",
    )

    @property
    def offset_m(self) -> float | None:
        """Distance of the sensor below the belt's neutral layer in m; None when it is not stated."""
        return None if self.offset_mm is None else self.offset_mm * 1e-3

    @property
    def roll_rad(self) -> float:
        """Roll of the sensor about the circumferential axis in rad, 0 when it is not stated."""
        return math.radians(self.roll_deg or 0.0)

    @property
    def pitch_rad(self) -> float:
        """Pitch of the sensor about the lateral axis in rad."""
        return math.radians(self.pitch_deg)


class Sensor(Section):
    """`[wheel.sensor]`: accuracy of the scale and the zero that the hub states, and the sensor's band."""

    gain_std_percent: float = within(GAIN_STD * 1e2, 0, 50, "standard error of the gain of all axes in percent")
    circumferential_gain_std_percent: float = within(
        AXIS_GAIN_STD * 1e2,
        0,
        50,
        "standard error of the gain of the circumferential axis beside that of all in percent",
    )
    lateral_gain_std_percent: float = within(
        AXIS_GAIN_STD * 1e2, 0, 50, "standard error of the gain of the lateral axis beside that of all in percent"
    )
    nonlinearity_std_percent: float = within(
        NONLINEARITY_STD * 1e2,
        0,
        20,
        "standard error of the radial axis by nonlinearity, in percent of full scale",
    )
    zero_g_std_mps2: float = within(ZERO_G_STD_MPS2, 0, 500, "standard error of the sensor's zero-g offset in m/s^2")
    lateral_zero_g_std_mps2: float | None = within(
        None, 0, 500, "standard error of the zero-g offset of the lateral axis in m/s^2; default: zero_g_std_mps2"
    )
    bandwidth_hz: float | None = within(None, 10, 1e6, "-3 dB bandwidth of the sensor in Hz; default: not known")
    rate_std_percent: float = within(
        CLOCK_STD_PERCENT,
        0,
        50,
        f"standard error of the sampling rate in percent; default: {CLOCK_STD_PERCENT:g}, of a hub's clock",
    )


class Wheel(Section):
    """`[[wheel]]`: one instrumented wheel."""

    position: str = Field(
        pattern=POSITION_PATTERN,
        description="name of the wheel, such as FL or rear.left: 1 to 24 letters, digits, '_', '.' or '-'",
    )
    hub: int = Field(ge=0, le=255, description="number of the hub that the sensor sends to")
    wheel: int = Field(ge=0, le=254, description="wheel number at this hub")
    sensor_id: str | None = Field(
        default=None,
        pattern=r"^[0-9a-fA-F]{1,8}$",
        description='serial number of the sensor: 1 to 8 hexadecimal digits in quotes, such as "0000a001"',
    )
    load_n: float | None = within(None, 50, 100_000, "vertical load in N")
    load_std_n: float | None = within(None, 0, 50_000, "standard error of load_n in N; default: 10 % of the load")
    tire: Tire = Field(default=Tire(), description="deviations of this wheel's tire from [tire]")
    mounting: Mounting = Field(default=Mounting(), description="position and orientation of the sensor")
    sensor: Sensor = Field(default=Sensor(), description="accuracy of the sensor")

    @property
    def sensor_number(self) -> int | None:
        """Serial number of the sensor."""
        return None if self.sensor_id is None else int(self.sensor_id, 16)


class Thresholds(Section):
    """`[thresholds]`: alarm limits; a limit that is not stated raises no alarm."""

    pressure_min_kpa: float | None = within(None, 0, 1500, "lowest gauge pressure in kPa")
    pressure_max_kpa: float | None = within(None, 10, 1500, "highest gauge pressure in kPa")
    temperature_max_degc: float | None = within(
        None, -60, 250, "highest temperature of the inner liner in degrees Celsius"
    )
    speed_max_kmh: float | None = above(None, 0, 500, "highest speed in km/h")
    load_max_n: float | None = within(None, 50, 100_000, "highest vertical load in N")
    wear_max_mm: float | None = above(None, 0, 50, "largest tread wear in mm")
    frame_loss_max_percent: float | None = within(
        None, 0, 100, "largest share of frames lost in the last 10 s in percent"
    )
    battery_min_percent: float | None = within(None, 0, 100, "lowest state of charge of a hub's battery in percent")
    silent_after_s: float | None = within(
        None, 0.2, 3600, "time without samples after which a sensor is silent, in s; 1 s when not stated"
    )

    @property
    def pressure_min_pa(self) -> float | None:
        """Lowest gauge pressure in Pa."""
        return None if self.pressure_min_kpa is None else self.pressure_min_kpa * 1e3

    @property
    def pressure_max_pa(self) -> float | None:
        """Highest gauge pressure in Pa."""
        return None if self.pressure_max_kpa is None else self.pressure_max_kpa * 1e3

    @property
    def speed_max_mps(self) -> float | None:
        """Highest speed in m/s."""
        return None if self.speed_max_kmh is None else self.speed_max_kmh / 3.6

    @property
    def wear_max_m(self) -> float | None:
        """Largest tread wear in m."""
        return None if self.wear_max_mm is None else self.wear_max_mm * 1e-3

    @property
    def frame_loss_max(self) -> float | None:
        """Largest share of frames lost, 0 to 1."""
        return None if self.frame_loss_max_percent is None else self.frame_loss_max_percent * 1e-2


class Policy(StrEnum):
    """Treatment of frames that are not verified."""

    OFF = "off"
    WARN = "warn"
    REQUIRE = "require"


class Security(Section):
    """`[security]`: whether frames must be signed by the sensors of the wheels."""

    policy: Policy = Field(
        default=Policy.OFF,
        strict=False,
        description="off: signatures are not checked; warn: unverified frames are reported; require: they are ignored",
    )


class VehicleConfig(Section):
    """The configuration of one vehicle or test rig."""

    vehicle: Vehicle = Field(default=Vehicle(), description="the vehicle or test rig")
    test: TestRun = Field(default=TestRun(), description="the test run: name, driver, comment and tags")
    tire: Tire = Field(default=Tire(), description="the tire of every wheel")
    axle: tuple[Axle, ...] = Field(default=(), strict=False, description="axles weighed as a whole")
    wheel: tuple[Wheel, ...] = Field(
        strict=False, min_length=1, description="at least one instrumented wheel, a [[wheel]] table each"
    )
    thresholds: Thresholds = Field(default=Thresholds(), description="alarm limits")
    security: Security = Field(default=Security(), description="checks of signatures")

    @model_validator(mode="after")
    def _consistent(self) -> VehicleConfig:
        faults = list(cross_faults(self.model_dump(mode="json", exclude_none=True)))
        if faults:
            raise ValueError("; ".join(map(str, faults)))
        return self

    @property
    def name(self) -> str:
        """Name of the vehicle, possibly empty."""
        return self.vehicle.name

    def tire_of(self, wheel: Wheel) -> Tire:
        """Return the tire of a wheel: `[tire]` with the deviations of `[wheel.tire]`."""
        return self.tire.overridden_by(wheel.tire)

    def wheel_setups(self) -> tuple[WheelSetup, ...]:
        """Return the setups of the wheels for the pipeline, in SI, in the order of the file."""
        return tuple(self._setup(wheel) for wheel in self.wheel)

    def tracks_m(self) -> dict[str, tuple[float, float]]:
        """Return track widths in m with their standard errors, by position, as far as stated."""
        tracks: dict[str, tuple[float, float]] = {}
        for axle in self.axle:
            if (width_mm := axle.track_width_mm) is not None:
                std_mm = _TRACK_STD * width_mm if axle.track_width_std_mm is None else axle.track_width_std_mm
                tracks |= dict.fromkeys(axle.wheels, (1e-3 * width_mm, 1e-3 * std_mm))
        return tracks

    def _setup(self, wheel: Wheel) -> WheelSetup:
        tire = self.tire_of(wheel)
        assert tire.radius_m is not None  # ensured by cross_faults
        load_n = wheel.load_n
        load_std_n = LOAD_STD * (load_n or 0.0) if wheel.load_std_n is None else wheel.load_std_n
        for axle in self.axle:
            if wheel.position in axle.wheels and axle.weight_kg is not None:
                load_n, load_std_n = axle.wheel_load_n, axle.wheel_load_std_n
        return WheelSetup(
            position=wheel.position,
            hub=wheel.hub,
            wheel=wheel.wheel,
            radius_m=tire.radius_m,
            radius_std_m=tire.radius_std_m,
            load_n=load_n,
            load_std_n=load_std_n,
            pressure_pa=tire.pressure_pa,
            pressure_std_pa=tire.pressure_std_pa,
            pressure_relative_std=tire.pressure_relative_std,
            temperature_degc=tire.temperature_degc,
            sensor=SensorClaims(
                offset_m=wheel.mounting.offset_m,
                offset_std_m=wheel.mounting.offset_std_mm * 1e-3,
                gain_std=wheel.sensor.gain_std_percent * 1e-2,
                zero_g_std_mps2=wheel.sensor.zero_g_std_mps2,
                roll_rad=None if wheel.mounting.roll_deg is None else wheel.mounting.roll_rad,
                roll_std_rad=math.radians(wheel.mounting.roll_std_deg),
                rate_std=wheel.sensor.rate_std_percent * 1e-2,
                bandwidth_hz=wheel.sensor.bandwidth_hz,
                lateral_is_left=wheel.mounting.lateral_is_left,
                along_gain_std=wheel.sensor.circumferential_gain_std_percent * 1e-2,
                lateral_gain_std=wheel.sensor.lateral_gain_std_percent * 1e-2,
                lateral_zero_g_std_mps2=wheel.sensor.lateral_zero_g_std_mps2,
                nonlinearity_std=wheel.sensor.nonlinearity_std_percent * 1e-2,
            ),
            tire=tire.data(),
            assumed_errors=frozenset(self._assumed_errors_of(wheel)),
        )

    def assumed_errors(self) -> Iterator[tuple[str, str, tuple[str, ...]]]:
        """Yield what is stated without a standard error: the quantity, its default with its unit, and the wheels."""
        positions: dict[tuple[str, str], list[str]] = {}
        for wheel in self.wheel:
            for assumed in self._assumed_errors_of(wheel).items():
                positions.setdefault(assumed, []).append(wheel.position)
        yield from ((quantity, default, tuple(wheels)) for (quantity, default), wheels in positions.items())

    def _assumed_errors_of(self, wheel: Wheel) -> dict[str, str]:
        tire, keys = self.tire_of(wheel), wheel.sensor.model_fields_set | wheel.mounting.model_fields_set
        has_no_softening_std = tire.reference.Bs is not None and tire.reference.softening_std_percent_per_k is None
        has_no_depth_std = "offset_mm" in keys and "offset_std_mm" not in keys
        loads = [(axle.weight_kg, axle.weight_std_kg) for axle in self.axle if wheel.position in axle.wheels]
        loads.append((wheel.load_n, wheel.load_std_n))
        defaults = (
            ("belt radius", f"{100.0 * RADIUS_STD:g} %", tire.radius_std_mm is None),
            ("load", f"{100.0 * LOAD_STD:g} %", any(std is None for load, std in loads if load is not None)),
            ("pressure", f"{100.0 * PRESSURE_STD:g} %", tire.pressure_std_kpa is None),
            ("wear", f"{_WEAR_STD_MM:g} mm", tire.wear_mm is not None and tire.wear_std_mm is None),
            ("sampling rate", f"{CLOCK_STD_PERCENT:g} %", "rate_std_percent" not in keys),
            ("gain", f"{100.0 * GAIN_STD:g} %", "gain_std_percent" not in keys),
            ("lateral gain", f"{100.0 * AXIS_GAIN_STD:g} %", "lateral_gain_std_percent" not in keys),
            ("circumferential gain", f"{100.0 * AXIS_GAIN_STD:g} %", "circumferential_gain_std_percent" not in keys),
            ("linearity", f"{100.0 * NONLINEARITY_STD:g} %", "nonlinearity_std_percent" not in keys),
            ("zero-g offset", f"{ZERO_G_STD_MPS2:g} m/s^2", "zero_g_std_mps2" not in keys),
            ("sensor depth", f"{1e3 * HAND_MOUNTED_STD_M:g} mm", has_no_depth_std),
            ("softening by temperature", f"{100.0 * SOFTENING_STD_PER_K:g} %/K", has_no_softening_std),
        )
        return {quantity: default for quantity, default, is_assumed in defaults if is_assumed}

    def with_sensors_of(self, recorded: VehicleConfig) -> VehicleConfig:
        """Return this configuration with what only that of a recording states of the accuracy of its samples.

        Rate, scale and zero are in the recording, and their errors belong to it: they remain where another vehicle file
        does not state them.
        """
        sensors = {(wheel.hub, wheel.wheel): wheel.sensor for wheel in recorded.wheel}
        wheels = tuple(
            wheel.model_copy(update={"sensor": Sensor(**_replaced(sensors[wheel.hub, wheel.wheel], wheel.sensor))})
            if (wheel.hub, wheel.wheel) in sensors
            else wheel
            for wheel in self.wheel
        )
        return self.model_copy(update={"wheel": wheels})

    def notices(self) -> tuple[Notice, ...]:
        """Return a notice for each assumption."""
        return tuple(Notice("", Reason(CoreCode.ASSUMED_NOT_MEASURED, text=text)) for text in self.vehicle.assumed)

    def to_toml(self) -> str:
        """Return the configuration as TOML that reads back equal, defaults written out.

        What a wheel's tire does not state remains unstated, so that it does not replace what `[tire]` states.
        """
        document = self.model_dump(mode="json", exclude_none=True)
        for table, wheel in zip(document["wheel"], self.wheel, strict=True):
            table["tire"] = wheel.tire.model_dump(mode="json", exclude_none=True, exclude_unset=True)
        return toml_text(document)


add_keys(VehicleConfig, "")


def load_vehicle(path: Path) -> VehicleConfig:
    """Return the configuration in a file.

    Raises:
        ConfigError: the file cannot be read, or the configuration has faults; the message lists all of them.
    """
    vehicle = parse_vehicle(read_text(path, "the configuration"), str(path))
    _logger.info("vehicle configuration %s: %d wheels", path, len(vehicle.wheel))
    return vehicle


def parse_vehicle(text: str, origin: str) -> VehicleConfig:
    """Return the configuration in a TOML text; `origin` names it in messages.

    Raises:
        ConfigError: with one line for each fault, `origin: key: value found, problem`.
    """
    return parse_document(VehicleConfig, text, origin, cross_faults)


def recorded_vehicle(text: str, origin: str) -> VehicleConfig:
    """Return the configuration that a recording contains; `origin` names the recording in messages.

    Raises:
        ConfigError: it has faults, which the user cannot correct there.
    """
    try:
        return parse_vehicle(text, f"{origin}: its configuration")
    except ConfigError as error:
        raise ConfigError(
            str(error), "Give the configuration with --config VEHICLE.toml; it replaces that of the recording."
        ) from error


def choose_vehicle(
    config: VehicleConfig | Path | None, provided: Sequence[str | None], origin: str
) -> VehicleConfig | None:
    """Return a given configuration, else the first of the texts that sources provide, else None.

    What a recording alone states of the accuracy of its samples remains, whatever configuration is given.

    Args:
        config: the configuration or its file, None without one.
        provided: TOML of each source, None for a source without a configuration.
        origin: names the sources in messages.

    Raises:
        ConfigError: the configuration cannot be read, or has faults.
    """
    texts = [text for text in provided if text]
    if config is None:
        return recorded_vehicle(texts[0], origin) if texts else None
    vehicle = load_vehicle(config) if isinstance(config, Path) else config
    for text in texts:
        # One with faults is what the given one replaces.
        with suppress(ConfigError):
            vehicle = vehicle.with_sensors_of(recorded_vehicle(text, origin))
    return vehicle


def shown_units_of(vehicle: VehicleConfig | None) -> ShownUnits:
    """Return the units in which screens show numbers."""
    return vehicle.vehicle.units if vehicle is not None else ShownUnits.SI
