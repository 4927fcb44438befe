"""The text of every reason, in one table.

A template is a format string over the values of its reason. Values are in SI units; a unit after the format converts
and is printed: `{depth_m:.1f mm}` shows 0.008 as `8.0 mm`. A nested reason is replaced by its own text.
"""

from __future__ import annotations

import math
import string
from collections.abc import Iterable, Mapping
from typing import Any, Final

from gateway.constants import STANDARD_GRAVITY_MPS2
from gateway.reasons import Code, Level, Notice, Reason, Value

TEMPLATES: Final[Mapping[Code, str]] = {
    # Revolutions
    Code.SAMPLES_LOST: "samples were lost on the link",
    # Estimates
    # Sensors
    # Wheels, links and alarms
    # - Thresholds
    Code.BATTERY_BELOW_LIMIT: "battery at {level:.0f %}, below {limit:.0f %}",
    Code.FRAME_LOSS_ABOVE_LIMIT: "{share:.2f %} of the frames lost, above {limit:.2f %}",
    Code.LINK_DOWN: "link is down: {state}",
    Code.LOAD_ABOVE_LIMIT: "load {load_n:.0f N} is above {limit_n:.0f N}",
    Code.PRESSURE_ABOVE_LIMIT: "pressure {pressure_pa:.0f kPa} is above {limit_pa:.0f kPa}",
    Code.PRESSURE_BELOW_LIMIT: "pressure {pressure_pa:.0f kPa} is below {limit_pa:.0f kPa}",
    Code.SENSOR_RANGE_REACHED: "{count:d} samples at the end of the sensor's range",
    Code.SPEED_ABOVE_LIMIT: "speed {speed_mps:.0f km/h} is above {limit_mps:.0f km/h}",
    Code.TEMPERATURE_ABOVE_LIMIT: "inner liner at {temperature_degc:.0f degC}, above {limit_degc:.0f degC}",
    Code.WEAR_ABOVE_LIMIT: "wear {wear_m:.1f mm} is above {limit_m:.1f mm}",
    # - Events of links and devices
    Code.BATTERY_LEVEL: "battery {level:.0f %}",
    Code.BLE_DEVICE: "{device}",
    Code.LINK_AWAY: "back after {away_s:.1f s}",
    Code.LINK_CONNECTED: "connected",
    Code.LINK_DISCONNECTED: "disconnected on request",
    Code.LINK_ENDED: "ended",
    Code.LINK_EVENT: "{event}: {details}",
    Code.LINK_LOST: "connection lost",
    Code.LINK_NOT_OPEN: "not open yet",
    Code.LINK_RESTORED: "reconnected",
    Code.LINK_RETRYING: "reconnecting fails",
    Code.MARK: "mark: {text}",
    Code.MTU: "MTU {mtu:d}",
    Code.MTU_TOO_SMALL: "MTU {mtu:d} is less than the {needed:d} that frames need: expect losses",
    Code.MTU_UNKNOWN: "MTU unknown (frames need {needed:d})",
    Code.NOTIFICATIONS_DROPPED: "{count:d} notifications dropped because this computer is too slow",
    Code.QUOTED_TEXT: "{text}",
    Code.RETRY_INTERVAL: "trying again every {interval_s:g s} or sooner",
    # - Health of links
    Code.FIRMWARE_TOO_NEW: (
        "the firmware uses protocol {major:d}.x and treadlink {own:d}.x, so no frame can be read. Update treadlink"
    ),
    Code.FIRMWARE_TOO_OLD: (
        "the firmware uses protocol {major:d}.x and treadlink {own:d}.x, so no frame can be read. Update the hub's "
        "firmware"
    ),
    Code.FRAMES_DAMAGED: (
        "{share:.0f %} of the frames arrive damaged and are left out. Check cable, ground, distance and baud rate"
    ),
    Code.FRAMES_RESUMED: "frames arrive now",
    Code.FRAMES_WITH_BAD_PAYLOAD: (
        "frames with a valid checksum whose content violates the protocol are skipped: a fault of the firmware"
    ),
    Code.FRAMES_WITH_UNKNOWN_FLAGS: "frames with unknown flags are skipped and counted",
    Code.HUB_RESTARTED: "restarted (boot count {boot_count:d}); its counters and times start again",
    Code.HUB_RESTARTS_REPEATEDLY: "restarts again and again. Check its supply. Further restarts are not reported",
    Code.HUB_SILENT: "sent nothing for {silence_s:.0f s} while others did. Battery empty, out of range or broken?",
    Code.LINK_NO_DATA_YET: (
        "open, but no data yet. Is the hub powered, awake and set to send? Are TX and RX connected correctly?"
    ),
    Code.LINK_RESUMED: "data arrives again",
    Code.LINK_SILENT: (
        "open, but no data for {silence_s:.0f s}. Is the hub powered, awake and set to send? Are TX and RX "
        "connected correctly?"
    ),
    Code.NEWER_FRAME_LAYOUT: (
        "frames of a layout newer than protocol {own} are skipped and counted: the firmware is newer. Update treadlink"
    ),
    Code.NEWER_PROTOCOL: (
        "its firmware uses protocol {version}, newer than treadlink's {own}. What both support is read, the rest "
        "is skipped and counted. Update treadlink"
    ),
    Code.NO_FRAMES: "data arrives, but it contains no frame ({frames:d} before): {content}",
    Code.NO_HELLO: (
        "samples arrive, but no hello for {silence_s:.0f s}: without rate and scale nothing can be estimated. A "
        "hub sends a hello every 2 s. Restart the hub or update its firmware"
    ),
    Code.SENSOR_SILENT: (
        "its sensor sent nothing for {silence_s:.0f s} while others did. Battery empty, out of range or broken?"
    ),
    Code.SENDS_AGAIN: "sends again after {away_s:.1f s}",
    # - Content of a line without frames
    Code.CHECK_SOURCE_ADDRESS: "Check the address of the source",
    Code.CHOOSE_HUB_PORT: "Choose the hub's port; `treadlink doctor` lists the ports",
    Code.LINE_ALL_FRAMES_DAMAGED: (
        "frames start, but all are damaged: a bad cable or ground, an overrun, or firmware with a wrong CRC "
        "(`treadlink protocol` prints test vectors)"
    ),
    Code.LINE_CONSTANT: (
        "every byte is {byte:#04x}: the line is held at one level. Is the hub powered, and are its data wire and "
        "ground connected?"
    ),
    Code.LINE_GPS_RECEIVER: "this is a GPS receiver (NMEA text), not a hub. {remedy}",
    Code.LINE_NOT_A_HUB: "this is not a hub. {remedy}",
    Code.LINE_TEXT: "this is another device, which sends text: '{line}'. {remedy}",
    Code.LINE_UBLOX_RECEIVER: "this is a u-blox receiver, not a hub. {remedy}",
    Code.LINE_WRONG_BAUD_RATE: (
        "wrong baud rate, or another device on the port. Set the hub's rate, for example ?baudrate=115200; the "
        "default is {default_baud:d}"
    ),
    # - Wheels and their sensors
    Code.SENSOR_REPLACED: "sensor {sensor} is here, but the configuration names {expected}: a new sensor or tire?",
    Code.SENSOR_SWAPPED: (
        "sensor {sensor} of {owner} is here: wheels swapped? Estimates use load and tire of {position}"
    ),
    Code.WHEEL_ADDRESS: "{position} (hub {hub:d}, wheel {wheel:d})",
    Code.WHEEL_NOT_CONFIGURED: (
        "not configured: belt radius {radius_m:g mm} assumed, load unknown; give --config VEHICLE.toml"
    ),
    Code.WHEEL_NOT_IN_CONFIGURATION: (
        "not configured (the configuration has {configured}): belt radius {radius_m:g mm} assumed, load unknown"
    ),
    # - Sessions and commands
    Code.ASSUMED_NOT_MEASURED: "assumed, not measured: {text}",
    Code.COMMAND_FAILED: "the command failed",
    Code.COMMAND_OUTCOME: "outcome {outcome:d}",
    Code.COMMAND_REFUSED: "did not execute {command}: {outcome}",
    Code.COMMAND_UNKNOWN: "unknown command",
    Code.COMMAND_VALUE_REFUSED: "value refused",
    Code.DECODING_BEHIND: (
        "this computer is too slow to decode and estimate; the recording is complete. Dropped data is counted"
    ),
    Code.EFFECTS_SUBTRACTED: "subtracted from its axes at {ranges}: {effects}",
    Code.HUB_LOG: "{severity}: {text}",
    Code.LOAD_RANGE: "{low_n:.0f} to {high_n:.0f N}",
    Code.PRESSURE_RANGE: "{low_pa:.0f kPa} to {high_pa:.0f kPa}",
    Code.RECORDING_BEHIND: "the disk is too slow: bytes are MISSING FROM THE RECORDING. Dropped data is counted",
    Code.RECORDING_STOPPED: "RECORDING STOPPED: {error}. {remedy}",
    Code.SPEED_RANGE: "{low_mps:.0f km/h} to {high_mps:.0f km/h}",
    Code.TOPICS_BEHIND: (
        "the disk is too slow: decoded values are left out of the recording, raw bytes are kept. Dropped data is "
        "counted"
    ),
    Code.VIEW_BEHIND: "the screen is too slow: lines are left out. Dropped data is counted",
    # - Recordings of a campaign
    Code.AXIS_CONSTANT: "the {axis} axis reads one value throughout {count:d} revolutions, dead or stuck: left out",
    Code.DIFFERENT_SENSORS: "the recordings are of different sensors: {sensors}",
    Code.RECORDING_DAMAGED: "{damage} The readable part is used",
    Code.RECORDING_ORDER_UNKNOWN: (
        "the recordings' times do not give their order: taken one after another, in the order given"
    ),
    Code.RECORDING_WITHOUT_DATA: "contains nothing that can be used",
    Code.REVOLUTIONS_LEFT_OUT: "{revolutions} revolutions left out: {reason}",
    Code.ABOUT_RECORDING: "{recording}: {reason}",
    Code.SEVERAL_SENSORS: "several",
    # - Provenance of conditions
    Code.ASSUMED_LOAD: "load {load_n:.0f N} (not stated)",
    Code.ASSUMED_PRESSURE: "pressure {pressure_pa:.0f kPa} (neither stated nor measured)",
    Code.ASSUMED_RADIUS: "belt radius {radius_m:g mm} (no configuration states it)",
    Code.ASSUMED_TEMPERATURE: "temperature steady (neither stated nor measured)",
    Code.FROM_CONFIGURATION: "--config",
    Code.FROM_CONFIGURATION_DEFAULT: "default, as {source} does not give it",
    Code.FROM_RECORDING: "configuration recorded with it",
    Code.FROM_SENSOR: "measured by the sensor",
    Code.OF_RECORDINGS: "{statement}: {recordings}",
    Code.STATED_LOAD: "load {load_n:.0f N} ({source})",
    Code.STATED_LOAD_RANGE: "load {low_n:.0f} to {high_n:.0f N} ({source})",
    Code.STATED_OFFSET: "mounting offset {offset_m:g mm} below the neutral layer ({source})",
    Code.STATED_PITCH: "mounting pitch {pitch_rad:g deg} ({source})",
    Code.STATED_PRESSURE: "pressure {pressure_pa:.0f kPa} ({source})",
    Code.STATED_PRESSURE_RANGE: "pressure {low_pa:.0f} to {high_pa:.0f kPa} ({source})",
    Code.STATED_RADIUS: "belt radius {radius_m:g mm} ({source})",
    Code.STATED_ROLL: "mounting roll {roll_rad:g deg} ({source})",
    # Security
    Code.COUNTERS_NOT_SAVED: "frames of this session could be replayed to the next one: {error}. {remedy}",
    Code.COUNTERS_SAVED_LATE: (
        "frames of this session could be replayed to the next one: the counters of the sensors could not be "
        "written in time"
    ),
    Code.FRAMES_IGNORED: "ignored, but recorded",
    Code.FRAMES_NOT_TRUSTED: "frames not to be trusted: {counts}",
    Code.FRAMES_USED: "used all the same (policy warn)",
    Code.FRAMES_VERDICT: "{count:d} {verdict}",
    Code.FRAME_BEFORE_HELLO: "signed frames arrive, but no verified hello ({count:d} so far); {consequence}",
    Code.FRAME_LATE: (
        "a frame arrived long after later ones ({count:d} so far): a recording of the sensor may be replayed; "
        "{consequence}"
    ),
    Code.FRAME_NO_KEY: (
        "frames are signed by {signer}, whose key is missing ({count:d} so far); `treadlink keys import` admits "
        "it; {consequence}"
    ),
    Code.FRAME_REPLAYED: (
        "a frame arrived twice ({count:d} so far): a recording of the sensor may be replayed; {consequence}"
    ),
    Code.FRAME_UNSIGNED: "a frame is not signed ({count:d} so far): anyone could have sent it; {consequence}",
    Code.FRAME_WRONG_TAG: (
        "a signed frame has a wrong tag ({count:d} so far): forged, from an earlier start, or signed with another "
        "key; {consequence}"
    ),
    Code.KEY_MISSING_FRAMES_IGNORED: (
        "no key for sensor {sensor}: its frames will be ignored; add its key with `treadlink keys import`"
    ),
    Code.KEY_MISSING_FRAMES_NOT_VERIFIED: (
        "no key for sensor {sensor}: its frames cannot be verified; add its key with `treadlink keys import`"
    ),
    Code.SENSOR_NOT_ADMITTED: (
        "sensor {sensor} is here, but the configuration names {expected} ({count:d} frames so far); configure it "
        "to admit it; {consequence}"
    ),
    Code.SENSOR_NOT_ADMITTED_SWAPPED: (
        "sensor {sensor} of {owner} is here: wheels swapped? ({count:d} frames so far); {consequence}"
    ),
    Code.SENSOR_NOT_ADMITTED_UNCONFIGURED: (
        "sensor {sensor} is at a wheel that is not configured ({count:d} frames so far); configure it to admit it; "
        "{consequence}"
    ),
    Code.SIGNER_HUB: "hub {identity}",
    Code.SIGNER_SENSOR: "sensor {identity}",
    Code.SIGNER_UNKNOWN: "an unknown sensor",
    # Files and configuration
}

