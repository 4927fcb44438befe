"""Recordings in, a diagnosis out: reading and closing the loop, with one progress for both."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from gateway.closure.diagnose import diagnose
from gateway.closure.diagnosis import Diagnosis
from gateway.closure.effects.base import BaselineModel
from gateway.config.vehicle import VehicleConfig
from gateway.session.campaign import read_campaign

# Share of the time that reading takes.
_READING: Final = 0.15

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
    on_progress: Progress | None = None,
) -> Diagnosis:
    """Diagnose one wheel of some recordings.

    Args:
        paths: recordings.
        vehicle: configuration for all of them; None for the one that each was recorded with.
        wheel: position; None when the recordings hold one wheel only.
        model: where to start.
        empirical: whether to fit a correction to what no effect explains.
        folds: blocks of revolutions under the same conditions, for held-out figures.
        jobs: processes at most.
        reverse: those of `paths` that were made rolling the other way round.
        key_file: keys of signed frames, where the configuration asks for them.
        on_progress: called with the share that is done, 0 to 1, and what is being done.

    Raises:
        TreadlinkError: nothing can be read, or not be used.
    """
    told = on_progress or (lambda _share, _text: None)
    total = sum(path.stat().st_size for path in paths if path.is_file())
    read = 0

    def on_bytes(count: int) -> None:
        nonlocal read
        read += count
        told(_READING * min(1.0, read / max(total, 1)), "reading")

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
    diagnosis = diagnose(
        campaign,
        model=model,
        empirical=empirical,
        on_progress=lambda share, text: told(_READING + (1.0 - _READING) * share, text),
        jobs=jobs,
    )
    notes = tuple(dict.fromkeys((*diagnosis.notes, *campaign.notes)))
    return replace(diagnosis, notes=notes, stated=campaign.stated)
