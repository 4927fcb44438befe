"""Distance of a contact edge from the steepest slope of the radial waveform, from the waveform's shape next to it.

The distance depends on bending, tension, tread and load of the tire, and so do features of the smoothed waveform: the
distance of the overshoot's top, its product with the overshoot's height, the width of the transition from contact to
free belt, and the width of its steepest part. The distance is a linear function of these, fitted on random tires of the
geometrically exact ring (tools/fit_contact_edges.py). Its standard error is that at tires left out of the fit, with a
margin for tires that are no rings.

A tread can make waves that are locked to the tire, run out of both edges and swing in the contact. They shift the
steepest slope and distort the features, in the stronger smoothing less than in the usual one. So the edge is found with
several widths. On a smooth ring they agree within their errors; where they do not, or where the free belt ripples, the
stronger smoothing counts, with its larger error.

Where the waveform is the average of contacts of different lengths, which smears its edges, the mean distance counts,
with its spread over tires as standard error.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

from gateway.core.types import FloatArray

# Width of the smoothing in orders, and for each: the mean distance, its change per feature about the features' means,
# then the standard error. Means and standard deviations of the features over tires. rad.
_WIDTHS: Final = (15.0, 17.5, 20.0, 25.0, 30.0, 40.0)
_DISTANCES: Final = (
    (0.0055, 0.0090, 0.0114, 0.0145, 0.0162, 0.0178),
    (-0.3157, -0.2148, -0.1366, -0.0659, -0.0618, -0.0687),
    (-0.4654, -0.4555, -0.4616, -0.4236, -0.3269, -0.2006),
    (-0.3951, -0.5030, -0.6300, -0.7233, -0.5926, -0.3539),
    (2.8540, 2.8035, 2.8442, 2.8322, 2.4815, 1.8535),
    (0.0122, 0.0101, 0.0084, 0.0061, 0.0052, 0.0039),
)
_FEATURE_MEANS_RAD: Final = (
    (0.2263, 0.2221, 0.2195, 0.2164, 0.2148, 0.2132),
    (0.0794, 0.0792, 0.0790, 0.0788, 0.0787, 0.0785),
    (0.1607, 0.1468, 0.1373, 0.1251, 0.1180, 0.1099),
    (0.0835, 0.0776, 0.0730, 0.0665, 0.0620, 0.0562),
)
_FEATURE_STDS_RAD: Final = (
    (0.0418, 0.0448, 0.0472, 0.0504, 0.0524, 0.0547),
    (0.0332, 0.0327, 0.0324, 0.0321, 0.0319, 0.0317),
    (0.0234, 0.0220, 0.0213, 0.0208, 0.0208, 0.0208),
    (0.0105, 0.0101, 0.0098, 0.0095, 0.0094, 0.0094),
)
# Standard deviation of the distance over tires.
_DISTANCE_SPREADS_RAD: Final = (0.0254, 0.0224, 0.0201, 0.0170, 0.0150, 0.0125)
# Ripple of the free belt, over the step from contact to free belt, at which an edge counts by half against that of a
# stronger smoothing. On smooth rings it is 0.0009 in the median and 0.0034 at the 99th percentile; on a measured tire
# it is 0.014.
_HALF_TRUST_RIPPLE: Final = 0.0045
# Likewise the difference of both edges, over the standard error that it has on a smooth ring.
_HALF_TRUST_DIFFERENCE: Final = 1.5
# Share of the difference between the two strongest smoothings that waves leave in the stronger one: 15 orders leave 0.3
# to 0.4 of what a wave of order 33 to 35, lower than any seen, does at 20 orders, and less of every shorter wave.
_REMAINING_WAVES: Final = 0.4
# Standard deviation of the edge in an average, rad, at which features count by half.
_HALF_TRUST_SMEAR_RAD: Final = 0.006
# A feature further than this many standard deviations from its mean is none of a tire's on a road.
_MAX_DEPARTURE: Final = 3.0


class EdgeShape(NamedTuple):
    """Shape of the smoothed waveform next to a contact edge.

    Attributes:
        steepest_rad: angle of the steepest slope.
        slope_mps2: the slope there per rad, positive outward.
        bend_mps2: minus the second derivative of the slope there.
        to_top_rad: from there outward to the top of the overshoot.
        overshoot: height of the top above the free belt, over the step from contact to free belt.
        top_bend_mps2: minus the second derivative of the waveform at the top.
        transition_rad: step from contact to free belt over the slope.
    """

    steepest_rad: float
    slope_mps2: float
    bend_mps2: float
    to_top_rad: float
    overshoot: float
    top_bend_mps2: float
    transition_rad: float

    @property
    def features_rad(self) -> FloatArray:
        """The four features, (4,); infinite where the waveform has none."""
        steep = math.sqrt(self.slope_mps2 / self.bend_mps2) if self.slope_mps2 > 0.0 < self.bend_mps2 else math.inf
        return np.array([self.to_top_rad, self.to_top_rad * self.overshoot, self.transition_rad, steep])

    def noises_rad(self, slope_std_mps2: float, slope_bend_std_mps2: float) -> FloatArray:
        """Return the standard errors of the features, (4,).

        Args:
            slope_std_mps2: noise of the waveform's derivative.
            slope_bend_std_mps2: noise of its third derivative.
        """
        if not (self.top_bend_mps2 > 0.0 and self.slope_mps2 > 0.0 and self.bend_mps2 > 0.0):
            return np.full(4, math.inf)
        relative = slope_std_mps2 / self.slope_mps2
        steep = 0.5 * float(self.features_rad[3]) * math.hypot(slope_bend_std_mps2 / self.bend_mps2, relative)
        top = slope_std_mps2 / self.top_bend_mps2
        return np.array([top, top * abs(self.overshoot), self.transition_rad * relative, steep])


class EdgeDistance(NamedTuple):
    """Distance of the edge outside the steepest slope.

    Attributes:
        distance_rad: the distance.
        noise_std_rad: standard error from noise.
        model_std_rad: standard error of the linear function, a constant error of all revolutions of a tire.
    """

    distance_rad: float
    noise_std_rad: float
    model_std_rad: float


def edge_shape(
    smooth_mps2: FloatArray,
    slope_mps2: FloatArray,
    index: int,
    direction: int,
    levels_mps2: tuple[float, float],
    reach: int,
) -> EdgeShape:
    """Return the shape next to an edge.

    Args:
        smooth_mps2: (n,) smoothed waveform on the angle grid.
        slope_mps2: (n,) its derivative by angle.
        index: grid point on the edge's slope.
        direction: -1 for the leading edge, 1 for the trailing edge.
        levels_mps2: of contact and free belt.
        reach: grid points outward within which the overshoot is searched.
    """
    n = len(slope_mps2)
    spacing = 2.0 * math.pi / n
    outward = slope_mps2 * direction
    edge = _climb(outward, index)
    preceding, middle, following = (outward.item((edge + step) % n) for step in (-1, 0, 1))
    bend = 2.0 * middle - preceding - following
    position = edge + 0.5 * (following - preceding) / bend if bend > 0.0 else float(edge)
    outward_profile = outward[(edge + direction * np.arange(reach + 2)) % n]
    falling = np.flatnonzero(outward_profile <= 0.0)
    top = max(int(falling[0]), 1) if len(falling) else len(outward_profile) - 1
    before, after = float(outward_profile[top - 1]), float(outward_profile[top])
    share = before / (before - after) if before > after else 1.0
    contact_level, free_level = levels_mps2
    height = float(smooth_mps2[(edge + direction * top) % n]) - free_level
    return EdgeShape(
        steepest_rad=-math.pi + position * spacing,
        slope_mps2=middle,
        bend_mps2=max(bend, 0.0) / spacing**2,
        to_top_rad=spacing * (top - 1 + share - direction * (position - edge)),
        overshoot=height / (free_level - contact_level),
        top_bend_mps2=(before - after) / spacing,
        transition_rad=(free_level - contact_level) / middle if middle > 0.0 else math.inf,
    )


def edge_distance(
    width: float, features_rad: FloatArray, noises_rad: FloatArray, smear_rad: float = 0.0
) -> EdgeDistance:
    """Return the distance from the features.

    The noisier a feature, the more its mean over tires counts in place of it.

    Args:
        width: of the smoothing, in orders.
        features_rad: (4,) of the shape.
        noises_rad: (4,) their standard errors.
        smear_rad: standard deviation of the edge's place over the revolutions of an average.
    """
    model = _linear_model(width)
    sharpness = 1.0 / (1.0 + (smear_rad / _HALF_TRUST_SMEAR_RAD) ** 4)
    distance, noise2, unknown2 = model.mean_rad, 0.0, 0.0
    for feature, noise, (factor, mean, spread) in zip(
        features_rad.tolist(), noises_rad.tolist(), model.features, strict=True
    ):
        trust = 0.0
        if math.isfinite(feature) and math.isfinite(noise):
            trust = spread**2 / (spread**2 + noise**2)
            resolved, limit = sharpness * factor * trust, _MAX_DEPARTURE * spread
            distance += resolved * min(max(feature - mean, -limit), limit)
            noise2 += (resolved * noise) ** 2
        unknown2 += (sharpness * factor * spread) ** 2 * (1.0 - trust)
    smeared_std = math.sqrt(1.0 - sharpness) * model.spread_rad
    return EdgeDistance(distance, math.sqrt(noise2), math.hypot(model.std_rad, math.sqrt(unknown2), smeared_std))


class EdgePlace(NamedTuple):
    """Place of an edge as found with one smoothing.

    Attributes:
        width: of the smoothing, in orders.
        angle_rad: of the edge.
        noise_std_rad: standard error from noise.
        model_std_rad: standard error of the edge's definition, a constant error of all revolutions of a tire.
    """

    width: float
    angle_rad: float
    noise_std_rad: float
    model_std_rad: float


def edge_among_waves(places: Sequence[EdgePlace], ripple: float) -> EdgePlace:
    """Return the place of an edge from those found with stronger and stronger smoothing.

    Args:
        places: the usual smoothing first, at least one.
        ripple: rms of the waves of the free belt, over the step from contact to free belt.
    """
    edge, waves_remaining = places[-1], _REMAINING_WAVES
    for index in range(len(places) - 2, -1, -1):
        position, stronger = places[index], places[index + 1]
        difference = position.angle_rad - edge.angle_rad
        # The error of the stronger smoothing contains that of the weaker one.
        variance = model_std_rad(stronger.width) ** 2 - model_std_rad(position.width) ** 2
        variance += position.noise_std_rad**2 + edge.noise_std_rad**2
        waves = (difference / _HALF_TRUST_DIFFERENCE) ** 2 / variance
        trust = 1.0 / (1.0 + waves * waves + (ripple / _HALF_TRUST_RIPPLE) ** 4 * (index == 0))
        stronger_weight = 1.0 - trust
        model = trust * position.model_std_rad + stronger_weight * edge.model_std_rad
        edge = EdgePlace(
            position.width,
            edge.angle_rad + trust * difference,
            trust * position.noise_std_rad + stronger_weight * edge.noise_std_rad,
            math.sqrt(model**2 + (trust * stronger_weight + waves_remaining * waves_remaining) * difference**2),
        )
        waves_remaining = 0.0
    return edge


class _LinearModel(NamedTuple):
    """The linear function at one width of the smoothing.

    Attributes:
        mean_rad: distance at the features' means.
        features: for each feature its factor, its mean and its standard deviation over tires.
        std_rad: standard error of the function.
        spread_rad: standard deviation of the distance over tires.
    """

    mean_rad: float
    features: tuple[tuple[float, float, float], ...]
    std_rad: float
    spread_rad: float


@lru_cache(maxsize=32)
def _linear_model(width: float) -> _LinearModel:
    """Return the linear function at a width of the smoothing in orders, interpolated between those of the tables."""

    def at_width(column: tuple[float, ...]) -> float:
        return float(np.interp(width, _WIDTHS, column))

    mean, *factors, std = map(at_width, _DISTANCES)
    tables = map(at_width, _FEATURE_MEANS_RAD), map(at_width, _FEATURE_STDS_RAD)
    return _LinearModel(mean, tuple(zip(factors, *tables, strict=True)), std, at_width(_DISTANCE_SPREADS_RAD))


def model_std_rad(width: float) -> float:
    """Return the standard error of the distance without noise, for a width of the smoothing in orders."""
    return _linear_model(width).std_rad


def _climb(slope: FloatArray, index: int) -> int:
    """Return the grid point of the local maximum that is reached by climbing from `index`."""
    n = len(slope)
    while 0 < index < n - 1:
        if slope[index + 1] > slope[index]:
            index += 1
        elif slope[index - 1] > slope[index]:
            index -= 1
        else:
            break
    return index
