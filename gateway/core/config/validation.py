"""Validation of TOML documents that reports all faults at once, each with the allowed values."""

import itertools
import json
import re
import tomllib
import types
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any, Final, Literal, TypeVar, Union, get_args, get_origin

import annotated_types
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic.fields import FieldInfo

from gateway.core.bounded_input import read_bounded
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.errors import ConfigError, reading_remedy
from gateway.core.feature import Registry, added, object_of
from gateway.core.nearest_name import missing_path_remedy, nearest
from gateway.core.removed_names import replacement

ModelT = TypeVar("ModelT", bound=BaseModel)
Location = tuple[int | str, ...]

# A file that is no configuration has a fault in every line.
_LISTED_FAULTS: Final = 100
MAX_TOML_BYTES: Final = 512 << 10
"""A configuration of a hundred wheels takes a tenth of this. In a recording it must fit into one metadata record."""

_MAX_DEPTH: Final = 32
_INTEGERS: Final = range(-(1 << 63), 1 << 63)
# The time that tomllib takes grows with the square of the parts of a dotted key.
_LONG_KEY: Final = re.compile(
    r"""(?<![\w"'-])(?:(?:[\w-]{1,200}+|"[^"\n]{0,200}"|'[^'\n]{0,200}')[ \t]*\.[ \t]*){33}"""
)
_LONG_NUMBER: Final = re.compile(r"[0-9_]{1000,}")


def parse_toml(text: str, origin: str) -> dict[str, Any]:
    """Return the document in a TOML text; its integers have at most 64 bits, as TOML requires.

    Args:
        text: TOML.
        origin: file name shown in messages.

    Raises:
        ConfigError: the text is not valid TOML, is too long, or is nested too deep.
    """
    if len(text) > MAX_TOML_BYTES:
        raise ConfigError(
            f"{origin}: {len(text)} characters are too many for a configuration, allowed: {MAX_TOML_BYTES}",
            "Check that it is the right file.",
        )
    if (match := _LONG_KEY.search(text)) is not None:
        raise _too_deep(origin, f", line {_line(text, match.start())}")
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        end = f"at the end of the document, line {_line(text.rstrip(), len(text))}"
        message = str(error).replace("at end of document", end)
        raise ConfigError(f"{origin}: not valid TOML: {message}", "Correct the syntax there.") from error
    except RecursionError as error:
        raise _too_deep(origin) from error
    except ValueError as error:  # Python's limit of the digits of a number
        match = _LONG_NUMBER.search(text)
        where = f" in line {_line(text, match.start())}" if match is not None else ""
        raise ConfigError(f"{origin}: not valid TOML: a number{where} is too long", "Correct the number.") from error
    _check(document, origin)
    return document


def _check(document: dict[str, Any], origin: str) -> None:
    """Check depth and integers without recursion, which a deep document would exhaust."""
    pending: list[tuple[Any, int, str]] = [(document, 0, "")]
    while pending:
        value, depth, key = pending.pop()
        if isinstance(value, dict | list):
            if depth > _MAX_DEPTH:
                raise _too_deep(origin)
            parts = value.items() if isinstance(value, dict) else ((key, part) for part in value)
            pending += [(part, depth + 1, name) for name, part in parts]
        elif isinstance(value, int) and value not in _INTEGERS:
            raise ConfigError(
                f"{origin}: not valid TOML: the number of '{key}' needs more than 64 bits", "Correct the number."
            )


def _too_deep(origin: str, where: str = "") -> ConfigError:
    return ConfigError(
        f"{origin}: not a configuration: tables, lists or keys nested deeper than {_MAX_DEPTH} levels{where}",
        "Check that it is the right file.",
    )


def _line(text: str, offset: int) -> int:
    return text.count("\n", 0, offset) + 1


Kind = TypeVar("Kind")


