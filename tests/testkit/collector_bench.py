"""Records for the reference collector, and what its link delivered."""

import struct
import subprocess
from collections.abc import Iterable, Iterator
from enum import IntEnum
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.codec import encode_frame
from firmware_protocol.counters import LinkCounters
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import (
    COMMAND_TYPES,
    HUB_ITSELF,
    Command,
    CommandResult,
    Frame,
    Hello,
    HubStatus,
    LogText,
    Message,
    SampleBlock,
)
from firmware_protocol.signing import sign
from gateway.core.errors import SourceError
from gateway.security.cmac import Key, mac
from tests.testkit.emulated_firmware import bench_records
from tests.testkit.emulated_firmware.bench_records import HubData, Kind, WheelData, provisioning, record

HUB_KEY = bytes(range(0xF0, 0x100))
SENSOR_KEY = bytes(range(16))
HUB = HubData()
SIGNING_HUB = HUB._replace(key=HUB_KEY)
WHEEL = WheelData()
SIGNING_WHEEL = WHEEL._replace(key=SENSOR_KEY)
BLOCK = 36
"""Samples of a full unsigned frame of three axes."""


UNLIMITED = 0xFFFF_FFFF
"""Bytes that a link takes which does not stall."""
_MOST_PAYLOAD = 255


class Flash(IntEnum):
    """State of the collector's flash."""

    BROKEN = 0
    WORKS = 1
    ERASED = 2


class Counters(NamedTuple):
    """Counters to set in a running collector.

    Attributes:
        seq: of every source.
        first_sample: number of the next sample of every wheel.
        frames_sent: of HUB_STATUS.
        frames_dropped: of HUB_STATUS.
        samples_dropped: of HUB_STATUS.
        tick_us: the clock.
    """

    seq: int
    first_sample: int
    frames_sent: int
    frames_dropped: int
    samples_dropped: int
    tick_us: int


class Delivery(NamedTuple):
    """Frames that a link delivered, and the counters of their decoder."""

    frames: list[Frame]
    counters: LinkCounters

    def of(self, kind: type[Message]) -> list[Frame]:
        """Return the frames with messages of one kind."""
        return [frame for frame in self.frames if isinstance(frame.message, kind)]

    def messages(self, kind: type) -> list:
        """Return the messages of one kind."""
        return [frame.message for frame in self.frames if isinstance(frame.message, kind)]

    def samples(self, wheel: int = 0) -> dict[int, tuple[int, ...]]:
        """Return the rows of counts of a wheel by their sample number."""
        results: dict[int, tuple[int, ...]] = {}
        for frame in self.of(SampleBlock):
            if frame.wheel == wheel and isinstance(frame.message, SampleBlock):
                for offset, row in enumerate(frame.message.counts.tolist()):
                    results[(frame.message.first_sample + offset) & 0xFFFF_FFFF] = tuple(row)
        return results

    @property
    def boot_counts(self) -> list[int]:
        """Return the boot counts of the hellos, each once, in order."""
        return list(dict.fromkeys(hello.boot_count for hello in self.messages(Hello)))

    @property
    def results(self) -> list[tuple[int, int]]:
        """Return sequence number and outcome of every reply to a command."""
        return [(result.seq, result.outcome) for result in self.messages(CommandResult)]

    @property
    def status(self) -> HubStatus:
        """Return the last status."""
        status: HubStatus = self.messages(HubStatus)[-1]
        return status

    @property
    def log(self) -> list[str]:
        """Return the texts of the log."""
        return [line.text for line in self.messages(LogText)]


def delivered(data: bytes) -> Delivery:
    """Decode the bytes of a link."""
    decoder = FrameDecoder()
    return Delivery([*decoder.feed(data), *decoder.finish()], decoder.counters)


def started(hub: HubData = HUB, wheels: Iterable[WheelData] = (WHEEL,)) -> bytes:
    """Return the records that provision and start a collector."""
    return provisioning(hub, list(wheels))


def counts_of(first: int, n: int, channels: int = 3) -> NDArray[np.int16]:
    """Return (n, channels) counts that differ from sample to sample."""
    numbers = np.arange(first, first + n, dtype=np.int64)[:, None]
    return ((numbers * 7919 + np.arange(channels) * 12_345) % 65_536 - 32_768).astype(np.int16)


def rows_of(first: int, n: int, channels: int = 3) -> dict[int, tuple[int, ...]]:
    """Return the rows of `counts_of` by sample number."""
    return {first + k: tuple(row) for k, row in enumerate(counts_of(first, n, channels).tolist())}


def block(first: int, n: int = BLOCK, *, place: int = 0, rate_hz: float = 9600.0, channels: int = 3) -> bytes:
    """Return the record of `n` samples from number `first` on, taken at a steady rate."""
    return bench_records.samples(place, round(first / rate_hz * 1e6), counts_of(first, n, channels))


def blocks(first: int, number: int, **options: float) -> bytes:
    """Return the records of that many full frames of samples."""
    return b"".join(block(first + BLOCK * k, **options) for k in range(number))


def tick(time_s: float) -> bytes:
    """Return the record that moves the collector's clock."""
    return number(Kind.TIME, round(time_s * 1e6))


def seconds(begin: int, end: int) -> bytes:
    """Return records that move the clock from second to second."""
    return b"".join(map(tick, range(begin, end)))


def command_bytes(
    command: Command, seq: int, *, wheel: int = HUB_ITSELF, hub: int = 0, key: bytes | None = None, boot_count: int = 1
) -> bytes:
    """Return a command's frame, signed for the bench's hub or sensor if there is a key."""
    frame = encode_frame(Frame(COMMAND_TYPES[type(command)], hub, wheel, seq, 0, command))
    if key is None:
        return frame
    identity = HUB.hub_id if wheel == HUB_ITSELF else WHEEL.sensor_id
    return sign(frame, identity, boot_count, lambda data: mac(Key(key), data))


def arriving(frames: Iterable[bytes]) -> Iterator[bytes]:
    """Yield the records that bring frames of the gateway."""
    return (from_gateway(frame) for frame in frames)


def listening(yes: bool) -> bytes:
    """Return the record by which a listener comes or goes."""
    return record(Kind.LISTEN, bytes((yes,)))


def number(kind: Kind, value: int) -> bytes:
    """Return a record whose payload is one number: TIME, STALL, RESET_AT or CUT."""
    return record(kind, struct.pack("<I", value & 0xFFFF_FFFF))


def from_gateway(data: bytes) -> bytes:
    """Return the records that bring bytes of the gateway, where the link itself does not."""
    pieces = [data[offset : offset + _MOST_PAYLOAD] for offset in range(0, len(data), _MOST_PAYLOAD)]
    return b"".join(record(Kind.LINK, piece) for piece in pieces)


def counters(values: Counters) -> bytes:
    """Return the record that sets the counters."""
    return record(Kind.COUNTERS, struct.pack("<6I", *values))


class HostCollector:
    """A collector that runs from power-on through the records that it is given, and ends.

    The same records give the same bytes.
    """

    def __init__(self, program: Path) -> None:
        """Take the program of `tests.testkit.emulated_firmware.firmware_build.build_host`."""
        self._program = program

    def run(self, records: bytes) -> bytes:
        """Return the bytes of the link.

        Raises:
            SourceError: the program failed, for example because a sanitizer found an error.
        """
        done = subprocess.run([self._program], input=records, capture_output=True, check=False)
        if done.returncode != 0:
            raise SourceError(
                f"the collector failed: {done.stderr.decode(errors='replace')}", "Report this as a defect."
            )
        return done.stdout
