"""The folder that the site generator renders: pages of docs/, top-level pages, generated pages and linked files."""

import os
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from gateway.diagnosis.views.effect_catalogue import effects_markdown
from tools.docs_site.accelerometer_pages import accelerometers_markdown
from tools.docs_site.api_pages import api_markdown
from tools.docs_site.command_pages import commands_markdown
from tools.docs_site.configuration_pages import configuration_markdown
from tools.docs_site.filled_tables import filled
from tools.docs_site.notebook_pages import notebook_markdown
from tools.docs_site.python_pages import python_markdown
from tools.docs_site.quantity_pages import quantities_markdown
from tools.docs_site.reason_pages import reasons_markdown
from tools.docs_site.threshold_pages import thresholds_markdown

ROOT: Final = Path(__file__).parents[2]
DOCS: Final = ROOT / "docs"
# Pages of the site that are kept elsewhere in the repository.
TOP_LEVEL: Final = {"CONTRIBUTING.md": "contributing/index.md", "CHANGELOG.md": "changelog.md"}
# Files that pages link to and that are no pages are copied to this folder of the site.
FILES: Final = "files"

_LINK: Final = re.compile(r"(?<!`)(!?\[(?:[^\[\]]|\[[^\]]*\])*\]\()([^()\s]+)(\))")


def generated_pages(*, run_notebooks: bool = False) -> dict[str, Callable[[], str]]:
    """Return path in the site -> what writes the Markdown of every generated page."""
    return {
        "reference/accelerometers.md": accelerometers_markdown,
        "reference/commands.md": commands_markdown,
        "reference/configuration.md": configuration_markdown,
        "reference/effects.md": effects_markdown,
        "reference/python.md": python_markdown,
        "reference/quantities.md": quantities_markdown,
        "reference/reasons.md": reasons_markdown,
        "reference/thresholds.md": thresholds_markdown,
        **notebook_markdown(run=run_notebooks),
        **{f"reference/api/{name}": page for name, page in api_markdown().items()},
    }


def written_pages() -> dict[str, Path]:
    """Return path in the site -> file of every page that is written by hand."""
    pages = {str(path.relative_to(DOCS)): path for path in sorted(DOCS.rglob("*.md"))}
    return pages | {page: ROOT / name for name, page in TOP_LEVEL.items()}


def relative_links(text: str) -> Iterator[str]:
    """Yield the targets of a page's links, except for addresses and links within the page."""
    for match in _LINK.finditer(_without_code(text)):
        if not re.match(r"[a-z]+:|#", match[2]):
            yield match[2]


def stage(target: Path, *, run_notebooks: bool = False) -> None:
    """Rewrite the whole folder; `run_notebooks` adds the outputs of the notebooks to their pages."""
    shutil.rmtree(target, ignore_errors=True)
    by_source = {path.resolve(): page for page, path in written_pages().items()}
    for page, path in written_pages().items():
        _write(target / page, _relinked(path, page, by_source, target))
    for page, markdown in generated_pages(run_notebooks=run_notebooks).items():
        _write(target / page, markdown())
    for path in DOCS.rglob("*"):
        if path.is_file() and path.suffix != ".md":
            _copy(path, target / path.relative_to(DOCS))


def _relinked(source: Path, page: str, by_source: dict[Path, str], target: Path) -> str:
    """Return a page's text with its links turned into those of the site; files outside of docs/ are copied."""
    folder = Path(page).parent

    def link(match: re.Match[str]) -> str:
        address, mark, anchor = match[2].partition("#")
        if not address or re.match(r"[a-z]+:", address):
            return match[0]
        linked = (source.parent / address).resolve()
        if linked in by_source:
            new_path = by_source[linked]
        elif linked.is_relative_to(DOCS):
            new_path = str(linked.relative_to(DOCS))
        else:
            new_path = f"{FILES}/{linked.relative_to(ROOT)}"
            _copy(linked, target / new_path)
        return f"{match[1]}{os.path.relpath(new_path, folder)}{mark}{anchor}{match[3]}"

    return _LINK.sub(link, filled(source.read_text("utf-8")))


def _without_code(text: str) -> str:
    return re.sub(r"^```.*?^```|`[^`\n]+`", "", text, flags=re.DOTALL | re.MULTILINE)


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, "utf-8")


def _copy(path: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(path, target)
