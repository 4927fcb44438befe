"""One revolution in the angle domain, from its two contacts and the buffered samples."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.messages import Axis, Coupling, Hello
from firmware_protocol.wire import MAX_SATURATION_COUNTS
from gateway.estimators.estimator import Revolution
from gateway.estimators.revolution_block import RevolutionArrays
from gateway.pipeline.contact_timing import TimedPair
from gateway.pipeline.sample_buffer import SampleBuffer
from gateway.pipeline.segmenter import ContactPair
from gateway.reasons import Code, Reason
from gateway.signal.angle_resampling import (
    GRID_SIZE,
    MARGIN_SAMPLES,
    Phase,
    Scale,
    fit_phase,
    resample_revolutions,
)
from gateway.signal.clipping import is_clipped
from gateway.signal.contact_edges import find_contact_edges
from gateway.signal.order_spectrum import ORDER_COUNT, band_noises, highest_order, sample_std, spectrum_coefficients
from gateway.signal.speed_normalisation import normalise_revolutions
from gateway.types import ComplexArray, FloatArray

# Revolutions with a larger share of lost samples are not averaged, because these are only interpolated.
_MAX_MISSING_FRACTION: Final = 0.0
# Revolutions worked on at once; more no longer fit into the processor's cache.
_TOGETHER: Final = 16


@dataclass(frozen=True, slots=True)
class SensorReading:
    """Conversion of one sensor's raw counts to accelerations.

    Attributes:
        columns: axis of each channel.
        scale_mps2: (channels,) m/s^2 per count.
        offset_counts: (channels,) counts at zero acceleration.
        saturation_counts: |count| at or above which a sample is saturated.
        ac_coupled: whether the sensor passes no steady value.
        rate_hz: sampling rate.
        radial_column: channel of the radial axis, -1 without one.
        has_radial: whether there is a radial axis that can be used; one of scale 0 cannot.
    """

    columns: tuple[int, ...]
    scale_mps2: FloatArray
    offset_counts: FloatArray
    saturation_counts: int
    ac_coupled: bool
    rate_hz: float
    radial_column: int
    has_radial: bool

    @classmethod
    def from_hello(cls, hello: Hello) -> Self:
        """Return the conversion that a hello describes, at its nominal rate."""
        columns = tuple(axis for axis in Axis if hello.axes >> axis & 1)
        has_radial = Axis.RADIAL in columns
        return cls(
            columns=columns,
            scale_mps2=np.array([hello.scale_mps2[axis] for axis in columns]),
            offset_counts=np.array([hello.offset_counts[axis] for axis in columns]),
            saturation_counts=hello.saturation_counts,
            ac_coupled=hello.coupling == Coupling.AC,
            rate_hz=hello.rate_hz,
            radial_column=columns.index(Axis.RADIAL) if has_radial else -1,
            has_radial=has_radial and hello.scale_mps2[Axis.RADIAL] != 0.0,
        )

    @property
    def range_mps2(self) -> FloatArray:
        """Acceleration of each axis (3,) up to which no sample is saturated; NaN for absent axes and without an end."""
        ranges = np.full(len(Axis), np.nan)
        if self.saturation_counts < MAX_SATURATION_COUNTS:
            free_counts = self.saturation_counts - np.abs(self.offset_counts)
            ranges[list(self.columns)] = free_counts * np.abs(self.scale_mps2)
        return ranges

    def radial_mps2(self, counts: NDArray[np.int16]) -> FloatArray:
        """Return the radial axis of samples (n, channels), nominally positive inward, (n,)."""
        column = self.radial_column
        radial: FloatArray = counts[:, column].astype(float)
        radial -= self.offset_counts[column]
        radial *= self.scale_mps2[column]
        return radial

    def samples_mps2(self, counts: NDArray[np.int16]) -> FloatArray:
        """Return samples (n, channels) as accelerations, in the directions that the sensor states."""
        samples: FloatArray = np.subtract(counts, self.offset_counts, dtype=float)
        samples *= self.scale_mps2
        return samples

    def is_saturated(self, counts: NDArray[np.integer[Any]]) -> bool:
        """Return whether any count is at the end of the sensor's range."""
        return bool(counts.max() >= self.saturation_counts or counts.min() <= -self.saturation_counts)


