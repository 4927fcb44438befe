"""Sessions that publish: no receiver holds them, and what it misses is an alarm, on the screen and in the summary."""

import json
from dataclasses import replace

import pytest

from gateway.console.page import ViewState, compose
from gateway.core.clock import SystemClock
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.estimates.results import SinkSnapshot, SinkState
from gateway.core.links.source import open_source
from gateway.core.reasons import Code, CoreCode, Reason
from gateway.core.session.alarms import sink_alarms
from gateway.core.session.core import SessionCore
from gateway.core.session.live import LiveSession
from gateway.core.session.reasons import SessionCode
from gateway.core.text.session_summary import summary_lines
from gateway.publishing.publisher import Publisher
from gateway.publishing.reasons import PublishingCode
from gateway.publishing.sink import PublishedAlarm, PublishedRevolution
from gateway.publishing.sink_worker import SinkWorker
from tests.publishing.receivers import Receiver
from tests.testkit.commands import invoked, run
from tests.testkit.waiting import TIMEOUT_S


def test_stalled_receiver_does_not_hold_the_session() -> None:
    clock = SystemClock()
    stalled, good = Receiver(), Receiver()
    stalled.gate.clear()
    workers = [SinkWorker("stalled:x", stalled, clock, max_items=10), SinkWorker("good:x", good, clock)]
    publisher = Publisher(workers, clock)
    # Long enough that alarms are reviewed after the first drop, however fast the machine is.
    source = open_source("sim:lab?speed=max&duration=40", clock)
    vehicle = parse_vehicle(source.vehicle_toml, "lab")
    live = LiveSession([source], SessionCore(vehicle), clock, patient=[True], publication=publisher)
    live.start()
    assert live.wait(TIMEOUT_S)
    snapshot = live.close()
    revolutions = snapshot.wheels[0].counters.revolutions
    stalled.gate.set()
    held, free = publisher.close()
    assert revolutions > 60
    sent = [item for item in good.taken if isinstance(item, PublishedRevolution)]
    assert [item.result.revolution.index for item in sent] == list(range(revolutions))
    changes = [item.change for item in good.taken if isinstance(item, PublishedAlarm)]
    assert changes, "the receiver that takes items gets the alarm of the other"
    assert changes[0].alarm.position == "stalled:x"
    assert (free.published, free.dropped) == (len(sent) + len(changes), 0)
    assert held.dropped > 0
    assert held.published + held.dropped == free.published
    (record,) = snapshot.alarm_records
    assert (record.position, record.name) == ("stalled:x", "publishing")
    assert [sink.sink for sink in snapshot.sinks] == ["stalled:x", "good:x"]


def sink_of(state: SinkState, **numbers) -> SinkSnapshot:
    notes = {
        SinkState.UP: Reason(PublishingCode.SINK_CONNECTED),
        SinkState.STALLED: Reason(PublishingCode.SINK_STALLED),
    }
    lost = Reason(PublishingCode.SINK_LOST, error="connection refused", interval_s=10.0)
    return SinkSnapshot("mqtt://host/car", state, notes.get(state, lost), **numbers)


@pytest.mark.parametrize(
    ("sink", "code"),
    [
        (sink_of(SinkState.UP, published=9), None),
        (sink_of(SinkState.CONNECTING, since_s=1.0), None),
        (sink_of(SinkState.DOWN, since_s=1.0), None),
        (sink_of(SinkState.DOWN, since_s=2.5, waiting=3), SessionCode.SINK_DOWN),
        (sink_of(SinkState.STALLED, since_s=2.5, waiting=3), SessionCode.SINK_DOWN),
        (sink_of(SinkState.UP, dropped=4, is_dropping=True), SessionCode.SINK_DROPS),
        (sink_of(SinkState.ENDED, since_s=99.0), None),
    ],
)
def test_outputs_have_an_alarm_when_away_or_dropping(sink: SinkSnapshot, code: Code | None) -> None:
    assert [alarm.reason.code for alarm in sink_alarms([sink])] == ([code] if code else [])


@pytest.mark.parametrize("cells", [80, 130])
def test_screen_shows_the_outputs(drive, cells: int) -> None:
    up = sink_of(SinkState.UP, published=1234)
    down = replace(sink_of(SinkState.DOWN, published=5, dropped=7, waiting=3, since_s=12.0), sink="can:virtual:x")
    snapshot = replace(drive[1], sinks=(up, down))
    rows = ["".join(text for text, _ in row) for row in compose(snapshot, ViewState(), cells, 40)]
    (first,) = (row for row in rows if row.startswith("mqtt://"))
    (second,) = (row for row in rows if row.startswith("can:virtual:x"))
    assert "up" in first
    assert "published 1234" in first
    assert "dropped 0" in first
    assert " DOWN 12 s " in second
    assert "dropped 7" in second
    assert all(len(row) == cells for row in rows)


def test_summary_counts_each_output(drive) -> None:
    done = replace(sink_of(SinkState.UP, published=8), note=Reason(CoreCode.SINK_CLOSED))
    away = sink_of(SinkState.DOWN, published=1, dropped=7)
    lines = summary_lines((), drive[1].links, (), (done, away))
    assert lines[-2] == "mqtt://host/car: 8 published, 0 dropped"
    assert lines[-1].startswith("mqtt://host/car: 1 published, 7 dropped; connection refused")


def test_replay_publishes_the_times_of_the_recording(tmp_path) -> None:
    recording, lines = tmp_path / "r.mcap", tmp_path / "lines.jsonl"
    run(f"live sim:lab?speed=max&duration=1.5 --plain --record {recording}")
    printed = run(f"replay {recording} --speed max --plain --publish jsonl:{lines}")
    times = [json.loads(line)["time_s"] for line in lines.read_text("utf-8").splitlines()]
    assert f"jsonl:{lines}: {len(times)} published, 0 dropped" in printed
    assert len(times) > 10
    assert times == sorted(times)
    assert times[-1] - times[0] == pytest.approx(1.2, abs=0.3)
    again = invoked(f"replay {recording} --publish jsonl:{lines}")
    assert again.exit_code == 1
    assert "exists" in str(again.exception)
