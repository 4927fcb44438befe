"""Server of the viewer: answers what its page asks of the recordings, and reads them meanwhile."""

from __future__ import annotations

import asyncio
import errno
import json
import logging
import math
import threading
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any, Final

import numpy as np
from websockets.asyncio.server import ServerConnection

from gateway.core.errors import TreadlinkError
from gateway.core.text.page_parts import PageFile, joined_page, page_part
from gateway.core.text.text import clean
from gateway.core.text.wording import joined
from gateway.core.types import FloatArray
from gateway.publishing.page_listener import PageServer
from gateway.publishing.payloads import encoded
from gateway.publishing.sink import cannot_listen
from gateway.viewer.recording_view import RecordingView

_logger = logging.getLogger(__name__)

# Work for all pages at once: each takes a processor and the memory of a part.
_AT_ONCE: Final = 2
_MAX_COLUMNS: Final = 4000
_DIGITS: Final = 3
_VIEW_PAGE: Final = "gateway.viewer.view_page"
_KMH: Final = 3.6


@lru_cache(maxsize=1)
def page_file() -> PageFile:
    """Return the page."""
    views = "gateway.compare.views"
    parts = [
        *map(page_part, ("uPlot.min.css", "uPlot.iife.min.js", "pictures.js")),
        page_part("result_page.css"),
        *(page_part(f"drive_section.{suffix}", views) for suffix in ("css", "js")),
        *(page_part(f"viewer.{suffix}", _VIEW_PAGE) for suffix in ("css", "js")),
    ]
    return joined_page("viewer.html", _VIEW_PAGE, parts)


