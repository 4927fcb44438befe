"""Estimator of the road's roughness class after ISO 8608, from the change of the contact from revolution to revolution.

The road lifts the tire and the load swings; the length of the contact follows at once. It is measured where the radial
axis crosses the middle between contact and free belt, which needs nothing but the waveform near each edge. What
ln(half width) of a contact differs from a parabola through the nine contacts about it is free of what changes slowly,
such as load transfer in a curve. Its variance is

    var = g^2 integral |H(f T)|^2 |D(f)|^2 A(f)^2 G(f / v) / v df + H2 jitter^2

with H the response of that difference to a frequency, H2 the sum of its squared weights, T the revolution's period,
g = d ln(half width) / d deflection of the ring, D the deflection of a tire of a quarter car over the height of the
road, A = sinc(f L / v) cos(pi f B / v) the averages over the contact length L and over the times at both ends of the
width B, v the speed and G(n) = G(n0) (n0 / n)^2 the road's density, n0 = 0.1 cycles/m (ISO 8608:2016). The stiffness of
the tire over its load is that of the ring. The rest of D depends on three numbers of the vehicle, which are not known:
the mean over their usual ranges is used, and the scatter over the ranges is part of the error.

Edges that jitter independently move the contact's centre as much as its half width. The centre's times, against a
rotation of steady acceleration, therefore bound the jitter; they contain irregular rotation too.
"""

import math
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.estimates.estimator import (
    DETERMINED,
    SETTLED_REVOLUTIONS,
    AngleAverage,
    Estimate,
    Revolution,
    Status,
    TireConditions,
    not_used,
)
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.reasons import CoreCode, Reason
from gateway.core.revolutions.angle_resampling import angle_grid
from gateway.core.trust.reasons import TrustCode
from gateway.core.types import ComplexArray, FloatArray
from gateway.forces.reasons import ForceCode

NAMES: Final = ("road_class", "road_roughness_m3")

