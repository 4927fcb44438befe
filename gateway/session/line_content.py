"""What bytes that hold no frame may be, in plain words."""

from __future__ import annotations

import re
from typing import Final

from firmware_protocol import wire

_TEXT_BYTES: Final = frozenset((*range(0x20, 0x7F), 0x09, 0x0A, 0x0D))
_TEXT_SHARE: Final = 0.95
_NMEA: Final = re.compile(rb"\$[A-Z]{2}[A-Z0-9]{3},")
_UBLOX_SYNC: Final = b"\xb5\x62"
# Two given bytes follow each other by chance once in 65,536 places.
_BY_CHANCE: Final = 1 / 65536
_SHOWN: Final = 40
_HEADER: Final = re.compile(re.escape(wire.SYNC) + b"(.)", re.DOTALL)


def describe_content(link: str, sample: bytes) -> str:
    """Say what `sample`, bytes of a link in which nothing decodes, looks like, and what to do.

    Args:
        link: name of the link; its scheme decides which remedies make sense.
        sample: a few hundred bytes or more.
    """
    if len(set(sample)) <= 1:
        value = sample[0] if sample else 0
        return (
            f"every byte is {value:#04x}: the line is held at one level. "
            "Is the hub powered, and are its data wire and ground connected?"
        )
    if sum(byte in _TEXT_BYTES for byte in sample) >= _TEXT_SHARE * len(sample):
        if _NMEA.search(sample):
            return f"a GPS receiver speaks here (NMEA text), not a hub. {_other_place(link)}"
        return f"another device speaks here; it sends text: '{_first_line(sample)}'. {_other_place(link)}"
    if sample.count(_UBLOX_SYNC) > 2 + 5 * _BY_CHANCE * len(sample):
        return f"a u-blox receiver speaks here, not a hub. {_other_place(link)}"
    starts = sum(match[1][0] >> 4 == wire.VERSION_MAJOR for match in _HEADER.finditer(sample))
    if starts > 3 + 5 * _BY_CHANCE / 16 * len(sample):
        return (
            "frames begin but every one is damaged: a bad cable or ground, an overrun, or firmware whose CRC is wrong "
            "(`treadlink protocol` prints test vectors)."
        )
    if link.startswith("serial:"):
        return (
            "wrong baud rate, or another device on the port. "
            "Give the hub's rate, for example ?baudrate=115200; it is 921600 unless given."
        )
    return f"what speaks here is no hub. {_other_place(link)}"


def major_versions(data: bytes) -> set[int]:
    """Return the major versions of what looks like the start of a frame, this version's left out."""
    return {match[1][0] >> 4 for match in _HEADER.finditer(data)} - {wire.VERSION_MAJOR}


def _other_place(link: str) -> str:
    if link.startswith("serial:"):
        return "Choose the hub's port; `treadlink doctor` lists the ports."
    return "Check the address of the source."


def _first_line(sample: bytes) -> str:
    # What a stranger sends goes to a terminal: nothing but printable characters, and not many.
    lines = [line.strip() for line in sample.decode("ascii", "replace").splitlines()]
    line = next((line for line in lines[1:] if line), lines[0] if lines else "")
    shown = "".join(character for character in line if " " <= character <= "~")
    return shown if len(shown) <= _SHOWN else shown[:_SHOWN] + "..."
