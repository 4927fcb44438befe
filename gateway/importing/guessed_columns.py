"""Columns of a measurement as a first map takes them: what each may be, and the order of the axes."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

from gateway.core.config.vehicle import ASSUMED_RADIUS_MM
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.types import FloatArray
from gateway.importing.column_names import A_MAGNITUDE, names_acceleration, other_quantity
from gateway.importing.import_map import ACCELERATION_UNITS_MPS2
from gateway.importing.sensor_groups import sensor_groups
from gateway.importing.unit_check import contact_depth, fits, no_unit_fits, revolution_lag

SCALED_UNITS: Final = {
    **dict.fromkeys(("mm/s^2", "mm/s2", "mm/s²", "mm/s**2", "mm/s/s"), ("m/s^2", 1e-3)),
    **dict.fromkeys(("cm/s^2", "cm/s2", "cm/s²", "Gal"), ("m/s^2", 1e-2)),
    **dict.fromkeys(("ft/s^2", "ft/s2", "ft/s²"), ("m/s^2", 0.3048)),
    **dict.fromkeys(("in/s^2", "in/s2", "in/s²"), ("m/s^2", 0.0254)),
    **dict.fromkeys(("µg", "μg", "ug"), ("g", 1e-6)),
}
"""Units of accelerations that a map states by another one and a scale."""
# Units that the size of a column may show; they are a factor of 9.8 apart.
_BY_SIZE: Final = {**{name: ACCELERATION_UNITS_MPS2[name] for name in ("m/s^2", "g", "mg")}, "mm/s^2": 1e-3}
ROLES: Final = {
    "radial": re.compile(r"radial", re.IGNORECASE),
    "circumferential": re.compile(r"circumf|tangent|longitud", re.IGNORECASE),
    "lateral": re.compile(r"lateral|(^|[^a-z])quer", re.IGNORECASE),
}
# Short forms, which beside a named acceleration name another axis; alone they may be of a position.
SHORT_ROLES: Final = {
    "circumferential": re.compile(r"(^|[^a-z])(tang?|circ|long?)([^a-z]|$)", re.IGNORECASE),
    "lateral": re.compile(r"(^|[^a-z])lat([^a-z]|$)", re.IGNORECASE),
}
POSITION: Final = re.compile(r"(?:^|[^a-z0-9])(fl|fr|rl|rr|vl|vr|hl|hr|w\d{1,2})(?:[^a-z0-9]|$)", re.IGNORECASE)
_GERMAN: Final = {"VL": "FL", "VR": "FR", "HL": "RL", "HR": "RR"}
SPEED: Final = re.compile(r"speed|veloc|geschw|(^|[^a-z])v([^a-z]|$)|kmh|km/h", re.IGNORECASE)
ROTATION: Final = re.compile(r"rpm|drehz|rotat|(^|[^a-z])n([^a-z]|$)|omega", re.IGNORECASE)
ANGLE: Final = re.compile(r"angle|winkel|encoder|phi|theta", re.IGNORECASE)
PULSES: Final = re.compile(r"tach|puls|trig|index|hall", re.IGNORECASE)
# Channels of a rig, by name; their units are those of the quantity.
RIG: Final = {
    "side_force": re.compile(
        r"(^|[^a-z])f_?y([^a-z]|$)|(side|lateral|cornering)[ _-]?force|seiten(führungs)?kraft", re.IGNORECASE
    ),
    "load": re.compile(
        r"(^|[^a-z])f_?z([^a-z]|$)|(wheel|vertical|normal)[ _-]?(load|force)|radlast|^load|kraft", re.IGNORECASE
    ),
    "slip_angle": re.compile(r"slip[ _-]?angle|schr(ä|ae)glauf|(^|[^a-z])(alpha|sa)([^a-z]|$)", re.IGNORECASE),
    "camber": re.compile(r"camber|inclination|sturz|(^|[^a-z])(gamma|ia)([^a-z]|$)", re.IGNORECASE),
    "torque": re.compile(r"torque|moment|(^|[^a-z])m_?[yz]([^a-z]|$)", re.IGNORECASE),
}
PRESSURE: Final = re.compile(r"press|druck|(^|[^a-z])p([^a-z]|$)", re.IGNORECASE)
TEMPERATURE: Final = re.compile(r"temp|(^|[^a-z])t([^a-z]|$)", re.IGNORECASE)
TIME: Final = re.compile(
    r"time|zeit|stamp|elapsed|millis|micros|seconds|sekunden|^t$|tiempo|tempo(?![a-z])|(?<![a-z])temps(?![a-z])|"
    r"(?<![a-z])(?:ts|ticks?|tijd|tid|czas)(?![a-z])|[时時][间間刻]|время",
    re.IGNORECASE,
)
VOLTS: Final = frozenset({"V", "mV"})
MOST_COLUMNS: Final = 64
_LARGEST: Final = 1e30
# A sensor that a number alone or a group of the file names is a wheel by its number.
_NAMED: Final = re.compile(r"(?!group)[A-Za-z][A-Za-z0-9_.-]*", re.IGNORECASE)
_LAG_S: Final = 1.0


@dataclass(slots=True)
class Seen:
    """One column.

    Attributes:
        name: its name.
        values: (n,) its first rows.
        unit: unit that the file states, empty without one.
        where: returns the place of a row for messages.
        fault: place and text of its first unreadable cell, empty without one.
    """

    name: str
    values: FloatArray
    unit: str
    where: Callable[[int], str]
    fault: str = ""

    def __post_init__(self) -> None:
        """Leave values out that no sensor gives, whose squares would be no numbers."""
        self.values = np.where(np.abs(self.values) < _LARGEST, self.values, np.nan)

    @property
    def is_acceleration(self) -> bool:
        """Whether its unit is that of an acceleration."""
        return self.unit in ACCELERATION_UNITS_MPS2 or self.unit in SCALED_UNITS

    @property
    def unit_mps2(self) -> float | None:
        """Size of its unit, None where it states none of an acceleration."""
        unit, scale = SCALED_UNITS.get(self.unit, (self.unit, 1.0))
        factor = ACCELERATION_UNITS_MPS2.get(unit)
        return None if factor is None else factor * scale

    @property
    def says_acceleration(self) -> bool:
        """Whether its unit says an acceleration, or its name where it has no unit."""
        if self.unit or self.is_acceleration:
            return self.is_acceleration and other_quantity(self.name) != A_MAGNITUDE
        others = (TEMPERATURE, PRESSURE, PULSES, ANGLE, SPEED, ROTATION)
        named = names_acceleration(self.name) or any(role.search(self.name) for role in ROLES.values())
        return named and not any(pattern.search(self.name) for pattern in others)


@dataclass(slots=True)
class Axis:
    """A column taken for an axis.

    Attributes:
        seen: the column.
        unit: unit by the file or by magnitude, empty when neither says it.
        why: reason for the unit.
        steady: mean in its own unit.
        depth: depth of the contact in its own unit, negative where the contact points up; without revolutions that of
            the largest peaks.
        is_rolling: whether revolutions are seen.
        scale: size of 1 in its unit by V²/R, where no unit fits by far.
        swing: standard deviation.
        doubt: why it may not be the radial axis, empty without a reason.
    """

    seen: Seen
    unit: str
    why: str
    steady: float
    depth: float
    swing: float
    doubt: str
    is_rolling: bool
    scale: float | None = None

    @property
    def is_steady(self) -> bool:
        """Whether it has a steady part, so that its mean says its direction."""
        return abs(self.steady) > 0.3 * abs(self.depth)


@dataclass(slots=True)
class Reference:
    """A column taken for a reference.

    Attributes:
        seen: the column.
        quantity: what it measures.
        unit: its unit, empty where neither file nor values say it.
        doubt: why the quantity or the unit is not certain, empty where it is.
    """

    seen: Seen
    quantity: str
    unit: str
    doubt: str


@dataclass(slots=True)
class Guess:
    """Sorted columns.

    Attributes:
        time: name of the time column, None without one.
        time_unit: its unit.
        time_doubt: what is doubtful about it, empty where nothing is.
        time_fault: its first unreadable cell, empty without one.
        no_time: why a column of times cannot be used, None without one.
        rate_hz: sampling rate, None where it is unknown.
        stated_rate: where the file states the rate, empty where it comes from times or is unknown.
        since_1970_s: time of the first row since 1970, None where the times have another zero.
        is_dated: whether times of dates are no times of day alone.
        date_order: of year, month and day in dates, with `?` where it is not certain.
        candidates: columns that may be accelerations.
        missed: columns whose name or unit says an acceleration, and that cannot be read.
        references: reference columns.
        environment: column of the `pressure` with its unit, that of the `temperature` with what is doubtful about it.
        others: (name, reason) of the columns that are not used.
        groups: groups of the file, as in its facts.
        stated: conditions that the file states: key of the map, its value in TOML, and where it stands.
        mv_per_g: sensitivity that the file states, None without one.
        identities: column of the sensor that a row is of, with its values; None without one.
    """

    time: str | None = None
    time_unit: str = "s"
    time_doubt: str = ""
    time_fault: str = ""
    no_time: str | None = None
    rate_hz: float | None = None
    stated_rate: str = ""
    since_1970_s: float | None = None
    is_dated: bool = True
    date_order: str = "ymd"
    candidates: list[Seen] = field(default_factory=list)
    missed: list[str] = field(default_factory=list)
    references: list[Reference] = field(default_factory=list)
    environment: dict[str, tuple[Seen, str]] = field(default_factory=dict)
    others: list[tuple[str, str]] = field(default_factory=list)
    groups: Mapping[str, Sequence[str]] = field(default_factory=dict)
    stated: list[tuple[str, str, str]] = field(default_factory=list)
    mv_per_g: float | None = None
    identities: tuple[str, tuple[str, ...]] | None = None


def names_role(name: str, role: str) -> bool:
    """Return whether the name of an acceleration says its axis, also in a short form."""
    short = SHORT_ROLES.get(role)
    return ROLES[role].search(name) is not None or (short is not None and short.search(name) is not None)


def ordered_axes(columns: Sequence[Seen], rate_hz: float | None) -> list[Axis]:
    """Return the columns as axes, the most likely radial one first."""
    return sorted(
        (_axis(column, rate_hz) for column in columns),
        key=lambda axis: (
            not ROLES["radial"].search(axis.seen.name),
            # The mean of volts is their reading at zero acceleration.
            -max(abs(axis.steady) * (axis.seen.unit not in VOLTS), abs(axis.depth), 1e-3 * axis.swing),
        ),
    )


class _Revolutions(NamedTuple):
    """The part of a column with the largest scatter, and what its revolutions say; NaN where it shows none.

    Attributes:
        values: (n,) the part.
        expected_mps2: V²/R.
        down: depth of the contact in the column's unit.
        up: the same of the reversed column.
    """

    values: FloatArray
    expected_mps2: float
    down: float
    up: float

    @classmethod
    def of(cls, values: FloatArray, rate_hz: float | None) -> "_Revolutions":
        part = _liveliest(values, rate_hz)
        lag = None if rate_hz is None else revolution_lag(part, rate_hz, ASSUMED_RADIUS_MM * 1e-3)
        if lag is None or rate_hz is None:
            return cls(part, math.nan, math.nan, math.nan)
        expected_mps2 = (2.0 * math.pi * rate_hz / lag) ** 2 * ASSUMED_RADIUS_MM * 1e-3
        return cls(part, expected_mps2, contact_depth(part, lag), contact_depth(-part, lag))

    def fits(self, size_mps2: float) -> bool:
        """Return whether a size is that of V²/R."""
        return size_mps2 > 0.0 and fits(size_mps2, self.expected_mps2)


def _axis(column: Seen, rate_hz: float | None) -> Axis:
    revolutions = _Revolutions.of(column.values, rate_hz)
    is_periodic = not math.isnan(revolutions.expected_mps2)
    low, middle, high = np.nanpercentile(revolutions.values, (1.0, 50.0, 99.0))
    down, up = (revolutions.down, revolutions.up) if is_periodic else (middle - low, high - middle)
    steady, depth = float(np.nanmean(revolutions.values)), float(down if down >= up else -up)
    unit, reason = (column.unit, "stated in the file") if column.is_acceleration else ("", "")
    doubt, scale = column.fault, None
    if is_periodic:
        expected_mps2, largest = revolutions.expected_mps2, max(abs(steady), abs(depth))
        for name in () if column.unit else _BY_SIZE:
            if revolutions.fits(largest * _BY_SIZE[name]):
                unit, reason = name, f"by magnitude: V²/R of its revolutions is {expected_mps2:.0f} m/s²"
        size = largest * (column.unit_mps2 or _BY_SIZE.get(unit, 1.0))
        if not doubt and not (unit and revolutions.fits(size)):
            mismatch = f"its mean and contact are {size:.0f}" if unit else f"no unit makes {size:.4g} fit"
            doubt = f"V²/R of its revolutions is {expected_mps2:.0f} m/s², {mismatch}"
        # The contact's depth holds no reading at zero acceleration.
        depth_mps2 = abs(depth) * (column.unit_mps2 or _BY_SIZE.get(unit, STANDARD_GRAVITY_MPS2))
        if depth_mps2 > 0.0 and ((not unit and column.unit) or no_unit_fits(depth_mps2 / expected_mps2)):
            scale = expected_mps2 / depth_mps2
    return Axis(column, unit, reason, steady, depth, float(np.nanstd(revolutions.values)), doubt, is_periodic, scale)


def _liveliest(values: FloatArray, rate_hz: float | None) -> FloatArray:
    """Return the second with the largest scatter: over a longer time the speed may change."""
    rows = len(values) if rate_hz is None else min(len(values), round(_LAG_S * rate_hz))
    parts = [values[first : first + rows] for first in range(0, len(values) - rows + 1, rows)]
    measured_parts = [part for part in parts if np.isfinite(part).any()]
    return max(measured_parts, key=lambda part: float(np.nanstd(part)), default=values)


def position_of(name: str) -> str:
    """Return the wheel in a name, `W1` where it names none."""
    match = POSITION.search(name)
    position = match[1].upper() if match else "W1"
    return _GERMAN.get(position, position)


def by_wheel(columns: Sequence[Seen], groups: Mapping[str, Sequence[str]]) -> dict[str, list[Seen]]:
    """Return the columns by the wheel in their names, or else by their sensor; `W1` where there is only one."""
    wheels: dict[str, list[Seen]] = {}
    sensors = {} if any(POSITION.search(column.name) for column in columns) else _sensors(columns, groups)
    for column in columns:
        wheels.setdefault(sensors.get(column.name, position_of(column.name)), []).append(column)
    unnamed = wheels.get("W1", [])
    if not sensors and len(wheels) > 1 and not any(POSITION.search(column.name) for column in unnamed):
        wheels.pop("W1", None)
    return wheels


def _sensors(columns: Sequence[Seen], groups: Mapping[str, Sequence[str]]) -> dict[str, str]:
    """Return a name for the sensor of each column, where they are of several."""
    column_groups = sensor_groups([column.name for column in columns], groups)
    labels = {label: re.sub(r"[^A-Za-z0-9_.-]+", "_", label).strip("_.-")[:24] for label in column_groups.values()}
    if len(set(labels.values())) < len(labels) or not all(_NAMED.fullmatch(name) for name in labels.values()):
        labels = {label: f"W{number}" for number, label in enumerate(labels, 1)}
    return {name: labels[label] for name, label in column_groups.items()}


def is_rolling(values: FloatArray, rate_hz: float, unit_mps2: float | None) -> bool:
    """Return whether values repeat as those of a rolling wheel whose V²/R fits, in a unit or in any."""
    revolutions = _Revolutions.of(values, rate_hz)
    size = max(abs(float(np.nanmean(revolutions.values))), revolutions.down, revolutions.up)
    units = (unit_mps2,) if unit_mps2 is not None else _BY_SIZE.values()
    return any(revolutions.fits(size * unit) for unit in units)
