"""Alarms: one per crossed threshold with time and value, in recordings, of pairs of wheels, and of late losses."""

import json
from collections.abc import Iterator
from dataclasses import replace

import pytest
from click.testing import CliRunner

from gateway.core.cli import treadlink
from gateway.core.config.vehicle import Thresholds, parse_vehicle
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.results import (
    Alarm,
    LinkSnapshot,
    RevolutionResult,
    Silence,
    SilentPart,
    WheelCounters,
    WheelSnapshot,
)
from gateway.core.links.reasons import LinkCode
from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind
from gateway.core.reasons import Code, Level, Reason
from gateway.core.recording.inspection import inspect_recording
from gateway.core.recording.writer import RecordingWriter
from gateway.core.session.alarm_log import AlarmLog
from gateway.core.session.alarms import SILENCES, AlarmName, alarms, present_values, silent_alarms, superseded
from gateway.core.session.core import SessionCore
from gateway.core.session.reasons import SessionCode
from gateway.core.session.recent_loss import WINDOW_S, RecentLoss
from gateway.core.session.recording_pass import OpenedRecording, RecordingPass
from gateway.core.session.silence import SilentHub
from gateway.core.text.wording import notice_text
from gateway.core.trust.wheel_pairs import ALARM
from gateway.simulator.scenario import parse_scenario, vehicle_toml
from gateway.simulator.simulation import simulate
from tests.core.session.test_computer_events import START_NS, S, frames_until
from tests.testkit.commands import invoked

LIMITS = Thresholds(
    pressure_min_kpa=180.0,
    pressure_max_kpa=260.0,
    temperature_max_degc=90.0,
    load_max_n=6000.0,
    wear_max_mm=5.0,
    frame_loss_max_percent=1.0,
    battery_min_percent=20.0,
)
WHEEL = WheelSnapshot("FL", pressure_pa=220e3, temperature_degc=40.0, load_n=5000.0)
LINK = LinkSnapshot("ble:x", True, Reason(LinkCode.LINK_CONNECTED), 0, 1000, 0, 0, 0, 0, 0, 0, None, {}, 80)


@pytest.mark.parametrize(
    ("change", "name", "reason"),
    [
        (
            {"pressure_pa": 170e3},
            AlarmName.PRESSURE,
            Reason(SessionCode.VALUE_BELOW_LIMIT, quantity="pressure_pa", value=170e3, limit=180e3),
        ),
        (
            {"pressure_pa": 270e3},
            AlarmName.PRESSURE,
            Reason(SessionCode.VALUE_ABOVE_LIMIT, quantity="pressure_pa", value=270e3, limit=260e3),
        ),
        (
            {"temperature_degc": 95.0},
            AlarmName.TEMPERATURE,
            Reason(SessionCode.VALUE_ABOVE_LIMIT, quantity="temperature_degc", value=95.0, limit=90.0),
        ),
        (
            {"load_n": 6500.0},
            AlarmName.LOAD,
            Reason(SessionCode.VALUE_ABOVE_LIMIT, quantity="load_n", value=6500.0, limit=6000.0),
        ),
        (
            {"wear_mm": Estimate("wear_mm", 6.0, 0.1, Status.VALID)},
            AlarmName.WEAR,
            Reason(SessionCode.VALUE_ABOVE_LIMIT, quantity="wear_m", value=0.006, limit=0.005),
        ),
        (
            {"counters": WheelCounters(samples_saturated=3)},
            AlarmName.SATURATED,
            Reason(SessionCode.SENSOR_RANGE_REACHED, count=3),
        ),
        (
            {"sensor_id": "0000a002"},
            AlarmName.MISPLACED,
            Reason(SessionCode.OTHER_SENSOR, how="replaced", sensor="0000a002", expected="a"),
        ),
    ],
)
def test_wheel_alarm(change: dict[str, object], name: AlarmName, reason: Reason) -> None:
    assert alarms([WHEEL], [], LIMITS, {"FL": "a"}) == ()
    (alarm,) = alarms([replace(WHEEL, **change)], [], LIMITS, {"FL": "a"})
    assert (alarm.position, alarm.name, alarm.reason) == ("FL", name, reason)


