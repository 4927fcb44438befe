"""The synchronous session: recordings replay to the same results, and a failing disk does not end it."""

import json
import threading
from dataclasses import replace
from urllib.parse import unquote

import pytest
from mcap.reader import make_reader

from gateway.core.clock import ManualClock
from gateway.core.errors import RecordingError
from gateway.core.links.reasons import LinkCode
from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind, open_source
from gateway.core.reasons import Level, Notice, Reason
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.writer import RecordingWriter
from gateway.core.session.alarms import AlarmName
from gateway.core.session.core import SessionCore
from gateway.core.session.reasons import SessionCode
from gateway.core.session.recording_pass import OpenedRecording, RecordingPass
from tests.testkit.agreement import assert_agree


def run(items, vehicle, recorder=None):
    core = SessionCore(vehicle, recorder=recorder)
    results = [result for item in items for result in core.take(item)]
    return results + core.finish(), core


@pytest.fixture(scope="module")
def recorded(demo, tmp_path_factory):
    items, vehicle = demo
    path = tmp_path_factory.mktemp("session") / "demo.mcap"
    recorder = RecordingWriter(path, start_ns=items[0].host_ns, vehicle_toml=vehicle.to_toml(), sources=["sim:demo"])
    results, core = run(items, vehicle, recorder)
    return path, results, core


def test_live_replay_and_batch_agree(demo, recorded, by_wheel):
    items, vehicle = demo
    path, live, core = recorded
    assert len(live) > 80
    source = open_source(f"replay:{path}?speed=max", ManualClock())
    again = list(source.items(threading.Event()))
    assert b"".join(item.data for item in again if isinstance(item, Chunk)) == b"".join(
        item.data for item in items if isinstance(item, Chunk)
    )
    replayed, _ = run(again, vehicle)
    assert by_wheel(replayed) == by_wheel(live)
    batch = RecordingPass(OpenedRecording(RecordingReader(path), vehicle))
    assert_agree(list(batch), live)
    (link,) = core.snapshot(0.0).links
    (counted,) = batch.links.values()
    assert (counted.frames, counted.lost, counted.crc_errors) == (link.frames, link.frames_lost, link.crc_errors)
    assert link.frames_lost > 0
    assert link.crc_errors > 0


def test_stock_reader_finds_topics_to_plot(recorded):
    path, live, _ = recorded
    rows = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            if channel.message_encoding == "json":
                payload = json.loads(message.data)
                assert set(payload) <= set(json.loads(schema.data)["properties"]) | set(payload)
                rows.setdefault(channel.topic, []).append(payload)
    for position in ("FL", "FR", "RL", "RR"):
        of_wheel = [result for result in live if result.position == position]
        assert len(rows[f"/wheel/{position}/revolution"]) == len(of_wheel)
        assert {"speed_mps", "speed_mps_std", "Cw", "Cw_std", "Cw_status"} <= set(
            rows[f"/wheel/{position}/revolution"][-1]
        )
        assert len(rows[f"/wheel/{position}/waveform"][0]["radial_mps2"]) == 256
        assert rows[f"/wheel/{position}/environment"][0]["pressure_pa"] > 1e5
    assert rows["/hub/0/hello"][0]["rate_hz"] == 9600.0
    assert rows["/hub/0/status"]


class FullDisk:
    """A recorder on a disk that is full after a number of writes."""

    path, size_bytes = "full.mcap", 12345

    def __init__(self, room):
        self.room = room
        self.closed = False

    def write(self, item):
        self.room -= 1
        if self.room < 0:
            raise RecordingError("cannot write 'full.mcap': No space left on device", "Free some space.")

    def write_topic(self, topic, host_ns, payload):
        self.write(None)

    def tick(self, now_ns):
        pass

    def close(self):
        self.closed = True


def test_full_disk_stops_the_recording_only(demo, recorded, by_wheel):
    items, vehicle = demo
    recorder = FullDisk(100)
    results, core = run(items, vehicle, recorder)
    assert by_wheel(results) == by_wheel(recorded[1])
    assert recorder.closed
    assert "No space left" in core.recording.fault
    assert (
        Notice(
            "",
            Reason(
                SessionCode.RECORDING_STOPPED,
                error="cannot write 'full.mcap': No space left on device",
                remedy="Free some space.",
            ),
            Level.ERROR,
        )
        in core.snapshot(0.0).notices
    )


