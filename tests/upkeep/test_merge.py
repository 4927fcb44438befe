"""Recordings of one drive as one: every frame once, in the order of the computers' clocks."""

import tomllib

import pytest

import gateway
from firmware_protocol.decoder import FrameDecoder
from gateway.core.config.validation import parse_document
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.errors import RecordingError
from gateway.core.links.source import BusFrames, Chunk
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.run_description import Note, RunDescription, TireIdentity, add_note
from gateway.core.recording.writer import RecordingWriter
from gateway.simulator.scenario_model import Scenario
from gateway.simulator.simulation import simulate
from gateway.upkeep.merge import merge_recordings
from tests.testkit.campaign_recordings import START_NS, write_recording
from tests.testkit.commands import invoked, run


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return write_recording(tmp_path_factory.mktemp("whole") / "whole.mcap", duration_s=3.0, wheels=("", ""))


def part(path, whole, begin_s, end_s, *, shift_ns=0, size=0, link=None, toml="", run=None):
    """Write what of a recording lies within a time; another computer has read in pieces of `size` and later."""
    reader = RecordingReader(whole)
    writer = RecordingWriter(
        path, start_ns=START_NS, vehicle_toml=toml or reader.vehicle_toml, sources=("sim",), run=run
    )
    for item in reader.items():
        if isinstance(item, Chunk) and begin_s <= (item.host_ns - START_NS) * 1e-9 < end_s:
            step = size or len(item.data)
            for start in range(0, len(item.data), step):
                writer.write(Chunk(link or item.link, item.host_ns + shift_ns, item.data[start : start + step]))
    writer.close()
    return path


def content(path):
    """Return frames as (hub, wheel, seq, tick), arrival times, and decoder of a recording."""
    decoder, frames, times = FrameDecoder(), [], []
    for item in RecordingReader(path).items():
        if isinstance(item, Chunk):
            times.append(item.host_ns)
            frames += [frame[1:5] for frame in decoder.feed(item.data)]
    return frames, times, decoder.counters


@pytest.mark.parametrize("size", [0, 7, 100])
def test_overlap_of_two_computers_is_taken_once(whole, tmp_path, size):
    first = part(tmp_path / "a.mcap", whole, 0.0, 2.0)
    second = part(tmp_path / "b.mcap", whole, 1.0, 9.0, shift_ns=3_000_000, size=size)
    report = merge_recordings([first, second], tmp_path / "out.mcap")
    frames, times, counters = content(tmp_path / "out.mcap")
    expected = content(whole)[0]
    assert sorted(frames) == sorted(expected)
    assert counters.duplicates == counters.lost == counters.crc_errors == 0
    assert times == sorted(times)
    assert report.repeated_frames == len(content(first)[0]) + len(content(second)[0]) - len(expected) > 0


def test_what_one_computer_lost_comes_from_the_other(whole, tmp_path):
    gap = tmp_path / "gap.mcap"
    reader = RecordingReader(whole)
    writer = RecordingWriter(gap, start_ns=START_NS, vehicle_toml=reader.vehicle_toml)
    for index, item in enumerate(reader.items()):
        if index % 3:
            writer.write(item)
    writer.close()
    assert content(gap)[2].lost > 0
    merge_recordings([gap, part(tmp_path / "b.mcap", whole, 0.0, 9.0)], tmp_path / "out.mcap")
    frames, _, counters = content(tmp_path / "out.mcap")
    assert sorted(frames) == sorted(content(whole)[0])
    assert counters.lost == 0


def test_estimates_of_the_merged_parts_are_those_of_the_whole(whole, tmp_path):
    parts = [part(tmp_path / f"{k}.mcap", whole, *span) for k, span in enumerate([(0.0, 1.5), (1.5, 9.0)])]
    out = tmp_path / "out.mcap"
    run("merge", *reversed(parts), "--out", out)
    rows = [invoked("estimate", path, "--csv", "-").stdout.replace(path.name, "") for path in (out, whole)]
    assert rows[0] == rows[1]
    assert len(rows[0].splitlines()) > 20


