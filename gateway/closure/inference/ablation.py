"""Ablation: a fitted effect removed, with all other parameters adapted by the linear fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gateway.closure.inference.fit import Fit, held_out_misfit
from gateway.closure.inference.likelihood import Normal, as_real
from gateway.closure.model.baseline import NoShapeError
from gateway.closure.model.closure_model import AngleEffect
from gateway.types import ComplexArray, FloatArray


@dataclass(frozen=True, slots=True)
class TakenOut:
    """A fit without one of its effects.

    Attributes:
        predicted: (blocks, 3, ORDERS) for each group, the other parameters adapted.
        fall: decrease of the misfit due to the effect.
        held_out: (K,) misfit of every fold under the fit of all others.
    """

    predicted: tuple[ComplexArray, ...]
    fall: float
    held_out: FloatArray


def added_by(fit: Fit, effect: AngleEffect) -> list[ComplexArray]:
    """Return the contribution of an effect to the orders of every block, (blocks, 3, ORDERS) for each group.

    It is not computed from derivatives: an order or a decay of 0 is not the absence of the effect.
    """
    without = fit.vector.copy()
    where = fit.model.layout.effect(effect.name)
    without[where] = 0.0
    added = []
    for index, (there, rows) in enumerate(zip(fit.predicted, fit.rows, strict=True)):
        try:
            added.append(there - fit.model.predict_group(without, index))
        except (NoShapeError, np.linalg.LinAlgError):
            # Without the effect the ring has no solution at these parameters.
            own = (rows.places >= where.start) & (rows.places < where.stop)
            linear = np.tensordot(rows.rows[:, own], fit.vector[rows.places[own]], axes=([1], [0]))
            added.append(np.where(rows.weight > 0.0, linear / np.where(rows.weight > 0.0, rows.weight, 1.0), 0.0))
    return added


def taken_out(fit: Fit, effect: AngleEffect) -> TakenOut:
    """Return a fit without an effect: its contribution is removed exactly, other parameters adapt to first order."""
    where = fit.model.layout.effect(effect.name)
    kept = np.ones(fit.model.layout.size, dtype=bool)
    kept[where] = False
    added = added_by(fit, effect)
    gradient, misfit = np.zeros_like(fit.normal.gradient), np.zeros_like(fit.normal.misfit)
    for rows, own in zip(fit.rows, added, strict=True):
        left = as_real(rows.residual + rows.weight * own)
        blocks = np.arange(len(left))
        gradient[np.ix_(blocks, rows.places)] += (as_real(rows.rows) @ left[:, :, None])[..., 0]
        misfit[blocks] += np.square(left).sum(axis=1)
    normal = Normal(fit.normal.matrix[:, kept][:, :, kept], gradient[:, kept], misfit)
    from_prior, prior_std = (fit.vector - fit.prior_mean)[kept], fit.prior_std[kept]
    slope = normal.gradient.sum(axis=0) - from_prior / prior_std**2
    change = np.zeros(len(kept))
    change[kept] = np.linalg.solve(normal.matrix.sum(axis=0) + np.diag(prior_std**-2.0), slope)
    predicted = []
    for rows, there, own in zip(fit.rows, fit.predicted, added, strict=True):
        used = rows.weight > 0.0
        moved = np.tensordot(rows.rows, change[rows.places], axes=([1], [0]))
        predicted.append(there - own + np.where(used, moved / np.where(used, rows.weight, 1.0), 0.0))
    known = fit.model.witness_misfit(np.where(kept, fit.vector, 0.0))
    return TakenOut(
        tuple(predicted),
        float(misfit.sum() - change[kept] @ slope) + known - fit.misfit,
        held_out_misfit(normal, from_prior, prior_std) + known / len(misfit),
    )
