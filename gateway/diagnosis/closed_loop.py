"""The closed loop: baseline model, posterior over sets of effects, hold-out, estimates before and after."""

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from functools import partial
from typing import Final, NamedTuple

import numpy as np

from gateway.core.constants import AXIS_NAMES
from gateway.core.errors import TreadlinkError
from gateway.core.plugins import error_text, is_from_user
from gateway.core.reasons import Reason
from gateway.core.worker_pool import Workers
from gateway.diagnosis import criteria
from gateway.diagnosis.angle.discrepancy import Discrepancy
from gateway.diagnosis.angle.fit import Fit, FitFailedError
from gateway.diagnosis.angle.likelihood import Whitened, whiten
from gateway.diagnosis.angle.number_estimates import (
    belt_widths,
    belt_widths_apart,
    estimates_of,
    open_effects,
    still_determined,
    widened,
)
from gateway.diagnosis.angle.remainder_freedom import beside_remainder
from gateway.diagnosis.angle.residual import PARTS, PLANE, left_shares, residual_ratio
from gateway.diagnosis.checks.outvoted_recordings import (
    RecordingsContradictedError,
    opposite_pair,
    unlike_contacts_of,
    unlike_loads,
    unlike_signals,
)
from gateway.diagnosis.checks.recordings_apart import Apart, recordings_apart
from gateway.diagnosis.checks.reference_model import OnExactRing, on_exact_ring
from gateway.diagnosis.checks.rolling_direction import turned_round
from gateway.diagnosis.checks.single_speed import doubted, is_one_speed
from gateway.diagnosis.data.campaign_data import Campaign
from gateway.diagnosis.data.condition_groups import unlike_contacts
from gateway.diagnosis.effects.catalogue import candidates, plugin_effects
from gateway.diagnosis.effects.effect import BaselineModel
from gateway.diagnosis.effects.mounting import MountingOffset
from gateway.diagnosis.model.baseline_registry import angle_effects, make_core
from gateway.diagnosis.model.closure_model import AngleEffect
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.remainder.contact_edge_jitter import edge_findings
from gateway.diagnosis.remainder.drifts import drifts_of, with_drifts
from gateway.diagnosis.remainder.non_stationary import beside_changes, changing
from gateway.diagnosis.remainder.unexplained_orders import unexplained
from gateway.diagnosis.remainder.unexplained_revolutions import unexplained_revolutions
from gateway.diagnosis.remainder.wheel_rate_sizes import rate_findings
from gateway.diagnosis.report.effect_contribution import contribution_table
from gateway.diagnosis.report.findings import apart_from, beside_more, confirmed, findings_of, of_common_size
from gateway.diagnosis.report.free_waveform import beside_unknown
from gateway.diagnosis.report.hold_out import alignment_note, hold_out
from gateway.diagnosis.report.one_size import of_one_size
from gateway.diagnosis.report.other_conditions import judged_elsewhere
from gateway.diagnosis.report.report_curves import curves_of, effect_curves_of, trends_of
from gateway.diagnosis.result import Diagnosis, Finding, Fitted, Unexplained, Verdict
from gateway.diagnosis.search.candidate_scan import Helpers
from gateway.diagnosis.search.set_search import SetSearch, baseline_fit
from gateway.diagnosis.search.tempered_posterior import Posterior, posterior_of
from gateway.diagnosis.self_test import self_test
from gateway.diagnosis.spectrum.nonsynchronous_diagnosis import TimeLocked, diagnose_time_locked

Progress = Callable[[float, str], None]


class BaselineUnfittedError(TreadlinkError):
    """The baseline model alone cannot be fitted to the recordings."""


_FEW_REVOLUTIONS: Final = 20
# Shares of the time at which the first fit, the hold-out and the time-locked part end.
_FITTED, _HELD_OUT, _TIME_LOCKED = 0.1, 0.87, 0.97
SEARCHED: Final = 0.8
"""Share that is done when the search has ended."""

