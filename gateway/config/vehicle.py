"""The vehicle configuration as values: user's units in the keys, SI through properties."""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import StrEnum
from typing import Final

from pydantic import Field, model_validator

from gateway.config.cross_checks import cross_faults
from gateway.config.toml_writer import toml_text
from gateway.config.validation import Section
from gateway.constants import STANDARD_GRAVITY_MPS2
from gateway.pipeline.wheel_setup import LoadCalibration, ReferenceNumbers, TireData, WheelSetup
from gateway.reasons import Code, Notice, Reason

ASSUMED_RADIUS_MM: Final = 320.0
POSITION_PATTERN: Final = r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,23}$"


class Vehicle(Section):
    """`[vehicle]`: what the wheels belong to; `assumed` tells in words what nobody measured or stated."""

    name: str = ""
    assumed: tuple[str, ...] = Field(default=(), strict=False)


class Reference(Section):
    """`[tire.reference]`: the four dimensionless numbers of the new tire; `treadlink calibrate` writes it."""

    Bs: float | None = Field(default=None, gt=0, le=1000)
    Cw: float | None = Field(default=None, gt=0, le=1000)
    Rs: float | None = Field(default=None, gt=0, le=1000)
    Ts: float | None = Field(default=None, gt=0, le=1000)
    Bs_std: float | None = Field(default=None, ge=0, le=1000)
    Cw_std: float | None = Field(default=None, ge=0, le=1000)
    Rs_std: float | None = Field(default=None, ge=0, le=1000)
    Ts_std: float | None = Field(default=None, ge=0, le=1000)
    pressure_kpa: float | None = Field(default=None, ge=10, le=1500, description="gauge pressure they were measured at")
    estimator: str | None = Field(default=None, description="which estimator they are of; weak-form when left out")

    def numbers(self, stated_pressure_pa: float | None) -> ReferenceNumbers:
        """Return them in SI; the tire's stated pressure is taken where none is told."""
        pressure_pa = stated_pressure_pa if self.pressure_kpa is None else self.pressure_kpa * 1e3
        stated = self.model_dump(exclude={"pressure_kpa"}, exclude_none=True)
        return ReferenceNumbers(**stated, pressure_pa=pressure_pa)


class LoadCalibrationTable(Section):
    """`[tire.load_calibration]`: load from contact half angle and pressure; `treadlink calibrate` writes it."""

    load_n: float = Field(ge=50, le=100_000, description="load at the reference half angle and pressure")
    half_angle_rad: float = Field(ge=0.01, le=1.5)
    pressure_kpa: float = Field(ge=10, le=1500)
    angle_exponent: float = Field(ge=0.1, le=5)
    angle_curvature: float = Field(default=0.0, ge=-2, le=2)
    pressure_exponent: float = Field(ge=-2, le=3)
    relative_std_percent: float = Field(ge=0, le=100, description="one standard error of a load it gives")
    half_angle_min_rad: float = Field(ge=0.01, le=1.5)
    half_angle_max_rad: float = Field(ge=0.01, le=1.5)
    pressure_min_kpa: float = Field(ge=10, le=1500)
    pressure_max_kpa: float = Field(ge=10, le=1500)

    def calibration(self) -> LoadCalibration:
        """Return it in SI."""
        return LoadCalibration(
            load_n=self.load_n,
            half_angle_rad=self.half_angle_rad,
            pressure_pa=self.pressure_kpa * 1e3,
            angle_exponent=self.angle_exponent,
            angle_curvature=self.angle_curvature,
            pressure_exponent=self.pressure_exponent,
            relative_std=self.relative_std_percent * 1e-2,
            half_angle_range_rad=(self.half_angle_min_rad, self.half_angle_max_rad),
            pressure_range_pa=(self.pressure_min_kpa * 1e3, self.pressure_max_kpa * 1e3),
        )


