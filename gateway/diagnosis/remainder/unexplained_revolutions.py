"""Unexplained signals of single revolutions: scatter at one angle, alternation of turns, repeated samples."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.core.constants import AXIS_NAMES
from gateway.core.types import BoolArray, FloatArray, IntArray
from gateway.diagnosis import criteria
from gateway.diagnosis.data.campaign_data import Group
from gateway.diagnosis.effects.contact import EDGE_REACH_RAD
from gateway.diagnosis.remainder.statistics import held_scaling, rare_ratio, scaling_of
from gateway.diagnosis.result import Scaling, Unexplained

PLACE: Final = "place"
TURNS: Final = "turns"
SAMPLES: Final = "samples"
"""Locks of an unexplained signal: one angle with a new waveform each turn, every second turn, data faults."""

# Places listed, and cells by which one may differ between groups.
_MAX_PLACES: Final = 4
_CELL_TOLERANCE: Final = 1
# Independent values in the mean square of successive differences, per value: each is part of two of them.
_SUCCESSIVE: Final = 2.0 / 3.0
# Angles of a cell at which a waveform's rate is worked out.
_ANGLES_PER_CELL: Final = 8


@dataclass(frozen=True, slots=True)
class _Profiles:
    """Power above that of the median cell, by group, axis and cell of angle.

    Attributes:
        power: (g, 3, cells) (m/s^2)^2; 0 where it is not known.
        std: (g, 3, cells) one standard error.
        over: (g, 3, cells) power over that of the median cell, less 1; what a place was listed for is set to 0.
        freedom: (g, 3) independent complex values of a cell; 0 where it is not known.
    """

    power: FloatArray
    std: FloatArray
    over: FloatArray
    freedom: FloatArray

    def ordered(self, mirrored: Sequence[bool]) -> _Profiles:
        """Return the profiles with the angles of some groups mirrored; `over` is a copy."""
        flip: BoolArray = np.array(mirrored)[:, None, None]
        flipped = [np.where(flip, values[..., ::-1], values) for values in (self.power, self.std, self.over)]
        return _Profiles(flipped[0], flipped[1], flipped[2], self.freedom)


def unexplained_revolutions(groups: Sequence[Group]) -> tuple[Unexplained, ...]:
    """Return what single revolutions contain beyond even noise, and samples that repeat, largest first."""
    entries = [*_repeated(groups)]
    if any(group.by_angle is not None for group in groups):
        for lock in (PLACE, TURNS):
            entries += _places(groups, lock)
    return tuple(sorted(entries, key=lambda entry: -entry.rms_mps2))


def _places(groups: Sequence[Group], lock: str) -> list[Unexplained]:
    """Return the places with more scatter than elsewhere, on a single axis of a group or on all together."""
    profiles = _profiles(groups, lock)
    # What is fixed to the contact comes at the same angle in reverse, what is fixed to the wheel at the opposite one.
    reverse = [group.conditions.reverse for group in groups]
    mirrorings = [[False] * len(groups), *([reverse] if len(set(reverse)) > 1 else [])]
    entries: list[Unexplained] = []
    while len(entries) < _MAX_PLACES:
        mirrored = max(mirrorings, key=lambda mirroring: _largest_excess(profiles.ordered(mirroring))[0])
        ordered = profiles.ordered(mirrored)
        excess, members = _largest_excess(ordered)
        if not excess > 1.0:
            break
        cells = _exceeding_cells(ordered, members)
        entries.append(_entry(groups, lock, ordered, cells, mirrored, members))
        count = profiles.over.shape[-1]
        cleared_cells = np.arange(cells[0] - _CELL_TOLERANCE, cells[0] + len(cells) + _CELL_TOLERANCE) % count
        for group, is_mirrored in enumerate(mirrored):
            profiles.over[group][:, count - 1 - cleared_cells if is_mirrored else cleared_cells] = 0.0
    return entries


def _profiles(groups: Sequence[Group], lock: str) -> _Profiles:
    count = next(group.by_angle.power_m2ps4.shape[1] for group in groups if group.by_angle is not None)
    power = np.zeros((len(groups), 3, count))
    std, excess_ratio, freedom = np.zeros_like(power), np.zeros_like(power), np.zeros((len(groups), 3))
    angle = _angles(count)
    for number, group in enumerate(groups):
        scatter = group.by_angle
        if scatter is None:
            continue
        edge = np.abs(angle) < group.half_angle_rad + EDGE_REACH_RAD
        # Moving the contact edges back leaves a share of their scatter.
        allowed = np.where(edge, criteria.EDGE_SHAPE * group.edges.explained_m2ps4 / max(float(edge.mean()), 1e-9), 0.0)
        for axis in np.flatnonzero(scatter.freedom).tolist():
            is_valid = ~scatter.at_limit[axis]
            values = scatter.power_m2ps4[axis]
            if lock == PLACE:
                # A step or drift of load or gain leaves neighbouring turns alike: a change during the recording.
                is_drifting = scatter.successive_m2ps4[axis] < criteria.TURNS_ALIKE * values
                values = np.minimum(values, scatter.successive_m2ps4[axis])
                # What jitters there comes with the change: the mean suits no turn.
                is_valid = is_valid & ~is_drifting
                if not is_valid.any():
                    continue
            level = float(np.median(values[is_valid]))
            if not level > 0.0:
                continue
            freedom[number, axis] = float(scatter.freedom[axis])
            if lock == PLACE:
                freedom[number, axis] *= _SUCCESSIVE * scatter.count
                # A coarse converter scatters by up to half a step, and not at all where the signal stays.
                converter_power = 0.25 * group.step_mps2[axis] ** 2
                excess_ratio[number, axis] = (values - max(level, converter_power) - allowed) / level
                power[number, axis] = values - level
                std[number, axis] = np.maximum(values, level) / math.sqrt(freedom[number, axis])
            else:
                # Turns that differ at random differ in odd and even ones too.
                chance, values = np.maximum(values, level), scatter.alternating_m2ps4[axis]
                excess_ratio[number, axis] = (values - chance) / chance
                power[number, axis] = (values - chance) / scatter.count
                std[number, axis] = np.maximum(values, chance) / (scatter.count * math.sqrt(freedom[number, axis]))
            for profile in (power, excess_ratio):
                profile[number, axis, ~is_valid] = 0.0
    return _Profiles(power, std, excess_ratio, freedom)


def _largest_excess(profiles: _Profiles) -> tuple[float, FloatArray]:
    """Return the largest excess over what noise exceeds as rarely as `criteria.RARE`, and weights (g, 3) of it."""
    max_ratio, chosen_weight = 0.0, profiles.freedom
    if not profiles.freedom.any():  # nothing scatters
        return max_ratio, chosen_weight
    single_axis_masks = [
        np.where(np.arange(profiles.freedom.size).reshape(profiles.freedom.shape) == index, 1.0, 0.0)
        for index in np.flatnonzero(profiles.freedom)
    ]
    for mask in (np.ones_like(profiles.freedom), *single_axis_masks):
        weight = mask * profiles.freedom
        limit = rare_ratio(float(weight.sum()), criteria.RARE) - 1.0
        largest = float(_mean(profiles.over, weight).max()) / limit
        if largest > max_ratio:
            max_ratio, chosen_weight = largest, weight
    return max_ratio, chosen_weight


def _mean(values: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the mean (cells,) of values (g, 3, cells) by weight (g, 3)."""
    result: FloatArray = np.tensordot(weight, values, axes=2) / max(float(weight.sum()), 1e-30)
    return result


