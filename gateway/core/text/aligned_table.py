"""Tables for a terminal: aligned columns that fit its width, wrapped where they do not."""

import shutil
import sys
from collections.abc import Iterator, Sequence
from itertools import zip_longest
from textwrap import wrap
from typing import Final

from gateway.core.text.text import filled, pad, pad_left, width

NARROWEST: Final = 80
"""Columns of a terminal for which every table is made."""

_GAP: Final = "  "
_LEAST_LABEL: Final = 20
# Longer lines are hard to follow.
WIDEST: Final = 120


def terminal_columns(*, on_err: bool = False) -> int:
    """Return the columns of the terminal, `NARROWEST` at least; where the output is no terminal, `WIDEST`."""
    if not (sys.stderr if on_err else sys.stdout).isatty():
        return WIDEST
    return max(NARROWEST, min(shutil.get_terminal_size((NARROWEST, 24)).columns, WIDEST))


def for_terminal(line: str, *, on_err: bool = False) -> str:
    """Return a line as the terminal takes it: broken between words where it is too wide, whole where there is none."""
    is_terminal = (sys.stderr if on_err else sys.stdout).isatty()
    return "\n".join(wrapped(line, terminal_columns(on_err=on_err))) if is_terminal else line


def table_lines(rows: Sequence[Sequence[str]], columns: int) -> Iterator[str]:
    """Yield rows as aligned lines of at most `columns` columns where their words allow it.

    Heads wrap first, then cells behind commas and before brackets, then labels; a label without room for that stands
    above its cells.

    Args:
        rows: heads and rows of equal length; the first column is the label, the others are aligned right.
        columns: of the terminal.
    """
    head, *body = rows
    labels, gaps = max(width(row[0]) for row in rows), len(_GAP) * (len(head) - 1)
    words = max(width(word) for row in rows for word in row[0].split(" "))
    sizes: list[int] = []
    for split_head, split_cell in ((_unbroken, _unbroken), (str.split, _unbroken), (str.split, _parts)):
        sizes = [
            max(
                width(part)
                for part in [*split_head(head[column]), *(part for row in body for part in split_cell(row[column]))]
            )
            for column in range(1, len(head))
        ]
        if labels + sum(sizes) + gaps <= columns:
            break
    label_width = min(columns - sum(sizes) - gaps, labels)
    is_above = label_width < max(min(labels, _LEAST_LABEL), words)
    for row, split in ((row, str.split if row is head else _parts) for row in rows):
        if is_above and row[0]:
            yield row[0]
        label = [""] if is_above else filled(row[0].split(" "), label_width)
        wrapped = [filled(split(text), size) for text, size in zip(row[1:], sizes, strict=True)]
        for line in zip_longest(label, *wrapped, fillvalue=""):
            cells = [pad_left(text, size) for text, size in zip(line[1:], sizes, strict=True)]
            yield _GAP.join([pad(line[0], 0 if is_above else label_width), *cells]).rstrip()


def wrapped(line: str, columns: int) -> list[str]:
    """Return a line in as many as it needs, those behind the first indented by two more."""
    if width(line) <= columns:
        return [line]
    indent = " " * (len(line) - len(line.lstrip()) + 2)
    return wrap(line, columns, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)


def _unbroken(text: str) -> list[str]:
    return [text]


def _parts(text: str) -> list[str]:
    """Return what of a cell stays on one line."""
    return text.replace(", ", ",\0").replace(" (", "\0(").split("\0")
