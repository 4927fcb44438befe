"""Orders, bands of orders and places at which the data concentrate what a set of effects leaves unexplained."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, NamedTuple, Self

import numpy as np

from gateway.core.types import FloatArray, IntArray
from gateway.diagnosis import criteria
from gateway.diagnosis.angle.discrepancy_kernels import FROM_PLACES, PLACES, Burst, Concentration, concentrations
from gateway.diagnosis.angle.fit import Fit
from gateway.diagnosis.angle.likelihood import Whitened
from gateway.diagnosis.angle.residual import group_residuals, residual_ratio

# Amplitudes that are tried, as powers over the noise: log evidence is flat about its maximum.
_POWERS: Final = np.logspace(0.0, 8.0, 17)


@dataclass(frozen=True, slots=True)
class Evident:
    """A concentration that the evidence asks for.

    Attributes:
        concentration: order, band or place.
        amplitudes: mean squares to start from, (m/s^2)^2, (axes of states, parts).
        gain: of log evidence.
        log_odds: before the data, against no concentration.
        share: of the residual's power beyond noise and other concentrations that it takes.
    """

    concentration: Concentration
    amplitudes: FloatArray
    gain: float
    log_odds: float
    share: float


def most_evident(fit: Fit, data: Whitened) -> Evident | None:
    """Return the concentration of the highest gain of log evidence; None if none is worth its odds.

    For curves L of unit weights, C^-1 r as they see it z and C^-1 as they see it V diag(v) V', an amplitude a gains
    1/2 sum [a z^2 / (1 + a v) - ln(1 + a v)]. A concentration has the odds of a stand-in, shared among all, and its
    gain is divided by the temperature, as all evidence is. It must hold `criteria.CONCENTRATED_SHARE` of the residual
    beyond noise and other concentrations: less is a part like any other, which the smooth kernels describe.

    Args:
        fit: with a discrepancy, at its optimum.
        data: whitened.
    """
    if fit.applied is None:
        raise ValueError("a discrepancy is concentrated where a fit has one")
    power = sum(float(np.square(residual.rms_mps2()).sum()) for residual in group_residuals(fit, data))
    if not power > 0.0:
        return None
    possible = concentrations()
    present = set(fit.applied.discrepancy.concentrations)
    answers = fit.applied.answers(fit.weighted, fit.precision)
    # At PLACES in place of orders, where a burst is narrow.
    part_answers = [
        _PartAnswer.of(answer, information, index, part, float(np.square(scale).sum()))
        for index, ((_, axis_groups), parts) in enumerate(zip(fit.applied.discrepancy.axes, answers, strict=True))
        for part, ((answer, information), scale) in enumerate(zip(parts, axis_groups.scales, strict=True))
    ]
    for number, concentration in enumerate(reversed(fit.applied.discrepancy.concentrations), 1):
        for part_answer in part_answers:
            weights = fit.applied.amplitudes[part_answer.index, part_answer.part, -number] * (
                concentration.curves().T @ part_answer.at_places.answer
            )
            power -= part_answer.power * float(np.square(concentration.curves() @ weights).mean())
    log_odds = math.log(criteria.STAND_IN_ODDS / len(possible))
    shape = fit.applied.amplitudes.shape[:2]
    candidates = [
        _evident(concentration, part_answers, shape, power, log_odds)
        for concentration in possible
        if concentration not in present
    ]
    best = max(candidates, key=lambda evident: evident.gain)
    is_evident = best.gain / math.sqrt(residual_ratio(fit, data)) + log_odds > 0.0
    return best if is_evident and best.share > criteria.CONCENTRATED_SHARE else None


@dataclass(frozen=True, slots=True)
class _Answer:
    """C^-1 r (n,) and C^-1 (n, n) in some basis.

    Attributes:
        answer: C^-1 r.
        information: C^-1.
    """

    answer: FloatArray
    information: FloatArray


@dataclass(frozen=True, slots=True)
class _PartAnswer:
    """C^-1 r and C^-1 as one part of one axis of a state sees them.

    Attributes:
        by_order: in the real coefficients.
        at_places: at PLACES.
        index: of the axis of a state.
        part: index.
        power: sum over groups of the part's squared size.
    """

    by_order: _Answer
    at_places: _Answer
    index: int
    part: int
    power: float

    @classmethod
    def of(cls, answer: FloatArray, information: FloatArray, index: int, part: int, power: float) -> Self:
        """Return them from C^-1 r (REAL,) and C^-1 (REAL, REAL) of the real coefficients."""
        at_places = _Answer(answer @ FROM_PLACES, FROM_PLACES.T @ information @ FROM_PLACES)
        return cls(_Answer(answer, information), at_places, index, part, power)


class _CompactBasis(NamedTuple):
    """A concentration in the basis in which few numbers describe it.

    Attributes:
        in_orders: whether that is the real coefficients: an order has two, a band few orders; a burst has few places.
        inside: of the numbers, (m,).
        curves: in them, (m, k).
        powers: mean products of the curves, (k, k).
    """

    in_orders: bool
    inside: IntArray
    curves: FloatArray
    powers: FloatArray


@lru_cache(maxsize=1024)
def _compact_basis(concentration: Concentration) -> _CompactBasis:
    curves = concentration.curves()
    in_orders = not isinstance(concentration, Burst)
    coefficients = FROM_PLACES @ curves if in_orders else curves
    inside = np.flatnonzero(np.abs(coefficients).max(axis=1) > 1e-3)
    return _CompactBasis(in_orders, inside, coefficients[inside], curves.T @ curves / len(PLACES))


def _evident(
    concentration: Concentration, answers: Sequence[_PartAnswer], shape: tuple[int, ...], power: float, log_odds: float
) -> Evident:
    """Return what a concentration gains: on every axis of a state the part of the larger gain."""
    basis = _compact_basis(concentration)
    amplitudes, gains, powers = np.zeros(shape), np.zeros(shape[0]), np.zeros(shape[0])
    for part_answer in answers:
        basis_answer = part_answer.by_order if basis.in_orders else part_answer.at_places
        information = basis_answer.information[basis.inside[:, None], basis.inside]
        values, vectors = np.linalg.eigh(basis.curves.T @ information @ basis.curves)
        values = np.maximum(values, 0.0)
        if values[-1] <= 0.0:
            continue
        projection = vectors.T @ (basis.curves.T @ basis_answer.answer[basis.inside])
        tried = _POWERS[:, None] / values[-1]
        gained = 0.5 * (tried * np.square(projection) / (1.0 + tried * values) - np.log1p(tried * values)).sum(axis=1)
        best_index = int(np.argmax(gained))
        if gained[best_index] > gains[part_answer.index]:
            amplitude = float(tried[best_index, 0])
            gains[part_answer.index] = gained[best_index]
            amplitudes[part_answer.index] = 0.0
            amplitudes[part_answer.index, part_answer.part] = amplitude
            weights = vectors @ (projection / (1.0 / amplitude + values))
            powers[part_answer.index] = part_answer.power * float(weights @ basis.powers @ weights)
    share = float(powers.sum()) / power if power > 0.0 else 0.0
    return Evident(concentration, amplitudes, float(gains.sum()), log_odds, share)
