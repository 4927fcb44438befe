"""Covariance kernels of the discrepancy: curves near the contact and away from it, of orders, bands, places."""

import itertools
import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, TypeAlias

import numpy as np

from gateway.core.types import FloatArray
from gateway.diagnosis import criteria
from gateway.diagnosis.angle.likelihood import ANGLES, FROM_FIELD, REAL

PLACES: Final[FloatArray] = -np.pi + np.pi / REAL * np.arange(2 * REAL, dtype=np.float64)
"""Angles of the grid on which concentrations are described, (2 REAL,): a blow has orders beyond those compared, without
which it rings all around the wheel."""


def _from_places() -> FloatArray:
    """Return the matrix from a curve at PLACES to its real coefficients; a coefficient is c - i s."""
    phases_rad = np.outer(np.arange(REAL // 2 + 1), PLACES)
    matrix = np.vstack([np.cos(phases_rad), -np.sin(phases_rad[1:])]) / REAL
    matrix[0] /= 2.0
    return matrix


FROM_PLACES: Final[FloatArray] = _from_places()


@dataclass(frozen=True, slots=True)
class OrderLine:
    """Part of the discrepancy at one order, of any phase: a pole wheel, a gear, the rotor of a motor.

    Attributes:
        order: per revolution.
    """

    order: int

    def curves(self) -> FloatArray:
        """Return curves at PLACES whose sum with independent normal weights has the kernel, (2 REAL, 2)."""
        phases_rad = self.order * PLACES
        return np.stack([np.cos(phases_rad), np.sin(phases_rad)], axis=1)


@dataclass(frozen=True, slots=True)
class OrderBand:
    """Part of the discrepancy in a band of orders, of any phase: short waves that no effect describes.

    Attributes:
        first: lowest order.
        last: highest order.
    """

    first: int
    last: int

    def curves(self) -> FloatArray:
        """Return curves at PLACES whose sum with independent normal weights has the kernel, (2 REAL, 2 orders)."""
        phases_rad = np.outer(PLACES, np.arange(self.first, self.last + 1))
        waves: FloatArray = np.concatenate([np.cos(phases_rad), np.sin(phases_rad)], axis=1)
        return waves / math.sqrt(phases_rad.shape[1])


@dataclass(frozen=True, slots=True)
class Burst:
    """Part of the discrepancy at one place of the revolution: a splice, a stone, a part that rubs or strikes.

    Attributes:
        place: index into PLACES of its centre.
        width_rad: standard deviation of its Gaussian window.
        length_rad: correlation length inside.
    """

    place: int
    width_rad: float
    length_rad: float

    def curves(self) -> FloatArray:
        """Return curves at PLACES whose sum with independent normal weights has the kernel, (2 REAL, m)."""
        return np.roll(_centred(self.width_rad, self.length_rad), self.place - REAL, axis=0)


Concentration: TypeAlias = OrderLine | OrderBand | Burst


def concentrations() -> tuple[Concentration, ...]:
    """Return all concentrations that a discrepancy may have."""
    all_concentrations: list[Concentration] = [OrderLine(order) for order in range(1, REAL // 2 + 1)]
    highest = REAL // 2
    for first, following in itertools.pairwise((*criteria.BANDS_FROM, highest + 1)):
        all_concentrations += [OrderBand(first, last) for last in sorted({following - 1, highest})]
    step_rad = 2.0 * math.pi / REAL
    for width in criteria.BURST_WIDTHS_RAD:
        places = range(0, 2 * REAL, 2 * max(1, round(width / step_rad)))
        lengths = (length for length in (criteria.BLOW_RAD, *criteria.LENGTHS_RAD) if length <= width + step_rad)
        all_concentrations += [Burst(centre, width, length) for length in lengths for centre in places]
    return tuple(all_concentrations)


@lru_cache(maxsize=32)
def smooth_kernels(half_angle_rad: float, lengths_rad: tuple[float, ...]) -> FloatArray:
    """Return kernels of unit power of curves near the contact and away from it, (2 lengths, REAL, REAL)."""
    fade = np.clip((np.abs(ANGLES) - half_angle_rad - criteria.NEAR_RAD) / criteria.FADE_RAD, 0.0, 1.0)
    near_window = np.cos(0.5 * math.pi * fade)
    stacked = []
    for window in (near_window, np.sin(0.5 * math.pi * fade)):
        for length in lengths_rad:
            field = _windowed(ANGLES, window, length)
            field /= max(float(np.square(window).mean()), 1e-12)
            stacked.append(FROM_FIELD @ field @ FROM_FIELD.T)
    kernels = np.stack(stacked)
    kernels.setflags(write=False)
    return kernels


def kernel(concentration: Concentration) -> FloatArray:
    """Return the kernel of a concentration, of unit variance at its centre, (REAL, REAL)."""
    coefficients = FROM_PLACES @ concentration.curves()
    result: FloatArray = coefficients @ coefficients.T
    return result


def _windowed(angles: FloatArray, window: FloatArray, length_rad: float) -> FloatArray:
    """Return the covariance at angles (n,) of a curve of one correlation length in a window (n,), (n, n)."""
    versines = 1.0 - np.cos(angles[:, None] - angles[None, :])
    field: FloatArray = np.outer(window, window) * np.exp(-versines / length_rad**2)
    return field


@lru_cache(maxsize=16)
def _centred(width_rad: float, length_rad: float) -> FloatArray:
    """Return the curves of a burst in the middle of PLACES, those left out of which no compared order sees anything."""
    window = np.exp(-0.5 * np.square((PLACES - PLACES[REAL]) / width_rad))
    values, vectors = np.linalg.eigh(_windowed(PLACES, window, length_rad))
    visible = values > 1e-6 * values[-1]
    components: FloatArray = vectors[:, visible] * np.sqrt(values[visible])
    _, sizes, combinations = np.linalg.svd(FROM_PLACES @ components, full_matrices=False)
    curves: FloatArray = components @ combinations[sizes > 1e-3 * sizes[0]].T
    curves.setflags(write=False)
    return curves
