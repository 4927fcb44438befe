"""Frames of a genuine sensor, and of an attacker who reads and sends everything but has no key."""

from collections.abc import Callable, Iterator
from zlib import crc32

import numpy as np

from firmware_protocol.codec import encode_frame
from firmware_protocol.messages import HUB_ITSELF, Coupling, Frame, Hello, HubStatus, Message, MessageType, SampleBlock
from gateway.security.cmac import FrameSigner, Key
from gateway.security.freshness import Ledger
from gateway.security.guard import ConfiguredWheel, Guard
from gateway.security.key_file import hub_identity, sensor_identity

SENSORS = {0: 0xA001, 1: 0xA002}
HUB = 0x5452_4541_4400_0000
PLACES = {
    (0, 0): ConfiguredWheel("FL", sensor_identity(SENSORS[0])),
    (0, 1): ConfiguredWheel("FR", sensor_identity(SENSORS[1])),
}
KEYS = {
    sensor_identity(SENSORS[0]): Key(bytes(range(16))),
    sensor_identity(SENSORS[1]): Key(bytes(range(16, 32))),
    hub_identity(HUB): Key(bytes(range(32, 48))),
}


def guard(ledger: Ledger | None = None, *, requires: bool = True) -> Guard:
    return Guard(PLACES, KEYS, ledger or Ledger(), requires=requires)


class Sender:
    """Signs frames like the firmware of one hub and counts them."""

    def __init__(self, boot_count: int = 7, keys: dict[str, Key] = KEYS, sensors: dict[int, int] = SENSORS) -> None:
        self.boot_count = boot_count
        self.sensors = sensors
        self.seq = dict.fromkeys((*sensors, HUB_ITSELF), 0)
        self._signer = FrameSigner(keys)

    def send(self, wheel: int, message: Message, *, signed: bool = True) -> bytes:
        """Return the message as the next frame of a wheel."""
        types = {Hello: MessageType.HELLO, SampleBlock: MessageType.SAMPLES, HubStatus: MessageType.HUB_STATUS}
        frame = encode_frame(Frame(types[type(message)], 0, wheel, self.seq[wheel], 1000, message))
        self.seq[wheel] += 1
        identity = hub_identity(HUB) if wheel == HUB_ITSELF else sensor_identity(self.sensors[wheel])
        return self._signer(frame, identity, self.boot_count) if signed else frame

    def hello(self, wheel: int = 0) -> bytes:
        """Return a hello frame."""
        return self.send(wheel, hello(self.sensors[wheel], self.boot_count))

    def samples(self, wheel: int = 0, *, signed: bool = True) -> bytes:
        """Return a frame of 35 samples."""
        return self.send(wheel, SampleBlock(self.seq[wheel] * 35, 7, np.ones((35, 3), "<i2")), signed=signed)

    def status(self) -> bytes:
        """Return a status frame of the hub."""
        return self.send(HUB_ITSELF, HubStatus(1, 50, 3.0, 0.1, -50, 1, 0, 0, 0))


def hello(sensor_id: int, boot_count: int) -> Hello:
    scale = (0.125,) * 3
    return Hello(
        1, 0, HUB, sensor_id, (1, 0, 0), boot_count, 9600.0, 7, Coupling.DC, 0.0, (4e3,) * 3, scale, (0.0,) * 3, 32767
    )


def with_crc(frame: bytes) -> bytes:
    """Return a changed frame with a matching CRC, which needs no key."""
    return frame[:-4] + crc32(frame[:-4]).to_bytes(4, "little")


def corrupted(frame: bytes, rng: np.random.Generator) -> bytes:
    """Return a frame with one byte changed outside sync, version, length and flags, so that it stays a signed frame."""
    data = bytearray(frame)
    places = [3, 5, 6, *range(8, len(data) - 4)]
    data[places[rng.integers(len(places))]] ^= rng.integers(1, 256)
    return with_crc(bytes(data))


def forged(frame: bytes, rng: np.random.Generator) -> bytes:
    """Return a frame that continues the sensor's numbering with a random tag."""
    data = bytearray(frame)
    data[8:12] = (int.from_bytes(data[8:12], "little") + int(rng.integers(1, 1000))).to_bytes(4, "little")
    data[-12:-4] = rng.bytes(8)
    return with_crc(bytes(data))


def downgraded(frame: bytes) -> bytes:
    """Return a signed frame without its tag and flag."""
    data = bytearray(frame[:-12] + frame[-4:])
    data[4] -= 8
    data[7] = 0
    return with_crc(bytes(data))


def attacks(count: int, seed: int) -> Iterator[tuple[str, Callable[[Guard], None], list[bytes]]]:
    """Yield the name, the genuine session to replay first, and `count` hostile frames of each kind."""
    rng = np.random.default_rng(seed)
    genuine = Sender()
    session = [genuine.hello(0), genuine.hello(1), genuine.status()]
    session += [genuine.samples(index % 2) for index in range(2000)]
    late = session.pop(-150)

    def before(to: Guard) -> None:
        gate = to.gate("link")
        assert all(map(gate, session))

    old = Sender(boot_count=6)
    earlier = [old.hello(), *(old.samples() for _ in range(500))]
    other = Sender(boot_count=8, keys={name: Key(rng.bytes(16)) for name in KEYS})
    wrong_key = [other.hello(), *(other.samples() for _ in range(500))]
    ahead = Sender()
    ahead.seq = dict.fromkeys(ahead.seq, 10_000)
    plain = [ahead.samples(index % 2, signed=False) for index in range(500)]
    last = session[-1]

    def of(frames: list[bytes]) -> list[bytes]:
        return [frames[index % len(frames)] for index in range(count)]

    yield "forged", before, [forged(last, rng) for _ in range(count)]
    yield "changed in flight", before, [corrupted(genuine.samples(), rng) for _ in range(count)]
    yield "replayed", before, of(session)
    yield "replayed from an earlier start", before, of(earlier)
    yield "late beyond the window", before, of([late])
    yield "wrong key", before, of(wrong_key)
    yield "unsigned", before, of(plain)
    yield "tag taken off", before, [downgraded(ahead.samples()) for _ in range(count)]
