"""Live output as a page in a browser: one file of HTML, and a WebSocket for what it shows and asks for."""

from __future__ import annotations

import asyncio
import errno
import json
import math
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import CancelledError
from contextlib import suppress
from functools import cache
from typing import Any, Final

from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

from gateway.console.trend_history import TrendHistory
from gateway.core.errors import TreadlinkError
from gateway.core.estimates.results import SessionSnapshot
from gateway.core.links.reasons import LinkCode
from gateway.core.reasons import Reason
from gateway.core.shown_units import ShownUnits, shown_in
from gateway.core.text.page_parts import PageFile, joined_page, page_part
from gateway.core.text.session_control import SessionControl
from gateway.core.text.text import clean
from gateway.core.text.wording import text as reason_text
from gateway.publishing.page_listener import PageServer
from gateway.publishing.payloads import encoded
from gateway.publishing.sink import (
    Item,
    PublishedRevolution,
    PublishedState,
    Sink,
    SinkAddress,
    SinkDownError,
    SinkError,
    SinkSetting,
    cannot_listen,
    host_and_port,
)
from gateway.publishing.web_page.page_state import UNIT_NAMES, page_quantities, page_state, page_trend, page_waveform

PORT: Final = 8780
_PAGE: Final = "gateway.publishing.web_page"
_LONGEST_MARK: Final = 200
_TREND_S: Final = 1.0
_LAST_STATE_S: Final = 1.0


def open_page(address: SinkAddress, setting: SinkSetting) -> PageSink:
    """Return the page at `web://HOST[:PORT]`; only this computer can open that of 127.0.0.1, others need its token.

    Raises:
        SinkError: the address cannot be used, or its port is taken.
    """
    address.check_options(())
    host, port = host_and_port(address, PORT)
    if address.target.partition("/")[2]:
        raise SinkError(f"'{address.name}' has a path", "Write web://HOST:PORT.")
    return PageSink(host, port, setting.session)


@cache
def page_file() -> PageFile:
    """Return the page."""
    names = ("uPlot.min.css", "uPlot.iife.min.js", "pictures.js")
    sheets = [page_part(name, _PAGE) for name in ("page.css", "page.js")]
    return joined_page("page.html", _PAGE, [*map(page_part, names), *sheets])


