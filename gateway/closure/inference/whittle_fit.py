"""Whittle likelihood of averaged periodograms, maximised by scoring."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.closure.inference.nonsynchronous_density import Parts, Site, wide_density
from gateway.types import FloatArray

# Standard deviation of ln of the noise density of one sensor between recordings.
_LEVEL_STD: Final = 0.1
_ENDS: Final = 1e-4
_HALVINGS: Final = 6


@dataclass(frozen=True, slots=True)
class Observed:
    """Averaged periodograms of one group in wide bins.

    Attributes:
        power: (3, b) density.
        freedom: (3, b) number of independent values; 0 for unused bins.
    """

    power: FloatArray
    freedom: FloatArray


@dataclass(frozen=True, slots=True)
class SpectrumFit:
    """A fitted model.

    Attributes:
        parts: components of the model.
        levels: (g, 3) ln of the noise density in each group.
        common: (3,) their means over groups.
        shared: (K,) parameters of the effects, the jitter, the low-pass.
        covariance: (K, K) covariance of `shared`.
        deviance: -2 ln likelihood, up to a constant of the data; without priors.
    """

    parts: Parts
    levels: FloatArray
    common: FloatArray
    shared: FloatArray
    covariance: FloatArray
    deviance: float


def deviance(sites: Sequence[Site], observed: Sequence[Observed], fit: SpectrumFit) -> float:
    """Return -2 ln likelihood of data under a model that was fitted to these or to other data."""
    return _state(sites, observed, fit.parts, fit.levels, fit.shared)


def start_fit(sites: Sequence[Site], observed: Sequence[Observed]) -> SpectrumFit:
    """Return white noise alone, at the median of each axis."""
    levels = np.zeros((len(sites), 3))
    for g, (site, one) in enumerate(zip(sites, observed, strict=True)):
        for axis in range(3):
            used = one.freedom[axis] > 0.0
            if used.any():
                levels[g, axis] = np.log(np.median(one.power[axis, used] / site.floor_wide[axis, used]))
    common: FloatArray = np.asarray(np.median(levels, axis=0), dtype=np.float64)
    white = SpectrumFit(Parts(), levels, common, np.empty(0), np.empty((0, 0)), np.inf)
    return fit_spectra(sites, observed, white)


def fit_spectra(
    sites: Sequence[Site], observed: Sequence[Observed], start: SpectrumFit, rounds: int = 25
) -> SpectrumFit:
    """Return the maximum-likelihood fit, starting from `start`."""
    parts, levels, common, shared = start.parts, start.levels, start.common, start.shared
    low, high, mean, spread = _bounds(parts)
    size = levels.size

    def objective(levels: FloatArray, common: FloatArray, shared: FloatArray) -> float:
        data = _state(sites, observed, parts, levels, shared)
        return (
            data
            + float(np.square((levels - common) / _LEVEL_STD).sum())
            + float(np.square((shared - mean) / spread).sum())
        )

    now = objective(levels, common, shared)
    hessian = np.eye(size + 3 + len(shared))
    damping = 1e-3
    for _ in range(rounds):
        hessian, gradient = _normal(sites, observed, parts, levels, common, shared)
        at = size + 3
        hessian[at:, at:] += np.diag(1.0 / np.square(spread))
        gradient[at:] += (mean - shared) / np.square(spread)
        better = False
        for _ in range(_HALVINGS):
            step = np.linalg.solve(hessian + damping * np.diag(np.diag(hessian)), gradient)
            tried = (
                levels + np.clip(step[:size].reshape(levels.shape), -2.0, 2.0),
                common + np.clip(step[size:at], -2.0, 2.0),
                np.clip(shared + step[at:], low, high),
            )
            value = objective(*tried)
            if value < now:
                better = True
                break
            damping = max(10.0 * damping, 1e-3)
        if not better:
            break
        damping *= 0.1
        gained, now = now - value, value
        levels, common, shared = tried
        if gained < _ENDS:
            break
    inverse = np.linalg.inv(hessian + 1e-12 * np.diag(np.diag(hessian)))
    covariance: FloatArray = np.asarray(inverse[size + 3 :, size + 3 :], dtype=np.float64)
    return SpectrumFit(parts, levels, common, shared, covariance, _state(sites, observed, parts, levels, shared))


def _bounds(parts: Parts) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return lower and upper ends, means and spreads of the shared parameters.

    The ends lie beyond the plausible range, so that a fit can show an implausible value.
    """
    ends = []
    for effect in parts.effects:
        for number, one in enumerate(effect.parameters):
            if number == 0:
                ends.append((0.0, 4.0 * one.high, one.prior_mean, 10.0 * one.prior_std))
            else:
                ends.append((0.7 * one.low, 1.4 * one.high, one.prior_mean, 3.0 * one.prior_std))
    if parts.jitter:
        ends += [(-np.inf, np.inf, 0.0, 1.0)] * (parts.shared - len(ends) - parts.low_pass)
    if parts.low_pass:
        ends.append((0.0, 1.0, 0.0, 1.0))
    low, high, mean, spread = np.array(ends, dtype=np.float64).reshape(-1, 4).T
    return low, high, mean, spread


def _state(
    sites: Sequence[Site], observed: Sequence[Observed], parts: Parts, levels: FloatArray, shared: FloatArray
) -> float:
    total = 0.0
    for site, one, level in zip(sites, observed, levels, strict=True):
        density = wide_density(site, parts, level, shared)[0]
        total += 2.0 * float((one.freedom * (np.log(density) + one.power / density)).sum())
    return total


def _normal(
    sites: Sequence[Site],
    observed: Sequence[Observed],
    parts: Parts,
    levels: FloatArray,
    common: FloatArray,
    shared: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return the expected information and the score of levels, their common means and shared parameters.

    Priors of the levels included, those of the shared parameters not.
    """
    size, count = levels.size, len(shared)
    at = size + 3
    hessian = np.zeros((at + count, at + count))
    gradient = np.zeros(at + count)
    own = 1.0 / _LEVEL_STD**2
    for g, (site, one) in enumerate(zip(sites, observed, strict=True)):
        density, noise, rows = wide_density(site, parts, levels[g], shared)
        surplus = one.freedom * (one.power / density - 1.0)
        for axis in range(3):
            relative = np.concatenate((noise[axis][None], rows[:, axis])) / density[axis]
            block = (relative * one.freedom[axis]) @ relative.T
            score = relative @ surplus[axis]
            place, mean = 3 * g + axis, size + axis
            hessian[place, place] += block[0, 0] + own
            hessian[place, at:] += block[0, 1:]
            hessian[at:, place] += block[1:, 0]
            hessian[at:, at:] += block[1:, 1:]
            gradient[at:] += score[1:]
            pull = own * (common[axis] - levels[g, axis])
            gradient[place] += score[0] + pull
            gradient[mean] -= pull
            hessian[mean, mean] += own
            hessian[place, mean] -= own
            hessian[mean, place] -= own
    # An absent axis has only its prior.
    hessian[range(size, at), range(size, at)] += 1e-6
    return hessian, gradient
