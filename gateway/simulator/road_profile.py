"""Random road profile after ISO 8608, and a quarter of a car that rolls over it."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.types import FloatArray
from gateway.simulator.filters import Biquad
from gateway.simulator.tire_model import TireModel

REFERENCE_PER_M: Final = 0.1
"""Spatial frequency at which ISO 8608 states the roughness, cycles per m."""
CLASSES: Final = "ABCDEFGH"
# Geometric mean of the roughness of class A, m^3; each class has four times that of the one before.
_CLASS_A_M3: Final = 16e-6
# Lowest spatial frequency of the standard, cycles per m. Finer waves than the standard's are kept: the contact's length
# averages them out.
_LOWEST_PER_M: Final = 0.011
# Points of the profile and their distance: a road of 7.9 km, which then repeats.
_POINTS: Final = 1 << 18
_STEP_M: Final = 0.03
# Loads are solved to this many standard deviations, and to this share of the load at most.
_SWING_STDS: Final = 4.5
_SWING_LARGEST: Final = 0.75
# Step of load for the tire's vertical stiffness.
_LOAD_STEP: Final = 0.02


def roughness_m3(name: str) -> float:
    """Return the roughness in the middle of a class: displacement density at 0.1 cycles/m."""
    return _CLASS_A_M3 * 4.0 ** CLASSES.index(name)


class RoadProfile:
    """Height of the road along the wheel's path, averaged over the contact's length; repeats after 7.9 km."""

    def __init__(self, density_m3: float, waviness: float, contact_m: float, rng: np.random.Generator) -> None:
        """Draw a profile of one-sided density `density_m3` (n / 0.1)^-waviness, n in cycles per m."""
        frequency = np.fft.rfftfreq(_POINTS, _STEP_M)
        density = np.zeros(len(frequency))
        inside = frequency >= _LOWEST_PER_M
        density[inside] = density_m3 * (frequency[inside] / REFERENCE_PER_M) ** -waviness
        # Half the density on either side: the variance of each complex coefficient.
        size = np.sqrt(0.5 * density * frequency[1]) * np.sinc(frequency * contact_m)
        phases = rng.standard_normal((2, len(frequency)))
        self._height = np.fft.irfft(size * (phases[0] + 1j * phases[1]), n=_POINTS) * (_POINTS / math.sqrt(2.0))

    def __call__(self, distance_m: FloatArray) -> FloatArray:
        """Return the heights, m."""
        places = np.arange(_POINTS) * _STEP_M
        heights: FloatArray = np.interp(distance_m, places, self._height, period=_POINTS * _STEP_M)
        return heights


@dataclass(frozen=True, slots=True)
class QuarterCar:
    """A wheel on its tire, and its share of the body on spring and damper.

    Attributes:
        sprung_kg: share of the body.
        unsprung_kg: wheel, tire and part of the suspension.
        spring_npm: of the suspension.
        damper_nspm: likewise.
        tire_npm: vertical stiffness of the tire.
        contact_m: contact length.
    """

    sprung_kg: float
    unsprung_kg: float
    spring_npm: float
    damper_nspm: float
    tire_npm: float
    contact_m: float

    def poles(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return (a1, a0) of s^2 + a1 s + a0 for the slower and the faster pair of poles, in 1/s."""
        ms, mu, c = self.sprung_kg, self.unsprung_kg, self.damper_nspm
        unsprung = np.array([mu, c, self.spring_npm + self.tire_npm])
        sprung = np.array([ms, c, self.spring_npm])
        roots = np.roots(np.polymul(unsprung, sprung) - np.pad(np.convolve(sprung[1:], sprung[1:]), (2, 0)))
        order = np.argsort(np.abs(roots))
        slow, fast = roots[order[:2]], roots[order[2:]]
        return (
            (-float(slow.sum().real), float(slow.prod().real)),
            (-float(fast.sum().real), float(fast.prod().real)),
        )

    def load_std_n(self, density_m3: float, waviness: float, speed_mps: float) -> float:
        """Return the standard deviation of the load on a road at a speed."""
        frequency = np.geomspace(_LOWEST_PER_M * speed_mps, 10.0 * speed_mps, 4000)
        s = 2j * np.pi * frequency
        (a1, a0), (b1, b0) = self.poles()
        mass = self.sprung_kg + self.unsprung_kg
        product = self.sprung_kg * self.unsprung_kg
        deflection = s**2 / (s**2 + a1 * s + a0) * (s**2 + mass / product * (self.damper_nspm * s + self.spring_npm))
        deflection /= s**2 + b1 * s + b0
        height = density_m3 / speed_mps * (frequency / speed_mps / REFERENCE_PER_M) ** -waviness
        return self.tire_npm * math.sqrt(float(np.trapezoid(np.abs(deflection) ** 2 * height, frequency)))


