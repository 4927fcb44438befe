"""Signals of the vehicle, such as steering, speed and position, at the times of revolutions."""

import math
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, NamedTuple

from gateway.core.constants import STANDARD_GRAVITY_MPS2

# Values kept for revolutions that are not complete yet: a minute at 200 Hz, and what is kept when they are thinned out.
_MOST_VALUES: Final = 24_000
_KEPT_VALUES: Final = 12_000
# Relative standard errors of a car's speeds of rotation, its yaw rate and other speeds, unless stated.
_ROTATION_STD: Final = 0.005
_YAW_STD: Final = 0.02
_SPEED_STD: Final = 0.01
# Standard error of a yaw rate of zero: the drift of its sensor.
_YAW_ZERO_RADPS: Final = 0.005
# Least time over which a course changes: the error of its rate is that of a receiver that sends once a second.
_COURSE_SPAN_NS: Final = 900_000_000
_TURN_DEG, _TURN_RAD = 360.0, 2.0 * math.pi


class Quantity(StrEnum):
    """What a signal of the vehicle measures."""

    WHEEL_SPEED = "wheel_speed"
    VEHICLE_SPEED = "vehicle_speed"
    GROUND_SPEED = "ground_speed"
    LATITUDE = "latitude"
    LONGITUDE = "longitude"
    COURSE = "course"
    STEERING_ANGLE = "steering_angle"
    BRAKE_PRESSURE = "brake_pressure"
    BRAKE = "brake"
    ACCELERATION_X = "acceleration_x"
    ACCELERATION_Y = "acceleration_y"
    ACCELERATION_Z = "acceleration_z"
    YAW_RATE = "yaw_rate"
    TORQUE = "torque"


class Unit(NamedTuple):
    """Suffix of names in SI, and the factor to SI."""

    suffix: str
    factor: float


UNITS: Final[dict[str, Unit]] = {
    "km/h": Unit("mps", 1.0 / 3.6),
    "kph": Unit("mps", 1.0 / 3.6),
    "m/s": Unit("mps", 1.0),
    "rpm": Unit("radps", math.pi / 30.0),
    "1/min": Unit("radps", math.pi / 30.0),
    "rad/s": Unit("radps", 1.0),
    "Hz": Unit("radps", 2.0 * math.pi),
    "deg/s": Unit("radps", math.pi / 180.0),
    "deg": Unit("rad", math.pi / 180.0),
    "degree": Unit("rad", math.pi / 180.0),
    "°": Unit("rad", math.pi / 180.0),
    "rad": Unit("rad", 1.0),
    "bar": Unit("pa", 1e5),
    "kPa": Unit("pa", 1e3),
    "Pa": Unit("pa", 1.0),
    "g": Unit("mps2", STANDARD_GRAVITY_MPS2),
    "m/s^2": Unit("mps2", 1.0),
    "m/s2": Unit("mps2", 1.0),
    "m/s²": Unit("mps2", 1.0),
    "N": Unit("n", 1.0),
    "Nm": Unit("nm", 1.0),
    "degC": Unit("degc", 1.0),
    "%": Unit("", 0.01),
    "s": Unit("s", 1.0),
    "1": Unit("", 1.0),
    "": Unit("", 1.0),
}
"""Units of signals; temperatures stay in degrees Celsius."""

POSITION_UNITS: Final[dict[str, Unit]] = {
    **dict.fromkeys(("deg", "degree", "°", "degrees"), Unit("deg", 1.0)),
    **dict.fromkeys(("min", "minutes", "'"), Unit("deg", 1.0 / 60.0)),
}
"""Units of latitude and longitude, which stay in degrees as maps and receivers have them."""

SUFFIXES: Final[dict[Quantity, frozenset[str]]] = {
    Quantity.WHEEL_SPEED: frozenset({"radps", "mps"}),
    Quantity.VEHICLE_SPEED: frozenset({"mps"}),
    Quantity.GROUND_SPEED: frozenset({"mps"}),
    Quantity.LATITUDE: frozenset({"deg"}),
    Quantity.LONGITUDE: frozenset({"deg"}),
    Quantity.COURSE: frozenset({"rad"}),
    Quantity.STEERING_ANGLE: frozenset({"rad"}),
    Quantity.BRAKE_PRESSURE: frozenset({"pa"}),
    Quantity.BRAKE: frozenset({""}),
    Quantity.ACCELERATION_X: frozenset({"mps2"}),
    Quantity.ACCELERATION_Y: frozenset({"mps2"}),
    Quantity.ACCELERATION_Z: frozenset({"mps2"}),
    Quantity.YAW_RATE: frozenset({"radps"}),
    Quantity.TORQUE: frozenset({"nm"}),
}
"""Units of names that fit a quantity."""