def test_the_same_wheel_from_two_links_is_refused_and_leaves_no_file(whole, tmp_path):
    other = part(tmp_path / "b.mcap", whole, 0.0, 9.0, link="tcp:other")
    with pytest.raises(RecordingError, match="wheel 0 of hub 0 comes from two hubs"):
        merge_recordings([whole, other], tmp_path / "out.mcap")
    assert not (tmp_path / "out.mcap").exists()


def test_the_same_sensor_at_two_wheels_is_refused(whole, tmp_path):
    text = "[[wheel]]\nposition = 'X'\nhub = 1\nwheel = 5\nsensor_id = '0000b001'\n"
    writer = RecordingWriter(tmp_path / "other.mcap", start_ns=START_NS)
    for chunk in simulate(parse_document(Scenario, text, "test"), duration_s=2.5).chunks("other", START_NS):
        writer.write(chunk)
    writer.close()
    with pytest.raises(RecordingError, match="sensor 0000b001 comes from two hubs or wheels"):
        merge_recordings([whole, writer.path], tmp_path / "out.mcap")


def test_other_configurations_need_one(whole, tmp_path):
    reader = RecordingReader(whole)
    worn = reader.vehicle_toml.replace("temperature_degc = 25.0", "temperature_degc = 40.0")
    other = part(tmp_path / "b.mcap", whole, 1.0, 2.0, toml=worn)
    with pytest.raises(RecordingError, match="'temperature_degc = 25.0' and 'temperature_degc = 40.0'") as caught:
        merge_recordings([whole, other], tmp_path / "out.mcap")
    assert "estimate them apart" in caught.value.remedy
    (tmp_path / "car.toml").write_text(reader.vehicle_toml)
    for config in (tmp_path / "car.toml", tomllib.loads(reader.vehicle_toml)):
        with gateway.merge([whole, other], tmp_path / f"{type(config).__name__}.mcap", config=config) as recording:
            assert recording.vehicle == parse_vehicle(reader.vehicle_toml, "")
    with pytest.raises(RecordingError, match="nothing to merge"):
        gateway.merge([whole], tmp_path / "out.mcap")


def test_unfinished_recording_is_refused(whole, tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[:-200])
    with pytest.raises(RecordingError, match="was not finished"):
        merge_recordings([whole, cut], tmp_path / "out.mcap")


def test_a_target_that_exists_is_never_said_to_be_replaceable(whole, tmp_path):
    paths = [part(tmp_path / name, whole, 0.0, 1.0) for name in ("a.mcap", "b.mcap", "out.mcap")]
    done = invoked("merge", *paths[:2], "--out", paths[2])
    assert isinstance(done.exception, RecordingError)
    assert "never overwritten" in done.exception.remedy


def test_the_run_is_described_as_in_all_parts(whole, tmp_path):
    tires = [{"W0": TireIdentity("Acme", wear_m=0.001)}, {"W0": TireIdentity("Other", "3524")}]
    runs = [
        RunDescription("wet 1", comment="cold", tags=("wet",), tires=tires[0]),
        RunDescription("wet 2", "Ada", "cold", ("wet", "wind"), tires[1]),
    ]
    paths = [part(tmp_path / f"{run.test}.mcap", whole, 0.0, 1.0, run=run) for run in runs]
    add_note(paths[1], Note("2026-01-01T00:00:00Z", "gusts", ("late",)))
    merge_recordings(paths, tmp_path / "out.mcap")
    run = RecordingReader(tmp_path / "out.mcap").info.run
    assert (run.test, run.driver, run.comment) == ("wet 1", "Ada", "cold\ngusts")
    assert set(run.tags) == {"wet", "wind", "late"}
    assert run.tires == {"W0": TireIdentity("Acme", "3524", 0.001)}


def test_each_time_of_a_bus_comes_from_the_first_recording_that_has_it(tmp_path):
    paths = []
    for name, times in (("a", range(0, 5)), ("b", range(3, 8))):
        writer = RecordingWriter(tmp_path / f"{name}.mcap", start_ns=START_NS)
        for time in times:
            writer.write(BusFrames("can:0", START_NS + time * 10**9, name.encode() * 24))
        writer.close()
        paths.append(writer.path)
    merge_recordings(paths, tmp_path / "out.mcap")
    items = list(RecordingReader(tmp_path / "out.mcap").items())
    assert [item.data[:1] for item in items] == [b"a"] * 5 + [b"b"] * 3
