"""Every message type repeated, flooded and bent: nothing is counted twice, notices stay few, and nothing is silent."""

from collections.abc import Callable

import pytest

from firmware_protocol.codec import encode_payload
from firmware_protocol.messages import (
    HUB_ITSELF,
    CommandResult,
    HubStatus,
    LogText,
    MessageType,
    Outcome,
    SetRate,
    TimeSync,
)
from gateway.io.source import Chunk
from gateway.reasons import Code
from gateway.session.core import SessionCore
from tests.session.hub_frames import HubFrames

START_NS = 1_700_000_000_000_000_000
FLOOD = 1000

SENDERS: dict[str, Callable[[HubFrames, int], None]] = {
    "hello": lambda hub, _: hub.hello(),
    "hello of another sensor": lambda hub, position: hub.hello(sensor_id=position),
    "hello of another rate": lambda hub, position: hub.hello(rate_hz=2000.0 + position),
    "hello of another start": lambda hub, position: hub.hello(boot_count=position),
    "samples": lambda hub, position: hub.samples(36 / 9600, first=36 * position, start_us=3750 * position),
    "samples of one block": lambda hub, _: hub.samples(36 / 9600),
    "samples of any number": lambda hub, position: hub.samples(
        36 / 9600, first=position * 2654435761, start_us=position
    ),
    "environment": lambda hub, position: hub.environment(2e5 + position),
    "hub status": lambda hub, position: hub.send(
        MessageType.HUB_STATUS, HubStatus(position, 50, 3.0, 0.1, -60, position, 0, 0, 0), HUB_ITSELF
    ),
    "time sync": lambda hub, position: hub.send(MessageType.TIME_SYNC, TimeSync(position, 0), HUB_ITSELF, position),
    "log text": lambda hub, position: hub.add(
        MessageType.LOG_TEXT, encode_payload(LogText(1, f"{position}\n")), HUB_ITSELF
    ),
    "command result": lambda hub, position: hub.send(
        MessageType.COMMAND_RESULT, CommandResult(position, 33, Outcome.FAILED), HUB_ITSELF
    ),
    "command": lambda hub, _: hub.send(MessageType.SET_RATE, SetRate(9600.0), HUB_ITSELF),
    "unknown type": lambda hub, _: hub.add(99, b"?"),
    "bad payload": lambda hub, _: hub.add(MessageType.HELLO, b"?"),
}

NAMED: dict[str, Code] = {
    "hello of another sensor": Code.HELLO_KEEPS_CHANGING,
    "hello of another rate": Code.HELLO_KEEPS_CHANGING,
    "hello of another start": Code.HUB_RESTARTS_REPEATEDLY,
    "samples of one block": Code.SAMPLES_REPEATED,
    "samples of any number": Code.SAMPLE_NUMBERS_JUMP,
    "log text": Code.HUB_LOG_LEFT_OUT,
    "command result": Code.HUB_LOG_LEFT_OUT,
    "command": Code.HUB_SENDS_COMMANDS,
    "bad payload": Code.FRAMES_WITH_BAD_PAYLOAD,
}
"""What a flood must be named as; the other messages may come that often."""


def session(stream: list[bytes], step_ns: int = 1_000_000) -> SessionCore:
    core = SessionCore(None)
    for number, data in enumerate(stream):
        core.take(Chunk("x", START_NS + number * step_ns, data))
    core.tick(START_NS + len(stream) * step_ns)
    core.finish()
    return core


@pytest.mark.parametrize("name", SENDERS)
def test_flood_has_few_notices_and_is_named(name: str) -> None:
    hub = HubFrames()
    hub.hello()
    for index in range(FLOOD):
        SENDERS[name](hub, index)
    core = session(hub.stream)
    codes = [notice.reason.code for notice in core.take_notices()]
    assert len(codes) <= 25, codes
    if name in NAMED:
        assert NAMED[name] in codes
    else:
        assert not set(codes) & set(NAMED.values())


@pytest.mark.parametrize("name", SENDERS)
def test_frame_that_comes_twice_counts_once(name: str) -> None:
    hub = HubFrames()
    hub.hello()
    for index in range(40):
        SENDERS[name](hub, index)
    once = session(hub.stream)
    twice = session([data for data in hub.stream for _ in range(2)])
    (single,), (other,) = once.snapshot(1.0).links, twice.snapshot(1.0).links
    assert (other.frames, other.frames_lost) == (single.frames, single.frames_lost)
    assert other.duplicates == len(hub.stream)
    assert [wheel.counters for wheel in twice.snapshot(1.0).wheels] == [
        wheel.counters for wheel in once.snapshot(1.0).wheels
    ]
    assert twice.false_statements() == once.false_statements()


def test_flood_does_not_disturb_another_wheel() -> None:
    quiet, noisy = HubFrames(), HubFrames()
    quiet.hello()
    quiet.samples(2.0)
    noisy.hello()
    for index, data in enumerate(quiet.stream[1:]):
        noisy.stream.append(data)
        noisy.hello(7, rate_hz=3000.0 + index)
        noisy.samples(36 / 9600, wheel=7, first=index * 10**6)
    noisy.stream = [quiet.stream[0], *noisy.stream[1:]]
    alone = session(quiet.stream).snapshot(1.0).wheels[0]
    beside = next(wheel for wheel in session(noisy.stream).snapshot(1.0).wheels if wheel.position == alone.position)
    assert beside.counters == alone.counters
