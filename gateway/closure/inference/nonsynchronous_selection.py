"""Forward selection of spectral components by their gain on held-out segments."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gateway.closure.effects.effect import SpectrumEffect
from gateway.closure.inference.nonsynchronous_density import JITTER, LOW_PASS, Parts, Site, wide_density
from gateway.closure.inference.whittle_fit import Observed, SpectrumFit, deviance, fit_spectra, start_fit
from gateway.types import FloatArray

# Decrease of the deviance on all data for a component to be considered, and on held-out data for it to be accepted.
# White noise does not reach these values in some thousand trials, with margin.
_LOOKED_AT: Final = 24.0
_ACCEPTED: Final = 16.0
_STARTS: Final = 2
_FOLD_ROUNDS: Final = 6
# Initial corner frequency of a low-pass.
_CORNER_HZ: Final = 800.0


@dataclass(frozen=True, slots=True)
class Step:
    """Candidate component of the model.

    Attributes:
        name: name of the effect, or JITTER or LOW_PASS.
        effect: effect of the catalogue, None for the other two.
        fit: fit with the component.
        chi2: decrease of the deviance on all data.
        gains: (folds,) decrease of the deviance on each held-out fold.
    """

    name: str
    effect: SpectrumEffect | None
    fit: SpectrumFit
    chi2: float
    gains: FloatArray

    @property
    def gain(self) -> float:
        """Decrease of the deviance on all held-out folds."""
        return float(self.gains.sum())

    @property
    def gain_std(self) -> float:
        """Its standard error."""
        return float(self.gains.std(ddof=1) * math.sqrt(len(self.gains)))

    @property
    def accepted(self) -> bool:
        """Whether the held-out gain exceeds one standard error and a level that noise does not reach."""
        return self.chi2 > _LOOKED_AT and self.gain > max(_ACCEPTED, self.gain_std)


class Selection:
    """Stepwise extension of a model of the spectra of all groups.

    Attributes:
        sites: the groups.
        observed: all data.
        fit: the current model.
    """

    def __init__(self, sites: Sequence[Site], usable: Sequence[FloatArray]) -> None:
        """Start with white noise.

        Args:
            sites: the groups.
            usable: (3, m) for each group, 1 for bins that a fit may use.
        """
        self.sites = tuple(sites)
        folds = len(sites[0].spectra.freedom)
        self._folds = [_observed(self.sites, usable, [fold]) for fold in range(folds)]
        self._training = [
            _observed(self.sites, usable, [k for k in range(folds) if k != fold]) for fold in range(folds)
        ]
        self.observed = _observed(self.sites, usable, list(range(folds)))
        self.fit = start_fit(self.sites, self.observed)
        self._held = self._held_out(self.fit)

    def steps(self, candidates: Sequence[SpectrumEffect], others: Sequence[str]) -> list[Step]:
        """Return the accepted steps of the candidates, best first."""
        found = [self._step(effect.name, effect) for effect in candidates]
        found += [self._step(name, None) for name in others]
        wanted = [step for step in found if step is not None and step.accepted]
        return sorted(wanted, key=lambda step: -step.gain)

    def take(self, step: Step) -> None:
        """Add a component."""
        self.fit = step.fit
        self._held = self._held_out(step.fit)

    def without(self, effect: SpectrumEffect) -> SpectrumFit:
        """Return the fit with one of its effects removed."""
        return fit_spectra(self.sites, self.observed, _removed(self.fit, effect))

    def _step(self, name: str, effect: SpectrumEffect | None) -> Step | None:
        starts = self._starts(effect) if effect is not None else [self._other_start(name)]
        fits = [fit_spectra(self.sites, self.observed, start) for start in starts]
        if not fits:
            return None
        best = min(fits, key=lambda fit: fit.deviance)
        chi2 = self.fit.deviance - best.deviance
        if chi2 < _LOOKED_AT:
            return None
        return Step(name, effect, best, chi2, self._held - self._held_out(best))

    def _held_out(self, fit: SpectrumFit) -> FloatArray:
        """Return the deviance of each fold under the model fitted to the others."""
        return np.array(
            [
                deviance(self.sites, held, fit_spectra(self.sites, training, fit, _FOLD_ROUNDS))
                for held, training in zip(self._folds, self._training, strict=True)
            ]
        )

    def _starts(self, effect: SpectrumEffect) -> list[SpectrumFit]:
        """Return the best of an effect's starts, each scaled to the data."""
        found = []
        for start in effect.starts(tuple(site.spectra.conditions for site in self.sites)):
            gain, size = self._score(effect, np.array(start))
            if size > 0.0:
                found.append((gain, math.sqrt(size), start))
        found.sort(key=lambda one: -one[0])
        return [_added(self.fit, effect, np.array((start[0] * root, *start[1:]))) for _, root, start in found[:_STARTS]]

    def _score(self, effect: SpectrumEffect, parameters: FloatArray) -> tuple[float, float]:
        """Return the gain in the linear approximation, and the scale factor of the density at the parameters."""
        top = below = 0.0
        for site, one, level in zip(self.sites, self.observed, self.fit.levels, strict=True):
            density, noise, _ = wide_density(site, self.fit.parts, level, self.fit.shared)
            added = site.wide(effect.density(site.spectra.conditions, site.grid_hz, parameters)) / density
            white = noise / density
            surplus = one.power / density - 1.0
            weight = one.freedom
            # The part that the noise level can explain is projected out.
            power = (weight * white * white).sum(axis=1) + 1e-9
            own = added - ((weight * white * added).sum(axis=1) / power)[:, None] * white
            left = surplus - ((weight * white * surplus).sum(axis=1) / power)[:, None] * white
            top += float((weight * own * left).sum())
            below += float((weight * own * own).sum())
        if not (below > 0.0 and top > 0.0):
            return 0.0, 0.0
        return top * top / below, top / below

    def _other_start(self, name: str) -> SpectrumFit:
        parts = self.fit.parts
        if name == LOW_PASS:
            shared = np.append(self.fit.shared, _CORNER_HZ**-4)
            return replace(self.fit, parts=replace(parts, low_pass=True), shared=shared)
        at = parts.shared - parts.low_pass
        changed = replace(parts, jitter=True)
        return replace(
            self.fit, parts=changed, shared=np.insert(self.fit.shared, at, np.zeros(changed.shared - parts.shared))
        )