@dataclass(frozen=True, slots=True)
class TimedRevolution:
    """A revolution between two timed contacts, still in samples.

    Attributes:
        pair: the contacts that bound it, as segmented.
        timed: the same contacts, refined.
        index: running number of the revolution.
        start_s: hub time of the first contact centre.
        rate_hz: measured sampling rate.
        sign: +1 or -1, makes the radial axis positive inward.
        contribution_mps2: (3, GRID_SIZE) contribution of known effects to the axes, which is subtracted; None if none.
        uncorrected: reason why no contribution is subtracted although effects are known.
        missing_samples: samples that were lost without being marked; negative for repeated ones.
        turns: between its contacts; more than 1 where contacts were not seen.
    """

    pair: ContactPair
    timed: TimedPair
    index: int
    start_s: float
    rate_hz: float
    sign: int
    contribution_mps2: FloatArray | None = None
    uncorrected: Reason | None = None
    missing_samples: float = 0.0
    turns: int = 1


def revolutions_in_angle(
    revolutions: Sequence[TimedRevolution], buffer: SampleBuffer, reading: SensorReading, radius_m: float
) -> RevolutionArrays:
    """Extract revolutions from the buffer and transform them to the angle domain.

    The numbers of each do not depend on the others.

    Args:
        revolutions: in order of time.
        buffer: raw samples, holding at least these revolutions.
        reading: conversion of the samples.
        radius_m: belt radius, restores the steady value of an AC-coupled signal.

    Returns:
        the revolutions, with their defects in `faults`.
    """
    axes = np.empty((len(revolutions), len(Axis), GRID_SIZE))
    radial = np.empty((len(revolutions), GRID_SIZE))
    orders = np.empty((len(revolutions), ORDER_COUNT), np.complex128)
    extracted: list[Revolution] = []
    for begin in range(0, len(revolutions), _TOGETHER):
        part = slice(begin, begin + _TOGETHER)
        extracted += _in_angle(revolutions[part], buffer, reading, radius_m, axes[part], radial[part], orders[part])
    return RevolutionArrays.of_rows(extracted, axes, radial, orders)


def _in_angle(
    revolutions: Sequence[TimedRevolution],
    buffer: SampleBuffer,
    reading: SensorReading,
    radius_m: float,
    axes: FloatArray,
    radial: FloatArray,
    orders: ComplexArray,
) -> Iterator[Revolution]:
    """Yield the revolutions, with their rows of the arrays, which are filled first."""
    counts, phases = zip(
        *(_samples_and_phase(timed_revolution, buffer) for timed_revolution in revolutions), strict=True
    )
    scale = Scale(reading.offset_counts, reading.scale_mps2)
    if reading.columns == tuple(Axis):
        resample_revolutions(counts, phases, GRID_SIZE, scale, out=axes)
    else:
        axes.fill(math.nan)
        axes[:, list(reading.columns)] = resample_revolutions(counts, phases, GRID_SIZE, scale)
    for row, revolution in zip(axes, revolutions, strict=True):
        if revolution.sign < 0:
            np.negative(row[Axis.RADIAL], out=row[Axis.RADIAL])
        if revolution.contribution_mps2 is not None:
            row -= revolution.contribution_mps2
    omegas_radps = [
        2.0 * math.pi * timed_revolution.turns * timed_revolution.rate_hz / phase.samples
        for timed_revolution, phase in zip(revolutions, phases, strict=True)
    ]
    radial[:] = normalise_revolutions(
        axes[:, Axis.RADIAL],
        phases,
        ac_coupled=reading.ac_coupled,
        steady_mps2=radius_m * np.square(omegas_radps),
    ).radial_mps2
    spectra = np.fft.rfft(radial, axis=1)
    orders[:] = spectrum_coefficients(spectra)
    noises = band_noises(spectra, [phase.samples for phase in phases])
    # Hardly ever is any sample of a block saturated.
    may_be_saturated = reading.is_saturated(buffer.view(*_range(revolutions[0], revolutions[-1], buffer)))
    for row_index, (revolution, phase, noise_coefficient) in enumerate(zip(revolutions, phases, noises, strict=True)):
        period = phase.samples
        order_max = highest_order(period)
        if order_max < ORDER_COUNT - 1:
            orders[row_index, order_max + 1 :] = complex(math.nan, math.nan)
        timed = revolution.timed
        edges, edge_fault = _edges(timed, radial[row_index], period, noise_coefficient)
        lost = buffer.missing_between(math.floor(timed.start.centre), math.ceil(timed.end.centre))
        saturated = may_be_saturated and reading.is_saturated(counts[row_index])
        clipped = not saturated and is_clipped(counts[row_index][:, reading.radial_column], revolution.sign)
        yield Revolution(
            index=revolution.index,
            start_s=revolution.start_s,
            period_s=period / revolution.rate_hz,
            omega_radps=omegas_radps[row_index],
            omega_dot_radps2=phase.acceleration * revolution.rate_hz**2,
            radial_mps2=radial[row_index],
            axes_mps2=axes[row_index],
            orders_mps2=orders[row_index],
            order_max=order_max,
            leading_edge_rad=edges[0],
            trailing_edge_rad=edges[1],
            leading_edge_std_rad=edges[2],
            trailing_edge_std_rad=edges[3],
            noise_mps2=sample_std(noise_coefficient, period, GRID_SIZE),
            missing_fraction=lost / period,
            saturated=saturated,
            ac_coupled=reading.ac_coupled,
            faults=_faults(revolution, lost / period, saturated, clipped, edge_fault),
            period_std_s=math.hypot(timed.period_std, revolution.missing_samples) / revolution.rate_hz,
            rate_hz=revolution.rate_hz,
            uncorrected=revolution.uncorrected,
            turns=revolution.turns,
        )