@pytest.mark.parametrize(
    ("change", "name", "code"),
    [
        ({"connected": False, "note": Reason(LinkCode.LINK_LOST)}, AlarmName.LINK, SessionCode.LINK_DOWN),
        ({"recent_loss": 0.05}, AlarmName.LOSS, SessionCode.VALUE_ABOVE_LIMIT),
        ({"judged": {"verified": 10, "unsigned": 2}}, AlarmName.SECURITY, SessionCode.FRAMES_NOT_TRUSTED),
        ({"battery_percent": 19}, AlarmName.BATTERY, SessionCode.VALUE_BELOW_LIMIT),
    ],
)
def test_link_alarm(change: dict[str, object], name: AlarmName, code: Code) -> None:
    assert alarms([], [LINK], LIMITS) == ()
    (alarm,) = alarms([], [replace(LINK, **change)], LIMITS)
    assert (alarm.position, alarm.name, alarm.reason.code) == ("ble:x", name, code)


def test_alarm_is_over_beyond_a_margin_only() -> None:
    stood = {("FL", AlarmName.PRESSURE): SessionCode.VALUE_BELOW_LIMIT}
    for pressure_pa, stands in ((179e3, True), (181e3, True), (183e3, True), (185e3, False)):
        result = alarms([replace(WHEEL, pressure_pa=pressure_pa)], [], LIMITS, standing=stood)
        assert bool(result) is stands
        if pressure_pa > 180e3:
            assert alarms([replace(WHEEL, pressure_pa=pressure_pa)], [], LIMITS) == ()
    # The margin belongs to the limit that was crossed, not to the other one.
    assert alarms([replace(WHEEL, pressure_pa=257e3)], [], LIMITS, standing=stood) == ()


def test_silent_wheel_has_no_alarm_of_its_speed() -> None:
    limits = Thresholds(speed_max_kmh=10.0)
    fast = RevolutionResult("FL", 0, None, None, (Estimate("speed_mps", 30.0, 0.01, Status.VALID),))
    wheel = replace(WHEEL, last=fast)
    assert [alarm.name for alarm in alarms([wheel], [], limits)] == [AlarmName.SPEED]
    quiet = Silence(SilentPart.HUB, 20.0, Reason(SessionCode.HUB_OF_WHEEL_SILENT, silence_s=20.0))
    assert alarms([replace(wheel, silences=(quiet,))], [], limits) == ()
    assert ("FL", AlarmName.SPEED) in superseded([replace(wheel, silences=(quiet,))], [], [], {}, several_links=False)


def test_present_values_say_what_is_normal_again() -> None:
    values = present_values([WHEEL], [LINK], LIMITS)
    assert values["FL", AlarmName.PRESSURE] == Reason(SessionCode.VALUE_NOW, quantity="pressure_pa", value=220e3)
    assert values["ble:x", AlarmName.BATTERY] == Reason(SessionCode.VALUE_NOW, quantity="battery", value=0.8)


def test_hubs_of_several_links_are_told_apart() -> None:
    silent = SilentHub("ble:x", 0, 4.0, ("FL",))
    names: dict[tuple[str, int], str] = {}
    (alone,) = silent_alarms([], [silent], [], names, several_links=False)
    (among,) = silent_alarms([], [silent], [], {}, several_links=True)
    assert (alone.position, among.position) == ("hub 0", "hub 0 on ble:x")
    of_wheel = {("FL", name) for name in SILENCES}
    for known, name in (({}, "hub 0 on ble:x"), (names, "hub 0")):
        assert superseded([], [silent], [], known, several_links=True) == {(name, AlarmName.SILENT), *of_wheel}
    # A link that appears after the first alarm gives it no other name: it would seem over.
    assert silent_alarms([], [silent], [], names, several_links=True) == (alone,)


def test_unknown_values_and_limits_give_no_alarm() -> None:
    assert alarms([WheelSnapshot("FL")], [], LIMITS) == ()
    assert alarms([replace(WHEEL, pressure_pa=1.0, load_n=1e9)], [replace(LINK, recent_loss=0.9)], Thresholds()) == ()


KEY = ("FL", AlarmName.PRESSURE)


def low(pressure_pa: float = 210e3) -> Alarm:
    reason = Reason(SessionCode.VALUE_BELOW_LIMIT, quantity="pressure_pa", value=pressure_pa, limit=230e3)
    return Alarm("FL", AlarmName.PRESSURE, reason)


def silent(silence_s: float) -> Alarm:
    return Alarm("W1", AlarmName.SILENT, Reason(SessionCode.SAMPLES_SILENT, silence_s=silence_s))


