"""Watches of wheels that features add: each takes the state of every wheel and has alarms of its own."""

from collections.abc import Iterable
from typing import Protocol

from gateway.core.config.vehicle import VehicleConfig
from gateway.core.estimates.results import Alarm, WheelSnapshot
from gateway.core.feature import Registry, added, object_of


class WheelWatch(Protocol):
    """A watch of the wheels of a vehicle, made of its configuration; None where there is nothing to watch.

    Attributes:
        names: of its alarms, which no other alarm has.
    """

    names: frozenset[str]

    def take(self, wheel: WheelSnapshot, at_s: float, *, is_current: bool) -> None:
        """Take the state of a wheel at a time; `is_current` is False where its pressure and temperature are old."""

    def alarms(self) -> Iterable[Alarm]:
        """Return the present alarms."""


def wheel_watches(vehicle: VehicleConfig | None) -> list[WheelWatch]:
    """Return the watches of all features; without a configuration there is none."""
    kinds = added(Registry.WHEEL_WATCHES).values() if vehicle is not None else ()
    return [watch for kind in kinds if (watch := object_of(kind)(vehicle)) is not None]
