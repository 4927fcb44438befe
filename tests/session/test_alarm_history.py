"""The recording has when an alarm was raised, acknowledged and over, and `inspect` shows it."""

import json

from click.testing import CliRunner

from gateway.cli import treadlink
from gateway.io.source import LinkEvent, LinkEventKind
from gateway.recording.inspection import inspect_recording
from gateway.recording.writer import RecordingWriter
from gateway.session.core import SessionCore
from tests.session.test_computer_events import START_NS, S, frames_until


def test_history_of_an_alarm_is_recorded_and_inspected(tmp_path) -> None:
    items, vehicle = frames_until(3.0)
    path = tmp_path / "r.mcap"
    core = SessionCore(vehicle, recorder=RecordingWriter(path, start_ns=START_NS), estimators=("kinematic",))
    link = items[0].link
    for item in items:
        core.take(item)
    core.take(LinkEvent(link, START_NS + 4 * S, LinkEventKind.LOST, "unplugged"))
    core.tick(START_NS + 5 * S)
    core.acknowledge_alarms()
    states = [(change.alarm.name, change.state) for change in core.take_alarm_changes()]
    assert ("link", "acknowledged") in states
    core.take(LinkEvent(link, START_NS + 6 * S, LinkEventKind.RESTORED))
    core.tick(START_NS + 6 * S + S // 10)
    core.take(LinkEvent(link, START_NS + 7 * S, LinkEventKind.LOST, "unplugged"))
    core.tick(START_NS + 8 * S)
    core.finish()
    first, second = [alarm for alarm in inspect_recording(path).alarms if alarm.name == "link"]
    assert first.subject == link
    assert first.end_ns is not None
    assert first.acknowledged_ns is not None
    assert first.begin_ns <= first.acknowledged_ns <= first.end_ns <= second.begin_ns
    assert (second.acknowledged_ns, second.end_ns) == (None, None)
    assert "unplugged" in second.text
    printed = CliRunner().invoke(treadlink, ["inspect", str(path)], catch_exceptions=False).output
    assert "(acknowledged at " in printed
    assert "to the end" in printed
    listed = json.loads(CliRunner().invoke(treadlink, ["inspect", "--json", str(path)]).stdout)["alarms"]
    assert [alarm["name"] for alarm in listed].count("link") == 2