# What is left of the search after each set.
_REMAINING_SHARE: Final = 0.93


def diagnose(
    campaign: Campaign,
    *,
    model: BaselineModel = BaselineModel.EXACT,
    empirical: bool = False,
    on_progress: Progress = lambda _share, _text: None,
    expired: Callable[[], bool] = lambda: False,
    workers: Workers | None = None,
    self_tests: int = 0,
) -> Diagnosis:
    """Find the effects that a baseline model lacks on a campaign.

    Args:
        campaign: the data of one wheel.
        model: baseline model.
        empirical: also report the held-out error with the mean of the discrepancy added as a correction.
        on_progress: called with the share that is done and the present step.
        expired: True when the time for the search is over; what is known by then is reported.
        workers: other processes that share the work; the result does not depend on them.
        self_tests: number of recordings to simulate from the result and to diagnose again.

    Raises:
        TreadlinkError: there are too few data.
        BrokenProcessPool: a process was terminated from outside; `Workers` explains it.
        BaselineUnfittedError: the baseline model cannot be fitted.
        RecordingsContradictedError: recordings contradict their stated direction.
    """
    helpers = Helpers(workers or Workers())
    parts = self_tests + 1

    def part(share: float, text: str) -> None:
        on_progress(share / parts, text)

    run = partial(_diagnose, expired=expired, helpers=helpers)
    others = plugin_effects()
    left_out: tuple[Reason, ...] = ()
    try:
        diagnosis, fit = run(campaign, model, empirical, part)
    except BaseException as error:  # code of others may raise anything
        if not others or isinstance(error, TreadlinkError | BrokenProcessPool) or is_from_user(error):
            raise
        text = error_text(error)
        left_out = (Reason(DiagnosisCode.PLUGIN_EFFECTS_LEFT_OUT, effects=", ".join(sorted(others)), error=text),)
        run = partial(run, omitted=others)
        diagnosis, fit = run(campaign, model, empirical, part)
    diagnosis = replace(diagnosis, notes=(*left_out, *diagnosis.notes))
    if not self_tests:
        return diagnosis

    def again(simulation: Campaign, on_share: Progress) -> Diagnosis:
        return run(simulation, model, False, on_share)[0]

    def beyond(share: float, text: str) -> None:
        on_progress((1.0 + self_tests * share) / parts, text)

    return replace(diagnosis, self_test=self_test(fit, diagnosis, again, self_tests, beyond, expired))


