"""Diagnosis of the signal not locked to the wheel angle: its effects and its unexplained part."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gateway.core.reasons import Reason
from gateway.core.types import FloatArray
from gateway.diagnosis.bayes.parameter_estimates import parameters_over_sets
from gateway.diagnosis.bayes.posterior import PosteriorOver, over
from gateway.diagnosis.bayes.verdicts import Judgement, judgements
from gateway.diagnosis.data.campaign_data import Group
from gateway.diagnosis.effects.catalogue import catalogue
from gateway.diagnosis.effects.effect import SpectrumEffect
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.result import Finding, Spectra, Unexplained, Verdict
from gateway.diagnosis.spectrum.nonsynchronous_density import FILTER_TERMS, LOW_PASS, Site, full_density, strange_name
from gateway.diagnosis.spectrum.nonsynchronous_spectra import group_spectra
from gateway.diagnosis.spectrum.spectrum_sets import SpectrumSearch, SpectrumSet
from gateway.diagnosis.spectrum.unexplained_spectrum import parts_left, several_speeds, unexplained
from gateway.diagnosis.spectrum.whittle_fit import SpectrumFit

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
    notes = [Reason(DiagnosisCode.GROUPS_TOO_SHORT, groups=short, of=len(groups))] if short else []
    if not measured:
        return TimeLocked(notes=tuple(notes))
    sites = tuple(Site.of(index, measurement) for index, measurement in enumerate(measured))
    available = [effect for name, effect in catalogue().items() if name not in without]
    effects = [effect for effect in available if isinstance(effect, SpectrumEffect)]
    posterior = over(SpectrumSearch(sites, effects).evaluations)
    findings = _findings(posterior, effects, sites)
    # The density that is explained is that of effects that are identified, or of which one is.
    identified = frozenset(finding.name for finding in findings if finding.verdict is not Verdict.REFUSED)
    best_set = posterior.best
    fit = best_set.fit
    parts, result_spectra = [], []
    for site, level in zip(sites, fit.levels, strict=True):
        density, noise = full_density(site, fit.parts, level, fit.shared, identified)
        parts += parts_left(site, density, noise, np.exp(level))
        result_spectra.append(_result_spectra(site, density, noise))
    notes += _notes(posterior)
    remaining = tuple(unexplained(sites, parts))
    revised = beside_larger(findings, _larger(findings, remaining, sites, fit), several=several_speeds(sites))
    return TimeLocked(tuple(revised), remaining, tuple(result_spectra), tuple(notes))


def beside_larger(findings: Sequence[Finding], larger: Mapping[str, float], *, several: bool) -> list[Finding]:
    """Make effects undecided that are smaller than something unknown of which they may be a part, and their rivals.

    Args:
        findings: of the spectra.
        larger: rms of the largest unexplained part that may contain an effect, by its name, m/s^2.
        several: whether the recordings have several speeds.
    """
    decides = Reason(DiagnosisCode.RECORD_AGAIN, how="another_road" if several else "another_speed")
    revised = []
    smaller = {
        finding.name
        for finding in findings
        if finding.verdict is not Verdict.REFUSED and finding.rms_mps2 < larger[finding.name]
    }
    for finding in findings:
        if finding.name in smaller:
            doubt = Reason(
                DiagnosisCode.BESIDE_SOMETHING_LARGER, own_mps2=finding.rms_mps2, larger_mps2=larger[finding.name]
            )
            finding = replace(finding, reason=doubt)
        if finding.verdict is not Verdict.REFUSED and smaller & {finding.name, *finding.rivals}:
            finding = replace(
                finding,
                verdict=Verdict.INDISTINGUISHABLE,
                rivals=(*finding.rivals, UNKNOWN),
                decide_with=finding.decide_with or decides,
            )
        revised.append(finding)
    return revised


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
    in_band = total = 0.0
    for site in sites:
        frequency = site.spectra.frequency_hz
        density = effect.density(site.spectra.conditions, frequency, parameters)
        in_band += float(density[:, (frequency >= part.hz[0]) & (frequency <= part.hz[1])].sum())
        total += float(density.sum())
    return in_band > 0.5 * total


def _findings(
    posterior: PosteriorOver[SpectrumSet], effects: Sequence[SpectrumEffect], sites: Sequence[Site]
) -> list[Finding]:
    """Return the finding of every effect with evidence: identified, then undecided, then rejected."""
    by_name = {effect.name: effect for effect in effects}
    # A strange band is no cause: where it is likely, no effect of the catalogue is certain to be present.
    return [
        _finding(posterior, judgement, by_name[judgement.name], sites)
        for judgement in judgements(posterior, {*by_name, LOW_PASS})
        if judgement.name in by_name
    ]


def _finding(
    posterior: PosteriorOver[SpectrumSet],
    judgement: Judgement[SpectrumSet],
    effect: SpectrumEffect,
    sites: Sequence[Site],
) -> Finding:
    name, inside = judgement.name, judgement.inside
    # What remains without it: the best set that lacks it and any band in its place.
    stand_in = strange_name(name)
    without = max(
        (candidate for candidate in posterior.every.values() if not {name, stand_in} & candidate.names),
        key=lambda candidate: candidate.log_evidence,
    )
    considered = posterior.considered if judgement.possible else ()
    several = several_speeds(sites)
    return Finding(
        name,
        judgement.verdict,
        parameters_over_sets(
            effect.parameters,
            inside.fit.parameters_of(name),
            [(member.fit.parameters_of(name), weight) for member, weight in considered if name in member.names],
        ),
        without.fit.deviance - inside.fit.deviance,
        _rms(sites, inside.fit, effect),
        rivals=tuple(ANTI_ALIAS if rival == LOW_PASS else rival for rival in judgement.rivals),
        decide_with=Reason(DiagnosisCode.RECORD_AGAIN, how="another_speed")
        if judgement.rivals and not several
        else None,
        reason=judgement.reason,
        summary=effect.summary,
        equation=effect.equation,
        lock="time",
        probability=posterior.probability([name]) if judgement.possible else 0.0,
        log_odds=posterior.log_odds(name) if judgement.possible else math.nan,
    )


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
    return [Reason(DiagnosisCode.NOISE_ROLLS_OFF, corner_hz=math.exp(float(fit.shared[-FILTER_TERMS])))]


def _result_spectra(site: Site, density: FloatArray, noise: FloatArray) -> Spectra:
    absent = ~site.spectra.present
    measured, before, after = site.spectra.mean_power(), noise.copy(), density.copy()
    for rows in (measured, before, after):
        rows[absent] = math.nan
    return Spectra(site.spectra.label, site.spectra.frequency_hz, measured, before, after)
