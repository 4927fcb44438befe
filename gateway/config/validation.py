"""Validate a TOML document whole: every fault is found and told at once, each with what is allowed."""

from __future__ import annotations

import difflib
import json
import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeVar, get_args

import annotated_types
from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic.fields import FieldInfo

from gateway.constants import STANDARD_GRAVITY_MPS2
from gateway.errors import ConfigError

ModelT = TypeVar("ModelT", bound=BaseModel)
Location = tuple[int | str, ...]


class Section(BaseModel):
    """Base of every table of a document: frozen, no unknown keys, no silent conversions, no NaN."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing wrong in a document.

    Attributes:
        key: where, dotted.
        found: the value found, as TOML shows it, or `nothing`.
        allowed: what is allowed there.
    """

    key: str
    found: str
    allowed: str

    def __str__(self) -> str:
        """Return `key: value found, what is allowed`."""
        return f"{self.key}: {self.found} found, {self.allowed}"


# unit suffix of a key -> (factor, what the user probably wrote, given that value * factor would be allowed)
_UNIT_HINTS: Final[dict[str, tuple[tuple[float, str], ...]]] = {
    "_mm": ((1e3, "m"), (10.0, "cm"), (25.4, "inch")),
    "_kpa": ((1e2, "bar"), (1e-3, "Pa"), (6.894757, "psi")),
    "_n": ((1e3, "kN"), (STANDARD_GRAVITY_MPS2, "kg")),
    "_kg": ((1e3, "t"), (1 / STANDARD_GRAVITY_MPS2, "N")),
    "_hz": ((1e3, "kHz"),),
}
_UNIT_NAMES: Final = {"_mm": "mm", "_kpa": "kPa", "_n": "N", "_kg": "kg", "_hz": "Hz", "_degc": "degC", "_kmh": "km/h"}


def read_text(path: Path, what: str) -> str:
    """Return the text of a TOML file.

    Raises:
        ConfigError: there is no such file, it cannot be read, or it is not UTF-8.
    """
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: byte {error.start} is not UTF-8", "Save the file as UTF-8 text.") from error
    except OSError as error:
        reason = error.strerror or str(error)
        raise ConfigError(f"{path}: {what} cannot be read: {reason}", "Check the path and its permissions.") from error


def parse_document(
    model: type[ModelT],
    text: str,
    origin: str,
    more: Callable[[Mapping[str, Any]], Iterable[Fault]] = lambda _: (),
) -> ModelT:
    """Return the document as `model`.

    Args:
        model: what the document must look like.
        text: TOML.
        origin: file name shown with each fault.
        more: checks across keys; sees the raw document, of which any key may be missing or of a wrong type.

    Raises:
        ConfigError: naming every fault, or the line of a syntax error.
    """
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        end = f"at the end of the document, line {text.rstrip().count(chr(10)) + 1}"
        message = str(error).replace("at end of document", end)
        raise ConfigError(f"{origin}: not valid TOML: {message}", "Mend the syntax at that place.") from error
    parsed: ModelT | None = None
    faults: list[Fault] = []
    try:
        parsed = model.model_validate(data)
    except ValidationError as error:
        # A fault without location comes from the model's own call of the checks across keys: `more` lists it better.
        # "too short" counts the good items of a list only: told when the list is really empty.
        faults += [
            _fault(model, data, dict(item))
            for item in error.errors()
            if item["loc"] and not (item["type"] == "too_short" and item["input"])
        ]
    faults += more(data)
    if parsed is None or faults:
        lines = list(dict.fromkeys(f"{origin}: {fault}" for fault in faults))
        count = "1 fault" if len(lines) == 1 else f"{len(lines)} faults"
        raise ConfigError("\n".join(lines), f"Mend {count} in {origin}.")
    return parsed


def show(value: object) -> str:
    """Return a value as TOML writes it, shortened."""
    if isinstance(value, Mapping):
        return "a table"
    if isinstance(value, str | bool | int | float):
        text = json.dumps(value, ensure_ascii=False)
    else:
        text = f"a list of {len(value)}" if isinstance(value, list) else str(value)
    return text if len(text) <= 60 else text[:57] + "..."


def nearest(name: str, known: Iterable[str]) -> str | None:
    """Return the known name most like `name`, or None when none is like it."""
    by_lower = {item.lower(): item for item in known}
    matches = difflib.get_close_matches(name.lower(), by_lower, n=1, cutoff=0.6)
    return by_lower[matches[0]] if matches else None


