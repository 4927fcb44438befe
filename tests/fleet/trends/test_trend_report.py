"""Trends as a page, tables for scripts, and terminal lines."""

import csv
import html
import io
import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest

from gateway.fleet.trends.fleet_analysis import analyse
from gateway.fleet.trends.trend_result import UNKNOWN_VEHICLE, FleetTrends
from gateway.fleet.trends.watched_series import SERIES
from gateway.fleet.views.trend_page import trends_page
from gateway.fleet.views.trend_tables import LABELS, trends_csv, trends_json
from gateway.fleet.views.trend_terminal import trend_lines
from tests.testkit.tire_histories import history

HOSTILE = "<script>alert('x')</script>\x1b[2J"


@pytest.fixture(scope="module")
def trends() -> FleetTrends:
    worn = history(1, 40, vehicle=HOSTILE, leak_pa=4000.0)
    worn.columns["Bs"][[5, 30]] *= 1.5  # type: ignore[index]
    return analyse([worn, history(2, 40, vehicle="=car", position="FR")], recordings=80, failures=3)


def test_page_is_self_contained_and_escapes_names(trends):
    page = trends_page(trends)
    policy = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
    assert f'<meta http-equiv="Content-Security-Policy" content="{policy}">' in html.unescape(page)
    assert "<script" not in page
    assert "\x1b" not in page
    assert html.escape("<script>alert('x')</script>", quote=True).replace("&#x27;", "&#39;") in page
    assert not re.findall(r'(?:src|href)="(?!#)', page)
    assert page.count("<svg") == 2
    assert "leaks, 220 kPa to 188 kPa in 244 days" in page
    assert "3 recordings without results" in page
    assert "_0005.mcap" in page


def test_figures_of_tires_without_findings_are_folded(trends):
    page = trends_page(trends)
    folded = page.split("<summary>Tires without findings and outliers: 1")[1].split("</details>")[0]
    assert "=car FR" in folded
    assert folded.count("<svg") == 1
    assert "leaks" not in folded


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (("a", "b"), "2 tires of 2 vehicles, 2 recordings, "),
        (("a", UNKNOWN_VEHICLE), "2 tires of 1 vehicle and unknown ones, 2 recordings, "),
        ((UNKNOWN_VEHICLE,), "1 tire of unknown vehicles, 1 recording, "),
    ],
)
def test_an_unknown_vehicle_is_not_counted(names, said):
    result = analyse([history(1, 40, vehicle=name) for name in names], recordings=len(names), failures=0)
    assert trend_lines(result, 120)[0].startswith(said)
    assert said.split(" of ")[1].split(",")[0] in trends_page(result)


def test_every_quantity_has_a_label(trends):
    assert {number.quantity for tire in trends.tires for number in tire.numbers} <= set(LABELS)
    assert {series.name for tire in trends.tires for series in tire.series} <= set(SERIES)
    assert not [series.label for series in SERIES.values() if "_" in series.label]


def test_json_has_values_units_errors_and_codes(trends):
    document = json.loads(json.dumps(trends_json(trends), allow_nan=False))
    assert (document["format"], document["recordings"], document["failures"]) == (
        "treadlink trends",
        80,
        3,
    )
    numbers = document["tires"][0]["numbers"]
    assert {number["quantity"] for number in numbers} == {name for name in LABELS if "asymmetry" not in name}
    for number in numbers:
        assert number["unit"]
        if number["status"] == "invalid":
            assert number["value"] is None
            assert number["reasons"][0]["code"]
        else:
            assert math.isfinite(number["value"])
            assert number["std"] >= 0.0
    assert [finding["code"] for finding in document["tires"][0]["findings"]] == ["trend_loses_pressure"]
    assert {item["name"] for item in document["outliers"]} == {"Bs"}


def test_csv_has_one_row_for_each_number(trends):
    rows = list(csv.DictReader(io.StringIO(trends_csv(trends).decode())))
    assert len(rows) == sum(len(tire.numbers) for tire in trends.tires)
    assert rows[-1]["vehicle"] == "'=car"  # not a formula
    loss = next(row for row in rows if row["quantity"] == "pressure_loss")
    assert float(loss["value"]) == pytest.approx(4.0, abs=0.3)
    assert loss["unit"] == "kPa/month"


def test_lines_are_clean_and_name_outliers(trends):
    lines = trend_lines(trends, 200)
    assert all(line.isprintable() for line in lines)
    assert any("leaks, 220 kPa to 188 kPa" in line for line in lines)
    assert any("2 of 80 recordings" in line for line in lines)
    assert any("_0030.mcap: " in line and " FL 0000a000 Bs +" in line for line in lines)


def test_notes_of_the_page_name_their_tires(trends):
    page = trends_page(trends)
    assert re.search(
        r"<li>=car FR 0000a000, pressure loss: the loss may be [^<]* as the scatter can hide refills", page
    )
    assert re.search(r"<li>— all tires, zero-g offset: no recording has a value", page)
    assert re.search(r"<li>[^<]*0000a000, Bs with age, Bs with temperature: 2 outliers are not used", page)


def test_csv_has_the_findings(trends):
    rows = list(csv.DictReader(io.StringIO(trends_csv(trends).decode())))
    assert {row["findings"][:6] for row in rows if row["position"] == "FL"} == {"leaks,"}
    assert {row["findings"] for row in rows if row["position"] == "FR"} == {""}


def test_lines_say_why_numbers_are_marked():
    doubts = ("contradicted",) * 40
    tires = [replace(history(1, 40, vehicle=name), doubts={"wear_mm": doubts} if name == "a" else {}) for name in "ab"]
    lines = trend_lines(analyse(tires, recordings=80), 200)
    assert lines[lines.index("marked ~, or — for not determined:") + 1] == (
        "  ~ a FL 0000a000, wear: provisional in 40 of 40 recordings: contradicted"
    )


def test_reason_of_a_dash_stands_below_the_table_of_terminal_and_page():
    tire = history(3, 40, months=0.5)
    tire = replace(tire, km=np.linspace(9000.0, 9210.0, 40))
    trends = analyse([tire, history(4, 40, position="FR")], recordings=80)
    why = "car FL 0000a000, wear: the recordings span 210 km: a rate per 1,000 km needs 250 km"
    lines = trend_lines(trends, 200)
    assert next(line for line in lines if line.startswith("car FL 0000a000")).split()[3] == "—"
    assert f"  — {why}" in lines
    page = trends_page(trends)
    assert f"<li>— {why}</li>" in re.sub(r"<details.*?</details>", "", page, flags=re.S)


def test_page_shows_ratios_meaningful_digits_and_folded_notes():
    tire = history(4, 60, vehicle="van")
    tire.columns["noise_mps2"][21] *= 4.0  # type: ignore[index]
    tire.columns["estimated_load_n"][:] = 4234.2759517023 + 1e-6 * tire.columns["wear_mm"]  # type: ignore[index]
    page = trends_page(analyse([tire], recordings=60))
    (ratio,) = re.findall(r"([\d.]+) times</td>", page)
    assert float(ratio) == pytest.approx(4.0, rel=0.15)
    assert "ln noise" not in page
    assert "4234.27" not in page
    assert re.search(r"<details class=\"small\"><summary>Notes: \d+</summary>", page)
