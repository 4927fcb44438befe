"""Estimator of the road's roughness class after ISO 8608, from the change of the contact from revolution to revolution.

The road lifts the tire and the load swings; the length of the contact follows at once. The second difference of
ln(half angle) over three contacts removes what changes slowly, such as load transfer in a curve. Its variance is

    var = g^2 integral |1 - cos(2 pi f T)|^2 |D(f)|^2 A(f)^2 G(f / v) / v df + 3/2 jitter^2

with g = d ln(half angle) / d deflection of the ring, T the revolution's period, D the deflection of a tire of a quarter
car over the height of the road, A = sinc(f L / v) cos(2 pi f t) the averages over the contact length L and over the
times +-t at which the edges are read, v the speed and G(n) = G(n0) (n0 / n)^2 the road's density, n0 = 0.1 cycles/m
(ISO 8608:2016). D depends on four numbers of the vehicle, which are not known: the mean over their usual ranges is
used, and the scatter over the ranges is part of the error.

Edges that jitter independently move the contact's centre as much as its half angle. The centre's times, against a
rotation of steady acceleration, therefore bound the jitter; they contain irregular rotation too.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

from gateway.estimators.determination import DETERMINED
from gateway.estimators.estimator import AngleAverage, Estimate, Revolution, Status, TireConditions, not_used
from gateway.reasons import Code, Reason
from gateway.types import FloatArray

NAMES: Final = ("road_class", "road_roughness_m3")

CLASSES: Final = "ABCDEFGH"
# Roughness G(n0) in the middle of class A, m^3; each class has four times that of the one before (ISO 8608:2016).
_CLASS_A_M3: Final = 16e-6
_REFERENCE_PER_M: Final = 0.1
_LOWEST_PER_M: Final = 0.011
# g R = this (half angle / 0.22 rad)^exponent, and its relative scatter, on 60 random tires of the exact ring.
_RING_RESPONSE: Final = 11.70
_RING_EXPONENT: Final = -1.371
_RING_STD: Final = 0.04
_RING_HALF_RAD: Final = 0.22
# An edge is read from the shape about it, up to the overshoot 0.16 rad outside: on the exact ring, as far outside as this.
_EDGE_READ_RAD: Final = 0.1
# Usual ranges of vehicles, one standard deviation: wheel hop in Hz and its damping ratio (logarithms), frequency of the
# body on its spring in Hz, ratio of sprung to unsprung mass (logarithm).
_HOP_HZ: Final = (12.0, 0.15)
_HOP_DAMPING: Final = (0.25, 0.35)
_BODY_HZ: Final = (1.3, 0.2)
_MASS_RATIO: Final = (8.0, 0.3)
_DRAWS: Final = 64
# Steps of the grids over which the response is computed once.
_SPEED_STEP: Final = 1.1
_CONTACT_STEP: Final = 1.15
# Revolutions that the estimate remembers, and that it needs at least.
_HORIZON: Final = 128
_LEAST: Final = 30
# Share of the bound that is taken as jitter, and its standard error: anywhere between nothing and the bound.
_JITTER_SHARE: Final = 0.5
_JITTER_STD: Final = 0.35
# Third difference of the centres' times with the variance of the half angle's second difference, 3/2 of the jitter's.
_TIMES: Final = tuple(weight * math.sqrt(1.5 / 20.0) for weight in (-1.0, 3.0, -3.0, 1.0))
# Speeds at which the wheel hop lies within the standard's spatial frequencies and the profile is a road's.
_SLOWEST_MPS: Final = 5.0
# Squares beyond this many times the root mean square are cut.
_OUTLIER: Final = 5.0
# Standard deviations of two numbers that are correlated from revolution to revolution count as fewer.
_INDEPENDENT_SHARE: Final = 0.4


class _Contact(NamedTuple):
    """Logarithm of the half angle, and hub time of the centre, of one contact."""

    half: float
    centre_s: float


class RoadRoughnessEstimator:
    """Road class and roughness of the last hundred revolutions or so."""

    def __init__(self) -> None:
        """Start empty."""
        self.reset()

    @property
    def name(self) -> str:
        """Name in the registry."""
        return "road"

    def reset(self) -> None:
        """Forget the road."""
        self._contacts: list[_Contact] = []
        self._leading_rad = math.nan
        self._next = -1
        self._count = 0
        self._total_m3 = self._jitter_m3 = self._model_std = 0.0
        self._band_per_m = (math.nan, math.nan)

    def update(
        self,
        revolution: Revolution,
        average: AngleAverage,  # noqa: ARG002 - part of the interface
        conditions: TireConditions,
    ) -> tuple[Estimate, ...]:
        """Return road_class, 1 in the middle of class A to 8 in that of H, and road_roughness_m3, G(0.1 cycles/m).

        Both state the same. The error of the class is symmetric; that of the roughness is a factor, given as its linear
        part. Never raises on values.
        """
        speed = revolution.omega_radps * conditions.radius_m
        unusable = _unusable(revolution, speed)
        if unusable is not None or revolution.index != self._next:
            self._contacts, self._leading_rad = [], math.nan
        self._next = revolution.index + 1
        if unusable is None:
            # The revolution begins with the second half of a contact, whose first half the one before has measured.
            half = 0.5 * (revolution.trailing_edge_rad - self._leading_rad)
            self._leading_rad = revolution.leading_edge_rad
            if half > 0.0:
                self._contacts = [*self._contacts[-3:], _Contact(math.log(half), revolution.start_s)]
                if len(self._contacts) == len(_TIMES):
                    self._take(half, revolution.omega_radps, conditions.radius_m)
        if self._count < _LEAST:
            waiting = unusable or Reason(Code.NEEDS_REVOLUTIONS, needed=float(_LEAST), count=float(self._count))
            return tuple(Estimate.invalid(name, waiting) for name in NAMES)
        return self._estimates()

    def _take(self, half_rad: float, omega_radps: float, radius_m: float) -> None:
        """Add the differences of the last contacts."""
        _, before, middle, after = (contact.half for contact in self._contacts)
        difference = middle - 0.5 * (before + after)
        times = sum(weight * contact.centre_s for weight, contact in zip(_TIMES, self._contacts, strict=True))
        bound = omega_radps * times / half_rad
        response = _RING_RESPONSE / radius_m * (half_rad / _RING_HALF_RAD) ** _RING_EXPONENT
        gain, self._model_std, self._band_per_m = _road_response(
            round(math.log(omega_radps * radius_m) / math.log(_SPEED_STEP)),
            round(math.log(2.0 * half_rad * radius_m) / math.log(_CONTACT_STEP)),
            round(1e3 * radius_m),
        )
        per_m3 = response**2 * gain
        found, jitter = difference**2 / per_m3, bound**2 / per_m3
        if self._count >= _LEAST:
            # Obstacles and single bad edges are not the road's roughness.
            found = min(found, _OUTLIER**2 * self._total_m3)
            jitter = min(jitter, _OUTLIER**2 * self._jitter_m3)
        self._count += 1
        weight = max(1.0 / self._count, 1.0 / _HORIZON)
        self._total_m3 += weight * (found - self._total_m3)
        self._jitter_m3 += weight * (jitter - self._jitter_m3)

    def _estimates(self) -> tuple[Estimate, ...]:
        effective = _INDEPENDENT_SHARE * min(self._count, 2 * _HORIZON)
        roughness = self._total_m3 - _JITTER_SHARE * self._jitter_m3
        statistical = math.hypot(self._total_m3 * math.sqrt(2.0 / effective), _JITTER_STD * self._jitter_m3)
        if not roughness > DETERMINED * statistical:
            limit = max(roughness, 0.0) + DETERMINED * statistical * math.exp(self._model_std)
            below = Reason(Code.ROAD_BELOW_NOISE, letter=class_letter(_class_of(limit)))
            return tuple(Estimate.invalid(name, below) for name in NAMES)
        relative = math.hypot(statistical / roughness, self._model_std, 2.0 * _RING_STD)
        value, std = _class_of(roughness), relative / math.log(4.0)
        letter = class_letter(value)
        middle = 1.0 + CLASSES.index(letter)
        # The outer classes have no outer limit.
        high = math.inf if letter == CLASSES[-1] else (middle + 0.5 - value) / std
        low = -math.inf if letter == CLASSES[0] else (middle - 0.5 - value) / std
        probability = 0.5 * (math.erf(high / math.sqrt(2.0)) - math.erf(low / math.sqrt(2.0)))
        notes = (
            Reason(Code.ROAD_CLASS, letter=letter, probability=probability),
            Reason(Code.ROAD_WAVES, short_m=1.0 / self._band_per_m[1], long_m=1.0 / self._band_per_m[0]),
        )
        return (
            Estimate(NAMES[0], value, std, Status.VALID, notes),
            Estimate(NAMES[1], roughness, relative * roughness, Status.VALID, notes),
        )


def class_letter(value: float) -> str:
    """Return the letter of a class number, 1 for A; numbers beyond the classes belong to the outer ones."""
    return CLASSES[min(max(round(value), 1), len(CLASSES)) - 1]


def _class_of(roughness_m3: float) -> float:
    return 1.0 + math.log(roughness_m3 / _CLASS_A_M3) / math.log(4.0)


def _unusable(revolution: Revolution, speed_mps: float) -> Reason | None:
    """Return why a revolution says nothing about the road; None when it may be used."""
    if revolution.faults:
        return not_used(revolution.faults)
    if not (revolution.trailing_edge_rad > revolution.leading_edge_rad):
        return Reason(Code.NO_CONTACT_EDGES)
    if not 0.0 < speed_mps < math.inf:
        return Reason(Code.SPEED_OR_RADIUS_UNKNOWN)
    if speed_mps < _SLOWEST_MPS:
        return Reason(Code.TOO_SLOW_FOR_ROAD, limit_mps=_SLOWEST_MPS)
    return None


@lru_cache(maxsize=256)
def _road_response(speed_step: int, contact_step: int, radius_mm: int) -> tuple[float, float, tuple[float, float]]:
    """Return the variance of the second difference of the tire's deflection on a road of G(n0) = 1 m^3.

    Args:
        speed_step: logarithm of the speed in m/s in steps of 10 %.
        contact_step: likewise of the contact length in m, in steps of 15 %.
        radius_mm: belt radius.

    Returns:
        The variance over the usual vehicles (geometric mean), m^2 per m^3; the standard error of its logarithm; the
        spatial frequencies, cycles per m, between which lie four fifths of it.
    """
    speed, contact = _SPEED_STEP**speed_step, _CONTACT_STEP**contact_step
    period = 2.0 * math.pi * 1e-3 * radius_mm / speed
    frequency = np.geomspace(max(_LOWEST_PER_M * speed, 0.2), 120.0, 800)
    second = np.square(1.0 - np.cos(2.0 * math.pi * frequency * period))
    # The road under the contact is averaged over its length; its edges read the load as the sensor enters and leaves.
    reach = 0.5 * contact + _EDGE_READ_RAD * 1e-3 * radius_mm
    averaged = np.square(np.sinc(frequency * contact / speed) * np.cos(2.0 * math.pi * frequency * reach / speed))
    height = (_REFERENCE_PER_M * speed / frequency) ** 2 / speed
    powers = np.square(np.abs(_deflection(frequency))) * (second * averaged * height)
    variances = np.trapezoid(powers, frequency, axis=1)
    logarithms = np.log(variances)
    mean = powers.mean(axis=0) * frequency
    share = np.cumsum(mean) / mean.sum()
    low, high = (float(np.interp(at, share, frequency)) / speed for at in (0.1, 0.9))
    return math.exp(float(logarithms.mean())), float(logarithms.std()), (low, high)


def _deflection(frequency_hz: FloatArray) -> FloatArray:
    """Return (draws, m) deflection of the tire over the height of the road, of the usual vehicles."""
    hop, damping, body, ratio = (draw[:, np.newaxis] for draw in _vehicles())
    s = 2j * math.pi * frequency_hz
    # Of unit unsprung mass: tire and spring together give the hop, the spring the body.
    spring = ratio * np.square(2.0 * math.pi * body)
    tire = np.maximum(np.square(2.0 * math.pi * hop) - spring, spring)
    damper = 2.0 * damping * 2.0 * math.pi * hop
    strut = damper * s + spring
    body_follows = strut / (ratio * s**2 + strut)
    wheel = tire / (s**2 + strut * (1.0 - body_follows) + tire)
    relative: FloatArray = 1.0 - wheel
    return relative


def _vehicles() -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return hop frequency, damping ratio, body frequency and mass ratio of the draws: quantiles, shuffled."""
    from scipy.special import ndtri

    levels = ndtri((np.arange(_DRAWS) + 0.5) / _DRAWS)
    rng = np.random.default_rng(8608)
    columns = [rng.permutation(levels) for _ in range(4)]
    return (
        _HOP_HZ[0] * np.exp(_HOP_HZ[1] * columns[0]),
        _HOP_DAMPING[0] * np.exp(_HOP_DAMPING[1] * columns[1]),
        _BODY_HZ[0] * np.exp(_BODY_HZ[1] * columns[2]),
        _MASS_RATIO[0] * np.exp(_MASS_RATIO[1] * columns[3]),
    )
