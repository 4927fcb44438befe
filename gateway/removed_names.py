"""Commands, options and keys of files that earlier versions had, with what replaces them."""

from collections.abc import Mapping
from typing import Final

REMOVED: Final[Mapping[str, str]] = {
    "treadlink manifest": "Write SHA256SUMS with `sha256sum *.mcap* > SHA256SUMS` in the folder of the recordings; "
    "`treadlink inspect --verify` reads it.",
    "treadlink protocol kaitai": "Use the Wireshark dissector (`treadlink protocol wireshark`), the C code (`header`, "
    "`encoder`) or the specification with its test vectors (`vectors`).",
}
"""Name as a user writes it -> remedy: `treadlink COMMAND`, `treadlink COMMAND --option`, `treadlink COMMAND --option
VALUE`, or the dotted key of a file."""


def replacement(*words: str) -> str | None:
    """Return what replaces a removed name, None where no version had it."""
    return REMOVED.get(" ".join(words))
