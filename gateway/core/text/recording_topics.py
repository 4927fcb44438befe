"""Decoded results and messages as the JSON topics of a recording (fields: `gateway.core.recording.schemas`)."""

import math
from collections.abc import Collection, Iterable, Mapping
from typing import Any, Final
from urllib.parse import quote

import numpy as np

from firmware_protocol.messages import Environment, Frame, Hello, HubStatus, LogLevel, LogText
from gateway.core.estimates.estimator import Estimate
from gateway.core.estimates.results import AlarmChange, RevolutionResult
from gateway.core.reasons import Level, Notice, Reason
from gateway.core.text.numbers import distinct_name
from gateway.core.text.wording import as_json, notice_text
from gateway.core.types import FloatArray

CONDITIONS: Final = ("load_n", "pressure_pa", "temperature_degc")
"""Fields of a revolution for the conditions, stated or measured."""

# The waveform topic is for plots only: the raw bytes in the same recording hold every sample.
_WAVEFORM_POINTS: Final = 256


def wheel_topic(position: str, what: str) -> str:
    """Return a topic of a wheel, `/wheel/FL/revolution`.

    An unconfigured wheel may be named for its link; what separates the levels of a topic is escaped in it.
    """
    return f"/wheel/{quote(position, safe='')}/{what}"


def finite(entries: Mapping[str, float | int | None]) -> dict[str, Any]:
    """Return the entries that are finite numbers: JSON has no NaN."""
    return {key: value for key, value in entries.items() if value is not None and math.isfinite(value)}


def estimate_fields(estimate: Estimate, taken: Collection[str] = ()) -> dict[str, Any]:
    """Return an estimate as flat fields that plotting programs list side by side.

    Args:
        estimate: the estimate.
        taken: names of other fields; see `distinct_name`.
    """
    name = distinct_name(estimate.name.replace("/", "_over_"), taken)
    return {
        **finite({name: estimate.value, f"{name}_std": estimate.std}),
        **({f"{name}_scatter_std": estimate.scatter_std} if estimate.scatter_std > 0.0 else {}),
        f"{name}_status": str(estimate.status),
        **_reasons(f"{name}_reasons", estimate.reasons),
    }


def _reasons(key: str, reasons: Iterable[Reason]) -> dict[str, Any]:
    entries = [as_json(reason) for reason in reasons]
    return {key: entries} if entries else {}


def revolution_payload(result: RevolutionResult) -> dict[str, Any]:
    """Return one row of results as flat fields."""
    revolution, conditions = result.revolution, result.conditions
    payload = finite(
        {
            "index": revolution.index,
            "start_s": revolution.start_s,
            "period_s": revolution.period_s,
            "omega_radps": revolution.omega_radps,
            "omega_dot_radps2": revolution.omega_dot_radps2,
            "noise_mps2": revolution.noise_mps2,
            "missing_fraction": revolution.missing_fraction,
            "load_n": conditions.load_n,
            "pressure_pa": conditions.pressure_pa,
            "temperature_degc": conditions.temperature_degc,
        }
    )
    payload.update(_reasons("fault_reasons", revolution.faults))
    for estimate in result.estimates:
        payload.update(estimate_fields(estimate, CONDITIONS))
    return payload


def waveform_payload(result: RevolutionResult, average_mps2: FloatArray) -> dict[str, Any]:
    """Return the last revolution against the running average, thinned for plotting."""
    radial = result.revolution.radial_mps2
    step = max(1, len(radial) // _WAVEFORM_POINTS)
    theta = np.linspace(-math.pi, math.pi, len(radial), endpoint=False)

    def thin(values: FloatArray, digits: int) -> list[float]:
        return [round(value, digits) for value in np.nan_to_num(values[::step]).tolist()]

    return {
        "index": result.revolution.index,
        "theta_rad": thin(theta, 4),
        "radial_mps2": thin(radial, 2),
        "average_mps2": thin(average_mps2, 2),
    }


def message_topic(frame: Frame, position: str, link: str) -> tuple[str, dict[str, Any]] | None:
    """Return topic and payload of a slow message; None for messages that are recorded only as bytes."""
    message = frame.message
    if isinstance(message, Environment):
        return wheel_topic(position, "environment"), finite(message._asdict())
    if isinstance(message, HubStatus):
        return f"/hub/{frame.hub}/status", finite(message._asdict())
    if isinstance(message, Hello):
        return f"/hub/{frame.hub}/hello", {
            "wheel": frame.wheel,
            "protocol": f"{message.protocol_major}.{message.protocol_minor}",
            "hub_id": f"{message.hub_id:016x}",
            "sensor_id": f"{message.sensor_id:08x}",
            "firmware": ".".join(map(str, message.firmware)),
            "boot_count": message.boot_count,
            "rate_hz": message.rate_hz,
            "axes": message.axes,
            "coupling": message.coupling.name.lower(),
            "highpass_hz": message.highpass_hz,
            "range_mps2": list(message.range_mps2),
            "scale_mps2": list(message.scale_mps2),
            "offset_counts": list(message.offset_counts),
            "saturation_counts": message.saturation_counts,
        }
    if isinstance(message, LogText):
        return "/log", {"level": log_level(message), "text": message.text, "hub": frame.hub, "link": link}
    return None


def alarm_payload(change: AlarmChange) -> dict[str, Any]:
    """Return a change of an alarm as an entry of the history of alarms."""
    alarm = change.alarm
    return {
        "subject": alarm.position,
        "name": str(alarm.name),
        "state": change.state,
        "at_s": change.at_s,
        "stood_s": change.stood_s,
        **as_json(alarm.reason),
    }


def notice_payload(notice: Notice, link: str) -> dict[str, Any]:
    """Return a notice as an entry of the log."""
    level = Level.WARNING if notice.level is Level.SECURITY else notice.level
    reason = as_json(notice.reason)
    return {
        "level": str(level),
        "text": notice_text(notice),
        "link": link,
        "subject": notice.subject,
        "code": reason["code"],
        "values": reason["values"],
    }


def log_level(message: LogText) -> str:
    """Return the severity in words, `level 7` for one that this version does not know."""
    names = {level.value: level.name.lower() for level in LogLevel}
    return names.get(message.level, f"level {message.level}")