def test_alarm_is_raised_and_over_with_time_and_value() -> None:
    log = AlarmLog()
    (raised,) = log.update([low()], 3.0)
    assert (raised.subject, raised.level) == ("FL", Level.WARNING)
    assert notice_text(raised) == "FL: ALARM at 3.0 s: pressure 210 kPa is below 230 kPa"
    assert log.update([low(205e3)], 4.0) == []
    assert log.standing() == {KEY: SessionCode.VALUE_BELOW_LIMIT}
    (over,) = log.update(
        [], 5.5, values=lambda: {KEY: Reason(SessionCode.VALUE_NOW, quantity="pressure_pa", value=236e3)}
    )
    assert notice_text(over) == "FL: alarm over at 5.5 s, after 2.5 s: pressure 236 kPa"
    (record,) = log.records()
    assert (record.count, record.first_s, record.last_s, record.total_s) == (1, 3.0, 5.5, 2.5)
    assert record.reason["value"] == 205e3
    assert not record.is_standing


def test_of_several_reasons_of_one_alarm_the_last_counts() -> None:
    log = AlarmLog()
    high = Alarm(*KEY, Reason(SessionCode.VALUE_ABOVE_LIMIT, quantity="pressure_pa", value=290e3, limit=260e3))
    assert len(log.update([low(), high], 0.0)) == 1
    assert log.update([low(), high], 0.1) == []
    assert log.records()[0].reason.code is SessionCode.VALUE_ABOVE_LIMIT


def test_alarm_that_flutters_does_not_flood() -> None:
    log = AlarmLog()
    notices = []
    for second in range(40):
        notices += log.update([low()] if second % 2 else [], float(second))
    codes = [notice.reason.code for notice in notices]
    assert codes == 3 * [SessionCode.ALARM_RAISED, SessionCode.ALARM_CLEARED] + [SessionCode.ALARM_COMES_AND_GOES]
    assert (log.records()[0].count, log.records()[0].first_s, log.records()[0].raised_s) == (20, 1.0, 39.0)
    (again,) = log.update([], 60.0) + log.update([low()], 150.0)
    assert again.reason.code is SessionCode.ALARM_RAISED


def test_lasting_silence_is_repeated_rarely() -> None:
    log = AlarmLog()
    notices = [notice for second in range(7300) for notice in log.update([silent(1.0 + second)], float(second))]
    stands = [notice.reason["at_s"] for notice in notices if notice.reason.code is SessionCode.ALARM_STANDS]
    assert stands == [60.0, 600.0, 3600.0, 7200.0]
    lasting = AlarmLog()
    assert sum(len(lasting.update([low()], float(second))) for second in range(100)) == 1


def test_other_reason_of_the_same_alarm_is_reported() -> None:
    log = AlarmLog()
    log.update([silent(2.0)], 0.0)
    gone = Alarm("W1", AlarmName.SILENT, Reason(SessionCode.SENSOR_SILENT, silence_s=4.0))
    (notice,) = log.update([gone], 1.0)
    assert notice.reason["alarm"].code is SessionCode.SENSOR_SILENT


def test_hidden_alarm_is_neither_reported_nor_over() -> None:
    log = AlarmLog()
    log.update([silent(2.0)], 0.0)
    assert log.update([], 1.0, hidden=[("W1", AlarmName.SILENT)]) == []
    assert log.standing() == {("W1", AlarmName.SILENT): SessionCode.SAMPLES_SILENT}
    (over,) = log.update([], 9.0)
    assert over.reason["what"] == Reason(SessionCode.SENDS_AGAIN, away_s=11.0)


def test_update_leaves_alarms_that_it_does_not_cover() -> None:
    log = AlarmLog()
    log.update([low(), silent(1.0)], 0.0)
    (over,) = log.update([], 1.0, covers=lambda key: key[0] == "W1")
    assert over.subject == "W1"
    assert log.standing_at("FL", 0.5) == (low(),)
    assert log.standing_at("W1", 0.5) == (silent(1.0),)
    assert log.standing_at("W1", 1.5) == ()


def test_alarms_of_links_are_left_to_their_events() -> None:
    log = AlarmLog()
    down = Alarm("ble:x", AlarmName.LINK, Reason(SessionCode.LINK_DOWN, state=Reason(LinkCode.LINK_LOST)))
    assert log.update([down], 1.0) == []
    assert [record.name for record in log.records()] == [AlarmName.LINK]


