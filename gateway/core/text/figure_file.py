"""Figures as files: whether one can be drawn, and its bytes."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from gateway.core.errors import OutputError
from gateway.core.optional_packages import require_packages

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SUFFIXES: Final = (".svg", ".png")


def check_figure(path: Path, suffixes: Sequence[str] = SUFFIXES) -> None:
    """Fail before the work if a figure cannot be drawn.

    Raises:
        OutputError: the suffix names no format, or matplotlib is missing.
    """
    if path.suffix.lower() not in suffixes:
        raise OutputError(f"the suffix of '{path}' names no format of a figure", f"Give one of {', '.join(suffixes)}.")
    require_packages("a figure", "plot", "matplotlib")


def figure_bytes(figure: Figure, kind: str) -> bytes:
    """Return the file of a figure, without a date."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format=kind, metadata={"Date": None} if kind == "svg" else None)
    return buffer.getvalue()