def test_marks_and_link_events_are_recorded_and_reported(demo, tmp_path):
    items, vehicle = demo
    recorder = RecordingWriter(tmp_path / "marks.mcap", start_ns=items[0].host_ns)
    core = SessionCore(vehicle, recorder=recorder)
    position = items[5].host_ns
    events = [
        LinkEvent("user", position, LinkEventKind.MARK, "curb hit"),
        LinkEvent("sim:demo", position, LinkEventKind.LOST, "unplugged"),
    ]
    for item in (*items[:5], *events):
        core.take(item)
    assert not core.snapshot(0.0).links[0].connected
    assert AlarmName.LINK in {alarm.name for alarm in core.snapshot(0.0).alarms}
    core.finish()
    lost = Reason(
        LinkCode.LINK_EVENT, event=Reason(LinkCode.LINK_LOST), details=(Reason(LinkCode.QUOTED_TEXT, text="unplugged"),)
    )
    notices = core.take_notices()
    assert Notice("", Reason(LinkCode.MARK, text="curb hit")) in notices
    assert Notice("sim:demo", lost, Level.WARNING) in notices
    remaining = [item for item in RecordingReader(tmp_path / "marks.mcap").items() if isinstance(item, LinkEvent)]
    assert [
        (event.kind, event.text) for event in remaining if event.kind in (LinkEventKind.MARK, LinkEventKind.LOST)
    ] == [
        (LinkEventKind.MARK, "curb hit"),
        (LinkEventKind.LOST, "unplugged"),
    ]


def test_thresholds_become_alarms(demo):
    items, vehicle = demo
    strict = vehicle.model_copy(
        update={
            "thresholds": vehicle.thresholds.model_copy(
                update={"pressure_min_kpa": 300.0, "speed_max_kmh": 20.0, "frame_loss_max_percent": 0.1}
            )
        }
    )
    core = SessionCore(strict)
    for item in items[:-1]:  # the wheels of a link that has ended have no speed
        core.take(item)
    texts = {f"{alarm.position} {alarm.name}" for alarm in core.snapshot(0.0).alarms}
    assert {"FL pressure", "FL speed", "RR pressure", "sim:demo loss"} <= texts


def test_assumed_radius_is_reported_without_configuration(demo):
    items, _ = demo
    core = SessionCore(None)
    results = [result for item in items for result in core.take(item)]
    assert {result.position for result in results} == {f"hub0.wheel{i}" for i in range(4)}
    reasons = [notice.reason for notice in core.take_notices()]
    assert reasons.count(Reason(SessionCode.WHEEL_NOT_CONFIGURED, vehicle_file="none", radius_m=0.32)) == 4


def test_two_links_with_one_hub_number_are_recorded(demo, tmp_path):
    """Wheels of the second link are named for it; the path of a device has slashes, which separate topics."""
    items, vehicle = demo
    both = [
        replace(item, link=link, host_ns=item.host_ns + index)
        for item in items
        for index, link in enumerate(("serial:/dev/ttyUSB0", "serial:/dev/ttyUSB1"))
    ]
    path = tmp_path / "two.mcap"
    results, core = run(both, vehicle, RecordingWriter(path, start_ns=items[0].host_ns))
    assert core.recording.fault is None
    seconds = {f"hub0.wheel{wheel} on serial:/dev/ttyUSB1" for wheel in range(4)}
    assert {result.position for result in results} == {"FL", "FR", "RL", "RR"} | seconds
    with path.open("rb") as file:
        topics = {channel.topic for channel in make_reader(file).get_summary().channels.values()}
    assert {unquote(topic.split("/")[2]) for topic in topics if topic.endswith("/revolution")} == {
        result.position for result in results
    }


def test_event_details_survive_recording(tmp_path):
    details = (Reason(LinkCode.MTU_TOO_SMALL, mtu=100, needed=247), Reason(LinkCode.LINK_AWAY, away_s=3.5))
    event = LinkEvent("ble:x", 5, LinkEventKind.RESTORED, rssi_dbm=-70, details=details)
    writer = RecordingWriter(tmp_path / "r.mcap", start_ns=1)
    writer.write(event)
    writer.close()
    assert [item for item in RecordingReader(tmp_path / "r.mcap").items() if isinstance(item, LinkEvent)] == [event]


def test_silent_link_returns_waiting_revolutions(demo):
    items, vehicle = demo
    core = SessionCore(vehicle)
    taken = items[: len(items) // 2 - 20]
    results = [result for item in taken for result in core.take(item)]
    now_ns = taken[-1].host_ns
    assert not core.tick(now_ns + 100_000_000)
    waiting = core.tick(now_ns + 500_000_000)
    assert waiting
    latest = {result.position: result.revolution.index for result in results}
    assert all(result.revolution.index > latest[result.position] for result in waiting)
    assert not core.tick(now_ns + 600_000_000)
