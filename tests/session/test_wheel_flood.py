"""Made-up wheel numbers: a session takes 64 wheels, reports the others once, and its cost grows with the bytes only."""

import cProfile
import pstats
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner

from firmware_protocol.messages import HUB_ITSELF
from firmware_protocol.wheel_limit import MOST_WHEELS, WheelLimit
from gateway.cli.estimate import estimate
from gateway.cli.inspect import inspect
from gateway.config.vehicle import parse_vehicle
from gateway.io.source import Chunk
from gateway.reasons import Code, Level, Notice, Reason
from gateway.recording.inspection import inspect_recording
from gateway.recording.reader import RecordingReader
from gateway.recording.repair import repair_recording
from gateway.recording.writer import RecordingWriter
from gateway.session.core import SessionCore
from gateway.session.recording_pass import OpenedRecording, RecordingPass
from tests.session.hub_frames import HubFrames

START_NS = 1_700_000_000_000_000_000
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
    refused = [notice for notice in core.take_notices() if notice.reason.code is Code.WHEELS_REFUSED]
    assert len(refused) == 1
    assert core.false_statements() == [
        Notice("", Reason(Code.WHEELS_REFUSED, count=1000 - MOST_WHEELS, most=MOST_WHEELS), Level.WARNING)
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
