"""A linear filter on signals that repeat with the wheel: order n of speed omega passes at n omega / 2 pi."""

from __future__ import annotations

from typing import Final

import numpy as np

from gateway.closure.effects.base import FIELD_SIZE
from gateway.types import ComplexArray, FloatArray

ORDER: Final[ComplexArray] = np.arange(FIELD_SIZE // 2 + 1).astype(np.complex128)
"""Orders of the spectra, 0 to FIELD_SIZE / 2."""


def filtered(signal: FloatArray, response: ComplexArray) -> FloatArray:
    """Return a periodic signal (..., FIELD_SIZE) behind a filter.

    Args:
        signal: one revolution on the grid; theta grows with time.
        response: (FIELD_SIZE / 2 + 1,) complex gain at ORDER, or (..., FIELD_SIZE / 2 + 1).
    """
    # The grid's last order has no phase: it is left as it is.
    spectrum = np.fft.rfft(signal) * response
    spectrum[..., -1] = 0.0
    result: FloatArray = np.fft.irfft(spectrum, n=FIELD_SIZE)
    return result
