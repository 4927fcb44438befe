"""The trend on the console: values, errors, gaps and scales."""

import math

import pytest

from gateway.estimators.estimator import Status
from gateway.views.console.trend_plot import SHOWN_S, draw_trend
from gateway.views.console.waveform import Ink
from gateway.views.trend_history import TrendPoint


def drawn(values, unit="km/h", std=math.nan, width=67, height=12):
    points = [TrendPoint(at_s, value, std, Status.VALID) for at_s, value in values]
    return draw_trend(points, unit, width, height)


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
