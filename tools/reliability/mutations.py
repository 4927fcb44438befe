"""Seeded changes of good inputs: bytes, numbers, lengths, lines, and the content behind checksums and compression."""

import struct
import zlib
from collections.abc import Callable, Sequence

import numpy as np
import zstandard

from firmware_protocol import wire

Change = Callable[[np.random.Generator, bytes], bytes]

_NUMBERS = (
    0, 1, 2, 0x7F, 0x80, 0xFF, 0x100, 0x7FFF, 0x8000, 0xFFFF, 0x10000, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 1 << 40,
    (1 << 63) - 1, 1 << 63, (1 << 64) - 1,
)  # fmt: skip
_WORDS = (
    b"nan", b"inf", b"-inf", b"1e999", b"-1", b"0", b"1e-320", b"9" * 400, b"0x", b"true", b'"', b"'", b"\\", b"[",
    b"]", b"[[", b"{", b"}", b"=", b",", b";", b".", b"#", b"\n", b"\r", b"\0", b"\t", b"\x1b[2J", b"\xed\xa0\x80",
    b"\xff\xfe", b"\xef\xbb\xbf", b"2024-01-01T00:00:00Z", b"null", b"[[wheel]]\n", b"[" * 2000, b"9" * 5000,
    b"a." * 40,
)  # fmt: skip
_MOST_BYTES = 1 << 20
_RECORD = struct.Struct("<BQ")
_CHUNK = struct.Struct("<QQQII")


def mutate(rng: np.random.Generator, seed: bytes, others: Sequence[bytes], inner: Change | None = None) -> bytes:
    """Return a good input with one to six changes.

    Args:
        rng: random numbers.
        seed: the good input.
        others: good inputs of the same kind, to splice with.
        inner: change of the content behind checksums or compression.
    """
    data = seed
    for _ in range(min(int(rng.geometric(0.5)), 6)):
        if inner is not None and rng.random() < 0.4:
            data = inner(rng, data)
        elif rng.random() < 0.08:
            other = others[int(rng.integers(len(others)))]
            data = data[: _offset(rng, data)] + other[_offset(rng, other) :]
        else:
            data = change(rng, data)
    return data[:_MOST_BYTES]