def _diagnose(
    campaign: Campaign,
    model: BaselineModel,
    empirical: bool,
    on_progress: Progress,
    expired: Callable[[], bool],
    helpers: Helpers,
    omitted: Collection[str] = (),
) -> tuple[Diagnosis, Fit]:
    """Return the diagnosis of a campaign without the effects `omitted`, and the fit of the best set."""
    core = make_core(model)
    data = whiten(campaign, core)
    if data.folds < 2:
        raise TreadlinkError(
            "a diagnosis needs at least two revolutions of one recording", "Record longer at a steady speed."
        )
    if all(group.conditions.offset_measured for group in campaign.groups):
        # Its error is a parameter of every set.
        omitted = {*omitted, MountingOffset.name}
    effects = angle_effects({name: effect for name, effect in candidates(model).items() if name not in omitted})
    search = SetSearch(
        campaign, core, data, effects, Discrepancy(campaign, data), expired, _Steps(on_progress), helpers
    )
    edges_ahead = helpers.ahead(_edges, campaign)
    time_locked_ahead = helpers.ahead(partial(_time_locked, without=omitted), campaign)
    posterior = _searched(search, on_progress)
    best_set = posterior.best
    on_progress(SEARCHED, "computing held-out errors")
    also = [posterior.every[names] for name in best_set.names if (names := best_set.names - {name}) in posterior.every]
    errors = hold_out(posterior, data, also)
    held_out, noise = errors.summary, errors.noise_mps2
    noise_ratio = held_out.rms_after_mps2 / noise if noise > 0.0 else math.nan
    exact = on_exact_ring(best_set.fit)
    findings = _judged(posterior, effects, errors.rms_of, exact, campaign, data, noise_ratio)
    findings = _not_overturned(findings, search, posterior)
    on_progress(_HELD_OUT, "diagnosing the time-locked signal")
    changes = changing(best_set.fit, data)
    if changes:
        drifts = drifts_of(best_set.fit, data, tuple(effects.values()))
        changes = tuple(replace(entry, drifts=drifts) for entry in changes)
        findings = with_drifts(findings, drifts)
    time_locked = time_locked_ahead()
    edges = edges_ahead()
    on_progress(_TIME_LOCKED, "preparing figures")
    numbers = _numbers(search, posterior, exact)
    residuals: tuple[Unexplained, ...] = (
        *changes,
        *unexplained(best_set.fit, data),
        *beside_changes(time_locked.unexplained, changes),
        *unexplained_revolutions(campaign.groups),
    )
    all_findings = (*findings, *edges, *rate_findings(campaign), *time_locked.findings)
    fits = errors.fit_of[frozenset()], errors.fit_of[best_set.names]
    on_progress(1.0, "done")
    diagnosis = Diagnosis(
        model=str(model),
        wheel=campaign.wheel,
        recordings=campaign.recordings,
        assumed=campaign.assumed,
        revolutions=campaign.revolutions,
        rejected=sum(campaign.rejected.values()),
        noise_floor_mps2=noise,
        held_out=held_out,
        findings=tuple(sorted(all_findings, key=lambda finding: _RANK[finding.verdict])),
        unexplained=tuple(sorted(residuals, key=lambda entry: -entry.rms_mps2)),
        estimates_before=numbers.before,
        estimates_after=numbers.after,
        determined=numbers.determined,
        determined_before=numbers.determined_before,
        curves=curves_of(*fits, data),
        effect_curves=effect_curves_of(best_set.fit, [f for f in findings if f.verdict is Verdict.NAMED]),
        spectra=time_locked.spectra,
        trends=trends_of(*fits, data),
        empirical_rms_mps2=errors.with_discrepancy_mps2 if empirical else None,
        notes=(
            *_ended(search),
            *(
                Reason(DiagnosisCode.ABOUT_RECORDING, recording=campaign.recordings[number], reason=reason)
                for number, reason in sorted(numbers.outvoted.items())
            ),
            *_opposite_axes(campaign),
            *_contradictions(campaign, numbers.unlike),
            *_unlike_widths(numbers.widths_apart),
            *_differing(campaign, numbers.differing),
            *_doubted_sensors(campaign),
            *_no_ring(campaign, numbers.strange),
            *alignment_note(held_out),
            *_notes(campaign, with_mean=core.mean),
            *(_cut_short(search, posterior) or _tempered(posterior)),
            *_open_effect_notes(numbers.considered, numbers.after),
            *other_optimum_notes(posterior),
            *time_locked.notes,
        ),
        folds_of=_folds_of(campaign),
        correction=contribution_table(best_set.fit, tuple(findings)),
        load_known=all(group.load_known for group in campaign.groups),
        pressure_known=all(group.pressure_known for group in campaign.groups),
        complete=search.complete,
        outvoted=numbers.outvoted,
    )
    return diagnosis, best_set.fit


def _judged(
    posterior: Posterior,
    effects: Mapping[str, AngleEffect],
    rms_of: Mapping[frozenset[str], float],
    exact: OnExactRing | None,
    campaign: Campaign,
    data: Whitened,
    noise_ratio: float,
) -> list[Finding]:
    """Return the findings of effects, as the exact ring and unseen recordings judge them."""
    best_set = posterior.best
    findings = findings_of(posterior, effects, rms_of)
    if exact is not None:
        findings = confirmed(apart_from(findings, exact.parameters), exact.absent)
    without = {name: posterior.without(name).fit for name in best_set.names}
    findings = beside_unknown(findings, best_set.fit, without, posterior.temperatures)
    single = of_one_size(beside_more(findings, best_set.fit, data), best_set.fit, data)
    tested = judged_elsewhere(of_common_size(single), best_set.fit, without, data)
    return doubted(tested, tuple(effects.values()), campaign, noise_ratio)


