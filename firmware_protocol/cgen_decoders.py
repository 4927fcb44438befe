"""Writes the C functions with which firmware reads the gateway's commands; part of `cgen.py`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from firmware_protocol.cgen_values import limits
from firmware_protocol.declaration import PAYLOADS
from firmware_protocol.field_table import Field, fields
from firmware_protocol.messages import COMMANDS, MessageType

_GET: Final = {"uint8_t": "at[{}]", "uint64_t": "get_u64(at + {})", "float": "get_f32(at + {})"}


def decoder_declarations() -> Iterator[str]:
    """Yield the header's part."""
    yield "/* Each reads a command from an intact frame (tl_check). Returns 1, or 0 where the frame is no such command"
    yield "   of this version or holds a value out of its range; then the message is not to be used. */"
    yield from (f"{_prototype(type_)};" for type_ in COMMANDS)
    yield ""


def decoder_definitions() -> Iterator[str]:
    """Yield the source's part."""
    yield _SUPPORT
    for type_ in COMMANDS:
        declared = list(fields(PAYLOADS[type_]))
        size = sum(field.size for field in declared)
        yield f"{_prototype(type_)} {{"
        yield f"    const uint8_t *at = payload(frame, TL_TYPE_{type_.name}, {size}u);"
        yield "    if (at == NULL) {"
        yield "        return 0;"
        yield "    }"
        yield from (f"    message->{field.name} = {_GET[field.c_type].format(field.offset)};" for field in declared)
        yield f"    return {_in_range(declared)};"
        yield "}"
        yield ""


def _prototype(type_: MessageType) -> str:
    name = type_.name.lower()
    return f"int tl_decode_{name}(const uint8_t *frame, tl_{name} *message)"


def _in_range(declared: list[Field]) -> str:
    return " && ".join(check for field in declared for check in limits(field)) or "1"


_SUPPORT: Final = """\
static const uint8_t *payload(const uint8_t *frame, uint8_t type, uint8_t size) {
    int known = frame[2] == TL_VERSION_BYTE && frame[3] == type && frame[4] == size && frame[7] == 0;
    return known ? frame + TL_HEADER_BYTES : NULL;
}

static uint32_t get_u32(const uint8_t *at) {
    return (uint32_t)at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16 | (uint32_t)at[3] << 24;
}

static uint64_t get_u64(const uint8_t *at) {
    return (uint64_t)get_u32(at) | (uint64_t)get_u32(at + 4) << 32;
}

static float get_f32(const uint8_t *at) {
    uint32_t bits = get_u32(at);
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}
"""
