"""Campaigns: recordings read in parallel, grouped by conditions and put on one time axis for a diagnosis."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Final, TypeVar

import numpy as np

from gateway.core.config.vehicle import VehicleConfig
from gateway.core.errors import RecordingError, TreadlinkError
from gateway.core.reasons import Reason
from gateway.core.recording.inspection import inspect_recording
from gateway.core.shown_units import ShownUnits
from gateway.core.text.wording import notice_text, text
from gateway.core.types import IntArray
from gateway.core.worker_pool import Workers
from gateway.diagnosis.campaign_clock import combined
from gateway.diagnosis.campaign_recording import ReadOrder, RecordingRead, read_recording
from gateway.diagnosis.data.campaign_data import Campaign, Group, Remark
from gateway.diagnosis.data.condition_groups import most_informative, tire_states
from gateway.diagnosis.data.group_statistics import TOO_FEW_REVOLUTIONS, label
from gateway.diagnosis.data.shared_noise import repeated_recordings
from gateway.diagnosis.effects.effect import GroupConditions
from gateway.diagnosis.reasons import DiagnosisCode

MIN_REVOLUTIONS: Final = 4
"""Smaller groups are left out, unless all are smaller."""

MAX_GROUPS: Final = 12
"""Groups of a campaign, unless there are more recordings: the time of a diagnosis grows with their number."""

_Remark = TypeVar("_Remark", bound=Remark)

SPARE: Final = Reason(DiagnosisCode.REVOLUTION_UNUSED, why="between_speeds", groups=MAX_GROUPS)

# Used where no recording knows any temperature: it is then the same for all, and its value has no effect.
_PLACEHOLDER_DEGC: Final = 20.0
# Within this time even a wheel at walking speed turns more than once.
_ONE_TURN_S: Final = 5.0
# Blocks of a group whose estimates are compared, unless asked otherwise.
_FOLDS: Final = 5


def read_campaign(
    orders: Sequence[ReadOrder],
    *,
    on_bytes: Callable[[int], None] | None = None,
    workers: Workers | None = None,
) -> Campaign:
    """Read recordings and group one wheel's revolutions by their conditions.

    Except for rounding, the result does not depend on `workers`.

    Args:
        orders: of the recordings, see `reading_orders`.
        on_bytes: called with the number of bytes of the files read, for a progress bar.
        workers: other processes that share the work.

    Raises:
        TreadlinkError: a recording cannot be read, contains nothing usable, repeats another, or contains several wheels
            and none was chosen.
        ValueError: no recording.
    """
    if not orders:
        raise ValueError("a campaign needs at least one recording")
    by_index: dict[int, RecordingRead] = {}
    work = (workers or Workers()).work_on(read_recording, orders, on_bytes or (lambda _: None), sizes=_sizes(orders))
    with closing(work) as done:
        for index, file in done:
            by_index[index] = _checked_for_one_wheel(orders[index], file)
    files = [by_index[index] for index in range(len(orders))]
    campaign = _assemble(orders, files, _chosen_wheel(orders, files, orders[0].wheel))
    for number, first in repeated_recordings(campaign.groups).items():
        raise RecordingError(
            f"'{orders[number].path}' holds the same revolutions as '{orders[first].path}'", "Give each recording once."
        )
    return campaign


@dataclass(frozen=True, slots=True)
class WheelRecordings:
    """Recordings of one wheel that were read.

    Attributes:
        wheel: position.
        orders: of the recordings.
        reads: their contents.
    """

    wheel: str
    orders: tuple[ReadOrder, ...]
    reads: tuple[RecordingRead, ...]

    def __len__(self) -> int:
        """Return the number of recordings."""
        return len(self.orders)

    def campaign(self) -> Campaign:
        """Return their revolutions, grouped by conditions; recordings are numbered in their order."""
        return _assemble(self.orders, self.reads, self.wheel)

    def chosen(self, keep: Collection[int]) -> WheelRecordings:
        """Return some of the recordings by their numbers, numbered anew."""
        numbers = sorted(keep)
        return WheelRecordings(
            self.wheel,
            tuple(replace(self.orders[old], index=new) for new, old in enumerate(numbers)),
            tuple(_renumbered(self.reads[old], new) for new, old in enumerate(numbers)),
        )


def read_usable(
    paths: Sequence[Path], wheel: str, *, vehicle: VehicleConfig | None = None, key_file: Path | None = None
) -> tuple[WheelRecordings, dict[int, Reason]]:
    """Read those of many recordings that can be used, and return why the others cannot, by their number.

    Args:
        paths: recordings.
        wheel: position.
        vehicle: configuration for all recordings; None to use the one in each recording.
        key_file: keys of signed frames, where the configuration asks for them.

    Raises:
        RecordingError: none of them can be used.
    """
    orders = reading_orders(paths, vehicle=vehicle, wheel=wheel, key_file=key_file)
    refused: dict[int, Reason] = {}
    files = [RecordingRead(())] * len(orders)
    work = Workers().work_on(_read_or_refuse, orders, lambda _: None)
    with closing(work) as done:
        for index, outcome in done:
            reason = outcome if isinstance(outcome, Reason) else _why_unusable(outcome, wheel)
            if reason is not None:
                refused[index] = reason
            if isinstance(outcome, RecordingRead):
                files[index] = outcome
    if len(refused) == len(orders):
        lines = (f"'{order.path}': {text(refused[order.index])}" for order in orders)
        raise RecordingError(f"no recording of wheel {wheel} can be used:\n" + "\n".join(lines))
    usable = WheelRecordings(wheel, tuple(orders), tuple(files))
    groups = [group for number, file in enumerate(files) if number not in refused for group in file.groups]
    for number, first in repeated_recordings(groups).items():
        refused[number] = Reason(DiagnosisCode.RECORDING_REPEATS, other=str(orders[first].path))
    return usable.chosen(range(len(orders)) - refused.keys()), refused


def _read_or_refuse(order: ReadOrder, on_position: Callable[[int], None]) -> RecordingRead | Reason:
    """Read one recording; return why it cannot be read instead of raising."""
    try:
        return read_recording(order, on_position)
    except TreadlinkError as error:
        return Reason(DiagnosisCode.RECORDING_NOT_USED, message=str(error))
    except OSError as error:
        return Reason(DiagnosisCode.RECORDING_NOT_READ, message=error.strerror or str(error))


def _why_unusable(file: RecordingRead, wheel: str) -> Reason | None:
    if wheel not in file.wheels:
        return Reason(DiagnosisCode.RECORDING_WITHOUT_WHEEL, wheel=wheel)
    if file.groups:
        return None
    rejected = file.rejected or {}
    if not rejected:
        return Reason(DiagnosisCode.RECORDING_WITHOUT_DATA)
    main_reason = max(rejected, key=lambda reason: rejected[reason])
    return Reason(DiagnosisCode.REVOLUTIONS_LEFT_OUT, revolutions=rejected[main_reason], reason=main_reason)


def _renumbered(file: RecordingRead, number: int) -> RecordingRead:
    return replace(file, groups=tuple(replace(group, recording=number) for group in file.groups))


def reading_orders(
    paths: Sequence[Path],
    *,
    vehicle: VehicleConfig | None = None,
    wheel: str | None = None,
    folds: int = _FOLDS,
    reverse: Collection[Path] = (),
    key_file: Path | None = None,
) -> list[ReadOrder]:
    """Return the orders to read the recordings of a campaign.

    Args:
        paths: recordings.
        vehicle: configuration for all recordings; None to use the one in each recording.
        wheel: position; None when the recordings contain one wheel only.
        folds: blocks of a group with enough revolutions, at least 2.
        reverse: those of `paths` recorded in the opposite direction, or with the tire turned on the rim.
        key_file: keys of signed frames, where the configuration asks for them.

    Raises:
        RecordingError: one of `reverse` is not among the recordings.
        ValueError: fewer than two folds.
    """
    if folds < 2:
        raise ValueError("a campaign needs at least two folds")
    real_paths, reversed_paths = set(map(os.path.realpath, paths)), set(map(os.path.realpath, reverse))
    unknown = [path for path in reverse if os.path.realpath(path) not in real_paths]
    if unknown:
        raise RecordingError(
            f"'{unknown[0]}' is given as reverse but is not among the recordings", "Give it as a recording too."
        )
    names = [path.name for path in paths]
    return [
        ReadOrder(
            path=path,
            index=index,
            name=path.name if names.count(path.name) == 1 else str(path),
            vehicle=vehicle,
            wheel=wheel,
            folds=folds,
            reverse=os.path.realpath(path) in reversed_paths,
            key_file=key_file,
        )
        for index, path in enumerate(paths)
    ]


def _sizes(orders: Sequence[ReadOrder]) -> list[int]:
    return [order.path.stat().st_size if order.path.is_file() else 0 for order in orders]


def _checked_for_one_wheel(order: ReadOrder, file: RecordingRead) -> RecordingRead:
    """Raise as soon as a wheel must be chosen, before other recordings are read."""
    if order.wheel is None and len(file.wheels) > 1:
        raise RecordingError(
            f"'{order.path}' contains several wheels: {', '.join(file.wheels)}",
            f"Choose one: --wheel {file.wheels[0]}.",
        )
    return file


def _assemble(orders: Sequence[ReadOrder], files: Sequence[RecordingRead], wheel: str) -> Campaign:
    rejected = _rejected(files)
    groups = _usable_groups(files, wheel, rejected)
    begin_s, order_remarks = _time_origins(orders, files)
    degc = _reference_degc(groups)
    states = _states(groups).tolist()
    groups = _of_one_depth(groups)
    sensors = {file.sensor_id for file in files if file.groups}
    return Campaign(
        wheel=wheel,
        recordings=tuple(str(order.path) for order in orders),
        groups=tuple(
            _placed(group, state, begin_s[group.recording], degc, orders[group.recording].name)
            for group, state in zip(groups, states, strict=True)
        ),
        states=max(states) + 1,
        rejected=rejected,
        clock_error=combined([file.clock_error for file in files]),
        assumed=_merged(orders, [file.assumed for file in files]),
        stated=_merged(orders, [file.stated for file in files]),
        notes=(
            *_recording_remarks(orders, files),
            *_left_out_remarks(rejected),
            *_sensor_remarks(sensors),
            *order_remarks,
        ),
        sensor_id=next(iter(sensors)) if len(sensors) == 1 else None,
        vehicle=_common(file.vehicle for file in files if file.groups),
        tire=_common(file.tire for file in files if file.groups),
        units=next((file.units for file in files if file.groups), ShownUnits.SI),
        times_s=tuple((file.first_s, file.last_s) for file in files),
    )


def _common(names: Iterable[str]) -> str:
    """Return the name that all recordings have, empty if they differ."""
    distinct = set(names)
    return distinct.pop() if len(distinct) == 1 else ""


def _rejected(files: Sequence[RecordingRead]) -> dict[Reason, int]:
    """Return reason -> revolutions left out, over all recordings."""
    rejected: dict[Reason, int] = {}
    for file in files:
        for reason, count in (file.rejected or {}).items():
            rejected[reason] = rejected.get(reason, 0) + count
    return rejected


def _usable_groups(files: Sequence[RecordingRead], wheel: str, rejected: dict[Reason, int]) -> list[Group]:
    """Return the groups to use; revolutions of the others are added to `rejected`.

    Raises:
        RecordingError: there is no group.
    """
    groups = [group for file in files for group in file.groups]
    if not groups:
        raise RecordingError(
            f"none of {sum(rejected.values())} revolutions of wheel {wheel} can be used: "
            + "; ".join(f"{count} x {text(reason)}" for reason, count in rejected.items()),
            "At least two revolutions at the same speed are needed; a minute of steady rolling is better.",
        )
    large_groups = [group for group in groups if group.revolutions >= MIN_REVOLUTIONS]
    if large_groups and len(large_groups) < len(groups):
        small_groups = [group for group in groups if group.revolutions < MIN_REVOLUTIONS]
        rejected[TOO_FEW_REVOLUTIONS] = rejected.get(TOO_FEW_REVOLUTIONS, 0) + sum(
            group.revolutions for group in small_groups
        )
        groups = large_groups
    groups, unused_count = _most_informative(groups)
    if unused_count:
        rejected[SPARE] = unused_count
    return groups


def _reference_degc(groups: Sequence[Group]) -> float:
    """Return the mean of the known temperatures, weighted by revolutions."""
    weighted_degc = [
        (c.temperature_degc, g.revolutions) for g in groups if math.isfinite((c := g.conditions).temperature_degc)
    ]
    if not weighted_degc:
        return _PLACEHOLDER_DEGC
    return sum(value * count for value, count in weighted_degc) / sum(count for _, count in weighted_degc)


def _recording_remarks(orders: Sequence[ReadOrder], files: Sequence[RecordingRead]) -> Iterator[Reason]:
    """Yield the remarks on single recordings."""
    for file in files:
        if file.damage:
            yield Reason(DiagnosisCode.RECORDING_DAMAGED, damage=file.damage)
    for order, file in zip(orders, files, strict=True):
        for notice in file.notices:
            subject = f"{order.name}, {notice.subject}" if notice.subject else order.name
            yield Reason(DiagnosisCode.ABOUT_RECORDING, recording=subject, reason=notice.reason)
        for remark in file.remarks:
            yield Reason(DiagnosisCode.ABOUT_RECORDING, recording=order.name, reason=remark)
    for order, file in zip(orders, files, strict=True):
        if not file.groups and len(orders) > 1:
            yield Reason(
                DiagnosisCode.ABOUT_RECORDING, recording=order.name, reason=Reason(DiagnosisCode.RECORDING_WITHOUT_DATA)
            )


def _left_out_remarks(rejected: Mapping[Reason, int]) -> Iterator[Reason]:
    for reason in (SPARE, TOO_FEW_REVOLUTIONS):
        if reason in rejected:
            yield Reason(DiagnosisCode.REVOLUTIONS_LEFT_OUT, revolutions=rejected[reason], reason=reason)


def _sensor_remarks(sensors: Collection[int | None]) -> Iterator[Reason]:
    if len(sensors) > 1:
        has_several = any(sensor is None for sensor in sensors)
        names = sorted(f"{sensor:08x}" for sensor in sensors if sensor is not None)
        remarks = (Reason(DiagnosisCode.SEVERAL_SENSORS),) if has_several else ()
        yield Reason(DiagnosisCode.DIFFERENT_SENSORS, sensors=(*names, *remarks))


def _states(groups: Sequence[Group]) -> IntArray:
    return tire_states(
        np.array([group.conditions.load_n for group in groups]),
        np.array([group.conditions.pressure_pa for group in groups]),
        np.array([group.half_angle_rad for group in groups]),
        np.array([group.load_known for group in groups]),
    )


def _most_informative(groups: list[Group]) -> tuple[list[Group], int]:
    """Return the groups that inform the diagnosis most, and the number of revolutions in the others."""
    chosen = most_informative(
        np.array([group.recording for group in groups]),
        _states(groups),
        np.array([group.conditions.omega_radps for group in groups]),
        np.array([group.revolutions for group in groups], dtype=np.float64),
        MAX_GROUPS,
    ).tolist()
    others = set(range(len(groups))) - set(chosen)
    return [groups[index] for index in chosen], sum(groups[index].revolutions for index in others)


def _time_origins(orders: Sequence[ReadOrder], files: Sequence[RecordingRead]) -> tuple[list[float], list[Reason]]:
    """Return the time to subtract from each recording's times, so that they count from the first revolution of all.

    Recordings without times of the host, or whose times overlap, are placed one after another in the order given.
    """
    spans_s = [(file.first_s, file.last_s) for file in sorted(files, key=lambda file: file.first_s) if file.groups]
    is_sequential = all(later[0] >= earlier[1] for earlier, later in pairwise(spans_s))
    if is_sequential and (len(spans_s) == 1 or all(file.host_times for file in files)):
        return [spans_s[0][0]] * len(orders), []
    origins_s, elapsed_s = [], 0.0
    for file in files:
        origins_s.append(file.first_s - elapsed_s)
        elapsed_s += file.last_s - file.first_s
    return origins_s, [Reason(DiagnosisCode.RECORDING_ORDER_UNKNOWN)]


def _of_one_depth(groups: Sequence[Group]) -> list[Group]:
    """Return groups whose measured depths are one: what differs between them is the error of the measurements."""
    measured = [group.declared_offset_m for group in groups if group.conditions.offset_measured]
    return [
        replace(group, declared_offset_m=sum(measured) / len(measured)) if group.conditions.offset_measured else group
        for group in groups
    ]


def _placed(group: Group, state: int, begin_s: float, degc: float, name: str) -> Group:
    def placed(conditions: GroupConditions) -> GroupConditions:
        measured_degc = conditions.temperature_degc
        return replace(
            conditions,
            temperature_degc=measured_degc if math.isfinite(measured_degc) else degc,
            reference_degc=degc,
            time_s=conditions.time_s - begin_s,
        )

    blocks = tuple(replace(block, conditions=placed(block.conditions)) for block in group.blocks)
    conditions = placed(group.conditions)
    return replace(group, state=state, blocks=blocks, conditions=conditions, label=label(name, group.conditions))


def _merged(orders: Sequence[ReadOrder], remarks: Sequence[tuple[_Remark, ...]]) -> tuple[_Remark | Reason, ...]:
    """Return the remarks of all recordings, each once, with its recordings unless it holds for all."""
    recordings: dict[_Remark, list[str]] = {}
    for order, order_remarks in zip(orders, remarks, strict=True):
        for remark in dict.fromkeys(order_remarks):
            recordings.setdefault(remark, []).append(order.name)
    return tuple(
        remark
        if len(names) == len(orders)
        else Reason(DiagnosisCode.OF_RECORDINGS, statement=remark, recordings=tuple(names))
        for remark, names in recordings.items()
    )


def _chosen_wheel(orders: Sequence[ReadOrder], files: Sequence[RecordingRead], wheel: str | None) -> str:
    """Return the position of the wheel: the chosen one, or the only one.

    Raises:
        RecordingError: there is no revolution, none of the chosen wheel, or there are several wheels to choose from.
    """
    wheels = list(dict.fromkeys(name for file in files for name in file.wheels))
    if not wheels:
        raise _no_revolution(orders, files)
    if wheel is None:
        if len(wheels) > 1:
            raise RecordingError(
                f"the recordings are of several wheels: {', '.join(wheels)}", f"Choose one: --wheel {wheels[0]}."
            )
        return wheels[0]
    for order, file in zip(orders, files, strict=True):
        if wheel not in file.wheels:
            raise _wheel_missing(order, file, files, wheel)
    return wheel


def _wheel_missing(order: ReadOrder, file: RecordingRead, files: Sequence[RecordingRead], wheel: str) -> RecordingError:
    common = [name for name in file.wheels if all(name in entry.wheels for entry in files)]
    choices = [f"Choose another wheel: {' or '.join(f'--wheel {name}' for name in common)}."] if common else []
    if any(wheel in entry.wheels for entry in files):
        choices.append("Or leave this recording out." if choices else "Leave this recording out.")
    elif not choices:
        choices.append("Give recordings of one wheel.")
    contained = f"it contains {', '.join(file.wheels)}" if file.wheels else "it contains no wheel"
    message = f"'{order.path}' contains no revolution of wheel {wheel}; {contained}"
    return RecordingError("; ".join((message, *map(notice_text, file.notices))), " ".join(choices))


def _no_revolution(orders: Sequence[ReadOrder], files: Sequence[RecordingRead]) -> RecordingError:
    durations_s = [_samples_s(order.path) for order in orders]
    messages = [
        "; ".join((f"no whole revolution in '{order.path}': {_samples_text(seconds)}", *map(notice_text, file.notices)))
        for order, file, seconds in zip(orders, files, durations_s, strict=True)
    ]
    if not any(durations_s):
        remedy = "`treadlink inspect` shows what was recorded."
    elif max(seconds or 0.0 for seconds in durations_s) < _ONE_TURN_S:
        remedy = "Record longer: half a minute of rolling at a steady speed is enough."
    else:
        remedy = "Did the wheel roll? `treadlink inspect` shows what was recorded."
    return RecordingError("\n".join(messages), remedy)


def _samples_text(seconds: float | None) -> str:
    if seconds is None:
        return "samples, but no hello with their rate"
    return f"{seconds:.1f} s of samples" if seconds else "no sample"


def _samples_s(path: Path) -> float | None:
    """Return the duration of samples of the wheel with the most; None when their rate is unknown."""
    wheels = [wheel for link in inspect_recording(path).links.values() for wheel in link.wheels.values()]
    durations_s = [wheel.samples / wheel.hello.rate_hz for wheel in wheels if wheel.samples and wheel.hello is not None]
    return max(durations_s) if durations_s else None if any(wheel.samples for wheel in wheels) else 0.0
