"""States of a reconnecting source, on a scripted link and a manual clock."""

import errno
import itertools
import threading
from collections.abc import Callable

import can
import pytest

from gateway.core.clock import ManualClock
from gateway.core.errors import LinkLostError, SourceError
from gateway.core.links.bus_frames import unpack
from gateway.core.links.reconnect import Backoff, LinkState, ReconnectingSource
from gateway.core.links.source import BusFrames, Chunk, LinkEvent, LinkEventKind
from gateway.vehicle.can_source import CanBusSource

MISSING = SourceError("there is no port X", "Plug it in.", cause=errno.ENOENT)
BUSY = SourceError("X is in use", "Close the other program.", cause=errno.EBUSY)
LOST = LinkLostError("X disappeared", "Unplugged?")


class ScriptedLink:
    """Its script has what each read brings: bytes, an error, or the seconds that pass."""

    def __init__(self, script: list[bytes | float | Exception], opened: Callable[[], None], clock: ManualClock) -> None:
        self._clock = clock
        self.script = script
        self.written: list[bytes] = []
        self.closed = 0
        self._opened = opened

    def open(self) -> None:
        self._opened()
        if self.script and isinstance(self.script[0], SourceError):
            raise self.script[0]

    def write(self, data: bytes) -> None:
        self.written.append(data)

    def read(self, timeout_s: float) -> bytes:
        if not self.script:
            raise LOST
        step = self.script.pop(0)
        if isinstance(step, Exception):
            raise step
        if isinstance(step, float):
            self._clock.advance_ns(round(step * 1e9))
            return b""
        return step

    def close(self) -> None:
        self.closed += 1


class Bench:
    """Scripted links one after the other, with the time of each opening; `stop` is set after the last script."""

    def __init__(self, *scripts: list[bytes | float | Exception]) -> None:
        self.clock = ManualClock(0)
        self.opened_ns: list[int] = []
        self.links: list[ScriptedLink] = []
        self.stop = threading.Event()
        self._scripts = list(scripts)
        self.source = ReconnectingSource("test:X", self._make, self.clock)

    def _make(self) -> ScriptedLink:
        script = self._scripts.pop(0) if self._scripts else [BUSY]
        link = ScriptedLink(script, self._note, self.clock)
        self.links.append(link)
        return link

    def _note(self) -> None:
        self.opened_ns.append(self.clock.now_ns())
        if not self._scripts:
            self.stop.set()

    def run(self) -> list[Chunk | LinkEvent]:
        return list(self.source.items(self.stop))


def kinds(items: list[Chunk | LinkEvent]) -> list[str]:
    return [item.kind.value if isinstance(item, LinkEvent) else "chunk" for item in items]