def change(rng: np.random.Generator, data: bytes) -> bytes:
    """Return data with one change."""
    offset = _offset(rng, data)
    size = int(min(2 ** min(rng.geometric(0.25) - 1, 11), max(len(data) - offset, 1)))
    word = _WORDS[int(rng.integers(len(_WORDS)))]
    match int(rng.integers(12)):
        case 0:
            flipped = (data[offset] ^ 1 << int(rng.integers(8))) if offset < len(data) else 0
            return data[:offset] + bytes((flipped,)) + data[offset + 1 :]
        case 1:
            return data[:offset] + rng.bytes(min(size, 64)) + data[offset + min(size, 64) :]
        case 2:
            return data[:offset]
        case 3:
            return data[:offset] + data[offset + size :]
        case 4:
            times = int(2 ** rng.integers(0, 9))
            return data[:offset] + data[offset : offset + size] * min(times, _MOST_BYTES // (4 * size)) + data[offset:]
        case 5:
            other = _offset(rng, data)
            return data[:offset] + data[other : other + size] + data[offset + size :]
        case 6 | 7:
            width = int(2 ** rng.integers(0, 4))
            number = _NUMBERS[int(rng.integers(len(_NUMBERS)))] + int(rng.integers(-2, 3))
            packed = (number % (1 << 8 * width)).to_bytes(width, "little" if rng.random() < 0.8 else "big")
            return data[:offset] + packed + data[offset + width :]
        case 8:
            return data[:offset] + word + data[offset:]
        case 9:
            return data[:offset] + word + data[offset + len(word) :]
        case 10:
            return _changed_line(rng, data)
        case _:
            return _changed_number(rng, data, word)


def recording_content(rng: np.random.Generator, data: bytes) -> bytes:
    """Change the records inside a chunk of a recording, and make sizes, compression and checksum right again."""
    chunks = [
        (offset, end)
        for opcode, offset, end in _records(data)
        if opcode == 6 and end - offset >= _RECORD.size + _CHUNK.size
    ]
    if not chunks:
        return change(rng, data)
    offset, end = chunks[int(rng.integers(len(chunks)))]
    body = data[offset + _RECORD.size : end]
    begin, stop, _, _, name_size = _CHUNK.unpack_from(body)
    content = body[_CHUNK.size + name_size + 8 :]
    if body[_CHUNK.size : _CHUNK.size + name_size] == b"zstd":
        try:
            content = zstandard.decompress(content, 1 << 20)
        except zstandard.ZstdError:
            return change(rng, data)
    for _ in range(int(rng.integers(1, 4))):
        content = change(rng, content)
    stored, name = (zstandard.compress(content), b"zstd") if rng.random() < 0.5 else (content, b"")
    head = (
        _CHUNK.pack(begin, stop, len(content), zlib.crc32(content), len(name)) + name + struct.pack("<Q", len(stored))
    )
    return data[:offset] + _RECORD.pack(6, len(head) + len(stored)) + head + stored + data[end:]


def mat_content(rng: np.random.Generator, data: bytes) -> bytes:
    """Change the inside of a compressed element of a MATLAB file, and make its length right again."""
    elements = []
    offset = 128
    while offset + 8 <= len(data):
        kind, size = struct.unpack_from("<II", data, offset)
        if kind == 15:
            elements.append((offset, min(offset + 8 + size, len(data))))
        offset += 8 + size
    if not elements:
        return change(rng, data)
    offset, end = elements[int(rng.integers(len(elements)))]
    try:
        content = zlib.decompressobj().decompress(data[offset + 8 : end], 1 << 20)
    except zlib.error:
        return change(rng, data)
    stored = zlib.compress(change(rng, content))
    return data[:offset] + struct.pack("<II", 15, len(stored)) + stored + data[end:]


def mdf_content(rng: np.random.Generator, data: bytes) -> bytes:
    """Change the inside of a compressed block of an MDF file; all places in the file stay."""
    starts = [offset for offset in range(0, len(data) - 48, 8) if data[offset : offset + 4] == b"##DZ"]
    if not starts:
        return change(rng, data)
    offset = starts[int(rng.integers(len(starts)))]
    length = int.from_bytes(data[offset + 8 : offset + 16], "little")
    try:
        content = zlib.decompressobj().decompress(data[offset + 48 : offset + length], 1 << 20)
    except zlib.error:
        return change(rng, data)
    if not content:
        # An earlier change has cut it off.
        return change(rng, data)
    changed = bytearray(content)
    for _ in range(int(rng.integers(1, 9))):
        changed[int(rng.integers(len(changed)))] = int(rng.integers(256))
    stored = zlib.compress(bytes(changed), 9)
    if len(stored) > length - 48:
        # Constant content is shorter than any other.
        stored = zlib.compress(bytes([changed[0]]) * len(changed), 9)
    return data[: offset + 48] + stored + data[offset + 48 + len(stored) :]


def frame_content(rng: np.random.Generator, data: bytes) -> bytes:
    """Change one frame of a link's bytes and make its checksum right again."""
    starts = [offset for offset in range(len(data)) if data.startswith(wire.SYNC, offset)]
    if not starts:
        return change(rng, data)
    which = int(rng.integers(len(starts)))
    offset = starts[which]
    end = starts[which + 1] if which + 1 < len(starts) else len(data)
    if end - offset < wire.HEADER_BYTES + 4:
        return change(rng, data)
    frame = bytearray(data[offset : end - 4])
    for _ in range(int(rng.integers(1, 4))):
        index = int(rng.integers(2, len(frame)))
        frame[index] = int(rng.integers(256)) if rng.random() < 0.7 else (0, 0xFF, 0x7F, 0x80)[int(rng.integers(4))]
    return data[:offset] + bytes(frame) + zlib.crc32(frame).to_bytes(4, "little") + data[end:]


def _offset(rng: np.random.Generator, data: bytes) -> int:
    return int(rng.integers(len(data) + 1))


def _records(data: bytes) -> list[tuple[int, int, int]]:
    """Return (opcode, start, end) of the complete records of an MCAP file."""
    results = []
    offset = 8
    while offset + _RECORD.size <= len(data):
        opcode, length = _RECORD.unpack_from(data, offset)
        end = offset + _RECORD.size + length
        if end > len(data):
            break
        results.append((opcode, offset, end))
        offset = end
    return results


def _changed_line(rng: np.random.Generator, data: bytes) -> bytes:
    lines = data.split(b"\n")
    index, other = (int(rng.integers(len(lines))) for _ in range(2))
    match int(rng.integers(3)):
        case 0:
            del lines[index]
        case 1:
            lines.insert(index, lines[other])
        case _:
            lines[index], lines[other] = lines[other], lines[index]
    return b"\n".join(lines)


def _changed_number(rng: np.random.Generator, data: bytes, word: bytes) -> bytes:
    """Replace the next number of a text."""
    offset = _offset(rng, data)
    digits = b"0123456789.+-eE"
    while offset < len(data) and data[offset] not in digits:
        offset += 1
    end = offset
    while end < len(data) and data[end] in digits:
        end += 1
    number = word if rng.random() < 0.4 else str(_NUMBERS[int(rng.integers(len(_NUMBERS)))]).encode()
    if rng.random() < 0.3:
        number = repr(float(10.0 ** rng.uniform(-320, 308))).encode()
    return data[:offset] + number + data[end:]