def _exceeding_cells(profiles: _Profiles, weight: FloatArray) -> IntArray:
    """Return the cells around the highest one that exceed noise, (k,), in order of angle; they may pass +-pi."""
    excess = _mean(profiles.over, weight)
    count = len(excess)
    is_high: BoolArray = excess > criteria.SIGMAS_LISTED / math.sqrt(float(weight.sum()))
    peak = int(np.argmax(excess))
    first = last = peak
    while peak - first < count // 4 and is_high[(first - 1) % count]:
        first -= 1
    while last - peak < count // 4 and is_high[(last + 1) % count]:
        last += 1
    return np.arange(first, last + 1)


def _entry(
    groups: Sequence[Group],
    lock: str,
    profiles: _Profiles,
    cells: IntArray,
    mirrored: Sequence[bool],
    weight: FloatArray,
) -> Unexplained:
    """Return the entry of a place: on the axis where it is largest, in the group where it is clearest."""
    count = profiles.power.shape[-1]
    part = cells % count
    square = profiles.power[..., part].sum(axis=-1) / count
    error = np.sqrt(np.square(profiles.std[..., part]).sum(axis=-1)) / count
    significance = np.where(weight > 0.0, square / np.maximum(error, 1e-30), -math.inf)
    largest = int(np.unravel_index(np.argmax(significance), significance.shape)[0])
    rms = np.sqrt(np.maximum(square, 0.0))
    std = 0.5 * error / np.maximum(np.maximum(rms, np.sqrt(error)), 1e-30)
    axis = int(np.argmax(np.where(profiles.freedom[largest] > 0.0, square[largest], -math.inf)))
    is_measured = profiles.freedom[:, axis] > 0.0
    sizes = [
        (number, float(rms[number, axis]), float(std[number, axis])) for number in np.flatnonzero(is_measured).tolist()
    ]
    others = tuple(
        (AXIS_NAMES[other_axis], float(rms[largest, other_axis]))
        for other_axis in range(3)
        if other_axis != axis and square[largest, other_axis] > criteria.SIGMAS_LISTED * error[largest, other_axis]
    )
    width = 2.0 * math.pi / count
    first = -math.pi + width * float(cells[0])
    angles_rad = (first, first + width * len(cells))
    if mirrored[largest]:
        angles_rad = (-angles_rad[1], -angles_rad[0])
    return Unexplained(
        AXIS_NAMES[axis],
        lock,
        None,
        None,
        angles_rad,
        _scaling(groups, sizes),
        float(rms[largest, axis]),
        float(std[largest, axis]),
        other_axes=others,
        largest_in=groups[largest].label,
        timing_s=_timing_s(groups[largest], profiles, largest, part, mirrored[largest]) if lock == PLACE else math.nan,
    )


