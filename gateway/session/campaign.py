"""Recordings to the data of a diagnosis: read side by side, grouped by conditions, put on one time axis."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, MutableSequence, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import replace
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path
from typing import Final

import numpy as np

from gateway.closure.effects.base import GroupConditions
from gateway.closure.group_making import FEW, label
from gateway.closure.grouping import telling, tire_states
from gateway.closure.observation import Campaign, Group
from gateway.closure.processes import Processes
from gateway.config.vehicle import VehicleConfig
from gateway.errors import RecordingError
from gateway.session.campaign_clock import combined
from gateway.session.campaign_recording import ReadOrder, RecordingRead, read_recording
from gateway.session.campaign_wheel import the_wheel
from gateway.types import IntArray
from gateway.views import wording

LEAST_REVOLUTIONS: Final = 4
"""Groups of fewer are left out, unless there is nothing else."""

MOST_GROUPS: Final = 12
"""Of a campaign, unless there are more recordings: what a diagnosis takes goes with their number."""

SPARE: Final = f"at speeds between those of {MOST_GROUPS} groups that tell the most"

_POLL_S: Final = 0.1
# Stated where no recording knows any temperature; all are the same then, and nothing follows from the value.
_SOME_DEGC: Final = 20.0


def read_campaign(
    paths: Sequence[Path],
    *,
    vehicle: VehicleConfig | None = None,
    wheel: str | None = None,
    folds: int = 5,
    on_bytes: Callable[[int], None] | None = None,
    jobs: int = 2,
    reverse: Collection[Path] = (),
    key_file: Path | None = None,
) -> Campaign:
    """Read recordings and group one wheel's revolutions by their conditions.

    Several recordings are read in processes of their own. But for rounding, the result is the same whatever `jobs` is.

    Args:
        paths: recordings.
        vehicle: configuration for all of them; None for the one that each was recorded with.
        wheel: position; None when the recordings hold one wheel only.
        folds: blocks of a group with revolutions enough, 2 at least.
        on_bytes: called with the number of bytes of the files read, for a progress bar.
        jobs: processes at most.
        reverse: those of `paths` that were made rolling the other way round, or with the tire turned on the rim.
        key_file: keys of signed frames, where the configuration asks for them.

    Raises:
        TreadlinkError: a recording cannot be read, holds nothing to use, or holds several wheels and none was chosen.
        ValueError: fewer than two folds, or no path.
    """
    if folds < 2 or not paths:
        raise ValueError("a campaign needs a recording and two folds at least")
    places, turned = {path.resolve() for path in paths}, {path.resolve() for path in reverse}
    strangers = [path for path in reverse if path.resolve() not in places]
    if strangers:
        raise RecordingError(
            f"'{strangers[0]}' is said to be reverse but is not among the recordings", "Name it as one of them too."
        )
    names = [path.name for path in paths]
    orders = [
        ReadOrder(
            path=path,
            index=index,
            name=path.name if names.count(path.name) == 1 else str(path),
            vehicle=vehicle,
            wheel=wheel,
            folds=folds,
            reverse=path.resolve() in turned,
            key_file=key_file,
        )
        for index, path in enumerate(paths)
    ]
    told = on_bytes or (lambda _: None)
    parallel = jobs > 1 and len(orders) > 1
    reads = _side_by_side(orders, told, min(jobs, len(orders))) if parallel else _one_by_one(orders, told)
    return _assemble(orders, reads, the_wheel(orders, reads, wheel))


def _one_by_one(orders: Sequence[ReadOrder], on_bytes: Callable[[int], None]) -> list[RecordingRead]:
    reads = []
    for order in orders:
        done = 0

        def on_position(position: int) -> None:
            nonlocal done
            on_bytes(position - done)
            done = position

        reads.append(_of_one_wheel(order, read_recording(order, on_position)))
    return reads


def _of_one_wheel(order: ReadOrder, read: RecordingRead) -> RecordingRead:
    """Return what was read, before the others are read in vain."""
    if order.wheel is None and len(read.wheels) > 1:
        raise RecordingError(
            f"'{order.path}' holds several wheels: {', '.join(read.wheels)}", f"Choose one: --wheel {read.wheels[0]}."
        )
    return read


_positions: MutableSequence[int] | None = None


def _share_positions(positions: MutableSequence[int]) -> None:
    """Run in a fresh process: keep the shared memory in which it tells how far it is."""
    global _positions
    _positions = positions


def _read_apart(order: ReadOrder) -> RecordingRead:
    def on_position(position: int) -> None:
        assert _positions is not None
        _positions[order.index] = position

    return read_recording(order, on_position)


def _side_by_side(orders: Sequence[ReadOrder], on_bytes: Callable[[int], None], jobs: int) -> list[RecordingRead]:
    # Plain shared memory: a process says how far it is without a word on the queue.
    positions = get_context("spawn").RawArray("q", len(orders))
    done = 0
    with Processes(jobs, _share_positions, (positions,)) as pool:
        futures: list[Future[RecordingRead]] = [pool.submit(_read_apart, order) for order in orders]
        waiting = set(futures)
        while waiting:
            finished, waiting = wait(waiting, _POLL_S, FIRST_COMPLETED)
            now = sum(positions)
            on_bytes(now - done)
            done = now
            for future in finished:
                _of_one_wheel(orders[futures.index(future)], future.result())  # the first fault ends it all
        return [future.result() for future in futures]


def _assemble(orders: Sequence[ReadOrder], reads: Sequence[RecordingRead], wheel: str) -> Campaign:
    rejected: dict[str, int] = {}
    for read in reads:
        for reason, count in (read.rejected or {}).items():
            rejected[reason] = rejected.get(reason, 0) + count
    groups = [group for read in reads for group in read.groups]
    if not groups:
        raise RecordingError(
            f"none of {sum(rejected.values())} revolutions of wheel {wheel} can be used: "
            + "; ".join(f"{count} x {reason}" for reason, count in rejected.items()),
            "At least two revolutions at the same speed are needed, a minute of steady rolling is better.",
        )
    notes = [f"{wording.text(read.damage)}. The readable part is used." for read in reads if read.damage]
    notes += [f"{order.name}: {note}" for order, read in zip(orders, reads, strict=True) for note in read.notes]
    notes += [
        f"{order.name} gave nothing to use"
        for order, read in zip(orders, reads, strict=True)
        if not read.groups and len(orders) > 1
    ]
    big = [group for group in groups if _count(group) >= LEAST_REVOLUTIONS]
    if big and len(big) < len(groups):
        small = [group for group in groups if _count(group) < LEAST_REVOLUTIONS]
        rejected[FEW] = rejected.get(FEW, 0) + sum(map(_count, small))
        groups = big
    groups, spare = _telling(groups)
    if spare:
        rejected[SPARE] = spare
        notes.append(f"{spare} revolutions left out: {SPARE}")
    if FEW in rejected:
        notes.append(f"{rejected[FEW]} revolutions left out: {FEW}")
    sensors = {read.sensor_id for read in reads if read.groups}
    if len(sensors) > 1:
        names = ", ".join(sorted("several" if sensor is None else f"{sensor:08x}" for sensor in sensors))
        notes.append(f"the recordings are of different sensors: {names}")
    begin_s, told = _begins(orders, reads)
    notes += told
    known = [(c.temperature_degc, _count(g)) for g in groups if math.isfinite((c := g.conditions).temperature_degc)]
    degc = sum(value * count for value, count in known) / sum(count for _, count in known) if known else _SOME_DEGC
    states = _states(groups).tolist()
    return Campaign(
        wheel=wheel,
        recordings=tuple(str(order.path) for order in orders),
        groups=tuple(
            _placed(group, state, begin_s[group.recording], degc, orders[group.recording].name)
            for group, state in zip(groups, states, strict=True)
        ),
        states=max(states) + 1,
        rejected=rejected,
        clock_error=combined([read.clock_error for read in reads]),
        assumed=_merged(orders, [read.assumed for read in reads]),
        stated=_merged(orders, [read.stated for read in reads]),
        notes=tuple(notes),
        sensor_id=next(iter(sensors)) if len(sensors) == 1 else None,
    )


def _states(groups: Sequence[Group]) -> IntArray:
    return tire_states(
        np.array([group.conditions.load_n for group in groups]),
        np.array([group.conditions.pressure_pa for group in groups]),
        np.array([group.half_angle_rad for group in groups]),
        np.array([group.load_known for group in groups]),
    )


def _telling(groups: list[Group]) -> tuple[list[Group], int]:
    """Return the groups to use, and the revolutions of those that are left out as there are more than it takes."""
    kept = telling(
        np.array([group.recording for group in groups]),
        _states(groups),
        np.array([group.conditions.omega_radps for group in groups]),
        np.array([_count(group) for group in groups], dtype=np.float64),
        MOST_GROUPS,
    ).tolist()
    return [groups[place] for place in kept], sum(map(_count, groups)) - sum(_count(groups[place]) for place in kept)


def _count(group: Group) -> int:
    return sum(block.count for block in group.blocks)


def _begins(orders: Sequence[ReadOrder], reads: Sequence[RecordingRead]) -> tuple[list[float], list[str]]:
    """Return what is to be taken off each recording's times, so that they count from the first revolution of all.

    Recordings whose times are not the host's, or that seem to have been made at the same time, are put one after
    another in the order given.
    """
    used = [(read.first_s, read.last_s) for read in sorted(reads, key=lambda read: read.first_s) if read.groups]
    apart = all(later[0] >= earlier[1] for earlier, later in pairwise(used))
    if apart and (len(used) == 1 or all(read.host_times for read in reads)):
        return [used[0][0]] * len(orders), []
    begins, elapsed_s = [], 0.0
    for read in reads:
        begins.append(read.first_s - elapsed_s)
        elapsed_s += read.last_s - read.first_s
    return begins, ["the recordings' times say nothing of their order: taken one after another, as named"]


def _placed(group: Group, state: int, begin_s: float, degc: float, name: str) -> Group:
    def placed(conditions: GroupConditions) -> GroupConditions:
        own = conditions.temperature_degc
        return replace(
            conditions,
            temperature_degc=own if math.isfinite(own) else degc,
            reference_degc=degc,
            time_s=conditions.time_s - begin_s,
        )

    blocks = tuple(replace(block, conditions=placed(block.conditions)) for block in group.blocks)
    conditions = placed(group.conditions)
    return replace(group, state=state, blocks=blocks, conditions=conditions, label=label(name, group.conditions))


def _merged(orders: Sequence[ReadOrder], told: Sequence[tuple[str, ...]]) -> tuple[str, ...]:
    """Return what was told of each recording once, with the recordings that it was told of where these are not all."""
    of: dict[str, list[str]] = {}
    for order, texts in zip(orders, told, strict=True):
        for text in dict.fromkeys(texts):
            of.setdefault(text, []).append(order.name)
    return tuple(text if len(names) == len(orders) else f"{text}: {', '.join(names)}" for text, names in of.items())
