"""`inspect` reports losses to the sample, rates, restarts and events."""

import json

import numpy as np
import pytest

from firmware_protocol.codec import encode_frame
from firmware_protocol.messages import Coupling, Frame, Hello, MessageType, SampleBlock
from gateway.core.errors import RecordingError
from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind
from gateway.core.recording.inspection import WheelInspection, inspect_recording
from gateway.core.recording.writer import RecordingWriter
from tests.testkit.commands import invoked, run

START_NS = 1_700_000_000_000_000_000
RATE_HZ = 5000.0


def hello(boot_count):
    return Hello(
        1, 0, 0xAB, 0x1234, (1, 2, 3), boot_count, 4800.0, 0b100, Coupling.AC, 0.5,
        (0.0, 0.0, 19620.0), (0.0, 0.0, 0.6), (0.0, 0.0, 0.0), 32767,
    )  # fmt: skip


def frames(boot_count, blocks, wheel=0):
    yield Frame(MessageType.HELLO, 0, wheel, 0, 0, hello(boot_count))
    for i in range(blocks):
        block = SampleBlock(i * 50, 0b100, np.full((50, 1), i, np.int16))
        yield Frame(MessageType.SAMPLES, 0, wheel, i + 1, round(i * 50 / RATE_HZ * 1e6), block)


@pytest.fixture
def recording(tmp_path):
    path = tmp_path / "day.mcap"
    writer = RecordingWriter(path, start_ns=START_NS, sources=["serial:///dev/ttyUSB0"])
    position = START_NS
    lost = {40, 41, 333}
    for boot, blocks in ((7, 400), (8, 300)):
        for i, frame in enumerate(frames(boot, blocks)):
            position += 10_000_000
            if boot == 8 or i not in lost:
                writer.write(Chunk("serial:hub", position, encode_frame(frame)))
        if boot == 7:
            position += 2_000_000_000
    writer.write(LinkEvent("user", position, LinkEventKind.MARK, "curb \x1b[31m"))
    writer.close()
    return path


def test_losses_rates_restarts_and_events(recording):
    result = inspect_recording(recording)
    link = result.links["serial:hub"]
    wheel = link.wheels[(0, 0)]
    assert wheel.samples == (400 - 3 + 300) * 50
    assert wheel.samples_lost == 3 * 50
    assert link.counters.lost == 3
    assert wheel.boots == [7, 8]
    assert wheel.measured_hz == pytest.approx(RATE_HZ, rel=1e-6)
    assert wheel.frames == {"samples": 697, "hello": 2}
    assert link.longest_silence_s == pytest.approx(2.01)
    assert sum(samples for samples, _ in wheel.seconds.values()) == wheel.samples
    assert sum(missing for _, missing in wheel.seconds.values()) == wheel.samples_lost
    assert [event.kind for event in result.events] == [LinkEventKind.MARK]
    assert result.damage is None


@pytest.mark.parametrize("gap_min", [1, 40, 80, 1000])
def test_ticks_that_wrapped_in_a_gap_do_not_change_the_measured_rate(gap_min):
    wheel = WheelInspection(hello=hello(1))
    begin = gap_min * 60 * 4800
    for sample in [*range(0, 48_000, 48), *range(begin, begin + 48_000, 48)]:
        wheel.add(sample, 48, round(sample / 4800.5 * 1e6) & 0xFFFFFFFF, 0)
    assert wheel.measured_hz == pytest.approx(4800.5, rel=1e-6)
    assert wheel.samples_lost == begin - 48_000


def test_only_a_block_that_was_missing_repairs_a_loss():
    wheel = WheelInspection(hello=hello(1))

    def add(*blocks):
        for block in blocks:
            wheel.add(block * 48, 48, block * 10_000, 0)

    add(*range(40), *range(60, 100))
    assert wheel.samples_lost == 20 * 48
    add(*range(20, 40), *range(60, 65))
    assert wheel.samples_lost == 20 * 48
    add(45, 45, 59, 40, 45, 100)
    assert wheel.samples_lost == 17 * 48
    wheel.add(44 * 48 + 24, 48, 445_000, 0)
    assert wheel.samples_lost == 17 * 48 - 24
    for block in range(200, 400, 2):
        add(block)
    lost = wheel.samples_lost
    add(397, 41)
    assert wheel.samples_lost == lost - 48, "gaps of long ago are forgotten"


def test_text_and_json_agree_and_are_clean(recording):
    text = run("inspect", recording)
    assert "150 lost" in text
    assert "5000.00 Hz by the hub's clock" in text
    assert "AC above 0.5 Hz" in text
    assert "boot counts 7, 8" in text
    assert "x: samples lost" in text
    assert "curb" in text
    assert "\x1b" not in text
    data = json.loads(invoked("inspect", recording, "--json").output)
    (source,) = data["links"]["serial:hub"]["sources"]
    assert (source["samples_lost"], source["samples"], source["boots"]) == (150, 697 * 50, [7, 8])
    assert data["finished"]


def test_event_just_before_the_first_chunk_is_at_zero(tmp_path):
    path = tmp_path / "live.mcap"
    writer = RecordingWriter(path, start_ns=START_NS, sources=["serial:hub"])
    (frame, *_) = frames(1, 1)
    writer.write(Chunk("serial:hub", START_NS, encode_frame(frame)))
    writer.write(LinkEvent("serial:hub", START_NS - 3_000_000, LinkEventKind.CONNECTED))
    writer.close()
    output = invoked("inspect", path).output
    assert " 0.00 s  serial:hub" in output
    assert "-0.00" not in output


def test_truncated_recording_is_shown_to_its_end(recording, tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(recording.read_bytes()[: recording.stat().st_size // 2])
    result = inspect_recording(cut)
    assert not result.info.finished
    assert result.links["serial:hub"].wheels[(0, 0)].samples > 5000
    output = invoked("inspect", cut).output
    assert "treadlink repair" in output


def test_other_files_are_rejected(tmp_path):
    (tmp_path / "x.mcap").write_bytes(b"hello")
    with pytest.raises(RecordingError, match="not a recording"):
        inspect_recording(tmp_path / "x.mcap")
