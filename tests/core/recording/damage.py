"""Damage of recording files, with exact knowledge of the frames that lost bytes."""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.codec import encode_frame
from firmware_protocol.decoder import FrameDecoder
from gateway.core.links.source import Chunk, LinkItem
from gateway.core.recording.reader import RecordingReader
from tests.core.recording import streams


class Recorded(NamedTuple):
    """A recording and the frames of each link as (encoded bytes, positions of the bytes in the file)."""

    file: bytes
    items: list[LinkItem]
    frames: dict[str, list[tuple[bytes, NDArray[np.int64]]]]


def record(
    path: Path, rng: np.random.Generator, *, count: int, links: int, largest: int, topics: bool, finish: bool
) -> Recorded:
    """Record random streams of frames, cut into chunks at random."""
    encoded = {f"serial:/dev/tty{link}": streams.frames(rng, count, hub=0) for link in range(links)}
    cut = [streams.chunks(rng, b"".join(frames), link, largest=largest) for link, frames in encoded.items()]
    items: list[LinkItem] = sorted((chunk for chunks in cut for chunk in chunks), key=lambda chunk: chunk.host_ns)
    items.insert(3, streams.some_events("serial:/dev/tty0")[4])
    writer = streams.write(path, items, topics=topics, finish=finish)
    writer.tick(items[-1].host_ns + 10**10)
    file = path.read_bytes()
    streams_at: dict[str, list[NDArray[np.int64]]] = {link: [] for link in encoded}
    payloads = payload_positions(file)
    for chunk in (item for item in items if isinstance(item, Chunk)):
        start, size = next((start, size) for start, size in payloads if file[start : start + size] == chunk.data)
        streams_at[chunk.link].append(np.arange(start, start + size))
    frames = {}
    for link, encoded_frames in encoded.items():
        positions = np.concatenate(streams_at[link])
        ends = np.cumsum([len(frame) for frame in encoded_frames])
        frames[link] = [
            (frame, positions[end - len(frame) : end]) for frame, end in zip(encoded_frames, ends, strict=True)
        ]
    return Recorded(file, items, frames)


def payload_positions(file: bytes) -> Iterator[tuple[int, int]]:
    """Yield (start, size) of every message's data in a plain recording, by the MCAP specification."""
    position = 8
    while position + 9 <= len(file):
        opcode, length = struct.unpack_from("<BQ", file, position)
        body = position + 9
        if opcode == 0x0F:
            return
        if opcode == 0x06:
            position = body + 40  # times, size, CRC, empty compression name, length: then the records themselves
            continue
        if opcode == 0x05:
            yield body + 22, length - 22
        position = body + length


def untouched(recorded: Recorded, touched: NDArray[np.bool_]) -> dict[str, set[bytes]]:
    """Return the frames of which no byte is damaged."""
    return {
        link: {frame for frame, positions in frames if not touched[positions].any()}
        for link, frames in recorded.frames.items()
    }


def rescued(path: Path) -> dict[str, set[bytes]]:
    """Return the decoded frames of a recording, encoded again, by link."""
    results: dict[str, set[bytes]] = {}
    decoders: dict[str, FrameDecoder] = {}
    for item in RecordingReader(path).items():
        if isinstance(item, Chunk):
            decoder = decoders.setdefault(item.link, FrameDecoder())
            results.setdefault(item.link, set()).update(encode_frame(frame) for frame in decoder.feed(item.data))
    for link, decoder in decoders.items():
        results[link].update(encode_frame(frame) for frame in decoder.finish())
    return results


def cut(file: bytes, places: list[tuple[int, int]]) -> tuple[bytes, NDArray[np.bool_]]:
    """Remove (start, size) ranges; return the rest and the removed positions."""
    touched = np.zeros(len(file), dtype=bool)
    for start, size in places:
        touched[start : start + size] = True
    return np.frombuffer(file, np.uint8)[~touched].tobytes(), touched


def overwrite(file: bytes, places: list[tuple[int, bytes]]) -> tuple[bytes, NDArray[np.bool_]]:
    """Overwrite ranges in place; return the file and the changed positions."""
    changed = bytearray(file)
    for start, data in places:
        size = min(len(data), len(file) - start)
        changed[start : start + size] = data[:size]
    touched = np.frombuffer(file, np.uint8) != np.frombuffer(bytes(changed), np.uint8)
    return bytes(changed), touched
