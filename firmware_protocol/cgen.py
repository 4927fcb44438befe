"""Generator of the firmware's C11 header and reference encoder, from the declaration."""

from collections.abc import Iterator
from typing import Final

from firmware_protocol import wire
from firmware_protocol.checks import MAX_F32
from firmware_protocol.declaration import PAYLOADS, SAMPLES
from firmware_protocol.layout import Field
from firmware_protocol.messages import COMMANDS, EVERY_HUB, HUB_ITSELF, Axis, Coupling, LogLevel, MessageType, Outcome
from firmware_protocol.reference_cmac import s_box

_OFFSETS: Final = {field.name: field.offset for field in wire.HEADER.fields} | {
    "length_known": wire.LENGTH_KNOWN_BYTES,
}
_TOP: Final = {"uint8_t": 0xFF, "uint16_t": 0xFFFF, "uint32_t": 0xFFFF_FFFF}


def limits(field: Field) -> Iterator[str]:
    """Yield the conditions on a field that its C type does not hold already."""
    for index in range(field.elements or 0):
        value = f"message->{field.name}" + ("" if field.elements == 1 else f"[{index}]")
        checks = []
        if field.low is not None and not (field.low == 0 and field.c_type in _TOP):
            checks.append(f"{value} >= {literal(field.low, field)}")
        if field.high is not None and field.high != _TOP.get(field.c_type):
            checks.append(f"{value} <= {literal(field.high, field)}")
        if checks:
            inside = " && ".join(checks)
            none = "" if field.none is None else f" || {value} == {literal(field.none, field)}"
            yield f"({inside}{none})" if none else inside


def literal(value: float, field: Field) -> str:
    """Return a value in the C type of a field."""
    if field.c_type == "float":
        return {MAX_F32: "TL_F32_MAX", -MAX_F32: "-TL_F32_MAX"}.get(value, f"{value:.1f}f")
    if field.c_type.startswith("u"):
        return f"{value:d}u" if isinstance(value, int) else f"{int(value)}u"
    # The least value of a type has no literal of its own in C.
    return f"({int(value) + 1} - 1)"


_GET: Final = {"uint8_t": "at[{}]", "uint64_t": "get_u64(at + {})", "float": "get_f32(at + {})"}


def decoder_declarations() -> Iterator[str]:
    """Yield the declarations of the command decoders."""
    yield "/* Each reads a command from an intact frame (tl_check). Returns 1, or 0 when the frame is no such command"
    yield "   of this version or holds a value out of range; do not use the message then. */"
    yield from (f"{_decoder_prototype(type_)};" for type_ in COMMANDS)
    yield ""


def decoder_definitions() -> Iterator[str]:
    """Yield the definitions of the command decoders."""
    yield _DECODER_SUPPORT.format(**_OFFSETS)
    for type_ in COMMANDS:
        declared, size = PAYLOADS[type_].fields, PAYLOADS[type_].size
        yield f"{_decoder_prototype(type_)} {{"
        yield f"    const uint8_t *at = payload(frame, TL_TYPE_{type_.name}, {size}u);"
        yield "    if (at == NULL) {"
        yield "        return 0;"
        yield "    }"
        yield from (f"    message->{field.name} = {_GET[field.c_type].format(field.offset)};" for field in declared)
        yield f"    return {_in_range(declared)};"
        yield "}"
        yield ""


def _decoder_prototype(type_: MessageType) -> str:
    name = type_.name.lower()
    return f"int tl_decode_{name}(const uint8_t *frame, tl_{name} *message)"


def _in_range(declared: tuple[Field, ...]) -> str:
    return " && ".join(check for field in declared for check in limits(field)) or "1"


_DECODER_SUPPORT: Final = """\
static const uint8_t *payload(const uint8_t *frame, uint8_t type, uint8_t size) {{
    int known = frame[{version}] == TL_VERSION_BYTE && frame[{type}] == type && frame[{length}] == size &&
                frame[{flags}] == 0;
    return known ? frame + TL_HEADER_BYTES : NULL;
}}

static uint32_t get_u32(const uint8_t *at) {{
    return (uint32_t)at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16 | (uint32_t)at[3] << 24;
}}

static uint64_t get_u64(const uint8_t *at) {{
    return (uint64_t)get_u32(at) | (uint64_t)get_u32(at + 4) << 32;
}}

static float get_f32(const uint8_t *at) {{
    uint32_t bits = get_u32(at);
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}}
"""


