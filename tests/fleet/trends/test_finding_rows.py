"""Each finding of a fleet says since when, how sure, and what to do."""

import re
from dataclasses import replace

import numpy as np
import pytest

from gateway.core.reasons import Reason
from gateway.core.shown_units import ShownUnits
from gateway.fleet.reasons import FleetCode
from gateway.fleet.trends.fleet_analysis import analyse
from gateway.fleet.trends.tire_history import MONTH_NS
from gateway.fleet.views.finding_rows import finding_rows
from gateway.fleet.views.trend_page import trends_page
from gateway.fleet.views.trend_tables import trends_csv, trends_json
from gateway.fleet.views.trend_terminal import trend_lines
from tests.testkit.tire_histories import history


def leaking_since(month: float, seed: int = 1):
    """Return a tire that loses 20 kPa a month from a time on, and that time in ns."""
    tire = history(seed, 60, sensor_id="a1", vehicle="van 7")
    lost_pa = 20e3 * np.maximum(tire.months - month, 0.0)
    tire.columns["pressure_pa"][:] -= lost_pa
    return tire, int(tire.time_ns[0] + month * MONTH_NS)


@pytest.mark.parametrize("month", [5.0, 6.5])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_finding_of_a_leak_has_the_date_on_which_it_began(month: float, seed: int):
    tire, begin_ns = leaking_since(month, seed)
    (trend,) = analyse([tire], recordings=60).tires
    finding = next(finding for finding in trend.findings if "after_pa" in dict(finding.values))
    since_s, std_s = (float(str(finding[name])) for name in ("since_s", "since_std_s"))
    assert 0.0 < std_s < 15.0 * 86_400.0
    assert abs(since_s - 1e-9 * begin_ns) < 3.0 * std_s
    row = finding_rows([trend])[0]
    assert row.since.endswith(("days", "day"))
    assert row.since[:10] == str(np.datetime64(round(since_s), "s"))[:10]
    assert row.sure.endswith("times its error")
    assert "leak" in row.step


def test_what_all_recordings_show_is_since_the_first():
    (trend,) = analyse([history(1, 60, leak_pa=4000.0)], recordings=60).tires
    row = finding_rows([trend])[0]
    assert row.since == "2026-01-01, the first recording"
    assert " ± " in row.said


@pytest.mark.parametrize(("change", "std", "times"), [(124.0, 94.0, 2), (-60.0, 10.0, 4)])
def test_a_ratio_is_as_sure_as_its_logarithm(change: float, std: float, times: int):
    (trend,) = analyse([history(1, 60)], recordings=60).tires
    finding = Reason(FleetCode.TREND_SLOPE_CHANGED, name="noise_mps2", change=change, std=std, unit="%")
    assert finding_rows([replace(trend, findings=(finding,))])[0].sure == f"{times} times its error"


def test_terminal_and_page_say_since_when_how_sure_and_what_to_do_in_that_order():
    trends = analyse([leaking_since(6.0)[0]], recordings=60)
    lines = trend_lines(trends, 80)
    at = [
        next(i for i, line in enumerate(lines) if words in line) for words in ("since when", "how sure", "what to do")
    ]
    assert at == sorted(at)
    page = trends_page(trends)
    assert page.index("<dt>Since when") < page.index("<dt>How sure") < page.index("<dt>What to do") < page.index("<svg")


def test_first_sentence_is_the_leak_with_pressures_and_days():
    noisy = history(2, 60, noise_growth=0.3, sensor_id="a0", position="FL", vehicle="van 7")
    leaking, begin_ns = leaking_since(7.5)
    trends = analyse([noisy, leaking], recordings=120)
    (answer,) = re.findall(r'<p class="answer act">(.*?)</p>', trends_page(trends))
    told = re.match(r"van 7 FL a1: leaks, (\d+) kPa to (\d+) kPa in ([\d.]+) days at 20 °C: ", answer)
    assert told is not None, answer
    first, last, days = map(float, told.groups())
    assert first == pytest.approx(220.0, abs=1.0)
    assert last == pytest.approx(210.0, abs=1.5)
    assert days == pytest.approx(1e-9 * (leaking.time_ns[-1] - begin_ns) / 86_400.0, abs=6.0)
    assert [row.tire for row in finding_rows(trends.tires)] == ["van 7 FL a1", "van 7 FL a0"]


def test_drift_a_month_says_the_time_that_it_was_seen_over():
    (trend,) = analyse([history(3, 60, months=2.0, stiffening=0.04)], recordings=60).tires
    (row,) = finding_rows([trend])
    assert row.said.startswith("Cw changes by ")
    assert row.said.endswith(" a month, seen over 60.9 days")


def test_units_of_the_vehicle_files_hold_for_trends_and_their_files_keep_si():
    trends = analyse([replace(leaking_since(6.0)[0], units=ShownUnits.US)], recordings=60)
    assert trends.units is ShownUnits.US
    terminal = "\n".join(trend_lines(trends, 120))
    assert "pressure loss, psi/month" in terminal
    assert "kPa" not in terminal
    page = trends_page(trends)
    assert "psi/month" in page
    assert "kPa" not in page
    assert "psi" not in str(trends_json(trends))
    assert b"psi" not in trends_csv(trends)


@pytest.mark.parametrize(
    ("name", "step"),
    [("noise_mps2", "fastening"), ("wear_mm", "tread depth"), ("estimated_load_n", "load"), ("Cw", "inspect")],
)
def test_change_of_a_level_has_the_step_of_its_series(name: str, step: str):
    tire = history(3, 60, vehicle="van 7")
    after = np.arange(60) >= 37
    tire.columns[name][:] = tire.columns[name] + 2.0 * after if name == "wear_mm" else tire.columns[name] * 4.0**after
    rows = finding_rows(analyse([tire], recordings=60).tires)
    assert any(step in row.step for row in rows if "from its earlier trend" in row.said)
