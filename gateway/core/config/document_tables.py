"""Configurations and scenarios given as dictionaries, turned into the text that files have."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gateway.core.config.toml_writer import toml_text
from gateway.core.errors import ConfigError


def document_text(tables: Mapping[str, Any], origin: str) -> str:
    """Return tables as TOML; numbers and arrays of numpy, tuples and paths are taken too, None is left out.

    Args:
        tables: names and values; nested mappings are tables, lists of mappings are arrays of tables.
        origin: names the document in messages.

    Raises:
        ConfigError: a value is of a type that a configuration cannot have.
    """
    try:
        return toml_text({str(key): _plain(value) for key, value in tables.items() if value is not None})
    except TypeError as error:
        raise ConfigError(
            f"{origin}: {error}", "Values are numbers, texts, true or false, lists and dictionaries."
        ) from error


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items() if item is not None}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return str(value) if isinstance(value, Path) else value
