"""Diagnosis of the signal not locked to the wheel angle: its effects and its unexplained part."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gateway.closure.data.campaign_data import Group
from gateway.closure.effects.catalogue import catalogue
from gateway.closure.effects.effect import SpectrumEffect
from gateway.closure.inference.findings import fitted_parameter
from gateway.closure.inference.narrow_lines import running_median, usable_bins
from gateway.closure.inference.nonsynchronous_density import (
    JITTER,
    LOW_PASS,
    Site,
    full_density,
    sites_of,
    wide_density,
)
from gateway.closure.inference.nonsynchronous_selection import OTHERS, Selection, Step, place_of
from gateway.closure.inference.nonsynchronous_spectra import group_spectra
from gateway.closure.inference.nonsynchronous_tests import objection, several_speeds
from gateway.closure.inference.unexplained_spectrum import parts_left, unexplained
from gateway.closure.inference.whittle_fit import SpectrumFit
from gateway.closure.result import Finding, Fitted, Spectra, Unexplained, Verdict
from gateway.reasons import Code, Reason
from gateway.types import FloatArray

FOLDS: Final = 5
ROAD: Final = "road vibration"
ANTI_ALIAS: Final = "anti-alias filter"
_ANOTHER_SPEED: Final = Reason(Code.RECORD_AT_ANOTHER_SPEED)

# Bins in which a rejected effect had at least this share of the density are excluded from later fits. An effect that
# covers more than this share of the bins is broadband; its spectrum then becomes the shape of the noise.
_HELD: Final = 0.15
_BROAD: Final = 0.35
_SMOOTH_BINS: Final = 40
_CLEARLY: Final = 0.1


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


@dataclass(frozen=True, slots=True)
class _Refusal:
    """A rejected effect; the reason refers to `fit`."""

    effect: SpectrumEffect
    step: Step
    fit: SpectrumFit
    reason: Reason
    open: bool


def diagnose_time_locked(groups: Sequence[Group], *, changing: bool = False) -> TimeLocked:
    """Identify the effects in the signal that remains when the wheel's mean waveform is subtracted.

    Args:
        groups: groups with deviations; those without, or too short for two seconds per fold, are skipped with a note.
        changing: whether the angle-locked signal is non-stationary; fitted contact-edge jitter then only represents
            that change.

    Returns:
        the findings; none when no group is long enough.
    """
    pairs = [(group, spectra) for group in groups if (spectra := group_spectra(group, FOLDS)) is not None]
    short = len(groups) - len(pairs)
    notes = [Reason(Code.GROUPS_TOO_SHORT, groups=short, of=len(groups))] if short else []
    if not pairs:
        return TimeLocked(notes=tuple(notes))
    sites = sites_of(*zip(*pairs, strict=True))
    usable = usable_bins(sites)
    effects = [effect for effect in catalogue().values() if isinstance(effect, SpectrumEffect)]
    others = list(OTHERS)
    refusals: list[_Refusal] = []
    # Every round but the last removes one candidate.
    while True:
        selection, taken, doubted = _select(sites, usable, effects, others)
        refusal = _worst(selection, taken)
        if refusal is None:
            if not selection.fit.parts.jitter or _jitter_rad2(selection.fit)[0] > 0.0:
                break
            others.remove(JITTER)
            continue
        refusals.append(refusal)
        effects.remove(refusal.effect)
        # Bins that a low-pass explains equally well stay in use.
        if refusal.effect.name not in doubted:
            sites = _kept_out(sites, usable, selection.fit, refusal.effect)
    fit = selection.fit
    notes += _notes(fit, sites, changing=changing)
    # The noise is white again, so that the spectrum that had become its shape is listed.
    plain = tuple(Site.of(site.spectra, site.basis) for site in sites)
    parts, drawn = [], []
    for g, site in enumerate(plain):
        density, noise = full_density(site, fit.parts, fit.levels[g], fit.shared)
        parts += parts_left(site, g, density, noise, np.exp(fit.levels[g]))
        drawn.append(_drawn(site, density, noise))
    # With unexplained broadband noise, a single speed cannot identify an effect.
    shaky = not several_speeds(sites) and any(site.floor.std() > 0.0 for site in sites)
    findings = [_finding(selection, step, step.name in doubted, shaky) for step in taken if step.effect is not None]
    findings += [_refused(refusal) for refusal in refusals]
    findings += [_rival(selection, step) for step in doubted.values() if step not in taken and step.effect is not None]
    rank = list(Verdict)
    findings.sort(key=lambda finding: rank.index(finding.verdict))
    return TimeLocked(tuple(findings), tuple(unexplained(plain, parts)), tuple(drawn), tuple(notes))


def _select(
    sites: Sequence[Site], usable: Sequence[FloatArray], effects: Sequence[SpectrumEffect], others: Sequence[str]
) -> tuple[Selection, list[Step], dict[str, Step]]:
    """Return the selection, its accepted steps, and by name the steps that a low-pass in the sensor may also be."""
    selection = Selection(sites, usable)
    candidates, remaining = list(effects), list(others)
    taken: list[Step] = []
    doubted: dict[str, Step] = {}
    one_speed = not several_speeds(sites)
    while steps := selection.steps(candidates, remaining):
        best = steps[0]
        low_pass = next((step for step in steps if step.name == LOW_PASS), None)
        road = next((step for step in steps if step.name == ROAD), None)
        if one_speed and low_pass and road and best in (low_pass, road) and not _better(road, low_pass):
            doubted[ROAD] = road
        selection.take(best)
        taken.append(best)
        if best.effect is None:
            remaining.remove(best.name)
        else:
            candidates.remove(best.effect)
    return selection, taken, doubted


def _better(first: Step, second: Step) -> bool:
    """Return whether one step is clearly better: by two standard errors, and by more than a filter's form explains."""
    difference = first.gains - second.gains
    unsure = float(difference.std(ddof=1)) * math.sqrt(len(difference))
    return float(difference.sum()) > max(6.0, 2.0 * unsure, _CLEARLY * first.gain)


