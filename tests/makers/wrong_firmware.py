"""A firmware that follows the protocol, and deliberately wrong ones: one fault each.

The faults were written down before the check that finds them: what firmware authors get wrong, with the clause.
"""

import math
import struct
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from typing import Any, Final, NamedTuple
from zlib import crc32

import numpy as np

from firmware_protocol.codec import encode_payload, encode_raw
from firmware_protocol.declaration import PAYLOADS
from firmware_protocol.messages import (
    HUB_ITSELF,
    Coupling,
    Environment,
    Hello,
    HubStatus,
    LogText,
    Message,
    MessageType,
    SampleBlock,
    TimeSync,
)
from firmware_protocol.reference_frames import payload_bytes

RATE_HZ: Final = 4000.0
BLOCK: Final = 36
WHEELS: Final = (0, 1)
DURATION_S: Final = 7.0
BLOCK_S: Final = BLOCK / RATE_HZ
HELLO: Final = Hello(
    1, 1, 0x7EAD, 0xA001, (1, 0, 0), 5, RATE_HZ, 7, Coupling.DC, 0.0, (4096.0,) * 3, (0.128,) * 3, (0.0,) * 3, 32000
)
_MASK: Final = 0xFFFF_FFFF
_PERIOD_S: Final = 0.08
_RADIUS_M: Final = 0.32


class Sent(NamedTuple):
    """A message before it has a counter: when it goes to the link (true time), and what it is."""

    time_s: float
    wheel: int
    type: int
    tick_us: int
    payload: bytes


Stream = Sequence[tuple[float, bytes]]
"""Bytes with the true time at which they go to the link."""


