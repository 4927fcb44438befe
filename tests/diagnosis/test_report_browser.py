"""The report in a real browser."""

from pathlib import Path

import numpy as np
import pytest

from tools.browser import Browser, Tab

pytest.importorskip("matplotlib", reason="matplotlib (extra 'plot') is not installed")
pytest.importorskip("jinja2", reason="jinja2 (extra 'plot') is not installed")

# Widths of what the page holds and of the window.
WIDTHS = "[document.documentElement.scrollWidth, document.documentElement.clientWidth]"
DRAWN = "[...document.querySelectorAll('.drawing svg')].map(s => s.getBoundingClientRect().height > 100)"
SCROLLS = "[...document.querySelectorAll('.scroll')].filter(s => s.scrollWidth > s.clientWidth).length"


@pytest.fixture(scope="module")
def report(page_text: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "report.html"
    path.write_text(page_text, "utf-8")
    return path


@pytest.fixture(scope="module")
def tab(browser: Browser) -> Tab:
    return browser.tab()


def test_browser_shows_every_section(tab: Tab, report: Path) -> None:
    tab.show(report)
    assert tab.value("document.title") == "Diagnosis of FL"
    assert {
        "Result", "Effects", "Unexplained residuals", "Estimates before and after", "Waveform and residual",
        "Order spectrum of the residual", "Trends of the residual", "Rejected effects",
    } <= set(tab.value("[...document.querySelectorAll('h2')].map(h => h.innerText)"))  # fmt: skip


@pytest.mark.parametrize("width", [800, 1280])
def test_page_fits_the_window(tab: Tab, report: Path, width: int) -> None:
    tab.show(report, width)
    scroll, client = tab.value(WIDTHS)
    assert client == width
    assert scroll <= client, "only tables scroll sideways, never the page"
    assert set(tab.value(DRAWN)) == {True}


def test_tables_scroll_at_phone_width(tab: Tab, report: Path) -> None:
    tab.show(report, 420)
    scroll, client = tab.value(WIDTHS)
    assert 400 <= client <= 420
    assert scroll <= client
    assert tab.value(SCROLLS) >= 3, "wide tables are there, and scroll"


def test_hostile_strings_have_no_effect(tab: Tab, nasty_text: str, tmp_path: Path) -> None:
    page = tmp_path / "nasty.html"
    page.write_text(nasty_text, "utf-8")
    tab.show(page, 800)
    scroll, client = tab.value(WIDTHS)
    assert tab.value("document.querySelectorAll('script').length") == 0
    assert scroll <= client
    assert tab.value("document.title").startswith("Diagnosis of ")


def test_content_policy_stops_scripts(tab: Tab, report: Path, tmp_path: Path) -> None:
    page = tmp_path / "attacked.html"
    attack = "<script>document.title = 'taken'</script><img src=x onerror=\"document.title='taken'\"></body>"
    page.write_text(report.read_text("utf-8").replace("</body>", attack), "utf-8")
    tab.show(page)
    assert tab.value("document.title").startswith("Diagnosis of FL")


@pytest.mark.parametrize("width", [800, 1280])
def test_screenshot_shows_before_and_after_colours(tab: Tab, report: Path, tmp_path: Path, width: int) -> None:
    from matplotlib.image import imread

    picture = tmp_path / "page.png"
    tab.show(report, width, 6000)
    tab.screenshot(picture)
    pixels = np.round(imread(picture)[..., :3] * 255).astype(int)
    assert pixels.shape == (6000, width, 3)
    figures = pixels[2000:].reshape(-1, 3)
    for colour in ((0xC0, 0x4A, 0x00), (0x00, 0x62, 0xA8)):
        assert np.count_nonzero((np.abs(figures - colour) <= 2).all(axis=1)) > 500
    assert 0.5 < (figures > 250).all(axis=1).mean() < 0.99
