"""Diagnosis of recordings: reading and closing the loop, with one progress for both."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from gateway.core.clock import Clock, SystemClock
from gateway.core.config.vehicle import VehicleConfig
from gateway.core.reasons import Reason
from gateway.core.revolutions.effect_correction import CorrectionTable
from gateway.core.worker_pool import Workers
from gateway.diagnosis.campaign import read_campaign, read_usable
from gateway.diagnosis.campaign_recording import ReadOrder
from gateway.diagnosis.checks.outvoted_recordings import RecordingsContradictedError, unlike_signals
from gateway.diagnosis.closed_loop import SEARCHED, BaselineUnfittedError, baseline_fits, diagnose
from gateway.diagnosis.data.campaign_data import Campaign
from gateway.diagnosis.effects.effect import BaselineModel
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.result import Diagnosis, Origin, RecordingOrigin
from gateway.diagnosis.revision import commit
from gateway.diagnosis.transfer import Transfer, transfer

# Share of reading in the total time.
_READING_SHARE: Final = 0.15
# Likewise where effects are only compared.
_TRANSFER_READING_SHARE: Final = 0.3

Progress = Callable[[float, str], None]


def diagnose_recordings(
    orders: Sequence[ReadOrder],
    *,
    model: BaselineModel = BaselineModel.EXACT,
    empirical: bool = False,
    workers: Workers | None = None,
    budget_s: float | None = None,
    self_tests: int = 0,
    clock: Clock | None = None,
    on_progress: Progress | None = None,
) -> Diagnosis:
    """Diagnose one wheel of one or more recordings.

    Args:
        orders: of the recordings.
        model: baseline model.
        empirical: whether to fit an empirical correction to the unexplained residual.
        workers: other processes that share the work.
        budget_s: time after which the search for effects ends, reading included; None sets no limit. The baseline
            model, the error on held-out revolutions and figures are computed in any case; a note says how long.
        self_tests: number of recordings to simulate from the result and to diagnose again.
        clock: of the budget; None for the system's.
        on_progress: called with the share done, 0 to 1, and the present step.

    Raises:
        TreadlinkError: a recording cannot be read, or contains nothing usable.
    """
    clock = clock or SystemClock()
    begin_ns = clock.now_ns()
    report = on_progress or (lambda _share, _text: None)
    paths = [order.path for order in orders]
    total = sum(path.stat().st_size for path in paths if path.is_file())
    read_bytes = 0

    def on_bytes(count: int) -> None:
        nonlocal read_bytes
        read_bytes += count
        report(_READING_SHARE * min(1.0, read_bytes / max(total, 1)), "reading")

    campaign = read_campaign(orders, on_bytes=on_bytes, workers=workers)
    read_ns = clock.now_ns()
    searched_ns: int | None = None

    def on_share(share: float, text: str) -> None:
        nonlocal searched_ns
        if share >= SEARCHED / (self_tests + 1) and searched_ns is None:
            searched_ns = clock.now_ns()
        report(_READING_SHARE + (1.0 - _READING_SHARE) * share, text)

    diagnosis = diagnose(
        campaign,
        model=model,
        empirical=empirical,
        on_progress=on_share,
        expired=lambda: budget_s is not None and clock.now_ns() >= begin_ns + round(1e9 * budget_s),
        workers=workers,
        self_tests=self_tests,
    )
    if budget_s is not None and not diagnosis.complete:
        end_ns = clock.now_ns()
        spent = Reason(
            DiagnosisCode.TIME_LIMIT_SPENT,
            limit_s=budget_s,
            reading_s=1e-9 * (read_ns - begin_ns),
            search_s=1e-9 * ((searched_ns or end_ns) - read_ns),
            after_s=1e-9 * (end_ns - (searched_ns or end_ns)),
        )
        limit, *others = diagnosis.notes
        diagnosis = replace(diagnosis, notes=(limit, spent, *others))
    return _with_origin(diagnosis, campaign, paths)


def _with_origin(diagnosis: Diagnosis, campaign: Campaign, paths: Sequence[Path]) -> Diagnosis:
    """Return a diagnosis with what the campaign notes and states, and what it was made of."""
    times_s = campaign.times_s or ((0.0, 0.0),) * len(paths)
    origin = Origin(
        tuple(RecordingOrigin(str(path), _sha256(path), *times) for path, times in zip(paths, times_s, strict=True)),
        campaign.sensor_id,
        campaign.vehicle,
        campaign.tire,
        commit=commit(),
    )
    return replace(
        diagnosis, notes=_notes(diagnosis, campaign), stated=campaign.stated, origin=origin, units=campaign.units
    )


def _sha256(path: Path) -> str:
    if not path.is_file():
        return ""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def diagnose_agreeing(
    paths: Sequence[Path], wheel: str, *, vehicle: VehicleConfig | None = None, key_file: Path | None = None
) -> Diagnosis:
    """Diagnose one wheel from those of many recordings that can be used and do not contradict most others.

    One recording that cannot be read, or with a reversed axis, does not cost the others their diagnosis.

    Args:
        paths: recordings.
        wheel: position.
        vehicle: configuration for all recordings; None to use the one in each recording.
        key_file: keys of signed frames, where the configuration asks for them.

    Returns:
        the diagnosis; `left_out` lists the other recordings with their reasons.

    Raises:
        TreadlinkError: no recording can be used, or what is wrong holds for all.
    """
    used, refused = read_usable(paths, wheel, vehicle=vehicle, key_file=key_file)
    left_out = {str(paths[number]): reason for number, reason in refused.items()}
    while True:
        campaign = used.campaign()
        contradicted: Mapping[int, Reason] = unlike_signals(campaign)
        diagnosis = None
        if not contradicted:
            try:
                diagnosis = diagnose(campaign)
                contradicted = diagnosis.outvoted
            except RecordingsContradictedError as error:
                if len(error.recordings) == len(used):
                    raise
                contradicted = error.recordings
            except BaselineUnfittedError:
                alone = [number for number in range(len(used)) if not baseline_fits(used.chosen([number]).campaign())]
                if len(alone) in (0, len(used)):
                    raise
                contradicted = dict.fromkeys(alone, Reason(DiagnosisCode.BASELINE_UNFITTED))
        if diagnosis is not None and not contradicted:
            reasons = tuple(
                Reason(DiagnosisCode.RECORDING_LEFT_OUT, recording=str(path), reason=left_out[str(path)])
                for path in paths
                if str(path) in left_out
            )
            used_paths = [order.path for order in used.orders]
            return replace(_with_origin(diagnosis, campaign, used_paths), left_out=reasons)
        left_out |= {str(used.orders[number].path): reason for number, reason in contradicted.items()}
        used = used.chosen(range(len(used)) - contradicted.keys())


def _notes(diagnosis: Diagnosis, campaign: Campaign) -> tuple[Reason, ...]:
    """Return what was noted; what is wrong with a sensor comes first, as it bears on everything else."""
    notes = dict.fromkeys((*diagnosis.notes, *campaign.notes))
    return tuple(sorted(notes, key=lambda note: not _is_alarm(note)))


def _is_alarm(note: Reason) -> bool:
    reason = note["reason"] if note.code is DiagnosisCode.ABOUT_RECORDING else note
    return isinstance(reason, Reason) and reason.code in (DiagnosisCode.SENSOR_ALARM, DiagnosisCode.SENSOR_IN_DOUBT)


def transfer_effects(
    orders: Sequence[ReadOrder],
    table: CorrectionTable,
    *,
    model: BaselineModel = BaselineModel.EXACT,
    workers: Workers | None = None,
    origin: str = "effects",
    on_progress: Progress | None = None,
) -> Transfer:
    """Return the error on recordings with the effects of an effects file, exactly as they were found.

    Args:
        orders: of the recordings of the wheel of the effects file.
        table: of the effects file.
        model: baseline model.
        workers: other processes that share the work.
        origin: name of the effects file, for messages.
        on_progress: called with the share done, 0 to 1, and the present step.

    Raises:
        TreadlinkError: a recording cannot be read or contains nothing usable, or an effect is not known or impossible.
    """
    report = on_progress or (lambda _share, _text: None)
    report(0.0, "reading")
    campaign = read_campaign(orders, workers=workers)
    report(_TRANSFER_READING_SHARE, "comparing with and without the effects")
    result = transfer(campaign, table, model=model, origin=origin)
    report(1.0, "done")
    return replace(result, report=_with_origin(result.report, campaign, [order.path for order in orders]))
