"""Leading and trailing contact edges from the angle-domain radial waveform.

On a belt that rolls steadily the sensor reads s = V^2 kappa: zero on a flat road, the baseline R Omega^2 in the free
part, overshoots on either side of the contact. The edge is defined as the place where contact pressure ends. What is
found is the steepest slope of the smoothed waveform, the feature most robust to noise, which mostly lies inside it. The
distance from it to the edge is estimated from the shape of the waveform (gateway/core/revolutions/edge_distance.py),
and its error is part of the standard error. Stronger smoothing finds the edge among waves of the belt.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import takewhile
from typing import Final, NamedTuple

import numpy as np

from gateway.core.constants import AXIS_NAMES
from gateway.core.reasons import Reason
from gateway.core.revolutions.angle_resampling import angle_grid
from gateway.core.revolutions.edge_distance import (
    EdgePlace,
    EdgeShape,
    edge_among_waves,
    edge_distance,
    edge_shape,
    model_std_rad,
)
from gateway.core.revolutions.order_spectrum import coefficient_std
from gateway.core.revolutions.reasons import RevolutionCode
from gateway.core.revolutions.short_medians import median
from gateway.core.types import ComplexArray, FloatArray

# The smoothed derivative keeps orders by a Gaussian of this standard width, narrower when the sampling is coarse.
SMOOTHING_ORDER: Final = 40.0
_SMOOTHING_SHARE: Final = 0.3
# Widths of the stronger smoothings, where they are less than this share of the usual one.
_STRONGER_ORDERS: Final = (20.0, 15.0)
_STRONGER_SHARE: Final = 0.8

# Standard error of the edge's definition at the usual smoothing: a constant error for all revolutions of a tire.
EDGE_MODEL_STD_RAD: Final = model_std_rad(SMOOTHING_ORDER)


def error_beyond_definition(edge_std_rad: float) -> float:
    """Return the error of an edge without that of its definition, which a calibration absorbs; NaN where not known."""
    if not math.isfinite(edge_std_rad):
        return math.nan
    return math.sqrt(max(0.0, edge_std_rad**2 - EDGE_MODEL_STD_RAD**2))


# The contact is searched within the first angle around 0; the free belt is what lies beyond the second.
_SEARCH_RAD: Final = 0.9
_FREE_RAD: Final = 1.1
# Every contact extends at least this far to either side of 0.
_CENTRE_RAD: Final = 0.2
# Waves of the free belt are measured between these angles beyond the steepest slopes, as what the usual smoothing keeps
# and the next stronger one removes.
_RIPPLE_RAD: Final = (0.45, 1.3)
# Smallest accepted step between baseline and contact, over the noise of the smoothed waveform.
_MIN_CONTRAST: Final = 6.0


@dataclass(frozen=True, slots=True)
class ContactEdges:
    """Edges of one contact, or the reason why none were found.

    Attributes:
        leading_rad: leading edge, negative; NaN when not found.
        trailing_rad: trailing edge, positive; NaN when not found.
        leading_std_rad: standard error: noise and uncertainty of the edge's definition.
        trailing_std_rad: likewise.
        leading_noise_std_rad: the part that varies from revolution to revolution.
        trailing_noise_std_rad: likewise.
        plateau_mps2: level in the middle of the contact.
        baseline_mps2: level of the free belt.
        contrast: (baseline - plateau) over the noise of the smoothed waveform.
        reason: why the edges are NaN; None when they are found.
    """

    leading_rad: float
    trailing_rad: float
    leading_std_rad: float
    trailing_std_rad: float
    leading_noise_std_rad: float
    trailing_noise_std_rad: float
    plateau_mps2: float
    baseline_mps2: float
    contrast: float
    reason: Reason | None = None

    @property
    def measured(self) -> bool:
        """Whether both edges were found."""
        return self.reason is None


def find_contact_edges(
    radial_mps2: FloatArray,
    samples_per_revolution: float,
    noise_coefficient_mps2: float | None = None,
    scatter_mps2: FloatArray | None = None,
) -> ContactEdges:
    """Find both edges of the contact around theta = 0.

    The result does not depend on a constant added to the waveform, so AC- and DC-coupled sensors are treated alike.

    Args:
        radial_mps2: (n,) radial waveform on the angle grid, positive inward, gravity removed.
        samples_per_revolution: time samples that it was made from; fewer samples need stronger smoothing.
        noise_coefficient_mps2: noise of one real order coefficient; estimated from the high orders when None.
        scatter_mps2: (n,) of an average, standard deviation from revolution to revolution; None for one revolution.

    Returns:
        The edges; NaN with a reason when the waveform has no contact that stands out of the noise. Never raises on
        values.
    """
    if not np.isfinite(radial_mps2).all():
        return _no_edges(Reason(RevolutionCode.AXIS_NOT_FINITE, axis=AXIS_NAMES[2]))
    if noise_coefficient_mps2 is None:
        noise_coefficient_mps2 = coefficient_std(radial_mps2, samples_per_revolution)
    width = smoothing_order(samples_per_revolution)
    spectrum = np.fft.rfft(radial_mps2)
    levels = _levels(radial_mps2, spectrum, width)
    contrast, reason = _contrast(levels, noise_coefficient_mps2)
    plateau, baseline = levels.plateau_mps2, levels.baseline_mps2
    if reason is not None:
        return _no_edges(reason, plateau, baseline, contrast)
    smoothed = [levels, *_stronger_levels(radial_mps2, spectrum, width)]
    ripple = _ripple(smoothed[0], smoothed[1], noise_coefficient_mps2) if len(smoothed) > 1 else 0.0
    scatter = None if scatter_mps2 is None else (scatter_mps2, median(scatter_mps2))
    places = [_places(smoothed, side, noise_coefficient_mps2, scatter) for side in (0, 1)]
    if not all(places):
        return _no_edges(Reason(RevolutionCode.CONTACT_HAS_NO_SLOPE), plateau, baseline, contrast)
    leading, trailing = (edge_among_waves(side_places, ripple) for side_places in places)
    if not leading.angle_rad < 0.0 < trailing.angle_rad:
        return _no_edges(Reason(RevolutionCode.CONTACT_HAS_NO_SLOPE), plateau, baseline, contrast)
    return ContactEdges(
        leading.angle_rad,
        trailing.angle_rad,
        math.hypot(leading.noise_std_rad, leading.model_std_rad),
        math.hypot(trailing.noise_std_rad, trailing.model_std_rad),
        leading.noise_std_rad,
        trailing.noise_std_rad,
        plateau,
        baseline,
        contrast,
    )


@dataclass(frozen=True, slots=True)
class ContactLevels:
    """Levels of a waveform with a contact, and the shape of its slopes.

    Attributes:
        width: of the smoothing, in orders.
        smooth_mps2: (n,) smoothed waveform.
        plateau_mps2: level in the middle of the contact; the lowest level near 0 where no contact is found.
        baseline_mps2: level of the free belt.
        shapes: at the leading and at the trailing edge; None where no contact is found.
    """

    width: float
    smooth_mps2: FloatArray
    plateau_mps2: float
    baseline_mps2: float
    shapes: tuple[EdgeShape, EdgeShape] | None


def contact_levels(radial_mps2: FloatArray, width: float) -> ContactLevels:
    """Return the levels and slopes of a finite waveform (n,), smoothed to `width` orders."""
    return _levels(radial_mps2, np.fft.rfft(radial_mps2), width)


def _levels(radial_mps2: FloatArray, spectrum: ComplexArray, width: float) -> ContactLevels:
    """Return what `contact_levels` does, with the Fourier transform (n / 2 + 1,) of the waveform."""
    n = radial_mps2.shape[0]
    smooth, slope = np.fft.irfft(spectrum * _smoothing(n, width).factors, n=n, axis=1)
    points_per_rad = n / (2.0 * math.pi)
    middle, reach, search = n // 2, round(_CENTRE_RAD * points_per_rad), round(_SEARCH_RAD * points_per_rad)
    free_points = math.ceil(_FREE_RAD * points_per_rad)
    baseline = median(np.concatenate((smooth[: middle - free_points + 1], smooth[middle + free_points :])))
    contact_index = middle - reach + int(smooth[middle - reach : middle + reach + 1].argmin())
    plateau = smooth.item(contact_index)
    crossings = _half_level_crossings(smooth, contact_index, 0.5 * (plateau + baseline), search)
    if crossings is not None:
        # Second pass with the level of the plateau instead of the minimum, which noise and overshoots bias.
        first, last = crossings
        quarter = (last - first) // 4
        plateau = float(radial_mps2[first + quarter : last - quarter + 1].mean())
        crossings = _half_level_crossings(smooth, (first + last) // 2, 0.5 * (plateau + baseline), search)
    if crossings is None:
        return ContactLevels(width, smooth, plateau, baseline, None)
    leading, trailing = (
        edge_shape(smooth, slope, index, direction, (plateau, baseline), search)
        for index, direction in zip(crossings, (-1, 1), strict=True)
    )
    return ContactLevels(width, smooth, plateau, baseline, (leading, trailing))


def _contrast(levels: ContactLevels, noise_coefficient_mps2: float) -> tuple[float, Reason | None]:
    """Return step over noise, and the reason why the waveform has no contact; None where it has one."""
    if levels.shapes is None:
        return math.nan, Reason(RevolutionCode.NO_CONTACT)
    noise = noise_coefficient_mps2 * _smoothing(len(levels.smooth_mps2), levels.width).noises[0]
    contrast = (levels.baseline_mps2 - levels.plateau_mps2) / noise if noise > 0.0 else math.inf
    return contrast, None if contrast > _MIN_CONTRAST else Reason(RevolutionCode.CONTACT_IN_NOISE)


def _stronger_levels(radial_mps2: FloatArray, spectrum: ComplexArray, width: float) -> list[ContactLevels]:
    """Return the levels of a waveform under stronger smoothing than to `width` orders, as far as it has a contact."""
    stronger = (_levels(radial_mps2, spectrum, order) for order in _STRONGER_ORDERS if order < _STRONGER_SHARE * width)
    return list(takewhile(lambda levels: levels.shapes is not None, stronger))


def _places(
    smoothed: list[ContactLevels],
    side: int,
    noise_coefficient_mps2: float,
    scatter_mps2: tuple[FloatArray, float] | None,
) -> list[EdgePlace]:
    """Return the places of one edge under each smoothing: 0 is the leading, 1 the trailing edge.

    `scatter_mps2` is that of `find_contact_edges` with its median.
    """
    places = []
    for levels in smoothed:
        assert levels.shapes is not None
        shape, width = levels.shapes[side], levels.width
        smoothing = _smoothing(len(levels.smooth_mps2), width)
        _, slope_noise, curvature_noise, slope_bend_noise = (
            noise_coefficient_mps2 * density for density in smoothing.noises
        )
        noises = shape.noises_rad(slope_noise, slope_bend_noise)
        smear = _smear(shape, *scatter_mps2) if scatter_mps2 is not None else 0.0
        distance = edge_distance(width, shape.features_rad, noises, smear)
        if shape.bend_mps2 > 0.0:
            angle = shape.steepest_rad + (2 * side - 1) * distance.distance_rad
            noise_std = math.hypot(curvature_noise / shape.bend_mps2, distance.noise_std_rad)
            places.append(EdgePlace(width, angle, noise_std, distance.model_std_rad))
    return places


def _ripple(levels: ContactLevels, stronger: ContactLevels, noise_coefficient_mps2: float) -> float:
    """Return the rms of the waves beside the contact that a stronger smoothing removes, over the step."""
    assert levels.shapes is not None
    waves = levels.smooth_mps2 - stronger.smooth_mps2
    angles = angle_grid(len(waves))
    inner_rad, outer_rad = _RIPPLE_RAD
    leading, trailing = (shape.steepest_rad for shape in levels.shapes)
    leading_span = slice(*np.searchsorted(angles, (leading - outer_rad, leading - inner_rad)).tolist())
    trailing_span = slice(*np.searchsorted(angles, (trailing + inner_rad, trailing + outer_rad)).tolist())
    free_waves = np.concatenate((waves[leading_span], waves[trailing_span]))
    square = float(free_waves @ free_waves) / len(free_waves) if len(free_waves) else 0.0
    noise = noise_coefficient_mps2 * _wave_noise(len(waves), levels.width, stronger.width)
    return math.sqrt(max(square - noise * noise, 0.0)) / (levels.baseline_mps2 - levels.plateau_mps2)


def contact_interior(radial_mps2: FloatArray, samples_per_revolution: float) -> slice | None:
    """Return the grid points of the middle quarter of the contact in a (n,) waveform; None without a contact.

    Curvature vanishes in a flat contact: on the exact ring the level there is -0.06 to +0.01 of R Omega^2 for contact
    half angles from 0.14 rad up. A shorter contact is not flat (+0.2 at 0.11 rad). A drum of radius Rd gives -R / Rd.
    """
    edges = find_contact_edges(radial_mps2, samples_per_revolution)
    if not edges.measured:
        return None
    n = radial_mps2.shape[0]
    points_per_rad = n / (2.0 * math.pi)
    margin = 0.375 * (edges.trailing_rad - edges.leading_rad)
    first = round((math.pi + edges.leading_rad + margin) * points_per_rad)
    last = round((math.pi + edges.trailing_rad - margin) * points_per_rad)
    return slice(first, max(first, last) + 1)


def smoothing_order(samples_per_revolution: float) -> float:
    """Return the standard width, in orders, of the smoothing Gaussian."""
    return min(SMOOTHING_ORDER, _SMOOTHING_SHARE * samples_per_revolution)


class _Smoothing(NamedTuple):
    """Smoothing of a waveform to a width in orders, and what it leaves of white noise.

    Attributes:
        factors: (2, n / 2 + 1) factors of the orders of the smoothed waveform and of its derivative by angle.
        noises: of the smoothed waveform and its first three derivatives, over that of one real order coefficient.
    """

    factors: ComplexArray
    noises: tuple[float, ...]


@lru_cache(maxsize=32)
def _smoothing(n: int, width: float) -> _Smoothing:
    """Return the smoothing of waveforms (n,) to `width` orders by a Gaussian."""
    orders, gain = _gaussian(n, width)
    factors = np.zeros((2, n // 2 + 1), np.complex128)
    factors[0, 0] = 1.0
    factors[0, 1 : len(orders) + 1] = gain
    factors[1, 1 : len(orders) + 1] = gain * (1j * orders)
    return _Smoothing(factors, tuple(math.sqrt(float(np.sum((orders**power * gain) ** 2))) for power in range(4)))


@lru_cache(maxsize=32)
def _wave_noise(n: int, width: float, stronger: float) -> float:
    """Return the noise of what one smoothing keeps and a stronger one removes, over that of one order coefficient."""
    orders, gain = _gaussian(n, width)
    return math.sqrt(float(np.sum((gain - np.exp(-0.5 * (orders / stronger) ** 2)) ** 2)))


def _gaussian(n: int, width: float) -> tuple[FloatArray, FloatArray]:
    """Return the orders above 0 that a smoothing to `width` orders keeps, and their gains."""
    orders = np.arange(1.0, min(n // 2, math.ceil(3.5 * width)))
    return orders, np.exp(-0.5 * (orders / width) ** 2)


def _smear(shape: EdgeShape, scatter_mps2: FloatArray, median_mps2: float) -> float:
    """Return the standard deviation of an edge's place in an average, rad; 0 while the scatter is not known.

    `median_mps2` is the median of the scatter.
    """
    n = len(scatter_mps2)
    index = round((shape.steepest_rad + math.pi) * n / (2.0 * math.pi)) % n
    excess = scatter_mps2.item(index) ** 2 - median_mps2 * median_mps2
    return math.sqrt(excess) / shape.slope_mps2 if excess > 0.0 < shape.slope_mps2 else 0.0


def _half_level_crossings(smooth: FloatArray, contact_index: int, level: float, reach: int) -> tuple[int, int] | None:
    """Return the last indices at or below the level on either side of `contact_index`, or None without crossings."""
    if not smooth[contact_index] < level:
        return None
    first = max(0, contact_index - reach)
    above = smooth[first : contact_index + 1 + reach] > level
    before, after = above[: contact_index - first][::-1], above[contact_index - first + 1 :]
    if not (len(before) and len(after)):
        return None
    # The first point above the level; the first of all where there is none.
    last_before, last_after = int(before.argmax()), int(after.argmax())
    if not (before.item(last_before) and after.item(last_after)):
        return None
    return contact_index - last_before, contact_index + last_after


def _no_edges(
    reason: Reason, plateau: float = math.nan, baseline: float = math.nan, contrast: float = math.nan
) -> ContactEdges:
    nan = math.nan
    return ContactEdges(nan, nan, nan, nan, nan, nan, plateau, baseline, contrast, reason)
