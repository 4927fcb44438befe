"""What the pressures of a vehicle's wheels have in common: weather, altitude, a temperature that no sensor measures.

All wheels of a vehicle are warmed and cooled alike, and gauges measure against one ambient pressure. Of every
recording the change since the one before is compared between the wheels; what one wheel alone does, as a refill, is
taken out, and the median of the others is what they have in common. A leak of the wheel itself is no part of it. Where
temperatures are measured only the ambient pressure remains, which comes and goes: what lasts is each wheel's own.
"""

import math
from collections import defaultdict
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from gateway.core.types import FloatArray
from gateway.fleet.trends.tire_history import TireHistory

# Wheels besides the one that is compared: of two, a leak of one would be half of what they have in common.
_LEAST_OTHERS: Final = 2
_LEAST_RECORDINGS: Final = 8
# Share of the recordings of a wheel that the others must have too.
_COMMON_SHARE: Final = 0.9
_MAD_TO_STD: Final = 1.4826
# Change of one wheel against the others, in scatters, that is its own; of most of the wheels, that is a refill of all.
_OUTLIER_SCATTERS: Final = 5.0
_LEAST_SCATTER_KPA: Final = 0.3
# Recordings by which a refill is told from a rise that goes back.
_WINDOW: Final = 7
# What is common is left in only where taking it out adds more scatter than this: refills of wheels, not weather.
_MOST_SCATTER_RATIO: Final = 1.05
# Recordings by which those are apart that weather makes different.
_LAGS: Final = (1, 3, 6)


class Shared(NamedTuple):
    """What a wheel's pressure has in common with the others'.

    Attributes:
        cold_kpa: (n,) pressures without it.
        has_trend: whether the trend of the others is taken out too.
        removed_kpa: standard deviation of what is taken out.
    """

    cold_kpa: FloatArray
    has_trend: bool = False
    removed_kpa: float = 0.0


def without_common(
    histories: Sequence[TireHistory], cold_kpa: Sequence[FloatArray], stuck: Sequence[bool]
) -> list[Shared]:
    """Return the pressures of tires without what the wheels of their vehicles have in common.

    Args:
        histories: of the tires.
        cold_kpa: (n,) gauge pressure at one temperature of each, NaN where unknown.
        stuck: whether a tire's temperature is not measured; the trend of the others is then taken out too.
    """
    by_vehicle: dict[str, list[int]] = defaultdict(list)
    for number, history in enumerate(histories):
        by_vehicle[history.vehicle].append(number)
    results = [Shared(cold) for cold in cold_kpa]
    for numbers in by_vehicle.values():
        if len(numbers) <= _LEAST_OTHERS:
            continue
        for number in numbers:
            others = [wheel for wheel in numbers if wheel != number and stuck[wheel] == stuck[number]]
            if histories[number].is_identified:
                common = _common(histories, cold_kpa, stuck, number, others)
                if common is not None:
                    results[number] = _reduced(cold_kpa[number], common, stuck[number])
    return results


