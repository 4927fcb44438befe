"""Cuts chunks at frame borders, so that a fault can hit whole frames."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from firmware_protocol import wire
from gateway.io.source import Chunk


class Piece(NamedTuple):
    """Consecutive bytes: one intact frame, or bytes that are none.

    Attributes:
        data: the bytes.
        whole: whether they are an intact frame.
    """

    data: bytes
    whole: bool


def frame_pieces(chunks: Iterable[Chunk]) -> Iterator[tuple[str, int, list[Piece]]]:
    """Yield (link, time, pieces) per chunk; a frame belongs to the chunk that completes it. No byte is lost."""
    tails: dict[str, bytes] = {}
    times: dict[str, int] = {}
    for chunk in chunks:
        pieces, tails[chunk.link] = cut(tails.get(chunk.link, b"") + chunk.data)
        times[chunk.link] = chunk.host_ns
        if pieces:
            yield chunk.link, chunk.host_ns, pieces
    for link, tail in tails.items():
        if tail:
            yield link, times[link], [Piece(tail, False)]


def cut(data: bytes) -> tuple[list[Piece], bytes]:
    """Return the pieces of `data`, and what may be the beginning of a frame at its end."""
    pieces: list[Piece] = []
    start = at = 0
    while (at := data.find(wire.SYNC, at)) >= 0:
        if at + wire.LENGTH_KNOWN_BYTES > len(data):
            break
        length = data[at + wire.LENGTH_OFFSET]
        end = at + wire.OVERHEAD_BYTES + length
        if length > wire.MAX_PAYLOAD_BYTES:
            at += 1
            continue
        if end > len(data):
            break
        if zlib.crc32(data[at:end]) != wire.CRC_RESIDUE:
            at += 1
            continue
        if at > start:
            pieces.append(Piece(data[start:at], False))
        pieces.append(Piece(data[at:end], True))
        start = at = end
    if at < 0:
        at = len(data) - 1 if data.endswith(wire.SYNC[:1]) else len(data)
        at = max(at, start)
    if at > start:
        pieces.append(Piece(data[start:at], False))
    return pieces, data[at:]