SIGNING_DECLARATION: Final = """\
/* Signer for one sensor, or for the hub itself. Make one from each key after every start. It holds the key: keep it
   private. Where the chip has AES hardware, define TL_AES_HARDWARE and write tl_port_aes128. */
typedef struct {
    uint8_t round_keys[176];
    uint8_t whole[16];
    uint8_t part[16];
    uint64_t identity;
    uint32_t boot_count;
} tl_signer;

/* `identity` is sensor_id of HELLO, or hub_id for frames of wheel TL_WHEEL_HUB_ITSELF; `boot_count` that of HELLO. It
   must never repeat under the same key: increment it at every start, and when seq would wrap. */
void tl_signer_init(tl_signer *signer, const uint8_t key[16], uint64_t identity, uint32_t boot_count);

/* Signs a frame that an encoder has just written to a buffer of TL_MAX_FRAME_BYTES, and returns its new size. Returns 0
   and changes nothing when the frame is signed already or its payload is above TL_MAX_SIGNED_PAYLOAD_BYTES. */
size_t tl_sign(uint8_t *frame, const tl_signer *signer);

/* Verifies an intact signed frame, in a time that does not depend on its tag. Returns 1 when the tag is right, and
   takes it off, so that the command decoders accept the frame; its CRC is then no longer right. Returns 0 otherwise. */
int tl_verify(uint8_t *frame, const tl_signer *signer);

#ifdef TL_AES_HARDWARE
/* Encrypts one block in place with AES-128. You write it. */
void tl_port_aes128(const uint8_t key[16], uint8_t block[16]);
#endif

/* AES-128-CMAC (RFC 4493) of `size` bytes. */
void tl_cmac(const tl_signer *signer, const uint8_t *data, size_t size, uint8_t mac[16]);
"""

