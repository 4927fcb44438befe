"""Linear filters on signals that repeat with the wheel: order n at angular speed omega passes at n omega / 2 pi."""

import math
from typing import Final

import numpy as np

from gateway.closure.effects.effect import FIELD_SIZE, GroupConditions
from gateway.types import ComplexArray, FloatArray

ORDER: Final[ComplexArray] = np.arange(FIELD_SIZE // 2 + 1).astype(np.complex128)
"""Orders of the spectra, 0 to FIELD_SIZE / 2."""


def order_hz(conditions: GroupConditions) -> ComplexArray:
    """Return the frequencies of the orders."""
    return ORDER * (conditions.omega_radps / (2.0 * math.pi))


def filtered(signal: FloatArray, response: ComplexArray) -> FloatArray:
    """Return a periodic signal (..., FIELD_SIZE) behind a filter.

    Args:
        signal: one revolution on the grid; theta grows with time.
        response: (FIELD_SIZE / 2 + 1,) complex gain at `ORDER`, or (..., FIELD_SIZE / 2 + 1).
    """
    # The grid's last order has no phase, so it is left out.
    spectrum = np.fft.rfft(signal) * response
    spectrum[..., -1] = 0.0
    result: FloatArray = np.fft.irfft(spectrum, n=FIELD_SIZE)
    return result
