"""Reference of the interface for Python, generated from its functions and tables."""

import inspect
from dataclasses import fields
from typing import Final

import gateway
from gateway.api.column_table import COLUMN, ColumnTable, unit_of
from gateway.api.estimate_comparison import Comparison
from gateway.api.estimate_tables import Alarms, Estimates
from gateway.api.signal_tables import (
    AngleWaveforms,
    AverageWaveform,
    Environment,
    OrderSpectra,
    Revolutions,
    Samples,
)
from tools.docs_site.markdown import code, docstring, escaped, table

_INTRODUCTION = """\
# Python

`import gateway` gives these names and loads each when it is first used. [Use treadlink from
Python](../how-to/use-from-python.md) shows how they work together. The modules behind them are in the
[API](api/index.md).
"""
# Table -> call that returns it.
TABLES: Final[dict[type[ColumnTable], str]] = {
    Samples: "wheel.samples()",
    Environment: "wheel.environment()",
    Revolutions: "wheel.revolutions()",
    AngleWaveforms: "wheel.angle()",
    AverageWaveform: "wheel.average()",
    OrderSpectra: "wheel.orders()",
    Estimates: "recording.estimates()",
    Alarms: "recording.alarms()",
    Comparison: "estimates.compare(other)",
}
_TABLES = """\
## Tables

Every column is an attribute, and `table["name"]` is the same array. `columns`, `units` and `descriptions` describe
them, `metadata` has the values of the whole table. `to_dict()` returns numpy arrays, `to_pandas()` a DataFrame with
units in `attrs`, `to_arrow()` an Arrow table with units in the metadata of its fields. Complex columns are pairs of
real and imaginary part in Arrow.
"""


def python_markdown() -> str:
    """Return the reference of every name of the top package."""
    lines = [_INTRODUCTION]
    for title, kind in (("Functions", inspect.isfunction), ("Classes", _is_class), ("Errors", _is_error)):
        lines += [f"## {title}", ""]
        public = {name: getattr(gateway, name) for name in gateway.names()}
        chosen = {name: value for name, value in public.items() if kind(value)}
        if title == "Errors":
            rows = ((code(f"gateway.{name}"), escaped(_first_line(value))) for name, value in chosen.items())
            lines += table(("Error", "Meaning"), rows)
        else:
            for name, value in chosen.items():
                lines += [f"::: {value.__module__}.{value.__qualname__}", *_options(name), ""]
    lines.append(_TABLES)
    for kind_of_table, call in TABLES.items():
        lines += [f"### {kind_of_table.__name__}", "", f"`{call}`. {_first_line(kind_of_table)}", ""]
        values = _attributes(kind_of_table)
        if values:
            lines += ["Values of the whole table: " + ", ".join(map(code, values)) + ".", ""]
        rows = ((code(name), escaped(unit_of(name)), escaped(text)) for name, text in _columns(kind_of_table).items())
        lines += table(("Column", "Unit", "Meaning"), rows)
    return "\n".join(lines).rstrip() + "\n"


def _options(name: str) -> list[str]:
    """Return the options of a directive: the name as users write it, without what they do not call."""
    return ["    options:", f"      heading: gateway.{name}", "      heading_level: 3", '      filters: ["!^_"]']


def _is_class(value: object) -> bool:
    return inspect.isclass(value) and not issubclass(value, Exception) and value not in TABLES


def _is_error(value: object) -> bool:
    return inspect.isclass(value) and issubclass(value, Exception)


def _first_line(documented: object) -> str:
    return docstring(documented).partition("\n\n")[0].replace("\n", " ")


def _columns(kind: type[ColumnTable]) -> dict[str, str]:
    return {field.name: field.metadata[COLUMN] for field in fields(kind) if COLUMN in field.metadata}


def _attributes(kind: type[ColumnTable]) -> list[str]:
    return [field.name for field in fields(kind) if COLUMN not in field.metadata]