def test_reads_leave_time_for_more_unless_the_terminal_is_full(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench([b"few", b"x" * 4095, b"", b"rest"], [BUSY])
    bench.source.gather_s = 0.004
    pauses: list[tuple[bytes, float]] = []
    items = bench.source.items(bench.stop)
    monkeypatch.setattr(bench.stop, "wait", lambda timeout_s: pauses.append((chunks[-1], timeout_s)))
    chunks: list[bytes] = []
    for item in items:
        if isinstance(item, Chunk):
            chunks.append(item.data)
        elif item.kind is LinkEventKind.LOST:
            break
    assert chunks == [b"few", b"x" * 4095, b"rest"]
    assert pauses == [(b"few", 0.004), (b"rest", 0.004)]


def test_first_opening_raises() -> None:
    bench = Bench([MISSING])
    with pytest.raises(SourceError, match="no port X") as caught:
        bench.run()
    assert caught.value.remedy == "Plug it in."
    assert bench.links[0].closed >= 1


def test_lost_link_is_retried_with_one_event_each() -> None:
    bench = Bench([b"ab", b"", b"cd"], [MISSING], [MISSING], [BUSY], [BUSY], [b"ef"], [])
    items = bench.run()
    assert kinds(items)[:8] == ["connected", "chunk", "chunk", "lost", "retrying", "retrying", "restored", "chunk"]
    assert [item.data for item in items if isinstance(item, Chunk)] == [b"ab", b"cd", b"ef"]
    lost, missing, busy, restored = [item for item in items if isinstance(item, LinkEvent)][1:5]
    assert lost.text == "X disappeared. Unplugged?"
    assert "no port X" in missing.text
    assert "Plug it in." in missing.text
    assert "in use" in busy.text
    (away,) = restored.details
    assert away["away_s"] == pytest.approx(7.75)  # 0.25 + 0.5 + 1 + 2 + 4


def test_failures_are_reported_once_per_cause() -> None:
    still_busy = SourceError("X is in use by process 17", "Close the other program.", cause=errno.EBUSY)
    other = SourceError("X is in use", "Close the other program.", cause="in use")
    bench = Bench([b"ab"], [BUSY], [still_busy], [other], [b"cd"], [])
    texts = [item.text for item in bench.run() if isinstance(item, LinkEvent) and item.kind is LinkEventKind.RETRYING]
    assert texts == ["X is in use. Close the other program."] * 2


def test_pauses_double_up_to_the_cap() -> None:
    bench = Bench([b"x"], *[[MISSING] for _ in range(8)])
    bench.run()
    opened = bench.opened_ns
    pauses_s = [(b - a) * 1e-9 for a, b in itertools.pairwise(opened)]
    assert pauses_s == [0.25, 0.5, 1.0, 2.0, 4.0, 5.0, 5.0, 5.0]


@pytest.mark.parametrize("brings", [[], [b"y"]])
def test_pauses_restart_only_after_a_connection_that_held(brings: list[bytes | float | Exception]) -> None:
    # A link that opens but breaks at once must not be hammered, though each time a byte comes.
    bench = Bench([b"x"], *[list(brings) for _ in range(7)], [5.0, b"z"], [])
    bench.run()
    pauses_s = [(b - a) * 1e-9 for a, b in itertools.pairwise(bench.opened_ns)]
    assert pauses_s == [0.25, 0.5, 1.0, 2.0, 4.0, 5.0, 5.0, 5.0, 5.25]


def test_backoff_never_overflows() -> None:
    assert Backoff().pause_ns(10_000) == 5_000_000_000


def test_stop_while_waiting_ends_without_another_attempt() -> None:
    bench = Bench([b"x"], [MISSING], [MISSING])
    items = bench.source.items(bench.stop)
    assert kinds([next(items), next(items), next(items)]) == ["connected", "chunk", "lost"]
    bench.stop.set()
    assert list(items) == []
    assert len(bench.opened_ns) == 1


def test_close_ends_items_and_may_be_repeated() -> None:
    bench = Bench([b"x", b"y", b"z"], [])
    items = bench.source.items(bench.stop)
    next(items)
    next(items)
    bench.source.close()
    bench.source.close()
    assert list(items) == []
    assert bench.source.state is LinkState.CLOSED
    assert bench.links[0].closed >= 1
    assert list(bench.source.items(bench.stop)) == []
    assert len(bench.links) == 1, "a closed source must not open its port again"


def test_stop_does_not_wait_for_a_hanging_opening() -> None:
    hanging, released, closed = threading.Event(), threading.Event(), threading.Event()

    class Hanging:
        def open(self) -> None:
            hanging.set()
            assert released.wait(10)

        def read(self, timeout_s: float) -> bytes:
            raise AssertionError("never opened")

        def write(self, data: bytes) -> None:
            raise AssertionError("never opened")

        def close(self) -> None:
            closed.set()

    stop = threading.Event()
    source = ReconnectingSource("test:hang", Hanging, ManualClock())
    items: list[object] = []
    thread = threading.Thread(target=lambda: items.extend(source.items(stop)))
    thread.start()
    assert hanging.wait(10)
    stop.set()
    thread.join(10)
    assert not thread.is_alive()
    assert items == []
    released.set()
    assert closed.wait(10), "a connection that came too late must be closed again"


def test_events_carry_the_clock() -> None:
    bench = Bench([b"x"], [b"y"], [])
    events = [item for item in bench.run() if isinstance(item, LinkEvent)]
    assert [event.host_ns for event in events[:3]] == [0, 0, 250_000_000]
    assert events[2].kind is LinkEventKind.RESTORED


class FlappingBus(can.BusABC):
    """A bus of an adapter that brings a frame and is gone."""

    def __init__(self, opened: Callable[[], None]) -> None:
        opened()
        self._frames = [can.Message(arbitration_id=1)]

    def recv(self, timeout: float | None = None) -> can.Message | None:
        if not self._frames:
            raise ValueError("an error of this adapter's library")
        return self._frames.pop()

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        raise AssertionError("a source sends nothing")

    def shutdown(self) -> None:
        pass


def test_a_bus_that_flaps_is_opened_less_and_less_often() -> None:
    clock, stop, opened_ns = ManualClock(0), threading.Event(), []

    def opened() -> None:
        opened_ns.append(clock.now_ns())
        if len(opened_ns) == 9:
            stop.set()

    items = list(CanBusSource("can:X", lambda: FlappingBus(opened), clock, None).items(stop))
    pauses_s = [(b - a) * 1e-9 for a, b in itertools.pairwise(opened_ns)]
    assert pauses_s == [0.25, 0.5, 1.0, 2.0, 4.0, 5.0, 5.0, 5.0]
    assert kinds(items)[:4] == ["connected", "chunk", "lost", "restored"]


class BusOffBus(can.BusABC):
    """A controller that goes bus-off: its last messages, then errors of a network that is down."""

    def __init__(self, messages: list[can.Message], then: Callable[[], None]) -> None:
        self._messages, self._then = messages, then

    def recv(self, timeout: float | None = None) -> can.Message | None:
        if self._messages:
            return self._messages.pop(0)
        self._then()
        return None

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        raise AssertionError("a source sends nothing")

    def shutdown(self) -> None:
        pass


def test_a_bus_that_goes_off_and_returns_keeps_its_frames_and_its_errors() -> None:
    clock, stop, openings = ManualClock(0), threading.Event(), itertools.count(1)
    # SocketCAN's error class "bus off", as python-can hands it on.
    bus_off = can.Message(arbitration_id=0x40, is_error_frame=True, dlc=8, data=bytes(8))

    def is_down() -> None:
        raise OSError(errno.ENETDOWN, "Network is down")

    def open_bus() -> can.BusABC:
        number = next(openings)
        if number in (2, 3):  # `ip link set can0 up` is not done yet
            is_down()
        before = number == 1
        messages = [can.Message(arbitration_id=1 if before else 2)] + [bus_off] * before
        return BusOffBus(messages, is_down if before else stop.set)

    items = list(CanBusSource("can:can0", open_bus, clock, None).items(stop))
    assert kinds(items) == ["connected", "chunk", "lost", "retrying", "restored", "chunk"]
    assert [item.text for item in items if isinstance(item, LinkEvent)][1:3] == ["Network is down"] * 2
    frames = [frame for item in items if isinstance(item, BusFrames) for frame in unpack(item.data, item.host_ns)]
    assert [(frame.can_id, frame.is_error) for frame in frames] == [(1, False), (0x40, True), (2, False)]
    away = next(item for item in items if getattr(item, "kind", None) is LinkEventKind.RESTORED).details[0]
    assert away["away_s"] == pytest.approx(0.25 + 0.5 + 1.0)
