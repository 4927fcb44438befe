"""Signals that repeat with the wheel: filters, by which order n at omega passes at n omega / 2 pi, and a finer grid."""

import math
from abc import abstractmethod
from typing import Final

import numpy as np

from gateway.core.types import ComplexArray, FloatArray
from gateway.diagnosis.effects.effect import FIELD_SIZE, GroupConditions, ModelledBlock, SignalEffect

FINE: Final = 8
"""Points of a fine grid for each of the model's: what has corners at steep edges has orders beyond the model's own."""

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


def on_fine_grid(signal: FloatArray) -> FloatArray:
    """Return a periodic signal (..., FIELD_SIZE) on the fine grid, (..., FINE FIELD_SIZE)."""
    spectrum = np.fft.rfft(signal)
    spectrum[..., -1] = 0.0
    result: FloatArray = FINE * np.fft.irfft(spectrum, n=FINE * FIELD_SIZE)
    return result


def from_fine_grid(fine: FloatArray) -> FloatArray:
    """Return the orders of a signal (..., FINE FIELD_SIZE) that the model's grid has, on that grid."""
    spectrum = np.fft.rfft(fine)[..., : FIELD_SIZE // 2 + 1] / FINE
    spectrum[..., -1] = 0.0
    result: FloatArray = np.fft.irfft(spectrum, n=FIELD_SIZE)
    return result


class AxisAhead(SignalEffect):
    """An axis that is read at another time or place than the radial one, in proportion to its only parameter.

    Attributes:
        axis: the axis.
    """

    axis: int

    def contribution(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the axis as it is read, less the axis."""
        return self._filtered(block, np.expm1(float(parameters[0]) * self.rate(block)))

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the rate of the axis as it is read."""
        rate = self.rate(block)
        return self._filtered(block, rate * np.exp(float(parameters[0]) * rate))[np.newaxis]

    def _filtered(self, block: ModelledBlock, response: ComplexArray) -> FloatArray:
        result = block.zeros()
        result[self.axis] = filtered(block.signal_mps2[self.axis], response)
        return result

    @staticmethod
    @abstractmethod
    def rate(block: ModelledBlock) -> ComplexArray:
        """Return the phase of every order by a unit of the parameter, times i."""
