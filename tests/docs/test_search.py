"""The search of the site: plain words find the pages that explain them, also where the site is opened from a file."""

import re
import tomllib

import pytest

from tools.browser import CHROMIUM, Browser
from tools.docs_site.api_pages import IN_SEARCH, PACKAGES, api_markdown
from tools.docs_site.staging import DOCS, ROOT, written_pages

SHIM = DOCS / "javascripts" / "iframe-worker.js"


def settings() -> dict:
    return tomllib.loads((ROOT / "zensical.toml").read_text("utf-8"))["project"]


def test_a_search_for_wear_finds_the_section_that_explains_it():
    """Sections whose heading begins with the word come first, in the order of the pages' addresses."""
    headed = [
        page
        for page, path in sorted(written_pages().items())
        if re.search(r"^#+ wear\b", path.read_text("utf-8"), re.MULTILINE | re.IGNORECASE)
    ]
    assert headed == ["how-to/calibrate-a-tire.md"]


def test_names_within_the_program_are_left_out_of_the_search():
    pages = api_markdown()
    searched = {name for name in PACKAGES if "exclude: true" not in pages[f"{name.replace('.', '-')}.md"]()}
    assert searched == IN_SEARCH


def test_the_search_from_a_file_uses_a_script_of_the_site():
    """The generator adds one of another host where none is named."""
    project = settings()
    assert "offline" in project["plugins"]
    assert [DOCS / script for script in project["extra"]["polyfills"]] == [SHIM]


@pytest.mark.skipif(CHROMIUM is None, reason="needs chromium")
def test_a_page_from_a_file_gets_the_answers_of_its_worker(browser: Browser, tmp_path):
    (tmp_path / "iframe-worker.js").write_text(SHIM.read_text("utf-8"), "utf-8")
    (tmp_path / "twice.js").write_text("self.onmessage = ({ data }) => self.postMessage(2 * data);", "utf-8")
    page = tmp_path / "page.html"
    page.write_text('<!doctype html><script src="iframe-worker.js"></script><body></body>', "utf-8")
    tab = browser.tab()
    tab.show(page)
    tab.value("window.two = new Worker('twice.js'); two.onmessage = ({ data }) => (window.four = data); 0")
    tab.value("two.postMessage(2); 0")
    assert tab.until("window.four") == 4
    tab.value("window.none = new Worker('none.js'); none.onerror = () => (window.failed = true); 0")
    assert tab.until("window.failed")
    tab.value("two.terminate(); none.terminate(); 0")
    assert tab.value("document.querySelectorAll('iframe').length") == 0