class _Numbers(NamedTuple):
    """The estimates of a diagnosis, and what contradicts them.

    Attributes:
        before: of the baseline model.
        after: over the sets of effects.
        determined: whether the data determine each of `after`.
        determined_before: likewise of `before`.
        considered: fits of the sets, with their weights.
        widths_apart: the two Cw of states farthest apart that contradict each other.
        unlike: pairs of groups whose contacts differ.
        differing: recordings of one state whose numbers contradict each other.
        strange: groups whose signal is not that of a ring, with the share of it that is left.
        outvoted: recordings that most others contradict, by index, and why.
    """

    before: dict[str, Fitted]
    after: dict[str, Fitted]
    determined: dict[str, bool]
    determined_before: dict[str, bool]
    considered: list[tuple[Fit, float]]
    widths_apart: tuple[Fitted, Fitted] | None
    unlike: list[tuple[int, int]]
    differing: list[Apart]
    strange: dict[int, float]
    outvoted: dict[int, Reason]


def _numbers(search: SetSearch, posterior: Posterior, exact: OnExactRing | None) -> _Numbers:
    """Return the estimates before and after, as far as the recordings do not contradict each other."""
    campaign, core, data = search.campaign, search.core, search.data
    reference_numbers = [exact.numbers] if exact is not None else []
    if exact is None and posterior.impossible is not None:
        reference_numbers = [estimates_of([(posterior.impossible.fit, 1.0)])[0]]
    unlike = _unlike_contacts(campaign)
    # Only where much is left: it costs a fit of each recording.
    differing = recordings_apart(campaign, core) if max(posterior.temperatures) >= criteria.TEMPERED else []
    doubted_states = {group.state for group in campaign.groups if group.sensor_doubted}
    doubted_states |= {campaign.groups[first].state for first, _ in unlike} | {
        difference.state for difference in differing
    }
    if _is_cut_short(search, posterior):
        doubted_states = {group.state for group in campaign.groups}
    contradicted = frozenset(doubted_states)
    non_ring, non_ring_before = (_not_a_ring(evaluated.fit, data) for evaluated in (posterior.best, posterior.baseline))
    considered = [(beside_remainder(evaluated.fit, data), weight) for evaluated, weight in posterior.considered]
    after, determined = estimates_of(
        considered, reference_numbers, contradicted | _states_of(campaign, non_ring), posterior.temperatures.plane
    )
    if exact is None and core.model is not BaselineModel.EXACT:
        # The error of the equations is unknown.
        determined = dict.fromkeys(determined, False)
    to_before = reference_numbers if exact is not None else [*reference_numbers, after]
    before, determined_before = estimates_of(
        [(beside_remainder(posterior.baseline.fit, data), 1.0)],
        to_before,
        contradicted | _states_of(campaign, non_ring_before),
        math.sqrt(residual_ratio(posterior.baseline.fit, data, PLANE)),
    )
    widths = belt_widths(campaign, after)
    # The series take the load for a part of Cw.
    widths_apart = belt_widths_apart(widths.values()) if core.model is BaselineModel.EXACT else None
    outvoted = {**unlike_signals(campaign), **unlike_contacts_of(campaign)}
    if widths_apart is not None:
        unlike_others = unlike_loads(campaign, widths)
        before, after = widened(before, *widths_apart), widened(after, *widths_apart)
        surviving = still_determined(after, determined)
        # Where numbers survive the contradiction, more recordings are worth more than its small share.
        outvoted |= unlike_others if surviving != determined else {}
        determined = surviving
        determined_before = still_determined(before, determined_before)
    return _Numbers(
        before, after, determined, determined_before, considered, widths_apart, unlike, differing, non_ring, outvoted
    )


