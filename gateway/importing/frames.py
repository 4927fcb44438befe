"""Conversion of a measurement into the frames a hub would have sent, in chunks as a link would deliver them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_protocol import wire
from firmware_protocol.codec import encode_frame
from firmware_protocol.declaration import SAMPLES
from firmware_protocol.messages import Environment, Frame, Hello, Message, MessageType, SampleBlock
from gateway.core.errors import ImportDataError
from gateway.core.types import FloatArray
from gateway.importing.data_scan import WheelScan
from gateway.importing.import_map import PRESSURE_UNITS_PA, ImportedWheel, Sensor

CHUNK_S: Final = 0.01
NEVER_SATURATED_COUNTS: Final = wire.MAX_SATURATION_COUNTS
FULL_SCALE_COUNTS: Final = 32767
"""Counts of a stated full scale, at and above which samples are saturated."""
# An axis that never exceeds this is dead; its scale must still be a number.
_ZERO_MPS2: Final = 1e-12


@dataclass(frozen=True, slots=True)
class Quantiser:
    """Conversion of accelerations into counts.

    Attributes:
        scale_mps2: (axes,) m/s^2 per count, exactly as in the hello.
        saturation_counts: as in the hello.
    """

    scale_mps2: FloatArray
    saturation_counts: int

    @staticmethod
    def of(wheel: ImportedWheel, wheel_scan: WheelScan) -> Quantiser:
        """Return a quantiser with the range of the stated full scale, or else the range that each axis just fills."""
        axes = wheel.axis.present()
        has_full_scale = any(column.full_scale is not None for column in axes.values())
        top_counts = FULL_SCALE_COUNTS - 1 if has_full_scale else 32767
        scales = []
        for axis, column in axes.items():
            peak_mps2 = max(abs(wheel_scan.low_mps2[axis]), abs(wheel_scan.high_mps2[axis]))
            if column.full_scale_mps2 is not None:
                scales.append(column.full_scale_mps2 / FULL_SCALE_COUNTS)
            else:
                scales.append((peak_mps2 if peak_mps2 > _ZERO_MPS2 else 1.0) / top_counts)
        return Quantiser(
            scale_mps2=np.array(scales, dtype=np.float32).astype(np.float64),
            saturation_counts=FULL_SCALE_COUNTS if has_full_scale else NEVER_SATURATED_COUNTS,
        )

    def counts(self, values_mps2: FloatArray) -> tuple[NDArray[np.int16], FloatArray]:
        """Return (n, axes) counts, and the (axes,) largest quantisation error of unclipped samples in m/s^2.

        Args:
            values_mps2: (n, axes) finite values, n at least 1.
        """
        rounded = np.rint(values_mps2 / self.scale_mps2)
        clipped = np.clip(rounded, -32767, 32767)
        errors_mps2 = np.where(clipped == rounded, np.abs(clipped * self.scale_mps2 - values_mps2), 0.0)
        return clipped.astype(np.int16), errors_mps2.max(axis=0)


class FrameStream:
    """Builder of frames from blocks of rows; rows that do not fill a chunk wait for the next block."""

    def __init__(
        self,
        sensor: Sensor,
        wheel: ImportedWheel,
        number: int,
        rate_hz: float,
        quantiser: Quantiser,
        begin_s: float = 0.0,
    ) -> None:
        """Prepare the hello.

        Args:
            sensor: sensor as the map states it.
            wheel: wheel as the map states it.
            number: number of the wheel at the hub.
            rate_hz: sampling rate.
            quantiser: conversion of its axes.
            begin_s: time of the first sample by the hub's clock.
        """
        axes = wheel.axis.present()
        self._mask = sum(1 << axis for axis in axes)
        self._wheel = number
        self._rate_hz = rate_hz
        self._begin_us = begin_s * 1e6
        self._hello = _hello(sensor, wheel, number, rate_hz, quantiser)
        self._block_samples = (wire.MAX_PAYLOAD_BYTES - SAMPLES.size) // (2 * len(axes))
        self._chunk_samples = max(1, round(CHUNK_S * rate_hz / self._block_samples)) * self._block_samples
        self._pressure_pa = PRESSURE_UNITS_PA[wheel.environment.pressure_unit]
        self._counts = np.empty((0, len(axes)), dtype=np.int16)
        self._present = np.empty(0, dtype=np.bool_)
        self._slow = np.empty((0, 2))
        self._sample = 0
        self._seq = 0
        self._next_hello = 0
        self._next_environment = 0
        self.environment_frames = 0

    @property
    def end_s(self) -> float:
        """End of the last sample returned, in s from the first sample."""
        return self._sample / self._rate_hz

    def chunks(
        self, counts: NDArray[np.int16], present: NDArray[np.bool_], slow: FloatArray, *, last: bool = False
    ) -> Iterator[tuple[float, bytes]]:
        """Yield (end of its last sample in s, bytes) of each complete chunk; with `last`, of all that remain.

        Args:
            counts: (n, axes) samples.
            present: (n,) whether there is a sample; gaps are not sent, but numbered.
            slow: (n, 2) pressure in the map's unit and temperature in degC, NaN where not measured.
            last: whether these are the last samples.
        """
        self._counts = np.concatenate((self._counts, counts))
        self._present = np.concatenate((self._present, present))
        self._slow = np.concatenate((self._slow, slow))
        done, total = 0, len(self._counts)
        while total - done >= self._chunk_samples or (last and done < total):
            stop = min(done + self._chunk_samples, total)
            data = self._chunk(self._counts[done:stop], self._present[done:stop], self._slow[done:stop])
            done = stop
            if data:
                yield self.end_s, data
        # Copies: a view would keep the whole block alive.
        self._counts, self._slow = self._counts[done:].copy(), self._slow[done:].copy()
        self._present = self._present[done:].copy()

    def _chunk(self, counts: NDArray[np.int16], present: NDArray[np.bool_], slow: FloatArray) -> bytes:
        parts = []
        if self._sample >= self._next_hello:
            parts.append(self._frame(MessageType.HELLO, self._hello))
            self._next_hello = self._sample + round(wire.HELLO_PERIOD_S * self._rate_hz)
        if self._sample >= self._next_environment and (environment := self._environment(slow)):
            parts.append(self._frame(MessageType.ENVIRONMENT, environment))
            self.environment_frames += 1
            self._next_environment = self._sample + round(wire.ENVIRONMENT_PERIOD_S * self._rate_hz)
        for first in range(0, len(counts), self._block_samples):
            block = counts[first : first + self._block_samples]
            begin = self._sample
            for start, stop in _runs(present[first : first + self._block_samples]):
                self._sample = begin + start
                samples = SampleBlock(self._sample & 0xFFFF_FFFF, self._mask, block[start:stop])
                parts.append(self._frame(MessageType.SAMPLES, samples))
            self._sample = begin + len(block)
        return b"".join(parts)

    def _frame(self, kind: MessageType, message: Message) -> bytes:
        tick_us = round(self._begin_us + self._sample * 1e6 / self._rate_hz) & 0xFFFF_FFFF
        frame = Frame(kind, 0, self._wheel, self._seq & 0xFFFF_FFFF, tick_us, message)
        self._seq += 1
        try:
            return encode_frame(frame)
        except ValueError as error:
            raise ImportDataError(
                f"at {self.end_s:.3f} s a value does not fit the protocol: {error}", "Check the column and its unit."
            ) from error

    def _environment(self, slow: FloatArray) -> Environment | None:
        """Return the mean of the slow quantities over a chunk, None when none was measured."""
        pressure, temperature = (
            float(measured.mean()) if len(measured := column[np.isfinite(column)]) else None for column in slow.T
        )
        if pressure is None and temperature is None:
            return None
        return Environment(None if pressure is None else pressure * self._pressure_pa, temperature, None)


def _runs(present: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return (start, stop) of each run of true values."""
    if present.all():
        return [(0, len(present))] if len(present) else []
    edges = np.flatnonzero(np.diff(np.concatenate(([False], present, [False])).astype(np.int8)))
    return [(int(start), int(stop)) for start, stop in edges.reshape(-1, 2)]


