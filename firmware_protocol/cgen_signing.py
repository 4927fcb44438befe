"""Writes the C functions with which firmware signs its frames; part of `cgen.py`."""

from __future__ import annotations

from typing import Final

from firmware_protocol.reference_cmac import s_box

SIGNING_DECLARATION: Final = """\
/* Signs as one sensor, or as the hub itself: make one from each key after every start. Holds the key: keep it from
   others, and where the chip has AES hardware use that in place of the AES here. */
typedef struct {
    uint8_t round_keys[176];
    uint8_t whole[16];
    uint8_t part[16];
    uint64_t identity;
    uint32_t boot_count;
} tl_signer;

/* `identity` is sensor_id of HELLO, or hub_id for frames of wheel TL_WHEEL_HUB_ITSELF; `boot_count` that of HELLO. It
   must never come again under the same key: count it up at every start, and when seq would wrap. */
void tl_signer_init(tl_signer *signer, const uint8_t key[16], uint64_t identity, uint32_t boot_count);

/* Signs a frame that an encoder has just written to a buffer of TL_MAX_FRAME_BYTES, and returns its new size. Returns 0
   and changes nothing where the frame is signed already or its payload is above TL_MAX_SIGNED_PAYLOAD_BYTES. */
size_t tl_sign(uint8_t *frame, const tl_signer *signer);

/* AES-128-CMAC (RFC 4493) of `size` bytes. */
void tl_cmac(const tl_signer *signer, const uint8_t *data, size_t size, uint8_t mac[16]);
"""

_CODE: Final = """\
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

static void aes_encrypt(const uint8_t round_keys[176], uint8_t block[16]) {{
    for (size_t k = 0; k < 16; k++) {{
        block[k] ^= round_keys[k];
    }}
    for (size_t round = 1; round <= 10; round++) {{
        uint8_t state[16];
        for (size_t k = 0; k < 16; k++) {{
            state[k] = s_box[block[(k + 4 * (k % 4)) % 16]];
        }}
        if (round < 10) {{
            for (size_t c = 0; c < 16; c += 4) {{
                uint8_t first = state[c];
                uint8_t all = state[c] ^ state[c + 1] ^ state[c + 2] ^ state[c + 3];
                state[c] ^= all ^ times_x(state[c] ^ state[c + 1]);
                state[c + 1] ^= all ^ times_x(state[c + 1] ^ state[c + 2]);
                state[c + 2] ^= all ^ times_x(state[c + 2] ^ state[c + 3]);
                state[c + 3] ^= all ^ times_x(state[c + 3] ^ first);
            }}
        }}
        for (size_t k = 0; k < 16; k++) {{
            block[k] = state[k] ^ round_keys[16 * round + k];
        }}
    }}
}}

static void doubled(uint8_t out[16], const uint8_t in[16]) {{
    for (size_t k = 0; k < 15; k++) {{
        out[k] = (uint8_t)((in[k] << 1) | (in[k + 1] >> 7));
    }}
    out[15] = (uint8_t)((in[15] << 1) ^ ((in[0] >> 7) * 0x87));
}}

/* CMAC over a head of fewer than 16 bytes and what follows it. */
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

size_t tl_sign(uint8_t *frame, const tl_signer *signer) {{
    if ((frame[7] & TL_FLAG_SIGNED) != 0 || frame[4] > TL_MAX_SIGNED_PAYLOAD_BYTES) {{
        return 0;
    }}
    uint8_t head[12];
    uint8_t mac[16];
    size_t size = TL_HEADER_BYTES + (size_t)frame[4];
    (void)put_u32(put_u64(head, signer->identity), signer->boot_count);
    frame[4] = (uint8_t)(frame[4] + TL_TAG_BYTES);
    frame[7] |= TL_FLAG_SIGNED;
    cmac(signer, head, sizeof head, frame, size, mac);
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
    return _CODE.format(s_box="".join(f"    {row},\n" for row in rows))