class Tire(Section):
    """`[tire]`, the default of every wheel, and `[wheel.tire]`, what differs from it."""

    size: str | None = None
    radius_mm: float | None = Field(
        default=None, ge=100, le=1200, description="the belt radius: 2 pi radius = rolling circumference"
    )
    pressure_kpa: float | None = Field(default=None, ge=10, le=1500, description="gauge pressure")
    pressure_std_kpa: float | None = Field(default=None, ge=0, le=500, description="one standard error")
    temperature_degc: float | None = Field(default=None, ge=-60, le=250, description="at the inner liner")
    ring_thickness_mm: float | None = Field(default=None, ge=1, le=80, description="belt and tread, new")
    ring_thickness_std_mm: float | None = Field(default=None, ge=0, le=40, description="one standard error")
    reference: Reference = Reference()
    load_calibration: LoadCalibrationTable | None = None

    def overridden_by(self, other: Tire) -> Tire:
        """Return this tire with what `other` states in place of its own."""
        reference = {**self.reference.model_dump(), **other.reference.model_dump(exclude_none=True)}
        stated = other.model_dump(exclude_none=True, exclude={"reference"})
        return Tire(**{**self.model_dump(exclude={"reference"}), **stated}, reference=Reference(**reference))

    @property
    def radius_m(self) -> float | None:
        """Belt radius in m."""
        return None if self.radius_mm is None else self.radius_mm * 1e-3

    @property
    def pressure_pa(self) -> float | None:
        """Stated gauge pressure in Pa."""
        return None if self.pressure_kpa is None else self.pressure_kpa * 1e3

    @property
    def pressure_std_pa(self) -> float:
        """Standard error of the stated pressure in Pa, 0 when not stated."""
        return (self.pressure_std_kpa or 0.0) * 1e3

    @property
    def ring_thickness_m(self) -> float | None:
        """Thickness of the new ring in m."""
        return None if self.ring_thickness_mm is None else self.ring_thickness_mm * 1e-3

    def data(self) -> TireData:
        """Return what estimators may know of it, in SI."""
        return TireData(
            ring_thickness_m=self.ring_thickness_m,
            ring_thickness_std_m=(self.ring_thickness_std_mm or 0.0) * 1e-3,
            reference=self.reference.numbers(self.pressure_pa),
            load_calibration=None if self.load_calibration is None else self.load_calibration.calibration(),
        )


class Axle(Section):
    """`[[axle]]`: an axle weighed as a whole, where the wheels were not weighed alone."""

    wheels: tuple[str, ...] = Field(strict=False, min_length=1, description="positions of its wheels, one at least")
    weight_kg: float = Field(ge=20, le=40_000)
    weight_std_kg: float = Field(default=0.0, ge=0, le=5000)
    split_std_percent: float = Field(
        default=5.0, ge=0, le=50, description="what an equal split may be wrong by, one standard error"
    )

    @property
    def wheel_load_n(self) -> float:
        """Load of each of its wheels: the weight split equally."""
        return self.weight_kg * STANDARD_GRAVITY_MPS2 / len(self.wheels)

    @property
    def wheel_load_std_n(self) -> float:
        """Standard error of that load: the scale's and the equal split's together."""
        scale_n = self.weight_std_kg * STANDARD_GRAVITY_MPS2 / len(self.wheels)
        return math.hypot(scale_n, self.wheel_load_n * self.split_std_percent * 1e-2)


class Mounting(Section):
    """`[wheel.mounting]`: how the sensor sits in the tire."""

    offset_mm: float = Field(default=0.0, ge=-20, le=80, description="sensor below the belt's neutral layer")
    roll_deg: float = Field(default=0.0, ge=-45, le=45)
    pitch_deg: float = Field(default=0.0, ge=-45, le=45)

    @property
    def offset_m(self) -> float:
        """Distance of the sensor below the belt's neutral layer in m."""
        return self.offset_mm * 1e-3

    @property
    def roll_rad(self) -> float:
        """Roll of the sensor about the circumferential axis in rad."""
        return math.radians(self.roll_deg)

    @property
    def pitch_rad(self) -> float:
        """Pitch of the sensor about the lateral axis in rad."""
        return math.radians(self.pitch_deg)


class Wheel(Section):
    """`[[wheel]]`: one instrumented wheel."""

    position: str = Field(
        pattern=POSITION_PATTERN, description="1 to 24 letters, digits, '_', '.' or '-', as FL or rear.left"
    )
    hub: int = Field(ge=0, le=255)
    wheel: int = Field(ge=0, le=254)
    sensor_id: str | None = Field(
        default=None, pattern=r"^[0-9a-fA-F]{1,8}$", description='1 to 8 hexadecimal digits in quotes, as "0000a001"'
    )
    load_n: float | None = Field(default=None, ge=50, le=100_000)
    load_std_n: float | None = Field(default=None, ge=0, le=50_000)
    tire: Tire = Tire()
    mounting: Mounting = Mounting()

    @property
    def sensor_number(self) -> int | None:
        """Serial number of the sensor."""
        return None if self.sensor_id is None else int(self.sensor_id, 16)