class ViewServer:
    """Serves recordings to browsers; a thread reads them, one after the other."""

    def __init__(self, host: str, port: int, recordings: Sequence[RecordingView], *, may_move: bool) -> None:
        """Take the port; another one where it is taken and that does.

        Raises:
            TreadlinkError: the port is taken, or the host is none of this computer's.
        """
        try:
            try:
                self._server = PageServer(host, port, page_file, self._talk)
            except OSError as error:
                if not may_move or error.errno != errno.EADDRINUSE:
                    raise
                self._server = PageServer(host, 0, page_file, self._talk)
        except OSError as error:
            raise TreadlinkError(
                f"the page {cannot_listen(host, port, error)}",
                "Give another address of this computer, or another port.",
            ) from error
        self.address = self._server.address
        self._recordings = recordings
        self._faults = [""] * len(recordings)
        self._stop = threading.Event()
        self._slots = asyncio.Semaphore(_AT_ONCE)
        self._reader = threading.Thread(target=self._read_recordings, name="reader of recordings", daemon=True)

    def start(self) -> None:
        """Start serving and reading."""
        self._reader.start()
        if not self._server.start():
            raise TreadlinkError("the server of the page does not start")

    def close(self) -> None:
        """Stop serving and reading."""
        self._stop.set()
        self._server.close()
        self._reader.join()

    def _read_recordings(self) -> None:
        for work in (RecordingView.glance, lambda view: view.complete(self._stop.is_set)):
            for number, view in enumerate(self._recordings):
                if self._stop.is_set() or self._faults[number]:
                    continue
                try:
                    work(view)
                except TreadlinkError as error:
                    self._faults[number] = _error_text(error)
                except Exception as error:
                    _logger.exception("reading %s failed", view.path)
                    self._faults[number] = f"reading it failed: {error}"

    async def _talk(self, connection: ServerConnection) -> None:
        async for message in connection:
            async with self._slots:
                reply = await asyncio.to_thread(self._reply, message)
            await connection.send(reply, text=True)

    def _reply(self, message: str | bytes) -> bytes:
        """Return the answer to a message, an error where the message is not a valid question."""
        number: object = None
        try:
            question = json.loads(message)
            number = question["id"]
            if not isinstance(number, int):
                raise TypeError("an answer has a number")
            answers: Mapping[str, Callable[[Mapping[str, Any]], dict[str, Any]]] = {
                "state": self._state,
                "pictures": self._pictures,
                "samples": self._samples,
                "revolution": self._revolution,
                "orders": self._orders,
            }
            return encoded({"id": number, **answers[question["ask"]](question)})
        except (ValueError, TypeError, KeyError, IndexError, OverflowError, RecursionError) as error:
            _logger.debug("invalid question of a page: %r", error)
            answered = number if isinstance(number, int) else 0
            return encoded({"id": answered, "error": "The question of the page is not valid."})
        except TreadlinkError as error:
            return encoded({"id": number, "error": _error_text(error)})

    def _view(self, question: Mapping[str, Any]) -> RecordingView:
        number = question["recording"]
        if not isinstance(number, int) or number < 0:
            raise TypeError("no number of a recording")
        return self._recordings[number]

    def _state(self, _: Mapping[str, Any]) -> dict[str, Any]:
        """Return what is known of the recordings so far."""
        return {
            "recordings": [
                {
                    "name": clean(view.path.name),
                    "span": round(view.span_s, 6),
                    "begin_ms": view.begin_ns // 10**6,
                    "wheels": [clean(wheel) for wheel in view.wheels],
                    "stage": view.progress.stage,
                    "share": round(view.progress.share, 3),
                    "fault": clean(fault or view.progress.fault),
                    "has_pictures": view.rolled.pictures is not None,
                }
                for view, fault in zip(self._recordings, self._faults, strict=True)
            ]
        }

    def _pictures(self, question: Mapping[str, Any]) -> dict[str, Any]:
        return {"pictures": self._view(question).rolled.pictures}

    def _samples(self, question: Mapping[str, Any]) -> dict[str, Any]:
        """Return the samples of all wheels and axes in a part."""
        columns = min(max(int(question["columns"]), 2), _MAX_COLUMNS)
        envelopes = self._view(question).samples(*_part(question), columns)
        return {
            "wheels": {
                clean(wheel): {
                    "t": np.round(envelope.time_s, 7).tolist(),
                    "low": [_numbers(axis) for axis in envelope.low.T],
                    "high": [_numbers(axis) for axis in envelope.high.T],
                    "lost": [
                        [round(float(time_s), 3), int(lost)]
                        for time_s, lost in zip(envelope.time_s, envelope.lost, strict=True)
                        if lost
                    ],
                }
                for wheel, envelope in envelopes.items()
            }
        }

    def _revolution(self, question: Mapping[str, Any]) -> dict[str, Any]:
        """Return the revolution of a wheel that a time is in, or that has a number."""
        view, wheel, time_s = (
            self._view(question),
            _wheel(self._view(question), question),
            float(question.get("time", 0.0)),
        )
        if "number" in question:
            known_s = view.rolled.time_s(wheel, int(question["number"]))
            if known_s is None:
                raise TreadlinkError(f"{wheel} has no revolution {int(question['number'])} so far")
            time_s = known_s
        elif not math.isfinite(time_s):
            raise ValueError("no time")
        located = view.revolution(wheel, time_s)
        if located is None:
            return {"revolution": None}
        result, end_s, number = located
        revolution = result.revolution
        count = revolution.axes_mps2.shape[1]
        return {
            "revolution": {
                "wheel": clean(wheel),
                "number": number,
                "begin": round(end_s - revolution.period_s, 6),
                "end": round(end_s, 6),
                "speed_kmh": round(_KMH * revolution.omega_radps * result.conditions.radius_m, 2),
                "angle": np.round(np.degrees(2.0 * np.pi * np.arange(count) / count - np.pi), 3).tolist(),
                "axes": [_numbers(axis) for axis in revolution.axes_mps2],
                "edges": _numbers(np.degrees([revolution.leading_edge_rad, revolution.trailing_edge_rad])),
                "faults": clean(joined(revolution.faults)),
            }
        }

    def _orders(self, question: Mapping[str, Any]) -> dict[str, Any]:
        view, axis, is_over_speed = self._view(question), int(question["axis"]), question["over"] == "speed"
        if axis not in range(3):
            raise IndexError("no axis")
        columns = view.orders(_wheel(view, question), axis, *_part(question), is_over_speed=is_over_speed)
        if columns is None or not len(columns.x):
            return {"x": [], "width": 0.0, "orders": []}
        factor = _KMH if is_over_speed else 1.0
        return {
            "x": np.round(factor * columns.x, 4).tolist(),
            "width": round(factor * columns.width, 6),
            "orders": [_numbers(row) for row in columns.orders_mps2],
        }


def _part(question: Mapping[str, Any]) -> tuple[float, float]:
    begin_s, end_s = float(question["begin"]), float(question["end"])
    if not (math.isfinite(begin_s) and math.isfinite(end_s) and begin_s < end_s):
        raise ValueError("no part of a recording")
    return begin_s, end_s


def _wheel(view: RecordingView, question: Mapping[str, Any]) -> str:
    wheels = {clean(wheel): wheel for wheel in view.wheels}
    return wheels[question["wheel"]]


def _numbers(values: FloatArray) -> list[float | None]:
    """Return numbers as JSON takes them: None where they are not finite."""
    rounded = np.round(np.asarray(values, np.float64), _DIGITS)
    return [value if math.isfinite(value) else None for value in rounded.tolist()]


def _error_text(error: TreadlinkError) -> str:
    return clean(f"{error}. {error.remedy}" if error.remedy else str(error))