_SIGNING_CODE: Final = """\
#ifdef TL_AES_HARDWARE
static void aes_expand(uint8_t round_keys[176], const uint8_t key[16]) {{
    memcpy(round_keys, key, 16);
}}

static void aes_encrypt(const uint8_t round_keys[176], uint8_t block[16]) {{
    tl_port_aes128(round_keys, block);
}}
#else
static uint8_t times_x(uint8_t value) {{
    return (uint8_t)((value << 1) ^ ((value >> 7) * 0x1B));
}}

static const uint8_t s_box[256] = {{
{s_box}}};

static void aes_expand(uint8_t round_keys[176], const uint8_t key[16]) {{
    uint8_t constant = 1;
    memcpy(round_keys, key, 16);
    for (size_t i = 16; i < 176; i += 4) {{
        uint8_t word[4];
        memcpy(word, round_keys + i - 4, 4);
        if (i % 16 == 0) {{
            uint8_t first = word[0];
            word[0] = s_box[word[1]] ^ constant;
            word[1] = s_box[word[2]];
            word[2] = s_box[word[3]];
            word[3] = s_box[first];
            constant = times_x(constant);
        }}
        for (size_t k = 0; k < 4; k++) {{
            round_keys[i + k] = round_keys[i + k - 16] ^ word[k];
        }}
    }}
}}

static uint32_t rotated(uint32_t word, unsigned bits) {{
    return word >> bits | word << (32u - bits);
}}

/* Four bytes times x at once. */
static uint32_t word_times_x(uint32_t word) {{
    return ((word & 0x7F7F7F7Fu) << 1) ^ (((word >> 7) & 0x01010101u) * 0x1Bu);
}}

static void aes_encrypt(const uint8_t round_keys[176], uint8_t block[16]) {{
    uint32_t state[4];
    for (size_t c = 0; c < 4; c++) {{
        state[c] = get_u32(block + 4 * c) ^ get_u32(round_keys + 4 * c);
    }}
    for (size_t round = 1; round <= 10; round++) {{
        uint32_t next[4];
        for (size_t c = 0; c < 4; c++) {{
            uint32_t word = (uint32_t)s_box[state[c] & 0xFFu] |
                            (uint32_t)s_box[state[(c + 1) % 4] >> 8 & 0xFFu] << 8 |
                            (uint32_t)s_box[state[(c + 2) % 4] >> 16 & 0xFFu] << 16 |
                            (uint32_t)s_box[state[(c + 3) % 4] >> 24] << 24;
            if (round < 10) {{
                uint32_t below = rotated(word, 8);
                word = word_times_x(word ^ below) ^ below ^ rotated(word, 16) ^ rotated(word, 24);
            }}
            next[c] = word ^ get_u32(round_keys + 16 * round + 4 * c);
        }}
        memcpy(state, next, sizeof state);
    }}
    for (size_t c = 0; c < 4; c++) {{
        (void)put_u32(block + 4 * c, state[c]);
    }}
}}
#endif

static void doubled(uint8_t out[16], const uint8_t in[16]) {{
    for (size_t k = 0; k < 15; k++) {{
        out[k] = (uint8_t)((in[k] << 1) | (in[k + 1] >> 7));
    }}
    out[15] = (uint8_t)((in[15] << 1) ^ ((in[0] >> 7) * 0x87));
}}

/* CMAC over a head of fewer than 16 bytes and the bytes after it. */
static void cmac(const tl_signer *signer, const uint8_t *head, size_t head_size, const uint8_t *data, size_t size,
                 uint8_t mac[16]) {{
    size_t total = head_size + size;
    size_t held = 0;
    memset(mac, 0, 16);
    for (size_t i = 0; i < total; i++) {{
        if (held == 16) {{
            aes_encrypt(signer->round_keys, mac);
            held = 0;
        }}
        mac[held++] ^= i < head_size ? head[i] : data[i - head_size];
    }}
    if (held < 16) {{
        mac[held] ^= 0x80;
    }}
    for (size_t k = 0; k < 16; k++) {{
        mac[k] ^= held == 16 ? signer->whole[k] : signer->part[k];
    }}
    aes_encrypt(signer->round_keys, mac);
}}

void tl_signer_init(tl_signer *signer, const uint8_t key[16], uint64_t identity, uint32_t boot_count) {{
    uint8_t zero[16] = {{0}};
    aes_expand(signer->round_keys, key);
    aes_encrypt(signer->round_keys, zero);
    doubled(signer->whole, zero);
    doubled(signer->part, signer->whole);
    signer->identity = identity;
    signer->boot_count = boot_count;
}}

void tl_cmac(const tl_signer *signer, const uint8_t *data, size_t size, uint8_t mac[16]) {{
    cmac(signer, data, 0, data, size, mac);
}}

static void frame_mac(const tl_signer *signer, const uint8_t *frame, size_t size, uint8_t mac[16]) {{
    uint8_t head[12];
    (void)put_u32(put_u64(head, signer->identity), signer->boot_count);
    cmac(signer, head, sizeof head, frame, size, mac);
}}

int tl_verify(uint8_t *frame, const tl_signer *signer) {{
    if (frame[{flags}] != TL_FLAG_SIGNED || frame[{length}] < TL_TAG_BYTES) {{
        return 0;
    }}
    uint8_t mac[16];
    uint8_t different = 0;
    size_t size = TL_HEADER_BYTES + (size_t)frame[{length}] - TL_TAG_BYTES;
    frame_mac(signer, frame, size, mac);
    for (size_t k = 0; k < TL_TAG_BYTES; k++) {{
        different |= mac[k] ^ frame[size + k];
    }}
    if (different != 0) {{
        return 0;
    }}
    frame[{length}] = (uint8_t)(frame[{length}] - TL_TAG_BYTES);
    frame[{flags}] = 0;
    return 1;
}}

size_t tl_sign(uint8_t *frame, const tl_signer *signer) {{
    if ((frame[{flags}] & TL_FLAG_SIGNED) != 0 || frame[{length}] > TL_MAX_SIGNED_PAYLOAD_BYTES) {{
        return 0;
    }}
    uint8_t mac[16];
    size_t size = TL_HEADER_BYTES + (size_t)frame[{length}];
    frame[{length}] = (uint8_t)(frame[{length}] + TL_TAG_BYTES);
    frame[{flags}] |= TL_FLAG_SIGNED;
    frame_mac(signer, frame, size, mac);
    memcpy(frame + size, mac, TL_TAG_BYTES);
    size += TL_TAG_BYTES;
    (void)put_u32(frame + size, crc32(frame, size));
    return size + TL_CRC_BYTES;
}}
"""