class PageSink(Sink):
    """Serves the page to browsers.

    A thread with an event loop serves; the sink's own thread hands it the latest state and the revolutions. Each
    browser is sent what is newest when it has taken what came before, so a slow one misses states and holds nobody.

    Attributes:
        address: of the page, with its token where it listens wider than this computer.
    """

    def __init__(self, host: str, port: int, session: Callable[[], SessionControl | None]) -> None:
        """Take the port; port 0 lets the system choose one.

        Args:
            host: name or address to listen on.
            port: to listen on.
            session: returns what marks and recordings go to, None before it runs.

        Raises:
            SinkError: the port is taken, or the host is none of this computer's.
        """
        self._session = session
        try:
            self._server = PageServer(host, port, page_file, self._page)
        except OSError as error:
            raise SinkError(
                f"the page {cannot_listen(host, port, error)}",
                f"End the program that uses the port, or choose another one: --publish web://{host}:{port + 1}"
                if error.errno == errno.EADDRINUSE
                else "Choose a port from 1024 on, and an address of this computer: --publish web://127.0.0.1:8780",
            ) from error
        self._host, self.port, self.address = host, self._server.port, self._server.address
        self._history = TrendHistory()
        self._lock = threading.Lock()
        self._snapshot: SessionSnapshot | None = None
        self._pages: set[_Page] = set()
        self._marks, self._recordings = _Pace(5, 1.0), _Pace(4, 10.0)
        # Encoded once for all pages, by what they were made from.
        self._state: tuple[SessionSnapshot | None, bytes] = (None, b"")
        self._waveforms: dict[str, tuple[object, bytes]] = {}

    # The sink: all calls from its thread

    def open(self, stop: threading.Event) -> None:
        """Start serving."""
        try:
            is_up = self._server.start()
        except OSError as error:
            raise SinkDownError(cannot_listen(self._host, self.port, error)) from error
        if not is_up:
            raise SinkDownError("the server of the page does not start")

    def send(self, item: Item, stop: threading.Event) -> None:
        """Keep a revolution for the trends, and show a state on every page."""
        if isinstance(item, PublishedRevolution):
            with self._lock:
                self._history.add(item.result)
        elif isinstance(item, PublishedState):
            self._snapshot = item.snapshot
            self._server.call(self._wake)

    def flush(self, stop: threading.Event) -> int:
        """Give the pages a moment to take the last state; nothing is confirmed."""
        loop = self._server.loop
        if loop is not None and not stop.is_set():
            with suppress(CancelledError, TimeoutError, RuntimeError):
                asyncio.run_coroutine_threadsafe(self._all_taken(), loop).result(2 * _LAST_STATE_S)
        return 0

    def close(self) -> None:
        """Stop serving."""
        self._server.close()

    # With pages: all of it in the event loop

    async def _page(self, connection: ServerConnection) -> None:
        page = _Page(connection)
        self._pages.add(page)
        page.news.set()
        sender = asyncio.create_task(self._send_news(page))
        try:
            async for message in connection:
                await self._take(page, message)
        finally:
            self._pages.discard(page)
            sender.cancel()

    async def _send_news(self, page: _Page) -> None:
        """Send a page what is new since it took the last; it waits here while the page is slow."""
        loop = asyncio.get_running_loop()
        with suppress(ConnectionClosed):
            while True:
                await page.news.wait()
                page.news.clear()
                page.is_sending = True
                while page.replies:
                    await page.connection.send(page.replies.pop(0), text=True)
                snapshot = self._snapshot
                if snapshot is None:
                    page.is_sending = False
                    continue
                if page.state is not snapshot:
                    page.state = snapshot
                    await page.connection.send(self._encoded_state(snapshot), text=True)
                await self._send_waveform(page)
                if page.trend and loop.time() >= page.trend_due_s:
                    page.trend_due_s = loop.time() + _TREND_S
                    await self._send_trend(page)
                page.is_sending = False

    def _encoded_state(self, snapshot: SessionSnapshot) -> bytes:
        if self._state[0] is not snapshot:
            control = self._session()
            form = control.run_form if control is not None and control.may_record else None
            with shown_in(snapshot.units):
                state = page_state(snapshot, run_form=form)
            self._state = snapshot, encoded(state)
        return self._state[1]

    async def _send_waveform(self, page: _Page) -> None:
        snapshot = self._snapshot
        wheel = (
            next((candidate for candidate in snapshot.wheels if candidate.position == page.wheel), None)
            if snapshot
            else None
        )
        if wheel is None or page.waveform is wheel.last:
            return
        cached = self._waveforms.get(wheel.position)
        if cached is None or cached[0] is not wheel.last:
            waveform = page_waveform(wheel)
            cached = wheel.last, encoded(waveform) if waveform is not None else b""
            self._waveforms[wheel.position] = cached
        page.waveform = wheel.last
        if cached[1]:
            await page.connection.send(cached[1], text=True)

    async def _send_trend(self, page: _Page) -> None:
        units = self._snapshot.units if self._snapshot is not None else ShownUnits.SI
        if page.trend_units is not units:
            page.trend_units, page.trend_since_s = units, 0
        with self._lock, shown_in(units):
            quantities = page_quantities(self._history)
            trend = page_trend(self._history, page.trend, page.trend_since_s)
        times = [points[-1][0] for points in trend["wheels"].values() if points]
        # The last second may still get another revolution.
        page.trend_since_s = max(times, default=page.trend_since_s)
        if quantities["quantities"] != page.quantities:
            page.quantities = quantities["quantities"]
            await page.connection.send(encoded(quantities), text=True)
        await page.connection.send(encoded(trend), text=True)

    async def _take(self, page: _Page, message: str | bytes) -> None:
        """Carry out what a page asks for: what to show, a mark, alarms seen, units, the recording's start or end."""
        try:
            request: Any = json.loads(message)
        except (ValueError, RecursionError):
            request = None
        if not isinstance(request, dict):
            return
        if isinstance(request.get("wheel"), str):
            page.wheel, page.waveform = request["wheel"], None
        if isinstance(request.get("trend"), str):
            page.trend, page.trend_due_s = request["trend"], -math.inf
            page.trend_since_s = 0
        if isinstance(request.get("mark"), str):
            text = clean(request["mark"].strip())[:_LONGEST_MARK] or "mark"
            mark, details = Reason(LinkCode.MARK, text=text), (Reason(LinkCode.MARK_NOT_KEPT),)
            failure = reason_text(Reason(LinkCode.LINK_EVENT, event=mark, details=details))
            await self._control(
                page, lambda control: "" if control.mark(text) else failure, f"mark set: {text}", self._marks
            )
        if request.get("acknowledge") is True:
            await self._control(page, lambda control: control.acknowledge(), "alarms acknowledged", self._marks)
        if request.get("units") in list(ShownUnits):
            units = ShownUnits(request["units"])
            await self._control(
                page, lambda control: control.show_in(units), f"units: {UNIT_NAMES[units]}", self._marks
            )
        if isinstance(request.get("record"), bool):
            is_start, run = request["record"], request.get("run")
            fields = run.items() if isinstance(run, dict) else ()
            form = {str(name): clean(value) for name, value in fields if isinstance(value, str)}
            await self._control(
                page,
                lambda control: control.start_recording(form) if is_start else control.stop_recording(),
                "recording started" if is_start else "recording finished",
                self._recordings,
            )
        page.news.set()

    async def _control(self, page: _Page, call: Callable[[SessionControl], str | None], done: str, pace: _Pace) -> None:
        """Ask the session for something that may wait for its disk, and say on the page what became of it.

        Args:
            page: who asks.
            call: does it, and returns what is to be said in place of `done`.
            done: what is said.
            pace: how often that is admitted.
        """
        control = self._session()
        try:
            if not pace.admits(asyncio.get_running_loop().time()):
                raise TreadlinkError(f"more than {pace.most} in {pace.within_s:g} s", "Wait a moment.")
            if control is None:
                raise TreadlinkError("the session has not begun")
            reply = await asyncio.to_thread(call, control)
            done = reply or done
        except TreadlinkError as error:
            done = f"{error}. {error.remedy}" if error.remedy else str(error)
        page.replies.append(encoded({"type": "said", "text": clean(done)}))

    def _wake(self) -> None:
        for page in self._pages:
            page.news.set()

    async def _all_taken(self) -> None:
        """Wait until no page has anything to take, for a moment at most."""
        with suppress(TimeoutError):
            async with asyncio.timeout(_LAST_STATE_S):
                while any(page.is_sending or page.state is not self._snapshot for page in self._pages):
                    await asyncio.sleep(0.01)


class _Pace:
    """How often all pages together may ask for something: so many times within a time."""

    def __init__(self, most: int, within_s: float) -> None:
        self.most, self.within_s = most, within_s
        self._times_s: deque[float] = deque(maxlen=most)

    def admits(self, now_s: float) -> bool:
        """Return whether it may be asked for now, and count it."""
        if len(self._times_s) == self.most and now_s - self._times_s[0] < self.within_s:
            return False
        self._times_s.append(now_s)
        return True


class _Page:
    """A browser with the page open."""

    def __init__(self, connection: ServerConnection) -> None:
        self.connection = connection
        self.news = asyncio.Event()
        self.replies: list[bytes] = []
        self.is_sending = False
        self.state: SessionSnapshot | None = None
        self.wheel = ""
        self.waveform: object = None
        self.trend = ""
        self.trend_since_s = 0
        self.trend_due_s = 0.0
        self.trend_units = ShownUnits.SI
        self.quantities: list[Any] = []