class Section(BaseModel):
    """Base of every table of a document: immutable, without unknown keys, silent conversions or NaN."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    def added(self, kind: type[Kind]) -> Kind | None:
        """Return the value of a key that a feature adds, by its type; None where the document does not have it."""
        return next((value for _, value in self if isinstance(value, kind)), None)


class AddedTable(Section):
    """Base of a table that a feature adds to a tire."""

    @abstractmethod
    def data(self) -> object:
        """Return what estimators of the feature take from `TireData.of`, in SI."""


@dataclass(frozen=True, slots=True)
class AddedKey:
    """A key of vehicle files that a feature adds.

    Attributes:
        kind: type of its table.
        description: for the reference of the configuration.
        default: where the document has no such key.
    """

    kind: type[Section]
    description: str
    default: Section | None = None


def add_keys(section: type[Section], table: str) -> None:
    """Add the keys that features declare for a table, after those of the core.

    Args:
        section: the table, whose class is complete.
        table: its name in the registry, empty for the document itself.
    """
    for name, target in added(Registry.VEHICLE_KEYS).items():
        of_table, _, key = name.rpartition(".")
        if of_table == table:
            declared: AddedKey = object_of(target)
            annotation: Any = declared.kind if declared.default is not None else declared.kind | None
            field = Field(default=declared.default, description=declared.description)
            section.__pydantic_fields__[key] = FieldInfo.from_annotated_attribute(annotation, field)
    section.model_rebuild(force=True)


def as_table(value: object) -> Mapping[str, Any]:
    """Return a table of a document that is not validated yet; an empty one for anything else."""
    return value if isinstance(value, Mapping) else {}


def as_tables(value: object) -> list[tuple[int, Mapping[str, Any]]]:
    """Return the tables of a list likewise, each with its index."""
    items = value if isinstance(value, list | tuple) else ()
    return [(index, item) for index, item in enumerate(items) if isinstance(item, Mapping)]


def within(default: Any, low: float, high: float, description: str) -> Any:
    """Return the declaration of a number from `low` to `high`, both included."""
    return Field(default=default, ge=low, le=high, description=description)


def above(default: Any, low: float, high: float, description: str) -> Any:
    """Return the declaration of a number above `low`, up to and including `high`."""
    return Field(default=default, gt=low, le=high, description=description)


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault of a document.

    Attributes:
        key: dotted key.
        value: the value as TOML shows it, None when it is missing.
        problem: what is wrong, or what is allowed.
    """

    key: str
    value: str | None
    problem: str

    def __str__(self) -> str:
        """Return `key: value found, problem`, or `key: missing, problem`."""
        return f"{self.key}: {'missing' if self.value is None else f'{self.value} found'}, {self.problem}"


# Unit suffix of a key -> (factor, unit): if value * factor is allowed, the user probably wrote it in that unit.
_UNIT_HINTS: Final[dict[str, tuple[tuple[float, str], ...]]] = {
    "_mm": ((1e3, "m"), (10.0, "cm"), (25.4, "inch")),
    "_kpa": ((1e2, "bar"), (1e-3, "Pa"), (6.894757, "psi")),
    "_n": ((1e3, "kN"), (STANDARD_GRAVITY_MPS2, "kg")),
    "_kg": ((1e3, "t"), (1 / STANDARD_GRAVITY_MPS2, "N")),
    "_hz": ((1e3, "kHz"),),
    "_gpa": ((1e-3, "MPa"), (1e-9, "Pa")),
    "_mpa": ((1e3, "GPa"), (1e-6, "Pa")),
}


def read_text(path: Path, what: str, *, max_bytes: int = MAX_TOML_BYTES) -> str:
    """Return the text of a file, without a byte order mark.

    Args:
        path: the file.
        what: what the file is, for messages.
        max_bytes: size of the largest file to read.

    Raises:
        ConfigError: there is no such file, it cannot be read, is too large, or is not UTF-8.
    """
    try:
        data = read_bounded(path, max_bytes)
    except FileNotFoundError as error:
        raise ConfigError(f"{path}: {what} cannot be read: no such file", missing_path_remedy(path)) from error
    except IsADirectoryError as error:
        raise ConfigError(f"{path}: {what} cannot be read: this is a folder", reading_remedy(error)) from error
    except OSError as error:
        reason = error.strerror or str(error)
        raise ConfigError(f"{path}: {what} cannot be read: {reason}", reading_remedy(error)) from error
    if len(data) > max_bytes:
        raise ConfigError(f"{path}: {what} is larger than {max_bytes >> 10} KiB", "Check that it is the right file.")
    try:
        return data.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        if b"\0" in data and not data.startswith((b"\xff\xfe", b"\xfe\xff")):
            remedy = f"This is not a text file. Give {what}."
        else:
            remedy = "Save the file as UTF-8 text."
        raise ConfigError(f"{path}: byte {error.start} is not UTF-8", remedy) from error


def parse_document(
    model: type[ModelT],
    text: str,
    origin: str,
    more: Callable[[Mapping[str, Any]], Iterable[Fault]] = lambda _: (),
) -> ModelT:
    """Return the document as `model`.

    Args:
        model: schema of the document.
        text: TOML.
        origin: file name shown with each fault.
        more: checks across keys. They get the raw document, of which any key may be missing or of a wrong type.

    Raises:
        ConfigError: naming every fault, or the line of a syntax error.
    """
    data = parse_toml(text, origin)
    parsed: ModelT | None = None
    faults: list[Fault] = []
    too_short: list[Fault] = []
    try:
        parsed = model.model_validate(data)
    except ValidationError as error:
        # A fault without location comes from the model's own call of the checks across keys; `more` reports it better.
        # "too short" counts only the valid items of a list, so it is reported only if the list is empty, or alone.
        for item in [item for item in error.errors() if item["loc"]][: _LISTED_FAULTS + 1]:
            is_short = item["type"] == "too_short" and item["input"]
            (too_short if is_short else faults).append(_fault(model, data, dict(item)))
    faults += itertools.islice(more(data), _LISTED_FAULTS)
    faults = faults or too_short
    if parsed is None or faults:
        lines = list(dict.fromkeys(f"{origin}: {fault}" for fault in faults))
        count = "1 fault" if len(lines) == 1 else f"{len(lines)} faults"
        if len(lines) > _LISTED_FAULTS:
            lines, count = [*lines[:_LISTED_FAULTS], f"{origin}: and more"], f"{_LISTED_FAULTS} faults and more"
        raise ConfigError("\n".join(lines), f"Correct {count} in {origin}.")
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