OTHERS: Final = (JITTER, LOW_PASS)


def _added(fit: SpectrumFit, effect: SpectrumEffect, parameters: FloatArray) -> SpectrumFit:
    at = sum(len(one.parameters) for one in fit.parts.effects)
    parts = replace(fit.parts, effects=(*fit.parts.effects, effect))
    return replace(fit, parts=parts, shared=np.insert(fit.shared, at, parameters))


def _removed(fit: SpectrumFit, effect: SpectrumEffect) -> SpectrumFit:
    place = place_of(fit.parts, effect)
    effects = tuple(one for one in fit.parts.effects if one is not effect)
    return replace(fit, parts=replace(fit.parts, effects=effects), shared=np.delete(fit.shared, place))


def place_of(parts: Parts, effect: SpectrumEffect) -> slice:
    """Return the slice of an effect's parameters among the shared ones."""
    at = 0
    for one in parts.effects:
        if one is effect:
            return slice(at, at + len(one.parameters))
        at += len(one.parameters)
    raise ValueError(f"{effect.name} is not in the model")


def _observed(sites: Sequence[Site], usable: Sequence[FloatArray], folds: list[int]) -> list[Observed]:
    """Return the means of the given folds over wide bins, from the usable bins."""
    found = []
    for site, used in zip(sites, usable, strict=True):
        spectra = site.spectra
        freedom = spectra.freedom[folds]
        power = np.tensordot(freedom, spectra.power[folds], axes=1) / freedom.sum()
        number = np.add.reduceat(used, spectra.first, axis=-1)
        total = np.add.reduceat(used * power, spectra.first, axis=-1)
        mean = np.divide(total, number, out=np.ones_like(total), where=number > 0.0)
        found.append(Observed(mean, number * float(freedom.sum()) * spectra.present[:, None]))
    return found