# Printed unit: factor from SI.
_UNITS: Final = {
    "%": 100.0,
    "deg": math.degrees(1.0),
    "degC": 1.0,
    "g": 1.0 / STANDARD_GRAVITY_MPS2,
    "GHz": 1e-9,
    "Hz": 1.0,
    "kB": 1e-3,
    "kHz": 1e-3,
    "km/h": 3.6,
    "kPa": 1e-3,
    "m": 1.0,
    "m/s²": 1.0,
    "mm": 1e3,
    "ms": 1e3,
    "N": 1.0,
    "s": 1.0,
    "us": 1e6,
}


class _Template(string.Formatter):
    """`str.format` with units of display and nested reasons."""

    def format_field(self, value: Any, format_spec: str) -> str:
        if isinstance(value, Reason):
            return text(value)
        if isinstance(value, tuple):
            return ", ".join(self.format_field(item, format_spec) for item in value)
        number, _, unit = format_spec.partition(" ")
        if unit:
            return f"{format(value * _UNITS[unit], number)} {unit}"
        return format(value, format_spec)


_FORMATTER: Final = _Template()


def text(reason: Reason) -> str:
    """Return a reason as a phrase without a full stop."""
    return _FORMATTER.vformat(TEMPLATES[reason.code], (), dict(reason.values))


def joined(reasons: Iterable[Reason]) -> str:
    """Return several reasons as one text, each once; empty when there are none."""
    return "; ".join(dict.fromkeys(text(reason) for reason in reasons))


def notice_text(notice: Notice) -> str:
    """Return a notice as one line: its subject, then its reason; a matter of security is marked as such."""
    said = f"{notice.subject}: {text(notice.reason)}" if notice.subject else text(notice.reason)
    return f"SECURITY: {said}" if notice.level is Level.SECURITY else said


def as_json(reason: Reason) -> dict[str, Any]:
    """Return a reason as JSON: code, values (SI) and text."""
    values = {name: _plain(value) for name, value in reason.values}
    return {"code": str(reason.code), "values": values, "text": text(reason)}


def fields(code: Code) -> set[str]:
    """Return the names of the values that a code's template needs."""
    return {name for _, name, _, _ in string.Formatter().parse(TEMPLATES[code]) if name}


def _plain(value: Value) -> Any:
    if isinstance(value, Reason):
        return as_json(value)
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return value
