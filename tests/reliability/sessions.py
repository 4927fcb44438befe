"""Live sessions with sources and recorders that misbehave on purpose."""

import threading
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from gateway.core.clock import SystemClock
from gateway.core.config.vehicle import VehicleConfig
from gateway.core.links.source import LinkItem
from gateway.core.session.core import SessionCore
from gateway.core.session.live import LiveSession, Recordings
from gateway.core.session.recording_stage import Recorder

TIMEOUT_S = 90.0


class Items:
    """A source of given items; `before_end` runs in its thread after the last one."""

    vehicle_toml = None

    def __init__(
        self, items: Iterable[LinkItem], link: str = "sim:lab", before_end: Callable[[], object] = lambda: None
    ) -> None:
        self._items, self.link, self._before_end = items, link, before_end

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        for item in self._items:
            if stop.is_set():
                return
            yield item
        self._before_end()

    def close(self) -> None:
        pass


class SlowWriter:
    """A recorder whose disk accepts no data until `gate` is set."""

    path = Path("slow.mcap")

    def __init__(self) -> None:
        self.gate = threading.Event()
        self.items: list[LinkItem] = []
        self.topics: list[str] = []
        self.closed = False
        self.error: Exception | None = None

    @property
    def size_bytes(self) -> int:
        return len(self.items)

    def write(self, item: LinkItem) -> None:
        assert self.gate.wait(TIMEOUT_S)
        if self.error is not None:
            raise self.error
        self.items.append(item)

    def write_topic(self, topic: str, host_ns: int, payload: object) -> None:
        assert self.gate.wait(TIMEOUT_S)
        self.topics.append(topic)

    def tick(self, now_ns: int) -> None:
        pass

    def sync(self) -> None:
        pass

    def close(self) -> None:
        self.closed = True


def prepare(
    source: Items, vehicle: VehicleConfig, recorder: Recorder | None = None, *, patient: bool = True
) -> LiveSession:
    """Return a session that has not started."""
    return LiveSession(
        [source], SessionCore(vehicle), SystemClock(), patient=[patient], recordings=Recordings(recorder)
    )


def start(
    source: Items, vehicle: VehicleConfig, recorder: Recorder | None = None, *, patient: bool = True
) -> LiveSession:
    live = prepare(source, vehicle, recorder, patient=patient)
    live.start()
    return live
