"""AES-128-CMAC (RFC 4493, FIPS 197) in plain Python: slow, for test vectors only, without dependencies.

Its running time depends on the key, so it must not sign or check anything that an attacker can time.
"""

from functools import cache
from typing import Final

_BLOCK: Final = 16
_ROUNDS: Final = 10


def aes_cmac(key: bytes, data: bytes) -> bytes:
    """Return the 16-byte AES-128-CMAC of `data`."""
    round_keys = _expand(key)
    first = _doubled(_encrypt(round_keys, bytes(_BLOCK)))
    whole = bool(data) and len(data) % _BLOCK == 0
    padded = data if whole else data + b"\x80" + bytes(-(len(data) + 1) % _BLOCK)
    last = first if whole else _doubled(first)
    padded = padded[:-_BLOCK] + _xor(padded[-_BLOCK:], last)
    state = bytes(_BLOCK)
    for index in range(0, len(padded), _BLOCK):
        state = _encrypt(round_keys, _xor(state, padded[index : index + _BLOCK]))
    return state


def _xor(first: bytes, other: bytes) -> bytes:
    return bytes(a ^ b for a, b in zip(first, other, strict=True))


def _doubled(block: bytes) -> bytes:
    """Return twice a block in GF(2^128)."""
    value = int.from_bytes(block) << 1
    return ((value ^ (0x87 if value >> 128 else 0)) & (1 << 128) - 1).to_bytes(_BLOCK)


def _times_x(value: int) -> int:
    return (value << 1 ^ (0x1B if value & 0x80 else 0)) & 0xFF


@cache
def s_box() -> bytes:
    """Return the S-box: the inverse in GF(2^8), then the affine map."""
    power, powers, logs = 1, [0] * 255, [0] * 256
    for exponent in range(255):
        powers[exponent], logs[power] = power, exponent
        power ^= _times_x(power)
    box = bytearray([0x63])
    for value in range(1, 256):
        inverse = powers[-logs[value] % 255]
        turned = inverse
        for _ in range(4):
            inverse = (inverse << 1 | inverse >> 7) & 0xFF
            turned ^= inverse
        box.append(turned ^ 0x63)
    return bytes(box)


@cache
def _expand(key: bytes) -> tuple[bytes, ...]:
    if len(key) != _BLOCK:
        raise ValueError(f"a key has {_BLOCK} bytes, this one {len(key)}")
    words = [key[index : index + 4] for index in range(0, _BLOCK, 4)]
    constant = 1
    for index in range(4, 4 * (_ROUNDS + 1)):
        word = words[-1]
        if index % 4 == 0:
            turned = (word[1:] + word[:1]).translate(s_box())
            word = bytes((turned[0] ^ constant, *turned[1:]))
            constant = _times_x(constant)
        words.append(_xor(words[-4], word))
    return tuple(b"".join(words[index : index + 4]) for index in range(0, len(words), 4))


def _encrypt(round_keys: tuple[bytes, ...], block: bytes) -> bytes:
    state = _xor(block, round_keys[0])
    for number, round_key in enumerate(round_keys[1:], 1):
        state = state.translate(s_box())
        state = bytes(state[(index + 4 * (index % 4)) % _BLOCK] for index in range(_BLOCK))
        if number < _ROUNDS:
            state = b"".join(_mixed(state[index : index + 4]) for index in range(0, _BLOCK, 4))
        state = _xor(state, round_key)
    return state


def _mixed(column: bytes) -> bytes:
    everything = column[0] ^ column[1] ^ column[2] ^ column[3]
    return bytes(value ^ everything ^ _times_x(value ^ column[(index + 1) % 4]) for index, value in enumerate(column))
