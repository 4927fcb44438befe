"""Commands, options and keys of files that earlier versions had, with what replaces them."""

from collections.abc import Mapping
from typing import Final

_KEYS: Final = "Use --keys, as the other commands do."
_NEXT_STEPS: Final = "The report of every diagnosis has next steps, which name the recording that would decide."
REMOVED: Final[Mapping[str, str]] = {
    "treadlink manifest": "Write SHA256SUMS with `sha256sum *.mcap* > SHA256SUMS` in the folder of the recordings; "
    "`treadlink inspect --verify` reads it.",
    "--estimator water-wedge": "It has no successor: it showed none of the wet contacts of measured drives.",
    "[road] leading_shift_mm": "Remove it: only the estimator water-wedge, which was removed too, reacted to it.",
    "--model series": "Use `exact`, or `paper`, of which the corrections are effects that a diagnosis identifies.",
    "treadlink diagnose --plan": _NEXT_STEPS,
    "treadlink diagnose --want": _NEXT_STEPS,
    "treadlink diagnose --at": _NEXT_STEPS,
    "treadlink keys new --file": _KEYS,
    "treadlink keys import --file": _KEYS,
    "treadlink keys list --file": _KEYS,
    "treadlink keys remove --file": _KEYS,
    "treadlink simulate --ble": "Use --pty, or a hub: the reference collector runs on this computer with `make hub`.",
    "treadlink simulate --firmware": "The reference collector runs on this computer with `make hub`.",
    "treadlink protocol kaitai": "Use the Wireshark dissector (`treadlink protocol wireshark`), the C code (`header`, "
    "`encoder`) or the specification with its test vectors (`vectors`).",
}
"""Name as a user writes it -> remedy: `treadlink COMMAND [--option]`, `--option VALUE` or `[table] key`."""


def replacement(*words: str) -> str | None:
    """Return what replaces a removed name, None where no version had it."""
    return REMOVED.get(" ".join(words))
