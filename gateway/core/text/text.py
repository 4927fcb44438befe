"""Width, cropping and cleaning of terminal text, and sizes of files."""

from __future__ import annotations

import json
import re
import unicodedata
from collections.abc import Iterable
from functools import lru_cache
from typing import Final

ELLIPSIS: Final = "…"

# All but ASCII, Latin, a few dashes, arrows, box drawing and braille needs a look-up for each character.
_NOT_PLAIN: Final = re.compile(r"[^ -~\xa0-\xac\xae-\u02ff\u2010-\u2026\u2190-\u21ff\u2500-\u25bf\u2800-\u28ff]")


@lru_cache(maxsize=1024)
def _cells(character: str) -> int:
    if unicodedata.combining(character) or unicodedata.category(character) in {"Cf", "Mn", "Me"}:
        return 0
    return 2 if unicodedata.east_asian_width(character) in "WF" else 1


def width(text: str) -> int:
    """Return the number of terminal cells of `text`."""
    if text.isascii() or not _NOT_PLAIN.search(text):
        return len(text)
    return sum(map(_cells, text))


def counted(number: int, noun: str) -> str:
    """Return `1 recording` or `2 recordings`."""
    return f"{number} {noun}" + ("" if number == 1 else "s")


def escaped(text: str) -> str:
    r"""Return `text` with everything unprintable as an escape such as `\n`, `\x1b` or `\u202e`.

    >>> escaped("one\ntwo\x1b[2J")
    'one\\ntwo\\x1b[2J'
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def json_text(document: object, indent: int | None = None, *, compact: bool = False) -> str:
    r"""Return a document as JSON in which everything unprintable is an escape such as `\u202e`.

    >>> json_text({"name": "Größe\x9b"})
    '{"name": "Größe\\u009b"}'

    Raises:
        ValueError: a number is not finite.
    """
    separators = (",", ":") if compact else None
    text = json.dumps(document, indent=indent, separators=separators, ensure_ascii=False, allow_nan=False)
    if text.replace("\n", "").isprintable():
        return text
    return "".join(c if c.isprintable() or c == "\n" else json.dumps(c)[1:-1] for c in text)


def clean(text: str) -> str:
    """Replace unprintable characters, so that a hub's log text cannot control the terminal."""
    return text if text.isprintable() else "".join(c if c.isprintable() else "·" if c > " " else " " for c in text)


def crop(text: str, cells: int) -> str:
    """Return `text`, or its beginning and an ellipsis, in at most `cells` cells."""
    if width(text) <= cells:
        return text
    if cells <= 0:
        return ""
    length, used_cells = 0, 1
    for character in text:
        used_cells += _cells(character)
        if used_cells > cells:
            break
        length += 1
    return text[:length] + ELLIPSIS


def crop_middle(text: str, cells: int) -> str:
    """Crop `text` in the middle: names and paths often differ at their ends."""
    if width(text) <= cells:
        return text
    if cells < 5 or not text.isascii():
        return crop(text, cells)
    tail = cells // 2
    return text[: cells - 1 - tail] + ELLIPSIS + text[-tail:]


def pad(text: str, cells: int) -> str:
    """Return `text` cropped or filled with blanks on the right to exactly `cells` cells."""
    padding = cells - width(text)
    return text + " " * padding if padding >= 0 else pad(crop(text, cells), cells) if cells > 0 else ""


def pad_left(text: str, cells: int) -> str:
    """Return `text` filled with blanks on the left to at least `cells` cells; longer text stays whole."""
    return " " * (cells - width(text)) + text


def filled(parts: Iterable[str], cells: int, gap: str = " ") -> list[str]:
    """Return parts as lines, each with as many as fit in `cells` cells, `gap` between them; no part is broken."""
    lines: list[str] = []
    for part in parts:
        if lines and width(f"{lines[-1]}{gap}{part}") <= cells:
            lines[-1] += gap + part
        else:
            lines.append(part)
    return lines


def file_size(size_bytes: int) -> str:
    """Return a size in decimal units with three digits, e.g. `12.3 MB`."""
    if size_bytes < 1000:
        return f"{size_bytes} B"
    size = float(size_bytes)
    for prefix in "kMGT":
        size /= 1000.0
        if size < 999.5 or prefix == "T":
            break
    decimals = 2 if size < 9.995 else 1 if size < 99.95 else 0
    return f"{size:.{decimals}f} {prefix}B"