def test_an_acknowledged_alarm_is_new_with_another_reason_or_when_raised_again() -> None:
    log = AlarmLog()
    log.update([low()], 1.0)
    log.acknowledge(2.0)
    log.acknowledge(2.5)
    assert [(change.state, change.at_s, change.stood_s) for change in log.take_changes()] == [
        ("raised", 1.0, 0.0),
        ("acknowledged", 2.0, 1.0),
    ]
    assert log.records()[0].is_acknowledged
    high = Reason(SessionCode.VALUE_ABOVE_LIMIT, quantity="pressure_pa", value=290e3, limit=260e3)
    log.update([Alarm("FL", AlarmName.PRESSURE, high)], 3.0)
    assert not log.records()[0].is_acknowledged
    log.acknowledge(4.0)
    log.update([], 5.0)
    log.update([low()], 6.0)
    assert not log.records()[0].is_acknowledged
    assert [change.state for change in log.take_changes()] == ["raised", "acknowledged", "over", "raised"]


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
    listed = json.loads(invoked("inspect", "--json", path).stdout)["alarms"]
    assert [alarm["name"] for alarm in listed].count("link") == 2


PAIR_START_NS = 1_700_000_000_000_000_000
SCENARIO = """
[scenario]
seed = 3
[motion]
speed_kmh = 65.0
[sensor]
noise_mg_rthz = 5.0
[[wheel]]
position = "FL"
wheel = 0
slip_angle_deg = [[0, 0], [2, 1], [6, -1]]
[[wheel]]
position = "FR"
wheel = 1
slip_angle_deg = [[0, 0], [2, -1], [6, 1]]
"""
ESTIMATORS = ("kinematic", "slip-angle")


class Recorded:
    """Chunks in memory."""

    def __init__(self, chunks: list[Chunk]) -> None:
        self._chunks = chunks
        self.position = 0

    def items(self) -> Iterator[Chunk]:
        return iter(self._chunks)


def test_pair_alarm_begins_with_its_revolution() -> None:
    scenario = parse_scenario(SCENARIO, "test")
    chunks = list(simulate(scenario, duration_s=6.0).chunks("sim:test", PAIR_START_NS))
    vehicle = parse_vehicle(vehicle_toml(scenario), "test")
    core = SessionCore(vehicle, estimators=ESTIMATORS)
    raised: dict[str, float] = {}
    for chunk in chunks:
        core.take(chunk)
        core.tick(chunk.host_ns)
        for change in core.take_alarm_changes():
            if change.alarm.name == ALARM:
                raised.setdefault(change.alarm.position, change.at_s)
    batch = RecordingPass(OpenedRecording(Recorded(chunks), vehicle), ESTIMATORS)
    rows = [result for result in batch if any(alarm.name == ALARM for alarm in result.alarms)]
    recorded = {alarm.position: alarm.first_s for alarm in batch.alarms() if alarm.name == ALARM}
    assert set(recorded) == set(raised) == {"FL", "FR"}
    # Live shows a revolution a little after its end.
    assert recorded == pytest.approx(raised, abs=0.6)
    assert min(recorded.values()) < 5.2
    assert any(row.position == "FR" for row in rows)


SECOND_NS = 1_000_000_000


def test_a_gap_is_forgotten_after_the_window() -> None:
    loss = RecentLoss()
    assert loss.share(0, 0, 0) is None
    assert loss.share(SECOND_NS, 100, 0) == 0.0
    assert loss.share(2 * SECOND_NS, 200, 200) == pytest.approx(0.5)
    shares = [loss.share(second * SECOND_NS, 100 * second, 200) for second in range(3, 20)]
    assert shares[0] == pytest.approx(200 / 500)
    assert [share for second, share in enumerate(shares, 3) if second > 2 + WINDOW_S] == [0.0] * 7


def test_a_link_that_becomes_bad_after_a_day_is_told() -> None:
    loss = RecentLoss()
    for second in range(0, 86_400, 10):
        loss.share(second * SECOND_NS, 100 * second, 0)
    assert loss.share(86_401 * SECOND_NS, 8_640_000, 300) > 0.2


def test_times_that_are_set_back_begin_another_window() -> None:
    loss = RecentLoss()
    for second in range(3600, 3620):
        loss.share(second * SECOND_NS, 100 * second, 10 * min(second, 3610))
    shares = [loss.share(second * SECOND_NS, 362_000 + 100 * second, 36_100) for second in range(20)]
    assert shares == [None, *[0.0] * 19]


def test_late_frames_are_no_gain() -> None:
    loss = RecentLoss()
    loss.share(0, 100, 50)
    loss.share(SECOND_NS, 200, 50)
    loss.share(20 * SECOND_NS, 300, 50)
    assert loss.share(21 * SECOND_NS, 400, 10) == 0.0