def signing_definitions() -> str:
    """Return the source's part."""
    box = s_box()
    rows = [", ".join(f"0x{value:02X}" for value in box[first : first + 16]) for first in range(0, 256, 16)]
    return _SIGNING_CODE.format(**_OFFSETS, s_box="".join(f"    {row},\n" for row in rows))


HEADER_NAME: Final = "treadlink_protocol.h"
ENCODER_NAME: Final = "treadlink_protocol.c"

_NOTICE: Final = (
    f"/* Treadlink wire protocol {wire.VERSION_MAJOR}.{wire.VERSION_MINOR}. "
    "Generated by `treadlink protocol`; change the declaration, not this file. */"
)
_PUT: Final = {1: "put_u8", 2: "put_u16", 4: "put_u32", 8: "put_u64"}


def c_header() -> str:
    """Return the header: constants, message structs and the encoder's functions."""
    return "\n".join(
        [
            _NOTICE,
            "#ifndef TREADLINK_PROTOCOL_H",
            "#define TREADLINK_PROTOCOL_H",
            "",
            "#include <stddef.h>",
            "#include <stdint.h>",
            "",
            "#ifdef __cplusplus",
            'extern "C" {',
            "#endif",
            "",
            *_constants(),
            "",
            "/* Source of frames. Set seq to 0 when the hub starts; the encoder increments it. */",
            "typedef struct {",
            "    uint8_t hub;",
            "    uint8_t wheel;",
            "    uint32_t seq;",
            "} tl_source;",
            "",
            *(line for type_ in PAYLOADS for line in _struct(type_)),
            "/* Each writes one frame of at most TL_MAX_FRAME_BYTES to `frame` and returns its size. With a",
            "   value out of range it returns 0, writes nothing and leaves the counter unchanged. */",
            *(f"{_prototype(type_)};" for type_ in PAYLOADS),
            "",
            _CHECK_DECLARATION,
            *decoder_declarations(),
            SIGNING_DECLARATION,
            "#ifdef __cplusplus",
            "}",
            "#endif",
            "",
            "#endif",
            "",
        ]
    )


def c_encoder() -> str:
    """Return the reference encoder: no allocation, no library beyond memcpy."""
    rows = [", ".join(f"0x{_crc_nibble(first + i):08X}u" for i in range(4)) for first in range(0, 16, 4)]
    table = ",\n".join(f"    {row}" for row in rows)
    support = _ENCODER_SUPPORT.format(**_OFFSETS, table=table, begin="\n".join(_begin()))
    encoders = "\n".join("\n".join(_encoder(type_)) for type_ in PAYLOADS)
    decoders = "\n".join(decoder_definitions())
    includes = f'#include "{HEADER_NAME}"\n\n#include <string.h>\n'
    return "\n".join(
        [
            _NOTICE,
            includes,
            support,
            encoders,
            decoders,
            signing_definitions(),
        ]
    )


def _constants() -> Iterator[str]:
    for name, value in (
        ("VERSION_MAJOR", wire.VERSION_MAJOR),
        ("VERSION_MINOR", wire.VERSION_MINOR),
        ("VERSION_BYTE", wire.VERSION_BYTE),
        ("SYNC_0", wire.SYNC[0]),
        ("SYNC_1", wire.SYNC[1]),
        ("HEADER_BYTES", wire.HEADER_BYTES),
        ("CRC_BYTES", wire.CRC_BYTES),
        ("MAX_PAYLOAD_BYTES", wire.MAX_PAYLOAD_BYTES),
        ("MAX_FRAME_BYTES", wire.MAX_FRAME_BYTES),
        ("MAX_SAMPLES", wire.MAX_SAMPLES),
        ("FLAG_SIGNED", wire.SIGNED_FLAG),
        ("TAG_BYTES", wire.TAG_BYTES),
        ("MAX_SIGNED_PAYLOAD_BYTES", wire.MAX_SIGNED_PAYLOAD_BYTES),
        ("WHEEL_HUB_ITSELF", HUB_ITSELF),
        ("EVERY_HUB", EVERY_HUB),
    ):
        yield f"#define TL_{name} {value}u"
    for prefix, members in (
        ("TYPE", MessageType),
        ("AXIS_BIT", Axis),
        ("COUPLING", Coupling),
        ("LOG", LogLevel),
        ("OUTCOME", Outcome),
    ):
        yield from (f"#define TL_{prefix}_{member.name} {member.value}u" for member in members)
    for type_, payload in PAYLOADS.items():
        for field in payload.fields:
            if field.none is not None:
                yield f"#define TL_{type_.name}_{field.name.upper()}_NONE {literal(field.none, field)}"


