"""Waveforms of one revolution: the model's angle grid and the coefficients of their wheel orders."""

import math
from typing import Final

import numpy as np

from gateway.core.types import ComplexArray, FloatArray
from gateway.diagnosis.effects.effect import FIELD_SIZE

ORDERS: Final = 111
"""Number of orders compared, 0 to 110: on a measured tire nothing above repeats."""
THETA: Final = -math.pi + (2.0 * math.pi / FIELD_SIZE) * np.arange(FIELD_SIZE, dtype=np.float64)
_SCALE: Final = np.where(np.arange(ORDERS) % 2, -2.0, 2.0) / FIELD_SIZE
_SCALE[0] *= 0.5
_SCALE.setflags(write=False)


def field_orders(field: FloatArray) -> ComplexArray:
    """Return the coefficients c - i s of orders 0 to 110 of curves on the model's grid, (..., ORDERS)."""
    spectrum = np.zeros((*field.shape[:-1], ORDERS), dtype=np.complex128)
    # Derivatives by most parameters are zero on some axes.
    is_nonzero = field.any(axis=-1)
    spectrum[is_nonzero] = np.fft.rfft(field[is_nonzero], axis=-1)[:, :ORDERS] * _SCALE
    return spectrum


def orders_field(orders: ComplexArray) -> FloatArray:
    """Return the curves (..., FIELD_SIZE) of coefficients (..., ORDERS); NaN counts as zero."""
    spectrum = np.zeros((*orders.shape[:-1], FIELD_SIZE // 2 + 1), dtype=np.complex128)
    spectrum[..., :ORDERS] = np.nan_to_num(orders) / _SCALE
    field: FloatArray = np.fft.irfft(spectrum, n=FIELD_SIZE, axis=-1)
    return field