@dataclass(frozen=True, slots=True)
class SignalSetup:
    """A signal as configured.

    Attributes:
        quantity: what it measures.
        message: name of its message in the DBC file.
        signal: name in the message.
        wheel: position of its wheel, None for the whole vehicle.
        unit: of its physical value, None for that of the DBC file.
        factor: multiplies the value.
        relative_std: relative standard error of a speed, None where not stated.
    """

    quantity: Quantity
    message: str
    signal: str
    wheel: str | None = None
    unit: str | None = None
    factor: float = 1.0
    relative_std: float | None = None


@dataclass(frozen=True, slots=True)
class VehicleSignal:
    """A signal with its unit.

    Attributes:
        name: with the unit, such as `vehicle_speed_mps`; of a wheel's own signal as `car_wheel_speed_radps`.
        quantity: what it measures.
        suffix: unit of the name.
        wheel: position of its wheel, None for the whole vehicle.
        relative_std: relative standard error of a speed or yaw rate, None where not stated.
        max_age_s: time after the last value from which there is none.
    """

    name: str
    quantity: Quantity
    suffix: str
    wheel: str | None
    relative_std: float | None
    max_age_s: float

    @property
    def age_name(self) -> str:
        """Name of its age."""
        return f"{self.name.removesuffix(f'_{self.suffix}') if self.suffix else self.name}_age_s"

    @property
    def is_witness(self) -> bool:
        """Whether it is a speed to compare a wheel's with."""
        return self.quantity in (Quantity.WHEEL_SPEED, Quantity.VEHICLE_SPEED, Quantity.GROUND_SPEED)

    def std(self, value: float) -> float:
        """Return the standard error of a value, NaN where it is not known."""
        if self.suffix == "deg":
            return _POSITION_STD_M / _M_PER_DEG
        if self.quantity is Quantity.YAW_RATE:
            return math.hypot(self.usual_std * value, _YAW_ZERO_RADPS)
        if not self.is_witness:
            return math.nan
        if self.relative_std is None and self.quantity is Quantity.GROUND_SPEED:
            return max(_SPEED_STD * abs(value), GROUND_SPEED_STD_MPS)
        return self.usual_std * abs(value)

    @property
    def usual_std(self) -> float:
        """Relative standard error of a speed that is not too low for it, or of a yaw rate."""
        if self.relative_std is not None:
            return self.relative_std
        if self.quantity is Quantity.YAW_RATE:
            return _YAW_STD
        return _SPEED_STD if self.suffix == "mps" else _ROTATION_STD

    @property
    def key(self) -> str:
        """Name that is unique in a vehicle."""
        return self.name if self.wheel is None else f"{self.wheel}.{self.name}"


_RECEIVED: Final = (
    (Quantity.LATITUDE, "deg"),
    (Quantity.LONGITUDE, "deg"),
    (Quantity.GROUND_SPEED, "mps"),
    (Quantity.COURSE, "rad"),
)
# Receivers send once a second in general. Two intervals and a half: one value may be late or damaged.
_RECEIVER_MAX_AGE_S: Final = 2.5
# As data sheets of receivers without corrections state it.
GROUND_SPEED_STD_MPS: Final = 0.05
# Standard error of a coordinate of a receiver without corrections: half of its positions lie within 2.5 m.
_POSITION_STD_M: Final = 2.5 / math.sqrt(2.0 * math.log(2.0))
# Length of a degree of latitude, near enough for an error.
_M_PER_DEG: Final = 111_200.0

RECEIVER_SIGNALS: Final = tuple(
    VehicleSignal(f"{quantity}_{suffix}", quantity, suffix, None, None, _RECEIVER_MAX_AGE_S)
    for quantity, suffix in _RECEIVED
)
"""Signals of a positioning receiver."""
_RECEIVED_KEYS: Final = frozenset(signal.key for signal in RECEIVER_SIGNALS)


class SignalValue(NamedTuple):
    """A value as received.

    Attributes:
        key: of its signal.
        host_ns: arrival, ns since the epoch.
        value: in SI, a position in degrees.
    """

    key: str
    host_ns: int
    value: float


class Reading(NamedTuple):
    """Value of a signal at a time.

    Attributes:
        value: in SI, a position in degrees.
        age_s: time since the last value before it.
        nearest_s: time to the nearest value that it rests on.
        held_s: time for which a value was kept as it was; 0 between two values.
        slope_per_s: change of the value per second between the two latest values that it rests on, of a course over
            about a second, by the shorter way round; NaN with only one.
    """

    value: float
    age_s: float
    nearest_s: float
    held_s: float
    slope_per_s: float


