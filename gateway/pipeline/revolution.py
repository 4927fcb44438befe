"""One revolution in the angle domain, from its two contacts and the buffered samples."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.messages import Axis, Coupling, Hello
from gateway.estimators.estimator import Revolution
from gateway.pipeline.contact_timing import TimedPair
from gateway.pipeline.sample_buffer import SampleBuffer
from gateway.pipeline.segmenter import ContactPair
from gateway.reasons import Code, Reason
from gateway.signal.angle_resampling import GRID_SIZE, MARGIN_SAMPLES, Phase, fit_phase, resample_revolution
from gateway.signal.clipping import is_clipped
from gateway.signal.contact_edges import find_contact_edges
from gateway.signal.order_spectrum import coefficient_std, highest_order, order_coefficients, sample_std
from gateway.signal.speed_normalisation import normalise_radial
from gateway.types import FloatArray

# Revolutions with a larger share of lost samples are not averaged, because these are only interpolated.
_MAX_MISSING_FRACTION: Final = 0.0


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
        sign: +1 or -1, makes the radial axis positive inward.
    """

    columns: tuple[int, ...]
    scale_mps2: FloatArray
    offset_counts: FloatArray
    saturation_counts: int
    ac_coupled: bool
    rate_hz: float
    sign: int = 1

    @classmethod
    def from_hello(cls, hello: Hello) -> Self:
        """Return the conversion that a hello describes, at its nominal rate and sign."""
        columns = tuple(axis for axis in Axis if hello.axes >> axis & 1)
        return cls(
            columns=columns,
            scale_mps2=np.array([hello.scale_mps2[axis] for axis in columns]),
            offset_counts=np.array([hello.offset_counts[axis] for axis in columns]),
            saturation_counts=hello.saturation_counts,
            ac_coupled=hello.coupling == Coupling.AC,
            rate_hz=hello.rate_hz,
        )

    @property
    def has_radial(self) -> bool:
        """Whether the sensor has a radial axis that can be used; one of scale 0 cannot."""
        return Axis.RADIAL in self.columns and self.scale_mps2[self.radial_column] != 0.0

    @property
    def radial_column(self) -> int:
        """Channel of the radial axis; raises ValueError without one."""
        return self.columns.index(Axis.RADIAL)

    def radial_mps2(self, counts: NDArray[np.int16]) -> FloatArray:
        """Return the radial axis of samples (n, channels), positive inward, (n,)."""
        column = self.radial_column
        radial: FloatArray = (counts[:, column] - self.offset_counts[column]) * self.scale_mps2[column]
        return radial * self.sign

    def samples_mps2(self, counts: NDArray[np.int16]) -> FloatArray:
        """Return samples (n, channels) as accelerations, the radial axis, if there is one, positive inward."""
        samples: FloatArray = (counts - self.offset_counts) * self.scale_mps2
        if Axis.RADIAL in self.columns:
            samples[:, self.radial_column] *= self.sign
        return samples

    def is_saturated(self, counts: NDArray[np.integer[Any]]) -> bool:
        """Return whether any count is at the end of the sensor's range."""
        return bool(counts.max() >= self.saturation_counts or counts.min() <= -self.saturation_counts)


