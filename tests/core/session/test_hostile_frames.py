"""Messages repeated, flooded, bent or of made-up wheels: counted once, reported once, at a cost of their bytes."""

import cProfile
import pstats
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner

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
from firmware_protocol.wheel_limit import MOST_WHEELS, WheelLimit
from gateway.core.cli.estimate import estimate
from gateway.core.cli.inspect import inspect
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.links.source import Chunk
from gateway.core.reasons import Code, Level, Notice, Reason
from gateway.core.recording.inspection import inspect_recording
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.writer import RecordingWriter
from gateway.core.session.core import SessionCore
from gateway.core.session.reasons import SessionCode
from gateway.core.session.recording_pass import OpenedRecording, RecordingPass
from gateway.core.text.wording import text
from gateway.upkeep.repair import repair_recording
from tests.core.session.hub_frames import HubFrames

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
    "hello of another sensor": SessionCode.HELLO_KEEPS_CHANGING,
    "hello of another rate": SessionCode.HELLO_KEEPS_CHANGING,
    "hello of another start": SessionCode.HUB_RESTARTS_REPEATEDLY,
    "samples of one block": SessionCode.SAMPLES_REPEATED,
    "samples of any number": SessionCode.SAMPLE_NUMBERS_JUMP,
    "log text": SessionCode.HUB_LOG_LEFT_OUT,
    "command result": SessionCode.HUB_LOG_LEFT_OUT,
    "command": SessionCode.HUB_SENDS_COMMANDS,
    "bad payload": SessionCode.FRAMES_WITH_BAD_PAYLOAD,
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


def test_frames_with_a_bad_payload_are_counted_as_skipped() -> None:
    hub = HubFrames()
    hub.hello()
    for index in range(FLOOD):
        SENDERS["bad payload"](hub, index)
    core = session(hub.stream)
    (link,) = core.snapshot(1.0).links
    assert (link.frames, link.skipped) == (1, FLOOD)
    (said,) = [text(notice.reason) for notice in core.take_notices() if notice.reason.code in NAMED.values()]
    assert "treadlink protocol check" in said


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


TOML = '[[wheel]]\nposition = "FL"\nhub = 39\nwheel = 0\nload_n = 4200\n[tire]\nradius_mm = 320.0\n'


def flood(wheels: int, rounds: int = 2) -> list[Chunk]:
    """Return frames of many wheel numbers, 250 to a hub, each a hello, samples and a reading."""
    hubs = [HubFrames(number) for number in range((wheels + 249) // 250)]
    chunks = []
    for index in range(rounds):
        for number in range(wheels):
            hub = hubs[number // 250]
            hub.stream.clear()
            wheel = number % 250
            hub.hello(wheel, index * 3750)
            hub.samples(36 / 9600, wheel=wheel, first=index * 36, start_us=index * 3750)
            hub.environment(wheel=wheel)
            chunks.append(Chunk("x", START_NS + index * 3_750_000, b"".join(hub.stream)))
    return chunks


def recorded(path: Path, chunks: list[Chunk]) -> Path:
    writer = RecordingWriter(path, start_ns=START_NS)
    for chunk in chunks:
        writer.write(chunk)
    writer.close()
    return path


def live(chunks: list[Chunk], toml: str | None = None) -> SessionCore:
    core = SessionCore(parse_vehicle(toml, "test") if toml else None)
    for chunk in chunks:
        core.take(chunk)
    core.tick(chunks[-1].host_ns)
    core.finish()
    return core


def test_limit_admits_hubs_and_configured_wheels_always() -> None:
    limit = WheelLimit({(200, 1)})
    assert [limit.admits("x", 0, wheel) for wheel in range(MOST_WHEELS)] == [True] * (MOST_WHEELS - 1) + [False]
    assert limit.admits("x", 200, 1)
    assert not limit.admits("y", 200, 1)
    assert limit.admits("x", 77, HUB_ITSELF)
    assert limit.admits("x", 0, 3)
    assert limit.refused == 2


def test_session_takes_64_wheels_and_reports_the_rest_once() -> None:
    core = live(flood(1000))
    refused = [notice for notice in core.take_notices() if notice.reason.code is SessionCode.WHEELS_REFUSED]
    assert len(refused) == 1
    assert core.false_statements() == [
        Notice("", Reason(SessionCode.WHEELS_REFUSED, count=1000 - MOST_WHEELS, most=MOST_WHEELS), Level.WARNING)
    ]
    assert len(core.snapshot(1.0).wheels) == MOST_WHEELS


def test_configured_wheel_keeps_its_place_in_a_flood() -> None:
    core = live(flood(9800, 1), TOML)
    wheels = {wheel.position: wheel for wheel in core.snapshot(1.0).wheels}
    assert len(wheels) == MOST_WHEELS
    assert wheels["FL"].counters.samples == 36


def test_notices_of_a_flood_are_few() -> None:
    core = live(flood(1000))
    assert len(core.take_notices()) <= 2 * MOST_WHEELS


def test_recording_of_a_flood_has_few_topics(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "x.mcap", start_ns=START_NS)
    core = SessionCore(None, recorder=writer)
    for chunk in flood(500, 1):
        core.take(chunk)
    core.finish()
    assert len(inspect_recording(tmp_path / "x.mcap").topics) <= MOST_WHEELS + 5


def test_outputs_report_the_wheels_refused(tmp_path: Path) -> None:
    path = recorded(tmp_path / "x.mcap", flood(200))
    said = f"{200 - MOST_WHEELS} wheel numbers beyond the {MOST_WHEELS} that a session takes are not used"
    for command in (inspect, estimate):
        printed = CliRunner().invoke(command, [str(path)]).output
        assert printed.count(said) == 1
        assert len(printed.splitlines()) < 6 * MOST_WHEELS


READERS: dict[str, Callable[[Path, list[Chunk]], object]] = {
    "live": lambda _, chunks: live(chunks),
    "estimate": lambda path, _: list(RecordingPass(OpenedRecording(RecordingReader(path)))),
    "inspect": lambda path, _: inspect_recording(path),
    "repair": lambda path, _: repair_recording(path, path.with_suffix(f".{time.monotonic_ns()}.mcap")),
}


@pytest.fixture(scope="module")
def floods(tmp_path_factory: pytest.TempPathFactory) -> dict[int, tuple[Path, list[Chunk]]]:
    folder = tmp_path_factory.mktemp("floods")
    made = {wheels: flood(wheels, 1) for wheels in (MOST_WHEELS, 250, 2000)}
    return {wheels: (recorded(folder / f"{wheels}.mcap", chunks), chunks) for wheels, chunks in made.items()}


@pytest.mark.parametrize("name", READERS)
def test_work_of_a_flood_is_linear(floods: dict[int, tuple[Path, list[Chunk]]], name: str) -> None:
    calls = []
    for wheels in (250, 2000):
        profile = cProfile.Profile()
        profile.runcall(READERS[name], *floods[wheels])
        calls.append(pstats.Stats(profile).total_calls)  # type: ignore[attr-defined]
    # Eight times the wheels; quadratic growth would be 64 times. Calls do not depend on the load of the computer.
    assert calls[1] < 12 * calls[0]


@pytest.mark.parametrize("name", READERS)
def test_memory_of_a_flood_is_that_of_the_limit(floods: dict[int, tuple[Path, list[Chunk]]], name: str) -> None:
    peaks = []
    for wheels in (MOST_WHEELS, 2000):
        tracemalloc.start()
        try:
            READERS[name](*floods[wheels])
            peaks.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
    assert peaks[1] - peaks[0] < 8e6
