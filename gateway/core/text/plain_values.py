"""Values as JSON holds them."""

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from gateway.core.reasons import Reason
from gateway.core.storable_text import storable
from gateway.core.text.wording import as_json


def record(item: Any, *, without: Collection[str] = (), **others: object) -> dict[str, Any]:
    """Return the fields of a record by name, without some of them, and what is beside them or in their place."""
    return {field.name: getattr(item, field.name) for field in fields(item) if field.name not in without} | others


def plain(value: object) -> Any:
    """Return a value as dicts, lists, strings and finite numbers; None where it is not known.

    A record is a dict of its fields, a reason has code, values and text. Text that UTF-8 cannot encode is escaped.
    """
    match value:
        case None | bool() | int():
            return value
        case float():
            return float(value) if math.isfinite(value) else None
        case str():
            return storable(value)
        case np.ndarray() | np.generic():
            return plain(value.tolist())
        case Reason():
            return plain(as_json(value))
        case Mapping():
            return {plain(key): plain(item) for key, item in value.items()}
        case tuple() if hasattr(value, "_asdict"):
            return plain(value._asdict())
        case Iterable():
            return [plain(item) for item in value]
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    raise TypeError(f"JSON has no {type(value).__name__}")