@cache
def counts_mps2(first: int, n: int) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return n rows of the three axes in m/s^2: R Omega^2 with a contact each turn, gravity and noise."""
    k = np.arange(first, first + n)
    turn = k / RATE_HZ / _PERIOD_S % 1.0
    steady = _RADIUS_M * (2.0 * math.pi / _PERIOD_S) ** 2
    noise = np.random.default_rng(first).normal(0.0, 2.0, (n, 3))
    contact = np.exp(-(((turn - 0.5) / 0.045) ** 6))
    edge = (turn - 0.5) / 0.045 * contact
    gravity = 2.0 * math.pi * turn
    rows = np.stack([0.4 * steady * edge + 9.8 * np.sin(gravity), 20.0 * contact, steady * (1.0 - contact)], axis=1)
    rows += noise
    rows.flags.writeable = False
    return rows


def block(first: int, n: int = BLOCK, scale: float = 0.128) -> SampleBlock:
    """Return a block of samples."""
    return SampleBlock(first & _MASK, 7, np.round(counts_mps2(first, n) / scale).astype("<i2"))


@cache
def right(duration_s: float = DURATION_S, hello: Hello = HELLO, *, rate_hz: float = RATE_HZ) -> tuple[Sent, ...]:
    """Return what a right firmware sends, in order of time."""
    sent = []

    def send(time_s: float, wheel: int, type_: MessageType, message: Message, tick_s: float | None = None) -> None:
        tick_us = round((time_s if tick_s is None else tick_s) * 1e6)
        sent.append(Sent(time_s, wheel, type_, tick_us, encode_payload(message)))

    for wheel in WHEELS:
        hello_of_wheel = hello._replace(sensor_id=hello.sensor_id + wheel)
        for k in range(math.ceil(duration_s / 2.0)):
            send(2.0 * k + 1e-5 * wheel, wheel, MessageType.HELLO, hello_of_wheel)
        for k in range(math.ceil(duration_s)):
            send(k + 0.1 + 0.01 * wheel, wheel, MessageType.ENVIRONMENT, Environment(2.3e5, 31.0, 3.0))
        for k in range(int(duration_s * rate_hz) // BLOCK):
            begin_s = 0.001 + k * BLOCK / rate_hz
            send(begin_s + BLOCK / rate_hz, wheel, MessageType.SAMPLES, block(BLOCK * k), begin_s)
    for k in range(math.ceil(duration_s)):
        send(k + 0.2, HUB_ITSELF, MessageType.HUB_STATUS, HubStatus(k, 90, 3.7, 0.08, -60, 0, 0, 0, 0))
        send(k + 0.3, HUB_ITSELF, MessageType.TIME_SYNC, TimeSync(round((k + 0.3) * 1e6), 0))
    send(0.4, HUB_ITSELF, MessageType.LOG_TEXT, LogText(1, "awake"))
    return tuple(sorted(sent))


def _with_frames_sent(message: Sent, frames_sent: int) -> Sent:
    if message.type != MessageType.HUB_STATUS:
        return message
    return message._replace(payload=message.payload[:4] + struct.pack("<I", frames_sent) + message.payload[8:])


def frames(sent: Iterable[Sent], *, boot: Callable[[Sent], bool] = lambda _: False) -> Stream:
    """Return the messages as frames, each source with a counter of its own; `boot` starts the counters anew."""
    seq: dict[int, int] = {}
    stream = []
    for index, message in enumerate(sent):
        if boot(message):
            seq.clear()
        number = seq.get(message.wheel, 0)
        seq[message.wheel] = number + 1
        stream.append((message.time_s, _frame(_with_frames_sent(message, index), number)))
    return stream


def _frame(message: Sent, seq: int) -> bytes:
    return encode_raw(message.type, message.payload, 0, message.wheel, seq & _MASK, message.tick_us & _MASK)


def _with_crc(body: bytes) -> bytes:
    return body + struct.pack("<I", crc32(body))


@cache
def right_stream() -> tuple[tuple[float, bytes], ...]:
    """Return the frames of a right firmware."""
    return tuple(frames(right()))


def _each_frame(change: Callable[[bytes], bytes]) -> Stream:
    return [(time_s, change(data)) for time_s, data in right_stream()]


def _each_message(type_: MessageType, change: Callable[[Sent], Sent | None]) -> Stream:
    changed = [change(sent) if sent.type == type_ else sent for sent in right()]
    return frames(sorted(sent for sent in changed if sent is not None))


def _payload(type_: MessageType, **fields: Any) -> bytes:
    defaults = {
        MessageType.HELLO: {
            **HELLO._asdict(),
            "coupling": int(HELLO.coupling),
            "firmware_major": 1,
            "firmware_minor": 0,
            "firmware_patch": 0,
        }
    }.get(type_, {})
    return payload_bytes(type_, {**defaults, **fields})


def _hello(**fields: Any) -> Stream:
    """Every HELLO of wheel 1 with other fields, wheel 0 right."""

    def change(sent: Sent) -> Sent:
        if sent.wheel == 0:
            return sent
        return sent._replace(payload=_payload(MessageType.HELLO, sensor_id=0xA002, **fields))

    return _each_message(MessageType.HELLO, change)


def _counters(count: Callable[[Sent, int, dict[int, int]], int]) -> Stream:
    """Frames whose counter is made of the message, its place in the stream and the counters of its source."""
    counters: dict[int, int] = {}
    stream = []
    for index, sent in enumerate(right()):
        seq = count(sent, index, counters)
        stream.append((sent.time_s, _frame(_with_frames_sent(sent, index), seq)))
    return stream


def _counted(sent: Sent, counters: dict[int, int]) -> int:
    counters[sent.wheel] = counters.get(sent.wheel, -1) + 1
    return counters[sent.wheel]


def _ticks(change: Callable[[Sent], int], types: Iterable[int] = tuple(MessageType)) -> Stream:
    wanted = frozenset(types)
    changed = [sent._replace(tick_us=change(sent)) if sent.type in wanted else sent for sent in right()]
    return frames(
        sent._replace(payload=struct.pack("<QQ", sent.tick_us, 0)) if sent.type == MessageType.TIME_SYNC else sent
        for sent in changed
    )


def _samples(change: Callable[[SampleBlock, int], SampleBlock], **hello: Any) -> Stream:
    """Change the blocks of wheel 1, given each with its place."""
    stream, position = [], 0
    for sent in right():
        message = sent
        if sent.wheel == 1 and sent.type == MessageType.SAMPLES:
            message = sent._replace(payload=encode_payload(change(block(BLOCK * position), position)))
            position += 1
        elif sent.wheel == 1 and sent.type == MessageType.HELLO and hello:
            message = sent._replace(payload=_payload(MessageType.HELLO, sensor_id=0xA002, **hello))
        stream.append(message)
    return frames(stream)


def _crc(make: Callable[[bytes], int], order: str = "<I") -> Stream:
    return _each_frame(lambda frame: frame[:-4] + struct.pack(order, make(frame[:-4]) & _MASK))


def _mpeg2(data: bytes) -> int:
    crc = _MASK
    for byte in data:
        crc ^= byte << 24
        for _ in range(8):
            crc = (crc << 1 ^ 0x04C11DB7 if crc >> 31 else crc << 1) & _MASK
    return crc


def _longer_length(by: int) -> Callable[[bytes], bytes]:
    def change(frame: bytes) -> bytes:
        return _with_crc(frame[:4] + bytes([min(frame[4] + by, 255)]) + frame[5:-4])

    return change


def _restarts(boot_count: int, *, starts_counters: bool = True) -> Stream:
    first = right(4.0)
    second = [
        sent._replace(time_s=sent.time_s + 4.0)
        for sent in right(4.0, HELLO._replace(boot_count=boot_count))
        # A boot loader takes a moment.
        if sent.time_s < 3.99
    ]
    return frames([*first, *second], boot=lambda sent: starts_counters and sent == second[0])


def _late_hello() -> Stream:
    return frames(
        sorted(
            sent._replace(time_s=sent.time_s + 0.5) if sent.type == MessageType.HELLO and sent.wheel else sent
            for sent in right()
        )
    )


def _slower(type_: MessageType, every: int, *, wheel: int | None = None) -> Stream:
    seen: dict[int, int] = {}

    def change(sent: Sent) -> Sent | None:
        if wheel is not None and sent.wheel != wheel:
            return sent
        seen[sent.wheel] = seen.get(sent.wheel, -1) + 1
        return sent if seen[sent.wheel] % every == 0 else None

    return _each_message(type_, change)


def _log(*texts: bytes) -> Stream:
    logs = [
        Sent(1.0 + 0.01 * k, HUB_ITSELF, MessageType.LOG_TEXT, 1_000_000 + 10_000 * k, text)
        for k, text in enumerate(texts)
    ]
    return frames(sorted([*right(), *logs]))


def _added(*more: Sent) -> Stream:
    return frames(sorted([*right(), *more]))


def _status(**fields: int) -> Callable[[Sent], Sent]:
    def change(sent: Sent) -> Sent:
        layout = PAYLOADS[MessageType.HUB_STATUS]
        values = zip((field.name for field in layout.fields), layout.head.unpack(sent.payload), strict=True)
        return sent._replace(payload=payload_bytes(MessageType.HUB_STATUS, {**dict(values), **fields}))

    return change


def _dropped_in_silence() -> Stream:
    """Drops frames, says so in HUB_STATUS, and does not use their numbers."""
    remaining = [
        sent
        for index, sent in enumerate(right())
        if sent.type != MessageType.SAMPLES or index % 50 or not sent.time_s > 1.0
    ]
    return frames(
        _status(frames_dropped=5 * int(s.time_s))(s) if s.type == MessageType.HUB_STATUS else s for s in remaining
    )


def _overloaded() -> Stream:
    """Loses frames on the link, as one that is too slow does."""
    return [item for index, item in enumerate(right_stream()) if index % 40 or index < 100]


def _lost_numbers() -> Stream:
    return _samples(lambda b, index: b._replace(first_sample=BLOCK * index + 400 * (index // 100)))


def _counts(change: Callable[[np.ndarray[Any, np.dtype[np.int16]]], Any]) -> Stream:
    """Change the counts of wheel 1."""
    return _samples(lambda b, _: b._replace(counts=np.asarray(change(b.counts)).astype("<i2")))


def _swapped_bytes(b: SampleBlock, _: int) -> SampleBlock:
    return b._replace(counts=b.counts.byteswap())


SAMPLES: Final = (MessageType.SAMPLES,)

WRONG: Final[dict[str, tuple[str, Callable[[], Stream]]]] = {
    # Frame
    "sync bytes swapped": ("sync", lambda: _each_frame(lambda f: f[1::-1] + f[2:])),
    "line feed after every frame": ("contiguous", lambda: _each_frame(lambda f: f + b"\r\n")),
    "CRC big endian": ("crc", lambda: _crc(crc32, ">I")),
    "CRC without the final inversion": ("crc", lambda: _crc(lambda b: crc32(b) ^ _MASK)),
    "CRC from 0": ("crc", lambda: _crc(lambda b: crc32(b, _MASK))),
    "CRC without the sync": ("crc", lambda: _crc(lambda b: crc32(b[2:]))),
    "CRC of the payload only": ("crc", lambda: _crc(lambda b: crc32(b[16:]))),
    "CRC not reflected": ("crc", lambda: _crc(_mpeg2)),
    "length counts the frame": ("length", lambda: _each_frame(_longer_length(20))),
    "length counts the CRC": ("length", lambda: _each_frame(_longer_length(4))),
    "version byte 1.1": ("version", lambda: _each_frame(lambda f: _with_crc(f[:2] + b"\x11" + f[3:-4]))),
    "version byte 1": ("version", lambda: _each_frame(lambda f: _with_crc(f[:2] + b"\x01" + f[3:-4]))),
    "a flag that is not defined": ("flags", lambda: _each_frame(lambda f: _with_crc(f[:7] + b"\x80" + f[8:-4]))),
    "a type that is not defined": ("types", lambda: _added(Sent(1.0, HUB_ITSELF, 9, 1_000_000, b"?"))),
    "a command from the hub": ("types", lambda: _added(Sent(1.0, HUB_ITSELF, 32, 1_000_000, b"\1"))),
    "HELLO with the padding of a C struct": (
        "layout",
        lambda: _each_message(MessageType.HELLO, lambda s: s._replace(payload=s.payload + b"\0\0")),
    ),
    "ENVIRONMENT without supply": (
        "layout",
        lambda: _each_message(MessageType.ENVIRONMENT, lambda s: s._replace(payload=s.payload[:6])),
    ),
    "battery of 150 %": (
        "ranges",
        lambda: _each_message(
            MessageType.HUB_STATUS, lambda s: s._replace(payload=s.payload[:26] + b"\x96" + s.payload[27:])
        ),
    ),
    "rate in kHz": (
        "ranges",
        lambda: _each_message(
            MessageType.HELLO,
            lambda s: s._replace(payload=s.payload[:24] + struct.pack("<f", 4.0) + s.payload[28:]),
        ),
    ),
    # Counters
    "one counter for all sources": ("seq", lambda: _counters(lambda sent, index, counters: index)),
    "counter stands": ("seq", lambda: _counters(lambda sent, index, counters: 0)),
    "counter of samples only": (
        "seq",
        lambda: _counters(
            lambda sent, index, counters: (
                _counted(sent, counters) if sent.type == MessageType.SAMPLES else max(counters.get(sent.wheel, 0), 0)
            )
        ),
    ),
    "counter big endian": (
        "seq",
        lambda: _counters(
            lambda sent, index, counters: int.from_bytes(struct.pack(">I", _counted(sent, counters)), "little")
        ),
    ),
    "counter of 8 bits": ("seq", lambda: _counters(lambda sent, index, counters: _counted(sent, counters) & 0xFF)),
    "counters go on over a restart": ("start", lambda: _restarts(6, starts_counters=False)),
    "boot_count not counted": ("boot-count", lambda: _restarts(5)),
    "boot_count goes back": ("boot-count", lambda: _restarts(4)),
    # Clock
    "tick in ms": ("tick", lambda: _ticks(lambda sent: sent.tick_us // 1000)),
    "tick of 16 bits": ("tick-monotonic", lambda: _ticks(lambda sent: sent.tick_us & 0xFFFF)),
    "tick of the last sample": ("tick-first", lambda: _ticks(lambda s: s.tick_us + round(BLOCK_S * 1e6), SAMPLES)),
    "tick stands": ("tick-monotonic", lambda: _ticks(lambda sent: 0)),
    "tick read in a busy loop": (
        "jitter",
        lambda: _ticks(lambda sent: sent.tick_us + hash(sent.tick_us) % 8000, SAMPLES),
    ),
    "clock 5 % fast": ("tick", lambda: _ticks(lambda sent: round(1.05 * sent.tick_us))),
    # Samples
    "first_sample counts blocks": ("numbers", lambda: _samples(lambda b, k: b._replace(first_sample=k))),
    "first_sample stands": ("numbers", lambda: _samples(lambda b, k: b._replace(first_sample=0))),
    "first_sample leaves holes": ("numbers", _lost_numbers),
    "first_sample jumps": (
        "numbers",
        lambda: _samples(lambda b, k: b._replace(first_sample=BLOCK * k + (100_000 if k > 300 else 0))),
    ),
    "rate 10 % off": ("rate", lambda: frames(right(hello=HELLO._replace(rate_hz=4400.0)))),
    "rate 0.5 % off": ("rate-exact", lambda: frames(right(hello=HELLO._replace(rate_hz=4020.0)))),
    "a buffer sent twice": (
        "once",
        lambda: frames(s for sent in right() for s in (sent, sent)[: 2 if sent.type == MessageType.SAMPLES else 1]),
    ),
    "other axes than HELLO's": (
        "axes",
        lambda: _hello(axes=3, range_mps2=[4096.0, 4096.0, 0.0], scale_mps2=[0.128, 0.128, 0.0]),
    ),
    "int16 big endian": ("byte-order", lambda: _samples(_swapped_bytes)),
    "offset binary": ("rows", lambda: _counts(lambda counts: counts.astype(int) + 32768)),
    "blocks axis by axis": ("rows", lambda: _counts(lambda counts: counts.T.reshape(counts.shape))),
    "radial axis first": ("rows", lambda: _counts(lambda counts: counts[:, [2, 0, 1]])),
    "radial axis outward": ("rows", lambda: _counts(lambda counts: counts * [1, 1, -1])),
    "an axis that stands": ("rows", lambda: _counts(lambda counts: counts * [1, 0, 1])),
    "a buffer that was not filled": (
        "once",
        lambda: _samples(lambda b, k: b._replace(counts=block(BLOCK * (k - (k % 7 == 3))).counts)),
    ),
    "AC stated, DC sent": ("coupling", lambda: _hello(coupling=1)),
    "scale four times too great": (
        "scale",
        lambda: _samples(lambda b, _: b, scale_mps2=[0.512] * 3, range_mps2=[16384.0] * 3),
    ),
    "scale four times too small": (
        "scale",
        lambda: _samples(lambda b, _: b, scale_mps2=[0.032] * 3, range_mps2=[1024.0] * 3),
    ),
    "scale against range": ("scale-range", lambda: _hello(scale_mps2=[0.512] * 3)),
    # HELLO
    "samples before HELLO": ("hello-first", _late_hello),
    "HELLO once": ("hello-period", lambda: _slower(MessageType.HELLO, 100, wheel=1)),
    "no HELLO": ("hello-period", lambda: _each_message(MessageType.HELLO, lambda _: None)),
    "scale 0": ("hello-values", lambda: _hello(scale_mps2=[0.0, 0.128, 0.128])),
    "zero beyond 16 bits": ("hello-values", lambda: _hello(offset_counts=[1e6, 0.0, 0.0])),
    "values of absent axes": ("hello-absent", lambda: _hello(axes=4)),
    "high-pass with DC": ("hello-coupling", lambda: _hello(highpass_hz=0.5)),
    "boot_count of each wheel": ("boot-count", lambda: _hello(boot_count=9)),
    "two sensors in turn": (
        "hello-sensor",
        lambda: _each_message(
            MessageType.HELLO,
            lambda s: s._replace(payload=_payload(MessageType.HELLO, sensor_id=0xB000 + round(s.time_s / 2) % 2)),
        ),
    ),
    "HELLO from the hub itself": (
        "hub-itself",
        lambda: _added(Sent(1.0, HUB_ITSELF, MessageType.HELLO, 1_000_000, _payload(MessageType.HELLO))),
    ),
    "hub number 255": ("hub-number", lambda: _each_frame(lambda f: _with_crc(f[:5] + b"\xff" + f[6:-4]))),
    # Other messages
    "ENVIRONMENT every 3 s": ("environment-period", lambda: _slower(MessageType.ENVIRONMENT, 3)),
    "pressure in kPa": (
        "environment-values",
        lambda: _each_message(
            MessageType.ENVIRONMENT, lambda s: s._replace(payload=encode_payload(Environment(230.0, 31.0, 3.0)))
        ),
    ),
    "temperature of 300 °C": (
        "environment-values",
        lambda: _each_message(
            MessageType.ENVIRONMENT, lambda s: s._replace(payload=encode_payload(Environment(2.3e5, 300.0, 3.0)))
        ),
    ),
    "no HUB_STATUS": ("status-period", lambda: _each_message(MessageType.HUB_STATUS, lambda _: None)),
    "uptime in ms": (
        "status-values",
        lambda: _each_message(MessageType.HUB_STATUS, lambda s: _status(uptime_s=s.tick_us // 1000)(s)),
    ),
    "drops without their numbers": ("drops", _dropped_in_silence),
    "TIME_SYNC every 4 s": ("time-period", lambda: _slower(MessageType.TIME_SYNC, 4)),
    "hub_us of another clock": (
        "time-values",
        lambda: _each_message(
            MessageType.TIME_SYNC, lambda s: s._replace(payload=struct.pack("<QQ", s.tick_us + 5_000, 0))
        ),
    ),
    "log in Latin-1": ("log", lambda: _log("\x01Räder".encode("latin-1"))),
    "log with line feeds": ("log", lambda: _log(b"\1one\ntwo")),
    "log of level 7": ("log", lambda: _log(b"\7awake")),
    "30 lines of log a second": ("log", lambda: _log(*(b"\1line %d" % k for k in range(30)))),
    # Link
    "more than the link carries": ("loss", _overloaded),
}
"""By name, the clause that each wrong firmware breaks, and its bytes."""
