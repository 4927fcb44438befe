"""The report in a real browser."""

import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("matplotlib", reason="matplotlib (extra 'plot') is not installed")
pytest.importorskip("jinja2", reason="jinja2 (extra 'plot') is not installed")

TIMEOUT_S = 90
POLICY = re.compile(r'<meta http-equiv="Content-Security-Policy"[^>]*>')
MEASURE = (
    "<script>const e = document.documentElement;"
    "e.dataset.page = [e.scrollWidth, e.clientWidth, document.querySelectorAll('script').length].join(' ');"
    "e.dataset.drawn = [...document.querySelectorAll('.drawing svg')].map(s => s.getBoundingClientRect().height > 100);"
    "</script></body>"
)


@pytest.fixture(scope="module")
def chromium() -> str:
    for name in ("chromium", "chromium-browser", "google-chrome"):
        if result := shutil.which(name):
            return result
    if os.environ.get("CI"):
        pytest.fail("chromium is missing; CI must have it")
    return pytest.skip("no chromium is installed")


@pytest.fixture(scope="module")
def report(page_text: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "report.html"
    path.write_text(page_text, "utf-8")
    return path


@pytest.fixture(scope="module")
def nasty_report(nasty_text: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "nasty.html"
    path.write_text(nasty_text, "utf-8")
    return path


def browse(chromium: str, page: Path, profile: Path, *arguments: str) -> str:
    """Open a page without network and with a profile of its own; return what the browser prints."""
    done = subprocess.run(
        [
            chromium, "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--hide-scrollbars",
            "--no-first-run", "--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={profile}",
            *arguments, page.as_uri(),
        ],
        capture_output=True, check=False, timeout=TIMEOUT_S,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr.decode(errors="replace")[-2000:]
    return done.stdout.decode()


def measured(chromium: str, page: Path, folder: Path, width: int) -> tuple[dict[str, str], str]:
    """Return what a script within a copy of the page, its policy taken out, sees."""
    text, count = POLICY.subn("", page.read_text("utf-8"))
    assert count == 1
    copy = folder / "copy.html"
    copy.write_text(text.replace("</body>", MEASURE), "utf-8")
    dom = browse(chromium, copy, folder / "profile", "--dump-dom", f"--window-size={width},900")
    return dict(re.findall(r'data-(page|drawn)="([^"]*)"', dom)), dom


def test_browser_shows_every_section(chromium, report, tmp_path):
    dom = browse(chromium, report, tmp_path / "profile", "--dump-dom")
    assert "<title>Diagnosis of FL: the exact ring</title>" in dom
    for heading in ("Result", "Effects", "Unexplained residuals", "Estimates before and after", "Waveform and residual",
                    "Order spectrum of the residual", "Trends of the residual", "Rejected effects"):  # fmt: skip
        assert f">{heading}</h2>" in dom


@pytest.mark.parametrize("width", [800, 1280])
def test_page_fits_the_window(chromium, report, tmp_path, width):
    seen, _ = measured(chromium, report, tmp_path, width)
    scroll, client, _ = map(int, seen["page"].split())
    assert client == width
    assert scroll <= client, "only tables scroll sideways, never the page"
    assert set(seen["drawn"].split(",")) == {"true"}


def test_tables_scroll_at_phone_width(chromium, report, tmp_path):
    """In a frame: no window of the browser's is as narrow."""
    inside = json.dumps(POLICY.sub("", report.read_text("utf-8"))).replace("</", "<\\/")
    look = (
        "const d = f.contentDocument, e = d.documentElement;"
        "document.documentElement.dataset.page = [e.scrollWidth, e.clientWidth].join(' ');"
        "document.documentElement.dataset.drawn ="
        " [...d.querySelectorAll('.scroll')].map(s => s.scrollWidth > s.clientWidth);"
    )
    frame = tmp_path / "frame.html"
    frame.write_text(
        "<!doctype html><body><iframe id=f width=420 height=900 style='border: 0'></iframe><script>"
        f"const f = document.getElementById('f'); f.onload = () => {{ {look} }}; f.srcdoc = {inside}</script></body>",
        "utf-8",
    )
    dom = browse(chromium, frame, tmp_path / "profile", "--dump-dom")
    seen = dict(re.findall(r'data-(page|drawn)="([^"]*)"', dom))
    scroll, client = map(int, seen["page"].split())
    assert 400 <= client <= 420
    assert scroll <= client
    assert seen["drawn"].count("true") >= 3, "wide tables are there, and scroll"


def test_hostile_strings_have_no_effect(chromium, nasty_report, tmp_path):
    seen, dom = measured(chromium, nasty_report, tmp_path, 800)
    scroll, client, scripts = map(int, seen["page"].split())
    assert scripts == 1, "the test's own"
    assert scroll <= client
    title = re.search(r"<title>(.*?)</title>", dom, re.DOTALL)
    assert title is not None
    assert title[1].startswith("Diagnosis of ")


def test_content_policy_stops_scripts(chromium, report, tmp_path):
    page = tmp_path / "attacked.html"
    attack = "<script>document.title = 'taken'</script><img src=x onerror=\"document.title='taken'\"></body>"
    page.write_text(report.read_text("utf-8").replace("</body>", attack), "utf-8")
    dom = browse(chromium, page, tmp_path / "profile", "--dump-dom")
    assert "<title>Diagnosis of FL" in dom


@pytest.mark.parametrize("width", [800, 1280])
def test_screenshot_shows_before_and_after_colours(chromium, report, tmp_path, width):
    from matplotlib.image import imread

    picture = tmp_path / "page.png"
    browse(chromium, report, tmp_path / "profile", f"--screenshot={picture}", f"--window-size={width},6000")
    pixels = np.round(imread(picture)[..., :3] * 255).astype(int)
    assert pixels.shape == (6000, width, 3)
    figures = pixels[2000:].reshape(-1, 3)
    for colour in ((0xC0, 0x4A, 0x00), (0x00, 0x62, 0xA8)):
        assert np.count_nonzero((np.abs(figures - colour) <= 2).all(axis=1)) > 500
    assert 0.5 < (figures > 250).all(axis=1).mean() < 0.99