CLASSES: Final = "ABCDEFGH"
# Roughness G(n0) in the middle of class A, m^3; each class has four times that of the one before (ISO 8608:2016).
_CLASS_A_M3: Final = 16e-6
_REFERENCE_PER_M: Final = 0.1
_LOWEST_PER_M: Final = 0.011
# On 60 random tires of the exact ring: g R, and R / load times the tire's vertical stiffness, are this times a power of
# the half width over 0.22 rad; relative scatter of the first.
_RING_RESPONSE: Final = (9.70, -1.184)
_RING_STIFFNESS: Final = (13.1, -0.962)
_RING_STD: Final = 0.047
# Contact angle over width at the middle level, on the same tires.
_CONTACT_OVER_WIDTH: Final = 1.25
_RING_HALF_RAD: Final = 0.22
# Plateau of the contact within this share of its half angle, and the free belt beyond this angle.
_PLATEAU_SHARE: Final = 0.4
_FREE_RAD: Final = 1.1
# Usual ranges of vehicles, one standard deviation: damping ratio of the wheel hop and ratio of sprung to unsprung mass
# (logarithms), frequency of the body on its spring in Hz.
_HOP_DAMPING: Final = (0.25, 0.35)
_MASS_RATIO: Final = (8.0, 0.3)
_BODY_HZ: Final = (1.3, 0.2)
_DRAWS: Final = 64
# Steps of the grids over which the response is computed once.
_SPEED_STEP: Final = 1.1
_WIDTH_STEP: Final = 1.15
# Revolutions that the estimate remembers, and that it needs at least.
_HORIZON: Final = 128
_MINIMUM: Final = 30
# Share of the bound that is taken as jitter, and its standard error: anywhere between nothing and the bound.
_JITTER_SHARE: Final = 0.5
_JITTER_STD: Final = 0.35
# Contacts of a parabola, and weights of what the middle one differs from it.
_WINDOW: Final = 9
_DIFFERENCE: Final = -np.linalg.pinv(np.vander(np.arange(_WINDOW) - _WINDOW // 2, 3, increasing=True))[0]
_DIFFERENCE[_WINDOW // 2] += 1.0
_SQUARED: Final = float(_DIFFERENCE @ _DIFFERENCE)
# Third difference of the centres' times with the variance of that difference.
_TIMES: Final = np.array([-1.0, 3.0, -3.0, 1.0]) * math.sqrt(_SQUARED / 20.0)
# Speeds at which the wheel hop lies within the standard's spatial frequencies and the profile is a road's.
_SLOWEST_MPS: Final = 5.0
# Squares beyond this many times the root mean square are cut.
_OUTLIER: Final = 5.0
# Contacts are correlated, so that fewer of them count.
_INDEPENDENT_SHARE: Final = 0.4


class _Contact(NamedTuple):
    """Logarithm of the half width, and hub time of the centre, of one contact."""

    half: float
    centre_s: float


class RoadRoughnessEstimator:
    """Road class and roughness of the last hundred revolutions or so."""

    name = "road"

    def __init__(self) -> None:
        """Start empty."""
        self.reset()

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
        average: AngleAverage,
        conditions: TireConditions,
    ) -> tuple[Estimate, ...]:
        """Return road_class, 1 in the middle of class A to 8 in that of H, and road_roughness_m3, G(0.1 cycles/m).

        Both state the same. The error of the class is symmetric; that of the roughness is a factor, given as its linear
        part. Never raises on values.
        """
        crossings, unusable = _crossings(revolution, average, revolution.omega_radps * conditions.radius_m)
        if crossings is None or revolution.index != self._next or not revolution.follows:
            self._contacts, self._leading_rad = [], math.nan
        self._next = revolution.index + 1
        if crossings is not None:
            # The revolution begins with the second half of a contact, whose first half the one before has measured.
            half = 0.5 * (crossings[1] - self._leading_rad)
            self._leading_rad = crossings[0]
            if half > 0.0:
                self._contacts = [*self._contacts[1 - _WINDOW :], _Contact(math.log(half), revolution.start_s)]
                if len(self._contacts) == _WINDOW:
                    self._take(half, revolution.omega_radps, conditions.radius_m)
        if self._count < _MINIMUM:
            waiting = unusable or Reason(TrustCode.NEEDS_REVOLUTIONS, needed=float(_MINIMUM), count=float(self._count))
            return tuple(Estimate.invalid(name, waiting) for name in NAMES)
        return self._estimates()

    def _take(self, half_rad: float, omega_radps: float, radius_m: float) -> None:
        """Add the differences of the last contacts."""
        halves, centres = np.array(self._contacts).T
        difference = float(_DIFFERENCE @ halves)
        # Relative to the first, so that hours of hub time lose no digits.
        times = float(_TIMES @ (centres[-len(_TIMES) :] - centres[0]))
        bound = omega_radps * times / half_rad
        response = _of_ring(_RING_RESPONSE, half_rad, radius_m)
        gain, self._model_std, self._band_per_m = _road_response(
            round(math.log(omega_radps * radius_m) / math.log(_SPEED_STEP)),
            round(math.log(2.0 * half_rad * radius_m) / math.log(_WIDTH_STEP)),
            round(1e3 * radius_m),
        )
        per_m3 = response**2 * gain
        roughness_m3, jitter = difference**2 / per_m3, bound**2 / per_m3
        if self._count >= _MINIMUM:
            # Obstacles and single bad edges are not the road's roughness.
            roughness_m3 = min(roughness_m3, _OUTLIER**2 * self._total_m3)
            jitter = min(jitter, _OUTLIER**2 * self._jitter_m3)
        self._count += 1
        weight = max(1.0 / self._count, 1.0 / _HORIZON)
        self._total_m3 += weight * (roughness_m3 - self._total_m3)
        self._jitter_m3 += weight * (jitter - self._jitter_m3)

    def _estimates(self) -> tuple[Estimate, ...]:
        effective = _INDEPENDENT_SHARE * min(self._count, 2 * _HORIZON)
        roughness = self._total_m3 - _JITTER_SHARE * self._jitter_m3
        statistical = math.hypot(self._total_m3 * math.sqrt(2.0 / effective), _JITTER_STD * self._jitter_m3)
        if not roughness > DETERMINED * statistical:
            limit = max(roughness, 0.0) + DETERMINED * statistical * math.exp(self._model_std)
            below = Reason(ForceCode.ROAD_BELOW_NOISE, letter=class_letter(_roughness_class(limit)))
            return tuple(Estimate.invalid(name, below) for name in NAMES)
        relative = math.hypot(statistical / roughness, self._model_std, 2.0 * _RING_STD)
        value, std = _roughness_class(roughness), relative / math.log(4.0)
        letter = class_letter(value)
        middle = 1.0 + CLASSES.index(letter)
        # The outer classes have no outer limit.
        high = math.inf if letter == CLASSES[-1] else (middle + 0.5 - value) / std
        low = -math.inf if letter == CLASSES[0] else (middle - 0.5 - value) / std
        probability = 0.5 * (math.erf(high / math.sqrt(2.0)) - math.erf(low / math.sqrt(2.0)))
        notes = (
            Reason(ForceCode.ROAD_CLASS, letter=letter, probability=probability),
            Reason(ForceCode.ROAD_WAVES, short_m=1.0 / self._band_per_m[1], long_m=1.0 / self._band_per_m[0]),
        )
        return (
            Estimate(NAMES[0], value, std, Status.VALID, notes),
            Estimate(NAMES[1], roughness, relative * roughness, Status.VALID, notes),
        )


def _of_ring(law: tuple[float, float], half_rad: float, radius_m: float) -> float:
    """Return a power law of the half angle over the radius, 1/m."""
    return float(law[0] / radius_m * (half_rad / _RING_HALF_RAD) ** law[1])


def class_letter(value: float) -> str:
    """Return the letter of a class number, 1 for A; numbers beyond the classes belong to the outer ones."""
    return CLASSES[min(max(round(value), 1), len(CLASSES)) - 1]


def _roughness_class(roughness_m3: float) -> float:
    return 1.0 + math.log(roughness_m3 / _CLASS_A_M3) / math.log(4.0)


def _crossings(
    revolution: Revolution, average: AngleAverage, speed_mps: float
) -> tuple[tuple[float, float] | None, Reason | None]:
    """Return where the radial axis crosses the middle level, leading and trailing, in rad, or why it cannot be used."""
    if revolution.faults:
        return None, not_used(revolution.faults)
    if not 0.0 < speed_mps < math.inf:
        return None, Reason(EstimateCode.SPEED_OR_RADIUS_UNKNOWN)
    if speed_mps < _SLOWEST_MPS:
        return None, Reason(ForceCode.TOO_SLOW_FOR_ROAD, limit_mps=_SLOWEST_MPS)
    if average.effective_count < SETTLED_REVOLUTIONS:
        return None, Reason(CoreCode.NOT_SETTLED, revolutions=average.effective_count, needed=SETTLED_REVOLUTIONS)
    n = len(average.radial_mps2)
    angles = angle_grid(n)
    inside = (angles > _PLATEAU_SHARE * average.leading_edge_rad) & (
        angles < _PLATEAU_SHARE * average.trailing_edge_rad
    )
    radial = revolution.radial_mps2
    if not (inside.any() and np.isfinite(radial).all()):
        return None, Reason(EstimateCode.NO_CONTACT_EDGES)
    # The level is the average's: that of a single revolution would follow the hub's acceleration.
    plateau = float(average.radial_mps2[inside].mean())
    level = 0.5 * (plateau + float(np.median(average.radial_mps2[np.abs(angles) > _FREE_RAD])))
    above = radial > level
    middle = n // 2
    trailing, leading = int(np.argmax(above[middle:])) + middle, middle - int(np.argmax(above[middle::-1]))
    if above[middle] or not (above[trailing] and above[leading]):
        return None, Reason(EstimateCode.NO_CONTACT_EDGES)
    spacing = 2.0 * math.pi / n
    crossings = []
    for outer, step in ((leading, -1), (trailing, 1)):
        low, high = float(radial[outer - step]), float(radial[outer])
        crossings.append(float(angles[outer]) - step * spacing * (high - level) / (high - low))
    return (crossings[0], crossings[1]), None


@lru_cache(maxsize=256)
def _road_response(speed_step: int, width_step: int, radius_mm: int) -> tuple[float, float, tuple[float, float]]:
    """Return the variance of the difference of the tire's deflection from its parabola on a road of G(n0) = 1 m^3.

    Args:
        speed_step: logarithm of the speed in m/s in steps of 10 %.
        width_step: likewise of the width in m, in steps of 15 %.
        radius_mm: belt radius.

    Returns:
        The variance over the usual vehicles (geometric mean), m^2 per m^3; the standard error of its logarithm; the
        spatial frequencies, cycles per m, between which lie four fifths of it.
    """
    speed, width = _SPEED_STEP**speed_step, _WIDTH_STEP**width_step
    period = 2.0 * math.pi * 1e-3 * radius_mm / speed
    frequency = np.geomspace(max(_LOWEST_PER_M * speed, 0.2), 120.0, 800)
    phasors = np.exp(2j * math.pi * np.outer(frequency * period, np.arange(_WINDOW)))
    difference_gain = np.square(np.abs(phasors @ _DIFFERENCE))
    # The road under the contact is averaged over its length; its edges read the load as the sensor enters and leaves.
    contact_gain = np.square(
        np.sinc(frequency * _CONTACT_OVER_WIDTH * width / speed) * np.cos(math.pi * frequency * width / speed)
    )
    height = (_REFERENCE_PER_M * speed / frequency) ** 2 / speed
    radius_m = 1e-3 * radius_mm
    per_mass = STANDARD_GRAVITY_MPS2 * _of_ring(_RING_STIFFNESS, 0.5 * width / radius_m, radius_m)
    powers = np.square(np.abs(_deflection(frequency, per_mass))) * (difference_gain * contact_gain * height)
    variances = np.trapezoid(powers, frequency, axis=1)
    logarithms = np.log(variances)
    mean = powers.mean(axis=0) * frequency
    cumulative = np.cumsum(mean) / mean.sum()
    low, high = (float(np.interp(level, cumulative, frequency)) / speed for level in (0.1, 0.9))
    return math.exp(float(logarithms.mean())), float(logarithms.std()), (low, high)


def _deflection(frequency_hz: FloatArray, tire_per_mass: float) -> ComplexArray:
    """Return (draws, m) deflection of the tire over the height of the road, of the usual vehicles.

    Args:
        frequency_hz: (m,) not 0.
        tire_per_mass: the tire's vertical stiffness over the mass that it carries, wheel included, 1/s^2.
    """
    damping, ratio, body = (draw[:, np.newaxis] for draw in _vehicles())
    s = 2j * math.pi * frequency_hz
    # Of unit unsprung mass.
    tire = (1.0 + ratio) * tire_per_mass
    spring = ratio * np.square(2.0 * math.pi * body)
    damper = 2.0 * damping * np.sqrt(tire + spring)
    strut = damper * s + spring
    body_follows = strut / (ratio * s**2 + strut)
    wheel = tire / (s**2 + strut * (1.0 - body_follows) + tire)
    relative: ComplexArray = np.asarray(1.0 - wheel, np.complex128)
    return relative


def _vehicles() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return damping ratio of the hop, mass ratio and body frequency of the draws: quantiles, shuffled."""
    from scipy.special import ndtri

    levels = ndtri((np.arange(_DRAWS) + 0.5) / _DRAWS)
    rng = np.random.default_rng(8608)
    columns = [rng.permutation(levels) for _ in range(3)]
    return (
        _HOP_DAMPING[0] * np.exp(_HOP_DAMPING[1] * columns[0]),
        _MASS_RATIO[0] * np.exp(_MASS_RATIO[1] * columns[1]),
        _BODY_HZ[0] + _BODY_HZ[1] * columns[2],
    )
