"""Sets of components of the nonsynchronous spectrum: evidence of each, and the search for those of the highest."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final, Protocol, TypeAlias, runtime_checkable

import numpy as np

from gateway.core.reasons import Reason
from gateway.core.types import FloatArray
from gateway.diagnosis import criteria
from gateway.diagnosis.bayes.parameter_estimates import beyond_range
from gateway.diagnosis.effects.effect import CIRCUMFERENTIAL, RADIAL, GroupConditions, SpectrumEffect
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.spectrum.nonsynchronous_density import (
    FILTER_STARTS,
    FILTER_TERMS,
    LOW_PASS,
    Component,
    Site,
    wide_density,
)
from gateway.diagnosis.spectrum.whittle_fit import Observed, SpectrumFit, fit_spectra, start_fit

Names: TypeAlias = frozenset[str]

_STARTS: Final = 2


@runtime_checkable
class Rotating(Protocol):
    """An effect fixed in space: the radial and circumferential axes measure it in quadrature."""

    def quadrature(self, conditions: GroupConditions, frequency_hz: FloatArray, parameters: FloatArray) -> FloatArray:
        """Return the imaginary part of the cross density, (m,)."""
        ...


@runtime_checkable
class NarrowNoise(Protocol):
    """An effect that is noise in a narrow band."""

    def noise_band(self, parameters: FloatArray) -> tuple[float, float]:
        """Return the band that holds most of its power, (from, to), Hz."""
        ...


@dataclass(frozen=True, slots=True)
class SpectrumSet:
    """A set of components with its evidence.

    Attributes:
        names: of the components and the low-pass.
        fit: at its optimum.
        log_evidence: prior odds of the set included.
        objections: effects whose values are impossible, with the reason.
    """

    names: Names
    fit: SpectrumFit
    log_evidence: float
    objections: tuple[tuple[str, Reason], ...] = ()


class SpectrumSearch:
    """Search over sets of components for those of the highest evidence.

    Attributes:
        evaluations: evidence of every set that was fitted.
    """

    def __init__(self, sites: Sequence[Site], effects: Sequence[SpectrumEffect]) -> None:
        """Take the groups and the candidates; each has a strange band of its shape as its rival."""
        self._sites = tuple(sites)
        self._observed = [Observed.of(site) for site in sites]
        components: list[Component] = []
        for effect in effects:
            components += [Component(effect), Component(effect, len(sites))]
        self._components = {component.name: component for component in components}
        self._candidates = (*self._components, LOW_PASS)
        self._density_cache: tuple[SpectrumFit, list[tuple[FloatArray, FloatArray]]] | None = None
        self.evaluations: dict[Names, SpectrumSet] = {}
        white = start_fit(self._sites, self._observed)
        self.evaluations[frozenset()] = self._evaluated(white)
        self._run()

    def _run(self) -> None:
        """Add, remove and exchange components of the best set until none is better."""
        base: Names | None = None
        while base != (optimum := self._best_names()):
            base = optimum
            for name in self._candidates:
                if name not in base and len(base) < criteria.MOST_EFFECTS:
                    self._fit(base | {name}, base)
            for name in sorted(base):
                self._fit(base - {name}, base)
            for name in sorted(base & set(self._components)):
                for replacement in self._components:
                    if replacement not in base:
                        self._fit((base - {name}) | {replacement}, base - {name})

    def _best_names(self) -> Names:
        return max(
            self.evaluations.values(), key=lambda spectrum_set: (spectrum_set.log_evidence, sorted(spectrum_set.names))
        ).names

    def _fit(self, names: Names, base_names: Names) -> None:
        """Evaluate a set, from the fit of one that lacks or has one more of its components."""
        if names in self.evaluations:
            return
        base = self.evaluations[base_names].fit
        fits = [fit_spectra(self._sites, self._observed, start) for start in self._starts(names, base)]
        if fits:
            self.evaluations[names] = self._evaluated(max(fits, key=lambda fit: fit.log_evidence))

    def _starts(self, names: Names, base: SpectrumFit) -> Iterator[SpectrumFit]:
        current_names = base.parts.names
        for name in sorted(current_names - names):
            base = _removed(base, name)
        added = sorted(names - current_names)
        if not added:
            yield base
            return
        (name,) = added
        if name == LOW_PASS:
            yield from self._filter_starts(base)
        else:
            yield from self._component_starts(self._components[name], base)

    def _filter_starts(self, base: SpectrumFit) -> Iterator[SpectrumFit]:
        parts = replace(base.parts, low_pass=True)
        promising = []
        for start in FILTER_STARTS:
            shared = np.append(base.shared, start)
            rows = []
            for site, level in zip(self._sites, base.levels, strict=True):
                unfiltered = wide_density(site, base.parts, level, base.shared)[0]
                rows.append(wide_density(site, parts, level, shared)[0] - unfiltered)
            gain, size = self._linear_gain(base, rows, free=False)
            if 0.5 * gain > criteria.LOOKED_AT and (size > 0.0).all():
                promising.append((gain, replace(base, parts=parts, shared=shared)))
        if promising:
            yield max(promising, key=lambda entry: entry[0])[1]

    def _component_starts(self, component: Component, base: SpectrumFit) -> list[SpectrumFit]:
        """Return the most promising starts of a component, each scaled to the data; none if none promises enough."""
        promising = []
        for start in component.effect.starts(tuple(site.spectra.conditions for site in self._sites)):
            parameters = np.zeros(len(component.prior.mean))
            parameters[: len(start)] = start
            rows = [
                site.wide(component.density(site.index, site.spectra.conditions, site.grid_hz, parameters))
                for site in self._sites
            ]
            gain, sizes = self._linear_gain(base, rows, free=component.strange)
            if 0.5 * gain > criteria.LOOKED_AT and (sizes > 0.0).any():
                promising.append((gain, sizes, parameters))
        promising.sort(key=lambda entry: -entry[0])
        result = []
        for _, sizes, parameters in promising[:_STARTS]:
            size = float(np.exp(np.log(sizes[sizes > 0.0]).mean()))
            parameters[0] *= math.sqrt(size)
            if component.strange:
                size_std = criteria.FREE_SIZE
                ratio = 0.5 * np.log(np.maximum(sizes, 1e-9) / size)
                parameters[-sizes.size :] = np.clip(ratio, -2.0 * size_std, 2.0 * size_std).ravel()
            first = base.parts.filter_at
            parts = replace(base.parts, components=(*base.parts.components, component))
            result.append(replace(base, parts=parts, shared=np.insert(base.shared, first, parameters)))
        return result

    def _linear_gain(self, base: SpectrumFit, added: Sequence[FloatArray], *, free: bool) -> tuple[float, FloatArray]:
        """Return the linear gain of twice the log likelihood by a part, and factors of its size.

        Args:
            base: the fit to which it is added.
            added: (3, b) its density in each group.
            free: whether each axis of each group has a factor of its own, (g, 3), or all have one, (1, 1).
        """
        score, information = self._scores(base, added)
        if not free:
            score, information = score.sum(keepdims=True), information.sum(keepdims=True)
        is_positive = (score > 0.0) & (information > 0.0)
        safe = np.where(information > 0.0, information, 1.0)
        return float((np.square(score) / safe)[is_positive].sum()), np.where(is_positive, score / safe, 0.0)

    def _scores(self, base: SpectrumFit, added: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Return score and information of a part's size on each axis of each group, the noise level projected out."""
        score = np.zeros((len(self._sites), 3))
        information = np.zeros_like(score)
        for g, (observation, (density, noise)) in enumerate(zip(self._observed, self._densities(base), strict=True)):
            relative, white = added[g] / density, noise / density
            surplus = np.minimum(observation.power / density - 1.0, criteria.SURPLUS)
            weight = observation.freedom / (1.0 + observation.freedom * criteria.DENSITY_ERROR**2)
            power = (weight * white * white).sum(axis=1) + 1e-9
            clear = relative - ((weight * white * relative).sum(axis=1) / power)[:, None] * white
            remainder = surplus - ((weight * white * surplus).sum(axis=1) / power)[:, None] * white
            score[g], information[g] = (weight * clear * remainder).sum(axis=1), (weight * clear * clear).sum(axis=1)
        return score, information

    def _densities(self, base: SpectrumFit) -> list[tuple[FloatArray, FloatArray]]:
        """Return density and noise of a fit in each group, (3, b) each."""
        if self._density_cache is None or self._density_cache[0] is not base:
            densities = [
                wide_density(site, base.parts, level, base.shared)[:2]
                for site, level in zip(self._sites, base.levels, strict=True)
            ]
            self._density_cache = base, densities
        return self._density_cache[1]

    def _evaluated(self, fit: SpectrumFit) -> SpectrumSet:
        odds = 0.0
        for name in fit.parts.names:
            is_stand_in = name in self._components and self._components[name].strange
            odds += math.log(criteria.STAND_IN_ODDS if is_stand_in else criteria.PRIOR_ODDS)
        log_ratio = sum(self._log_ratios(fit))
        return SpectrumSet(fit.parts.names, fit, fit.log_evidence + odds + log_ratio, _impossible(fit))

    def _log_ratios(self, fit: SpectrumFit) -> Iterator[float]:
        """Yield the log likelihood ratios of what spectra by axis do not contain, effect against unknown cause."""
        for component in fit.parts.components:
            if not component.strange:
                parameters = fit.shared[fit.parts.columns_of(component.name)]
                if isinstance(component.effect, NarrowNoise):
                    yield self._envelope_ratio(component.effect.noise_band(parameters))
                if isinstance(component.effect, Rotating):
                    yield self._rotation_ratio(fit, component.effect, parameters)

    def _envelope_ratio(self, band: tuple[float, float]) -> float:
        """Return the log likelihood ratio, by the envelope, of noise against what may be noise or partly a tone."""
        moments = [envelope_moment(site.spectra.runs, site.spectra.rate_hz, RADIAL, band) for site in self._sites]
        number = sum(count for _, count in moments)
        if not number > 0.0:
            return 0.0
        # E[A^4] / E[A^2]^2 is 2 for noise and 1 for a tone.
        moment = sum(value * count for value, count in moments) / number
        std = math.hypot(2.0 / math.sqrt(number), criteria.DENSITY_ERROR)
        noise = -0.5 * ((moment - 2.0) / std) ** 2
        return noise - float(np.logaddexp(noise, _range_likelihood(moment, std, 1.0, 2.0)) - math.log(2.0))

    def _rotation_ratio(self, fit: SpectrumFit, effect: Rotating, parameters: FloatArray) -> float:
        """Return the log likelihood ratio of a force fixed in space against any cause, by the axes' quadrature."""
        score = information = 0.0
        for g, site in enumerate(self._sites):
            spectra = site.spectra
            if not (spectra.present[RADIAL] and spectra.present[CIRCUMFERENTIAL]):
                continue
            expected = spectra.wide(effect.quadrature(spectra.conditions, spectra.frequency_hz, parameters))
            wide, _, _ = wide_density(site, fit.parts, fit.levels[g], fit.shared)
            variance = 0.5 * wide[RADIAL] * wide[CIRCUMFERENTIAL]
            weight = spectra.count * spectra.freedom.sum() / variance
            score += float((weight * expected * spectra.wide(spectra.cross.imag)).sum())
            information += float((weight * expected * expected).sum())
        if not information > 0.0:
            return 0.0
        # The quadrature over that expected: 1 for a fixed direction, within -1 and 1 for any cause.
        value, std = score / information, math.hypot(information**-0.5, criteria.DENSITY_ERROR)
        return -0.5 * ((value - 1.0) / std) ** 2 - _range_likelihood(value, std, -1.0, 1.0)


