"""Parts of the URIs that name sources and live outputs, `scheme:target?key=value`."""

from contextlib import suppress
from pathlib import Path
from typing import NamedTuple
from urllib.parse import parse_qsl, unquote, urlsplit


class UriParts(NamedTuple):
    """Parts of a URI.

    Attributes:
        scheme: before the first colon, in lower case; empty without one.
        authority: host, port and user name after `//`, as written.
        target: everything up to the options, percent signs resolved; leading slashes of `scheme://` left out.
        options: by name.
    """

    scheme: str
    authority: str
    target: str
    options: dict[str, str]


def split_uri(uri: str) -> UriParts:
    """Split a URI; `scheme://target` and `scheme:target` mean the same.

    `#` and `+` are characters like others, as in names of files: no source has fragments. `?` and `%` begin something
    else, and are written as `%3F` and `%25`; a `%` that begins no pair of hexadecimal digits stands for itself.

    Raises:
        ValueError: it cannot be split.
    """
    parts = urlsplit(uri.replace("#", "%23"))
    options = parse_qsl(parts.query.replace("+", "%2B"), keep_blank_values=True)
    return UriParts(parts.scheme.lower(), parts.netloc, _target(parts.netloc + parts.path), dict(options))


def _target(text: str) -> str:
    """Return a target without its escapes; a file that has them in its name is meant as it is written."""
    plain, written = unquote(text, errors="surrogateescape"), text.replace("%23", "#")
    # pathlib would raise on names that no file can have.
    with suppress(OSError, ValueError):
        if plain != written and Path(written).exists() and not Path(plain).exists():
            return written
    return plain