def revolution_in_angle(
    pair: ContactPair,
    timed: TimedPair,
    buffer: SampleBuffer,
    reading: SensorReading,
    *,
    radius_m: float,
    index: int,
    start_s: float,
    contribution_mps2: FloatArray | None = None,
    uncorrected: Reason | None = None,
) -> Revolution:
    """Extract one revolution from the buffer and transform it to the angle domain.

    Args:
        pair: the contacts that bound it, as segmented.
        timed: the same contacts, refined.
        buffer: raw samples, holding at least the revolution.
        reading: conversion of the samples, with the measured rate and the sign found.
        radius_m: belt radius, restores the steady value of an AC-coupled signal.
        index: running number of the revolution.
        start_s: hub time of the first contact centre.
        contribution_mps2: (3, GRID_SIZE) contribution of known effects to the axes, which is subtracted; None if none.
        uncorrected: reason why no contribution is subtracted although effects are known.

    Returns:
        the revolution, with its defects in `faults`.
    """
    period = timed.end.centre - timed.start.centre
    counts, first = _surrounding_counts(pair, timed, buffer)
    axes, phase = _axes_in_angle(counts, first, timed, reading)
    if contribution_mps2 is not None:
        axes -= contribution_mps2
    omega_radps = 2.0 * math.pi * reading.rate_hz / period
    radial = normalise_radial(
        axes[Axis.RADIAL], phase, ac_coupled=reading.ac_coupled, steady_mps2=radius_m * omega_radps**2
    ).radial_mps2
    noise_coefficient = coefficient_std(radial, period)
    edges, edge_fault = _edges(timed, radial, period, noise_coefficient)
    order_max = highest_order(period)
    missing = buffer.missing_between(math.floor(timed.start.centre), math.ceil(timed.end.centre)) / period
    radial_counts = counts[:, reading.radial_column]
    saturated = reading.is_saturated(radial_counts)
    clipped = not saturated and is_clipped(radial_counts * reading.sign)
    return Revolution(
        index=index,
        start_s=start_s,
        period_s=period / reading.rate_hz,
        omega_radps=omega_radps,
        omega_dot_radps2=phase.acceleration * reading.rate_hz**2,
        radial_mps2=radial,
        axes_mps2=axes,
        orders_mps2=order_coefficients(radial, order_max),
        order_max=order_max,
        leading_edge_rad=edges[0],
        trailing_edge_rad=edges[1],
        leading_edge_std_rad=edges[2],
        trailing_edge_std_rad=edges[3],
        noise_mps2=sample_std(noise_coefficient, period, GRID_SIZE),
        missing_fraction=missing,
        saturated=saturated,
        ac_coupled=reading.ac_coupled,
        faults=_faults(pair, missing, saturated, clipped, edge_fault),
        period_std_s=timed.period_std / reading.rate_hz,
        rate_hz=reading.rate_hz,
        uncorrected=uncorrected,
    )


def _surrounding_counts(pair: ContactPair, timed: TimedPair, buffer: SampleBuffer) -> tuple[NDArray[np.int16], int]:
    """Return the samples of a revolution with margins for the interpolation, and the number of the first."""
    first = max(math.floor(timed.start.centre) - MARGIN_SAMPLES - 1, buffer.tail)
    last = min(math.ceil(timed.end.centre) + MARGIN_SAMPLES + 2, pair.decided_at, buffer.head)
    return buffer.view(first, last), first


def _axes_in_angle(
    counts: NDArray[np.int16], first: int, timed: TimedPair, reading: SensorReading
) -> tuple[FloatArray, Phase]:
    """Return the three axes on the angle grid, (3, GRID_SIZE), NaN where the sensor has none, and the phase."""
    start, end = timed.start.centre, timed.end.centre
    previous = start - timed.previous_period - first if timed.previous_period is not None else None
    phase = fit_phase(start - first, end - first, previous)
    axes = np.full((len(Axis), GRID_SIZE), np.nan)
    axes[list(reading.columns)] = resample_revolution(reading.samples_mps2(counts), phase)
    return axes, phase


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
    own = find_contact_edges(radial_mps2, period, noise_coefficient_mps2)
    return (own.leading_rad, own.trailing_rad, own.leading_std_rad, own.trailing_std_rad), own.reason


def _faults(
    pair: ContactPair, missing: float, saturated: bool, clipped: bool, edge_fault: Reason | None
) -> tuple[Reason, ...]:
    faults = []
    if pair.start.predicted or pair.end.predicted:
        faults.append(Reason(Code.CONTACT_INTERPOLATED))
    if missing > _MAX_MISSING_FRACTION:
        faults.append(Reason(Code.SAMPLES_LOST))
    if saturated:
        faults.append(Reason(Code.RADIAL_SATURATED))
    if clipped:
        faults.append(Reason(Code.RADIAL_CLIPPED))
    if edge_fault is not None:
        faults.append(edge_fault)
    return tuple(faults)
