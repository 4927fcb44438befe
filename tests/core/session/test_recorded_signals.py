import threading
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import Hello, SampleBlock
from gateway.core.clock import ManualClock
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.errors import RecordingError
from gateway.core.links.source import Chunk, open_source
from gateway.core.recording.recorded_file import open_recorded_file
from gateway.core.session.recording_pass import OpenedRecording
from gateway.exporting import recorded_signals
from gateway.exporting.recorded_signals import EnvironmentReading, SignalBlock, revolutions, sample_blocks, signals
from gateway.simulator.scenario import parse_scenario, vehicle_toml
from gateway.simulator.simulation import simulate

START_NS = 1_700_000_000_000_000_000
# The hub's clock is fast, and the sensor samples slowly by it: its rate is not the stated one.
SCENARIO = """
[scenario]
seed = 5
[[hub]]
hub = 0
clock_ppm = 250
[sensor]
rate_error_ppm = -300
[[wheel]]
position = "FL"
wheel = 0
[[wheel]]
position = "FR"
wheel = 1
"""


RATE_HZ = 9600.0 * (1 - 300e-6)


class Held:
    """Items in memory."""

    def __init__(self, items):
        self._items = list(items)
        self.read = 0

    def items(self):
        self.read = 0
        for item in self._items:
            self.read += len(getattr(item, "data", b""))
            yield item


def simulated(uri):
    source = open_source(uri, ManualClock())
    vehicle = parse_vehicle(source.vehicle_toml, "scenario")
    return Held(source.items(threading.Event())), vehicle


def joined(blocks, wheel):
    selected = [block for block in blocks if block.wheel == wheel]
    return {
        "number": np.concatenate([block.first_sample + np.arange(len(block)) for block in selected]),
        "hub_s": np.concatenate([block.hub_time_s for block in selected]),
        "host_ns": np.concatenate([block.host_time_ns for block in selected]),
        "axes": np.concatenate([block.axes_mps2 for block in selected]),
        "saturated": np.concatenate([block.saturated for block in selected]),
    }


@pytest.fixture(scope="module")
def two_wheels():
    scenario = parse_scenario(SCENARIO, "test")
    chunks = list(simulate(scenario, duration_s=6.0).chunks("sim:test", START_NS))
    return Held(chunks), parse_vehicle(vehicle_toml(scenario), "test")


@pytest.fixture(scope="module")
def frames(two_wheels):
    decoder = FrameDecoder()
    return [frame for chunk in two_wheels[0].items() for frame in decoder.feed(chunk.data)]


def test_samples_equal_the_counts_of_the_frames(two_wheels, frames):
    result = joined(sample_blocks(OpenedRecording(*two_wheels)), "FR")
    hello = next(f.message for f in frames if f.wheel == 1 and isinstance(f.message, Hello))
    sent = [f.message for f in frames if f.wheel == 1 and isinstance(f.message, SampleBlock)]
    counts = np.concatenate([block.counts for block in sent])
    scale, offset = np.array(hello.scale_mps2), np.array(hello.offset_counts)
    np.testing.assert_array_equal(result["axes"], (counts - offset) * scale)
    np.testing.assert_array_equal(result["number"], np.arange(sent[0].first_sample, sent[0].first_sample + len(counts)))


def test_hub_times_follow_the_time_stamps_from_the_first_sample(two_wheels, frames):
    result = joined(sample_blocks(OpenedRecording(*two_wheels)), "FL")
    stamps = {f.message.first_sample: f.tick_us for f in frames if f.wheel == 0 and isinstance(f.message, SampleBlock)}
    index = np.searchsorted(result["number"], list(stamps))
    assert np.abs(result["hub_s"][index] * 1e6 - np.array(list(stamps.values()))).max() < 3.0
    assert np.diff(result["hub_s"]).min() > 0.0


def test_rate_is_measured_against_the_hub_clock(two_wheels):
    blocks = [block for block in sample_blocks(OpenedRecording(*two_wheels)) if block.wheel == "FL"]
    assert blocks[-1].rate_hz == pytest.approx(RATE_HZ, rel=2e-6)