def _samples_and_phase(revolution: TimedRevolution, buffer: SampleBuffer) -> tuple[NDArray[np.int16], Phase]:
    """Return the samples of a revolution with margins for the interpolation, and its phase in their positions."""
    timed = revolution.timed
    start, end = timed.start.centre, timed.end.centre
    first, last = _range(revolution, revolution, buffer)
    previous = start - timed.previous_period - first if timed.previous_period is not None else None
    return buffer.view(first, last), fit_phase(start - first, end - first, previous)


def _range(earlier: TimedRevolution, later: TimedRevolution, buffer: SampleBuffer) -> tuple[int, int]:
    """Return first and last (exclusive) sample from one revolution to another, with margins for the interpolation."""
    first = math.floor(earlier.timed.start.centre) - MARGIN_SAMPLES - 1
    last = math.ceil(later.timed.end.centre) + MARGIN_SAMPLES + 2
    return max(first, buffer.tail), min(last, later.pair.decided_at, buffer.head)


def _edges(
    timed: TimedPair, radial_mps2: FloatArray, period: float, noise_coefficient_mps2: float
) -> tuple[tuple[float, float, float, float], Reason | None]:
    """Return leading and trailing edge with their standard errors, and the reason why there are none.

    The refined contacts give the leading edge at the end and the trailing edge at the start of the revolution. Without
    them, the edges are those of the waveform.
    """
    start, end = timed.start, timed.end
    edges = end.leading_rad, start.trailing_rad, end.leading_std_rad, start.trailing_std_rad
    if all(map(math.isfinite, edges)):
        return edges, None
    waveform_edges = find_contact_edges(radial_mps2, period, noise_coefficient_mps2)
    return (
        waveform_edges.leading_rad,
        waveform_edges.trailing_rad,
        waveform_edges.leading_std_rad,
        waveform_edges.trailing_std_rad,
    ), waveform_edges.reason


def _faults(
    revolution: TimedRevolution, missing: float, saturated: bool, clipped: bool, edge_fault: Reason | None
) -> tuple[Reason, ...]:
    faults = []
    pair = revolution.pair
    if pair.start.predicted or pair.end.predicted:
        faults.append(Reason(Code.CONTACT_INTERPOLATED))
    if revolution.turns > 1:
        faults.append(Reason(Code.SEVERAL_TURNS, turns=float(revolution.turns)))
    if missing > _MAX_MISSING_FRACTION:
        faults.append(Reason(Code.SAMPLES_LOST))
    if revolution.missing_samples > 0.0:
        faults.append(Reason(Code.SAMPLES_LOST_UNMARKED, count=revolution.missing_samples))
    elif revolution.missing_samples < 0.0:
        faults.append(Reason(Code.SAMPLES_REPEATED_UNMARKED, count=-revolution.missing_samples))
    if saturated:
        faults.append(Reason(Code.RADIAL_SATURATED))
    if clipped:
        faults.append(Reason(Code.RADIAL_CLIPPED))
    if edge_fault is not None:
        faults.append(edge_fault)
    return tuple(faults)
