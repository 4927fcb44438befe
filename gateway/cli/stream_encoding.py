"""Output streams that cannot encode every character, such as those of a console with code page 1252."""

import codecs
import sys
import unicodedata
from contextlib import suppress
from io import TextIOWrapper
from typing import Final

_HANDLER: Final = "treadlink-nearest"
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


def make_streams_encodable() -> None:
    """Let standard output and error write the nearest text for what their encoding does not have."""

    def replaced(error: UnicodeError) -> tuple[str, int]:
        if not isinstance(error, UnicodeEncodeError):
            raise error
        return nearest_text(error.object[error.start : error.end]), error.end

    codecs.register_error(_HANDLER, replaced)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper) and stream.errors in ("strict", "surrogateescape"):
            with suppress(ValueError, OSError):  # closed
                stream.reconfigure(errors=_HANDLER)