def _range_likelihood(value: float, std: float, low: float, high: float) -> float:
    """Return the log likelihood of a normal variate whose mean is anywhere in a range, over that at its mean."""
    log_likelihoods = -0.5 * np.square((value - np.linspace(low, high, 201)) / std)
    return float(np.logaddexp.reduce(log_likelihoods)) - math.log(len(log_likelihoods))


def envelope_moment(
    runs: Sequence[FloatArray], rate_hz: float, axis: int, band: tuple[float, float]
) -> tuple[float, float]:
    """Return E[A^4] / E[A^2]^2 of the envelope in a band (noise 2, tone 1), and the number of independent samples."""
    second = fourth = length = number = 0.0
    for run in runs:
        n = run.shape[1]
        low, high = round(band[0] / rate_hz * n), min(round(band[1] / rate_hz * n), n // 2) + 1
        if high - low < 4:
            continue
        spectrum = np.fft.rfft(run[axis])[low:high]
        power = np.square(np.abs(np.fft.ifft(spectrum, 4 * len(spectrum))))
        # Number of independent samples: those at the band's own rate.
        second += float(power.mean()) * len(spectrum)
        fourth += float(np.square(power).mean()) * len(spectrum)
        length += len(spectrum)
        number += high - low
    if not second > 0.0:
        return 2.0, 0.0
    return fourth * length / second**2, number


def _removed(fit: SpectrumFit, name: str) -> SpectrumFit:
    parts = fit.parts
    if name == LOW_PASS:
        return replace(fit, parts=replace(parts, low_pass=False), shared=fit.shared[:-FILTER_TERMS])
    components = tuple(component for component in parts.components if component.name != name)
    return replace(
        fit, parts=replace(parts, components=components), shared=np.delete(fit.shared, parts.columns_of(name))
    )


def _impossible(fit: SpectrumFit) -> tuple[tuple[str, Reason], ...]:
    """Return the effects whose parameters are out of their physical range, with the reason."""
    reasons: list[tuple[str, Reason | None]] = []
    for component in fit.parts.components:
        if not component.strange:
            values, variances = fit.parameters_of(component.name)
            reason = beyond_range(component.effect.parameters, values, np.sqrt(np.maximum(variances, 0.0)))
            if reason is None and not values[0] > 0.0:
                reason = Reason(DiagnosisCode.NOTHING_REMAINS)
            reasons.append((component.name, reason))
    return tuple((name, reason) for name, reason in reasons if reason is not None)