class SignalHistory:
    """Latest values of every signal, by time.

    A value at a time lies on the line between the values before and after it, a position without one after it on the
    line through the two before it. Only values up to the end of the revolution count, so that the result does not
    depend on what has been read beyond it.
    """

    def __init__(self, signals: Sequence[VehicleSignal]) -> None:
        """Start without values."""
        self.signals = tuple(signals)
        self._max_age_ns = {signal.key: signal.max_age_s * 1e9 for signal in signals}
        self._first_ns: dict[str, int] = {}
        self._positions = {signal.key for signal in signals if signal.suffix == "deg"}
        self._courses = {signal.key for signal in signals if signal.quantity is Quantity.COURSE}
        self._times_ns: dict[str, list[int]] = {signal.key: [] for signal in signals}
        self._values: dict[str, list[float]] = {signal.key: [] for signal in signals}

    def add(self, key: str, host_ns: int, value: float) -> None:
        """Append a value; one that is not later than the last, or not finite, is left out."""
        times_ns, values = self._times_ns[key], self._values[key]
        if (times_ns and host_ns <= times_ns[-1]) or not math.isfinite(value):
            return
        self._first_ns.setdefault(key, host_ns)
        times_ns.append(host_ns)
        values.append(value)
        if len(times_ns) > _MOST_VALUES:
            del times_ns[:-_KEPT_VALUES], values[:-_KEPT_VALUES]

    def at(self, key: str, at_ns: int, known_ns: int) -> Reading | None:
        """Return the value at `at_ns` from values up to `known_ns`; None where there is none that is recent."""
        times_ns, values = self._times_ns[key], self._values[key]
        after = bisect_right(times_ns, at_ns)
        if not after:
            return None
        before_ns, value, max_age_ns = times_ns[after - 1], values[after - 1], self._max_age_ns[key]
        age_ns = at_ns - before_ns
        if age_ns > max_age_ns:
            return None
        if after < len(times_ns) and times_ns[after] <= known_ns and times_ns[after] - before_ns <= max_age_ns:
            interval_ns, change = times_ns[after] - before_ns, self._change(key, values[after] - value)
            nearest_s = min(age_ns, times_ns[after] - at_ns) * 1e-9
            value = self._turned(key, value + age_ns / interval_ns * change)
            return Reading(value, age_ns * 1e-9, nearest_s, 0.0, self._slope_per_s(key, after))
        slope_per_s, age_s = self._slope_per_s(key, after - 1), age_ns * 1e-9
        # A vehicle goes on: within a second it may be 50 m further.
        if key in self._positions and math.isfinite(slope_per_s):
            value = self._turned(key, value + slope_per_s * age_s)
        return Reading(value, age_s, age_s, age_s, slope_per_s)

    def _slope_per_s(self, key: str, last: int) -> float:
        times_ns, values = self._times_ns[key], self._values[key]
        span_ns = _COURSE_SPAN_NS if key in self._courses else 0
        first = min(last, bisect_right(times_ns, times_ns[last] - span_ns)) - 1
        interval_ns = times_ns[last] - times_ns[first]
        if first < 0 or interval_ns > span_ns + self._max_age_ns[key]:
            return math.nan
        return self._change(key, values[last] - values[first]) / interval_ns * 1e9

    def _change(self, key: str, change: float) -> float:
        """Return a change by the shorter way round: after 180 degrees a longitude goes on from -180."""
        if key in self._positions:
            return math.remainder(change, _TURN_DEG)
        return math.remainder(change, _TURN_RAD) if key in self._courses else change

    def _turned(self, key: str, value: float) -> float:
        """Return a longitude between -180 and 180 degrees, a course between 0 and a turn."""
        if key in self._positions:
            return math.remainder(value, _TURN_DEG)
        return value % _TURN_RAD if key in self._courses else value

    def has_begun(self, key: str, at_ns: int) -> bool:
        """Return whether a value was received by then."""
        first_ns = self._first_ns.get(key)
        return first_ns is not None and first_ns <= at_ns

    def span_ns(self, key: str) -> tuple[int, int] | None:
        """Return the first and the last time of what came with a signal, by bus or receiver; None without it."""
        if key not in self._first_ns:
            return None
        is_received = key in _RECEIVED_KEYS
        siblings = [sibling for sibling in self._first_ns if (sibling in _RECEIVED_KEYS) is is_received]
        return min(map(self._first_ns.__getitem__, siblings)), max(self._times_ns[sibling][-1] for sibling in siblings)

    def of_wheel(self, position: str) -> Iterator[VehicleSignal]:
        """Yield the signals of the vehicle and of one wheel."""
        return (signal for signal in self.signals if signal.wheel in (None, position))


def signal_name(setup: SignalSetup, suffix: str) -> str:
    """Return the name of a signal with its unit."""
    name = f"car_{setup.quantity}" if setup.wheel is not None else str(setup.quantity)
    return f"{name}_{suffix}" if suffix else name


COURSE_RATE: Final = "course_rate_radps"
"""Name of the yaw rate by the course of a receiver, positive to the left, among the estimates of a revolution."""

SIGNAL_NAMES: Final = frozenset(
    f"{prefix}{quantity}_{suffix}".rstrip("_")
    for quantity, suffixes in SUFFIXES.items()
    for suffix in suffixes
    for prefix in ("", "car_")
) | {COURSE_RATE}
"""Every name that a signal can have among the estimates of a revolution; see `signal_name`."""
