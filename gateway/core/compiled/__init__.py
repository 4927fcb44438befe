"""The compiled core: inner loops that also stand in numpy, beside their only callers.

`core` is None where it was not built, or where the environment variable TREADLINK_COMPILED is 0. Callers choose once,
at import. Both agree to 1e-10; the functions in numpy are the reference.
"""

import importlib
import os
from types import ModuleType


def is_switched_off() -> bool:
    """Return whether the environment asks for the functions in numpy."""
    return os.environ.get("TREADLINK_COMPILED") == "0"


def _loaded() -> ModuleType | None:
    if is_switched_off():
        return None
    try:
        return importlib.import_module("gateway.core.compiled._core")
    except ImportError:
        return None


core = _loaded()
