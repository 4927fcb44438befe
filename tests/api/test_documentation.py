"""The code of the guide to Python runs as it stands, and the reference lists everything."""

import dataclasses
import re
from pathlib import Path

import pytest

import gateway
from tools.docs_site.notebook_pages import NOTEBOOKS, notebook_markdown
from tools.docs_site.python_pages import TABLES, python_markdown

GUIDE = Path(__file__).parents[2] / "docs" / "how-to" / "use-from-python.md"


def test_code_of_the_guide_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    namespace = {}
    for block in re.findall(r"^```python\n(.*?)^```", GUIDE.read_text("utf-8"), re.DOTALL | re.MULTILINE):
        exec(compile(block, str(GUIDE), "exec"), namespace)
    printed = capsys.readouterr().out
    assert "<Recording 'drive.mcap': W1, 10.0 s" in printed
    assert "recording 'missing.mcap' does not exist Check the path." in printed
    assert callable(namespace["why"])


def test_reference_lists_every_name_and_column():
    page = python_markdown()
    for name in gateway.names():
        value = getattr(gateway, name)
        directive = f"::: {value.__module__}.{value.__qualname__}\n"
        assert value in TABLES or f"`gateway.{name}`" in page or directive in page
    for table in TABLES:
        section = page.partition(f"\n### {table.__name__}\n")[2].partition("\n### ")[0]
        for field in dataclasses.fields(table):
            assert f"`{field.name}`" in section


@pytest.mark.parametrize("path", sorted(NOTEBOOKS.glob("*.ipynb")), ids=lambda path: path.stem)
def test_notebook_has_a_page_with_its_code(path):
    page = notebook_markdown()[f"tutorials/notebook-{path.stem}.md"]()
    assert page.startswith("# ")
    assert "```python\n" in page
    assert ".ipynb)" not in page
