"""Trends: the last revolution of each second for ten minutes, and their plot on the console."""

import dataclasses
import math

import pytest

from gateway.console.trend_history import SPAN_S, TrendHistory, TrendPoint
from gateway.console.trend_plot import SHOWN_S, draw_trend
from gateway.console.waveform import Ink
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.reasons import Reason
from gateway.ring.reasons import RingCode


def drawn(values, unit="km/h", std=math.nan, width=67, height=12, later_s=0):
    points = [TrendPoint(at_s, value, std, Status.VALID) for at_s, value in values]
    return draw_trend(points, unit, width, height, (values[-1][0] if values else 0) + later_s)


def texts(rows):
    return ["".join(text for text, _ in row) for row in rows]


def test_fills_its_area_and_shows_scale_and_times() -> None:
    rows = texts(drawn([(at_s, 50.0 + at_s / 10.0) for at_s in range(SHOWN_S + 1)]))
    assert {len(row) for row in rows} == {67}
    assert len(rows) == 12
    assert rows[-1].strip().startswith("km/h -3 min")
    assert rows[-1].endswith("now")
    assert any("60┤" in row for row in rows)
    first = [
        min(i for i, cell in enumerate(row[7:]) if cell > "⠀") for row in rows[:-2] if any(c > "⠀" for c in row[7:])
    ]
    assert first == sorted(first, reverse=True)  # it rises to the right


def test_gap_is_not_drawn_through_and_old_values_leave() -> None:
    rows = texts(drawn([*((at_s, 5.0) for at_s in range(200, 261)), *((at_s, 5.0) for at_s in range(320, 381))]))
    line = max((row[7:] for row in rows[:-2]), key=lambda row: sum(cell > "⠀" for cell in row))
    assert line[:20].strip()
    assert not line[22:38].strip()
    assert line[42:].strip()


def test_line_ends_at_the_last_value() -> None:
    values = [(at_s, 5.0) for at_s in range(SHOWN_S + 1)]
    for later_s in (0, 60, 120):
        rows = texts(drawn(values, later_s=later_s))
        line = max((row[7:] for row in rows[:-2]), key=lambda row: sum(cell > "⠀" for cell in row))
        assert 1.0 - len(line.rstrip(" ⠀")) / len(line) == pytest.approx(later_s / SHOWN_S, abs=0.02)
    assert drawn(values, later_s=SHOWN_S + 1) == ()


def test_error_is_dotted_about_the_line() -> None:
    values = [(at_s, 5.0) for at_s in range(SHOWN_S + 1)]

    def dotted(rows):
        return sum(len(text.strip()) for row in rows[:-2] for text, ink in row if ink is Ink.AVERAGE)

    assert dotted(drawn(values, std=0.5)) > 100
    assert dotted(drawn(values)) < 60


@pytest.mark.parametrize(("value", "label"), [(2.85e-3, "2.85"), (3.0e6, "3.00")])
def test_small_and_large_values_have_a_power_of_ten(value, label) -> None:
    rows = texts(drawn([(at_s, value) for at_s in range(60)], unit=""))
    assert any(row.split("┤")[0].strip().startswith(label) for row in rows[:-2])
    assert rows[-1].strip().startswith("e-3" if value < 1 else "e6")


def test_no_value_and_no_room_draw_nothing() -> None:
    assert drawn([]) == drawn([(0, 1.0)], width=10) == drawn([(0, 1.0)], height=3) == ()


START_S = 1_700_000_000


def result_at(result, at_s, speed_mps=20.0, status=Status.VALID, position="FL"):
    estimates = (
        Estimate("speed_mps", speed_mps, 0.1, status)
        if status is not Status.INVALID
        else Estimate.invalid("speed_mps", Reason(RingCode.NEEDS_LOAD)),
        Estimate("Rs", 3.0, math.nan, Status.PROVISIONAL),
        Estimate("vehicle_speed_age_s", 0.1, 0.0, Status.VALID),
    )
    host_ns = round((START_S + at_s) * 1e9)
    return dataclasses.replace(result, host_ns=host_ns, estimates=estimates, position=position)


@pytest.fixture
def history():
    return TrendHistory()


def test_last_revolution_of_each_second_in_shown_units(history, made) -> None:
    for at_s, speed_mps in [(0.1, 10.0), (0.9, 11.0), (1.2, 12.0), (2.5, 13.0)]:
        history.add(result_at(made.result(), at_s, speed_mps))
    points = history.points("FL", "speed_mps")
    assert [point.at_s - START_S for point in points] == [0, 1, 2]
    assert [point.value for point in points] == pytest.approx([39.6, 43.2, 46.8], rel=1e-6)
    assert [point.std for point in points] == pytest.approx([0.36] * 3, rel=1e-6)
    assert {point.status for point in points} == {Status.VALID}
    assert {point.status for point in history.points("FL", "Rs")} == {Status.PROVISIONAL}
    assert [point.at_s - START_S for point in history.points("FL", "speed_mps", START_S + 1)] == [1, 2]


def test_invalid_value_and_unknown_names_have_no_point(history, made) -> None:
    for at_s, status in enumerate([Status.VALID, Status.INVALID, Status.INVALID]):
        history.add(result_at(made.result(), at_s, status=status))
    assert [point.at_s - START_S for point in history.points("FL", "speed_mps")] == [0]
    assert history.points("FL", "nothing") == history.points("nowhere", "speed_mps") == []


def test_old_points_end_and_quantities_have_words(history, made) -> None:
    for at_s in range(SPAN_S + 100):
        history.add(result_at(made.result(), at_s))
    points = history.points("FL", "speed_mps")
    assert points[-1].at_s - points[0].at_s == SPAN_S
    quantities = {quantity.name: quantity for quantity in history.quantities()}
    assert list(quantities) == ["speed_mps", "Rs", "pressure_pa", "temperature_degc"]
    assert quantities["speed_mps"][1:] == ("speed", "km/h", "rolling speed")
    assert history.points("FL", "pressure_pa")[-1].value == pytest.approx(210.0)
