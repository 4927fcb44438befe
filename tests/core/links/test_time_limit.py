"""Wrapped sources: one with a time limit ends by the times of its items, one is read ahead of its reader."""

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from gateway.core.clock import ManualClock
from gateway.core.errors import SourceError
from gateway.core.links.playback import PlayedSource
from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind, LinkItem, open_source
from gateway.core.links.time_limit import TimeLimitedSource, limited
from gateway.makers.read_ahead import ReadAheadSource

START_NS = 1_700_000_000_000_000_000


class TenChunks:
    """A source with a chunk every 0.1 s, all of them available at once."""

    link = "test:x"
    vehicle_toml = "[vehicle]"

    def __init__(self) -> None:
        self.ended = self.closed = False

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        try:
            yield LinkEvent("test:x", START_NS, LinkEventKind.CONNECTED)
            for number in range(10):
                yield Chunk("test:x", START_NS + number * 100_000_000, bytes([number]))
        finally:
            self.ended = True

    def close(self) -> None:
        self.closed = True


def test_items_end_with_their_own_time() -> None:
    source = TenChunks()
    limited = TimeLimitedSource(source, 0.5)
    items = list(limited.items(threading.Event()))
    assert b"".join(item.data for item in items if isinstance(item, Chunk)) == bytes(range(6))
    assert source.ended, "the source must not go on behind the limit"


def test_other_properties_are_those_of_the_source() -> None:
    source = TenChunks()
    limited = TimeLimitedSource(source, 5.0)
    assert len(list(limited.items(threading.Event()))) == 11
    assert (limited.link, limited.vehicle_toml) == ("test:x", "[vehicle]")
    limited.close()
    assert source.closed


def test_limited_replay_can_be_paused(tmp_path: Path) -> None:
    (tmp_path / "x.bin").write_bytes(b"x")
    played = open_source(f"replay:{tmp_path}/x.bin?rate=100", ManualClock())
    source = limited(played, 5.0)
    assert isinstance(source, PlayedSource)
    assert source.playback is played.playback  # type: ignore[attr-defined]
    assert not isinstance(limited(TenChunks(), 5.0), PlayedSource)


class Exhausted(TenChunks):
    """A source that tells when its last item was taken, and fails then if it is told to."""

    def __init__(self, error: Exception | None = None) -> None:
        super().__init__()
        self.exhausted = threading.Event()
        self.error = error

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        yield from super().items(stop)
        self.exhausted.set()
        if self.error is not None:
            raise self.error


def test_a_source_read_ahead_does_not_wait_for_its_reader() -> None:
    source = Exhausted()
    items = ReadAheadSource(source).items(threading.Event())
    next(items)
    assert source.exhausted.wait(30.0)
    assert len(list(items)) == 10
    assert source.closed


def test_what_the_reading_thread_raises_is_raised_by_the_items() -> None:
    source = ReadAheadSource(Exhausted(SourceError("gone", "Plug it in.")))
    with pytest.raises(SourceError, match="gone"):
        list(source.items(threading.Event()))
