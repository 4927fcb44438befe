"""Diagnosis of recordings: reading and closing the loop, with one progress for both."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from gateway.clock import Clock, SystemClock
from gateway.closure.closed_loop import diagnose
from gateway.closure.data.campaign_data import Remark
from gateway.closure.effects.effect import BaselineModel
from gateway.closure.result import Diagnosis
from gateway.closure.transfer import Transfer, transfer
from gateway.config.vehicle import VehicleConfig
from gateway.reasons import Code, Reason
from gateway.session.campaign import read_campaign
from gateway.signal.effect_correction import CorrectionTable

# Share of reading in the total time.
_READING_SHARE: Final = 0.15
# Likewise where effects are only compared.
_READ_SHARE: Final = 0.3

Progress = Callable[[float, str], None]


def diagnose_recordings(
    paths: Sequence[Path],
    *,
    vehicle: VehicleConfig | None = None,
    wheel: str | None = None,
    model: BaselineModel = BaselineModel.EXACT,
    empirical: bool = False,
    folds: int = 5,
    jobs: int = 2,
    reverse: Collection[Path] = (),
    key_file: Path | None = None,
    budget_s: float | None = None,
    clock: Clock | None = None,
    on_progress: Progress | None = None,
) -> Diagnosis:
    """Diagnose one wheel of one or more recordings.

    Args:
        paths: recordings.
        vehicle: configuration for all recordings; None to use the one in each recording.
        wheel: position; None when the recordings contain one wheel only.
        model: baseline model.
        empirical: whether to fit an empirical correction to the unexplained residual.
        folds: blocks of revolutions under the same conditions, for held-out errors.
        jobs: maximum number of processes.
        reverse: those of `paths` recorded in the opposite direction.
        key_file: keys of signed frames, where the configuration asks for them.
        budget_s: time that the search for effects may take, reading not included; None sets no limit.
        clock: of the budget; None for the system's.
        on_progress: called with the share done, 0 to 1, and the present step.

    Raises:
        TreadlinkError: a recording cannot be read, or contains nothing usable.
    """
    clock = clock or SystemClock()
    report = on_progress or (lambda _share, _text: None)
    total = sum(path.stat().st_size for path in paths if path.is_file())
    read = 0

    def on_bytes(count: int) -> None:
        nonlocal read
        read += count
        report(_READING_SHARE * min(1.0, read / max(total, 1)), "reading")

    campaign = read_campaign(
        paths,
        vehicle=vehicle,
        wheel=wheel,
        folds=folds,
        on_bytes=on_bytes,
        jobs=jobs,
        reverse=reverse,
        key_file=key_file,
    )
    end_ns = None if budget_s is None else clock.now_ns() + round(1e9 * budget_s)
    diagnosis = diagnose(
        campaign,
        model=model,
        empirical=empirical,
        on_progress=lambda share, text: report(_READING_SHARE + (1.0 - _READING_SHARE) * share, text),
        expired=lambda: end_ns is not None and clock.now_ns() >= end_ns,
        jobs=jobs,
    )
    notes = tuple(dict.fromkeys((*diagnosis.notes, *campaign.notes)))
    # What is wrong with a sensor comes first: it bears on everything else.
    notes = tuple(sorted(notes, key=lambda note: not _is_alarm(note)))
    return replace(diagnosis, notes=notes, stated=campaign.stated)


def _is_alarm(note: Remark) -> bool:
    if not isinstance(note, Reason):
        return False
    reason = note["reason"] if note.code is Code.ABOUT_RECORDING else note
    return isinstance(reason, Reason) and reason.code in (Code.SENSOR_ALARM, Code.SENSOR_IN_DOUBT)


def transfer_effects(
    paths: Sequence[Path],
    table: CorrectionTable,
    *,
    vehicle: VehicleConfig | None = None,
    model: BaselineModel = BaselineModel.EXACT,
    folds: int = 5,
    jobs: int = 2,
    reverse: Collection[Path] = (),
    key_file: Path | None = None,
    origin: str = "effects",
    on_progress: Progress | None = None,
) -> Transfer:
    """Return the error on recordings with the effects of an effects file, exactly as they were found.

    Args:
        paths: recordings.
        table: of the effects file.
        vehicle: configuration for all recordings; None to use the one in each recording.
        model: baseline model.
        folds: blocks of revolutions under the same conditions, for held-out errors.
        jobs: maximum number of processes.
        reverse: those of `paths` recorded in the opposite direction.
        key_file: keys of signed frames, where the configuration asks for them.
        origin: name of the effects file, for messages.
        on_progress: called with the share done, 0 to 1, and the present step.

    Raises:
        TreadlinkError: a recording cannot be read or contains nothing usable, or an effect is not known or impossible.
    """
    report = on_progress or (lambda _share, _text: None)
    report(0.0, "reading")
    campaign = read_campaign(
        paths,
        vehicle=vehicle,
        wheel=table.position,
        folds=folds,
        jobs=jobs,
        reverse=reverse,
        key_file=key_file,
    )
    report(_READ_SHARE, "comparing with and without the effects")
    result = transfer(campaign, table, model=model, origin=origin)
    report(1.0, "done")
    return result
