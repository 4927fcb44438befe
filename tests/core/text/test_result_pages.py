"""Pages of results have one order, one style, and fit a phone in light and dark."""

import re

import pytest

pytest.importorskip("jinja2")
pytest.importorskip("matplotlib")

from gateway.diagnosis.views.html import diagnosis_html
from gateway.fleet.trends.fleet_analysis import analyse
from gateway.fleet.views.trend_page import trends_page
from tests.testkit.campaign_recordings import write_recording
from tests.testkit.commands import run
from tests.testkit.diagnosis_data import ordinary
from tests.testkit.tire_histories import history
from tools.browser import FAINT_TEXT

KINDS = ("compare", "diagnose", "drive", "orders", "trends")
ORDER = ["verdict", "steps", "pictures", "tables", "made"]
FITS = "document.documentElement.scrollWidth <= document.documentElement.clientWidth"
SMALL = """
[...document.querySelectorAll("body *")].filter((one) => !one.closest("svg, script, style, noscript")
  && [...one.childNodes].some((node) => node.nodeType === 3 && node.textContent.trim())
  && one.checkVisibility() && parseFloat(getComputedStyle(one).fontSize) < 12).map((one) => one.outerHTML.slice(0, 80))
"""


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pages")
    paths = [
        write_recording(
            folder / f"{kpa}.mcap", "[motion]\nspeed_kmh = 70.0", wheels=(f"pressure_kpa = {kpa}",), duration_s=3.0
        )
        for kpa in (230, 190)
    ]
    run("compare", *paths, "--html", folder / "compare.html")
    run("estimate", paths[0], "--html", folder / "drive.html")
    run("orders", paths[0], "--figure", folder / "orders.html")
    texts = {
        "diagnose": diagnosis_html(ordinary(2)),
        "trends": trends_page(analyse([history(1, 40, vehicle="van", leak_pa=4000.0)], recordings=40)),
    }
    for kind, text in texts.items():
        (folder / f"{kind}.html").write_text(text, "utf-8")
    return folder


@pytest.mark.parametrize("kind", KINDS)
def test_pages_have_one_order(pages, kind):
    text = (pages / f"{kind}.html").read_text("utf-8")
    parts = re.findall(r'data-part="(\w+)"', text)
    assert parts == [part for part in ORDER if part in parts]
    assert set(parts) >= {"verdict", "pictures", "tables"}
    assert not re.findall(r'(?:src|href)="(?!#|data:)', text)


def test_comparison_says_what_differs_and_what_was_not_alike(pages):
    text = (pages / "compare.html").read_text("utf-8")
    assert re.search(r"Pressure differs: \S+ 40\.0 ± \S+ kPa lower \(230, then 190 kPa\)\.", text)
    assert re.search(r'data-part="steps".*?, pressure</b>: if nobody let air out, look for a leak', text, re.DOTALL)


def test_leak_is_answered_by_what_to_do(pages):
    text = (pages / "trends.html").read_text("utf-8")
    assert "1 of 1 tire has a finding: van FL" in text
    assert text.count("look for a leak") == 1


@pytest.mark.parametrize("is_dark", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_a_phone_shows_all_of_it_in_light_and_dark(browser, pages, kind, is_dark):
    tab = browser.tab()
    tab.open((pages / f"{kind}.html").as_uri(), 390, 800, is_dark=is_dark)
    tab.until("document.readyState == 'complete' && document.querySelector('footer') !== null")
    assert tab.value(FITS)
    assert tab.value(FAINT_TEXT) == []
    assert tab.value(SMALL) == []
    assert tab.errors == []


@pytest.mark.parametrize("kind", KINDS)
def test_paper_cuts_no_picture(browser, pages, kind):
    tab = browser.tab()
    tab.open((pages / f"{kind}.html").as_uri(), 720, 1000)
    tab.until("document.readyState == 'complete' && document.querySelector('footer') !== null")
    tab.call("Emulation.setEmulatedMedia", media="print")
    cut = "[...document.querySelectorAll('.drawing')].filter((box) => box.scrollWidth > box.clientWidth + 1).length"
    assert tab.value(cut) == 0
    assert (
        tab.value("getComputedStyle(document.querySelector('nav') || document.querySelector('.tools')).display")
        == "none"
    )
