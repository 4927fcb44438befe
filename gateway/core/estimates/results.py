"""Results per revolution and immutable snapshots of wheels, links and the session, for the views."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple

from gateway.core.estimates.estimator import Estimate, Revolution, Status, TireConditions
from gateway.core.reasons import Notice, Reason
from gateway.core.revolutions.axis_relations import Lag
from gateway.core.shown_units import ShownUnits
from gateway.core.types import FloatArray


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
class RevolutionResult:
    """Result of one revolution of one wheel.

    Attributes:
        position: wheel position from the configuration, e.g. `FL`, or `hub0.wheel2` when not configured.
        host_ns: host time of the end of the revolution, ns since the epoch.
        revolution: the revolution itself.
        conditions: load, pressure and temperature during the revolution.
        estimates: of every estimator, in running order.
        alarms: alarms that stood at the wheel; of recordings that are estimated in one pass only, as the next.
        silent_before_s: time for which its sensor was silent between the previous result and this one.
        axis_lags: of the circumferential and the lateral axis, as `AxisRelations.lags`.
    """

    position: str
    host_ns: int
    revolution: Revolution
    conditions: TireConditions
    estimates: tuple[Estimate, ...]
    alarms: tuple[Alarm, ...] = ()
    silent_before_s: float = 0.0
    axis_lags: tuple[Lag | None, Lag | None] = (None, None)


class WheelState(StrEnum):
    """Motion of a wheel, from its radial axis; silent when its samples have stopped, ended when its session has."""

    NO_DATA = "no data"
    SEARCHING = "searching"
    STANDSTILL = "standstill"
    ROLLING = "rolling"
    SILENT = "silent"
    ENDED = "ended"


class SilentPart(StrEnum):
    """What is silent, from the widest to the narrowest; a wheel that stands still is not silent."""

    LINK = "link"
    """The link is down."""
    HUB = "hub"
    """The hub sends no frame of any kind."""
    SENSOR = "sensor"
    """The hub sends, but nothing of this sensor."""
    SAMPLES = "samples"
    """The sensor sends other messages only."""
    AXIS = "axis"
    """The samples lack an axis that the hello declares."""
    ENVIRONMENT = "environment"
    """Pressure and temperature are old."""


@dataclass(frozen=True, slots=True)
class Silence:
    """A part of a wheel's stream that has stopped.

    Attributes:
        part: what is silent.
        age_s: time since the last of it, or since the session began when there was none.
        reason: the same in words.
        is_certain: False in the seconds in which it is not known yet whether more is silent.
    """

    part: SilentPart
    age_s: float
    reason: Reason
    is_certain: bool = True

    @property
    def stops_numbers(self) -> bool:
        """Whether no new revolution can come."""
        return self.part is not SilentPart.ENVIRONMENT


@dataclass(frozen=True, slots=True)
class WheelCounters:
    """Sample and revolution counts of one wheel since the session began.

    Attributes:
        samples: received.
        samples_lost: missing by their numbers.
        samples_silent: those of them that are missing in silences, in which nothing came for a second or longer.
        silent_s: time of these silences.
        samples_saturated: at the end of the range.
        samples_overwritten: not looked at in time.
        revolutions: completed.
        revolutions_rejected: by the average.
    """

    samples: int = 0
    samples_lost: int = 0
    samples_silent: int = 0
    silent_s: float = 0.0
    samples_saturated: int = 0
    samples_overwritten: int = 0
    revolutions: int = 0
    revolutions_rejected: int = 0

    @property
    def lost_while_heard(self) -> int:
        """Samples lost while the sensor was heard: silence is no loss."""
        return self.samples_lost - self.samples_silent


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
        scatter_mps2: (n,) standard deviation from revolution to revolution about it; NaN before the second.
        pressure_pa: latest measured or configured inflation pressure.
        temperature_degc: latest measured temperature.
        load_n: configured load, else the estimated one.
        stated: those of `load_n` and `pressure_pa` that are stated, not measured.
        wear_mm: tread wear; None when no estimator gives it.
        counters: sample and revolution counts.
        flags: present faults of the sensor.
        missing: why not a single revolution has come, None when one has, or when it is too early to say.
        silences: what of it is silent, the widest first.
    """

    position: str
    sensor_id: str = ""
    rate_hz: float = 0.0
    state: WheelState = WheelState.NO_DATA
    last: RevolutionResult | None = None
    average_mps2: FloatArray | None = None
    scatter_mps2: FloatArray | None = None
    pressure_pa: float | None = None
    temperature_degc: float | None = None
    load_n: float | None = None
    stated: frozenset[str] = frozenset()
    wear_mm: Estimate | None = None
    counters: WheelCounters = field(default_factory=WheelCounters)
    flags: tuple[SensorFlag, ...] = ()
    missing: Reason | None = None
    silences: tuple[Silence, ...] = ()

    def estimate(self, name: str) -> Estimate | None:
        """Return an estimate of the last revolution, None where it is invalid or no estimator gives it."""
        estimates = self.last.estimates if self.last is not None else ()
        return next((e for e in estimates if e.name == name and e.status is not Status.INVALID), None)

    @property
    def silence(self) -> Silence | None:
        """Why no new revolution can come, None while samples arrive."""
        return next((silence for silence in self.silences if silence.stops_numbers), None)

    @property
    def old_environment(self) -> Silence | None:
        """The silence of pressure and temperature, None while they are current."""
        return next((silence for silence in self.silences if silence.part is SilentPart.ENVIRONMENT), None)

    @property
    def has_current_environment(self) -> bool:
        """Whether pressure and temperature are those of now: the one rule for every view and output.

        A sensor whose samples, or an axis of them, have stopped may still send them.
        """
        silence = self.silence
        is_arriving = silence is None or (silence.part in (SilentPart.SAMPLES, SilentPart.AXIS) and silence.is_certain)
        return is_arriving and self.old_environment is None


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
        skipped: frames of unknown type or newer version, and those whose content violates the protocol.
        latency_s: delay of the newest samples against the fastest seen; None before time is known and in silence.
        queue_dropped: items that a stage could not take, by stage name.
        battery_percent: the lowest of its hubs, None when unknown.
        rssi_dbm: the lowest of its hubs' sensor links, else that of the link when it was connected; None when unknown.
        supply_w: of its hubs together, None when unknown.
        judged: frames by what the check of their signatures found; empty when signatures do not matter.
        silent_s: time since the last frame when the link is down, or every hub on it or the vehicle's bus is silent,
            else None.
        recent_loss: share of the frames lost in the last seconds, None without frames.
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
    silent_s: float | None = None
    recent_loss: float | None = None


