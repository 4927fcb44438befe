"""The whole loop: starting model, residual, effects, hold-out, estimates before and after."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from gateway.closure.changing import beside_changes, changing
from gateway.closure.closing import close_loop
from gateway.closure.contribution import contribution_table
from gateway.closure.diagnosis import FAR_OFF, Diagnosis, Unexplained, Verdict
from gateway.closure.edge_finding import beside_edges, edge_findings
from gateway.closure.effects.base import BaselineModel
from gateway.closure.estimates import estimates_of, state_name
from gateway.closure.held_out import over_noise, summary
from gateway.closure.likelihood import whiten
from gateway.closure.observation import Campaign
from gateway.closure.one_speed import doubted, is_one_speed
from gateway.closure.picture import curves_of, trends_of
from gateway.closure.residual import unexplained
from gateway.closure.starting import make_core
from gateway.closure.timelocked import diagnose_time_locked
from gateway.errors import TreadlinkError

_FEW_REVOLUTIONS: Final = 20
_NO_MEAN: Final = (
    "the paper's model has no mean, so the axes' means are not compared: no zero-g offset or steady gain is seen in "
    "them; start from --model exact to see it"
)
# States named in one note.
_MOST_STATES: Final = 3


def diagnose(
    campaign: Campaign,
    *,
    model: BaselineModel = BaselineModel.EXACT,
    empirical: bool = False,
    on_progress: Callable[[float, str], None] = lambda _share, _text: None,
    jobs: int = 1,
) -> Diagnosis:
    """Find what a starting model lacks on a campaign.

    Args:
        campaign: the data of one wheel.
        model: where to start.
        empirical: also report the held-out error with the mean residual added as a correction.
        on_progress: called with the share that is done and what is being done.
        jobs: processes for the nested hold-out.

    Raises:
        TreadlinkError: there are too few data, or the starting model cannot be fitted.
    """
    core = make_core(model)
    data = whiten(campaign, with_mean=core.mean)
    if data.folds < 2:
        raise TreadlinkError(
            "a diagnosis needs two revolutions of one recording at least", "Record longer at a steady speed."
        )
    on_progress(0.0, "fitting the starting model")
    closed = close_loop(campaign, core, data, model, on_progress, jobs)
    selection = closed.selection
    held_out, noise, corrected = summary(closed.errors)
    over = held_out.rms_after_mps2 / noise if noise > 0.0 else math.nan
    findings = doubted(closed.findings, selection.final.model.effects, campaign, over)
    on_progress(0.9, "what does not repeat with the wheel")
    changes = changing(selection.final, selection.data)
    time_locked = diagnose_time_locked(campaign.groups, changing=bool(changes))
    edges = edge_findings(campaign.groups)
    on_progress(0.97, "figures")
    before, _ = estimates_of(selection.start, data)
    shares = over_noise(closed.errors)
    # Each by itself: one that the model does not describe hides behind good ones. Where nothing could be held out
    # nothing is known.
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
    )


_RANK: Final = {Verdict.NAMED: 0, Verdict.INDISTINGUISHABLE: 1, Verdict.REFUSED: 2}


def _folds_of(campaign: Campaign) -> str:
    single = all(block.count == 1 for group in campaign.groups for block in group.blocks)
    return "revolutions" if single else "blocks of revolutions"


def _far_off(campaign: Campaign, states: Sequence[int], shares: Mapping[int, float]) -> tuple[str, ...]:
    """Return which states the model is far from, where that is not all there is."""
    if campaign.states < 2 or not states:
        return ()
    names = []
    for state in sorted(states, key=lambda state: -shares.get(state, math.inf))[:_MOST_STATES]:
        conditions = next(group.conditions for group in campaign.groups if group.state == state)
        share = f" ({shares[state]:.1f})" if state in shares else ""
        names.append(f"{state_name(conditions)}{share}")
    more = f" and {len(states) - _MOST_STATES} more" if len(states) > _MOST_STATES else ""
    return (
        f"numbers are not determined where the held-out error is above {FAR_OFF:g} noise floors: at "
        + "; ".join(names)
        + more,
    )


def _notes(campaign: Campaign, *, with_mean: bool) -> tuple[str, ...]:
    notes = [] if with_mean else [_NO_MEAN]
    notes += [f"{count} revolutions left out: {reason}" for reason, count in campaign.rejected.items()]
    total = sum(block.count for group in campaign.groups for block in group.blocks)
    if total < _FEW_REVOLUTIONS:
        notes.append(f"{total} revolutions only: what is seen in all of them may still be chance of this run")
    if is_one_speed(campaign):
        notes.append("one speed only: what goes with speed cannot be told from what does not")
    return tuple(notes)
