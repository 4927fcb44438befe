"""Live outputs of a session: each item goes to every sink, and the end waits for receivers that take items."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit

import numpy as np

from gateway.core.clock import Clock
from gateway.core.estimates.results import AlarmChange, RevolutionResult, SessionSnapshot, SinkSnapshot
from gateway.core.text.session_control import SessionControl
from gateway.publishing.sink import (
    BrowsedSink,
    Item,
    PublishedAlarm,
    PublishedRevolution,
    PublishedState,
    SinkAddress,
    SinkError,
    SinkSetting,
    kind_of,
    open_sink,
    parse_sink_uri,
)
from gateway.publishing.sink_worker import SinkWorker

STANDARD_OUTPUT: Final = "jsonl:-"
FINISH_STUCK_S: Final = 2.0
"""At the end, a receiver that takes nothing for this long is left."""
FINISH_S: Final = 10.0
"""At the end, every receiver is left after this time."""
_NO_REALS: Final = np.empty(0)
_NO_AXES: Final = np.empty((3, 0))
_NO_ORDERS: Final = np.empty(0, dtype=np.complex128)


class Publisher:
    """Sends revolutions, alarms and states to sinks; see `gateway.core.session.publication.Publication`."""

    def __init__(self, workers: Sequence[SinkWorker], clock: Clock, addresses: Sequence[str] = ()) -> None:
        """Start the outputs; `addresses` are those that users open in a browser."""
        self.addresses = tuple(addresses)
        self._workers = tuple(workers)
        self._clock = clock
        for worker in self._workers:
            worker.start()

    def take(self, items: Sequence[RevolutionResult | AlarmChange], host_ns: int) -> None:
        """Hand revolutions and changes of alarms to every sink."""
        for item in items:
            published: Item
            if isinstance(item, RevolutionResult):
                published = PublishedRevolution(item.host_ns, _without_waveforms(item))
            else:
                published = PublishedAlarm(host_ns, item)
            for worker in self._workers:
                worker.offer(published)

    def show(self, snapshot: SessionSnapshot, host_ns: int) -> None:
        """Hand the state of the session to every sink for which it is time, and the last one."""
        now_ns = self._clock.now_ns()
        state = PublishedState(host_ns or now_ns, snapshot)
        for worker in self._workers:
            if snapshot.ended or worker.wants_state(now_ns):
                worker.offer(state)

    def sinks(self) -> tuple[SinkSnapshot, ...]:
        """Return the present health of each sink."""
        return tuple(worker.snapshot() for worker in self._workers)

    @property
    def uses_standard_output(self) -> bool:
        """Whether nothing else may be printed to standard output."""
        return any(worker.name == STANDARD_OUTPUT for worker in self._workers)

    @property
    def is_output_closed(self) -> bool:
        """Whether the reader of standard output has left."""
        return any(worker.name == STANDARD_OUTPUT and worker.has_ended for worker in self._workers)

    @property
    def is_receiver_left(self) -> bool:
        """After `close`: whether a receiver was away or took nothing at the end."""
        return any(worker.is_left for worker in self._workers)

    def close(self) -> tuple[SinkSnapshot, ...]:
        """Send what waits and end the outputs; return their last state.

        A receiver that takes nothing for FINISH_STUCK_S is left, and every receiver after FINISH_S. What it has not
        taken is counted as dropped.
        """
        for worker in self._workers:
            worker.finish()
        end_ns = self._clock.now_ns() + int(FINISH_S * 1e9)
        last_progress = {worker: (worker.progress(), self._clock.now_ns()) for worker in self._workers}
        waiting = list(self._workers)
        while waiting:
            now_ns = self._clock.now_ns()
            for worker in tuple(waiting):
                progress = worker.progress()
                if progress != last_progress[worker][0]:
                    last_progress[worker] = progress, now_ns
                if worker.join(0.02):
                    waiting.remove(worker)
                elif now_ns >= end_ns or now_ns - last_progress[worker][1] >= FINISH_STUCK_S * 1e9:
                    worker.abandon()
                    worker.join(0.5)
                    waiting.remove(worker)
        for worker in self._workers:
            worker.discard()
        return self.sinks()


def files_of(uris: Sequence[str]) -> list[Path]:
    """Return the files that live outputs write.

    Raises:
        SinkError: a URI is wrong.
    """

    def is_file(address: SinkAddress) -> bool:
        return address.scheme == "jsonl" or (address.scheme == "influx" and not urlsplit(address.uri).netloc)

    return [Path(address.target) for address in filter(is_file, map(parse_sink_uri, uris))]


def open_outputs(
    uris: Sequence[str], positions: Sequence[str], session: Callable[[], SessionControl | None], clock: Clock
) -> Publisher | None:
    """Return the live outputs of a session, None without any; errors as for `open_publisher`."""
    return open_publisher(uris, SinkSetting(positions, session, clock), clock)


def open_publisher(uris: Sequence[str], setting: SinkSetting, clock: Clock) -> Publisher | None:
    """Return the live outputs of URIs, None without any.

    Raises:
        SinkError: one cannot be opened at all, or two are the same.
    """
    opened = [open_sink(uri, setting) for uri in uris]
    names = [name for name, _ in opened]
    duplicate = next((name for name in names if names.count(name) > 1), None)
    if duplicate is not None:
        raise SinkError(f"--publish {duplicate} is given twice", "Give each live output once.")
    if not opened:
        return None
    workers = [
        SinkWorker(name, sink, clock, state_interval_s=kind.state_interval_s, alarms_only=kind.alarms_only)
        for kind, (name, sink) in zip(map(kind_of, uris), opened, strict=True)
    ]
    return Publisher(workers, clock, [sink.address for _, sink in opened if isinstance(sink, BrowsedSink)])


def _without_waveforms(result: RevolutionResult) -> RevolutionResult:
    stripped = replace(result.revolution, radial_mps2=_NO_REALS, axes_mps2=_NO_AXES, orders_mps2=_NO_ORDERS)
    return replace(result, revolution=stripped)
