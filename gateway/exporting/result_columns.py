"""Units and descriptions of the columns of results, by their names."""

from __future__ import annotations

from typing import Final

from gateway.exporting.export_table import Column, Kind
from gateway.quantity_catalogue import unit_of
from gateway.recording.revolution_fields import estimate_descriptions
from gateway.views.tables.result_table import HEAD, OTHER, PARTS, TAIL

_PARTS: Final = {
    "": "{}",
    "_std": "one standard error of {}",
    "_status": "valid, provisional or invalid: {}",
    "_reason": "why it is not valid, or a note: {}",
}
_DESCRIPTIONS: Final = {
    "recording": "file name of the recording",
    "position": "wheel",
    "revolution": "running number of the revolutions of the wheel",
    "device_start_s": "begin of the revolution on the clock of the hub",
    "device_end_s": "end of the revolution on the clock of the hub",
    "host_utc": "end of the revolution on the clock of the computer, UTC",
    "host_ns": "end of the revolution on the clock of the computer, since 1970",
    "acceleration_mps2": "angular acceleration times belt radius",
    "radius_m": "belt radius in use",
    "radius_std_m": "one standard error of the belt radius",
    "mounting_offset_m": "distance of the sensor below the neutral layer, in use",
    "mounting_offset_std_m": "one standard error of the distance",
    "load_n": "stated vertical load",
    "load_std_n": "one standard error of the stated load",
    "pressure_pa": "gauge pressure, measured or else stated",
    "pressure_std_pa": "one standard error of the pressure",
    "temperature_degc": "temperature of the inner liner, measured or else stated",
    "missing_fraction": "share of the samples that was lost on the link",
    "saturated": "whether the sensor reached the end of its range",
    "ac_coupled": "whether the sensor passes no steady value",
    "faults": "why the revolution is not averaged",
    "silent_before_s": "silence of the sensor before the revolution",
    "alarms": "alarms that stood at the wheel",
    OTHER: "estimates that appeared after the columns were fixed, as JSON",
}
_KINDS: Final = {str: Kind.TEXT, int: Kind.INTEGER, float: Kind.REAL, bool: Kind.FLAG}


def result_column(name: str) -> Column:
    """Return a fixed column of the results of a revolution.

    Raises:
        KeyError: there is none of this name.
    """
    kind = {**HEAD, **TAIL, OTHER: str}[name]
    return Column(name, unit_of(name.replace("_std_", "_").removesuffix("_std")), _DESCRIPTIONS[name], _KINDS[kind])


def estimate_columns(name: str) -> list[Column]:
    """Return the columns of an estimate; the description of an estimate that is not listed is its name."""
    plain = name.replace("/", "_over_")
    about = estimate_descriptions().get(plain, plain)
    return [
        Column(
            plain + part,
            unit_of(plain) if kind is float else "",
            _PARTS[part].format(about),
            _KINDS[kind],
        )
        for part, kind in PARTS.items()
    ]