def _hello(sensor: Sensor, wheel: ImportedWheel, number: int, rate_hz: float, quantiser: Quantiser) -> Hello:
    axes = wheel.axis.present()
    scales, ranges = [0.0] * 3, [0.0] * 3
    for (axis, column), scale_mps2 in zip(axes.items(), quantiser.scale_mps2.tolist(), strict=True):
        scales[axis] = scale_mps2
        # The largest value of a file says nothing about the sensor.
        if column.full_scale_mps2 is not None:
            ranges[axis] = scale_mps2 * quantiser.saturation_counts
    return Hello(
        protocol_major=wire.VERSION_MAJOR,
        protocol_minor=wire.VERSION_MINOR,
        hub_id=0,
        # Sensors that are not stated must differ: the same one cannot be in two wheels.
        sensor_id=number if wheel.sensor_id is None else int(wheel.sensor_id, 16),
        firmware=(0, 0, 0),
        boot_count=1,
        rate_hz=rate_hz,
        axes=sum(1 << axis for axis in axes),
        coupling=sensor.protocol_coupling,
        highpass_hz=sensor.highpass_hz,
        range_mps2=(ranges[0], ranges[1], ranges[2]),
        scale_mps2=(scales[0], scales[1], scales[2]),
        offset_counts=(0.0, 0.0, 0.0),
        saturation_counts=quantiser.saturation_counts,
    )
