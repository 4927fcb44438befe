"""Messages between a hub and the gateway, as values. `declaration.py` declares their bytes."""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

HUB_ITSELF = 0xFF
"""Wheel number of frames that concern the hub rather than one wheel."""

EVERY_HUB = 0xFF
"""Hub number of a command that concerns every hub of the link."""


class MessageType(IntEnum):
    """Type byte of a frame."""

    HELLO = 1
    SAMPLES = 2
    ENVIRONMENT = 3
    HUB_STATUS = 4
    TIME_SYNC = 5
    LOG_TEXT = 6
    COMMAND_RESULT = 7
    CHALLENGE_ANSWER = 8
    SET_STREAM = 32
    SET_RATE = 33
    SET_TIME = 34
    CHALLENGE = 35


COMMANDS = (MessageType.SET_STREAM, MessageType.SET_RATE, MessageType.SET_TIME, MessageType.CHALLENGE)
"""Types that go from the gateway to the hub; all others come from the hub."""


class Axis(IntEnum):
    """Bit number of an axis in an axis mask; the channels of a sample follow in this order."""

    CIRCUMFERENTIAL = 0
    LATERAL = 1
    RADIAL = 2


class Coupling(IntEnum):
    """Coupling of the sensor: DC passes the steady value, AC removes it."""

    DC = 0
    AC = 1


class LogLevel(IntEnum):
    """Severity of a log text."""

    DEBUG = 0
    INFO = 1
    WARNING = 2
    ERROR = 3


class Outcome(IntEnum):
    """Outcome of a command."""

    DONE = 0
    UNKNOWN_COMMAND = 1
    VALUE_REFUSED = 2
    FAILED = 3
    NOT_VERIFIED = 4
    REPEATED = 5


class Hello(NamedTuple):
    """Identity of hub and sensor, and the format of the samples.

    Sent once per wheel at start, after a reboot, and every 2 s.

    Attributes:
        protocol_major: major protocol version of the hub's firmware.
        protocol_minor: minor protocol version of the hub's firmware.
        hub_id: serial number of the hub, 64 bit.
        sensor_id: serial number of the sensor in the tire, 32 bit.
        firmware: (major, minor, patch).
        boot_count: how often the hub has started; a change means that counters and time stamps restarted.
        rate_hz: sampling rate, 2000 to 25600.
        axes: axis mask, bit numbers of `Axis`.
        coupling: AC or DC.
        highpass_hz: corner of the AC coupling, 0 when DC.
        range_mps2: (3,) full scale per axis (indexed by `Axis`), 0 for absent axes and where it is not known.
        scale_mps2: (3,) m/s^2 per count and axis; the sign turns the axis into the protocol's direction.
        offset_counts: (3,) counts at zero acceleration per axis.
        saturation_counts: |count| at or above which a sample is saturated.
    """

    protocol_major: int
    protocol_minor: int
    hub_id: int
    sensor_id: int
    firmware: tuple[int, int, int]
    boot_count: int
    rate_hz: float
    axes: int
    coupling: Coupling
    highpass_hz: float
    range_mps2: tuple[float, float, float]
    scale_mps2: tuple[float, float, float]
    offset_counts: tuple[float, float, float]
    saturation_counts: int


class SampleBlock(NamedTuple):
    """Consecutive samples of one wheel.

    Attributes:
        first_sample: running number (32 bit, wraps) of the first sample; samples that the hub dropped are counted too.
        axes: axis mask.
        counts: (n, number of axes) little-endian int16, a view of the received bytes.
    """

    first_sample: int
    axes: int
    counts: NDArray[np.int16]


class Environment(NamedTuple):
    """Slow quantities at the inner liner.

    Attributes:
        pressure_pa: inflation pressure above ambient (gauge), or None when not available.
        temperature_degc: temperature of the inner liner, or None when not available.
        supply_v: supply of the sensor, or None when not available.
    """

    pressure_pa: float | None
    temperature_degc: float | None
    supply_v: float | None


class HubStatus(NamedTuple):
    """Health of the hub.

    Attributes:
        uptime_s: since its start.
        battery_percent: state of charge, or None when the hub has no battery.
        supply_v: supply voltage of the hub.
        supply_w: supply power of the hub.
        rssi_dbm: signal strength of its sensor link, or None when wired.
        frames_sent: frames handed to the link.
        frames_dropped: frames that the hub could not send.
        samples_dropped: samples that the hub could not send.
        link_retries: retransmissions on its sensor link.
    """

    uptime_s: int
    battery_percent: int | None
    supply_v: float
    supply_w: float
    rssi_dbm: int | None
    frames_sent: int
    frames_dropped: int
    samples_dropped: int
    link_retries: int


class TimeSync(NamedTuple):
    """The hub's clock in full.

    Attributes:
        hub_us: microseconds since the hub's start, 64 bit; its low 32 bits are the frame's time stamp.
        host_ns: latest host time received by the hub, echoed; 0 when none.
    """

    hub_us: int
    host_ns: int


class LogText(NamedTuple):
    """A line of the hub's log, UTF-8; bytes that are not UTF-8 are shown as U+FFFD."""

    level: int
    text: str


class CommandResult(NamedTuple):
    """The hub's answer to a command; its frame's time stamp is when the hub carried the command out.

    Attributes:
        seq: counter of the command's frame; with REPEATED, the highest counter that the hub has accepted.
        command: type of the command.
        outcome: a value of `Outcome`, or one that a later version defines.
    """

    seq: int
    command: int
    outcome: int


class ChallengeAnswer(NamedTuple):
    """The hub's answer to a challenge, signed with the hub's key: what a command must be signed for now.

    Attributes:
        nonce: of the challenge.
        boot_count: the present start of the hub.
        highest_seq: highest counter of a command accepted under the hub's key in this start, 0 before the first.
    """

    nonce: int
    boot_count: int
    highest_seq: int


class SetStream(NamedTuple):
    """Command: send samples, or stop sending them; everything else goes on."""

    running: bool


class SetRate(NamedTuple):
    """Command: sample at this rate, 2000 to 25600 Hz, or at the nearest that the sensor supports.

    The next hello reports the rate.
    """

    rate_hz: float


class SetTime(NamedTuple):
    """Command: take note of the host's time, ns since the epoch; time syncs echo it."""

    host_ns: int


class Challenge(NamedTuple):
    """Command: prove that the hub is there now, by repeating this random number of 64 bit under its key."""

    nonce: int


Command = SetStream | SetRate | SetTime | Challenge

COMMAND_TYPES: dict[type, MessageType] = {
    SetStream: MessageType.SET_STREAM,
    SetRate: MessageType.SET_RATE,
    SetTime: MessageType.SET_TIME,
    Challenge: MessageType.CHALLENGE,
}
"""Type byte of a command by its class."""

Message = Hello | SampleBlock | Environment | HubStatus | TimeSync | LogText | CommandResult | ChallengeAnswer | Command


class Frame(NamedTuple):
    """A frame that passed every check.

    Attributes:
        type: type byte.
        hub: number of the hub on this link.
        wheel: number of the wheel at this hub, or HUB_ITSELF.
        seq: counter of the source (hub, wheel), 32 bit, wraps.
        tick_us: hub time, low 32 bits of microseconds since its start; of the first sample for a sample block.
        message: the payload.
    """

    type: int
    hub: int
    wheel: int
    seq: int
    tick_us: int
    message: Message
