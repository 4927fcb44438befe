"""Columns of a campaign's dataset: type, unit and description of each."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import datetime
from typing import Final, NamedTuple

from gateway.quantity_catalogue import unit_of as quantity_unit
from gateway.views.tables.result_table import HEAD, OTHER, PARTS, TAIL


class Column(NamedTuple):
    """A column of a dataset.

    Attributes:
        kind: type of the cells; `datetime` is a time in ns, UTC.
        text: description.
        is_short: whether single precision is enough.
    """

    kind: type
    text: str
    is_short: bool = False


# As on a page.
_TYPESET: Final = {"m/s^2": "m/s²", "rad/s^2": "rad/s²", "m^3": "m³", "degC": "°C"}

RECORDING_PARTS: Final[dict[str, Column]] = {
    "": Column(float, "mean over the valid revolutions, weighted by their standard errors"),
    "_std": Column(
        float,
        "standard error of one revolution's value (weighted mean); revolutions share most of it; of a number that "
        "driving does not change, with the scatter where it is more than three times as large",
    ),
    "_scatter": Column(float, "standard deviation between revolutions"),
    "_count": Column(int, "revolutions in the mean"),
    "_status": Column(
        str,
        "valid; provisional where less than half of the revolutions since the first value were valid, or where the "
        "scatter is more than three times the standard error; invalid where none has a value",
    ),
    "_reason": Column(str, "why it is provisional; reasons of the last of these revolutions"),
}
"""Columns of each estimate in the table of recordings: suffix to its name."""

RECORDING_HEAD: Final[dict[str, Column]] = {
    "recording_id": Column(str, "first 32 digits of the SHA-256 of the file: the same in all tables"),
    "recording": Column(str, "name of the file when it was estimated"),
    "path": Column(str, "path of the file when it was estimated"),
    "position": Column(str, "wheel position, such as FL"),
    "sensor_id": Column(str, "serial number of the sensor in the tire, hexadecimal; empty when it was not sent"),
    "start_utc": Column(datetime, "start of the recording by its own clock, UTC"),
    "begin_utc": Column(datetime, "first data by the clock of the recorder, UTC"),
    "end_utc": Column(datetime, "last data by the clock of the recorder, UTC"),
    "hub_zero_utc": Column(
        datetime, "time at which the hub's clock was zero; the same in all recordings of one drive, whatever was cut"
    ),
    "duration_s": Column(float, "time from the first to the last data"),
    "revolutions": Column(int, "completed revolutions"),
    "revolutions_valid": Column(int, "of these, revolutions without a fault"),
    "revolutions_saturated": Column(int, "of these, revolutions with a sample at the end of the sensor's range"),
    "distance_m": Column(float, "rolled distance in completed revolutions"),
    "rolling_s": Column(float, "time in completed revolutions"),
    "speed_mean_mps": Column(float, "distance over time"),
    "speed_min_mps": Column(float, "slowest revolution"),
    "speed_max_mps": Column(float, "fastest revolution"),
    "load_n": Column(float, "vertical load as stated, mean"),
    "load_std_n": Column(float, "its standard error"),
    "pressure_pa": Column(float, "gauge pressure, mean"),
    "pressure_std_pa": Column(float, "its standard error"),
    "pressure_measured": Column(bool, "whether the sensor sent the pressure; otherwise it is stated"),
    "temperature_degc": Column(float, "temperature of the inner liner, mean"),
    "temperature_min_degc": Column(float, "lowest temperature"),
    "temperature_max_degc": Column(float, "highest temperature"),
    "radius_m": Column(float, "belt radius in use at the end: as stated, measured or assumed"),
    "stated_radius_m": Column(float, "belt radius as stated; null where none is"),
    "ring_thickness_m": Column(float, "thickness of belt and tread of the new tire as stated"),
    "reference": Column(str, "reference numbers of the new tire as stated, as JSON in SI units"),
    "load_calibration": Column(str, "calibration of the load as stated, as JSON in SI units; null without one"),
    "mounting_offset_m": Column(float, "distance of the sensor below the belt's neutral layer, in use at the end"),
    "mounting_offset_std_m": Column(float, "its standard error"),
    "rate_hz": Column(float, "sampling rate"),
    "noise_mps2": Column(float, "noise of the radial axis, mean over the valid revolutions"),
    "missing_fraction": Column(float, "share of the samples within completed revolutions that were lost, by time"),
    "samples": Column(int, "samples received"),
    "samples_lost": Column(int, "samples lost on the link, also between revolutions"),
    "samples_saturated": Column(int, "samples at the end of the sensor's range"),
    "frames": Column(int, "frames of the recording's links"),
    "frames_lost": Column(int, "frames lost on the recording's links"),
    "faults": Column(str, "faults of revolutions, as JSON: code, values, text and count"),
    "alarms": Column(
        str,
        "alarms of wheel and links, false statements of the sensor, effects of another tire, as JSON",
    ),
    "alarm_count": Column(int, "number of these alarms"),
    "missing": Column(str, "why the wheel has no revolution, as JSON; null when it has"),
    "damage": Column(str, "what of the file could not be read, as JSON; null when all was read"),
}
RECORDING_TAIL: Final[dict[str, Column]] = {
    "tire_size": Column(str, "tire size as stated"),
    "size_bytes": Column(int, "size of the file"),
    "version": Column(str, "version of treadlink that estimated it"),
    OTHER: Column(str, "estimates that the dataset has no columns for, as JSON"),
}
REVOLUTION_EXTRA: Final[dict[str, Column]] = {"recording_id": RECORDING_HEAD["recording_id"]}
FAILURE_COLUMNS: Final[dict[str, Column]] = {
    "recording_id": Column(str, "as in the other tables; null when the file cannot be read"),
    "recording": Column(str, "name of the file"),
    "path": Column(str, "path of the file"),
    "code": Column(str, "code of the reason"),
    "text": Column(str, "reason"),
    "values": Column(str, "values of the reason in SI units, as JSON"),
    "remedy": Column(str, "what to do about it"),
    "attempts": Column(int, "times that it was tried"),
    "is_final": Column(bool, "whether the file must change before it is tried again"),
    "failed_utc": Column(datetime, "time of the failure, UTC"),
    "size_bytes": Column(int, "size of the file"),
    "version": Column(str, "version of treadlink"),
}
DIAGNOSIS_COLUMNS: Final[dict[str, Column]] = {
    "position": RECORDING_HEAD["position"],
    "sensor_id": RECORDING_HEAD["sensor_id"],
    "recordings": Column(str, "paths of the recordings that were used, as a JSON list"),
    "left_out": Column(str, "recordings that were left out and why, as a JSON list: code, values and text"),
    "first_utc": Column(datetime, "start of the earliest recording, UTC"),
    "effect": Column(str, "name of an effect for which there is evidence; null in a row without any effect"),
    "verdict": Column(str, "named (identified), indistinguishable (undecided) or refused (rejected)"),
    "parameters": Column(str, "parameters of the effect, as JSON: value, std and unit by name"),
    "reason": Column(str, "why it was rejected or is undecided"),
    "rms_mps2": Column(float, "size of the effect, rms"),
    "held_out_before_mps2": Column(float, "error on held-out revolutions without effects, rms"),
    "held_out_after_mps2": Column(float, "error on held-out revolutions with the identified effects, rms"),
    "noise_floor_mps2": Column(float, "error that a perfect model would leave, rms"),
    "unexplained": Column(int, "number of residuals that no effect explains"),
    "diagnosis": Column(str, "the whole diagnosis, as `treadlink diagnose --json` writes it"),
    "code": Column(str, "code of the reason why there is no diagnosis; null when there is one"),
    "text": Column(str, "that reason"),
    "version": Column(str, "version of treadlink"),
}
_REVOLUTION_TEXT: Final = {
    "recording": "name of the file when it was estimated",
    "position": "wheel position, such as FL",
    "revolution": "running number of the wheel's revolutions",
    "device_start_s": "begin of the revolution by the hub's clock",
    "device_end_s": "end of the revolution by the hub's clock",
    "host_utc": "end of the revolution by the computer's clock, UTC",
    "host_ns": "the same since 1970",
    "acceleration_mps2": "acceleration along the road",
    "radius_m": "belt radius in use",
    "radius_std_m": "its standard error",
    "mounting_offset_m": "distance of the sensor below the belt's neutral layer",
    "mounting_offset_std_m": "its standard error",
    "load_n": "vertical load as stated",
    "load_std_n": "its standard error",
    "pressure_pa": "gauge pressure",
    "pressure_std_pa": "its standard error",
    "temperature_degc": "temperature of the inner liner",
    "missing_fraction": "share of the revolution's samples that were lost",
    "saturated": "whether a radial sample was at the end of the range",
    "ac_coupled": "whether the sensor does not pass the steady value",
    "faults": "why the revolution was not used; empty when it was",
    "silent_before_s": "time for which the sensor was silent before it",
    "alarms": "alarms at the wheel",
}
_PART_TEXT: Final = {"": "value", "_std": "standard error", "_status": "validity", "_reason": "reasons"}


def unit_of(name: str, estimates: Iterable[str] = ()) -> str:
    """Return the unit of a column: that of its suffix, or of the estimate it belongs to; empty for a pure number."""
    for estimate in estimates:
        part = name.removeprefix(estimate)
        if part in RECORDING_PARTS and name.startswith(estimate):
            if part in ("_count", "_status", "_reason"):
                return ""
            name = estimate
            break
    unit = quantity_unit(name)
    return _TYPESET.get(unit, unit)


def recording_columns(estimates: Sequence[str]) -> dict[str, Column]:
    """Return the columns of the table of recordings, one row for each recording and wheel."""
    middle = {name + part: column for name in estimates for part, column in RECORDING_PARTS.items()}
    return {**RECORDING_HEAD, **middle, **RECORDING_TAIL}


def revolution_columns(estimates: Sequence[str]) -> dict[str, Column]:
    """Return the columns of the table of revolutions: those of `treadlink estimate`, and the recording's identity."""
    plain = {name: _plain(name, kind) for name, kind in HEAD.items()}
    middle = {
        name + part: Column(kind, _PART_TEXT[part], is_short=kind is float)
        for name in estimates
        for part, kind in PARTS.items()
    }
    tail = {name: _plain(name, kind, is_short=kind is float) for name, kind in TAIL.items()}
    return {**REVOLUTION_EXTRA, **plain, **middle, **tail, OTHER: RECORDING_TAIL[OTHER]}


def _plain(name: str, kind: type, *, is_short: bool = False) -> Column:
    return Column(datetime if name == "host_utc" else kind, _REVOLUTION_TEXT.get(name, ""), is_short)
