"""Order coefficients of an angle-domain waveform and their noise.

With theta_k = -pi + 2 pi k / n and x = c_0 + sum c_n cos(n theta) + s_n sin(n theta), the coefficient of order n is the
complex number c_n - i s_n; order 0 is the mean.
"""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from gateway.core.revolutions.short_medians import median
from gateway.core.types import ComplexArray, FloatArray

ORDER_COUNT: Final = 61

# Share of the Nyquist order up to which a sampled and spline-interpolated order is accurate within 0.5 %.
_USABLE_BAND: Final = 0.56


def highest_order(samples_per_revolution: float) -> int:
    """Return the highest order that the sampling carries, at most 60.

    The quintic interpolation of `resample_revolutions` is within 0.5 % up to 0.56 of the Nyquist order (0.28 cycles per
    sample).
    """
    return max(0, min(ORDER_COUNT - 1, math.floor(_USABLE_BAND * samples_per_revolution / 2.0)))


def order_coefficients(waveform: FloatArray, order_max: int = ORDER_COUNT - 1) -> ComplexArray:
    """Return the coefficients c_n - i s_n of orders 0 to 60.

    Args:
        waveform: (..., n) on the angle grid, n >= 128.
        order_max: coefficients above it are NaN.

    Returns:
        (..., 61) complex, in the unit of the waveform.
    """
    coefficients = spectrum_coefficients(np.fft.rfft(waveform, axis=-1))
    coefficients[..., order_max + 1 :] = complex(math.nan, math.nan)
    return coefficients


def spectrum_coefficients(spectrum: ComplexArray) -> ComplexArray:
    """Return the coefficients of orders 0 to 60, (..., 61), from discrete Fourier transforms (..., n / 2 + 1)."""
    n = 2 * (spectrum.shape[-1] - 1)
    coefficients: ComplexArray = spectrum[..., :ORDER_COUNT] * _SIGNS * (2.0 / n)
    coefficients[..., 0] *= 0.5
    return coefficients


def coefficient_std(waveform: FloatArray, samples_per_revolution: float) -> float:
    """Estimate the noise of one real order coefficient from the orders above the tire's own content.

    Uses the median power of the upper part of the sampled orders, if possible above order 150, where a tire's shape has
    decayed. With few samples per revolution the band still contains signal, and the estimate is too high.

    Args:
        waveform: (n,) on the angle grid.
        samples_per_revolution: time samples that the waveform was made from.

    Returns:
        Standard deviation of a cosine or sine coefficient, in the unit of the waveform; NaN when the waveform is.
    """
    return band_noises(np.fft.rfft(waveform)[np.newaxis], [samples_per_revolution])[0]


def band_noises(spectra: ComplexArray, samples_per_revolution: Sequence[float]) -> list[float]:
    """Return what `coefficient_std` does, from (k, n / 2 + 1) discrete Fourier transforms of waveforms."""
    n = 2 * (spectra.shape[1] - 1)
    bands = [_noise_band(n, samples) for samples in samples_per_revolution]
    lowest, highest = min(low for low, _ in bands), max(high for _, high in bands)
    power = np.square(spectra.real[:, lowest:highest])
    power += np.square(spectra.imag[:, lowest:highest])
    # |C|^2 = 2 sigma^2 * (chi-square of two degrees / 2), whose median is ln 2.
    factor = 2.0 / n / math.sqrt(2.0 * math.log(2.0))
    return [
        factor * math.sqrt(median(row[low - lowest : high - lowest]))
        for row, (low, high) in zip(power, bands, strict=True)
    ]


def _noise_band(n: int, samples_per_revolution: float) -> tuple[int, int]:
    """Return first and last (exclusive) order of the band above the tire's own content."""
    nyquist = min(n, samples_per_revolution) / 2.0
    # Above 0.7 of the band, the roll-off of the interpolation attenuates the noise.
    high = max(3, min(n // 2, math.floor(0.7 * nyquist)))
    return min(150, max(1, math.floor(0.45 * nyquist))), high


def sample_std(coefficient_std_mps2: float, samples_per_revolution: float, n: int) -> float:
    """Return the noise of one angle-domain sample from that of one real coefficient, for white noise."""
    carried = min(n, samples_per_revolution)
    return coefficient_std_mps2 * math.sqrt(carried / 2.0)


# The grid starts at -pi, so odd orders change sign.
_SIGNS: Final = np.where(np.arange(ORDER_COUNT) % 2, -1.0, 1.0)
_SIGNS.setflags(write=False)
