"""A simulated hub's bytes for tests that change or interrupt them."""

import threading
from collections.abc import Iterable

from firmware_protocol import wire
from firmware_protocol.codec import encode_raw
from firmware_protocol.decoder import FrameDecoder
from gateway.core.clock import ManualClock
from gateway.core.links.source import Chunk, LinkItem, open_source
from gateway.core.reasons import Notice
from gateway.core.session.core import SessionCore


def simulated(uri: str) -> tuple[list[LinkItem], str]:
    """Return the items of a simulator source and its vehicle."""
    source = open_source(uri, ManualClock())
    return list(source.items(threading.Event())), source.vehicle_toml or ""


def chunks_of(items: Iterable[LinkItem]) -> list[Chunk]:
    return [item for item in items if isinstance(item, Chunk)]


def link_bytes(items: Iterable[LinkItem]) -> bytes:
    """Return what links have sent."""
    return b"".join(item.data for item in items if isinstance(item, Chunk))


def readdressed(frame: bytes, *, version: int = wire.VERSION_BYTE, flags: int = 0, type_: int | None = None) -> bytes:
    """Return a frame with another version, flags or type and the right checksum."""
    payload = frame[wire.HEADER_BYTES : -wire.CRC_BYTES]
    seq, tick_us = int.from_bytes(frame[8:12], "little"), int.from_bytes(frame[12:16], "little")
    kind = frame[3] if type_ is None else type_
    return encode_raw(kind, payload, frame[5], frame[6], seq, tick_us, version=version, flags=flags)


def notices_of(core: SessionCore, items: Iterable[LinkItem]) -> list[Notice]:
    """Run items through a session; return its notices after the start."""
    core.take_notices()
    for item in items:
        core.take(item)
    core.finish()
    return core.take_notices()


def decodes(data: bytes) -> int:
    """Return the number of frames in bytes."""
    decoder = FrameDecoder()
    return len(decoder.feed(data)) + len(decoder.finish())
