"""One recording as the viewer shows it: samples, revolutions and orders of any part, read as they are needed."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from copy import copy
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.messages import Hello, MessageType
from gateway.core.errors import RecordingError
from gateway.core.estimates.results import RevolutionResult
from gateway.core.recording.reader import RecordingReader
from gateway.core.session.recording_pass import OpenedRecording, open_recording
from gateway.core.session.session_parts import default_key_file
from gateway.core.session.wheel_identity import positions
from gateway.core.text.wording import text
from gateway.core.types import FloatArray
from gateway.core.wheels.revolution import SensorReading
from gateway.exporting.recorded_signals import revolutions, sample_blocks
from gateway.viewer.chunk_index import RecordedPart, chunk_index
from gateway.viewer.level_cache import Arrays, content_key, store, stored
from gateway.viewer.order_waterfall import OrderColumns, magnitudes
from gateway.viewer.rolled_revolutions import RolledRevolutions
from gateway.viewer.sample_levels import Envelope, SampleLevels, SampleTimes

_logger = logging.getLogger(__name__)

LONGEST_PART_S: Final = 40.0
"""Part of a recording whose samples are read from the file; a longer one is shown by its bins."""
_GLANCES: Final = 256
# Before the part: a sensor's description comes every 2 s; one that comes late is searched further back.
_LEADS_S: Final = (3.0, 30.0)
# Samples arrive after they were taken.
_DELAY_S: Final = 1.0
# A revolution is found by the contacts before and behind it.
_AROUND_S: Final = 4.0
# Revolutions are found in blocks, so that a step to the next one reads nothing.
_BLOCK_S: Final = 4.0
_BLOCKS_KEPT: Final = 2
_LONGEST_ORDERS_S: Final = 20.0
_READING, _ESTIMATING, _DONE = "reading the samples", "estimating the revolutions", ""


class Progress(NamedTuple):
    """Of the work on a recording: what is done, empty at the end; its share; why it ended early."""

    stage: str
    share: float
    fault: str = ""


class _StoppedError(Exception):
    """Nobody waits for the recording any more."""


class RecordingView:
    """A recording, what is known of it so far, and its parts.

    Attributes:
        begin_ns: time from which all times count, ns since the epoch.
        rolled: its revolutions, orders and pictures.
    """

    def __init__(self, path: Path, config_path: Path | None = None, key_file: Path | None = None) -> None:
        """Read the index of a recording.

        Raises:
            RecordingError: it cannot be read, or has nothing in it.
            ConfigError: the configuration cannot be read.
        """
        self._reader = RecordingReader(path)
        self._index = chunk_index(path)
        if not len(self._index.offset):
            raise RecordingError(
                f"'{path}' has no message in a chunk", f"`treadlink repair '{path}'` recovers what it has."
            )
        self.path = path
        self._opened = open_recording(self._reader, config_path, key_file=key_file)
        begin_ns, start_ns = int(self._index.begin_ns.min()), self._reader.info.start_ns
        # As on the page of a drive: from the start of the session.
        self.begin_ns = begin_ns if start_ns is None else min(begin_ns, start_ns)
        self.span_s = max(float(self._index.end_ns.max() - self.begin_ns) * 1e-9, 1e-3)
        self._levels = SampleLevels.over(self.span_s)
        self._times = SampleTimes()
        self.rolled = RolledRevolutions(self.span_s)
        self.progress = Progress(_READING, 0.0)
        self._read_s = 0.0
        self._blocks: dict[int, list[tuple[float, RevolutionResult]]] = {}

    @property
    def wheels(self) -> list[str]:
        """Positions so far, configured ones first."""
        names = list(self._levels.wheels)
        configured = list(positions(self._opened.vehicle).values())
        return sorted(names, key=lambda wheel: (configured.index(wheel) if wheel in configured else len(names), wheel))

    def glance(self) -> None:
        """Look at chunks over the whole recording, so that there is a first picture of it."""
        configured = positions(self._opened.vehicle)
        count = len(self._index.offset)
        spread = np.linspace(0, count - 1, min(_GLANCES, count)).astype(int)
        first = self._index.between(self.begin_ns, self.begin_ns + round(_LEADS_S[0] * 1e9))
        readings: dict[tuple[int, int], SensorReading] = {}
        for _, batch, arrivals_ns in self._part(np.union1d(first, spread)).verified_blocks():
            for frame in np.flatnonzero(batch.type == MessageType.HELLO).tolist():
                hello = batch.message(frame)
                assert isinstance(hello, Hello)
                readings[int(batch.hub[frame]), int(batch.wheel[frame])] = SensorReading.from_hello(hello)
            for group in batch.sample_groups():
                source = group.hub, group.wheel
                reading = readings.get(source)
                if reading is None or group.counts.shape[2] != len(reading.columns):
                    continue
                time_s = self._since(arrivals_ns[group.frame_index])
                for extremes in (group.counts.min(axis=1), group.counts.max(axis=1)):
                    samples = np.full((len(extremes), 3), np.nan)
                    samples[:, reading.columns] = reading.samples_mps2(extremes)
                    self._levels.add(configured.get(source, "hub{}.wheel{}".format(*source)), time_s, samples)

    def complete(self, is_stopped: Callable[[], bool]) -> None:
        """Take what the cache has of the recording, else read all of it and store that.

        Raises:
            TreadlinkError: the recording or what belongs to it cannot be read.
        """
        key = content_key(self.path, self._index, self._setting())
        arrays = stored(key)
        if arrays is None or not self._restore(arrays):
            try:
                self._read(is_stopped)
            except _StoppedError:
                return
            # One that is being written has another content next time.
            if not self._reader.info.in_progress:
                tables = {f"times {wheel}": table for wheel, table in self._times.tables.items()}
                store(key, {**self._levels.arrays(), **self.rolled.arrays(), **tables})
        self.progress = Progress(_DONE, 1.0, text(self._reader.damage) if self._reader.damage is not None else "")

    def _setting(self) -> str:
        vehicle, key_file = self._opened.vehicle, self._opened.key_file or default_key_file()
        keys = key_file.read_bytes() if self._opened.guard() is not None and key_file.exists() else b""
        return f"{vehicle and vehicle.to_toml()} {self._opened.signals().dbc_text} {keys.hex()}"

    def _restore(self, arrays: Arrays) -> bool:
        levels, rolled = SampleLevels.over(self.span_s), RolledRevolutions(self.span_s)
        try:
            levels.restore(arrays)
            rolled.restore(arrays)
        except (KeyError, ValueError) as error:
            _logger.warning("what the cache has of %s is not whole, and is made again: %s", self.path, error)
            return False
        prefix = "times "
        self._times = SampleTimes({name[len(prefix) :]: arrays[name] for name in arrays if name.startswith(prefix)})
        self._levels, self.rolled, self._read_s = levels, rolled, math.inf
        return True

    def _read(self, is_stopped: Callable[[], bool]) -> None:
        size = max(self._reader.info.size_bytes, 1)

        def watched(stage: str) -> OpenedRecording:
            def show(position: int) -> None:
                if is_stopped():
                    raise _StoppedError
                self.progress = Progress(stage, position / size)

            # One that is being written is read as far as its bins reach.
            part = self._part(np.arange(len(self._index.offset))) if self._reader.info.in_progress else self._opened
            return replace(part, file=copy(part.file), on_position=show)

        times = SampleTimes()
        for block in sample_blocks(watched(_READING)):
            time_s = self._since(block.host_time_ns)
            self._levels.add(block.wheel, time_s, block.axes_mps2, block.lost_before)
            times.add(block, time_s)
            self._read_s = max(self._read_s, float(time_s[0]))
        times.finish()
        self._times, self._read_s = times, math.inf
        self.rolled.read(watched(_ESTIMATING), self.begin_ns)

    def samples(self, begin_s: float, end_s: float, columns: int) -> dict[str, Envelope]:
        """Return the samples of every wheel from one time to another; single ones of a short part, from the file.

        Raises:
            RecordingError: the file cannot be read.
        """
        if end_s - begin_s > LONGEST_PART_S:
            envelopes = {wheel: self._levels.envelope(wheel, begin_s, end_s, columns) for wheel in self.wheels}
            # Where the file has not been read yet, its bins have a sample here and there, and no gaps.
            return {wheel: self._without_holes(envelope) for wheel, envelope in envelopes.items()}
        for lead_s in _LEADS_S:
            result = self._exact(begin_s, end_s, columns, lead_s)
            if set(result) >= set(self.wheels):
                break
        return result

    def _without_holes(self, envelope: Envelope) -> Envelope:
        is_complete = (envelope.time_s < self._read_s) | np.isfinite(envelope.low).any(axis=1)
        return Envelope(*(part[is_complete] for part in envelope))

    def _exact(self, begin_s: float, end_s: float, columns: int, lead_s: float) -> dict[str, Envelope]:
        bins = SampleLevels(begin_s, max(end_s - begin_s, 1e-6) / columns, columns)
        single: dict[str, list[tuple[FloatArray, FloatArray, int]]] = {}
        counts: dict[str, int] = {}
        for block in sample_blocks(self._part(self._chosen(begin_s - lead_s, end_s + _DELAY_S))):
            time_s = self._times.dated(block, self._since(block.host_time_ns))
            inside = slice(*np.searchsorted(time_s, (begin_s, end_s)))
            time_s, axes = time_s[inside], block.axes_mps2[inside]
            if not len(time_s):
                continue
            lost = block.lost_before if inside.start == 0 else 0
            bins.add(block.wheel, time_s, axes, lost)
            counts[block.wheel] = counts.get(block.wheel, 0) + len(time_s)
            if counts[block.wheel] <= 2 * columns:
                single.setdefault(block.wheel, []).append((time_s, axes, lost))
        result = {}
        for wheel, count in counts.items():
            if count > 2 * columns:
                result[wheel] = bins.envelope(wheel, begin_s, end_s, columns)
                continue
            blocks = single[wheel]
            values, lost_before = np.concatenate([axes for _, axes, _ in blocks]), np.zeros(count)
            lost_before[np.cumsum([0, *(len(axes) for _, axes, _ in blocks[:-1])])] = [lost for _, _, lost in blocks]
            result[wheel] = Envelope(np.concatenate([time_s for time_s, _, _ in blocks]), values, values, lost_before)
        return result

    def revolution(self, wheel: str, time_s: float) -> tuple[RevolutionResult, float, int | None] | None:
        """Return the revolution of a wheel that a time is in, its end and its number; None where there is none near.

        The number is None while it is not known.

        Raises:
            RecordingError: the file cannot be read.
        """
        results = [row for row in self._around(math.floor(time_s / _BLOCK_S)) if row[1].position == wheel]
        if not results:
            return None
        # A time is in the revolution whose end follows it; ends are known to some milliseconds.
        slack_s = 0.25 * results[0][1].revolution.period_s
        candidates = [row for row in results if row[0] >= time_s - slack_s] or results[-1:]
        end_s, result = min(candidates, key=lambda row: row[0])
        return result, end_s, self.rolled.number(wheel, result.revolution.start_s, end_s)

    def _around(self, number: int) -> list[tuple[float, RevolutionResult]]:
        """Return end and result of the revolutions of all wheels in a block of the recording, and some about it."""
        if number not in self._blocks:
            begin_s, end_s = number * _BLOCK_S, (number + 1) * _BLOCK_S
            for lead_s in (_AROUND_S, _LEADS_S[-1]):
                rows = self._revolutions(begin_s - lead_s, end_s + _AROUND_S)
                if rows:
                    break
            while len(self._blocks) >= _BLOCKS_KEPT:
                self._blocks.pop(next(iter(self._blocks)), None)
            self._blocks[number] = rows
        return self._blocks[number]

    def _revolutions(self, begin_s: float, end_s: float) -> list[tuple[float, RevolutionResult]]:
        part = self._part(self._chosen(begin_s, end_s))
        return [((result.host_ns - self.begin_ns) * 1e-9, result) for result in revolutions(part)]

    def orders(
        self, wheel: str, axis: int, begin_s: float, end_s: float, *, is_over_speed: bool
    ) -> OrderColumns | None:
        """Return the amplitudes of a wheel's orders: of each revolution of a short part, else of the whole recording.

        Raises:
            RecordingError: the file cannot be read.
        """
        if is_over_speed or end_s - begin_s > _LONGEST_ORDERS_S:
            return self.rolled.columns(wheel, axis, is_over_speed=is_over_speed)
        rows = [
            (time_s, magnitudes(result.revolution)[axis])
            for time_s, result in self._revolutions(begin_s - _AROUND_S, end_s + _AROUND_S)
            if begin_s <= time_s <= end_s and result.position == wheel and not result.revolution.faults
        ]
        return OrderColumns(np.array([row[0] for row in rows]), 0.0, np.array([row[1] for row in rows]))

    def _chosen(self, begin_s: float, end_s: float) -> NDArray[np.intp]:
        begin_ns, end_ns = (self.begin_ns + round(time_s * 1e9) for time_s in (begin_s, end_s))
        return self._index.between(begin_ns, end_ns)

    def _part(self, chosen: NDArray[np.intp]) -> OpenedRecording:
        return replace(self._opened, file=RecordedPart(self.path, self._index, chosen))

    def _since(self, times_ns: NDArray[np.int64]) -> FloatArray:
        return np.array((times_ns - self.begin_ns) * 1e-9, np.float64)
