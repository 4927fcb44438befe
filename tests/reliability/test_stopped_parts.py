"""What stops within a session, a thread, its recording or a source, is named; the rest goes on, the session fails."""

import threading
from pathlib import Path

import pytest

from gateway.core.cli.session_setup import RunningSession, start_session
from gateway.core.clock import SystemClock
from gateway.core.errors import TreadlinkError
from gateway.core.estimates.registry import ESTIMATORS
from gateway.core.links.source import BusFrames, Chunk, LinkEvent, LinkEventKind
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.writer import RecordingWriter
from gateway.core.session import live as live_module
from gateway.core.session.alarms import AlarmName
from gateway.core.session.core import SessionCore
from gateway.core.session.live import LiveSession, Recordings
from gateway.core.session.reasons import SessionCode
from tests.reliability.sessions import TIMEOUT_S, Items, SlowWriter, prepare
from tests.reliability.streams import link_bytes
from tests.testkit.commands import invoked
from tests.testkit.waiting import until

# Of a session with a recording, live outputs and the socket of commands, until the session is asked to end.
THREADS = {
    "read sim:lab": "read sim:",
    "session": "session",
    "core watch": "core watch",
    "publish jsonl": "publish jsonl:",
    "control": "control",
}


def opened(folder: Path, source: str) -> RunningSession:
    return start_session(
        [source],
        record=folder / "r.mcap",
        publish=[f"jsonl:{folder / 'lines.jsonl'}"],
        config_path=None,
        estimators=(),
        key_file=None,
        effects_paths=(),
        duration_s=None,
    )


def test_names_of_the_threads_are_those_tested(tmp_path: Path, tcp_hub) -> None:
    before = set(threading.enumerate())
    session = opened(tmp_path, f"tcp://127.0.0.1:{tcp_hub.port}")
    names = {thread.name for thread in set(threading.enumerate()) - before if not thread.name.startswith("Thread-")}
    session.live.close()
    assert session.publisher is not None
    session.publisher.close()
    tested = {*THREADS, "read tcp", "recording", "open-link"}
    assert {name.split(":")[0] for name in names} <= tested, "a test makes each raise, or stops its work"


@pytest.mark.parametrize("name", THREADS)
def test_thread_that_raises_fails_the_session_and_keeps_its_recording(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = threading.Thread.run

    def raising(self: threading.Thread) -> None:
        if self.name.startswith(THREADS[name]):
            raise ZeroDivisionError(f"in {name}")
        run(self)

    monkeypatch.setattr(threading.Thread, "run", raising)
    session = opened(tmp_path, "sim:lab?speed=max&duration=2")
    if name == "control":
        # It is begun for links that other commands can share; here in its place.
        other = threading.Thread(name="control", daemon=True)
        other.start()
        other.join()
    try:
        if name not in ("read sim:lab", "session"):
            assert session.live.wait(TIMEOUT_S)
        with pytest.raises(TreadlinkError, match=f"in {name}"):
            session.live.close()
    finally:
        assert session.publisher is not None
        session.publisher.close()
    if name in ("publish jsonl", "control", "core watch"):
        assert session.live.snapshot().wheels[0].counters.revolutions > 10
        assert RecordingReader(tmp_path / "r.mcap").info.finished
        assert any(notice.reason.code is SessionCode.THREAD_STOPPED for notice in session.live.notices())


def test_recording_that_fails_by_our_own_fault_is_an_alarm_and_a_failure(lab) -> None:
    items, vehicle = lab
    writer, hold = SlowWriter(), threading.Event()
    writer.error = ZeroDivisionError("in the writer")
    writer.gate.set()
    live = prepare(Items(items, before_end=lambda: hold.wait(TIMEOUT_S)), vehicle, writer)
    live.start()
    until(lambda: any(alarm.name == AlarmName.STOPPED for alarm in live.snapshot().alarms), TIMEOUT_S)
    (alarm,) = [alarm for alarm in live.snapshot().alarms if alarm.name == AlarmName.STOPPED]
    hold.set()
    assert live.wait(TIMEOUT_S)
    snapshot = live.close()
    assert (alarm.position, alarm.reason.code) == ("recording", SessionCode.RECORDING_STOPPED)
    assert snapshot.wheels[0].counters.revolutions > 40, "the estimates go on"
    assert "in the writer" in str(live.core.recording.fault), "which the exit status rests on"
    assert writer.closed


def test_source_that_raises_ends_alone(lab) -> None:
    items, vehicle = lab
    gate = threading.Event()

    class Raising(Items):
        def items(self, stop):
            gate.set()
            raise KeyError("lost in a plug-in")
            yield

    class After(Items):
        def items(self, stop):
            assert gate.wait(TIMEOUT_S)
            yield from super().items(stop)

    live = LiveSession(
        [After(items), Raising([], link="other:1")], SessionCore(vehicle), SystemClock(), patient=[True, True]
    )
    live.start()
    assert live.wait(TIMEOUT_S)
    with pytest.raises(TreadlinkError, match="lost in a plug-in"):
        live.close()
    assert live.snapshot().wheels[0].counters.revolutions > 40
    (lost,) = [link for link in live.snapshot().links if link.link == "other:1"]
    assert not lost.connected


@pytest.mark.parametrize("time_ns", [-1, 1 << 62, (1 << 64) + 5])
def test_item_without_a_possible_time_is_refused_alone(lab, tmp_path: Path, time_ns: int) -> None:
    items, vehicle = lab
    path = tmp_path / "r.mcap"
    bus = [BusFrames("can:x", host_ns, b"") for host_ns in (items[5].host_ns, time_ns, items[9].host_ns)]
    writer = RecordingWriter(path, start_ns=items[0].host_ns)
    live = prepare(Items([*items[:5], *bus, Chunk("sim:lab", time_ns, b"x"), *items[5:]]), vehicle, writer)
    live.start()
    assert live.wait(TIMEOUT_S)
    snapshot = live.close()
    reader = RecordingReader(path)
    assert link_bytes(reader.items()) == link_bytes(items)
    assert reader.info.finished
    refused = [notice for notice in snapshot.notices if notice.reason.code is SessionCode.TIMES_REFUSED]
    assert {notice.subject for notice in refused} == {"can:x", "sim:lab"}
    assert [notice.reason["time_s"] for notice in refused] == [pytest.approx(time_ns * 1e-9)] * 2


@pytest.mark.parametrize("speed", ["1", "max"])
def test_log_of_a_bus_with_times_before_its_start_is_recorded_without_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, speed: str
) -> None:
    monkeypatch.chdir(tmp_path)
    lines = ["(40000000000.5) can0 123#11", "(1700000000.0) can0 123#22", "(30000000000.0) can0 123#33"]
    lines += [f"(1700000000.{tenths}) can0 123#44" for tenths in range(1, 4)]
    Path("bus.log").write_text("\n".join(lines) + "\n")
    # A time limit counts from the first frame that has a time.
    result = invoked(f"record sim:lab?speed=max can:bus.log?speed={speed} --duration 0.3 --out r.mcap")
    assert result.exit_code == 0, result.output
    frames = [item for item in RecordingReader(Path("r.mcap")).items() if isinstance(item, BusFrames)]
    assert sum(item.count for item in frames) == 4
    assert "3237-07-19" in result.output, "the time of the first is named"
    assert "2 dropped by time out of range" in result.output