def _searched(search: SetSearch, on_progress: Progress) -> Posterior:
    """Return the posterior over sets of effects.

    Raises:
        BaselineUnfittedError: the baseline model cannot be fitted.
        RecordingsContradictedError: recordings contradict their stated direction.
    """
    on_progress(0.0, "fitting the baseline model")
    try:
        first = baseline_fit(search.campaign, search.core, search.data)
        _check_directions(search.campaign, turned_round(first, search.data))
        on_progress(_FITTED, "searching for effects")
        search.run(first)
    except FitFailedError as error:
        raise _cannot_be_fitted(search.core.model, error) from error
    if frozenset() not in search.evaluations:
        raise _cannot_be_fitted(search.core.model, "its residual has no fit")
    return posterior_of(search)


def _time_locked(campaign: Campaign, without: Collection[str]) -> TimeLocked:
    return diagnose_time_locked(campaign.groups, without)


def _edges(campaign: Campaign) -> tuple[Finding, ...]:
    return edge_findings(campaign.groups)


def baseline_fits(campaign: Campaign) -> bool:
    """Return whether the exact ring alone can be fitted to a campaign."""
    core = make_core(BaselineModel.EXACT)
    try:
        baseline_fit(campaign, core, whiten(campaign, core))
    except FitFailedError:
        return False
    return True


class _Steps:
    """Converter of sets worked on, whose number is unknown beforehand, to a growing share."""

    def __init__(self, on_progress: Progress) -> None:
        self._on_progress = on_progress
        self._done = 0

    def __call__(self, effects: int) -> None:
        self._done += 1
        share = _FITTED + (SEARCHED - _FITTED) * (1.0 - _REMAINING_SHARE**self._done)
        self._on_progress(share, f"comparing sets of {effects} effects" if effects != 1 else "comparing single effects")


def _cannot_be_fitted(model: BaselineModel, error: object) -> BaselineUnfittedError:
    return BaselineUnfittedError(
        f"the baseline model '{model}' cannot be fitted to these recordings: {error}",
        "Check belt radius, load and pressure in the configuration.",
    )


def _check_directions(campaign: Campaign, contradicted: list[int]) -> None:
    """Reject recordings that contradict their stated direction, which no effect could correct.

    Raises:
        RecordingsContradictedError: one does.
    """
    if not contradicted:
        return
    reverse_recordings = {group.recording for group in campaign.groups if group.conditions.reverse}
    remedies = [
        f"remove --reverse {campaign.recordings[number]}"
        if number in reverse_recordings
        else f"add --reverse {campaign.recordings[number]}"
        for number in contradicted
    ]
    raise RecordingsContradictedError(
        "the sign of the circumferential axis is opposite to that of a rolling tire in "
        + ", ".join(f"'{campaign.recordings[number]}'" for number in contradicted),
        f"If the tire rolled in the opposite direction, {' and '.join(remedies)}; otherwise the sensor's axis points "
        "backwards: record or import it with the sign reversed.",
        dict.fromkeys(contradicted, Reason(DiagnosisCode.CIRCUMFERENTIAL_REVERSED)),
    )


def _unlike_contacts(campaign: Campaign) -> list[tuple[int, int]]:
    return unlike_contacts(
        np.array([group.state for group in campaign.groups]),
        np.array([group.conditions.omega_radps for group in campaign.groups]),
        np.array([group.half_angle_rad for group in campaign.groups]),
    )


def _doubted_sensors(campaign: Campaign) -> tuple[Reason, ...]:
    """Return the note on recordings whose sensor the pipeline doubts."""
    places = sorted({group.recording for group in campaign.groups if group.sensor_doubted})
    if not places:
        return ()
    return (
        Reason(DiagnosisCode.SENSOR_IN_DOUBT, recordings=tuple(campaign.recordings[recording] for recording in places)),
    )


