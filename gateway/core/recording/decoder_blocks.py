"""Decoding of a recorded link in large blocks, with the arrival times of the frames."""

from collections.abc import Iterator
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.block_decoder import BatchDecoder, FrameBatch
from firmware_protocol.counters import LinkCounters
from firmware_protocol.signing import Gate
from gateway.core.links.source import Chunk

# A wheel's revolutions in a block are worked on together: 80 of a car's at 100 km/h.
_BLOCK_BYTES: Final = 1 << 21
_BLOCK_CHUNKS: Final = 1 << 16
LINKS_APART_NS: Final = 1_000_000_000
"""Time by which frames of a link may be ahead of those of another: alarms and pairs of wheels compare their times."""


class LinkBlocks:
    """Batch decoder of the chunks of one link; memory use is constant."""

    def __init__(self, link: str, gate: Gate | None = None) -> None:
        """Start with the link's first byte; `gate` as for the decoder."""
        self.link = link
        self._decoder = BatchDecoder(_BLOCK_BYTES, gate)
        self._pending = bytearray()
        self._fed = 0
        self._ends: list[int] = []
        self._arrivals_ns: list[int] = []

    @property
    def counters(self) -> LinkCounters:
        """Counts of the decoder so far."""
        return self._decoder.counters

    def add(self, chunk: Chunk) -> Iterator[tuple[FrameBatch, NDArray[np.int64]]]:
        """Add a chunk; when a block is full, yield a batch and the arrival times of its frames in ns.

        A batch is valid until the next one is yielded.
        """
        self._pending += chunk.data
        self._ends.append(self._fed + len(self._pending))
        self._arrivals_ns.append(chunk.host_ns)
        if len(self._pending) >= _BLOCK_BYTES or len(self._ends) >= _BLOCK_CHUNKS:
            yield from self._decode(self._decoder.feed(self._take()))

    def waiting(self) -> Iterator[tuple[FrameBatch, NDArray[np.int64]]]:
        """Yield a batch of the chunks that wait for a full block."""
        if self._pending:
            yield from self._decode(self._decoder.feed(self._take()))

    def finish(self) -> Iterator[tuple[FrameBatch, NDArray[np.int64]]]:
        """Yield the remaining batches at the end of the link."""
        if self._arrivals_ns:
            yield from self.waiting()
            yield from self._decode(self._decoder.finish())

    def _take(self) -> bytes:
        block = bytes(self._pending)
        self._fed += len(block)
        self._pending.clear()
        return block

    def _decode(self, batch: FrameBatch) -> Iterator[tuple[FrameBatch, NDArray[np.int64]]]:
        if len(batch):
            chunk = np.searchsorted(np.array(self._ends), batch.end_offset, side="left")
            arrivals = np.array(self._arrivals_ns, np.int64)
            yield batch, arrivals[np.minimum(chunk, len(arrivals) - 1)]
        # Only the last chunk of a block can still complete a frame of the next.
        del self._ends[:-1], self._arrivals_ns[:-1]


class Gates(Protocol):
    """Verification of frames, link by link."""

    def gate(self, link: str) -> Gate:
        """Return what admits the frames of a link."""
        ...


class DecodedLinks:
    """Batch decoders of all links of a recording."""

    def __init__(self, gates: Gates | None = None) -> None:
        """Start before the first byte of each link; `gates` verifies every frame first, None to verify none."""
        self._gates = gates
        self._links: dict[str, LinkBlocks] = {}
        self._window_ns = 0

    @property
    def counters(self) -> dict[str, LinkCounters]:
        """Counts of the decoders so far, by link."""
        return {name: blocks.counters for name, blocks in self._links.items()}

    def add(self, chunk: Chunk) -> Iterator[tuple[str, FrameBatch, NDArray[np.int64]]]:
        """Add a chunk; yield link, frames and arrival times of blocks that are full. Batches as for `LinkBlocks`."""
        blocks = self._links.get(chunk.link)
        if blocks is None:
            gate = self._gates.gate(chunk.link) if self._gates is not None else None
            blocks = self._links[chunk.link] = LinkBlocks(chunk.link, gate)
        if len(self._links) > 1 and not 0 <= chunk.host_ns - self._window_ns < LINKS_APART_NS:
            self._window_ns = chunk.host_ns
            yield from self.waiting()
        for batch, arrivals_ns in blocks.add(chunk):
            yield chunk.link, batch, arrivals_ns

    def waiting(self) -> Iterator[tuple[str, FrameBatch, NDArray[np.int64]]]:
        """Yield the frames that wait for a full block, of all links."""
        for name, blocks in self._links.items():
            for batch, arrivals_ns in blocks.waiting():
                yield name, batch, arrivals_ns

    def finish(self) -> Iterator[tuple[str, FrameBatch, NDArray[np.int64]]]:
        """Yield the remaining batches of all links."""
        for name, blocks in self._links.items():
            for batch, arrivals_ns in blocks.finish():
                yield name, batch, arrivals_ns