def _worst(selection: Selection, taken: Sequence[Step]) -> _Refusal | None:
    """Return the accepted effect that fails its tests; of several, the one with the fewest bins."""
    found = []
    for step in taken:
        if step.effect is None:
            continue
        reason, still_open = objection(selection.sites, selection.observed, selection.fit, step.effect)
        if reason is not None:
            bins = sum(int((part > _HELD).sum()) for part in _shares(selection.sites, selection.fit, step.effect))
            found.append((bins, _Refusal(step.effect, step, selection.fit, reason, still_open)))
    return min(found, key=lambda one: one[0])[1] if found else None


def _shares(sites: Sequence[Site], fit: SpectrumFit, effect: SpectrumEffect) -> list[FloatArray]:
    """Return the share of an effect in the density, (3, m) for each group."""
    own = fit.shared[place_of(fit.parts, effect)]
    found = []
    for site, level in zip(sites, fit.levels, strict=True):
        density, _ = full_density(site, fit.parts, level, fit.shared)
        found.append(effect.density(site.spectra.conditions, site.spectra.frequency_hz, own) / density)
    return found


def _kept_out(
    sites: Sequence[Site], usable: list[FloatArray], fit: SpectrumFit, effect: SpectrumEffect
) -> tuple[Site, ...]:
    """Exclude the bins of a rejected effect, so that the next effect does not explain them; `usable` changes."""
    shares = _shares(sites, fit, effect)
    result = []
    for site, used, share in zip(sites, usable, shares, strict=True):
        reached = (share > _HELD).any(axis=0)
        if reached.mean() < _BROAD:
            used[:, reached] = 0.0
            result.append(site)
            continue
        power = site.spectra.mean_power()
        smooth = np.stack([running_median(row, min(_SMOOTH_BINS, len(row) - 1)) for row in power])
        level = np.median(smooth[:, -_SMOOTH_BINS:], axis=1, keepdims=True)
        floor = np.divide(smooth, level, out=np.ones_like(smooth), where=level > 0.0)
        result.append(Site.of(site.spectra, site.basis, floor))
    return tuple(result)


def _notes(fit: SpectrumFit, sites: Sequence[Site], *, changing: bool) -> list[Reason]:
    notes = []
    if fit.parts.jitter and not changing:
        size = math.sqrt(_jitter_rad2(fit)[1]) * float(np.mean([s.spectra.conditions.radius_m for s in sites]))
        notes.append(Reason(Code.CONTACT_EDGE_JITTER, rms_m=size))
    if fit.parts.low_pass and fit.shared[-1] > 0.0:
        notes.append(Reason(Code.NOISE_ROLLS_OFF, corner_hz=float(fit.shared[-1] ** -0.25)))
    return notes