def test_recording_refuses_a_time_without_a_place_and_can_be_finished(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "r.mcap", start_ns=0)
    writer.write(LinkEvent("a", 5, LinkEventKind.CONNECTED))
    with pytest.raises(TreadlinkError, match="no place"):
        writer.write(Chunk("a", 1 << 64, b"x"))
    writer.close()
    reader = RecordingReader(tmp_path / "r.mcap")
    assert reader.info.finished
    assert [item.host_ns for item in reader.items()] == [5]


class Hanging:
    """An estimator that does not return before `gate` is set."""

    name = "road"
    gate = threading.Event()

    def update(self, revolution, average, conditions):
        self.gate.wait(TIMEOUT_S)
        return ()

    def reset(self) -> None:
        pass


@pytest.fixture
def hanging(monkeypatch: pytest.MonkeyPatch):
    """Registers the estimator, and looks after it more often."""
    monkeypatch.setitem(ESTIMATORS, "road", f"{__name__}:Hanging")
    monkeypatch.setattr(live_module, "LOOK_S", 0.01)
    monkeypatch.setattr(Hanging, "gate", gate := threading.Event())
    yield gate
    gate.set()


def test_estimator_that_never_returns_is_named_and_the_recording_finished(lab, tmp_path: Path, hanging) -> None:
    items, vehicle = lab
    handed_over = threading.Event()
    path = tmp_path / "r.mcap"
    writer = RecordingWriter(path, start_ns=items[0].host_ns)
    source = Items(items, before_end=lambda: (handed_over.set(), live._stop.wait(TIMEOUT_S)))
    live = LiveSession(
        [source],
        SessionCore(vehicle, estimators=["road"]),
        SystemClock(),
        patient=[True],
        recordings=Recordings(writer),
    )
    live.start()
    until(lambda: any(alarm.position == "estimator road" for alarm in live.snapshot().alarms))
    (notice,) = [notice for notice in live.notices() if notice.reason.code is SessionCode.CORE_STUCK]
    assert notice.subject == "estimator road"
    assert 4.0 <= notice.reason["stuck_s"] <= 5.0
    assert handed_over.wait(TIMEOUT_S), "what can be recorded does not wait for it"
    with pytest.raises(TreadlinkError, match="estimator road has not returned"):
        live.close()
    reader = RecordingReader(path)
    assert reader.info.finished
    assert link_bytes(reader.items()) == link_bytes(items)
    assert live.snapshot().recorded_bytes == path.stat().st_size


def test_estimator_that_returns_late_is_no_failure(lab, hanging) -> None:
    items, vehicle = lab
    live = LiveSession([Items(items)], SessionCore(vehicle, estimators=["road"]), SystemClock(), patient=[True])
    live.start()
    codes = []
    until(lambda: codes.extend(notice.reason.code for notice in live.notices()) or SessionCode.CORE_STUCK in codes)
    hanging.set()
    assert live.wait(TIMEOUT_S)
    snapshot = live.close()
    assert snapshot.alarms == ()
    assert snapshot.wheels[0].counters.revolutions > 40


@pytest.mark.parametrize("command", ["record", "live --plain"])
def test_session_with_an_estimator_that_never_returns_fails(command: str, tmp_path: Path, hanging) -> None:
    option = "--record" if command.startswith("live") else "--out"
    result = invoked(f"{command} sim:lab?speed=max --estimator road --duration 2 {option} {tmp_path / 'r.mcap'}")
    assert isinstance(result.exception, TreadlinkError)
    assert "estimator road has not returned" in str(result.exception)
    assert "estimator road: does not answer" in result.output
    assert RecordingReader(tmp_path / "r.mcap").info.finished
    assert sum(1 for item in RecordingReader(tmp_path / "r.mcap").items()) > 150