def _struct(type_: MessageType) -> Iterator[str]:
    yield f"/* {PAYLOADS[type_].purpose.capitalize()}. */"
    yield "typedef struct {"
    for field in PAYLOADS[type_].fields:
        comment = f" /* {field.docs} */" if field.docs else ""
        if field.elements is None:
            yield f"    const {field.c_type} *{field.name};{comment}"
            if field.c_type == "char":
                yield f"    size_t {field.name}_size; /* bytes of {field.name} */"
        else:
            yield f"    {field.c_type} {field.name}{'' if field.elements == 1 else f'[{field.elements}]'};{comment}"
    yield f"}} tl_{type_.name.lower()};"
    yield ""


def _prototype(type_: MessageType) -> str:
    name = type_.name.lower()
    return f"size_t tl_encode_{name}(uint8_t *frame, tl_source *source, uint32_t tick_us, const tl_{name} *message)"


def _encoder(type_: MessageType) -> Iterator[str]:
    declared = PAYLOADS[type_].fields
    conditions = [check for field in declared for check in limits(field)]
    if type_ is MessageType.HELLO:
        conditions += [
            f"((message->axes & (1u << {axis:d})) == 0u || message->scale_mps2[{axis:d}] < 0.0f || "
            f"message->scale_mps2[{axis:d}] > 0.0f)"
            for axis in Axis
        ]
        conditions.append(f"(message->coupling != {Coupling.DC:d}u || message->highpass_hz <= 0.0f)")
    if type_ is MessageType.SAMPLES:
        yield from ("static size_t channels(uint8_t axes) {", _CHANNELS, "}", "")
        conditions.append(f"{SAMPLES.size}u + 2u * message->n * channels(message->axes) <= TL_MAX_PAYLOAD_BYTES")
    elif any(field.c_type == "char" for field in declared):
        conditions += [
            f"message->{field.name}_size <= TL_MAX_PAYLOAD_BYTES - {field.offset}u"
            for field in declared
            if field.c_type == "char"
        ]
    yield f"{_prototype(type_)} {{"
    if conditions:
        yield "    if (!(" + " &&\n          ".join(conditions) + ")) {"
        yield "        return 0;"
        yield "    }"
    yield f"    uint8_t *at = begin(frame, source, TL_TYPE_{type_.name}, tick_us);"
    for field in declared:
        yield from _write(field)
    yield "    return finish(frame, source, at);"
    yield "}"
    yield ""


def _write(field: Field) -> Iterator[str]:
    value = f"message->{field.name}"
    if field.c_type == "char":
        yield f"    if ({value}_size > 0) {{"
        yield f"        memcpy(at, {value}, {value}_size);"
        yield f"        at += {value}_size;"
        yield "    }"
    elif field.elements == 1:
        yield f"    at = {_put(field, value)};"
    else:
        count = f"{field.elements}u" if field.elements else "message->n * channels(message->axes)"
        yield f"    for (size_t i = 0; i < {count}; i++) {{"
        yield f"        at = {_put(field, f'{value}[i]')};"
        yield "    }"


def _begin() -> Iterator[str]:
    """Yield the statements that write the header."""
    values = {"version": "TL_VERSION_BYTE", "length": "0", "flags": "0"}
    values |= {name: f"source->{name}" for name in ("hub", "wheel", "seq")}
    yield "    uint8_t *at = frame;"
    for field in wire.HEADER.fields:
        if field.name == "sync":
            yield from (f"    at = put_u8(at, TL_SYNC_{index});" for index in range(len(wire.SYNC)))
        else:
            yield f"    at = {_put(field, values.get(field.name, field.name))};"
    yield "    return at;"


