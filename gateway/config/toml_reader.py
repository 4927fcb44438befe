"""Reader of TOML documents from anywhere, also from inside a recording: every fault of the text is a ConfigError."""

import re
import tomllib
from typing import Any, Final

from gateway.errors import ConfigError

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
