"""A percentage has one form wherever a person reads it: a blank before its sign, as the SI has it."""

import ast
import re
from collections.abc import Iterator

import pytest

from tools.docs_site.staging import ROOT

CODE = [path for folder in ("gateway", "firmware_protocol", "tools") for path in sorted((ROOT / folder).rglob("*.py"))]
VIEWS = [path for kind in ("j2", "html", "js") for path in sorted((ROOT / "gateway").rglob(f"*.{kind}"))]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").rglob("*.md"))]
# A width of a style sheet, what a user types, bytes of a wrong sensor, and the sign of a template.
OTHERS = re.compile(r"(?:width|height) ?[:=] ?\"?100%|(?:\w|--want )=\d[\d.]*%|RH=51%|%[-\d.]*[a-z(%]|\{%|%\}")


def unspaced(text: str) -> list[str]:
    """Return where a number meets the sign of percent."""
    return re.findall(r".{0,30}(?:\d|\}\})%(?!\})", OTHERS.sub("", text))


def shown_by(tree: ast.AST) -> Iterator[str]:
    """Yield the percentages without a blank that strings of a module hold or format."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield from unspaced(node.value)
        elif isinstance(node, ast.JoinedStr):
            for part, after in zip(node.values, [*node.values[1:], None], strict=True):
                if not isinstance(part, ast.FormattedValue):
                    continue
                spec = part.format_spec
                if isinstance(spec, ast.JoinedStr) and ast.unparse(spec).rstrip("'\"").endswith("%"):
                    yield ast.unparse(part)
                if isinstance(after, ast.Constant) and str(after.value).startswith("%"):
                    yield ast.unparse(part)


def test_code_writes_a_blank_before_percent():
    """Templates of reasons get theirs from the wording, which `test_wording` holds."""
    wrong = {path: list(shown_by(ast.parse(path.read_text("utf-8")))) for path in CODE if path.name != "reasons.py"}
    assert {str(path.relative_to(ROOT)): texts for path, texts in wrong.items() if texts} == {}


@pytest.mark.parametrize("paths", [VIEWS, PAGES], ids=["views", "pages"])
def test_views_and_pages_write_a_blank_before_percent(paths):
    wrong = {
        str(path.relative_to(ROOT)): unspaced(path.read_text("utf-8")) for path in paths if "uPlot" not in path.name
    }
    assert {name: texts for name, texts in wrong.items() if texts} == {}


def test_a_missing_blank_is_seen():
    assert unspaced("2.0% of it")
    assert unspaced("{{ share }}%")
    assert not unspaced("2.0 % of it, {% if a %}, --want Ts=3%, %s")
    assert list(shown_by(ast.parse("f'{share:.0%}'")))
    assert list(shown_by(ast.parse("f'{share}%'")))
