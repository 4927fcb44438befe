"""Standard streams: what their encoding lacks, as that of code page 1252, and what would control the terminal."""

import codecs
import re
import sys
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import TextIOWrapper
from typing import Final, TextIO

from gateway.core.text.text import escaped

_HANDLER: Final = "treadlink-nearest"
_OWN_CONTROLS: Final = re.compile(r"(\x1b\[[0-9;?]*[A-Za-z]|[\n\r\t])")
# What the views write, in ASCII; other characters lose their accents or become a question mark.
_ASCII: Final = {
    "±": "+-", "²": "^2", "³": "^3", "°": " deg", "µ": "u", "μ": "u", "·": "*", "×": "x", "–": "-", "—": "-", "−": "-",
    "…": "...", "→": "->", "▶": ">", "█": "#", "▓": "#", "▒": "+", "░": ".", "│": "|", "─": "-", "║": "|", "═": "=",
    "•": "*", "✓": "ok", "✗": "x",
}  # fmt: skip


def nearest_text(text: str) -> str:
    """Return a text in ASCII that says the same as far as ASCII can."""
    plain = "".join(_ASCII.get(character, character) for character in text)
    decomposed = unicodedata.normalize("NFKD", plain)
    return "".join(c if c.isascii() else "?" for c in decomposed if not unicodedata.combining(c))


class ShownText(TextIOWrapper):
    """Text stream that replaces what it cannot encode by similar text, and escapes what would control the terminal.

    Every message may hold names and texts from outside. What is not printable is written as an escape such as
    `\\u202e`, except line ends, tabs, and the colour and cursor sequences of the program's own lines.
    """

    def write(self, text: str) -> int:
        """Write a text."""
        super().write(shown(text))
        return len(text)


def shown(text: str) -> str:
    """Return a text as a terminal may get it."""
    if text.replace("\n", "").isprintable():
        return text
    return "".join(part if index % 2 else escaped(part) for index, part in enumerate(_OWN_CONTROLS.split(text)))


@contextmanager
def shown_streams() -> Iterator[None]:
    """Make standard output and error `ShownText`; bytes written to their buffers, which are data, stay as they are."""

    def replaced(error: UnicodeError) -> tuple[str, int]:
        if not isinstance(error, UnicodeEncodeError):
            raise error
        return nearest_text(error.object[error.start : error.end]), error.end

    codecs.register_error(_HANDLER, replaced)
    original_streams = sys.stdout, sys.stderr
    try:
        sys.stdout, sys.stderr = map(_shown_stream, original_streams)
        yield
    finally:
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, ShownText):
                with suppress(OSError, ValueError):  # the output is closed
                    stream.detach()  # else it closes the buffer, which is not its own
        sys.stdout, sys.stderr = original_streams


def _shown_stream(stream: TextIO) -> TextIO:
    if not isinstance(stream, TextIOWrapper) or stream.closed:
        return stream
    is_strict = stream.errors in ("strict", "surrogateescape")
    return ShownText(
        stream.buffer,
        stream.encoding,
        _HANDLER if is_strict else stream.errors,
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )
