"""Alarms as events: raised and over with time and value, without a flood."""

from gateway.pipeline.results import Alarm
from gateway.reasons import Code, Level, Reason
from gateway.session.alarm_log import AlarmLog
from gateway.session.alarms import AlarmName
from gateway.views.wording import notice_text

KEY = ("FL", AlarmName.PRESSURE)


def low(pressure_pa: float = 210e3) -> Alarm:
    reason = Reason(Code.PRESSURE_BELOW_LIMIT, pressure_pa=pressure_pa, limit_pa=230e3)
    return Alarm("FL", AlarmName.PRESSURE, reason)


def silent(silence_s: float) -> Alarm:
    return Alarm("W1", AlarmName.SILENT, Reason(Code.SAMPLES_SILENT, silence_s=silence_s))


def test_alarm_is_raised_and_over_with_time_and_value() -> None:
    log = AlarmLog()
    (raised,) = log.update([low()], 3.0)
    assert (raised.subject, raised.level) == ("FL", Level.WARNING)
    assert notice_text(raised) == "FL: ALARM at 3.0 s: pressure 210 kPa is below 230 kPa"
    assert log.update([low(205e3)], 4.0) == []
    assert log.standing() == {KEY: Code.PRESSURE_BELOW_LIMIT}
    (over,) = log.update([], 5.5, values=lambda: {KEY: Reason(Code.PRESSURE_NOW, pressure_pa=236e3)})
    assert notice_text(over) == "FL: alarm over at 5.5 s, after 2.5 s: pressure 236 kPa"
    (record,) = log.records()
    assert (record.count, record.first_s, record.last_s, record.total_s) == (1, 3.0, 5.5, 2.5)
    assert record.reason["pressure_pa"] == 205e3
    assert not record.is_standing


def test_alarm_that_flutters_does_not_flood() -> None:
    log = AlarmLog()
    notices = []
    for second in range(40):
        notices += log.update([low()] if second % 2 else [], float(second))
    codes = [notice.reason.code for notice in notices]
    assert codes == 3 * [Code.ALARM_RAISED, Code.ALARM_CLEARED] + [Code.ALARM_COMES_AND_GOES]
    assert log.records()[0].count == 20
    (again,) = log.update([], 60.0) + log.update([low()], 150.0)
    assert again.reason.code is Code.ALARM_RAISED


def test_lasting_silence_is_repeated_rarely() -> None:
    log = AlarmLog()
    notices = [notice for second in range(7300) for notice in log.update([silent(1.0 + second)], float(second))]
    stands = [notice.reason["at_s"] for notice in notices if notice.reason.code is Code.ALARM_STANDS]
    assert stands == [60.0, 600.0, 3600.0, 7200.0]
    lasting = AlarmLog()
    assert sum(len(lasting.update([low()], float(second))) for second in range(100)) == 1


def test_other_reason_of_the_same_alarm_is_reported() -> None:
    log = AlarmLog()
    log.update([silent(2.0)], 0.0)
    gone = Alarm("W1", AlarmName.SILENT, Reason(Code.SENSOR_SILENT, silence_s=4.0))
    (notice,) = log.update([gone], 1.0)
    assert notice.reason["alarm"].code is Code.SENSOR_SILENT


def test_hidden_alarm_is_neither_reported_nor_over() -> None:
    log = AlarmLog()
    log.update([silent(2.0)], 0.0)
    assert log.update([], 1.0, hidden=[("W1", AlarmName.SILENT)]) == []
    assert log.standing() == {("W1", AlarmName.SILENT): Code.SAMPLES_SILENT}
    (over,) = log.update([], 9.0)
    assert over.reason["what"] == Reason(Code.SENDS_AGAIN, away_s=11.0)


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
    down = Alarm("ble:x", AlarmName.LINK, Reason(Code.LINK_DOWN, state=Reason(Code.LINK_LOST)))
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
    high = Reason(Code.PRESSURE_ABOVE_LIMIT, pressure_pa=290e3, limit_pa=260e3)
    log.update([Alarm("FL", AlarmName.PRESSURE, high)], 3.0)
    assert not log.records()[0].is_acknowledged
    log.acknowledge(4.0)
    log.update([], 5.0)
    log.update([low()], 6.0)
    assert not log.records()[0].is_acknowledged
    assert [change.state for change in log.take_changes()] == ["raised", "acknowledged", "over", "raised"]
