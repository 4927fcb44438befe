"""Pages of the documentation: links resolve, and every page is in the navigation."""

import os
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tools.docs_site.staging import DOCS, ROOT, TOP_LEVEL, generated_pages, relative_links, stage, written_pages


def navigated(items: list[Any]) -> Iterator[str]:
    for item in items:
        for value in item.values() if isinstance(item, dict) else (item,):
            yield from navigated(value) if isinstance(value, list) else (value,)


def broken_links() -> Iterator[str]:
    """Yield page and target of each link that leads neither to a file nor to a page that is made for the site."""
    made = {str(DOCS / page) for page in (*generated_pages(), *TOP_LEVEL.values())}
    for path in [ROOT / "README.md", *written_pages().values()]:
        for link in relative_links(path.read_text("utf-8")):
            target = os.path.normpath(path.parent / link.partition("#")[0])
            if not Path(target).is_file() and target not in made:
                yield f"{path.relative_to(ROOT)}: {link}"


def test_relative_links_resolve():
    assert list(broken_links()) == []


def test_every_page_is_in_the_navigation():
    site = tomllib.loads((ROOT / "zensical.toml").read_text("utf-8"))["project"]
    pages = list(navigated(site["nav"]))
    assert sorted(pages) == sorted({*written_pages(), *generated_pages()})


def test_the_site_loads_nothing_from_elsewhere():
    site = tomllib.loads((ROOT / "zensical.toml").read_text("utf-8"))["project"]
    assert site["theme"]["font"] is False
    drawn = [page for page, path in written_pages().items() if "```mermaid" in path.read_text("utf-8")]
    assert drawn == [], "the site would fetch mermaid from another host: draw with text or SVG"


def test_linked_files_are_copied_to_the_site(tmp_path):
    stage(tmp_path)
    for page in sorted(tmp_path.rglob("*.md")):
        for link in relative_links(page.read_text("utf-8")):
            assert (page.parent / link.partition("#")[0]).is_file(), f"{page.relative_to(tmp_path)}: {link}"
