"""Columns of all tables: name, description and type, once for files, datasets and the Python interface."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Final

from gateway.core.constants import AXIS_NAMES
from gateway.core.quantity_catalogue import quantity_of
from gateway.core.quantity_catalogue import unit_of as unit_in_name

# As on a page.
_TYPESET: Final = {"m/s^2": "m/s²", "rad/s^2": "rad/s²", "m^3": "m³", "degC": "°C"}
# A column of an error or of a scatter has the unit of its quantity; the other parts of an estimate have none.
_WITH_UNIT: Final = ("_std", "_constant", "_scatter", "_expanded")


@dataclass(frozen=True, slots=True)
class Column:
    """A column.

    Attributes:
        name: with its SI unit at the end, before the suffix of a part such as `_std`.
        description: one line.
        kind: float (NaN or null where unknown), int, bool, str, or datetime: a time in ns, UTC.
        is_short: whether a dataset stores it in single precision.
    """

    name: str
    description: str
    kind: type = float
    is_short: bool = False

    @property
    def unit(self) -> str:
        """Symbol in ASCII, `m/s^2`; empty without one."""
        if self.kind not in (float, int):
            return ""
        return unit_in_name(unsuffixed(self.name))


def unsuffixed(name: str) -> str:
    """Return the name of the quantity whose error, or part of it, a column has."""
    for suffix in _WITH_UNIT:
        name = name.removesuffix(suffix)
    return name


def typeset_unit(name: str) -> str:
    """Return the unit in the name of a quantity as on a page, `m/s²`; empty for a pure number."""
    unit = unit_in_name(name)
    return _TYPESET.get(unit, unit)


def by_name(*columns: Column) -> dict[str, Column]:
    """Return columns by name, in order."""
    return {column.name: column for column in columns}


_AXES: Final = dict(
    zip(
        AXIS_NAMES,
        (
            "specific force along the tread, in the direction of travel of the sensor",
            "specific force across the tread, to the left of the vehicle",
            "specific force toward the wheel centre",
        ),
        strict=True,
    )
)
_NORMALISED: Final = "radial axis without gravity and the angular acceleration of the revolution"

SAMPLE_COLUMNS: Final = by_name(
    Column("time_s", "time since the beginning of the recording, on the clock of the computer"),
    *(Column(f"{name}_mps2", text) for name, text in _AXES.items()),
    Column("saturated", "whether an axis is at the end of the range of the sensor", bool),
    Column("lost_before", "samples lost on the link before this one", int),
    Column("number", "running number that the hub gave the sample", int),
    Column("segment", "stretch of one clock: a restart or a long gap begins a new one", int),
    Column("device_s", "time on the clock of the hub"),
    Column("host_ns", "time on the clock of the computer, since 1970", int),
    Column("host_utc", "time on the clock of the computer, UTC", datetime),
)
"""Columns of samples; each kind of table has some of them."""

RESULT_HEAD: Final = by_name(
    Column("recording", "file name of the recording", str),
    Column("position", "wheel position, such as FL", str),
    Column("revolution", "running number of the revolutions of the wheel", int),
    Column("device_start_s", "begin of the revolution, its first contact centre, on the clock of the hub"),
    Column("device_end_s", "end of the revolution, its second contact centre, on the clock of the hub"),
    Column("host_utc", "end of the revolution on the clock of the computer, UTC", datetime),
    Column("host_ns", "end of the revolution on the clock of the computer, since 1970", int),
)
"""Columns before the estimates of a revolution."""

RESULT_TAIL: Final = by_name(
    Column("acceleration_mps2", "angular acceleration times belt radius"),
    Column("radius_m", "belt radius in use"),
    Column("radius_std_m", "one standard error of the belt radius"),
    Column("mounting_offset_m", "distance of the sensor below the neutral layer, in use"),
    Column("mounting_offset_std_m", "one standard error of the distance"),
    Column("load_n", "stated vertical load"),
    Column("load_std_n", "one standard error of the stated load"),
    Column(
        "load_source", "stated where a load is: none is measured, `estimated_load_n` has the one of the signal", str
    ),
    Column("pressure_pa", "gauge pressure, measured or else stated"),
    Column("pressure_std_pa", "one standard error of the pressure"),
    Column("pressure_source", "stated or measured", str),
    Column("relative_rate_std", "one standard error of the sampling rate over it"),
    Column("relative_gain_std", "one standard error of the gain of the axes over it"),
    Column("temperature_degc", "temperature of the inner liner, measured or else stated"),
    Column("missing_fraction", "share of the samples that was lost on the link"),
    Column("saturated", "whether the sensor reached the end of its range", bool),
    Column("ac_coupled", "whether the sensor passes no steady value", bool),
    Column("faults", "why the revolution is not averaged", str),
    Column("silent_before_s", "silence of the sensor before the revolution"),
    Column("alarms", "alarms that stood at the wheel", str),
)
"""Columns after the estimates of a revolution."""

OTHER: Final = Column("other_estimates", "estimates that appeared after the columns were fixed, as JSON", str)
"""Last column of a table: estimates that have none of their own."""

ESTIMATE_PARTS: Final = by_name(
    Column("", "{}"),
    Column("_std", "one standard error of {}"),
    Column("_constant_std", "its part that revolutions share: {}"),
    Column("_scatter_std", "its part that averaging makes smaller: {}"),
    Column("_status", "valid, provisional or invalid: {}", str),
    Column("_reason", "why it is not valid, or a note: {}", str),
)
"""Columns of an estimate, by the suffix to its name; `{}` stands for its description."""

REVOLUTION_COLUMNS: Final = by_name(
    SAMPLE_COLUMNS["time_s"],
    *RESULT_HEAD.values(),
    *RESULT_TAIL.values(),
    Column("period_s", "duration of the revolution"),
    Column("speed_mps", "rolling speed, belt radius times angular speed"),
    Column("omega_radps", "mean angular speed of the revolution"),
    Column("omega_dot_radps2", "angular acceleration"),
    Column("leading_edge_rad", "angle of the leading contact edge, negative"),
    Column("leading_edge_std_rad", "one standard error of the leading contact edge"),
    Column("trailing_edge_rad", "angle of the trailing contact edge, positive"),
    Column("trailing_edge_std_rad", "one standard error of the trailing contact edge"),
    Column("noise_mps2", "noise of one sample of the normalised radial waveform"),
    Column("rate_hz", "sampling rate measured against the hub's clock"),
    Column("usable", "whether the revolution may be averaged and used for estimates", bool),
    Column("angle_rad", "angle of the sensor, 0 at the contact centre"),
    *(Column(f"{name}_mps2", text) for name, text in _AXES.items()),
    Column("normalised_mps2", _NORMALISED),
    Column("order_max", "highest order that the sampling rate carries", int),
)
"""Columns of a revolution and of its waveforms; each kind of table has some of them."""

AVERAGE_COLUMNS: Final = by_name(
    REVOLUTION_COLUMNS["angle_rad"],
    *(
        column
        for name, text in (*_AXES.items(), ("normalised", "radial axis without gravity, at the mean speed"))
        for column in (
            Column(f"{name}_mps2", f"mean of {text}"),
            Column(f"{name}_scatter_mps2", "its standard deviation from revolution to revolution"),
        )
    ),
    Column("revolutions", "number of averaged revolutions", int),
    Column("omega_radps", "mean angular speed of the revolutions"),
    Column("omega_std_radps", "standard deviation of the angular speed"),
    Column("host_ns", "beginning of the recording on the clock of the computer, since 1970", int),
)
"""Columns of the time synchronous average, one row an angle."""


EXPANDED: Final = Column("_expanded", "expanded uncertainty, coverage_factor times the standard error: {}")
COVERAGE: Final = Column("coverage_factor", "expanded uncertainty over standard error")
"""Columns where expanded uncertainties are asked for."""

CONVENTIONS: Final = {
    "axes": "ISO 8855: x forward, y to the left, z up; angles of the contact count from its centre, positive behind it",
    "uncertainty": "JCGM 100: NAME_std is a combined standard uncertainty, coverage factor 1; "
    "NAME_std^2 = NAME_constant_std^2 + NAME_scatter_std^2",
    "average": "mean over valid revolutions, weights 1 / NAME_std^2; its constant part is the weighted mean of "
    "NAME_constant_std; its scattering part falls with the root of the independent revolutions, which are one in "
    "twice the memory of a running average",
    "covariance": "of two quantities of a revolution: the sum over causes of p x u times q y u, where p and q are "
    "their powers, x and y their values and u the relative standard error of the cause (radius, relative_rate, "
    "relative_gain, load, pressure); scattering parts beside it",
}
"""How to read a file with estimates."""


def conventions(names: Iterable[str]) -> dict[str, str]:
    """Return the metadata of a file with estimates: CONVENTIONS, and what is declared of each as JSON.

    Args:
        names: of the estimates' columns.
    """
    declared = {name: quantity_of(name.removeprefix("estimated_")) for name in names}
    declarations = {
        "powers": {name: dict(quantity.powers) for name, quantity in declared.items() if quantity.powers},
        "signs": {name: quantity.sign for name, quantity in declared.items() if quantity.sign},
        "memory_revolutions": {
            name: quantity.correlated_revolutions
            for name, quantity in declared.items()
            if quantity.correlated_revolutions
        },
    }
    return CONVENTIONS | {key: json.dumps(value, ensure_ascii=False) for key, value in declarations.items()}


def estimate_columns(name: str, description: str, parts: Iterable[Column] = ESTIMATE_PARTS.values()) -> list[Column]:
    """Return the columns of an estimate."""
    return [replace(part, name=name + part.name, description=part.description.format(description)) for part in parts]


# --- the dataset of a campaign

RECORDING_PARTS: Final = by_name(
    Column("", "mean over the valid revolutions, weighted by their standard errors unless it varies"),
    Column(
        "_std",
        "standard error of one revolution's value (weighted mean); revolutions share most of it; with the scatter "
        "where that is more than three times as large: the quantity varies, as `_reason` says",
    ),
    Column("_scatter", "standard deviation between revolutions"),
    Column("_count", "revolutions in the mean", int),
    Column(
        "_status",
        "valid; provisional where less than half of the revolutions since the first value were valid, or where the "
        "scatter is more than three times the standard error; invalid where none has a value",
        str,
    ),
    Column("_reason", "why it is provisional; reasons of the last of these revolutions", str),
)
"""Columns of an estimate in the table of recordings, by the suffix to its name."""

RECORDING_HEAD: Final = by_name(
    Column("recording_id", "first 32 digits of the SHA-256 of the file: the same in all tables", str),
    Column("recording", "name of the file when it was estimated", str),
    Column("path", "path of the file when it was estimated", str),
    RESULT_HEAD["position"],
    Column("sensor_id", "serial number of the sensor in the tire, hexadecimal; empty when it was not sent", str),
    Column("start_utc", "start of the recording, by the time that its clock was set to later, UTC", datetime),
    Column("begin_utc", "first data, likewise, UTC", datetime),
    Column("end_utc", "last data, likewise, UTC", datetime),
    Column(
        "hub_zero_utc",
        "time at which the hub's clock was zero; the same in all recordings of one drive, whatever was cut",
        datetime,
    ),
    Column("duration_s", "time from the first to the last data"),
    Column("revolutions", "completed revolutions", int),
    Column("revolutions_valid", "of these, revolutions without a fault", int),
    Column("revolutions_saturated", "of these, revolutions with a sample at the end of the sensor's range", int),
    Column("distance_m", "rolled distance in completed revolutions"),
    Column("rolling_s", "time in completed revolutions"),
    Column("speed_mean_mps", "mean speed: distance over time"),
    Column("speed_min_mps", "slowest revolution"),
    Column("speed_max_mps", "fastest revolution"),
    Column("load_n", "vertical load as stated, mean"),
    Column("load_std_n", "its standard error"),
    Column("pressure_pa", "gauge pressure, mean"),
    Column("pressure_std_pa", "its standard error"),
    Column("pressure_measured", "whether the sensor sent the pressure; otherwise it is stated", bool),
    Column("temperature_degc", "temperature of the inner liner, mean"),
    Column("temperature_min_degc", "lowest temperature"),
    Column("temperature_max_degc", "highest temperature"),
    Column("radius_m", "belt radius in use at the end: as stated, measured or assumed"),
    Column("stated_radius_m", "belt radius as stated; null where none is"),
    Column("ring_thickness_m", "thickness of belt and tread of the new tire as stated"),
    Column("reference", "reference numbers of the new tire as stated, as JSON in SI units", str),
    Column("load_calibration", "calibration of the load as stated, as JSON in SI units; null without one", str),
    Column("mounting_offset_m", "distance of the sensor below the belt's neutral layer, in use at the end"),
    Column("mounting_offset_std_m", "its standard error"),
    Column("rate_hz", "sampling rate"),
    Column("noise_mps2", "noise of the radial axis, mean over the valid revolutions"),
    Column("missing_fraction", "share of the samples within completed revolutions that were lost, by time"),
    Column("samples", "samples received", int),
    Column("samples_lost", "samples lost on the link, also between revolutions", int),
    Column("samples_saturated", "samples at the end of the sensor's range", int),
    Column("frames", "frames of the recording's links", int),
    Column("frames_lost", "frames lost on the recording's links", int),
    Column("faults", "faults of revolutions, as JSON: code, values, text and count", str),
    Column(
        "alarms", "alarms of wheel and links, false statements of the sensor, effects of another tire, as JSON", str
    ),
    Column("alarm_count", "number of these alarms", int),
    Column("missing", "why the wheel has no revolution, as JSON; null when it has", str),
    Column("damage", "what of the file could not be read, as JSON; null when all was read", str),
)
RECORDING_TAIL: Final = by_name(
    Column("test", "name of the test as stated", str),
    Column("driver", "driver as stated", str),
    Column("comment", "comments on the run, one a line", str),
    Column("tags", "tags of the run, as a JSON list", str),
    Column("tire_size", "tire size as stated", str),
    Column("shown_units", "units of screens as stated: si, bar or us; the columns keep theirs", str),
    Column("tire_maker", "maker of the tire as stated", str),
    Column("tire_dot", "DOT code of the tire as stated", str),
    Column("tire_wear_m", "wear of the tire as stated with the run"),
    Column("tire_run_in_m", "distance the tire had run before, as stated"),
    Column("size_bytes", "size of the file", int),
    Column("version", "version of treadlink that estimated it", str),
    Column("other_estimates", "estimates that the dataset has no columns for, as JSON", str),
)
FAILURE_COLUMNS: Final = by_name(
    Column("recording_id", "as in the other tables; null when the file cannot be read", str),
    Column("recording", "name of the file", str),
    Column("path", "path of the file", str),
    Column("code", "code of the reason", str),
    Column("text", "reason", str),
    Column("values", "values of the reason in SI units, as JSON", str),
    Column("remedy", "what to do about it", str),
    Column("attempts", "times that it was tried", int),
    Column("is_final", "whether the file must change before it is tried again", bool),
    Column("failed_utc", "time of the failure, UTC", datetime),
    Column("size_bytes", "size of the file", int),
    Column("version", "version of treadlink", str),
)
DIAGNOSIS_COLUMNS: Final = by_name(
    RECORDING_HEAD["position"],
    RECORDING_HEAD["sensor_id"],
    Column("recordings", "paths of the recordings that were used, as a JSON list", str),
    Column("left_out", "recordings that were left out and why, as a JSON list: code, values and text", str),
    Column("first_utc", "start of the earliest recording, UTC", datetime),
    Column("effect", "name of an effect for which there is evidence; null in a row without any effect", str),
    Column("verdict", "named (identified), indistinguishable (undecided) or refused (rejected)", str),
    Column("parameters", "parameters of the effect, as JSON: value, std and unit by name", str),
    Column("reason", "why it was rejected or is undecided", str),
    Column("rms_mps2", "size of the effect, rms"),
    Column("held_out_before_mps2", "error on held-out revolutions without effects, rms"),
    Column("held_out_after_mps2", "error on held-out revolutions with the identified effects, rms"),
    Column("noise_floor_mps2", "error that a perfect model would leave, rms"),
    Column("unexplained", "number of residuals that no effect explains", int),
    Column("diagnosis", "the whole diagnosis, as `treadlink diagnose --json` writes it", str),
    Column("code", "code of the reason why there is no diagnosis; null when there is one", str),
    Column("text", "that reason", str),
    Column("version", "version of treadlink", str),
)


def recording_columns(estimates: Sequence[str]) -> dict[str, Column]:
    """Return the columns of the table of recordings, one row for each recording and wheel."""
    parts = (column for name in estimates for column in estimate_columns(name, name, RECORDING_PARTS.values()))
    return by_name(*RECORDING_HEAD.values(), *parts, *RECORDING_TAIL.values())


def revolution_columns(estimates: Sequence[str]) -> dict[str, Column]:
    """Return the columns of the table of revolutions: those of `treadlink estimate`, and the recording's identity."""
    parts = (column for name in estimates for column in estimate_columns(name, name))
    columns = (replace(column, is_short=column.kind is float) for column in (*parts, *RESULT_TAIL.values()))
    return by_name(RECORDING_HEAD["recording_id"], *RESULT_HEAD.values(), *columns, RECORDING_TAIL["other_estimates"])
