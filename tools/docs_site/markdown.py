"""Tables, escapes and sentences in Markdown."""

import inspect
from collections.abc import Iterable, Sequence


def escaped(text: str) -> str:
    """Return text for a table cell: one line, no character that Markdown reads as markup outside of code."""
    parts = " ".join(text.split()).split("`")
    for index in range(0, len(parts), 2):
        for character in ("\\", "*", "_", "<", "|", "[", "^", "~"):
            parts[index] = parts[index].replace(character, "\\" + character)
    return "`".join(part.replace("|", "\\|") if index % 2 else part for index, part in enumerate(parts))


def code(text: str) -> str:
    """Return text as code for a table cell; nothing for an empty text."""
    return f"`{text.replace('|', chr(92) + '|')}`" if text else ""


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a table, with an empty line after it."""
    lines = [f"| {' | '.join(header)} |", f"|{'---|' * len(header)}"]
    lines += [f"| {' | '.join(row)} |" for row in rows]
    return [*lines, ""]


def sentence(text: str) -> str:
    """Return text with a capital letter and a full stop; code keeps its case."""
    text = text.strip()
    if not text:
        return ""
    first = text[0] if text.startswith("`") else text[0].upper()
    return first + text[1:] + ("" if text.endswith((".", "!", "?", ":")) else ".")


def docstring(documented: object) -> str:
    """Return a docstring without its indentation; empty when there is none."""
    return inspect.getdoc(documented) or ""
