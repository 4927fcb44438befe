"""The known name or file that a mistyped one was meant to be."""

import difflib
from collections.abc import Iterable
from itertools import islice
from pathlib import Path
from typing import Final

# A folder of millions of files must not delay a message.
_COMPARED_FILES: Final = 10_000


def nearest(name: str, names: Iterable[str]) -> str | None:
    """Return the known name most similar to `name`, or None when none is similar."""
    by_lower = {item.lower(): item for item in names}
    matches = difflib.get_close_matches(name.lower(), by_lower, n=1, cutoff=0.6)
    return by_lower[matches[0]] if matches else None


def did_you_mean(name: str, names: Iterable[str]) -> str:
    """Return the sentence that proposes the known name most similar to `name`, with a space after it, or nothing."""
    match = nearest(name, names)
    return f"Did you mean {match}? " if match else ""


def missing_path_remedy(path: Path) -> str:
    """Return what helps where a path does not exist: the nearest name with a similar stem in its folder, if any."""
    try:
        names = [entry.name for entry in islice(path.parent.iterdir(), _COMPARED_FILES)]
    except OSError:
        return "Check the path."
    # Two names of unlike stems would be similar by a common suffix alone.
    match = nearest(path.name, (name for name in names if nearest(path.stem, [Path(name).stem])))
    return f"Check the path. Did you mean {path.parent / match}?" if match else "Check the path."
