"""Diagnosis of the signal not locked to the wheel angle: its effects and its unexplained part."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gateway.closure import criteria
from gateway.closure.bayes.parameter_estimates import fitted_parameter, over_sets
from gateway.closure.bayes.posterior import PosteriorOver, over
from gateway.closure.data.campaign_data import Group
from gateway.closure.effects.catalogue import catalogue
from gateway.closure.effects.effect import SpectrumEffect
from gateway.closure.result import Finding, Fitted, Spectra, Unexplained, Verdict
from gateway.closure.spectrum.nonsynchronous_density import FILTER_TERMS, LOW_PASS, Site, full_density, strange_name
from gateway.closure.spectrum.nonsynchronous_spectra import group_spectra
from gateway.closure.spectrum.spectrum_sets import SpectrumSearch, SpectrumSet
from gateway.closure.spectrum.unexplained_spectrum import parts_left, several_speeds, unexplained
from gateway.closure.spectrum.whittle_fit import SpectrumFit
from gateway.reasons import Code, Reason
from gateway.types import FloatArray

FOLDS: Final = 5
ANTI_ALIAS: Final = "anti-alias filter"
UNKNOWN: Final = "what is unexplained beside it"
"""The confounder of an effect that is smaller than something unknown of which it may be a part."""


@dataclass(frozen=True, slots=True)
class TimeLocked:
    """Result for the signal that is not locked to the wheel.

    Attributes:
        findings: lock "time"; identified first, then indistinguishable, then rejected.
        unexplained: lines and bands that no effect explains, largest first.
        spectra: spectra of every group that was long enough.
        notes: limitations, and components found that are not effects.
    """

    findings: tuple[Finding, ...] = ()
    unexplained: tuple[Unexplained, ...] = ()
    spectra: tuple[Spectra, ...] = ()
    notes: tuple[Reason, ...] = ()


def diagnose_time_locked(groups: Sequence[Group], without: Collection[str] = ()) -> TimeLocked:
    """Identify the effects in the signal that remains when the wheel's mean waveform is subtracted.

    Args:
        groups: groups with deviations; those without, or too short for two seconds per fold, are skipped with a note.
        without: names of effects that are left out.

    Returns:
        the findings; none when no group is long enough.
    """
    measured = [spectra for group in groups if (spectra := group_spectra(group, FOLDS)) is not None]
    short = len(groups) - len(measured)
    notes = [Reason(Code.GROUPS_TOO_SHORT, groups=short, of=len(groups))] if short else []
    if not measured:
        return TimeLocked(notes=tuple(notes))
    sites = tuple(Site.of(index, each) for index, each in enumerate(measured))
    offered = [effect for name, effect in catalogue().items() if name not in without]
    effects = [effect for effect in offered if isinstance(effect, SpectrumEffect)]
    posterior = over(SpectrumSearch(sites, effects).evaluations)
    findings = _findings(posterior, effects, sites)
    # The density that is explained is that of effects that are identified, or of which one is.
    named = frozenset(finding.name for finding in findings if finding.verdict is not Verdict.REFUSED)
    best = posterior.best
    fit = best.fit
    parts, drawn = [], []
    for site, level in zip(sites, fit.levels, strict=True):
        density, noise = full_density(site, fit.parts, level, fit.shared, named)
        parts += parts_left(site, density, noise, np.exp(level))
        drawn.append(_drawn(site, density, noise))
    notes += _notes(posterior)
    remaining = tuple(unexplained(sites, parts))
    doubted = beside_larger(findings, _larger(findings, remaining, sites, fit), several=several_speeds(sites))
    return TimeLocked(tuple(doubted), remaining, tuple(drawn), tuple(notes))


def beside_larger(findings: Sequence[Finding], larger: Mapping[str, float], *, several: bool) -> list[Finding]:
    """Make effects undecided that are smaller than something unknown of which they may be a part, and their rivals.

    Args:
        findings: of the spectra.
        larger: rms of the largest unexplained part that may contain an effect, by its name, m/s^2.
        several: whether the recordings have several speeds.
    """
    decides = Code.RECORD_ON_ANOTHER_ROAD if several else Code.RECORD_ROAD_AT_ANOTHER_SPEED
    doubted = []
    smaller = {
        finding.name
        for finding in findings
        if finding.verdict is not Verdict.REFUSED and finding.rms_mps2 < larger[finding.name]
    }
    for finding in findings:
        if finding.name in smaller:
            beside = Reason(Code.BESIDE_SOMETHING_LARGER, own_mps2=finding.rms_mps2, larger_mps2=larger[finding.name])
            finding = replace(finding, reason=beside)
        if finding.verdict is not Verdict.REFUSED and smaller & {finding.name, *finding.rivals}:
            finding = replace(
                finding,
                verdict=Verdict.INDISTINGUISHABLE,
                rivals=(*finding.rivals, UNKNOWN),
                decide_with=finding.decide_with or Reason(decides),
            )
        doubted.append(finding)
    return doubted


def _larger(
    findings: Sequence[Finding], remaining: Sequence[Unexplained], sites: Sequence[Site], fit: SpectrumFit
) -> dict[str, float]:
    """Return the largest unexplained part of which an effect may be a part, m/s^2, by the effect's name.

    At one speed anything may be: the flanks of a line or a band look like a resonance. At several speeds its frequency
    tells an effect from what lies elsewhere, but not from what holds its band on another axis.
    """
    several = several_speeds(sites)
    return {
        finding.name: max(
            (part.rms_mps2 for part in remaining if not several or _within_band(finding.name, part, sites, fit)),
            default=0.0,
        )
        for finding in findings
    }


def _within_band(name: str, part: Unexplained, sites: Sequence[Site], fit: SpectrumFit) -> bool:
    """Return whether an effect of the fit has more than half its power in the band of an unexplained part."""
    effect = catalogue()[name]
    if name not in fit.parts.names or part.hz is None or not isinstance(effect, SpectrumEffect):
        return False
    parameters = fit.shared[fit.parts.columns_of(name)]
    inside = total = 0.0
    for site in sites:
        frequency = site.spectra.frequency_hz
        density = effect.density(site.spectra.conditions, frequency, parameters)
        inside += float(density[:, (frequency >= part.hz[0]) & (frequency <= part.hz[1])].sum())
        total += float(density.sum())
    return inside > 0.5 * total


def _findings(
    posterior: PosteriorOver[SpectrumSet], effects: Sequence[SpectrumEffect], sites: Sequence[Site]
) -> list[Finding]:
    """Return the finding of every effect with evidence: identified, then undecided, then rejected."""
    named = posterior.identified()
    names = [effect.name for effect in effects]
    findings = [
        _finding(posterior, name, Verdict.NAMED, sites) for name in posterior.names if name in {*named} & {*names}
    ]
    seen = set(named)
    another = Reason(Code.RECORD_ROAD_AT_ANOTHER_SPEED)
    # A strange band is no cause: where it is likely, no effect of the catalogue is certain to be present.
    for group in posterior.alternatives({*names, LOW_PASS}):
        for name in group:
            if name in names:
                others = tuple(ANTI_ALIAS if other == LOW_PASS else other for other in group if other != name)
                decides = None if several_speeds(sites) else another
                findings.append(
                    _finding(posterior, name, Verdict.INDISTINGUISHABLE, sites, rivals=others, decide_with=decides)
                )
        seen |= set(group)
    for name in posterior.names:
        probability = posterior.probability([name])
        if name in names and name not in seen and probability >= criteria.LISTED:
            reason = Reason(Code.PROBABILITY_TOO_LOW, probability=probability, needed=criteria.NAMED)
            findings.append(_finding(posterior, name, Verdict.REFUSED, sites, reason=reason))
            seen.add(name)
    impossible = sorted(
        (spectrum_set for spectrum_set in posterior.every.values() if spectrum_set.objections),
        key=lambda spectrum_set: -spectrum_set.log_evidence,
    )
    for spectrum_set in impossible:
        for name, reason in spectrum_set.objections if spectrum_set.log_evidence > posterior.best.log_evidence else ():
            if name not in seen:
                seen.add(name)
                findings.append(_finding(posterior, name, Verdict.REFUSED, sites, reason=reason, inside=spectrum_set))
    return findings


def _finding(
    posterior: PosteriorOver[SpectrumSet],
    name: str,
    verdict: Verdict,
    sites: Sequence[Site],
    *,
    rivals: tuple[str, ...] = (),
    decide_with: Reason | None = None,
    reason: Reason | None = None,
    inside: SpectrumSet | None = None,
) -> Finding:
    chosen_set = posterior.with_effect(name) if inside is None else inside
    # What remains without it: the best set that lacks it and any band in its place.
    stand_in = strange_name(name)
    without = max(
        (other for other in posterior.every.values() if not {name, stand_in} & other.names),
        key=lambda other: other.log_evidence,
    )
    effect = catalogue()[name]
    if not isinstance(effect, SpectrumEffect):
        raise TypeError(name)
    probability = 0.0 if inside is not None else posterior.probability([name])
    matter = () if inside is not None else tuple(pair for pair in posterior.considered if name in pair[0].names)
    return Finding(
        name,
        verdict,
        _parameters(effect, chosen_set.fit, [(other.fit, weight) for other, weight in matter]),
        without.fit.deviance - chosen_set.fit.deviance,
        _rms(sites, chosen_set.fit, effect),
        rivals=rivals,
        decide_with=decide_with,
        reason=reason,
        summary=effect.summary,
        equation=effect.equation,
        lock="time",
        probability=probability,
        log_odds=math.nan if inside is not None else posterior.log_odds(name),
    )


def _parameters(
    effect: SpectrumEffect, fit: SpectrumFit, others: Sequence[tuple[SpectrumFit, float]]
) -> dict[str, Fitted]:
    values_and_variances = _of_effect(fit, effect.name)
    variances = over_sets(values_and_variances, [(_of_effect(other, effect.name), weight) for other, weight in others])
    return {
        parameter.name: fitted_parameter(parameter, float(value), math.sqrt(max(float(variance), 0.0)))
        for parameter, value, variance in zip(effect.parameters, values_and_variances[0], variances, strict=True)
    }


def _of_effect(fit: SpectrumFit, name: str) -> tuple[FloatArray, FloatArray]:
    where = fit.parts.columns_of(name)
    return fit.shared[where], np.diag(fit.covariance)[where]


def _rms(sites: Sequence[Site], fit: SpectrumFit, effect: SpectrumEffect) -> float:
    """Return the root mean square of an effect, over groups and the axes on which it acts."""
    parameters = fit.shared[fit.parts.columns_of(effect.name)]
    powers = []
    for site in sites:
        density = effect.density(site.spectra.conditions, site.spectra.frequency_hz, parameters)
        powers += [float(density[axis].sum()) * site.spectra.step_hz for axis in effect.axes]
    return math.sqrt(float(np.mean(powers)))


def _notes(posterior: PosteriorOver[SpectrumSet]) -> list[Reason]:
    if LOW_PASS not in posterior.identified():
        return []
    fit = posterior.with_effect(LOW_PASS).fit
    return [Reason(Code.NOISE_ROLLS_OFF, corner_hz=math.exp(float(fit.shared[-FILTER_TERMS])))]


def _drawn(site: Site, density: FloatArray, noise: FloatArray) -> Spectra:
    absent = ~site.spectra.present
    measured, before, after = site.spectra.mean_power(), noise.copy(), density.copy()
    for rows in (measured, before, after):
        rows[absent] = math.nan
    return Spectra(site.spectra.label, site.spectra.frequency_hz, measured, before, after)
