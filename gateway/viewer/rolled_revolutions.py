"""What one pass of the estimates over a recording leaves for the viewer: revolutions, orders, quantities, events."""

from __future__ import annotations

import json
from array import array
from typing import Any, Final

import numpy as np

from gateway.compare.views.drive import Drive
from gateway.compare.views.drive_pictures import pictures_json
from gateway.compare.views.drive_verdict import verdict
from gateway.core.estimates.registry import DEFAULT_ESTIMATORS
from gateway.core.session.recording_pass import OpenedRecording, RecordingPass
from gateway.core.types import FloatArray
from gateway.viewer.level_cache import Arrays
from gateway.viewer.order_waterfall import OrderColumns, OrderWaterfall, magnitudes

_FIELDS: Final = 3
# Time after which the ticks of a hub's clock begin again.
_WRAP_S: Final = 2.0**32 * 1e-6


class RolledRevolutions:
    """Revolutions of all wheels by number and time, their orders, and the pictures of the drive.

    Attributes:
        pictures: what the pictures of a drive are drawn from, with `summary` and `actions`; None before the end.
    """

    def __init__(self, span_s: float) -> None:
        """Start without a revolution, for a recording of a length."""
        self._span_s = span_s
        self.pictures: dict[str, Any] | None = None
        self._rows: dict[str, array[float]] = {}
        self._tables: dict[str, FloatArray] = {}
        self._orders: dict[str, OrderWaterfall] = {}

    def read(self, recording: OpenedRecording, origin_ns: int) -> None:
        """Estimate a recording whose times count from `origin_ns`.

        Raises:
            TreadlinkError: the recording or what belongs to it cannot be read.
        """
        drive = Drive.of(recording.file)
        estimation = RecordingPass(recording, DEFAULT_ESTIMATORS, signals=recording.signals(), logs_alarms=False)
        for result in estimation:
            drive.add(result)
            time_s, revolution = (result.host_ns - origin_ns) * 1e-9, result.revolution
            rows = self._rows.get(result.position)
            if rows is None:
                rows = self._rows[result.position] = array("d")
                self._orders[result.position] = OrderWaterfall(self._span_s)
            rows.extend((time_s, revolution.start_s, revolution.index))
            if not revolution.faults:
                speed_mps = revolution.omega_radps * result.conditions.radius_m
                self._orders[result.position].add(time_s, speed_mps, magnitudes(revolution))
        notices = estimation.notices(list(drive.wheels))
        drive.finish(estimation.wheels, estimation.alarms(), (*notices, *estimation.missing()))
        first = verdict(drive, origin_ns, origin_ns + round(self._span_s * 1e9))
        pictures = {**pictures_json(drive, first.events, origin_ns), "summary": first.summary, "actions": first.actions}
        for position in self._rows:
            self._tables[position] = self._table(position)
        self.pictures = pictures

    def _table(self, wheel: str) -> FloatArray:
        """Return end time, hub time of the begin and number of each revolution, (3, n)."""
        rows = self._rows.get(wheel, ())  # copied below in one step: `read` cannot extend rows that numpy holds
        return self._tables[wheel] if wheel in self._tables else np.asarray(rows[:]).reshape(-1, _FIELDS).T

    def time_s(self, wheel: str, number: int) -> float | None:
        """Return the end time of the revolution with a number, or of the next one there is; None after the last."""
        table = self._table(wheel)
        row = int(np.searchsorted(table[2], number))
        return float(table[0, row]) if row < table.shape[1] else None

    def number(self, wheel: str, start_s: float, time_s: float) -> int | None:
        """Return the number of the revolution that begins at a time of the hub's clock, and ends near a time."""
        table = self._table(wheel)
        nearby = slice(*np.searchsorted(table[0], (time_s - 2.0, time_s + 2.0)))
        offsets_s = np.abs((table[1, nearby] - start_s + 0.5 * _WRAP_S) % _WRAP_S - 0.5 * _WRAP_S)
        if not offsets_s.size or offsets_s.min() > 0.01:
            return None
        return int(table[2, nearby][int(offsets_s.argmin())])

    def columns(self, wheel: str, axis: int, *, is_over_speed: bool) -> OrderColumns | None:
        """Return the orders of a wheel, None before its first revolution."""
        orders = self._orders.get(wheel)
        return None if orders is None else orders.columns(axis, is_over_speed=is_over_speed)

    def arrays(self) -> Arrays:
        """Return all that it has learnt, after the end."""
        return {
            "pictures": np.frombuffer(json.dumps(self.pictures).encode(), np.uint8),
            **{f"revolutions {wheel}": table for wheel, table in self._tables.items()},
            **{f"orders {wheel}": orders.learnt for wheel, orders in self._orders.items()},
        }

    def restore(self, arrays: Arrays) -> None:
        """Take what `arrays` returned; ValueError where it is not whole."""
        for name, values in arrays.items():
            kind, _, wheel = name.partition(" ")
            if kind == "revolutions":
                self._tables[wheel] = values
            elif kind == "orders":
                self._orders[wheel] = OrderWaterfall(self._span_s, values)
        self.pictures = json.loads(arrays["pictures"].tobytes())
