"""Whittle likelihood of averaged periodograms with strange bins in it, maximised by scoring, and its evidence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import gammaln

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.types import FloatArray
from gateway.diagnosis import criteria
from gateway.diagnosis.spectrum.nonsynchronous_density import Parts, Site, wide_density

# Standard deviation of ln of the noise density of one sensor between recordings.
_LEVEL_STD: Final = 0.1
_MIN_DECREASE: Final = 1e-3
_MAX_ROUNDS: Final = 25
_DAMPING_ROUNDS: Final = 6
# ln of a sensor's noise density in (m/s^2)^2 per Hz: 5 mg per root Hz, to a factor of four.
_LOG_NOISE: Final = 2.0 * math.log(5e-3 * STANDARD_GRAVITY_MPS2)
_LOG_NOISE_STD: Final = 2.0 * math.log(4.0)
_SOUND_NU: Final = criteria.DENSITY_ERROR**-2


@dataclass(frozen=True, slots=True)
class Observed:
    """Averaged periodograms of one group in wide bins.

    Attributes:
        power: (3, b) density.
        freedom: (3, b) number of independent values; 0 for absent axes.
        constant: of its log likelihood, sound and strange, (2, 3, b).
    """

    power: FloatArray
    freedom: FloatArray
    constant: FloatArray

    @classmethod
    def of(cls, site: Site) -> Observed:
        """Return the means over all folds in wide bins."""
        spectra = site.spectra
        power = np.add.reduceat(spectra.mean_power(), spectra.first, axis=-1) / spectra.count
        freedom: FloatArray = np.outer(spectra.present, float(spectra.freedom.sum()) * spectra.count).astype(np.float64)
        k = np.maximum(freedom, 1.0)
        constant: FloatArray = np.stack(
            [
                k * np.log(k) + gammaln(k + nu + 1.0) - gammaln(nu + 1.0) - gammaln(k) + (nu + 1.0) * np.log(nu)
                for nu in (_SOUND_NU, 1.0)
            ]
        )
        return cls(np.asarray(power, dtype=np.float64), freedom, constant)


@dataclass(frozen=True, slots=True)
class SpectrumFit:
    """A fitted model.

    Attributes:
        parts: components of the model.
        levels: (g, 3) ln of the noise density in each group.
        common: (3,) their means over groups.
        shared: (K,) parameters of the components, then of the low-pass.
        covariance: (K, K) covariance of `shared`.
        deviance: -2 ln likelihood, up to a constant of the data; without priors.
        log_evidence: Laplace's approximation, up to a constant of the data; without prior odds of the parts.
    """

    parts: Parts
    levels: FloatArray
    common: FloatArray
    shared: FloatArray
    covariance: FloatArray
    deviance: float
    log_evidence: float

    def parameters_of(self, name: str) -> tuple[FloatArray, FloatArray]:
        """Return the parameters of a component and their variances, (P,) each."""
        columns = self.parts.columns_of(name)
        return self.shared[columns], np.diagonal(self.covariance)[columns]


def start_fit(sites: Sequence[Site], observed: Sequence[Observed]) -> SpectrumFit:
    """Return white noise alone, at the median of each axis."""
    levels = np.zeros((len(sites), 3))
    for g, observation in enumerate(observed):
        for axis in range(3):
            used = observation.freedom[axis] > 0.0
            if used.any():
                levels[g, axis] = np.log(np.median(observation.power[axis, used]))
    common: FloatArray = np.asarray(np.median(levels, axis=0), dtype=np.float64)
    white = SpectrumFit(Parts(), levels, common, np.empty(0), np.empty((0, 0)), np.inf, -np.inf)
    return fit_spectra(sites, observed, white)


def fit_spectra(sites: Sequence[Site], observed: Sequence[Observed], start: SpectrumFit) -> SpectrumFit:
    """Return the fit of the highest posterior density, starting from `start`."""
    parts, levels, common, shared = start.parts, start.levels, start.common, start.shared
    prior = parts.prior
    size = levels.size

    def objective(levels: FloatArray, common: FloatArray, shared: FloatArray) -> float:
        return (
            _deviance(sites, observed, parts, levels, shared)
            + float(np.square((levels - common) / _LEVEL_STD).sum())
            + float(np.square((common - _LOG_NOISE) / _LOG_NOISE_STD).sum())
            + float(np.square((shared - prior.mean) / prior.std).sum())
        )

    lowest = objective(levels, common, shared)
    damping = 1e-3
    first_shared = size + 3
    hessian, gradient = _normal(sites, observed, parts, levels, common, shared)
    for _ in range(_MAX_ROUNDS):
        scaled = hessian.copy()
        scaled[range(first_shared, len(scaled)), range(first_shared, len(scaled))] += 1.0 / np.square(prior.std)
        pull = gradient.copy()
        pull[first_shared:] += (prior.mean - shared) / np.square(prior.std)
        # A parameter at an end that its score points beyond stays there.
        fixed = first_shared + np.flatnonzero(
            ((shared <= prior.low) & (pull[first_shared:] < 0.0))
            | ((shared >= prior.high) & (pull[first_shared:] > 0.0))
        )
        scaled[fixed], scaled[:, fixed], pull[fixed] = 0.0, 0.0, 0.0
        scaled[fixed, fixed] = 1.0
        has_decreased = False
        for _ in range(_DAMPING_ROUNDS):
            step = np.linalg.solve(scaled + damping * np.diag(np.diag(scaled)), pull)
            trial = (
                levels + np.clip(step[:size].reshape(levels.shape), -2.0, 2.0),
                common + np.clip(step[size:first_shared], -2.0, 2.0),
                np.clip(shared + step[first_shared:], prior.low, prior.high),
            )
            value = objective(*trial)
            if value < lowest:
                has_decreased = True
                break
            damping = max(10.0 * damping, 1e-3)
        if not has_decreased:
            break
        damping *= 0.1
        decrease, lowest = lowest - value, value
        levels, common, shared = trial
        hessian, gradient = _normal(sites, observed, parts, levels, common, shared)
        if decrease < _MIN_DECREASE:
            break
    precision = hessian.copy()
    precision[range(first_shared, len(precision)), range(first_shared, len(precision))] += 1.0 / np.square(prior.std)
    covariance: FloatArray = np.asarray(np.linalg.inv(precision)[first_shared:, first_shared:], dtype=np.float64)
    evidence = -0.5 * (lowest + float(np.linalg.slogdet(precision)[1])) - float(np.log(prior.std).sum())
    for index, decades in parts.sizes:
        # Sizes are scale parameters: the fit's normal prior only keeps it stable. Below its own error a size is none.
        scale = max(float(shared[index]), math.sqrt(float(covariance[index, index])))
        evidence += math.log(float(prior.std[index]) * math.sqrt(2.0 * math.pi) / (scale * decades))
    deviance = _deviance(sites, observed, parts, levels, shared)
    return SpectrumFit(parts, levels, common, shared, covariance, deviance, evidence)


def _likelihood(observation: Observed, density: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return log likelihood of each bin, its derivative by ln of the density, and the information on that.

    The power over the density is a gamma variate times an error of the density, of inverse-gamma distribution: small
    in a sound bin, of any size in a strange one.
    """
    nu = np.array([_SOUND_NU, 1.0])[:, None, None]
    ratio = observation.freedom * observation.power / density
    log_power = observation.freedom * np.log(density)
    total = observation.freedom[None] + nu + 1.0
    shifted_ratio = nu + ratio
    log_likelihoods = observation.constant - log_power - total * np.log(shifted_ratio)
    log_likelihoods += np.log(np.array([1.0 - criteria.STRANGE_BINS, criteria.STRANGE_BINS]))[:, None, None]
    log_likelihood = np.logaddexp(log_likelihoods[0], log_likelihoods[1])
    share = np.exp(log_likelihoods - log_likelihood)
    slope = total * ratio / shifted_ratio - observation.freedom
    information = observation.freedom * (nu + 1.0) / (observation.freedom + nu + 2.0)
    used = observation.freedom > 0.0
    return (
        np.where(used, log_likelihood, 0.0),
        np.where(used, (share * slope).sum(axis=0), 0.0),
        (share * information).sum(axis=0),
    )