class Thresholds(Section):
    """`[thresholds]`: limits whose crossing raises an alarm; None never does."""

    pressure_min_kpa: float | None = Field(default=None, ge=0, le=1500)
    pressure_max_kpa: float | None = Field(default=None, ge=10, le=1500)
    temperature_max_degc: float | None = Field(default=None, ge=-60, le=250)
    speed_max_kmh: float | None = Field(default=None, gt=0, le=500)
    load_max_n: float | None = Field(default=None, ge=50, le=100_000)
    wear_max_mm: float | None = Field(default=None, gt=0, le=50)
    frame_loss_max_percent: float | None = Field(default=None, ge=0, le=100)
    battery_min_percent: float | None = Field(default=None, ge=0, le=100)

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
        """Most wear in m."""
        return None if self.wear_max_mm is None else self.wear_max_mm * 1e-3

    @property
    def frame_loss_max(self) -> float | None:
        """Largest share of frames lost, 0 to 1."""
        return None if self.frame_loss_max_percent is None else self.frame_loss_max_percent * 1e-2


class Policy(StrEnum):
    """What becomes of frames that nobody can vouch for."""

    OFF = "off"
    WARN = "warn"
    REQUIRE = "require"


class Security(Section):
    """`[security]`: whether frames must be signed by the sensors that the wheels name."""

    policy: Policy = Field(
        default=Policy.OFF,
        strict=False,
        description="off: signatures are not looked at; warn: what is not verified is told; require: it is ignored",
    )


class VehicleConfig(Section):
    """The whole configuration of one vehicle or test rig."""

    vehicle: Vehicle = Vehicle()
    tire: Tire = Tire()
    axle: tuple[Axle, ...] = Field(default=(), strict=False)
    wheel: tuple[Wheel, ...] = Field(strict=False, min_length=1, description="one [[wheel]] table at least")
    thresholds: Thresholds = Thresholds()
    security: Security = Security()

    @model_validator(mode="after")
    def _consistent(self) -> VehicleConfig:
        faults = list(cross_faults(self.model_dump(mode="json", exclude_none=True)))
        if faults:
            raise ValueError("; ".join(map(str, faults)))
        return self

    @property
    def name(self) -> str:
        """Name of the vehicle, may be empty."""
        return self.vehicle.name

    def tire_of(self, wheel: Wheel) -> Tire:
        """Return the tire of a wheel: `[tire]` with what `[wheel.tire]` states in place."""
        return self.tire.overridden_by(wheel.tire)

    def wheel_setups(self) -> tuple[WheelSetup, ...]:
        """Return what the pipeline needs of each wheel, in the order of the file, in SI."""
        return tuple(self._setup(wheel) for wheel in self.wheel)

    def _setup(self, wheel: Wheel) -> WheelSetup:
        tire = self.tire_of(wheel)
        assert tire.radius_m is not None  # cross_faults has seen to it
        load_n, load_std_n = wheel.load_n, wheel.load_std_n or 0.0
        for axle in self.axle:
            if wheel.position in axle.wheels:
                load_n, load_std_n = axle.wheel_load_n, axle.wheel_load_std_n
        return WheelSetup(
            position=wheel.position,
            hub=wheel.hub,
            wheel=wheel.wheel,
            radius_m=tire.radius_m,
            load_n=load_n,
            load_std_n=load_std_n,
            pressure_pa=tire.pressure_pa,
            pressure_std_pa=tire.pressure_std_pa,
            temperature_degc=tire.temperature_degc,
            sensor_offset_m=wheel.mounting.offset_m,
            tire=tire.data(),
        )

    def notices(self) -> tuple[Notice, ...]:
        """Return a notice for each assumption."""
        return tuple(Notice("", Reason(Code.ASSUMED_NOT_MEASURED, text=text)) for text in self.vehicle.assumed)

    def to_toml(self) -> str:
        """Return the configuration as TOML that reads back equal, defaults written out."""
        return toml_text(self.model_dump(mode="json", exclude_none=True))


def default_vehicle(wheels: Sequence[tuple[int, int]]) -> VehicleConfig:
    """Return a configuration for wheels (hub, wheel) that nobody configured.

    The belt radius is assumed to be 0.32 m and told so by `notices()`; load and pressure stay unknown.
    """
    return VehicleConfig(
        vehicle=Vehicle(assumed=(f"tire.radius_mm = {ASSUMED_RADIUS_MM:g} (no configuration states it)",)),
        tire=Tire(radius_mm=ASSUMED_RADIUS_MM),
        wheel=tuple(Wheel(position=f"hub{hub}.wheel{wheel}", hub=hub, wheel=wheel) for hub, wheel in wheels),
    )