def _not_a_ring(fit: Fit, data: Whitened) -> dict[int, float]:
    """Return the groups whose signal is not that of a ring, with the share of it that is left."""
    return {index: share for index, share in enumerate(left_shares(fit, data)) if share > criteria.NO_RING}


def _states_of(campaign: Campaign, groups: Iterable[int]) -> frozenset[int]:
    return frozenset(campaign.groups[index].state for index in groups)


def _no_ring(campaign: Campaign, non_ring_shares: Mapping[int, float]) -> tuple[Reason, ...]:
    """Return the note on recordings whose signal is not that of a ring."""
    if not non_ring_shares:
        return ()
    places = sorted({campaign.groups[index].recording for index in non_ring_shares})
    names = tuple(campaign.recordings[recording] for recording in places)
    return (Reason(DiagnosisCode.NOT_A_RING, recordings=names, share=max(non_ring_shares.values())),)


def _contradictions(campaign: Campaign, pairs: Sequence[tuple[int, int]]) -> tuple[Reason, ...]:
    """Return a note on every state whose contacts differ."""
    notes = []
    for pair in pairs:
        short, long = (campaign.groups[index] for index in pair)
        is_same = short.recording == long.recording
        first, second = (group.label if is_same else campaign.recordings[group.recording] for group in (short, long))
        notes.append(
            Reason(
                DiagnosisCode.CONTACTS_CONTRADICT,
                short=first,
                short_rad=short.half_angle_rad,
                long=second,
                long_rad=long.half_angle_rad,
            )
        )
    return tuple(notes)


def _unlike_widths(widths: tuple[Fitted, Fitted] | None) -> tuple[Reason, ...]:
    if widths is None:
        return ()
    low, high = widths
    return (
        Reason(DiagnosisCode.LOADS_CONTRADICT, low=low.value, high=high.value, share=math.log(high.value / low.value)),
    )


def _is_cut_short(search: SetSearch, posterior: Posterior) -> bool:
    """Return whether the search ended with so much unexplained that effects that move the numbers may be missing."""
    return not search.complete and max(posterior.temperatures) >= criteria.TEMPERED


def _cut_short(search: SetSearch, posterior: Posterior) -> tuple[Reason, ...]:
    if not _is_cut_short(search, posterior):
        return ()
    return (Reason(DiagnosisCode.LEFT_WHEN_ENDED, residual_ratio=max(posterior.temperatures)),)


def _differing(campaign: Campaign, pairs: Sequence[Apart]) -> Iterator[Reason]:
    """Yield the note on recordings of one state whose numbers contradict each other."""
    for pair in pairs:
        yield Reason(
            DiagnosisCode.NUMBERS_CONTRADICT,
            number=pair.low.quantity,
            low=pair.low.value,
            recording=campaign.recordings[pair.low_recording],
            high=pair.high.value,
            other=campaign.recordings[pair.high_recording],
        )


def _open_effect_notes(considered: Sequence[tuple[Fit, float]], after: Mapping[str, Fitted]) -> Iterator[Reason]:
    """Yield a note on each effect whose presence is open and makes up most of the error of numbers."""
    for open_effect in open_effects(considered, after):
        code = (
            DiagnosisCode.ERROR_BY_MISSING_EFFECT
            if open_effect.probability > 0.5
            else DiagnosisCode.ERROR_BY_POSSIBLE_EFFECT
        )
        yield Reason(
            code,
            effect=open_effect.name,
            probability=open_effect.probability,
            numbers=open_effect.numbers,
            ratio=open_effect.ratio,
        )


