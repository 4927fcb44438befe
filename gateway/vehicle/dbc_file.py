"""Text of DBC files: its encoding, and the part of it that describes some messages."""

import re
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Final

from gateway.core.bounded_input import MAX_DBC_BYTES, read_bounded

_MESSAGE: Final = re.compile(r"\s*BO_\s+(\d+)\s+(\w+)\s*:")
# Statements about signals that change how they are decoded; the second word is the number of the message.
_OF_MESSAGE: Final = re.compile(r"\s*(?:VAL_|SIG_VALTYPE_|SG_MUL_VAL_)\s+(\d+)\s")
_LONG_NAME: Final = re.compile(r'\s*BA_\s+"System(?:Message|Signal)LongSymbol"\s+(?:BO_|SG_)\s+(\d+)\s[^"]*"([^"]*)"')
_LONG_NAME_TYPE: Final = re.compile(r'\s*BA_DEF_(?:DEF_)?\s+(?:(?:BO_|SG_)\s+)?"System(?:Message|Signal)LongSymbol"')


def read_dbc(path: Path) -> str | None:
    """Return the text of a DBC file with lines that end in a line feed, None where it is too large for one.

    Raises:
        OSError: it cannot be read.
    """
    data = read_bounded(path, MAX_DBC_BYTES)
    return None if len(data) > MAX_DBC_BYTES else decoded_dbc(data).replace("\r\n", "\n")


def decoded_dbc(data: bytes) -> str:
    """Return the text of a DBC file, which states no encoding: UTF-8 where it is that, else that of Windows tools."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


def message_names(text: str) -> list[str]:
    """Return the names of the messages of a DBC file, however much else of it is wrong."""
    return [match[2] for line in text.splitlines() if (match := _MESSAGE.match(line))]


def only_messages(text: str, names: Collection[str]) -> str:
    """Return a DBC file of the named messages alone, without comments and attributes.

    Args:
        text: the file.
        names: those of messages, also long ones in attributes.
    """
    lines = text.splitlines()
    numbers = {match[1] for line in lines if (match := _MESSAGE.match(line)) and match[2] in names}
    numbers |= {match[1] for line in lines if (match := _LONG_NAME.match(line)) and match[2] in names}
    return "\n".join(('VERSION ""', "NS_ :", "BS_:", "BU_:", *_kept_lines(lines, numbers))) + "\n"


def _kept_lines(lines: list[str], numbers: Collection[str]) -> Iterator[str]:
    in_message = in_statement = False
    for line in lines:
        message, statement = _MESSAGE.match(line), _OF_MESSAGE.match(line) or _LONG_NAME.match(line)
        if message is not None:
            in_message, in_statement = message[1] in numbers, False
        elif statement is not None or _LONG_NAME_TYPE.match(line):
            in_message, in_statement = False, statement is None or statement[1] in numbers
        elif not in_statement:
            in_message = in_message and (line.lstrip().startswith("SG_ ") or not line.strip())
        if in_message or in_statement:
            yield line
        if in_statement and line.rstrip().endswith(";"):
            in_statement = False
