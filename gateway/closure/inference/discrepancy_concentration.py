"""Single orders and places at which the data concentrate what a set of effects leaves unexplained."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.closure.inference import criteria
from gateway.closure.inference.discrepancy_kernels import Concentration, concentrations
from gateway.closure.inference.fit import Fit
from gateway.closure.inference.likelihood import FROM_FIELD, Whitened
from gateway.closure.inference.residual import residual_ratio
from gateway.types import FloatArray

# Amplitudes that are tried, as powers over the noise: log evidence is flat about its maximum.
_POWERS: Final = np.logspace(0.0, 8.0, 17)


@dataclass(frozen=True, slots=True)
class Evident:
    """A concentration that the evidence asks for.

    Attributes:
        concentration: order or place.
        amplitudes: mean squares to start from, (m/s^2)^2, (places, parts).
        gain: of log evidence.
    """

    concentration: Concentration
    amplitudes: FloatArray
    gain: float


def most_evident(fit: Fit, data: Whitened) -> Evident | None:
    """Return the concentration of the highest gain of log evidence; None if none is worth its odds.

    For curves L of unit weights, C^-1 r as they see it z and C^-1 as they see it V diag(v) V', an amplitude a gains
    1/2 sum [a z^2 / (1 + a v) - ln(1 + a v)]. A concentration has the odds of a stand-in, shared among all, and its
    gain is divided by the temperature, as all evidence is.

    Args:
        fit: with a discrepancy, at its optimum.
        data: whitened.
    """
    if fit.applied is None:
        raise ValueError("a discrepancy is concentrated where a fit has one")
    possible = concentrations()
    known = set(fit.applied.discrepancy.concentrations)
    # At ANGLES in place of orders, where a burst is narrow.
    seen = [
        [(answer @ FROM_FIELD, FROM_FIELD.T @ information @ FROM_FIELD) for answer, information in parts]
        for parts in fit.applied.answers(fit.rows, fit.residual, fit.precision)
    ]
    best: Evident | None = None
    for one in possible:
        if one in known:
            continue
        gain, amplitudes = _gained(one.curves(), seen, fit.applied.amplitudes.shape[1])
        if best is None or gain > best.gain:
            best = Evident(one, amplitudes, gain)
    odds = math.log(criteria.STAND_IN_ODDS / len(possible))
    temperature = math.sqrt(residual_ratio(fit, data))
    return best if best is not None and best.gain / temperature + odds > 0.0 else None


def _gained(
    curves: FloatArray, seen: Sequence[Sequence[tuple[FloatArray, FloatArray]]], parts: int
) -> tuple[float, FloatArray]:
    """Return the gain of a concentration with these curves, and its amplitudes (places, parts)."""
    inside = np.flatnonzero(np.abs(curves).max(axis=1) > 1e-3)
    curves = curves[inside]
    amplitudes = np.zeros((len(seen), parts))
    total = 0.0
    for at, place in enumerate(seen):
        best = 0.0
        for part, (answer, information) in enumerate(place):
            values, vectors = np.linalg.eigh(curves.T @ information[np.ix_(inside, inside)] @ curves)
            values = np.maximum(values, 0.0)
            if values[-1] <= 0.0:
                continue
            square = np.square(vectors.T @ (curves.T @ answer[inside]))
            tried = _POWERS[:, None] / values[-1]
            gains = 0.5 * (tried * square / (1.0 + tried * values) - np.log1p(tried * values)).sum(axis=1)
            top = int(np.argmax(gains))
            if gains[top] > best:
                best = float(gains[top])
                amplitudes[at] = 0.0
                amplitudes[at, part] = float(tried[top, 0])
        total += best
    return total, amplitudes
