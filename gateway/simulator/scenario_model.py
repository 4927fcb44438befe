"""A scenario as values: defaults of every wheel overridden wheel by wheel."""

from __future__ import annotations

from typing import Annotated, Final, Literal, TypeVar

from pydantic import Field

from gateway.config.validation import Section
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
    """`[[wheel]]`."""

    position: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,23}$", description="as FL or rear.left")
    hub: int = Field(default=0, ge=0, le=255)
    wheel: int = Field(ge=0, le=254)
    sensor_id: str = Field(default="", pattern=r"^[0-9a-fA-F]{0,8}$", description='hexadecimal digits, as "0000a001"')
    load_n: Annotated[Series, in_range(50, 50_000)] = constant(5000.0)
    pressure_kpa: Annotated[Series, in_range(20, 1500)] = constant(210.0)
    temperature_degc: Annotated[Series, in_range(-60, 250)] = constant(25.0)
    slip_angle_deg: Annotated[Series, in_range(-12, 12)] = constant(0.0)
    camber_deg: Annotated[Series, in_range(-30, 30)] = constant(0.0)
    side: Literal["left", "right"] = "left"
    phase_deg: float | None = Field(default=None, ge=-360, le=360, description="at the start; nothing for random")
    motion: Motion = Motion()
    road: Road = Road()
    vibration: Vibration = Vibration()
    impact: Impact = Impact()
    tire: Tire = Tire()
    edge_waves: EdgeWaveTable = EdgeWaveTable()
    tread_pitch: TreadPitchTable = TreadPitchTable()
    sensor: Sensor = Sensor()
    defect: Defect = Defect()
    stated: Stated = Stated()


class Scenario(Section):
    """The whole scenario."""

    scenario: Header = Header()
    link: Link = Link()
    motion: Motion = Motion()
    road: Road = Road()
    vibration: Vibration = Vibration()
    impact: Impact = Impact()
    tire: Tire = Tire()
    edge_waves: EdgeWaveTable = EdgeWaveTable()
    tread_pitch: TreadPitchTable = TreadPitchTable()
    sensor: Sensor = Sensor()
    defect: Defect = Defect()
    hub: tuple[Hub, ...] = Field(default=(), strict=False)
    wheel: tuple[Wheel, ...] = Field(strict=False, min_length=1, description="one [[wheel]] table at least")

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


def _filled(base: SectionT, own: SectionT) -> SectionT:
    return base.model_copy(update={name: getattr(own, name) for name in own.model_fields_set})
