"""Reference of the diagnosis' thresholds, generated from `gateway.diagnosis.criteria`."""

import ast
import inspect
from collections.abc import Iterator
from itertools import pairwise

from gateway.diagnosis import criteria
from tools.docs_site.markdown import code, escaped, table

_INTRODUCTION = """\
# Thresholds

Every threshold of `treadlink diagnose` with its reason. [Closing the loop](../explanation/closing-the-loop.md) explains
the method. They stand in `gateway/diagnosis/criteria.py` and may change at any time.
"""


def thresholds() -> Iterator[tuple[str, tuple[float, ...], str]]:
    """Yield name, values and reason of every threshold, in the order of the module."""
    for statement, after in pairwise(ast.parse(inspect.getsource(criteria)).body):
        if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name):
            assert isinstance(after, ast.Expr), statement.target.id
            assert isinstance(after.value, ast.Constant), statement.target.id
            value = getattr(criteria, statement.target.id)
            yield statement.target.id, value if isinstance(value, tuple) else (value,), str(after.value.value)


def thresholds_markdown() -> str:
    """Return the reference of every threshold as a table."""
    rows = (
        (code(name), ", ".join(f"{value:g}" for value in values), escaped(reason))
        for name, values, reason in thresholds()
    )
    return "\n".join([_INTRODUCTION, *table(("Threshold", "Value", "Reason"), rows)]).rstrip() + "\n"
