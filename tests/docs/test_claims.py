"""Claims of README.md and the documentation that code can check: paths, names, links and navigation."""

import importlib
import os
import re
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from gateway.core.estimates.registry import DEFAULT_ESTIMATORS, ESTIMATORS
from tests.test_import_rules import imports
from tools.docs_site.staging import DOCS, ROOT, TOP_LEVEL, generated_pages, relative_links, stage, written_pages

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
SOLVER = "gateway.ring.rolling_ring"
MOST_WORDS = 2100
"""As CONTRIBUTING.md states."""


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_named_paths_exist(page):
    paths = re.findall(
        r"`((?:gateway|firmware_protocol|tests|tools|docs|examples)/[\w./*-]*)`", page.read_text("utf-8")
    )
    assert [path for path in paths if not list(ROOT.glob(path.rstrip("/")))] == []


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_named_modules_and_attributes_exist(page):
    names = re.findall(r"`((?:gateway|firmware_protocol)(?:\.\w+)+)`", page.read_text("utf-8"))
    assert [name for name in names if not resolves(name)] == []


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_named_tests_exist(page):
    tests = re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", page.read_text("utf-8"))
    assert [(path, name) for path, name in tests if f"def {name}(" not in (ROOT / path).read_text("utf-8")] == []


def resolves(name: str) -> bool:
    """Return whether a dotted name is a module or an attribute of one."""
    try:
        importlib.import_module(name)
    except ImportError:
        module, _, attribute = name.rpartition(".")
        return bool(module) and resolves(module) and hasattr(importlib.import_module(module), attribute)
    return True


@cache
def imported(module: str) -> frozenset[str]:
    """Return the modules of the project that a module imports, directly or not."""
    path = ROOT / module.replace(".", "/")
    file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    results: set[str] = set()
    if file.is_file():
        for name in imports(file):
            if name.startswith("gateway"):
                results |= {name, *imported(name)}
    return frozenset(results)


def uses_solver(module: str) -> bool:
    return any(name == SOLVER or name.startswith(f"{SOLVER}.") for name in imported(module))


def test_the_reference_names_the_estimators_that_run_by_default():
    said = (DOCS / "reference/estimates.md").read_text("utf-8").partition(" run unless you choose others")[0]
    assert tuple(re.findall(r"`([^`]+)`", said.rpartition(". ")[2])) == DEFAULT_ESTIMATORS


def test_only_the_forward_estimator_shares_the_simulators_solver():
    sharing = {name for name, position in ESTIMATORS.items() if uses_solver(position.partition(":")[0])}
    assert sharing == {"forward"}


@pytest.mark.parametrize("module", ["gateway.simulator.tire_model", "gateway.diagnosis.model.exact_baseline"])
def test_simulator_and_exact_model_share_one_solver(module):
    assert uses_solver(module)


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


def anchors_of(page: Path) -> set[str]:
    """Return the names that the site gives the headings of a page (Python-Markdown)."""
    text = re.sub(r"^```.*?^```$", "", page.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE)
    headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", heading).strip().lower()) for heading in headings}


def test_links_lead_to_headings_that_exist():
    written = [ROOT / "README.md", *written_pages().values()]
    anchors = {path.resolve(): anchors_of(path) for path in written}
    broken = []
    for path in written:
        for link in re.findall(r"\]\(([^()\s:]*#[^()\s]+)\)", path.read_text("utf-8")):
            target, _, anchor = link.partition("#")
            linked = (path.parent / target).resolve() if target else path.resolve()
            if anchor not in anchors.get(linked, {anchor}):
                broken.append(f"{path.relative_to(ROOT)}: {link}")
    assert broken == []


def test_every_page_is_in_the_navigation():
    site = tomllib.loads((ROOT / "zensical.toml").read_text("utf-8"))["project"]
    pages = list(navigated(site["nav"]))
    assert sorted(pages) == sorted({*written_pages(), *generated_pages()})


def test_an_explanation_takes_ten_minutes_to_read():
    words = {page.name: len(page.read_text("utf-8").split()) for page in (DOCS / "explanation").glob("*.md")}
    assert {name: count for name, count in words.items() if count > MOST_WORDS} == {}


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
