"""The page of a comparison: the cause first, what follows from it, when each was recorded, one wheel at a time."""

import json
import re
from dataclasses import replace

import pytest

from gateway.compare.mean_comparison import compared_means
from gateway.compare.views.comparison_page import comparison_page
from gateway.compare.views.comparison_verdict import comparison_verdict
from gateway.compare.views.drive import Drive
from gateway.compare.views.drive_comparison import comparison_csv, comparison_lines, means_of, radii_of
from gateway.compare.views.drive_page import drive_page
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.shown_units import ShownUnits

START_NS = 1_790_000_000 * 10**9


@pytest.fixture
def make_drive(made):
    def make(name: str, *, start_ns: int = START_NS, change: float = 0.0, wheels=("FL", "FR"), **conditions) -> Drive:
        """Return a drive whose FR has other conditions and a Bs that is larger by a share."""
        drive = Drive(name)
        for index in range(40):
            for position in wheels:
                of_wheel = position == "FR"
                wobble = 1.0 + 1e-3 * (-1.0) ** index
                bs = 0.003 * wobble * (1.0 + change * of_wheel)
                estimates = (Estimate("Bs", bs, 1e-5, Status.VALID, scatter_std=3e-6),)
                result = made.result(position=position, index=index, estimates=estimates)
                changed = replace(result.conditions, **conditions) if of_wheel else result.conditions
                drive.add(replace(result, conditions=changed, host_ns=start_ns + index * 10**9))
        return drive

    return make


def said_of(first: Drive, second: Drive):
    """Return differences and verdict of two drives."""
    differences = compared_means(means_of(first), means_of(second), radii_of(first), radii_of(second))
    return differences, comparison_verdict(first, second, list(first.wheels), differences)


def test_the_condition_that_changed_is_named_before_what_follows_from_it(make_drive):
    first = make_drive("a.mcap", pressure_pa=250e3, pressure_std_pa=1e3)
    second = make_drive("b.mcap", pressure_pa=210e3, pressure_std_pa=1e3, change=0.19)
    _, said = said_of(first, second)
    assert re.match(r"Pressure differs: FR 40\.0 ± 1\.4 kPa lower \(250, then 210 kPa\)\.", said.answer)
    assert "FL: no difference beyond chance." in said.answer
    assert [line.partition(":")[0] for line in said.lines] == ["FR, with the pressure"]
    assert re.search(r"\(Bs\) 19\.0\d* ± \S+ % higher", said.lines[0])
    assert [step["about"] for step in said.steps] == ["FR, pressure"]
    assert "leak" in said.steps[0]["step"]
    assert said.wheel == "FR"


def test_a_pressure_that_rose_is_no_leak_and_one_within_its_error_is_none(make_drive):
    first = make_drive("a.mcap", pressure_pa=210e3, pressure_std_pa=1e3)
    _, said = said_of(first, make_drive("b.mcap", pressure_pa=250e3, pressure_std_pa=1e3))
    assert "higher" in said.answer
    assert "leak" not in said.steps[0]["step"]
    _, said = said_of(first, make_drive("b.mcap", pressure_pa=214e3, pressure_std_pa=2e3))
    assert said.answer == "FL, FR: no difference beyond chance. Nothing to act on."
    assert not said.steps
    assert not said.lines


def test_a_difference_without_a_cause_is_said_to_have_none(make_drive):
    _, said = said_of(make_drive("a.mcap"), make_drive("b.mcap", change=0.2))
    assert "FR: the tire's numbers differ, and no condition that was recorded does." in said.answer
    assert [step["about"] for step in said.steps] == ["FR"]


def test_each_recording_has_its_date_and_the_wheel_that_differs_is_drawn_first(make_drive):
    first = make_drive("a.mcap", pressure_pa=250e3)
    second = make_drive("b.mcap", pressure_pa=210e3, start_ns=START_NS + 86_400 * 10**9, wheels=("FR", "FL"))
    differences, _ = said_of(first, second)
    page = comparison_page(first, second, differences)
    assert "First: a.mcap, 2026-09-21 14:13:20 UTC, 39 s · second: b.mcap, 2026-09-22 14:13:20 UTC, 39 s" in page
    data = json.loads(re.search(r'id="both-data">(.*?)</script>', page)[1])
    choice = data["choices"][data["chosen"]]
    assert [data["wheels"][at]["name"] for at in choice["wheels"]] == ["FR a.mcap", "FR b.mcap"]
    assert [wheel["style"] for wheel in data["wheels"]] == [0, 0, 1, 1]
    assert data["pairs"] == {"pressure_pa": "temperature_degc"}


def test_a_browser_draws_one_wheel_at_a_time_and_another_one_by_choice(browser, make_drive, tmp_path):
    first, second = make_drive("a.mcap", pressure_pa=250e3), make_drive("b.mcap", pressure_pa=210e3)
    page = tmp_path / "comparison.html"
    page.write_text(comparison_page(first, second, said_of(first, second)[0]), "utf-8")
    tab = browser.tab()
    tab.show(page, 390)
    shown = "[...document.querySelectorAll('.grid .legend')].map((one) => one.innerText).join()"
    assert "FR a.mcap: 250 kPa, " in tab.value(shown), "pressure and temperature are in one picture"
    assert "FL" not in tab.value(shown)
    choose = "{ const s = document.querySelector('.tools select'); s.value = 0; s.dispatchEvent(new Event('change')); }"
    tab.value(choose)
    assert "FL b.mcap" in tab.value(shown)
    assert "FR" not in tab.value(shown)
    assert tab.value("document.documentElement.scrollWidth") <= 390
    assert not tab.errors


def test_units_of_the_vehicle_file_hold_on_the_page_and_in_the_terminal_and_files_keep_theirs(make_drive):
    first, second = (
        make_drive(name, pressure_pa=pressure_pa, pressure_std_pa=1e3, temperature_degc=degc)
        for name, pressure_pa, degc in (("a.mcap", 250e3, 20.0), ("b.mcap", 210e3, 30.0))
    )
    first.units = second.units = ShownUnits.US
    differences, _ = said_of(first, second)
    page = comparison_page(first, second, differences)
    assert "Pressure differs: FR 5.80 ± 0.21 psi lower (36.26, then 30.46 psi)." in page
    assert "Temperature differs: FR 18.00 °F higher (68, then 86 °F)." in page
    assert "kPa" not in re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)
    data = json.loads(re.search(r'id="both-data">(.*?)</script>', page)[1])
    drawn = {quantity["name"]: quantity for quantity in data["quantities"]}
    assert [drawn[name]["unit"] for name in ("pressure_pa", "temperature_degc")] == ["psi", "°F"]
    assert drawn["temperature_degc"]["wheels"][1]["v"][0] == pytest.approx(68.0)
    assert drawn["pressure_pa"]["wheels"][1]["e"][0] == pytest.approx(0.145, abs=1e-3)
    lines = list(comparison_lines(first, second, differences))
    assert any(line.startswith("pressure") and "36.26 ± 0.15 psi" in line for line in lines)
    assert "psi" in drive_page([first])
    assert b"psi" not in comparison_csv(differences)