@dataclass(frozen=True, slots=True)
class AlarmRecord:
    """An alarm over a whole session or recording.

    Attributes:
        position: as in Alarm.
        name: as in Alarm.
        reason: what was wrong, as last seen.
        count: number of times that it was raised.
        total_s: time for which it stood.
        first_s: time of its first raising, from the beginning of the session or recording.
        last_s: time at which it was last seen standing.
        is_standing: whether it stood at the end.
        is_acknowledged: whether the user has acknowledged it since it was last raised.
        raised_s: time of its last raising.
    """

    position: str
    name: str
    reason: Reason
    count: int
    total_s: float
    first_s: float
    last_s: float
    is_standing: bool
    is_acknowledged: bool = False
    raised_s: float = math.nan


@dataclass(frozen=True, slots=True)
class AlarmChange:
    """An alarm that was raised, has got another reason, was acknowledged, or is over.

    Attributes:
        alarm: with its reason; of an alarm that is over, as last seen.
        is_raised: False when it is over.
        at_s: time from the beginning of the session, in the time of its frames.
        stood_s: time for which it stood, 0 when it is raised.
        is_acknowledged: True when the user has acknowledged it, while it stands on.
    """

    alarm: Alarm
    is_raised: bool
    at_s: float
    stood_s: float = 0.0
    is_acknowledged: bool = False

    @property
    def state(self) -> str:
        """What the alarm is now: raised, acknowledged or over."""
        return "over" if not self.is_raised else "acknowledged" if self.is_acknowledged else "raised"


class SinkState(StrEnum):
    """State of a live output."""

    CONNECTING = "connecting"
    UP = "up"
    STALLED = "stalled"
    """Connected, but the receiver takes nothing."""
    DOWN = "down"
    ENDED = "ended"
    """The receiver has left and is not expected back."""


@dataclass(frozen=True, slots=True)
class SinkSnapshot:
    """Health of one live output.

    Attributes:
        sink: its URI without options.
        state: of its connection.
        note: why it is in that state.
        published: revolutions and alarms that the receiver has taken.
        dropped: revolutions and alarms that it will not get.
        waiting: revolutions and alarms in its buffer.
        since_s: time for which it has been in a state other than up, 0 when it is up.
        is_dropping: whether one was dropped in the last seconds.
    """

    sink: str
    state: SinkState
    note: Reason
    published: int = 0
    dropped: int = 0
    waiting: int = 0
    since_s: float = 0.0
    is_dropping: bool = False


class DiskRoom(NamedTuple):
    """What is left of the disk of a recording.

    Attributes:
        free_bytes: free space.
        left_s: time until it is full at the present pace, None where it does not fill up or is not known yet.
        refusal: why the recording cannot go on in its next file, empty where it can.
    """

    free_bytes: int
    left_s: float | None
    refusal: str = ""


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
        alarm_records: every alarm since the session began, in the order in which they were first raised.
        sinks: live outputs, in the order given.
        disk: what is left of the disk of the recording, None when nothing is recorded.
        units: in which screens show numbers.
    """

    elapsed_s: float
    wheels: tuple[WheelSnapshot, ...]
    links: tuple[LinkSnapshot, ...]
    alarms: tuple[Alarm, ...]
    notices: tuple[Notice, ...]
    recording: str
    recorded_bytes: int
    ended: bool
    alarm_records: tuple[AlarmRecord, ...] = ()
    sinks: tuple[SinkSnapshot, ...] = ()
    disk: DiskRoom | None = None
    units: ShownUnits = ShownUnits.SI

    def is_acknowledged(self, alarm: Alarm) -> bool:
        """Return whether the user has acknowledged a present alarm."""
        return any(
            record.is_acknowledged and record.is_standing
            for record in self.alarm_records
            if (record.position, record.name) == (alarm.position, alarm.name)
        )
