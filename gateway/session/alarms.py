"""Alarms: crossed thresholds of the configuration and faults of sensors and links, from the latest snapshot."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from enum import StrEnum
from typing import Final, NamedTuple

from gateway.config.vehicle import Thresholds
from gateway.estimators.estimator import Status
from gateway.pipeline.results import Alarm, LinkSnapshot, WheelSnapshot
from gateway.reasons import Code, Reason
from gateway.security.guard import SUSPICIOUS
from gateway.session.wheel_identity import misplaced_sensor

_SPEED: Final = "speed_mps"


class AlarmName(StrEnum):
    """Names of the alarms, as printed; those of sensor faults are the names of their flags."""

    BATTERY = "battery"
    LINK = "link"
    LOAD = "load"
    LOSS = "loss"
    MISPLACED = "wrong sensor"
    PRESSURE = "pressure"
    SATURATED = "saturated"
    SECURITY = "security"
    SPEED = "speed"
    TEMPERATURE = "temperature"
    WEAR = "wear"


def alarms(
    wheels: Sequence[WheelSnapshot],
    links: Sequence[LinkSnapshot],
    thresholds: Thresholds,
    sensor_ids: Mapping[str, str] | None = None,
) -> tuple[Alarm, ...]:
    """Return the present alarms, wheels first.

    Args:
        wheels: latest state of the wheels.
        links: latest state of the links.
        thresholds: of the configuration.
        sensor_ids: configured sensors, hex text by position.
    """
    found = [alarm for wheel in wheels for alarm in _wheel_alarms(wheel, thresholds)]
    misplaced = _misplaced_sensors(wheels, sensor_ids or {})
    return (*found, *misplaced, *(alarm for link in links for alarm in _link_alarms(link, thresholds)))


def sensor_alarms(alarms: Sequence[Alarm], wheels: Sequence[WheelSnapshot]) -> tuple[Alarm, ...]:
    """Return those of the alarms that concern a faulty or misplaced sensor."""
    flags = {(wheel.position, flag.name) for wheel in wheels for flag in wheel.flags}
    return tuple(
        alarm for alarm in alarms if alarm.name == AlarmName.MISPLACED or (alarm.position, alarm.name) in flags
    )


def _misplaced_sensors(wheels: Sequence[WheelSnapshot], configured: Mapping[str, str]) -> Iterator[Alarm]:
    """Yield an alarm for each wheel whose sensor is another than the configured one."""
    for wheel in wheels:
        reason = misplaced_sensor(wheel.position, wheel.sensor_id, configured)
        if reason is not None:
            yield Alarm(wheel.position, AlarmName.MISPLACED, reason)


class _Limit(NamedTuple):
    """A threshold: an upper one, or a lower one where `is_lower` is set."""

    name: AlarmName
    limit: float | None
    value: float | None
    reason: Callable[[float, float], Reason]
    is_lower: bool = False

    def is_crossed(self) -> bool:
        if self.limit is None or self.value is None:
            return False
        return self.value < self.limit if self.is_lower else self.value > self.limit


def _wheel_limits(wheel: WheelSnapshot, limits: Thresholds) -> Iterator[_Limit]:
    """Yield the thresholds of a wheel with its present values, None where a limit or a value is unknown."""
    yield _Limit(
        AlarmName.PRESSURE,
        limits.pressure_min_pa,
        wheel.pressure_pa,
        lambda value, limit: Reason(Code.PRESSURE_BELOW_LIMIT, pressure_pa=value, limit_pa=limit),
        is_lower=True,
    )
    yield _Limit(
        AlarmName.PRESSURE,
        limits.pressure_max_pa,
        wheel.pressure_pa,
        lambda value, limit: Reason(Code.PRESSURE_ABOVE_LIMIT, pressure_pa=value, limit_pa=limit),
    )
    yield _Limit(
        AlarmName.TEMPERATURE,
        limits.temperature_max_degc,
        wheel.temperature_degc,
        lambda value, limit: Reason(Code.TEMPERATURE_ABOVE_LIMIT, temperature_degc=value, limit_degc=limit),
    )
    yield _Limit(
        AlarmName.LOAD,
        limits.load_max_n,
        wheel.load_n,
        lambda value, limit: Reason(Code.LOAD_ABOVE_LIMIT, load_n=value, limit_n=limit),
    )
    for estimate in wheel.last.estimates if wheel.last is not None else ():
        if estimate.name == _SPEED and estimate.status != Status.INVALID:
            yield _Limit(
                AlarmName.SPEED,
                limits.speed_max_mps,
                estimate.value,
                lambda value, limit: Reason(Code.SPEED_ABOVE_LIMIT, speed_mps=value, limit_mps=limit),
            )
    yield _Limit(
        AlarmName.WEAR,
        limits.wear_max_mm,
        wheel.wear_mm.value if wheel.wear_mm is not None else None,
        lambda value, limit: Reason(Code.WEAR_ABOVE_LIMIT, wear_m=value * 1e-3, limit_m=limit * 1e-3),
    )


def _wheel_alarms(wheel: WheelSnapshot, limits: Thresholds) -> Iterator[Alarm]:
    for limit in _wheel_limits(wheel, limits):
        if limit.is_crossed():
            assert limit.value is not None
            assert limit.limit is not None
            yield Alarm(wheel.position, limit.name, limit.reason(limit.value, limit.limit))
    for flag in wheel.flags:
        yield Alarm(wheel.position, flag.name, flag.reason)
    saturated = wheel.counters.samples_saturated
    if saturated:
        yield Alarm(wheel.position, AlarmName.SATURATED, Reason(Code.SENSOR_RANGE_REACHED, count=saturated))


def _link_alarms(link: LinkSnapshot, limits: Thresholds) -> Iterator[Alarm]:
    if not link.connected:
        yield Alarm(link.link, AlarmName.LINK, Reason(Code.LINK_DOWN, state=link.note))
    total = link.frames + link.frames_lost
    worst = limits.frame_loss_max
    if worst is not None and total and link.frames_lost / total > worst:
        share = link.frames_lost / total
        yield Alarm(link.link, AlarmName.LOSS, Reason(Code.FRAME_LOSS_ABOVE_LIMIT, share=share, limit=worst))
    suspicious = tuple(
        Reason(Code.FRAMES_VERDICT, verdict=str(verdict), count=count)
        for verdict in SUSPICIOUS
        if (count := link.judged.get(verdict))
    )
    if suspicious:
        yield Alarm(link.link, AlarmName.SECURITY, Reason(Code.FRAMES_NOT_TRUSTED, counts=suspicious))
    battery, least = link.battery_percent, limits.battery_min_percent
    if battery is not None and least is not None and battery < least:
        level = Reason(Code.BATTERY_BELOW_LIMIT, level=battery / 100.0, limit=least / 100.0)
        yield Alarm(link.link, AlarmName.BATTERY, level)
