"""From two contacts and the ring buffer to a revolution in the angle domain."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from firmware_protocol.messages import Axis
from gateway.estimators.base import Revolution
from gateway.pipeline.contact_timing import TimedPair
from gateway.pipeline.sample_buffer import SampleBuffer
from gateway.pipeline.segmenter import ContactPair
from gateway.reasons import Code, Reason
from gateway.signal.angle_resampling import GRID_SIZE, MARGIN_SAMPLES, fit_phase, resample_revolution
from gateway.signal.clipping import is_clipped
from gateway.signal.contact_edges import find_contact_edges
from gateway.signal.order_spectrum import coefficient_std, highest_order, order_coefficients, sample_std
from gateway.signal.speed_normalisation import normalise_radial
from gateway.types import FloatArray

# A revolution with more of its samples lost than this is kept out of averages: a straight line stands in for them.
_MAX_MISSING: Final = 0.0


def revolution_in_angle(
    pair: ContactPair,
    timed: TimedPair,
    *,
    ring: SampleBuffer,
    columns: tuple[int, ...],
    scale_mps2: FloatArray,
    offset_counts: FloatArray,
    saturation_counts: int,
    sign: int,
    rate_hz: float,
    ac_coupled: bool,
    radius_m: float,
    index: int,
    start_s: float,
    contribution_mps2: FloatArray | None = None,
    uncorrected: Reason | None = None,
) -> Revolution:
    """Cut one revolution out of the ring and take it into the angle domain.

    Args:
        pair: the contacts that bound it, as segmented.
        timed: the same contacts refined.
        ring: raw samples, holding at least the revolution.
        columns: axis of each channel.
        scale_mps2: (channels,) m/s^2 per count.
        offset_counts: (channels,) counts at zero acceleration.
        saturation_counts: |count| at or above which a sample is saturated.
        sign: +1 or -1, makes the radial axis positive inward.
        rate_hz: sampling rate.
        ac_coupled: whether the sensor passes no steady value.
        radius_m: belt radius, restores the steady value of an AC-coupled signal.
        index: running number of the revolution.
        start_s: hub time of the first contact centre.
        contribution_mps2: (3, GRID_SIZE) what known effects add to the axes; taken off. None for nothing.
        uncorrected: why nothing is taken off although effects are known.

    Returns:
        the revolution; what is wrong with it is in its `faults`.
    """
    start, end = timed.start.centre, timed.end.centre
    first = max(math.floor(start) - MARGIN_SAMPLES - 1, ring.tail)
    last = min(math.ceil(end) + MARGIN_SAMPLES + 2, pair.decided_at, ring.head)
    counts = ring.view(first, last)
    radial_column = columns.index(Axis.RADIAL)
    inside = counts[:, radial_column]
    saturated = bool(inside.max() >= saturation_counts or inside.min() <= -saturation_counts)
    clipped = not saturated and (is_clipped(inside) or is_clipped(-inside))
    samples = (counts - offset_counts) * scale_mps2
    samples[:, radial_column] *= sign
    previous = start - timed.previous_period - first if timed.previous_period is not None else None
    phase = fit_phase(start - first, end - first, previous)
    channels = resample_revolution(samples, phase)
    axes = np.full((len(Axis), GRID_SIZE), np.nan)
    axes[list(columns)] = channels
    if contribution_mps2 is not None:
        axes -= contribution_mps2
    period = end - start
    omega_radps = 2.0 * math.pi * rate_hz / period
    steady_mps2 = radius_m * omega_radps**2
    normal = normalise_radial(axes[Axis.RADIAL], phase, ac_coupled=ac_coupled, steady_mps2=steady_mps2)
    radial = normal.radial_mps2
    noise_coefficient = coefficient_std(radial, period)
    edges = _edges(timed)
    edge_fault = None
    if not all(map(math.isfinite, edges)):
        own = find_contact_edges(radial, period, noise_coefficient)
        edges = own.leading_rad, own.trailing_rad, own.leading_std_rad, own.trailing_std_rad
        edge_fault = own.reason
    order_max = highest_order(period)
    missing = ring.missing_between(math.floor(start), math.ceil(end)) / period
    return Revolution(
        index=index,
        start_s=start_s,
        period_s=period / rate_hz,
        omega_radps=omega_radps,
        omega_dot_radps2=phase.acceleration * rate_hz**2,
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
        ac_coupled=ac_coupled,
        faults=_faults(pair, missing, saturated, clipped, edge_fault),
        period_std_s=timed.period_std / rate_hz,
        rate_hz=rate_hz,
        uncorrected=uncorrected,
    )


def _edges(timed: TimedPair) -> tuple[float, float, float, float]:
    """Return leading and trailing edge with their errors: the end's contact is entered, the start's is left."""
    start, end = timed.start, timed.end
    return end.leading_rad, start.trailing_rad, end.leading_std_rad, start.trailing_std_rad


def _faults(
    pair: ContactPair, missing: float, saturated: bool, clipped: bool, edge_fault: Reason | None
) -> tuple[Reason, ...]:
    faults = []
    if pair.start.predicted or pair.end.predicted:
        faults.append(Reason(Code.CONTACT_INTERPOLATED))
    if missing > _MAX_MISSING:
        faults.append(Reason(Code.SAMPLES_LOST))
    if saturated:
        faults.append(Reason(Code.RADIAL_SATURATED))
    if clipped:
        faults.append(Reason(Code.RADIAL_CLIPPED))
    if edge_fault is not None:
        faults.append(edge_fault)
    return tuple(faults)
