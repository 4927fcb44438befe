"""A sensor at another wheel is said to have moved, and two that change places are one finding."""

from dataclasses import replace

import numpy as np

from gateway.reasons import Code, Reason
from gateway.trends.fleet_analysis import analyse
from gateway.trends.moved_tires import findings_of_moves
from gateway.trends.tire_history import MONTH_NS, TireHistory
from gateway.views.wording import text
from tests.testkit.tire_histories import BEGIN_NS, history


def tire_at(position: str, sensor_id: str, begin_months: float, *, vehicle: str = "car", seed: int = 1) -> TireHistory:
    """Return three months of a tire at a wheel."""
    made = history(seed, 40, months=3.0, position=position, sensor_id=sensor_id, vehicle=vehicle)
    return replace(made, time_ns=made.time_ns + np.int64(round(begin_months * MONTH_NS)))


def test_two_sensors_that_change_wheels_are_one_finding() -> None:
    before = [tire_at("FL", "a1", 0.0), tire_at("FR", "a2", 0.0, seed=2)]
    after = [tire_at("FR", "a1", 3.1, seed=3), tire_at("FL", "a2", 3.2, seed=4), tire_at("RL", "a3", 0.0, seed=5)]
    trends = analyse([*before, *after], recordings=200)
    moved = [(tire.position, tire.sensor_id, tire.findings[0]) for tire in trends.tires if tire.findings]
    date = str(np.datetime64(BEGIN_NS + round(3.1 * MONTH_NS), "ns").astype("datetime64[D]"))
    expected = Reason(Code.TREND_TIRES_EXCHANGED, origin="FL", target="FR", date=date, sensor="a1", other="a2")
    assert moved == [("FR", "a1", expected)]
    assert "a1" in text(expected)
    assert "a2" in text(expected)


def test_a_sensor_that_moves_alone_is_named() -> None:
    (moved,) = findings_of_moves([tire_at("FL", "a1", 0.0), tire_at("RL", "a1", 4.0), tire_at("RL", "a2", 0.0)]).items()
    assert moved[0] == ("car", "RL", "a1")
    assert [(reason.code, reason["origin"]) for reason in moved[1]] == [(Code.TREND_TIRE_MOVED, "FL")]
    assert "RL" in text(moved[1][0])


def test_moves_at_other_times_or_vehicles_are_no_exchange() -> None:
    later = [tire_at("FL", "a1", 0.0), tire_at("FR", "a1", 3.1), tire_at("FR", "a2", 0.0), tire_at("FL", "a2", 9.0)]
    later[2] = replace(later[2], time_ns=later[2].time_ns + np.int64(round(5.0 * MONTH_NS)))
    other = [
        tire_at("FL", "a1", 0.0),
        tire_at("FR", "a1", 3.1),
        tire_at("FR", "a2", 0.0, vehicle="van"),
        tire_at("FL", "a2", 3.1, vehicle="van"),
    ]
    for histories in (later, other):
        codes = [reason.code for findings in findings_of_moves(histories).values() for reason in findings]
        assert codes == [Code.TREND_TIRE_MOVED] * 2


def test_an_unknown_sensor_and_one_that_stays_have_no_finding() -> None:
    assert findings_of_moves([tire_at("FL", "a1", 0.0), tire_at("FR", "a2", 3.1)]) == {}
    assert findings_of_moves([tire_at("FL", "", 0.0), tire_at("FR", "", 3.1)]) == {}
