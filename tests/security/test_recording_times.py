"""Recordings whose times are any that MCAP can hold: a result or a message in every command, never a traceback."""

import shutil
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer

from firmware_protocol.codec import encode_frame
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import TimeSync
from gateway.core.config.validation import parse_document
from gateway.core.errors import TreadlinkError
from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind
from gateway.core.recording.writer import RecordingWriter
from gateway.simulator.scenario import vehicle_toml
from gateway.simulator.scenario_model import Scenario
from gateway.simulator.simulation import simulate
from tests.testkit.commands import invoked
from tests.testkit.vehicle_bus import DBC, blocks, frames, merged, with_signals

START_NS = 1_700_000_000 * 10**9
SCENARIO = """[scenario]
seed = 1
[sensor]
rate_hz = 2000
[motion]
speed_kmh = 80
[[wheel]]
position = "FL"
wheel = 0
sensor_id = "0000b000"
load_n = 4000
"""
COMMANDS = (
    "estimate {path} --json -",
    "estimate {path} --parquet {folder}/rows.parquet",
    "export {path} {folder}/samples.h5",
    "export {path} {folder}/samples.mf4",
    "export {path} {folder}/estimates.csv --what estimates",
    "inspect {path} --json",
    "orders {path} --json {folder}/orders.json",
    "replay {path} --plain --speed max",
    "repair {path} --force --out {folder}/repaired.mcap",
    "compact {path} --out {folder}/compact.mcap",
)
# A hub may state any time of the world; what the computer stores beside a message is any of MCAP.
TIMES = st.one_of(st.sampled_from([0, 1, 2**53, 2**62, 2**63 - 1, 2**63, 2**64 - 1]), st.integers(0, 2**64 - 1))


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a recording with samples, a vehicle bus, an event and the hub's clock."""
    path = tmp_path_factory.mktemp("times") / "drive.mcap"
    scenario = parse_document(Scenario, SCENARIO, "test")
    vehicle = with_signals(vehicle_toml(scenario), "FL")
    writer = RecordingWriter(
        path, start_ns=START_NS, vehicle_toml=vehicle.to_toml(), dbc_text=DBC.read_text(encoding="latin-1")
    )
    bus = blocks(frames(START_NS, START_NS + 10**9, 80.0, 22.0))
    for item in merged(list(simulate(scenario, duration_s=1.2).chunks("sim", START_NS)), bus):
        writer.write(item)
    writer.write(LinkEvent("sim", START_NS + 5 * 10**8, LinkEventKind.LOST, "gone"))
    writer.close()
    return path


def with_times(path: Path, out: Path, first: int, count: int, time_ns: int, *, steps: bool) -> Path:
    """Write a copy in which some messages have another time, or all from it on a step of it."""
    with path.open("rb") as source, out.open("wb") as target:
        reader, writer = make_reader(source), Writer(target)
        writer.start("treadlink", "times")
        for metadata in reader.iter_metadata():
            writer.add_metadata(metadata.name, metadata.metadata)
        channels: dict[int, int] = {}
        for number, (_, channel, message) in enumerate(reader.iter_messages()):
            if channel.id not in channels:
                schema = writer.register_schema("x", "text/plain", b"x")
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, schema, dict(channel.metadata)
                )
            stamp = message.log_time
            if first <= number < first + count:
                stamp = (stamp + time_ns) % 2**64 if steps else time_ns
            writer.add_message(channels[channel.id], stamp, message.data, stamp, number)
        writer.finish()
    return out


def outcome(line: str) -> int:
    """Return the exit status of a command; anything but a message is an error of the test."""
    result = invoked(line)
    if result.exception is not None and not isinstance(result.exception, (SystemExit, TreadlinkError)):
        raise AssertionError(f"{line}: {result.exception!r}") from result.exception
    return result.exit_code


@settings(max_examples=4)
@given(first=st.integers(0, 120), count=st.sampled_from([1, 20, 10_000]), time_ns=TIMES, steps=st.booleans())
@example(first=0, count=10_000, time_ns=2**63, steps=False)
@example(first=60, count=10_000, time_ns=2**63, steps=True)
@example(first=0, count=1, time_ns=2**64 - 1, steps=False)
def test_any_times_give_a_result_or_a_message(
    drive: Path, tmp_path_factory: pytest.TempPathFactory, first: int, count: int, time_ns: int, steps: bool
) -> None:
    folder = tmp_path_factory.mktemp("copy")
    path = with_times(drive, folder / "copy.mcap", first, count, time_ns, steps=steps)
    for line in COMMANDS:
        outcome(line.format(path=path, folder=folder))
    shutil.rmtree(folder)


@pytest.mark.parametrize("stated", [0, 2**53, 2**62, 2**63 - 1, 2**63, 2**64 - 1])
def test_any_time_that_a_hub_states_gives_a_result(tmp_path: Path, stated: int) -> None:
    path, scenario, decoder = tmp_path / "synced.mcap", parse_document(Scenario, SCENARIO, "test"), FrameDecoder()
    writer = RecordingWriter(path, start_ns=START_NS, vehicle_toml=vehicle_toml(scenario))
    synced = 0
    for chunk in simulate(scenario, duration_s=1.2).chunks("sim", START_NS):
        for frame in decoder.feed(chunk.data):
            if isinstance(frame.message, TimeSync):
                synced += 1
                frame = frame._replace(tick_us=stated % 2**32, message=TimeSync(stated, stated))
            writer.write(Chunk("sim", chunk.host_ns, encode_frame(frame)))
    writer.close()
    assert synced
    for line in COMMANDS:
        outcome(line.format(path=path, folder=tmp_path))
