"""The closed loop: baseline model, residual, effects, hold-out, estimates before and after."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from gateway.closure.data.campaign_data import Campaign
from gateway.closure.effects.effect import BaselineModel
from gateway.closure.inference.contact_edge_jitter import beside_edges, edge_findings
from gateway.closure.inference.effect_contribution import contribution_table
from gateway.closure.inference.hold_out import over_noise, summary
from gateway.closure.inference.likelihood import whiten
from gateway.closure.inference.non_stationary import beside_changes, changing
from gateway.closure.inference.nonsynchronous_diagnosis import diagnose_time_locked
from gateway.closure.inference.number_estimates import estimates_of
from gateway.closure.inference.residual import unexplained
from gateway.closure.inference.single_speed import doubted, is_one_speed
from gateway.closure.inference.validated_selection import close_loop
from gateway.closure.model.baseline_registry import make_core
from gateway.closure.report_curves import curves_of, trends_of
from gateway.closure.result import FAR_OFF, Diagnosis, Unexplained, Verdict
from gateway.errors import TreadlinkError
from gateway.reasons import Code, Reason

_FEW_REVOLUTIONS: Final = 20
# States listed in one note.
_MOST_STATES: Final = 3


def diagnose(
    campaign: Campaign,
    *,
    model: BaselineModel = BaselineModel.EXACT,
    empirical: bool = False,
    on_progress: Callable[[float, str], None] = lambda _share, _text: None,
    jobs: int = 1,
) -> Diagnosis:
    """Find the effects that a baseline model lacks on a campaign.

    Args:
        campaign: the data of one wheel.
        model: baseline model.
        empirical: also report the held-out error with the mean residual added as a correction.
        on_progress: called with the share that is done and the present step.
        jobs: processes for the nested hold-out.

    Raises:
        TreadlinkError: there are too few data, or the baseline model cannot be fitted.
    """
    core = make_core(model)
    data = whiten(campaign, with_mean=core.mean)
    if data.folds < 2:
        raise TreadlinkError(
            "a diagnosis needs at least two revolutions of one recording", "Record longer at a steady speed."
        )
    on_progress(0.0, "fitting the baseline model")
    closed = close_loop(campaign, core, data, model, on_progress, jobs)
    selection = closed.selection
    held_out, noise, corrected = summary(closed.errors)
    over = held_out.rms_after_mps2 / noise if noise > 0.0 else math.nan
    findings = doubted(closed.findings, selection.final.model.effects, campaign, over)
    on_progress(0.9, "diagnosing the time-locked signal")
    changes = changing(selection.final, selection.data)
    time_locked = diagnose_time_locked(campaign.groups, changing=bool(changes))
    edges = edge_findings(campaign.groups)
    on_progress(0.97, "preparing figures")
    before, _ = estimates_of(selection.start, data)
    shares = over_noise(closed.errors)
    # Each state separately: one that the model does not describe hides behind good ones. A state without held-out
    # revolutions has no known error.
    far_off = [state for state in range(campaign.states) if not shares.get(state, math.inf) <= FAR_OFF]
    after, determined = estimates_of(selection.final, selection.data, closed.undecided, far_off)
    left: tuple[Unexplained, ...] = (
        *changes,
        *unexplained(selection.final, selection.data),
        *beside_changes(time_locked.unexplained, changes),
    )
    on_progress(1.0, "done")
    return Diagnosis(
        model=str(model),
        wheel=campaign.wheel,
        recordings=campaign.recordings,
        assumed=campaign.assumed,
        revolutions=sum(block.count for group in campaign.groups for block in group.blocks),
        rejected=sum(campaign.rejected.values()),
        noise_floor_mps2=noise,
        held_out=held_out,
        findings=tuple(
            sorted(
                (*findings, *edges, *beside_edges(time_locked.findings, edges)),
                key=lambda finding: _RANK[finding.verdict],
            )
        ),
        unexplained=tuple(sorted(left, key=lambda entry: -entry.rms_mps2)),
        estimates_before=before,
        estimates_after=after,
        determined=determined,
        curves=curves_of(selection.start, selection.final, data),
        spectra=time_locked.spectra,
        trends=trends_of(selection.start, selection.final, data),
        empirical_rms_mps2=corrected if empirical else None,
        notes=(*_far_off(campaign, far_off, shares), *_notes(campaign, with_mean=core.mean), *time_locked.notes),
        folds_of=_folds_of(campaign),
        correction=contribution_table(selection.final, tuple(findings)),
        load_known=all(group.load_known for group in campaign.groups),
        pressure_known=all(group.pressure_known for group in campaign.groups),
    )


_RANK: Final = {Verdict.NAMED: 0, Verdict.INDISTINGUISHABLE: 1, Verdict.REFUSED: 2}


def _folds_of(campaign: Campaign) -> str:
    single = all(block.count == 1 for group in campaign.groups for block in group.blocks)
    return "revolutions" if single else "blocks of revolutions"


def _far_off(campaign: Campaign, states: Sequence[int], shares: Mapping[int, float]) -> tuple[Reason, ...]:
    """Return a note of the states that the model is far from, when there are other states."""
    if campaign.states < 2 or not states:
        return ()
    names = []
    for state in sorted(states, key=lambda state: -shares.get(state, math.inf))[:_MOST_STATES]:
        conditions = next(group.conditions for group in campaign.groups if group.state == state)
        load_n, pressure_pa = conditions.load_n, conditions.pressure_pa
        if state in shares:
            share = shares[state]
            names.append(Reason(Code.STATE_WITH_ERROR, load_n=load_n, pressure_pa=pressure_pa, noise_floors=share))
        else:
            names.append(Reason(Code.STATE, load_n=load_n, pressure_pa=pressure_pa))
    if len(states) > _MOST_STATES:
        names.append(Reason(Code.MORE_STATES, states=len(states) - _MOST_STATES))
    return (Reason(Code.STATES_NOT_DETERMINED, limit=FAR_OFF, states=tuple(names)),)


def _notes(campaign: Campaign, *, with_mean: bool) -> tuple[Reason, ...]:
    notes = [] if with_mean else [Reason(Code.MEANS_NOT_COMPARED)]
    notes += [
        Reason(Code.REVOLUTIONS_LEFT_OUT, revolutions=count, reason=reason)
        for reason, count in campaign.rejected.items()
    ]
    total = sum(block.count for group in campaign.groups for block in group.blocks)
    if total < _FEW_REVOLUTIONS:
        notes.append(Reason(Code.FEW_REVOLUTIONS, revolutions=total))
    if is_one_speed(campaign):
        notes.append(Reason(Code.ONE_SPEED))
    return tuple(notes)
