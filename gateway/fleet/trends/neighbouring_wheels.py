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
_COMPARED: Final = 0.9
_MAD_TO_STD: Final = 1.4826
# Change of one wheel against the others, in scatters, that is its own; of most of the wheels, that is a refill of all.
_OWN: Final = 5.0
_LEAST_SCATTER_KPA: Final = 0.3
# Recordings by which a refill is told from a rise that goes back.
_HELD: Final = 7
# What is common is left in only where taking it out adds more scatter than this: refills of wheels, not weather.
_REDUCED: Final = 1.05
# Recordings by which those are apart that weather makes different.
_LAGS: Final = (1, 3, 6)


class Shared(NamedTuple):
    """What a wheel's pressure has in common with the others'.

    Attributes:
        cold_kpa: (n,) pressures without it.
        has_trend: whether the trend of the others is taken out too.
    """

    cold_kpa: FloatArray
    has_trend: bool = False


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
            others = [other for other in numbers if other != number and stuck[other] == stuck[number]]
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
    paths, own = histories[number].paths, cold_kpa[number]
    measured = np.flatnonzero(np.isfinite(own))
    rows, known = [], np.zeros(len(measured), dtype=int)
    for other in others:
        by_path = dict(zip(histories[other].paths, cold_kpa[other].tolist(), strict=True))
        row = np.array([by_path.get(paths[index], np.nan) for index in measured.tolist()])
        has_value = np.isfinite(row)
        if has_value.sum() < max(_LEAST_RECORDINGS, _COMPARED * len(measured)):
            continue
        # Now and then a wheel sends nothing: the others have a median without it.
        rows.append(np.interp(measured, measured[has_value], row[has_value]))
        known += has_value
    enough = known >= _LEAST_OTHERS
    if len(rows) < _LEAST_OTHERS or enough.sum() < _COMPARED * len(measured) or not enough[-1]:
        return None
    usable = measured[enough]
    values = np.stack(rows)[:, enough]
    changes = np.diff(values, axis=1)
    middle = np.median(np.vstack([changes, np.diff(own[usable])]), axis=0)
    apart = changes - middle
    scatter = max(_MAD_TO_STD * float(np.median(np.abs(apart))), _LEAST_SCATTER_KPA)
    of_all = max(_MAD_TO_STD * float(np.median(np.abs(middle - np.median(middle)))), _LEAST_SCATTER_KPA)
    alone = np.where(np.abs(apart) > _OWN * scatter, apart, 0.0)
    # Without temperatures a refill of all wheels is each one's own; a rise that goes back, as in mountains, is common.
    level = np.concatenate([[0.0], np.cumsum(middle)])
    for change in np.flatnonzero((middle > _OWN * max(of_all, scatter)) & stuck[number]).tolist():
        before, after = level[max(change + 1 - _HELD, 0) : change + 1], level[change + 1 : change + 1 + _HELD]
        if float(np.median(after) - np.median(before)) > 0.5 * float(middle[change]):
            alone[:, change] = changes[:, change]
    values -= np.concatenate([np.zeros((len(values), 1)), np.cumsum(alone, axis=1)], axis=1)
    values -= np.median(values, axis=1, keepdims=True)
    common = np.full(len(paths), np.nan)
    common[usable] = np.median(values, axis=0)
    return common


def _reduced(cold_kpa: FloatArray, common: FloatArray, is_stuck: bool) -> Shared:
    """Return pressures without what is common where that scatters less."""
    usable = np.flatnonzero(np.isfinite(common))
    part = common[usable]
    if not is_stuck:
        part = part - _lasting(part)
    if not _wander(cold_kpa[usable] - part) < _REDUCED * _wander(cold_kpa[usable]):
        return Shared(cold_kpa)
    reduced = np.full(len(cold_kpa), np.nan)
    reduced[usable] = cold_kpa[usable] - part + float(part[-1]) * is_stuck
    return Shared(reduced, is_stuck)


def _lasting(values: FloatArray) -> FloatArray:
    """Return the running median, which keeps the edges of refills."""
    padded = np.pad(values, _HELD, constant_values=math.nan)
    return np.asarray(np.nanmedian(np.lib.stride_tricks.sliding_window_view(padded, 2 * _HELD + 1), axis=1))


def _wander(values: FloatArray) -> float:
    """Return how far values differ from others that are some recordings apart; refills are few."""
    changes = [values[lag:] - values[:-lag] for lag in _LAGS]
    return float(sum(np.median(np.abs(change - np.median(change))) for change in changes))
