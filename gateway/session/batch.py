"""Recordings through the batch decoder and the pipeline in one pass: the same results as live, memory flat."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final, Protocol

import numpy as np

from firmware_protocol.batch import BatchDecoder, FrameBatch
from firmware_protocol.counters import LinkCounters
from gateway.config.model import ASSUMED_RADIUS_MM, VehicleConfig
from gateway.estimators.registry import DEFAULT_ESTIMATORS
from gateway.io.source import Chunk, LinkItem
from gateway.pipeline.core import Pipeline
from gateway.pipeline.results import RevolutionResult
from gateway.pipeline.setup import WheelSetup

# Bytes of one link that are decoded together.
_BLOCK_BYTES: Final = 1 << 20


class Items(Protocol):
    """Anything that yields link items, such as a recording."""

    def items(self) -> Iterator[LinkItem]:
        """Yield items in the order of arrival."""
        ...


@dataclass(slots=True)
class _Link:
    """Bytes of one link that wait to be decoded, and when they came."""

    name: str
    decoder: BatchDecoder = field(default_factory=lambda: BatchDecoder(_BLOCK_BYTES))
    pending: bytearray = field(default_factory=bytearray)
    fed: int = 0
    ends: list[int] = field(default_factory=list)
    arrivals_ns: list[int] = field(default_factory=list)

    def add(self, chunk: Chunk) -> None:
        self.pending += chunk.data
        self.ends.append(self.fed + len(self.pending))
        self.arrivals_ns.append(chunk.host_ns)

    def decode(self, *, final: bool) -> Iterator[FrameBatch]:
        block = bytes(self.pending)
        self.fed += len(block)
        self.pending.clear()
        yield self.decoder.feed(block)
        if final:
            yield self.decoder.finish()

    def arrival_ns(self, batch: FrameBatch) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        """Arrival of the chunk that completed each frame."""
        place = np.searchsorted(np.array(self.ends), batch.end_offset, side="left")
        return np.array(self.arrivals_ns, np.int64)[np.minimum(place, len(self.arrivals_ns) - 1)]

    def forget(self) -> None:
        """Drop arrivals that no later frame can need: the last chunk of a block may still complete one."""
        del self.ends[:-1], self.arrivals_ns[:-1]


def estimate_items(
    source: Items,
    vehicle: VehicleConfig | None,
    on_result: Callable[[RevolutionResult], None],
    *,
    estimators: Sequence[str] = DEFAULT_ESTIMATORS,
    on_bytes: Callable[[int], None] | None = None,
) -> dict[str, LinkCounters]:
    """Estimate everything that `source` yields.

    Args:
        source: a recording.
        vehicle: configuration, None for an assumed belt radius.
        on_result: called for every completed revolution; each wheel's in order, wheels interleaved by block.
        estimators: names from the registry.
        on_bytes: called with the number of link bytes taken in, for a progress bar.

    Returns:
        the decoder's counters per link.
    """
    setups = vehicle.wheel_setups() if vehicle is not None else ()
    pipeline = Pipeline(setups, WheelSetup("", 0, 0, ASSUMED_RADIUS_MM * 1e-3), estimators)
    links: dict[str, _Link] = {}

    def flush(link: _Link, *, final: bool = False) -> None:
        for batch in link.decode(final=final):
            if len(batch.type):
                for result in pipeline.batch(link.name, batch, link.arrival_ns(batch)):
                    on_result(result)
        link.forget()

    for item in source.items():
        if not isinstance(item, Chunk):
            continue
        link = links.get(item.link)
        if link is None:
            link = links[item.link] = _Link(item.link)
        link.add(item)
        if on_bytes is not None:
            on_bytes(len(item.data))
        if len(link.pending) >= _BLOCK_BYTES:
            flush(link)
    for link in links.values():
        if link.arrivals_ns:
            flush(link, final=True)
    for result in pipeline.finish():
        on_result(result)
    return {name: link.decoder.counters for name, link in links.items()}