def other_optimum_notes(posterior: Posterior) -> Iterator[Reason]:
    """Yield a note on each other optimum that makes up most of the error of a parameter, the first one of these."""
    weights = {id(evaluated): weight for evaluated, weight in posterior.considered}
    fit = posterior.best.fit
    for name, others in posterior.optima.items():
        effect = next(effect for effect in fit.model.effects if effect.name == name)
        indices = fit.model.layout.effect(name)
        for evaluated in others:
            shifts = np.abs(evaluated.fit.vector - fit.vector)[indices] / np.sqrt(np.diagonal(fit.covariance)[indices])
            weight = weights.get(id(evaluated), 0.0)
            widened_to = np.hypot(1.0, math.sqrt(weight) * shifts)
            if widened_to.max() < criteria.OPEN_RATIO:
                continue
            index = int(np.argmax(widened_to >= criteria.OPEN_RATIO))
            parameter = effect.parameters[index]
            yield Reason(
                DiagnosisCode.OTHER_OPTIMUM,
                effect=name,
                parameter=parameter.name,
                value=float(evaluated.fit.vector[indices][index]) * parameter.factor,
                best=float(fit.vector[indices][index]) * parameter.factor,
                unit=parameter.display_unit or parameter.unit,
                probability=weight,
            )


def _ended(search: SetSearch) -> tuple[Reason, ...]:
    if search.complete:
        return ()
    return (Reason(DiagnosisCode.SEARCH_ENDED_EARLY, sets=len(search.evaluations), untried=search.untried),)


def _not_overturned(findings: Sequence[Finding], search: SetSearch, posterior: Posterior) -> list[Finding]:
    """Reject what a search that its time has ended has identified, where what is missing could take its place."""
    if search.complete:
        return list(findings)
    judged = []
    for finding in findings:
        if finding.verdict is Verdict.NAMED:
            rivals = search.untried_rivals(finding.name)
            if _is_cut_short(search, posterior):
                finding = replace(finding, verdict=Verdict.REFUSED, reason=_cut_short(search, posterior)[0])
            elif rivals:
                finding = replace(
                    finding, verdict=Verdict.REFUSED, reason=Reason(DiagnosisCode.RIVALS_UNTRIED, effects=rivals)
                )
        judged.append(finding)
    return judged


def _tempered(posterior: Posterior) -> tuple[Reason, ...]:
    return tuple(
        Reason(DiagnosisCode.EVIDENCE_TEMPERED, axes=tuple(AXIS_NAMES[axis] for axis in axes), residual_ratio=ratio)
        for axes, ratio in zip(PARTS, posterior.temperatures, strict=True)
        if ratio >= criteria.TEMPERED
    )


_RANK: Final = {Verdict.NAMED: 0, Verdict.INDISTINGUISHABLE: 1, Verdict.REFUSED: 2}


def _folds_of(campaign: Campaign) -> str:
    single = all(block.count == 1 for group in campaign.groups for block in group.blocks)
    return "revolutions" if single else "blocks of revolutions"


def _opposite_axes(campaign: Campaign) -> tuple[Reason, ...]:
    """Return that two recordings have opposite lateral axes, where no majority tells which is reversed."""
    pair = opposite_pair(campaign)
    if pair is None:
        return ()
    first, second = (campaign.recordings[number] for number in pair)
    return (Reason(DiagnosisCode.LATERAL_OPPOSITE, recording=first, other=second),)


def _notes(campaign: Campaign, *, with_mean: bool) -> tuple[Reason, ...]:
    notes = [] if with_mean else [Reason(DiagnosisCode.MEANS_NOT_COMPARED)]
    notes += [
        Reason(DiagnosisCode.REVOLUTIONS_LEFT_OUT, revolutions=count, reason=reason)
        for reason, count in campaign.rejected.items()
    ]
    if campaign.revolutions < _FEW_REVOLUTIONS:
        notes.append(Reason(DiagnosisCode.FEW_REVOLUTIONS, revolutions=campaign.revolutions))
    if is_one_speed(campaign):
        notes.append(Reason(DiagnosisCode.ONE_SPEED))
    return tuple(notes)