def key_of(data: object, location: Location) -> str:
    """Return the dotted key of a location; a wheel is named by its position where it has one, else by its number."""
    key = ""
    for part in location:
        if isinstance(part, int):
            items = [item for item in data if isinstance(item, Mapping)] if isinstance(data, list) else []
            item = data[part] if isinstance(data, list) and part < len(data) else None
            name = item.get("position") if isinstance(item, Mapping) else None
            unique = isinstance(name, str) and name and sum(other.get("position") == name for other in items) == 1
            key += f"[{name}]" if unique else f"[#{part + 1}]"
            data = item
        else:
            key += f".{part}" if key else part
            data = data.get(part) if isinstance(data, Mapping) else None
    return key


def _fault(model: type[BaseModel], data: object, item: Mapping[str, Any]) -> Fault:
    location: Location = item["loc"]
    kind: str = item["type"]
    key = key_of(data, location)
    owner, field = _field_at(model, location)
    if kind == "extra_forbidden":
        names = list(owner.model_fields) if owner else []
        guess = nearest(str(location[-1]), names)
        hint = f"did you mean '{guess}'?" if guess else f"known keys: {', '.join(names)}"
        return Fault(key, show(item["input"]), f"there is no such key; {hint}")
    if kind == "missing":
        return Fault(key, "nothing", f"{_allowed(field, str(item['msg']))} is required")
    value = item["input"]
    message = str(item["msg"]).removeprefix("Value error, ")
    allowed = _allowed(field, message) if kind not in ("value_error", "assertion_error") else message
    return Fault(key, show(value), f"allowed: {allowed}{_unit_hint(str(location[-1]), value, field)}")


def _field_at(model: type[BaseModel], location: Location) -> tuple[type[BaseModel] | None, FieldInfo | None]:
    """Return the model that holds the last key of a location, and that key's field."""
    owner: type[BaseModel] | None = model
    field: FieldInfo | None = None
    names = [part for part in location if isinstance(part, str)]
    for depth, name in enumerate(names):
        field = owner.model_fields.get(name) if owner else None
        if depth < len(names) - 1:
            owner = _model_in(field.annotation) if field else None
    return owner, field


def _model_in(annotation: object) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((found for part in get_args(annotation) if (found := _model_in(part))), None)


def _bounds(field: FieldInfo) -> tuple[float | None, float | None, bool]:
    """Return (lowest, highest, lowest itself excluded) of a numeric field."""
    low = high = None
    exclusive = False
    for item in field.metadata:
        if isinstance(item, annotated_types.Ge):
            low = float(item.ge)  # type: ignore[arg-type]
        elif isinstance(item, annotated_types.Gt):
            low, exclusive = float(item.gt), True  # type: ignore[arg-type]
        elif isinstance(item, annotated_types.Le):
            high = float(item.le)  # type: ignore[arg-type]
    return low, high, exclusive


def _allowed(field: FieldInfo | None, message: str) -> str:
    if field is None:
        return message
    low, high, exclusive = _bounds(field)
    if low is not None and high is not None:
        text = f"more than {low:g}, up to {high:g}" if exclusive else f"{low:g} to {high:g}"
    elif low is not None:
        text = f"more than {low:g}" if exclusive else f"{low:g} or more"
    else:
        text = ""
    if _model_in(field.annotation) and not field.description:
        return "a list of tables" if get_args(field.annotation) else "a table"
    kinds = {int: "a whole number", float: "a number", str: "text", bool: "true or false"}
    bare = [part for part in (field.annotation, *get_args(field.annotation)) if part in kinds]
    kind = kinds[bare[0]] if bare else ""
    described = ", ".join(part for part in (f"{kind} {text}".strip(), field.description or "") if part)
    return described or message


def _unit_hint(key: str, value: object, field: FieldInfo | None) -> str:
    if field is None or isinstance(value, bool) or not isinstance(value, int | float):
        return ""
    low, high, _ = _bounds(field)
    suffix = "_" + key.rsplit("_", 1)[-1]
    for factor, unit in _UNIT_HINTS.get(suffix, ()):
        converted = value * factor
        if (low is None or converted >= low) and (high is None or converted <= high):
            return f" ({_UNIT_NAMES[suffix]}; was it meant in {unit}? then write {converted:.6g})"
    return f" ({_UNIT_NAMES[suffix]})" if suffix in _UNIT_NAMES else ""
