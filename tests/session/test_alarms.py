"""Alarms: one per crossed threshold, with value and limit."""

from dataclasses import replace

import pytest

from gateway.config.vehicle import Thresholds
from gateway.estimators.estimator import Estimate, Status
from gateway.pipeline.results import (
    LinkSnapshot,
    RevolutionResult,
    Silence,
    SilentPart,
    WheelCounters,
    WheelSnapshot,
)
from gateway.reasons import Code, Reason
from gateway.session.alarms import AlarmName, alarms, present_values, silent_alarms, superseded
from gateway.session.silence import SilentHub

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
LINK = LinkSnapshot("ble:x", True, Reason(Code.LINK_CONNECTED), 0, 1000, 0, 0, 0, 0, 0, 0, None, {}, 80)


@pytest.mark.parametrize(
    ("change", "name", "reason"),
    [
        (
            {"pressure_pa": 170e3},
            AlarmName.PRESSURE,
            Reason(Code.PRESSURE_BELOW_LIMIT, pressure_pa=170e3, limit_pa=180e3),
        ),
        (
            {"pressure_pa": 270e3},
            AlarmName.PRESSURE,
            Reason(Code.PRESSURE_ABOVE_LIMIT, pressure_pa=270e3, limit_pa=260e3),
        ),
        (
            {"temperature_degc": 95.0},
            AlarmName.TEMPERATURE,
            Reason(Code.TEMPERATURE_ABOVE_LIMIT, temperature_degc=95.0, limit_degc=90.0),
        ),
        ({"load_n": 6500.0}, AlarmName.LOAD, Reason(Code.LOAD_ABOVE_LIMIT, load_n=6500.0, limit_n=6000.0)),
        (
            {"wear_mm": Estimate("wear_mm", 6.0, 0.1, Status.VALID)},
            AlarmName.WEAR,
            Reason(Code.WEAR_ABOVE_LIMIT, wear_m=0.006, limit_m=0.005),
        ),
        (
            {"counters": WheelCounters(samples_saturated=3)},
            AlarmName.SATURATED,
            Reason(Code.SENSOR_RANGE_REACHED, count=3),
        ),
        ({"sensor_id": "0000a002"}, AlarmName.MISPLACED, Reason(Code.SENSOR_REPLACED, sensor="0000a002", expected="a")),
    ],
)
def test_wheel_alarm(change: dict[str, object], name: AlarmName, reason: Reason) -> None:
    assert alarms([WHEEL], [], LIMITS, {"FL": "a"}) == ()
    (alarm,) = alarms([replace(WHEEL, **change)], [], LIMITS, {"FL": "a"})
    assert (alarm.position, alarm.name, alarm.reason) == ("FL", name, reason)


@pytest.mark.parametrize(
    ("change", "name", "code"),
    [
        ({"connected": False, "note": Reason(Code.LINK_LOST)}, AlarmName.LINK, Code.LINK_DOWN),
        ({"recent_loss": 0.05}, AlarmName.LOSS, Code.FRAME_LOSS_ABOVE_LIMIT),
        ({"judged": {"verified": 10, "unsigned": 2}}, AlarmName.SECURITY, Code.FRAMES_NOT_TRUSTED),
        ({"battery_percent": 19}, AlarmName.BATTERY, Code.BATTERY_BELOW_LIMIT),
    ],
)
def test_link_alarm(change: dict[str, object], name: AlarmName, code: Code) -> None:
    assert alarms([], [LINK], LIMITS) == ()
    (alarm,) = alarms([], [replace(LINK, **change)], LIMITS)
    assert (alarm.position, alarm.name, alarm.reason.code) == ("ble:x", name, code)


def test_alarm_is_over_beyond_a_margin_only() -> None:
    stood = {("FL", AlarmName.PRESSURE): Code.PRESSURE_BELOW_LIMIT}
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
    quiet = Silence(SilentPart.HUB, 20.0, Reason(Code.HUB_OF_WHEEL_SILENT, silence_s=20.0))
    assert alarms([replace(wheel, silences=(quiet,))], [], limits) == ()
    assert ("FL", AlarmName.SPEED) in superseded([replace(wheel, silences=(quiet,))])


def test_present_values_say_what_is_normal_again() -> None:
    values = present_values([WHEEL], [LINK], LIMITS)
    assert values["FL", AlarmName.PRESSURE] == Reason(Code.PRESSURE_NOW, pressure_pa=220e3)
    assert values["ble:x", AlarmName.BATTERY] == Reason(Code.BATTERY_NOW, level=0.8)


def test_hubs_of_several_links_are_told_apart() -> None:
    silent = SilentHub("ble:x", 0, 4.0, ("FL",))
    (alone,) = silent_alarms([], [silent], [], several_links=False)
    (among,) = silent_alarms([], [silent], [], several_links=True)
    assert (alone.position, among.position) == ("hub 0", "hub 0 on ble:x")
    assert superseded([], [silent], several_links=True) == {("hub 0 on ble:x", AlarmName.SILENT)}


def test_unknown_values_and_limits_give_no_alarm() -> None:
    assert alarms([WheelSnapshot("FL")], [], LIMITS) == ()
    assert alarms([replace(WHEEL, pressure_pa=1.0, load_n=1e9)], [replace(LINK, recent_loss=0.9)], Thresholds()) == ()
