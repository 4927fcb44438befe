"""Thresholds of the inference: every one has its reason."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from gateway.closure.inference import criteria


def test_every_threshold_has_a_reason() -> None:
    body = ast.parse(Path(criteria.__file__).read_text()).body
    names = []
    for statement, after in zip(body, [*body[1:], None], strict=True):
        if not isinstance(statement, ast.AnnAssign):
            continue
        assert isinstance(statement.target, ast.Name)
        names.append(statement.target.id)
        assert isinstance(after, ast.Expr), names[-1]
        assert isinstance(after.value, ast.Constant), names[-1]
        assert len(str(after.value.value)) > 15, names[-1]
    assert len(names) == len(set(names)) >= 15
    assert {name for name in vars(criteria) if name.isupper()} == set(names)


def test_page_lists_every_threshold() -> None:
    page = (Path(__file__).parents[2] / "docs" / "explanation" / "closing-the-loop.md").read_text()
    listed = dict(re.findall(r"^\| `([A-Z_]+)` \| ([^|]+) \|", page, re.MULTILINE))
    assert set(listed) == {name for name in vars(criteria) if name.isupper()}
    for name, shown in listed.items():
        value = getattr(criteria, name)
        stated = tuple(map(float, shown.split(", ")))
        assert stated == pytest.approx(value if isinstance(value, tuple) else (value,), rel=1e-3), name


def test_names_are_rarely_wrong() -> None:
    assert criteria.SUPPORTED < criteria.LISTED < 0.5 < criteria.NAMED < 1.0
    assert criteria.PRIOR_ODDS < 0.1
