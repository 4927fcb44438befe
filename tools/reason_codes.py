"""Reason codes of all rooms, each declared in the module `reasons` of its room."""

import importlib
from functools import cache

from gateway.core.reasons import Code, Codes
from tools import rooms


@cache
def rooms_of_codes() -> tuple[type[Codes], ...]:
    """Return the codes of every room, those of the core first."""
    names = sorted(name for name in rooms.modules() if name.endswith(".reasons"))
    codes = {}
    for name in sorted(names, key=lambda name: not rooms.is_core(rooms.room_of(name))):
        of_module = vars(importlib.import_module(name)).values()
        codes |= {value: None for value in of_module if isinstance(value, type) and issubclass(value, Codes)}
    return tuple(value for value in codes if value is not Codes)


@cache
def all_codes() -> tuple[Code, ...]:
    """Return the codes of all rooms."""
    return tuple(code for codes in rooms_of_codes() for code in codes.members())