def key_of(data: object, location: Location) -> str:
    """Return the dotted key of a location; a wheel is named by its position if it has one, else by its number."""
    key = ""
    for part in location:
        if isinstance(part, int):
            items = [item for item in data if isinstance(item, Mapping)] if isinstance(data, list) else []
            item = data[part] if isinstance(data, list) and part < len(data) else None
            name = item.get("position") if isinstance(item, Mapping) else None
            is_unique = isinstance(name, str) and name and sum(peer.get("position") == name for peer in items) == 1
            key += f"[{name}]" if is_unique else f"[#{part + 1}]"
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
        table = next((part for part in reversed(location[:-1]) if isinstance(part, str)), "")
        remedy = replacement(f"[{table}]", str(location[-1]))
        if remedy is not None:
            return Fault(key, show(item["input"]), f"removed; {remedy}")
        names = list(owner.model_fields) if owner else []
        guess = nearest(str(location[-1]), names)
        hint = f"did you mean '{guess}'?" if guess else f"known keys: {', '.join(names)}"
        return Fault(key, show(item["input"]), f"unknown key; {hint}")
    if kind == "missing":
        return Fault(key, None, f"required: {_allowed(field, str(item['msg']))}")
    value = item["input"]
    message = str(item["msg"]).removeprefix("Value error, ")
    allowed = _allowed(field, message) if kind not in ("value_error", "assertion_error") else message
    return Fault(key, show(value), f"allowed: {allowed}{_unit_hint(str(location[-1]), value, field)}")


def _field_at(model: type[BaseModel], location: Location) -> tuple[type[BaseModel] | None, FieldInfo | None]:
    """Return the model that contains the last key of a location, and the field of that key."""
    owner: type[BaseModel] | None = model
    field: FieldInfo | None = None
    names = [part for part in location if isinstance(part, str)]
    for depth, name in enumerate(names):
        field = owner.model_fields.get(name) if owner else None
        if depth < len(names) - 1:
            owner = model_in(field.annotation) if field else None
    return owner, field


def model_in(annotation: object) -> type[BaseModel] | None:
    """Return the model of a table within an annotation, such as `Tire | None` or `tuple[Wheel, ...]`."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((model for part in get_args(annotation) if (model := model_in(part))), None)


def _bounds(field: FieldInfo) -> tuple[float | None, float | None, bool]:
    """Return (lowest, highest, whether the lowest itself is excluded) of a numeric field."""
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
    """Return the allowed values of a field with its description, or `message` if the field states neither."""
    if field is None:
        return message
    low, high, exclusive = _bounds(field)
    if low is not None and high is not None:
        limits = f" above {low:g}, at most {high:g}" if exclusive else f" from {low:g} to {high:g}"
    elif low is not None:
        limits = f" above {low:g}" if exclusive else f" of at least {low:g}"
    else:
        limits = ""
    described = f" ({field.description})" if field.description else ""
    kind = _kind(field.annotation)
    return f"{kind}{limits}{described}" if kind else field.description or message


def _kind(annotation: object) -> str:
    """Return in words what kind of value an annotation stands for, empty when it is none of TOML's."""
    kinds: dict[object, str] = {int: "a whole number", float: "a number", str: "text", bool: "true or false"}
    if annotation in kinds:
        return kinds[annotation]
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return "a table"
    if isinstance(annotation, type) and issubclass(annotation, Enum):
        return " or ".join(show(item.value) for item in annotation)
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin is Literal:
        return " or ".join(show(part) for part in parts)
    if origin is tuple:
        return "a list of tables" if model_in(annotation) else "a list"
    if origin in (Union, types.UnionType):
        return next((kind for part in parts if (kind := _kind(part))), "")
    return ""


def _unit_hint(key: str, value: object, field: FieldInfo | None) -> str:
    if field is None or isinstance(value, bool) or not isinstance(value, int | float):
        return ""
    low, high, _ = _bounds(field)
    suffix = "_" + key.rsplit("_", 1)[-1]
    for factor, unit in _UNIT_HINTS.get(suffix, ()):
        converted = value * factor
        if (low is None or converted >= low) and (high is None or converted <= high):
            return f"; if the value is in {unit}, write {converted:.6g}"
    return ""