def test_host_times_are_the_arrival_of_the_fastest_frames(two_wheels):
    result = joined(sample_blocks(OpenedRecording(*two_wheels)), "FL")
    true_ns = START_NS + result["number"] / RATE_HZ / (1 + 250e-6) * 1e9
    delay_s = (result["host_ns"] - true_ns)[-9600:] * 1e-9
    # A block is sent when the last of its 36 samples is taken.
    assert delay_s.min() > 36 / RATE_HZ
    assert delay_s.max() < 36 / RATE_HZ + 2e-3


@pytest.mark.parametrize("duration_s", [3.0, 8.0])
def test_first_frames_that_come_late_bend_no_time(duration_s):
    scenario = parse_scenario(SCENARIO, "test")
    chunks = list(simulate(scenario, duration_s=duration_s).chunks("sim:test", START_NS))
    late = [replace(chunk, host_ns=max(chunk.host_ns, START_NS + 60_000_000)) for chunk in chunks]
    result = joined(sample_blocks(OpenedRecording(Held(late), parse_vehicle(vehicle_toml(scenario), "test"))), "FL")
    rates = 9600.0 / (result["host_ns"][4800:] - result["host_ns"][:-4800]) * 0.5e9
    np.testing.assert_allclose(rates, RATE_HZ * (1 + 250e-6), rtol=4e-4)


def test_chunks_do_not_change_samples(two_wheels, monkeypatch):
    whole = joined(sample_blocks(OpenedRecording(*two_wheels)), "FL")
    data = b"".join(chunk.data for chunk in two_wheels[0].items())
    arrivals = np.repeat(
        [chunk.host_ns for chunk in two_wheels[0].items()], [len(chunk.data) for chunk in two_wheels[0].items()]
    )
    pieces = [
        Chunk("sim:test", int(arrivals[hi - 1]), data[lo:hi]) for lo, hi in pairwise((*range(0, len(data), 777),))
    ]
    monkeypatch.setattr("gateway.core.recording.decoder_blocks._BLOCK_BYTES", 5000)
    cut = joined(sample_blocks(OpenedRecording(Held(pieces), two_wheels[1])), "FL")
    reference = len(cut["number"])
    assert reference > 0.99 * len(whole["number"])
    for name in ("number", "axes", "saturated"):
        np.testing.assert_array_equal(cut[name], whole[name][:reference])
    np.testing.assert_allclose(cut["hub_s"][:-9600], whole["hub_s"][: reference - 9600], atol=1e-9)


def test_late_samples_find_their_place():
    clean, vehicle = simulated("sim:lab?speed=max&duration=4&seed=2")
    late, _ = simulated("sim:lab?speed=max&duration=4&seed=2&fault=reorder:rate=0.05,depth=4")
    a, b = (
        joined(sample_blocks(OpenedRecording(items, vehicle)), vehicle.wheel[0].position) for items in (clean, late)
    )
    inside = b["number"] < b["number"][-1] - 2000  # a frame that is late at the very end is lost
    same = np.isin(a["number"], b["number"][inside])
    assert inside.sum() == b["number"][inside][-1] - b["number"][0] + 1
    np.testing.assert_array_equal(a["axes"][same], b["axes"][inside])


def test_lost_samples_are_counted_before_the_block_that_follows():
    items, vehicle = simulated("sim:lab?speed=max&duration=5&seed=2&fault=drop:rate=0.01")
    blocks = list(sample_blocks(OpenedRecording(items, vehicle)))
    assert sum(block.lost_before for block in blocks) > 0
    for first, other in pairwise(blocks):
        assert other.first_sample == first.first_sample + len(first) + other.lost_before
        assert other.segment == first.segment


