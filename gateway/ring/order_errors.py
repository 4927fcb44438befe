"""Standard errors of the orders of an averaged waveform, equal within bands of orders."""

import math
from itertools import pairwise
from typing import Final

import numpy as np

from gateway.core.revolutions.order_spectrum import ORDER_COUNT
from gateway.core.types import ComplexArray, FloatArray

# Bands of orders [first, next); orders 0 and 1 belong to the first.
BANDS: Final = (2, 4, 6, 9, 13, 18, 24, 31, 39, 48, ORDER_COUNT)
_BAND_OF: Final = np.searchsorted(np.array(BANDS), np.arange(ORDER_COUNT), side="right").clip(1) - 1
_BAND_COUNT: Final = len(BANDS) - 1
# (bands, ORDER_COUNT): 1 for the orders of each band.
_MASKS: Final[FloatArray] = np.where(
    np.arange(ORDER_COUNT) >= BANDS[0], np.arange(_BAND_COUNT)[:, np.newaxis] == _BAND_OF, 0.0
)
# Least standard error of an order, as a share of the mean: resampling and rounding.
_MIN_STD: Final = 1e-6
# First of the bands in which the belt's shape has decayed to less than the waves that tread blocks make.
_WAVE_BAND: Final = BANDS.index(39)
# Power over that of noise from which it is not noise alone: in a band of nine orders noise exceeds it once in 30.
_BEYOND_NOISE: Final = 2.0


def relative_std(order_std: FloatArray, mean: float, orders: FloatArray, max_order: int) -> FloatArray:
    """Return standard errors of the relative signal's orders, smoothed by band, (ORDER_COUNT,).

    From a few revolutions the scatter of one order is poorly known, that of a band well. Orders above those that the
    sampling carries get an error as large as the last orders that it does carry.

    Args:
        order_std: (ORDER_COUNT,) measured standard errors; NaN where not known.
        mean: of the signal, in the same unit.
        orders: (>= max_order + 1,) size of the relative orders.
        max_order: highest order that the sampling carries.
    """
    variance = np.square(order_std / mean)
    measured = np.isfinite(variance)
    counts = np.bincount(_BAND_OF[measured], minlength=_BAND_COUNT)
    sums = np.bincount(_BAND_OF[measured], variance[measured], minlength=_BAND_COUNT)
    overall = float(sums.sum() / max(int(counts.sum()), 1))
    by_band = np.where(counts > 0, sums / np.maximum(counts, 1), overall)
    std: FloatArray = np.sqrt(by_band[_BAND_OF])
    if max_order < ORDER_COUNT - 1:
        last = orders[max(BANDS[0], max_order - 7) : max_order + 1]
        std[max_order + 1 :] = np.maximum(std[max_order + 1 :], math.sqrt(float(np.square(last).mean())))
    return np.maximum(std, _MIN_STD)


def wave_std(signal: ComplexArray, noise_std: FloatArray, max_order: int) -> FloatArray:
    """Return standard errors of the relative signal's cosine orders by waves that are not its shape, (ORDER_COUNT,).

    Tread blocks make waves that repeat every revolution, of orders around the number of blocks and up to 30 away from
    it. Unlike the shape of the belt they have sines as strong as cosines, and orders above ORDER_COUNT. A belt that
    loses energy has sines without the latter, a clipped signal the latter without sines: only what both show counts.

    Args:
        signal: (> max_order) orders c - i s about the contact centre.
        noise_std: (ORDER_COUNT,) as of `relative_std`.
        max_order: highest order that the sampling carries.
    """
    relative = signal[: max_order + 1] / signal[0].real
    variance = np.zeros(ORDER_COUNT)
    powers = np.square(np.abs(relative[ORDER_COUNT:]))
    high_order_power = 0.5 * float(powers.mean()) if len(powers) else math.inf
    for first, following in pairwise(BANDS[_WAVE_BAND:]):
        if first <= max_order:
            waves = min(float(np.square(relative.imag[first:following]).mean()), high_order_power)
            variance[first:following] = max(waves - _BEYOND_NOISE * float(noise_std[first]) ** 2, 0.0)
    result: FloatArray = np.sqrt(variance)
    return result


def by_band(orders: FloatArray) -> FloatArray:
    """Return (..., bands, ORDER_COUNT): the orders of each band, with zeros elsewhere."""
    parts: FloatArray = orders[..., np.newaxis, :] * _MASKS
    return parts


def band_mean(values: FloatArray) -> FloatArray:
    """Return (..., ORDER_COUNT) with each order's value replaced by its band's mean; 0 below the first band."""
    sizes = np.diff(np.array(BANDS))
    sums = np.add.reduceat(values[..., BANDS[0] :], np.array(BANDS[:-1]) - BANDS[0], axis=-1)
    result = np.zeros_like(values)
    result[..., BANDS[0] :] = np.repeat(sums / sizes, sizes, axis=-1)
    return result


def _quarter_turn() -> FloatArray:
    """Cosine orders of sin(k |theta|), by k: 4 k / (pi (k^2 - n^2)) where k - n is odd, half of it at n = 0."""
    k, n = np.meshgrid(np.arange(ORDER_COUNT), np.arange(ORDER_COUNT), indexing="ij")
    odd = (k - n) % 2 == 1
    matrix: FloatArray = np.where(odd, 4.0 * k / (math.pi * np.where(odd, k**2 - n**2, 1)), 0.0)
    matrix[:, : BANDS[0]] = 0.0  # the mean is fixed by calibration, order 1 by closure
    return matrix


QUARTER_TURN: Final[FloatArray] = _quarter_turn()
"""Matrix that turns the phase of even orders, of waves equal at both edges, by 90 degrees: orders @ QUARTER_TURN."""
