"""The known name that a mistyped one was meant to be."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def nearest(name: str, names: Iterable[str]) -> str | None:
    """Return the known name most similar to `name`, or None when none is similar."""
    by_lower = {item.lower(): item for item in names}
    matches = difflib.get_close_matches(name.lower(), by_lower, n=1, cutoff=0.6)
    return by_lower[matches[0]] if matches else None


def did_you_mean(name: str, names: Iterable[str]) -> str:
    """Return the sentence that proposes the known name most similar to `name`, with a space after it, or nothing."""
    match = nearest(name, names)
    return f"Did you mean {match}? " if match else ""