def _common(
    histories: Sequence[TireHistory],
    cold_kpa: Sequence[FloatArray],
    stuck: Sequence[bool],
    number: int,
    others: Sequence[int],
) -> FloatArray | None:
    """Return (n,) what the other wheels have in common at the recordings of one, NaN where it is not known."""
    paths, wheel_kpa = histories[number].paths, cold_kpa[number]
    measured = np.flatnonzero(np.isfinite(wheel_kpa))
    rows, value_counts = [], np.zeros(len(measured), dtype=int)
    for wheel in others:
        by_path = dict(zip(histories[wheel].paths, cold_kpa[wheel].tolist(), strict=True))
        row = np.array([by_path.get(paths[index], np.nan) for index in measured.tolist()])
        has_value = np.isfinite(row)
        if has_value.sum() < max(_LEAST_RECORDINGS, _COMMON_SHARE * len(measured)):
            continue
        # Now and then a wheel sends nothing: the others have a median without it.
        rows.append(np.interp(measured, measured[has_value], row[has_value]))
        value_counts += has_value
    is_known = value_counts >= _LEAST_OTHERS
    if len(rows) < _LEAST_OTHERS or is_known.sum() < _COMMON_SHARE * len(measured) or not is_known[-1]:
        return None
    usable = measured[is_known]
    values = np.stack(rows)[:, is_known]
    changes = np.diff(values, axis=1)
    medians = np.median(np.vstack([changes, np.diff(wheel_kpa[usable])]), axis=0)
    deviations = changes - medians
    scatter = max(_MAD_TO_STD * float(np.median(np.abs(deviations))), _LEAST_SCATTER_KPA)
    median_scatter = max(_MAD_TO_STD * float(np.median(np.abs(medians - np.median(medians)))), _LEAST_SCATTER_KPA)
    own_changes = np.where(np.abs(deviations) > _OUTLIER_SCATTERS * scatter, deviations, 0.0)
    # Without temperatures a refill of all wheels is each one's own; a rise that goes back, as in mountains, is common.
    if stuck[number]:
        level = np.concatenate([[0.0], np.cumsum(medians)])
        for rise in _lasting_rises(level, _OUTLIER_SCATTERS * max(median_scatter, scatter)):
            own_changes[:, rise - 1] = changes[:, rise - 1]
    values -= np.concatenate([np.zeros((len(values), 1)), np.cumsum(own_changes, axis=1)], axis=1)
    values -= np.median(values, axis=1, keepdims=True)
    common = np.full(len(paths), np.nan)
    common[usable] = np.median(values, axis=0)
    return common


def _reduced(cold_kpa: FloatArray, common: FloatArray, is_stuck: bool) -> Shared:
    """Return pressures without what is common where that scatters less."""
    usable = np.flatnonzero(np.isfinite(common))
    part = common[usable]
    if not is_stuck:
        part = part - _running_median(part)
    if not _lag_scatter(cold_kpa[usable] - part) < _MOST_SCATTER_RATIO * _lag_scatter(cold_kpa[usable]):
        return Shared(cold_kpa)
    reduced = np.full(len(cold_kpa), np.nan)
    reduced[usable] = cold_kpa[usable] - part + float(part[-1]) * is_stuck
    return Shared(reduced, is_stuck, float(part.std()))


def _lasting_rises(values: FloatArray, threshold: float) -> list[int]:
    """Return the indices after rises above a threshold that do not go back, as at refills."""
    changes = np.diff(values)
    return [
        index
        for index in (np.flatnonzero(changes > threshold) + 1).tolist()
        if np.median(values[index : index + _WINDOW]) - np.median(values[max(index - _WINDOW, 0) : index])
        > 0.5 * changes[index - 1]
    ]


def _running_median(values: FloatArray) -> FloatArray:
    """Return the running median before and after each refill.

    Across one it would be the highest of the values before and the lowest of those after: the rest would be a ramp.
    """
    changes = np.diff(values)
    scatter = max(_MAD_TO_STD * float(np.median(np.abs(changes - np.median(changes)))), _LEAST_SCATTER_KPA)
    refills = _lasting_rises(values, _OUTLIER_SCATTERS * scatter)
    return np.concatenate([_median_of_part(part) for part in np.split(values, refills)])


def _median_of_part(values: FloatArray) -> FloatArray:
    padded = np.pad(values, _WINDOW, constant_values=math.nan)
    return np.asarray(np.nanmedian(np.lib.stride_tricks.sliding_window_view(padded, 2 * _WINDOW + 1), axis=1))


def _lag_scatter(values: FloatArray) -> float:
    """Return how far values differ from others that are some recordings apart; refills are few."""
    changes = [values[lag:] - values[:-lag] for lag in _LAGS]
    return float(sum(np.median(np.abs(change - np.median(change))) for change in changes))
