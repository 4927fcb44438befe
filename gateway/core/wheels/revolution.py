"""One revolution in the angle domain, from its two contacts and the buffered samples."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.messages import Axis, Coupling, Hello
from firmware_protocol.wire import MAX_SATURATION_COUNTS
from gateway.core.contacts.contact_timing import TimedPair
from gateway.core.contacts.segmenter import ContactPair
from gateway.core.estimates.estimator import OF_LOSS, Revolution
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.revolution_block import LEAST_MEASURED, RevolutionArrays
from gateway.core.reasons import Reason
from gateway.core.revolutions.angle_resampling import (
    GRID_SIZE,
    MARGIN_SAMPLES,
    Phase,
    Scale,
    fit_phase,
    resample_revolutions,
)
from gateway.core.revolutions.clipping import is_clipped
from gateway.core.revolutions.contact_edges import find_contact_edges
from gateway.core.revolutions.coupling_highpass import before_highpass
from gateway.core.revolutions.order_spectrum import (
    ORDER_COUNT,
    band_noises,
    highest_order,
    sample_std,
    spectrum_coefficients,
)
from gateway.core.revolutions.speed_normalisation import normalise_revolutions
from gateway.core.types import ComplexArray, FloatArray
from gateway.core.wheels.gap_filling import GapFilling, angles_in_gaps
from gateway.core.wheels.reasons import WheelCode
from gateway.core.wheels.sample_buffer import SampleBuffer

# Revolutions worked on at once; more no longer fit into the processor's cache.
_BATCH_SIZE: Final = 16


@dataclass(frozen=True, slots=True)
class SensorReading:
    """Conversion of one sensor's raw counts to accelerations.

    Attributes:
        columns: axis of each channel.
        scale_mps2: (channels,) m/s^2 per count.
        offset_counts: (channels,) counts at zero acceleration.
        saturation_counts: |count| at or above which a sample is saturated.
        ac_coupled: whether the sensor passes no steady value.
        corner_hz: of that coupling; 0 for none, or where none is stated.
        rate_hz: sampling rate.
        radial_column: channel of the radial axis, -1 without one.
        has_radial: whether there is a radial axis that can be used; one of scale 0 cannot.
    """

    columns: tuple[int, ...]
    scale_mps2: FloatArray
    offset_counts: FloatArray
    saturation_counts: int
    ac_coupled: bool
    corner_hz: float
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
            corner_hz=max(hello.highpass_hz, 0.0) if hello.coupling == Coupling.AC else 0.0,
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
        rate_std: its relative standard error.
        follows: whether it begins with the contact that ended the revolution before.
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
    rate_std: float
    follows: bool
    sign: int
    contribution_mps2: FloatArray | None = None
    uncorrected: Reason | None = None
    missing_samples: float = 0.0
    turns: int = 1


def revolutions_in_angle(
    revolutions: Sequence[TimedRevolution],
    buffer: SampleBuffer,
    reading: SensorReading,
    radius_m: float,
    filling: GapFilling,
) -> RevolutionArrays:
    """Extract revolutions from the buffer and transform them to the angle domain.

    The numbers of each do not depend on the others.

    Args:
        revolutions: in order of time.
        buffer: raw samples, holding at least these revolutions.
        reading: conversion of the samples.
        radius_m: belt radius, restores the steady value of an AC-coupled signal.
        filling: of the wheel's gaps; takes these revolutions.

    Returns:
        the revolutions, with their defects in `faults`.
    """
    axes = np.empty((len(revolutions), len(Axis), GRID_SIZE))
    radial = np.empty((len(revolutions), GRID_SIZE))
    orders = np.empty((len(revolutions), ORDER_COUNT), np.complex128)
    extracted: list[Revolution] = []
    for begin in range(0, len(revolutions), _BATCH_SIZE):
        part = slice(begin, begin + _BATCH_SIZE)
        rows = axes[part], radial[part], orders[part]
        extracted += _in_angle(revolutions[part], buffer, reading, radius_m, filling, *rows)
    return RevolutionArrays.of_rows(extracted, axes, radial, orders)


def _in_angle(
    revolutions: Sequence[TimedRevolution],
    buffer: SampleBuffer,
    reading: SensorReading,
    radius_m: float,
    filling: GapFilling,
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
    periods = [phase.samples for phase in phases]
    omegas_radps = [
        2.0 * math.pi * timed_revolution.turns * timed_revolution.rate_hz / period
        for timed_revolution, period in zip(revolutions, periods, strict=True)
    ]
    corners = [2.0 * math.pi * reading.corner_hz / omega_radps for omega_radps in omegas_radps]
    _correct(axes, revolutions, corners)
    # Hardly ever is any sample of a block saturated.
    may_be_saturated = reading.is_saturated(buffer.view(*_range(revolutions[0], revolutions[-1], buffer)))
    faults: list[tuple[Reason, ...]] = []
    missing: list[float] = []
    saturated: list[bool] = []
    for row, omega_radps, timed_revolution, phase, samples in zip(
        axes, omegas_radps, revolutions, phases, counts, strict=True
    ):
        first, end = math.floor(timed_revolution.timed.start.centre), math.ceil(timed_revolution.timed.end.centre)
        lost = buffer.missing_between(first, end)
        is_saturated = may_be_saturated and reading.is_saturated(samples)
        is_clipped_low = not is_saturated and is_clipped(samples[:, reading.radial_column], timed_revolution.sign)
        is_damaged = _is_damaged(timed_revolution.timed)
        revolution_faults = _faults(timed_revolution, is_damaged, is_saturated, is_clipped_low)
        is_usable = not (lost or is_damaged)
        if not (revolution_faults or is_damaged):
            inside = angles_in_gaps(_gaps(timed_revolution, buffer), phase, GRID_SIZE) if lost else None
            state = timed_revolution.sign, timed_revolution.contribution_mps2 is None
            is_usable = filling.take(row, omega_radps, inside, state, timed_revolution.start_s)
        faults.append(revolution_faults if is_usable else (Reason(EstimateCode.SAMPLES_LOST), *revolution_faults))
        missing.append(lost / phase.samples if lost else 0.0)
        saturated.append(is_saturated)
    radial[:] = normalise_revolutions(
        axes[:, Axis.RADIAL],
        phases,
        ac_coupled=reading.ac_coupled,
        steady_mps2=radius_m * np.square(omegas_radps),
    ).radial_mps2
    spectra = np.fft.rfft(radial, axis=1)
    orders[:] = spectrum_coefficients(spectra)
    noises = band_noises(spectra, periods)
    full_scale_mps2 = float(reading.range_mps2[Axis.RADIAL])
    for row_index, (revolution, phase, period, noise_coefficient) in enumerate(
        zip(revolutions, phases, periods, noises, strict=True)
    ):
        order_max = highest_order(period)
        if order_max < ORDER_COUNT - 1:
            orders[row_index, order_max + 1 :] = complex(math.nan, math.nan)
        # What stands in the gaps has hardly any noise.
        noise_coefficient = noise_coefficient / math.sqrt(max(1.0 - missing[row_index], LEAST_MEASURED))
        revolution_faults = faults[row_index]
        waveform = None if _has_loss(revolution_faults) else radial[row_index]
        edges, edge_fault = _edges(revolution.timed, waveform, period, noise_coefficient)
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
            missing_fraction=missing[row_index],
            saturated=saturated[row_index],
            ac_coupled=reading.ac_coupled,
            faults=revolution_faults if edge_fault is None else (*revolution_faults, edge_fault),
            period_std_s=math.hypot(revolution.timed.period_std, revolution.missing_samples) / revolution.rate_hz,
            rate_hz=revolution.rate_hz,
            rate_std=revolution.rate_std,
            full_scale_mps2=full_scale_mps2,
            follows=revolution.follows,
            uncorrected=revolution.uncorrected,
            turns=revolution.turns,
            corner=corners[row_index],
            assumed_steady=revolution.timed.previous_period is None,
        )


def _has_loss(faults: Iterable[Reason]) -> bool:
    return any(fault.code in OF_LOSS for fault in faults)


def _correct(axes: FloatArray, revolutions: Sequence[TimedRevolution], corners: Sequence[float]) -> None:
    """Undo the high-pass of a coupling, the sign of the radial axis and known effects, in place.

    Args:
        axes: (n, 3, GRID_SIZE) of the revolutions.
        revolutions: with sign and contribution of known effects.
        corners: of the coupling over the wheel's frequency, 0 without one.
    """
    for row, revolution, corner in zip(axes, revolutions, corners, strict=True):
        if corner:
            row[:] = before_highpass(row, corner)
        if revolution.sign < 0:
            np.negative(row[Axis.RADIAL], out=row[Axis.RADIAL])
        if revolution.contribution_mps2 is not None:
            row -= revolution.contribution_mps2


def _samples_and_phase(revolution: TimedRevolution, buffer: SampleBuffer) -> tuple[NDArray[np.int16], Phase]:
    """Return the samples of a revolution with margins for the interpolation, and its phase in their positions."""
    timed = revolution.timed
    start, end = timed.start.centre, timed.end.centre
    first, last = _range(revolution, revolution, buffer)
    previous = start - timed.previous_period - first if timed.previous_period is not None else None
    return buffer.view(first, last), fit_phase(start - first, end - first, previous)


def _range(initial: TimedRevolution, final: TimedRevolution, buffer: SampleBuffer) -> tuple[int, int]:
    """Return first and last (exclusive) sample from one revolution to another, with margins for the interpolation."""
    first = math.floor(initial.timed.start.centre) - MARGIN_SAMPLES - 1
    last = math.ceil(final.timed.end.centre) + MARGIN_SAMPLES + 2
    return max(first, buffer.tail), min(last, final.pair.decided_at, buffer.head)


def _edges(
    timed: TimedPair, radial_mps2: FloatArray | None, period: float, noise_coefficient_mps2: float
) -> tuple[tuple[float, float, float, float], Reason | None]:
    """Return leading and trailing edge with their standard errors, and the reason why there are none.

    The refined contacts give the leading edge at the end and the trailing edge at the start of the revolution. Without
    them, the edges are those of the waveform, or NaN where that lacks samples.
    """
    edges = _refined_edges(timed)
    if all(map(math.isfinite, edges)):
        return edges, None
    if radial_mps2 is None:
        return (math.nan,) * 4, None
    waveform_edges = find_contact_edges(radial_mps2, period, noise_coefficient_mps2)
    return (
        waveform_edges.leading_rad,
        waveform_edges.trailing_rad,
        waveform_edges.leading_std_rad,
        waveform_edges.trailing_std_rad,
    ), waveform_edges.reason


def _refined_edges(timed: TimedPair) -> tuple[float, float, float, float]:
    """Return leading and trailing edge with their standard errors, NaN where a contact was not refined."""
    start, end = timed.start, timed.end
    return end.leading_rad, start.trailing_rad, end.leading_std_rad, start.trailing_std_rad


def _is_damaged(timed: TimedPair) -> bool:
    """Return whether samples were lost in either contact, so that its time and edges are not measured."""
    return not (timed.start.is_seen and timed.end.is_seen)


def _gaps(revolution: TimedRevolution, buffer: SampleBuffer) -> list[tuple[float, float]]:
    """Return first and last (exclusive) sample of the gaps in a revolution, in the positions of its phase."""
    first, last = _range(revolution, revolution, buffer)
    return [(low - first, end - first) for low, end in buffer.gaps_between(first, last)]


def _faults(revolution: TimedRevolution, damaged: bool, saturated: bool, clipped: bool) -> tuple[Reason, ...]:
    """Return why a revolution must not be averaged, apart from lost samples elsewhere than in its contacts."""
    faults = []
    pair, timed = revolution.pair, revolution.timed
    if pair.start.predicted or pair.end.predicted:
        faults.append(Reason(EstimateCode.CONTACT_INTERPOLATED))
    if damaged and all(map(math.isfinite, _refined_edges(timed))):
        faults.append(Reason(EstimateCode.CONTACT_NOT_SEEN))
    if revolution.turns > 1:
        faults.append(Reason(WheelCode.SEVERAL_TURNS, turns=float(revolution.turns)))
    if revolution.missing_samples > 0.0:
        faults.append(Reason(WheelCode.SAMPLES_LOST_UNMARKED, count=revolution.missing_samples))
    elif revolution.missing_samples < 0.0:
        faults.append(Reason(WheelCode.SAMPLES_REPEATED_UNMARKED, count=-revolution.missing_samples))
    if saturated:
        faults.append(Reason(EstimateCode.RADIAL_SATURATED))
    if clipped:
        faults.append(Reason(WheelCode.RADIAL_CLIPPED))
    return tuple(faults)