def _deviance(
    sites: Sequence[Site], observed: Sequence[Observed], parts: Parts, levels: FloatArray, shared: FloatArray
) -> float:
    total = 0.0
    for site, observation, level in zip(sites, observed, levels, strict=True):
        total -= 2.0 * float(_likelihood(observation, wide_density(site, parts, level, shared)[0])[0].sum())
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
    first_shared = size + 3
    hessian = np.zeros((first_shared + count, first_shared + count))
    gradient = np.zeros(first_shared + count)
    level_precision = 1.0 / _LEVEL_STD**2
    for g, (site, observation) in enumerate(zip(sites, observed, strict=True)):
        density, noise, rows = wide_density(site, parts, levels[g], shared)
        _, surplus, information = _likelihood(observation, density)
        for axis in range(3):
            relative = np.concatenate((noise[axis][None], rows[:, axis])) / density[axis]
            block = (relative * information[axis]) @ relative.T
            score = relative @ surplus[axis]
            row, mean = 3 * g + axis, size + axis
            hessian[row, row] += block[0, 0] + level_precision
            hessian[row, first_shared:] += block[0, 1:]
            hessian[first_shared:, row] += block[1:, 0]
            hessian[first_shared:, first_shared:] += block[1:, 1:]
            gradient[first_shared:] += score[1:]
            pull = level_precision * (common[axis] - levels[g, axis])
            gradient[row] += score[0] + pull
            gradient[mean] -= pull
            hessian[mean, mean] += level_precision
            hessian[row, mean] -= level_precision
            hessian[mean, row] -= level_precision
    hessian[range(size, first_shared), range(size, first_shared)] += _LOG_NOISE_STD**-2
    gradient[size:first_shared] += (_LOG_NOISE - common) / _LOG_NOISE_STD**2
    return hessian, gradient
