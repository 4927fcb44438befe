"""TOML output of plain values; the standard library only reads TOML."""

import json
import re
from collections.abc import Iterator, Mapping
from typing import Final

_BARE_KEY: Final = re.compile(r"[A-Za-z0-9_-]+")


def toml_text(document: Mapping[str, object]) -> str:
    """Return a mapping of str, bool, int, finite float, lists and mappings as TOML; empty tables are left out."""
    return "\n".join(_table((), document)).lstrip("\n") + "\n"


def _table(path: tuple[str, ...], table: Mapping[str, object]) -> Iterator[str]:
    for key, value in table.items():
        if not isinstance(value, Mapping) and not _is_table_array(value):
            yield f"{_key(key)} = {_value(value)}"
    for key, value in table.items():
        name = ".".join(map(_key, (*path, key)))
        if isinstance(value, Mapping):
            lines = list(_table((*path, key), value))
            if lines:
                # A table that contains only tables needs no header of its own.
                yield from lines if lines[0] == "" else ["", f"[{name}]", *lines]
        elif _is_table_array(value):
            for item in value:  # type: ignore[attr-defined]
                yield from ("", f"[[{name}]]", *_table((*path, key), item))


def _is_table_array(value: object) -> bool:
    return isinstance(value, list | tuple) and bool(value) and all(isinstance(item, Mapping) for item in value)


def _key(key: str) -> str:
    return key if _BARE_KEY.fullmatch(key) else toml_string(key)


def _value(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, str):
        return toml_string(value)
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_value, value)) + "]"
    raise TypeError(f"TOML cannot express {type(value).__name__}")


def toml_string(text: str) -> str:
    """Return a text in quotes."""
    # JSON escapes are valid TOML. Only DEL, which JSON does not escape, is not allowed in TOML.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
