"""High-pass of one pole that an AC coupling is, on a wheel that turns steadily.

Order n of a periodic signal passes with the factor i n / (i n + c), where c is the corner in units of the wheel's
frequency. So order 1 is turned by c: what is symmetric about the contact becomes antisymmetric, as a force makes it.
"""

from __future__ import annotations

import numpy as np

from gateway.core.types import ComplexArray, FloatArray


def _factors(n: int, corner: float) -> ComplexArray:
    """Return the inverse of what each order passes with, 1 at order 0, (n // 2 + 1,)."""
    factors = np.ones(n // 2 + 1, np.complex128)
    factors[1:] -= 1j * corner / np.arange(1, len(factors))
    return factors


def before_highpass(passed: FloatArray, corner: float) -> FloatArray:
    """Return the orders from 1 on before the high-pass, and the mean behind it.

    Args:
        passed: (..., n) signal behind it, on an angle grid that increases with time.
        corner: in units of the wheel's frequency.
    """
    n = passed.shape[-1]
    signal: FloatArray = np.fft.irfft(np.fft.rfft(passed) * _factors(n, corner), n)
    return signal


def behind_highpass(signal: FloatArray, corner: float) -> FloatArray:
    """Return what a high-pass leaves of a signal (..., n), but for its mean, as `before_highpass` takes it."""
    n = signal.shape[-1]
    passed: FloatArray = np.fft.irfft(np.fft.rfft(signal) / _factors(n, corner), n)
    return passed