@lru_cache(maxsize=32)
def quarter_car(
    tire: TireModel, load_n: float, pressure_pa: float, unsprung_kg: float, spring_npm: float, damper_nspm: float
) -> QuarterCar:
    """Return the quarter car of a wheel that carries `load_n` at rest.

    Raises:
        ValueError: the load does not exceed the weight of the wheel.
        RingNotConvergedError: the tire has no equilibrium.
    """
    sprung_kg = load_n / STANDARD_GRAVITY_MPS2 - unsprung_kg
    if sprung_kg <= 0.0:
        raise ValueError(
            f"the load of {load_n:g} N does not exceed the weight of an unsprung mass of {unsprung_kg:g} kg"
        )
    less, more = (tire.solve(load_n * (1.0 + step), pressure_pa, 0.0) for step in (-_LOAD_STEP, _LOAD_STEP))
    stiffness = 2.0 * _LOAD_STEP * load_n / (less.axle_height_m - more.axle_height_m)
    contact = less.ring.radius_m * (less.trailing_edge_rad - less.leading_edge_rad)
    return QuarterCar(sprung_kg, unsprung_kg, spring_npm, damper_nspm, stiffness, contact)


def largest_swing(car: QuarterCar, load_n: float, density_m3: float, waviness: float, speed_mps: float) -> float:
    """Return the largest change of load that is simulated, over the load."""
    if not speed_mps > 0.0:
        return 0.05
    return min(_SWING_STDS * car.load_std_n(density_m3, waviness, speed_mps) / load_n, _SWING_LARGEST)


class RoadRide:
    """Change of the load and vertical acceleration of the hub while a quarter car rolls over a profile."""

    def __init__(self, profile: RoadProfile, car: QuarterCar, rate_hz: float) -> None:
        """Start at rest on the first height."""
        self._profile = profile
        self._tire_npm = car.tire_npm
        body, hop = car.poles()
        mass, product = car.sprung_kg + car.unsprung_kg, car.sprung_kg * car.unsprung_kg
        ratio = car.tire_npm / product
        self._body = _section((1.0, 0.0, 0.0), body, rate_hz)
        self._deflection = _section(
            (1.0, mass / product * car.damper_nspm, mass / product * car.spring_npm), hop, rate_hz
        )
        self._hub = _section((ratio * car.sprung_kg, ratio * car.damper_nspm, ratio * car.spring_npm), hop, rate_hz)

    def __call__(self, distance_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the change of the load in N and the hub's upward acceleration in m/s^2 at the next samples."""
        common = self._body(self._profile(distance_m)[:, None])
        return self._tire_npm * self._deflection(common)[:, 0], self._hub(common)[:, 0]


def _section(numerator: tuple[float, float, float], poles: tuple[float, float], rate_hz: float) -> Biquad:
    """Return (b2 s^2 + b1 s + b0) / (s^2 + a1 s + a0) by the bilinear transform."""
    k = 2.0 * rate_hz
    b2, b1, b0 = numerator
    a1, a0 = poles
    scale = k * k + a1 * k + a0
    forward = ((b2 * k * k + b1 * k + b0) / scale, 2.0 * (b0 - b2 * k * k) / scale, (b2 * k * k - b1 * k + b0) / scale)
    return Biquad(forward, (2.0 * (a0 - k * k) / scale, (k * k - a1 * k + a0) / scale))
