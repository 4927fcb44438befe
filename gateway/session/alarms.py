"""What is wrong now: thresholds of the configuration, sensors and links, from the latest snapshot."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from gateway.config.vehicle import Thresholds
from gateway.estimators.base import Status
from gateway.pipeline.results import Alarm, LinkSnapshot, WheelSnapshot
from gateway.security.guard import SUSPICIOUS
from gateway.session.wheel_identity import misplaced
from gateway.views import wording


def alarms(
    wheels: Sequence[WheelSnapshot],
    links: Sequence[LinkSnapshot],
    thresholds: Thresholds,
    sensor_ids: Mapping[str, str] | None = None,
) -> tuple[Alarm, ...]:
    """Return what is wrong now, wheels first.

    Args:
        wheels: latest state of the wheels.
        links: latest state of the links.
        thresholds: of the configuration.
        sensor_ids: sensor that the configuration wants, hex text by position.
    """
    found = [alarm for wheel in wheels for alarm in _of_wheel(wheel, thresholds)]
    of_sensors = _of_sensors(wheels, sensor_ids or {})
    return (*found, *of_sensors, *(alarm for link in links for alarm in _of_link(link, thresholds)))


def sensor_alarms(alarms: Sequence[Alarm], wheels: Sequence[WheelSnapshot]) -> tuple[Alarm, ...]:
    """Return those of the alarms that tell of a sensor at fault or in the wrong place."""
    flags = {(wheel.position, flag.name) for wheel in wheels for flag in wheel.flags}
    return tuple(alarm for alarm in alarms if alarm.name == MISPLACED or (alarm.position, alarm.name) in flags)


MISPLACED: Final = "wrong sensor"


def _of_sensors(wheels: Sequence[WheelSnapshot], wanted: Mapping[str, str]) -> Iterator[Alarm]:
    """Wheels whose sensor says that it is another than the configuration wants there."""
    for wheel in wheels:
        if text := misplaced(wheel.position, wheel.sensor_id, wanted):
            yield Alarm(wheel.position, MISPLACED, text)


def _of_wheel(wheel: WheelSnapshot, limits: Thresholds) -> Iterator[Alarm]:
    def alarm(name: str, text: str) -> Alarm:
        return Alarm(wheel.position, name, text)

    pressure = wheel.pressure_pa
    if pressure is not None:
        low, high = limits.pressure_min_pa, limits.pressure_max_pa
        if low is not None and pressure < low:
            yield alarm("pressure", f"pressure {pressure / 1e3:.0f} kPa is below {low / 1e3:.0f} kPa")
        if high is not None and pressure > high:
            yield alarm("pressure", f"pressure {pressure / 1e3:.0f} kPa is above {high / 1e3:.0f} kPa")
    temperature, hottest = wheel.temperature_degc, limits.temperature_max_degc
    if temperature is not None and hottest is not None and temperature > hottest:
        yield alarm("temperature", f"inner liner {temperature:.0f} degC is above {hottest:.0f} degC")
    if wheel.load_n is not None and limits.load_max_n is not None and wheel.load_n > limits.load_max_n:
        yield alarm("load", f"load {wheel.load_n:.0f} N is above {limits.load_max_n:.0f} N")
    fastest = limits.speed_max_mps
    if fastest is not None and wheel.last is not None:
        for estimate in wheel.last.estimates:
            if estimate.name == "speed_mps" and estimate.status != Status.INVALID and estimate.value > fastest:
                yield alarm("speed", f"speed {estimate.value * 3.6:.0f} km/h is above {fastest * 3.6:.0f} km/h")
    wear = wheel.wear_mm
    if wear is not None and limits.wear_max_mm is not None and wear.value > limits.wear_max_mm:
        yield alarm("wear", f"wear {wear.value:.1f} mm is above {limits.wear_max_mm:.1f} mm")
    for flag in wheel.flags:
        yield alarm(flag.name, wording.text(flag.reason))
    if wheel.counters.samples_saturated:
        yield alarm("saturated", f"{wheel.counters.samples_saturated} samples at the end of the sensor's range")


def _of_link(link: LinkSnapshot, limits: Thresholds) -> Iterator[Alarm]:
    if not link.connected:
        yield Alarm(link.link, "link", f"link is down: {link.note}")
    total = link.frames + link.frames_lost
    worst = limits.frame_loss_max
    if worst is not None and total and link.frames_lost / total > worst:
        yield Alarm(link.link, "loss", f"{link.frames_lost / total:.2%} of the frames lost, above {worst:.2%}")
    suspicious = {verdict: count for verdict in SUSPICIOUS if (count := link.judged.get(verdict))}
    if suspicious:
        text = ", ".join(f"{count} {verdict}" for verdict, count in suspicious.items())
        yield Alarm(link.link, "security", f"frames not to be trusted: {text}")
    battery, least = link.battery_percent, limits.battery_min_percent
    if battery is not None and least is not None and battery < least:
        yield Alarm(link.link, "battery", f"battery {battery} % is below {least:.0f} %")