def _put(field: Field, value: str) -> str:
    if field.c_type == "float":
        return f"put_f32(at, {value})"
    unsigned = f"uint{8 * field.size}_t"
    return f"{_PUT[field.size]}(at, {value if field.c_type == unsigned else f'({unsigned}){value}'})"


def _crc_nibble(value: int) -> int:
    for _ in range(4):
        value = value >> 1 ^ (0xEDB88320 if value & 1 else 0)
    return value


_CHECK_DECLARATION: Final = """\
typedef enum { TL_INTACT, TL_INCOMPLETE, TL_BAD_CRC, TL_NO_FRAME } tl_verdict;

/* Checks the frame that starts at `data`; sets *frame_size when it is intact. In a stream, continue after an intact
   frame, or one byte further after TL_BAD_CRC or TL_NO_FRAME. */
tl_verdict tl_check(const uint8_t *data, size_t size, size_t *frame_size);
"""

_CHANNELS: Final = "    return (size_t)((axes & 1u) + ((axes >> 1) & 1u) + ((axes >> 2) & 1u));"

_ENCODER_SUPPORT: Final = """\
#define TL_F32_MAX 3.40282346638528859812e+38f

static uint32_t crc32(const uint8_t *data, size_t size) {{
    static const uint32_t nibble[16] = {{
{table}}};
    uint32_t crc = 0xFFFFFFFFu;
    for (size_t i = 0; i < size; i++) {{
        crc ^= data[i];
        crc = (crc >> 4) ^ nibble[crc & 15u];
        crc = (crc >> 4) ^ nibble[crc & 15u];
    }}
    return crc ^ 0xFFFFFFFFu;
}}

static uint8_t *put_u8(uint8_t *at, uint8_t value) {{
    *at = value;
    return at + 1;
}}

static uint8_t *put_u16(uint8_t *at, uint16_t value) {{
    at = put_u8(at, (uint8_t)(value & 0xFFu));
    return put_u8(at, (uint8_t)(value >> 8));
}}

static uint8_t *put_u32(uint8_t *at, uint32_t value) {{
    at = put_u16(at, (uint16_t)(value & 0xFFFFu));
    return put_u16(at, (uint16_t)(value >> 16));
}}

static uint8_t *put_u64(uint8_t *at, uint64_t value) {{
    at = put_u32(at, (uint32_t)(value & 0xFFFFFFFFu));
    return put_u32(at, (uint32_t)(value >> 32));
}}

static uint8_t *put_f32(uint8_t *at, float value) {{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return put_u32(at, bits);
}}

static uint8_t *begin(uint8_t *frame, const tl_source *source, uint8_t type, uint32_t tick_us) {{
{begin}
}}

static size_t finish(uint8_t *frame, tl_source *source, uint8_t *at) {{
    size_t size = (size_t)(at - frame);
    frame[{length}] = (uint8_t)(size - TL_HEADER_BYTES);
    (void)put_u32(at, crc32(frame, size));
    source->seq++;
    return size + TL_CRC_BYTES;
}}

tl_verdict tl_check(const uint8_t *data, size_t size, size_t *frame_size) {{
    if ((size > 0 && data[0] != TL_SYNC_0) || (size > 1 && data[1] != TL_SYNC_1)) {{
        return TL_NO_FRAME;
    }}
    if (size < {length_known}) {{
        return TL_INCOMPLETE;
    }}
    if (data[{length}] > TL_MAX_PAYLOAD_BYTES) {{
        return TL_NO_FRAME;
    }}
    size_t body = TL_HEADER_BYTES + (size_t)data[{length}];
    if (size < body + TL_CRC_BYTES) {{
        return TL_INCOMPLETE;
    }}
    uint8_t crc[4];
    (void)put_u32(crc, crc32(data, body));
    if (memcmp(crc, data + body, sizeof crc) != 0) {{
        return TL_BAD_CRC;
    }}
    *frame_size = body + TL_CRC_BYTES;
    return TL_INTACT;
}}
"""
