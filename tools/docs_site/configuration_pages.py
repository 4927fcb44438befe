"""Reference of the TOML files: vehicle, import map and scenario, generated from the pydantic models."""

import enum
import inspect
import json
import re
import typing
from collections.abc import Iterator
from typing import Any, Final

import annotated_types
from pydantic import AwareDatetime, BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from gateway.core.config.vehicle import VehicleConfig
from gateway.forces.known_runs import SlipRunsFile
from gateway.importing.import_map import ImportMap
from gateway.planner.accelerometer import AccelerometerList
from gateway.simulator.scenario_model import Scenario
from gateway.simulator.time_series import Series
from tools.docs_site.markdown import code, docstring, escaped, sentence, table

DOCUMENTS: Final[tuple[tuple[str, type[BaseModel], str], ...]] = (
    (
        "Vehicle",
        VehicleConfig,
        "The file given as `--config`, checked by `treadlink doctor --config FILE`. "
        "How to write one: [Describe a vehicle](../how-to/describe-a-vehicle.md).",
    ),
    (
        "Import map",
        ImportMap,
        "The file given to `treadlink import --map`. "
        "How to write one: [Import measurements](../how-to/import-measurements.md).",
    ),
    (
        "Runs of known slip",
        SlipRunsFile,
        "The file given to `treadlink calibrate slip`. "
        "How to write one: [Calibrate slip](../how-to/calibrate-slip.md).",
    ),
    (
        "Scenario",
        Scenario,
        "The file given to `treadlink simulate` or as `sim:FILE`. "
        "How to write one: [Simulate a tire](../how-to/simulate-a-tire.md).",
    ),
    (
        "Accelerometers",
        AccelerometerList,
        "The file given to `treadlink plan --sensors`. "
        "How to write one: [Choose a sensor](../how-to/choose-a-sensor.md).",
    ),
)

_INTRODUCTION: Final = """\
# Configuration

Treadlink reads these kinds of TOML file. Keys carry their unit. An unknown key is an error. All faults of a file are
reported at once, each with the value that was found and what is allowed.
"""


def configuration_markdown() -> str:
    """Return the reference of every table and key of each kind of file."""
    lines = [_INTRODUCTION]
    for title, model, meaning in DOCUMENTS:
        lines += [f"## {title}", "", meaning, ""]
        lines += _tables(title, model, "", {})
    return "\n".join(lines).rstrip() + "\n"


def _tables(document: str, model: type[BaseModel], path: str, seen: dict[type[BaseModel], str]) -> Iterator[str]:
    """Yield a table of keys and, after it, those of the tables inside it; a model that came before is referred to."""
    keys = {name: field for name, field in model.model_fields.items() if _model_in(field.annotation) is None}
    if path:
        yield from (f"### {document}: `{path}`", "")
        if model in seen:
            yield from (f"The same keys as `{seen[model]}`.", "")
            return
        seen[model] = path
        if text := _meaning(model):
            yield from (text, "")
    if keys:
        yield from table(("Key", "Allowed", "Meaning"), (_row(name, field) for name, field in keys.items()))
    for name, field in model.model_fields.items():
        inner = _model_in(field.annotation)
        if inner is not None:
            dotted = f"{path.strip('[]')}.{name}" if path else name
            many = typing.get_origin(field.annotation) is tuple
            yield from _tables(document, inner, f"[[{dotted}]]" if many else f"[{dotted}]", seen)


def _model_in(annotation: object) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((result for part in typing.get_args(annotation) if (result := _model_in(part))), None)


def _meaning(model: type[BaseModel]) -> str:
    """Return a model's docstring without the names of its tables, which the heading shows."""
    return sentence(re.sub(r"^(`\[+[\w.]+\]+`(,| and)? ?)+[:;.]? *", "", docstring(model).replace("\n", " ")))


def _row(name: str, field: FieldInfo) -> tuple[str, str, str]:
    """Return a key, what is allowed and what it means; values that `allowed` lists are not repeated in the meaning."""
    meaning = re.sub(r'^("[^"]+"(, | or )?)+(: ?|; ?|$)', "", field.description or "")
    return code(name), _allowed(field), f"{escaped(sentence(meaning))} {_default(field)}".strip()


def _allowed(field: FieldInfo) -> str:
    for item in field.metadata:
        if allowed := _validator_text(getattr(item, "func", None)):
            return escaped(allowed)
    low = high = ""
    for item in field.metadata:
        if isinstance(item, annotated_types.Ge):
            low = f"{item.ge:g}"
        elif isinstance(item, annotated_types.Gt):
            low = f"more than {item.gt:g}"
        elif isinstance(item, annotated_types.Le):
            high = f"{item.le:g}"
    if low and high:
        return f"{low}, up to {high}" if low.startswith("more") else f"{low} to {high}"
    return low if low.startswith("more") else f"{low} or more" if low else _kind(field.annotation)


def _validator_text(function: object) -> str:
    """Return what the validators of series, triples and units allow; they keep it in their closure, for messages."""
    captured = inspect.getclosurevars(function).nonlocals if inspect.isfunction(function) else {}
    return captured.get("allowed") or (f"one of {', '.join(captured['names'])}" if "names" in captured else "")


def _kind(annotation: Any) -> str:
    """Return what a value of a type looks like in TOML."""
    origin, parts = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Annotated:
        return _kind(parts[0])
    if origin is typing.Literal:
        return ", ".join(code(json.dumps(part)) for part in parts)
    if origin is tuple:
        return f"list of {_kind(parts[0])}"
    if isinstance(annotation, type) and issubclass(annotation, enum.Enum):
        return ", ".join(code(json.dumps(str(member))) for member in annotation)
    for part in parts:
        if part is not type(None):
            return _kind(part)
    names: dict[Any, str] = {
        str: "text", bool: "`true`, `false`", int: "whole number", float: "number", AwareDatetime: "date and time"
    }  # fmt: skip
    return names.get(annotation, "text")


def _default(field: FieldInfo) -> str:
    value = field.default
    if value is PydanticUndefined:
        return "**Required.**"
    if value is None or value in ((), ""):
        return ""
    if isinstance(value, Series):
        value = value.points[0][1]
    if isinstance(value, tuple):
        value = value[0] if len(set(value)) == 1 else list(value)
    return f"Default: {code(json.dumps(value) if isinstance(value, str | bool | list) else f'{value:g}')}."
