"""Attacks on commands by someone who hears and writes to the link, and has no key.

Written from the protocol page. Whatever is replayed, in whatever order, no command counts as executed that the hub
did not execute, and none goes out unsigned.
"""

import threading
from collections.abc import Iterator, Sequence
from zlib import crc32

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_protocol import wire
from firmware_protocol.codec import encode_frame
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import Frame, MessageType, SetStream
from firmware_protocol.signing import is_signed
from gateway.core.clock import ManualClock
from gateway.core.errors import SourceError
from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind, LinkItem
from gateway.security.hub_commands import CommandedSource, execute
from tests.testkit.signing_hub import KEYS, SECONDS, Hub, hello_message
from tests.testkit.waiting import HeldClock


class Attacker:
    """A link without a hub behind it: yields what was overheard and swallows what is sent."""

    vehicle_toml = None
    link = "test:attacker"
    rate_hz: float | None = None

    def __init__(self, frames: Sequence[bytes]) -> None:
        self.frames = frames
        self.received: list[bytes] = []

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        yield LinkEvent(self.link, 0, LinkEventKind.CONNECTED)
        for frame in self.frames:
            if stop.is_set():
                return
            yield Chunk(self.link, 0, frame)

    def send(self, data: bytes) -> None:
        self.received.append(data)

    def close(self) -> None:
        pass


class Eavesdropper(Hub):
    """A hub whose frames are overheard."""

    def __init__(self, boot_count: int) -> None:
        super().__init__(boot_count=boot_count)
        self.overheard: list[bytes] = []

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        for item in super().items(stop):
            if isinstance(item, Chunk):
                self.overheard.append(item.data)
            yield item


def overheard(boot_count: int, running: bool) -> list[bytes]:
    """Return the hub's frames of a session in which one command was executed."""
    hub = Eavesdropper(boot_count)
    assert execute(hub, SetStream(running), HeldClock(SECONDS * 10**9), keys=KEYS).signed
    return hub.overheard


RECORDED = [frame for boot in (40, 41) for running in (False, True) for frame in overheard(boot, running)]


def without_tag(frame: bytes) -> bytes:
    """Return a signed frame as an attacker makes it unsigned."""
    if not is_signed(frame):
        return frame
    body = bytearray(frame[: -wire.CRC_BYTES - wire.TAG_BYTES])
    body[wire.LENGTH_OFFSET] -= wire.TAG_BYTES
    body[wire.FLAGS_OFFSET] &= ~wire.SIGNED_FLAG
    return bytes(body) + crc32(body).to_bytes(4, "little")


STRIPPED = [without_tag(frame) for frame in RECORDED]
OLD_HELLOS = [
    Hub(minor=0, boot_count=40).hello(),
    encode_frame(Frame(MessageType.HELLO, 0, 0, 0, 0, hello_message(42, 0))),
    encode_frame(Frame(MessageType.HELLO, 0, 0, 0, 0, hello_message(42, 1))),
]
ALL = [*RECORDED, *STRIPPED, *OLD_HELLOS]


def attacked(frames: Sequence[bytes], running: bool, seconds: int) -> Attacker:
    link = Attacker(frames)
    with pytest.raises(SourceError):
        execute(link, SetStream(running), HeldClock(seconds * 10**9), keys=KEYS, timeout_s=30.0)
    return link


class Withholder(Hub):
    """A hub behind someone who keeps the first command of a gateway, and delivers it in place of the next one."""

    delayed: bytes | None = None
    delivers = False

    def send(self, data: bytes) -> None:
        if not is_signed(data):
            super().send(data)
        elif self.delivers and self.delayed is not None:
            super().send(self.delayed)
        else:
            self.delayed = data


def test_command_kept_back_is_not_taken_for_the_next_one() -> None:
    hub = Withholder()
    for delivers, running in ((False, True), (True, False)):
        hub.delivers = delivers
        hub.waiting.append(hub.hello())
        with pytest.raises(SourceError):
            execute(hub, SetStream(running), HeldClock(SECONDS * 10**9), keys=KEYS, timeout_s=30.0)
    assert hub.executed == []


def unsigned_commands(sent: Sequence[bytes]) -> list[int]:
    types = [frame.type for data in sent for frame in FrameDecoder().feed(data) if not is_signed(data)]
    return [kind for kind in types if kind in (MessageType.SET_STREAM, MessageType.SET_RATE, MessageType.SET_TIME)]


@settings(max_examples=300)
@given(st.lists(st.sampled_from(ALL), max_size=12), st.booleans(), st.integers(SECONDS - 2, SECONDS + 2))
def test_no_replay_executes_a_command_or_brings_it_out_unsigned(
    frames: list[bytes], running: bool, seconds: int
) -> None:
    assert unsigned_commands(attacked(frames, running, seconds).received) == []


@pytest.mark.parametrize("boot", [40, 41])
def test_session_overheard_and_replayed_whole(boot: int) -> None:
    attacked(overheard(boot, False), False, SECONDS)


@pytest.mark.parametrize("hello", OLD_HELLOS)
def test_forged_or_old_hello_before_the_genuine_one(hello: bytes) -> None:
    answers = [without_tag(frame) for frame in overheard(41, False)[1:]]
    assert unsigned_commands(attacked([hello, *answers], False, SECONDS).received) == []


def test_flood_of_replayed_hellos_causes_few_frames() -> None:
    hellos = [Hub(boot_count=40 + k % 2).hello() for k in range(200)]
    for keys in (KEYS, {"0000ffff": KEYS["0000a001"]}):
        link = Attacker([without_tag(h) for h in hellos] if keys is not KEYS else hellos)
        list(CommandedSource(link, ManualClock(SECONDS * 10**9), keys).items(threading.Event()))
        assert len(link.received) <= 30