def _timing_s(group: Group, profiles: _Profiles, number: int, cells: IntArray, mirrored: bool) -> float:
    """Return the timing noise that makes the scatter of a place, rms; NaN where another cause does.

    Samples that come late by tau read tau times the waveform's rate, so that tau^2 is the power over the square of the
    rate at every angle and on every axis. It is fitted to all of them: what scatters at one steep place and not at the
    others is no timing noise.

    Args:
        group: with the place.
        profiles: of all groups.
        number: of the group.
        cells: of the place.
        mirrored: whether the group's angles are mirrored in the profiles.
    """
    count = profiles.power.shape[-1]
    weight = group.counts
    mean = np.tensordot(weight / weight.sum(), np.nan_to_num([block.orders_mps2 for block in group.blocks]), axes=1)
    angles = _angles(_ANGLES_PER_CELL * count).reshape(count, _ANGLES_PER_CELL)
    orders = np.arange(mean.shape[-1])
    slope = np.einsum("an,ncf->acf", 1j * orders * mean, np.exp(1j * orders[:, None, None] * angles)).real
    square = np.square(group.conditions.omega_radps * slope).mean(axis=-1)
    if mirrored:
        square = square[:, ::-1]
    measured = (profiles.freedom[number] > 0.0)[:, None] & (profiles.std[number] > 0.0)
    precision = np.where(measured, 1.0 / np.square(np.where(measured, profiles.std[number], 1.0)), 0.0)
    power = profiles.power[number]
    denominator = float((precision * np.square(square)).sum())
    tau_square = float((precision * square * power).sum()) / denominator if denominator > 0.0 else 0.0
    if not tau_square > 0.0:
        return math.nan
    measured_cells = measured[:, cells]
    misfit = float(np.abs((power - tau_square * square)[:, cells][measured_cells]).sum())
    is_timing = misfit < criteria.EDGE_SHAPE * float(np.abs(power[:, cells][measured_cells]).sum())
    return math.sqrt(tau_square) if is_timing else math.nan


def _angles(count: int) -> FloatArray:
    return -math.pi + 2.0 * math.pi * (np.arange(count) + 0.5) / count


def _scaling(groups: Sequence[Group], sizes: Sequence[tuple[int, float, float]]) -> Scaling:
    speeds = [group.conditions.omega_radps * group.conditions.radius_m for group in groups]
    significant = [(speeds[index], rms, std) for index, rms, std in sizes if rms > criteria.SIGMAS_LISTED * std]
    exponent, exponent_std = held_scaling(
        [speed for speed, _, _ in significant], [rms for _, rms, _ in significant], [std for _, _, std in significant]
    )
    return scaling_of(exponent, exponent_std, several=max(speeds) > criteria.SPEEDS_APART * min(speeds))


def _repeated(groups: Sequence[Group]) -> list[Unexplained]:
    """Return the error by repeated samples, at its axis of the largest, in the recording where it is largest."""
    first = {group.recording: index for index, group in reversed(list(enumerate(groups)))}
    sizes = [
        (index, max(repeats.error_mps2), max(repeats.error_mps2) / math.sqrt(repeats.runs))
        for index in sorted(first.values())
        if (repeats := groups[index].repeats) is not None
    ]
    if not sizes:
        return []
    largest, rms, std = max(sizes, key=lambda size: size[1])
    repeats = groups[largest].repeats
    errors = repeats.error_mps2 if repeats is not None else (0.0, 0.0, 0.0)
    axis = int(np.argmax(errors))
    others = tuple((AXIS_NAMES[index], errors[index]) for index in range(3) if index != axis and errors[index] > 0.0)
    return [
        Unexplained(
            AXIS_NAMES[axis],
            SAMPLES,
            None,
            None,
            None,
            _scaling(groups, sizes),
            rms,
            std,
            other_axes=others,
            largest_in=groups[largest].label,
        )
    ]