def _jitter_rad2(fit: SpectrumFit) -> tuple[float, float]:
    """Return the mean square of the edge jitter minus two standard errors, and the mean square itself."""
    at = sum(len(effect.parameters) for effect in fit.parts.effects)
    # Without damping the two edges have the same spectrum: only their sum is well determined.
    value = 0.5 * float(fit.shared[at] + fit.shared[at + 1])
    std = 0.5 * math.sqrt(max(float(fit.covariance[at : at + 2, at : at + 2].sum()), 0.0))
    return value - 2.0 * std, value


def _drawn(site: Site, density: FloatArray, noise: FloatArray) -> Spectra:
    absent = ~site.spectra.present
    measured, before, after = site.spectra.mean_power(), noise.copy(), density.copy()
    for rows in (measured, before, after):
        rows[absent] = math.nan
    return Spectra(site.spectra.label, site.spectra.frequency_hz, measured, before, after)


def _parameters(step: Step, fit: SpectrumFit) -> dict[str, Fitted]:
    if step.effect is None:
        return {}
    place = place_of(fit.parts, step.effect)
    std = np.sqrt(np.maximum(np.diag(fit.covariance)[place], 0.0))
    return {
        one.name: fitted_parameter(one, float(value), float(error))
        for one, value, error in zip(step.effect.parameters, fit.shared[place], std, strict=True)
    }


def _finding(selection: Selection, step: Step, doubted: bool, shaky: bool) -> Finding:
    made = _described(step, selection.fit, _rms(selection, selection.fit, step))
    before, after = _left_over(selection, step)
    made = replace(made, verdict=Verdict.NAMED, rms_before_mps2=before, rms_after_mps2=after)
    if doubted:
        return _doubtful(made)
    if shaky:
        reason = Reason(Code.BROADBAND_NOISE_LEFT)
        return replace(made, verdict=Verdict.INDISTINGUISHABLE, reason=reason, decide_with=_ANOTHER_SPEED)
    return made


def _rival(selection: Selection, step: Step) -> Finding:
    return _doubtful(_described(step, step.fit, _rms(selection, step.fit, step)))


def _doubtful(finding: Finding) -> Finding:
    return replace(
        finding,
        verdict=Verdict.INDISTINGUISHABLE,
        rivals=(ANTI_ALIAS,),
        decide_with=Reason(Code.RECORD_ROAD_AT_ANOTHER_SPEED),
    )


def _refused(refusal: _Refusal) -> Finding:
    made = _described(refusal.step, refusal.fit, math.nan)
    if refusal.open:
        return replace(
            made,
            verdict=Verdict.INDISTINGUISHABLE,
            reason=refusal.reason,
            decide_with=_ANOTHER_SPEED,
        )
    return replace(made, reason=refusal.reason)


def _described(step: Step, fit: SpectrumFit, rms: float) -> Finding:
    effect = step.effect
    if effect is None:
        raise ValueError(f"{step.name} is no effect of the catalogue")
    return Finding(
        effect.name,
        Verdict.REFUSED,
        _parameters(step, fit),
        step.chi2,
        step.gain,
        step.gain_std,
        rms,
        summary=effect.summary,
        equation=effect.equation,
        lock="time",
    )


def _rms(selection: Selection, fit: SpectrumFit, step: Step) -> float:
    """Return the root mean square of an effect, over groups and the axes on which it acts."""
    if step.effect is None:
        return math.nan
    own = fit.shared[place_of(fit.parts, step.effect)]
    powers = []
    for site in selection.sites:
        density = step.effect.density(site.spectra.conditions, site.spectra.frequency_hz, own)
        powers += [float(density[axis].sum()) * site.spectra.step_hz for axis in step.effect.axes]
    return math.sqrt(float(np.mean(powers)))


def _left_over(selection: Selection, step: Step) -> tuple[float, float]:
    """Return the rms of the unexplained power without and with an effect, over its axes and all groups."""
    effect = step.effect
    if effect is None:
        return math.nan, math.nan
    own = selection.fit.shared[place_of(selection.fit.parts, effect)]
    without, left = [], []
    for g, (site, one) in enumerate(zip(selection.sites, selection.observed, strict=True)):
        density = wide_density(site, selection.fit.parts, selection.fit.levels[g], selection.fit.shared)[0]
        added = site.wide(effect.density(site.spectra.conditions, site.grid_hz, own))
        for axis in effect.axes:
            if site.spectra.present[axis]:
                number = site.spectra.count * site.spectra.step_hz * (one.freedom[axis] > 0.0)
                missing = one.power[axis] - density[axis]
                left.append(float(number @ missing))
                without.append(float(number @ (missing + added[axis])))
    before, after = (math.sqrt(abs(float(np.mean(powers)))) for powers in (without, left))
    return before, after
