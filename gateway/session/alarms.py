"""Thresholds of the configuration against the latest snapshot."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from gateway.config.model import Thresholds
from gateway.estimators.base import Status
from gateway.pipeline.results import Alarm, LinkSnapshot, WheelSnapshot


def alarms(wheels: Sequence[WheelSnapshot], links: Sequence[LinkSnapshot], thresholds: Thresholds) -> tuple[Alarm, ...]:
    """Return the thresholds that are crossed now, wheels first."""
    found = [alarm for wheel in wheels for alarm in _of_wheel(wheel, thresholds)]
    return (*found, *(alarm for link in links for alarm in _of_link(link, thresholds)))


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
    if wheel.counters.samples_saturated:
        yield alarm("saturated", f"{wheel.counters.samples_saturated} samples at the end of the sensor's range")


def _of_link(link: LinkSnapshot, limits: Thresholds) -> Iterator[Alarm]:
    if not link.connected:
        yield Alarm(link.link, "link", f"link is down: {link.note}")
    total = link.frames + link.frames_lost
    worst = limits.frame_loss_max
    if worst is not None and total and link.frames_lost / total > worst:
        yield Alarm(link.link, "loss", f"{link.frames_lost / total:.2%} of the frames lost, above {worst:.2%}")
    battery, least = link.battery_percent, limits.battery_min_percent
    if battery is not None and least is not None and battery < least:
        yield Alarm(link.link, "battery", f"battery {battery} % is below {least:.0f} %")
