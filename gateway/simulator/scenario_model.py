"""Scenario model: tables with defaults for every wheel, overridden wheel by wheel."""

from typing import Annotated, Final, Literal, TypeVar

from pydantic import Field

from gateway.core.config.validation import Section, within
from gateway.simulator.scenario_tables import (
    Defect,
    EdgeWaveTable,
    Header,
    Hub,
    Impact,
    Link,
    Motion,
    Road,
    Sensor,
    Stated,
    Tire,
    TreadPitchTable,
    Vibration,
)
from gateway.simulator.time_series import Series, constant, in_range

SectionT = TypeVar("SectionT", bound=Section)

_INHERITED: Final = ("motion", "road", "vibration", "impact", "tire", "edge_waves", "tread_pitch", "sensor", "defect")


class Wheel(Section):
    """`[[wheel]]`: one wheel; its tables override those of the scenario key by key."""

    position: str = Field(
        pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,23}$",
        description="name of the wheel, such as FL or rear.left: 1 to 24 letters, digits, '_', '.' or '-'",
    )
    hub: int = within(0, 0, 255, "number of the hub that the sensor sends to")
    wheel: int = Field(ge=0, le=254, description="wheel number at this hub")
    sensor_id: str = Field(
        default="",
        pattern=r"^[0-9a-fA-F]{0,8}$",
        description='serial number of the sensor in hexadecimal digits, such as "0000a001"',
    )
    load_n: Annotated[Series, in_range(50, 50_000)] = Field(
        default=constant(5000.0), description="vertical load in N: a number or a list of [t_s, value] points"
    )
    pressure_kpa: Annotated[Series, in_range(20, 1500)] = Field(
        default=constant(210.0), description="gauge pressure in kPa: a number or a list of [t_s, value] points"
    )
    temperature_degc: Annotated[Series, in_range(-60, 250)] = Field(
        default=constant(25.0),
        description="temperature of the inner liner in degrees Celsius: a number or a list of [t_s, value] points",
    )
    slip_angle_deg: Annotated[Series, in_range(-12, 12)] = Field(
        default=constant(0.0), description="slip angle in degrees: a number or a list of [t_s, value] points"
    )
    camber_deg: Annotated[Series, in_range(-30, 30)] = Field(
        default=constant(0.0), description="camber angle in degrees: a number or a list of [t_s, value] points"
    )
    side: Literal["left", "right"] = Field(
        default="left", description="side of the vehicle; it decides the sign of conicity"
    )
    phase_deg: float | None = within(None, -360, 360, "angle of the sensor at the start in degrees; default: random")
    motion: Motion = Field(default=Motion(), description="speed and direction of rolling")
    road: Road = Field(default=Road(), description="random vibration and contact-edge jitter")
    vibration: Vibration = Field(default=Vibration(), description="vibration of the wheel caused by the vehicle")
    impact: Impact = Field(default=Impact(), description="impact once per revolution")
    tire: Tire = Field(default=Tire(), description="the tire")
    edge_waves: EdgeWaveTable = Field(default=EdgeWaveTable(), description="waves from the tread pattern")
    tread_pitch: TreadPitchTable = Field(default=TreadPitchTable(), description="bending by tread blocks")
    sensor: Sensor = Field(default=Sensor(), description="the sensor")
    defect: Defect = Field(default=Defect(), description="defects of the sensor")
    stated: Stated = Field(
        default=Stated(), description="values of the vehicle configuration that differ from the truth"
    )


class Scenario(Section):
    """The scenario; the tables from `motion` to `defect` are defaults for every wheel."""

    scenario: Header = Field(default=Header(), description="name, length and faults")
    link: Link = Field(default=Link(), description="delivery of the bytes")
    motion: Motion = Field(default=Motion(), description="speed and direction of rolling")
    road: Road = Field(default=Road(), description="random vibration and contact-edge jitter")
    vibration: Vibration = Field(default=Vibration(), description="vibration of the wheel caused by the vehicle")
    impact: Impact = Field(default=Impact(), description="impact once per revolution")
    tire: Tire = Field(default=Tire(), description="the tire")
    edge_waves: EdgeWaveTable = Field(default=EdgeWaveTable(), description="waves from the tread pattern")
    tread_pitch: TreadPitchTable = Field(default=TreadPitchTable(), description="bending by tread blocks")
    sensor: Sensor = Field(default=Sensor(), description="the sensor")
    defect: Defect = Field(default=Defect(), description="defects of the sensor")
    hub: tuple[Hub, ...] = Field(default=(), strict=False, description="hubs")
    wheel: tuple[Wheel, ...] = Field(
        strict=False, min_length=1, description="at least one wheel, a [[wheel]] table each"
    )

    def wheels(self) -> tuple[Wheel, ...]:
        """Return the wheels with the scenario's defaults filled in."""
        return tuple(
            wheel.model_copy(update={name: _filled(getattr(self, name), getattr(wheel, name)) for name in _INHERITED})
            for wheel in self.wheel
        )

    def hubs(self) -> tuple[Hub, ...]:
        """Return every hub that a wheel names, by number."""
        described = {hub.hub: hub for hub in self.hub}
        numbers = sorted({wheel.hub for wheel in self.wheel})
        return tuple(described.get(number) or Hub(hub=number) for number in numbers)


def _filled(base: SectionT, overrides: SectionT) -> SectionT:
    return base.model_copy(update={name: getattr(overrides, name) for name in overrides.model_fields_set})
