"""Generated parts of the protocol specification: the tables and the worked example, from the declaration."""

import re
from collections.abc import Iterable, Iterator

from firmware_protocol import wire
from firmware_protocol.checks import MAX_F32
from firmware_protocol.conformance import EXAMPLE
from firmware_protocol.declaration import PAYLOADS
from firmware_protocol.layout import Field
from firmware_protocol.messages import MessageType
from firmware_protocol.reference_frames import frame_bytes

_BLOCK = re.compile(r"(?P<begin><!-- generated: (?P<name>\w+) -->)\n.*?(?P<end><!-- end -->)", re.DOTALL)


def updated(specification: str) -> str:
    """Return the text with every block between `<!-- generated: NAME -->` and `<!-- end -->` regenerated.

    Raises:
        KeyError: a block has a name that nothing generates.
    """
    blocks = {"frame": _frame, "payloads": _payloads, "example": _example}

    def regenerated(match: re.Match[str]) -> str:
        return "\n".join((match["begin"], *blocks[match["name"]](), match["end"]))

    return _BLOCK.sub(regenerated, specification)


def _frame() -> Iterator[str]:
    rows = [_row(field) for field in wire.HEADER.fields]
    rows.append((f"{wire.HEADER_BYTES}", "length", "", "payload", "see below"))
    rows.append((f"{wire.HEADER_BYTES} + length", f"{wire.CRC_BYTES}", "u32", "crc32", "over all bytes before it"))
    yield from _table(rows)


def _payloads() -> Iterator[str]:
    for type_, payload in PAYLOADS.items():
        declared = payload.fields
        fixed = payload.size
        more = "" if all(field.elements for field in declared) else " and more"
        yield f"**{type_:d} {type_.name}**: {payload.purpose}; {fixed} byte{'s' if fixed != 1 else ''}{more}."
        yield ""
        yield from _table(_row(field) for field in declared)
        yield ""


def _example() -> Iterator[str]:
    data = frame_bytes(EXAMPLE)
    yield "```text"
    yield from (
        f"{data[start:end].hex(' ').upper():<12} {text}"
        for start, end, text in (
            (0, 2, "sync"),
            (2, 4, f"version {wire.VERSION_MAJOR}.{wire.LAYOUT_MINOR}, type {MessageType(EXAMPLE.type).name}"),
            (4, 5, f"length {data[4]}"),
            (5, 7, f"hub {EXAMPLE.hub}, wheel {EXAMPLE.wheel}"),
            (7, 8, "flags"),
            (8, 12, f"seq {EXAMPLE.seq}"),
            (12, 16, f"tick_us {EXAMPLE.tick_us}"),
            (16, 20, f"first_sample {EXAMPLE.payload['first_sample']}"),
            (20, 22, f"axes {EXAMPLE.payload['axes']} (radial only), n {EXAMPLE.payload['n']}"),
            (22, 26, f"counts {', '.join(map(str, EXAMPLE.payload['counts']))}"),
            (26, 30, f"crc32 {int.from_bytes(data[26:30], 'little'):08X}"),
        )
    )
    yield "```"


def _row(field: Field) -> tuple[str, str, str, str, str]:
    size = "rest" if field.elements is None else str(field.size * field.elements)
    kind = {"float": "f32", "char": "bytes"}.get(
        field.c_type, field.c_type.replace("uint", "u").replace("int", "i")[:-2]
    )
    many = "" if field.elements == 1 or field.c_type == "char" else f"[{field.elements or ''}]"
    none = "" if field.none is None else f"{field.none}: not available"
    meaning = "; ".join(text for text in (field.docs, _limits(field.low, field.high), none) if text)
    return str(field.offset), size, kind + many, field.name, meaning


def _limits(low: float | None, high: float | None) -> str:
    if low is None or high is None or low <= -MAX_F32:
        return ""
    return f"{low:g} or more" if high >= MAX_F32 else f"{low:g} to {high:g}"


def _table(rows: Iterable[tuple[str, ...]]) -> Iterator[str]:
    yield "| offset | bytes | type | field | meaning |"
    yield "|---|---|---|---|---|"
    yield from (f"| {' | '.join(row)} |" for row in rows)
