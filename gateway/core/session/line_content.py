"""Identification of a line's content when no frame is in it."""

import re
from typing import Final

from firmware_protocol import wire
from gateway.core.links.source import DEFAULT_BAUDRATE
from gateway.core.reasons import Reason
from gateway.core.session.reasons import SessionCode

_TEXT_BYTES: Final = frozenset((*range(0x20, 0x7F), 0x09, 0x0A, 0x0D))
_TEXT_SHARE: Final = 0.95
_NMEA: Final = re.compile(rb"\$[A-Z]{2}[A-Z0-9]{3},")
_UBLOX_SYNC: Final = b"\xb5\x62"
# Two given bytes follow each other by chance in one of 65,536 places.
_CHANCE_OF_TWO_BYTES: Final = 1 / 65536
_QUOTED_CHARACTERS: Final = 40
_HEADER: Final = re.compile(re.escape(wire.SYNC) + b"(.)", re.DOTALL)
_SWAPPED_HEADER: Final = re.compile(re.escape(wire.SYNC[::-1]) + b"(.)", re.DOTALL)
_SERIAL_SCHEME: Final = "serial:"


def identify_content(link: str, sample: bytes) -> Reason:
    """Return what the bytes of a link look like, with the remedy.

    Args:
        link: name of the link; its scheme decides which remedies apply.
        sample: a few hundred bytes or more in which no frame decodes.
    """
    if len(set(sample)) <= 1:
        return Reason(SessionCode.LINE_CONSTANT, byte=f"{sample[0] if sample else 0:#04x}")
    is_serial = link.startswith(_SERIAL_SCHEME)
    remedy = Reason(SessionCode.CHOOSE_HUB_PORT if is_serial else SessionCode.CHECK_SOURCE_ADDRESS)
    if sum(byte in _TEXT_BYTES for byte in sample) >= _TEXT_SHARE * len(sample):
        if _NMEA.search(sample):
            return Reason(SessionCode.LINE_NOT_A_HUB, device="gps", remedy=remedy)
        return Reason(SessionCode.LINE_TEXT, line=_first_line(sample), remedy=remedy)
    if sample.count(_UBLOX_SYNC) > 2 + 5 * _CHANCE_OF_TWO_BYTES * len(sample):
        return Reason(SessionCode.LINE_NOT_A_HUB, device="u-blox", remedy=remedy)
    if swapped_syncs(sample) > 3 + 5 * _CHANCE_OF_TWO_BYTES / 16 * len(sample):
        return Reason(SessionCode.LINE_SYNC_SWAPPED)
    starts = sum(match[1][0] >> 4 == wire.VERSION_MAJOR for match in _HEADER.finditer(sample))
    if starts > 3 + 5 * _CHANCE_OF_TWO_BYTES / 16 * len(sample):
        return Reason(SessionCode.LINE_ALL_FRAMES_DAMAGED)
    if is_serial:
        return Reason(SessionCode.LINE_WRONG_BAUD_RATE, default_baud=DEFAULT_BAUDRATE)
    return Reason(SessionCode.LINE_NOT_A_HUB, device="unknown", remedy=remedy)


def swapped_syncs(data: bytes) -> int:
    """Return how many headers of this major version begin with the sync's bytes in the wrong order."""
    return sum(match[1][0] >> 4 == wire.VERSION_MAJOR for match in _SWAPPED_HEADER.finditer(data))


def other_major_versions(data: bytes) -> set[int]:
    """Return the major versions, other than this one's, of what looks like the start of a frame."""
    return {match[1][0] >> 4 for match in _HEADER.finditer(data)} - {wire.VERSION_MAJOR}


def _first_line(sample: bytes) -> str:
    # An unknown device must not reach the terminal with more than a few printable characters.
    lines = [line.strip() for line in sample.decode("ascii", "replace").splitlines()]
    line = next((line for line in lines[1:] if line), lines[0] if lines else "")
    printable = "".join(character for character in line if " " <= character <= "~")
    return printable if len(printable) <= _QUOTED_CHARACTERS else printable[:_QUOTED_CHARACTERS] + "..."