def test_restart_of_the_hub_begins_a_segment():
    items, vehicle = simulated("sim:lab?speed=max&duration=8&seed=2&fault=reboot:at=4,gap=1")
    blocks = list(sample_blocks(OpenedRecording(items, vehicle)))
    assert sorted({block.segment for block in blocks}) == [0, 1]
    after = next(block for block in blocks if block.segment == 1)
    assert after.first_sample < 2000
    assert after.hub_time_s[0] < 1.0
    assert after.host_time_ns[0] > blocks[0].host_time_ns[0] + 4_000_000_000


def test_long_gap_begins_a_segment():
    items, vehicle = simulated("sim:lab?speed=max&duration=6&seed=2&fault=silence:part=2,at=2,for=1.5")
    first, other = (list(sample_blocks(OpenedRecording(items, vehicle)))[position] for position in (0, -1))
    assert (first.segment, other.segment) == (0, 1)
    lost = next(block.lost_before for block in sample_blocks(OpenedRecording(items, vehicle)) if block.segment == 1)
    assert lost == pytest.approx(1.5 * 9600, rel=0.02)


def test_contacts_of_revolutions_lie_in_the_samples():
    items, vehicle = simulated("sim:lab?speed=max&duration=4&seed=2")
    actual = joined(sample_blocks(OpenedRecording(items, vehicle)), vehicle.wheel[0].position)
    results = list(revolutions(OpenedRecording(items, vehicle)))
    assert len(results) > 20
    for result in results:
        index = np.searchsorted(actual["hub_s"], result.revolution.start_s)
        # In the contact the belt is straight, so the radial acceleration is small.
        assert abs(actual["axes"][index, 2]) < 0.1 * np.median(actual["axes"][:, 2])


def test_only_chosen_wheels_are_read(two_wheels):
    source, vehicle = two_wheels
    assert {item.wheel for item in signals(OpenedRecording(source, vehicle), wheels=("FR",))} == {"FR"}
    assert {result.position for result in revolutions(OpenedRecording(source, vehicle), wheels=("FR",))} == {"FR"}


def test_environment_has_the_times_of_its_frames(two_wheels):
    readings = [
        item
        for item in signals(OpenedRecording(*two_wheels))
        if isinstance(item, EnvironmentReading) and item.wheel == "FL"
    ]
    assert len(readings) == 6
    assert [reading.pressure_pa for reading in readings] == [pytest.approx(210e3, rel=0.02)] * 6
    assert np.diff([reading.hub_time_s for reading in readings]) == pytest.approx(1.0, rel=1e-3)
    assert readings[-1].host_time_ns == pytest.approx(START_NS + 5e9, abs=2e7)


def test_wheels_without_configuration_are_named_by_number(two_wheels):
    assert {item.wheel for item in signals(OpenedRecording(two_wheels[0]))} == {"hub0.wheel0", "hub0.wheel1"}


def test_blocks_come_before_the_recording_ends(monkeypatch):
    items, vehicle = simulated("sim:lab?speed=max&duration=8&seed=2")
    monkeypatch.setattr("gateway.core.recording.decoder_blocks._BLOCK_BYTES", 20_000)
    total = sum(len(item.data) for item in items.items() if isinstance(item, Chunk))
    for block in sample_blocks(OpenedRecording(items, vehicle)):
        held_s = items.read / total * 8.0 - block.hub_time_s[-1]
        assert held_s < recorded_signals._HOLD_S + 1.0
    assert items.read == total


def test_dump_has_no_host_times(tmp_path, two_wheels):
    path = tmp_path / "link.bin"
    path.write_bytes(b"".join(chunk.data for chunk in two_wheels[0].items()))
    dump = open_recorded_file(path)
    block = next(sample_blocks(OpenedRecording(dump)))
    assert isinstance(block, SignalBlock)
    assert not block.host_time_ns.any()
    assert block.hub_time_s[0] < 0.1
    assert dump.info.size_bytes == dump.position


def test_missing_file_is_a_recording_error(tmp_path):
    for name in ("none.mcap", "none.bin"):
        with pytest.raises(RecordingError, match="does not exist"):
            open_recorded_file(tmp_path / name)
