"""Errors of parameters by what a fit leaves: its own shape, band by band of the orders at any phase.

What the model lacks moves every parameter, alike in all recordings, so that no comparison of them shows it. At the
optimum the moves of all orders cancel, by chance where the shape is something else's. Each octave of an axis is
therefore turned by a phase of its own, the same in all recordings, and the spread of what the parameters make of it is
a part of their errors.
"""

import itertools
from dataclasses import replace
from typing import Final

import numpy as np

from gateway.core.types import FloatArray
from gateway.diagnosis.angle.fit import Fit
from gateway.diagnosis.angle.likelihood import Whitened, as_real
from gateway.diagnosis.angle.residual import group_residuals
from gateway.diagnosis.effects.angle_orders import ORDERS

_OCTAVES: Final = (0, 1, 2, 4, 8, 16, 32, 64, ORDERS)


def remainder_covariance(fit: Fit, data: Whitened) -> FloatArray:
    """Return the covariance of the parameters by what the fit leaves beyond noise, (P, P)."""
    size = len(fit.vector)
    residuals = group_residuals(fit, data)
    slopes = []
    for axis in range(3):
        for first, last in itertools.pairwise(_OCTAVES):
            excess = sum(float(residual.excess()[axis, first:last].sum()) for residual in residuals)
            noise = sum(float(residual.variance[axis, first:last].sum()) for residual in residuals)
            if not excess > 0.0:
                continue
            # The share of the power that is not noise.
            amplitude_share = np.sqrt(excess / (excess + noise))
            for phase in (1.0, 1j):
                slope = np.zeros(size)
                for rows, residual in zip(fit.weighted, residuals, strict=True):
                    band = np.zeros((3, ORDERS), dtype=np.complex128)
                    band[axis, first:last] = amplitude_share * phase * residual.orders_mps2[axis, first:last]
                    slope += rows[:-1].reshape(size, -1) @ as_real(band).reshape(-1)
                slopes.append(slope * np.sqrt(0.5 if first else 1.0))
    if not slopes:
        return np.zeros((size, size))
    steps = np.linalg.solve(fit.precision, np.stack(slopes, axis=1))
    result: FloatArray = steps @ steps.T
    return result


def beside_remainder(fit: Fit, data: Whitened) -> Fit:
    """Return a fit whose parameters' covariance contains what it leaves."""
    widened = replace(fit, freedom=remainder_covariance(fit, data))
    for name in ("weighted", "_gram"):
        if name in fit.__dict__:
            widened.__dict__[name] = fit.__dict__[name]
    return widened
