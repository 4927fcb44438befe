"""Grouping of revolutions by conditions: speed, load, pressure and temperature."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Final

import numpy as np

from gateway.core.types import BoolArray, FloatArray, IntArray
from gateway.diagnosis.data.campaign_data import Group
from gateway.diagnosis.effects.effect import GroupConditions

SPEED_WIDTH: Final = 0.03
LOAD_WIDTH: Final = 0.02
PRESSURE_WIDTH: Final = 0.02
TEMPERATURE_WIDTH_K: Final = 5.0
DRIFT_WIDTH: Final = 0.015
STATE_LOAD_WIDTH: Final = 0.04
# The share of sidewall stiffness due to pressure is unknown, so a state tolerates only a small change of pressure.
STATE_PRESSURE_WIDTH: Final = 0.01
_ANGLE_WIDTH: Final = 0.08
_CONTACT_SPEED_WIDTH: Final = 0.1
# Distance of speeds, as a logarithm, beyond which a further distance adds no information on speed dependence.
_SPEED_DISTANCE_LN: Final = 0.2
# Ratio of speeds, loads or pressures from which recordings can test each other.
_TESTING_RATIO: Final = 1.05
# Difference of temperatures that counts as much as that of speeds.
_TEMPERATURE_SCALE_K: Final = 10.0


def modes(values: FloatArray, width: float) -> IntArray:
    """Return a label for every value so that values of one label lie within `width` of each other.

    The window with the most values is taken first, so that a plateau stays in one piece. NaN values
    share a label of their own.

    Args:
        values: (n,).
        width: greatest less smallest value of one label.

    Returns:
        (n,) labels from 0.
    """
    labels = np.full(len(values), -1, dtype=np.intp)
    finite = np.flatnonzero(np.isfinite(values))
    remaining = finite[np.argsort(values[finite], kind="stable")]
    label = 0
    while len(remaining):
        ordered = values[remaining]
        last = np.searchsorted(ordered, ordered + width, side="right")
        begin = int(np.argmax(last - np.arange(len(remaining))))
        labels[remaining[begin : last[begin]]] = label
        remaining = np.concatenate((remaining[:begin], remaining[last[begin] :]))
        label += 1
    labels[labels < 0] = label
    return labels


def alike(
    omega_radps: FloatArray,
    load_n: FloatArray,
    pressure_pa: FloatArray,
    temperature_degc: FloatArray,
    drift: FloatArray | None = None,
) -> list[IntArray]:
    """Return the row indices of the revolutions of each group; groups and indices are in row order.

    A group's angular speeds lie within 3 %, loads and pressures within 2 %, temperatures within 5 K. With `drift`, the
    change of speed within a revolution over the speed, speeding up and slowing down are kept apart.
    """
    groups = [np.arange(len(omega_radps), dtype=np.intp)]
    for values, width in (
        (np.log(load_n), LOAD_WIDTH),
        (np.log(pressure_pa), PRESSURE_WIDTH),
        (temperature_degc, TEMPERATURE_WIDTH_K),
        (np.zeros_like(omega_radps) if drift is None else drift, DRIFT_WIDTH),
        (np.log(omega_radps), SPEED_WIDTH),
    ):
        groups = [part for group in groups for part in _split(group, modes(values[group], width))]
    return sorted(groups, key=lambda group: float(group.mean()))


def tire_states(
    load_n: FloatArray, pressure_pa: FloatArray, half_angle_rad: FloatArray, load_known: BoolArray
) -> IntArray:
    """Return the tire's state of each group, numbered from 0 in the order of the groups.

    Groups of one state have the same load within 4 % and pressure within 1 %; where the load is not known, the same
    half angle of the contact within 8 % instead.
    """
    loads = modes(np.where(load_known, np.log(load_n), np.nan), STATE_LOAD_WIDTH)
    angles = modes(np.where(load_known, np.nan, np.log(half_angle_rad)), _ANGLE_WIDTH)
    pressures = modes(np.log(pressure_pa), STATE_PRESSURE_WIDTH)
    keys = list(zip(loads.tolist(), angles.tolist(), pressures.tolist(), strict=True))
    numbers = {key: number for number, key in enumerate(dict.fromkeys(keys))}
    return np.array([numbers[key] for key in keys], dtype=np.intp)


def unlike_contacts(state: IntArray, omega_radps: FloatArray, half_angle_rad: FloatArray) -> list[tuple[int, int]]:
    """Return pairs of groups of one state whose contacts contradict it, the shortest and the longest of each state."""
    pairs: dict[int, tuple[int, int]] = {}
    for contact_sets in contact_groups(state, omega_radps, half_angle_rad):
        places = np.concatenate(contact_sets)
        angles = half_angle_rad[places]
        pairs.setdefault(int(state[places[0]]), (int(places[np.argmin(angles)]), int(places[np.argmax(angles)])))
    return list(pairs.values())


def contact_groups(state: IntArray, omega_radps: FloatArray, half_angle_rad: FloatArray) -> Iterator[list[IntArray]]:
    """Yield, where contacts of one state and nearly one speed contradict each other, the indices that agree.

    Groups whose contacts differ by more than 8 % would not be taken for one state if their loads were not stated: a
    load of one of them differs by 12 %, or the tire. Only speeds within a tenth are compared, as edges move with speed.
    """
    for tire_state in np.unique(state).tolist():
        members = np.flatnonzero((state == tire_state) & np.isfinite(half_angle_rad))
        speeds = modes(np.log(omega_radps[members]), _CONTACT_SPEED_WIDTH)
        for speed in np.unique(speeds).tolist():
            same_speed = members[speeds == speed]
            angles = modes(np.log(half_angle_rad[same_speed]), _ANGLE_WIDTH)
            if angles.max() > 0:
                yield [same_speed[angles == label] for label in np.unique(angles).tolist()]


def most_informative(
    recording: IntArray, state: IntArray, omega_radps: FloatArray, count: FloatArray, most: int
) -> IntArray:
    """Return the indices of the `most` most informative groups, ascending; more if there are more recordings.

    The largest group of each recording is included. Groups with many revolutions at a speed far from all others follow.

    Args:
        recording: (n,) of each group.
        state: (n,) of the tire.
        omega_radps: (n,).
        count: (n,) revolutions.
        most: groups.
    """
    selected = [
        int(members[np.argmax(count[members])])
        for members in (np.flatnonzero(recording == number) for number in np.unique(recording))
    ]
    speed = np.log(omega_radps)
    while len(selected) < min(most, len(count)):
        distances = np.abs(speed[:, None] - speed[selected])
        distances[state[:, None] != state[selected]] = np.inf
        score = count * np.minimum(1.0, distances.min(axis=1) / _SPEED_DISTANCE_LN)
        score[selected] = -1.0
        selected.append(int(np.argmax(score)))
    return np.array(sorted(selected), dtype=np.intp)


def far_apart(places: IntArray, conditions: Sequence[GroupConditions], most: int) -> IntArray:
    """Return at most `most` of these indices, ascending: those whose conditions are farthest apart from each other.

    Args:
        places: (n,) indices of `conditions`.
        conditions: of every group.
        most: indices to keep.
    """
    if len(places) <= most:
        return places
    candidates = [conditions[index] for index in places.tolist()]
    log_conditions = (
        np.log([[condition.omega_radps, condition.load_n, condition.pressure_pa] for condition in candidates])
        / _SPEED_DISTANCE_LN
    )
    temperature = np.nan_to_num([condition.temperature_degc for condition in candidates]) / _TEMPERATURE_SCALE_K
    features = np.column_stack((log_conditions, temperature, [float(condition.reverse) for condition in candidates]))
    selected = [0]
    while len(selected) < most:
        distances = np.abs(features[:, None] - features[selected]).sum(axis=2).min(axis=1)
        distances[selected] = -1.0
        selected.append(int(np.argmax(distances)))
    return np.sort(places[selected])


def folded(count: int, folds: int) -> list[slice]:
    """Return consecutive stretches of `count` revolutions: `folds` of them, or one each where they are few."""
    if count < 2 * folds:
        return [slice(index, index + 1) for index in range(count)]
    edges = np.linspace(0, count, folds + 1).round().astype(int).tolist()
    return [slice(low, high) for low, high in pairwise(edges)]


def _split(group: IntArray, labels: IntArray) -> list[IntArray]:
    return [group[labels == label] for label in np.unique(labels)]


def has_other_conditions(groups: Sequence[Group], recording: int) -> bool:
    """Return whether a recording has a speed, load or pressure that no other one has."""

    def differ(first: float, second: float) -> bool:
        return max(first, second) > _TESTING_RATIO * min(first, second)

    of_recording = [group.conditions for group in groups if group.recording == recording]
    references = [group.conditions for group in groups if group.recording != recording]
    return bool(references) and any(
        all(
            differ(condition.omega_radps, reference.omega_radps)
            or differ(condition.load_n, reference.load_n)
            or differ(condition.pressure_pa, reference.pressure_pa)
            for reference in references
        )
        for condition in of_recording
    )
