"""Results per revolution and immutable snapshots of wheels, links and the session, for the views."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from gateway.estimators.estimator import Estimate, Revolution, TireConditions
from gateway.reasons import Notice, Reason
from gateway.types import FloatArray


@dataclass(frozen=True, slots=True)
class RevolutionResult:
    """Result of one revolution of one wheel.

    Attributes:
        position: wheel position from the configuration, e.g. `FL`, or `hub0.wheel2` when not configured.
        host_ns: host time of the end of the revolution, ns since the epoch.
        revolution: the revolution itself.
        conditions: load, pressure and temperature during the revolution.
        estimates: of every estimator, in running order.
    """

    position: str
    host_ns: int
    revolution: Revolution
    conditions: TireConditions
    estimates: tuple[Estimate, ...]


class WheelState(StrEnum):
    """Motion of a wheel, from its radial axis."""

    NO_DATA = "no data"
    SEARCHING = "searching"
    STANDSTILL = "standstill"
    ROLLING = "rolling"


@dataclass(frozen=True, slots=True)
class WheelCounters:
    """Sample and revolution counts of one wheel since the session began."""

    samples: int = 0
    samples_lost: int = 0
    samples_saturated: int = 0
    samples_overwritten: int = 0
    revolutions: int = 0
    revolutions_rejected: int = 0


@dataclass(frozen=True, slots=True)
class SensorFlag:
    """Fault of a sensor, detected in its own signal.

    Attributes:
        name: one or two words.
        reason: the fault and its consequence.
    """

    name: str
    reason: Reason


@dataclass(frozen=True, slots=True)
class WheelSnapshot:
    """Latest state of one wheel, for views.

    Attributes:
        position: as in RevolutionResult.
        sensor_id: serial number as hex text, empty before a hello.
        rate_hz: sampling rate, 0 before a hello.
        state: motion of the wheel.
        last: the latest result, None before the first revolution.
        average_mps2: (n,) running average of the radial axis at the last revolution's speed, None before the first.
        pressure_pa: latest measured or configured inflation pressure.
        temperature_degc: latest measured temperature.
        load_n: configured load, else the estimated one.
        wear_mm: tread wear; None when no estimator gives it.
        counters: sample and revolution counts.
        flags: present faults of the sensor.
        missing: why not a single revolution has come, None when one has, or when it is too early to say.
    """

    position: str
    sensor_id: str = ""
    rate_hz: float = 0.0
    state: WheelState = WheelState.NO_DATA
    last: RevolutionResult | None = None
    average_mps2: FloatArray | None = None
    pressure_pa: float | None = None
    temperature_degc: float | None = None
    load_n: float | None = None
    wear_mm: Estimate | None = None
    counters: WheelCounters = field(default_factory=WheelCounters)
    flags: tuple[SensorFlag, ...] = ()
    missing: Reason | None = None


@dataclass(frozen=True, slots=True)
class LinkSnapshot:
    """Health of one link.

    Attributes:
        link: name.
        connected: whether it delivers now.
        note: the last event.
        bytes_received: since the session began.
        frames: good frames.
        crc_errors: frames with a bad CRC.
        noise_bytes: bytes outside good frames.
        frames_lost: missing by their counters.
        duplicates: frames seen twice.
        reordered: frames that came late.
        skipped: frames of unknown type or newer version.
        latency_s: delay of the newest samples against the fastest seen, or None before time is known.
        queue_dropped: items that a stage could not take, by stage name.
        battery_percent: of the hub, None when unknown.
        rssi_dbm: of the hub's sensor link, else of the link itself when it was connected; None when unknown.
        supply_w: of the hub, None when unknown.
        judged: frames by what the check of their signatures found; empty when signatures do not matter.
    """

    link: str
    connected: bool
    note: Reason
    bytes_received: int
    frames: int
    crc_errors: int
    noise_bytes: int
    frames_lost: int
    duplicates: int
    reordered: int
    skipped: int
    latency_s: float | None
    queue_dropped: Mapping[str, int]
    battery_percent: int | None = None
    rssi_dbm: int | None = None
    supply_w: float | None = None
    judged: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Alarm:
    """Something wrong now.

    Attributes:
        position: of the wheel, or name of the link.
        name: kind of the alarm, one or two words: an `AlarmName` or the name of a sensor's flag.
        reason: what is wrong.
    """

    position: str
    name: str
    reason: Reason


@dataclass(frozen=True, slots=True)
class SessionSnapshot:
    """Everything a live view may show.

    Attributes:
        elapsed_s: host time since the session began.
        wheels: in the order of the configuration.
        links: one per source.
        alarms: present alarms.
        notices: the latest notices, newest last, at most 20.
        recording: path of the recording, empty when not recording.
        recorded_bytes: its size so far.
        ended: True when every source has ended.
    """

    elapsed_s: float
    wheels: tuple[WheelSnapshot, ...]
    links: tuple[LinkSnapshot, ...]
    alarms: tuple[Alarm, ...]
    notices: tuple[Notice, ...]
    recording: str
    recorded_bytes: int
    ended: bool
