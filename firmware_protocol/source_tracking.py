"""Counter rules for every source of a link, shared by the streaming and the block decoder."""

from collections.abc import Iterable
from typing import Final

from firmware_protocol.counters import LinkCounters, SourceCounters
from firmware_protocol.sequence import COUNTER_MASK, Arrival, Window, advance, classify

_NOTHING_YET: Final = -1


class SourceTracker:
    """Counter state of one source.

    Attributes:
        counters: its public counters.
        expected: the next counter in sequence, -1 before the first frame. A decoder may advance it directly; the window
            is brought up to date when a frame arrives out of order.
    """

    __slots__ = ("_window", "counters", "expected", "restarted_alone")

    def __init__(self, counters: SourceCounters) -> None:
        self.counters = counters
        self.expected = _NOTHING_YET
        self.restarted_alone = False
        self._window: Window | None = None

    @property
    def window(self) -> Window | None:
        """History of the counters."""
        if self._window is None:
            return None
        return advance(self._window, (self.expected - 1 - self._window.last) & COUNTER_MASK)

    @window.setter
    def window(self, window: Window | None) -> None:
        self._window = window
        self.expected = _NOTHING_YET if window is None else (window.last + 1) & COUNTER_MASK

    def accept(self, seq: int) -> bool:
        """Count a frame by its counter; return False when it is a duplicate."""
        if seq == self.expected:
            self.expected = (seq + 1) & COUNTER_MASK
            return True
        arrival, lost, self.window = classify(self.window, seq)
        counters = self.counters
        if arrival is Arrival.DUPLICATE:
            counters.duplicates += 1
            return False
        counters.lost += lost
        if arrival is Arrival.LATE:
            counters.reordered += 1
        elif arrival is Arrival.RESTART:
            counters.restarts += 1
            self.restarted_alone = True
        return True

    def hub_restarted(self) -> None:
        """Restart with the hub, unless the counter has shown this restart already."""
        if not self.restarted_alone:
            self.counters.restarts += 1
            self.window = None
        self.restarted_alone = False


class LinkTracker:
    """Counter state of all sources of a link: at most 65,536 sources and 256 hubs, 25 MB."""

    def __init__(self) -> None:
        self.counters = LinkCounters()
        self.sources: dict[int, SourceTracker] = {}
        self._boot_counts: dict[int, int] = {}

    def source(self, key: int) -> SourceTracker:
        """Return the tracker of the source `wheel << 8 | hub`, new if need be."""
        tracker = self.sources.get(key)
        if tracker is None:
            counters = self.counters.sources[key & 0xFF, key >> 8] = SourceCounters()
            tracker = self.sources[key] = SourceTracker(counters)
        return tracker

    def restarts_within(self, hellos: Iterable[tuple[int, int]]) -> bool:
        """Return whether upcoming hellos, as (hub, boot count) in order, announce a restart of a hub."""
        boot_counts = dict(self._boot_counts)
        return any(boot_counts.setdefault(hub, boot_count) != boot_count for hub, boot_count in hellos)

    def hello(self, key: int, boot_count: int) -> None:
        """Note a hello's boot count, before its counter is looked at; a new one restarts all sources of the hub."""
        hub = key & 0xFF
        if self._boot_counts.setdefault(hub, boot_count) != boot_count:
            self._boot_counts[hub] = boot_count
            for of_hub in range(hub, 0x10000, 0x100):
                tracker = self.sources.get(of_hub)
                if tracker is not None:
                    tracker.hub_restarted()
        elif key in self.sources:
            self.sources[key].restarted_alone = False
