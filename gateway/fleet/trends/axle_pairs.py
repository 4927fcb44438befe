"""Asymmetry of the wheels of an axle over the recordings that both have."""

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from gateway.core.estimates.estimator import Status
from gateway.core.quantity import Quantity as Declared
from gateway.core.quantity_catalogue import declared
from gateway.core.reasons import Reason
from gateway.core.wheel_position import right_of
from gateway.fleet.reasons import FleetCode
from gateway.fleet.trends.line_numbers import of_unidentified_tire, shared_std
from gateway.fleet.trends.outlier_detection import find_outliers
from gateway.fleet.trends.recording_doubts import doubt_of
from gateway.fleet.trends.regression import LEAST_FREEDOM, weights_of
from gateway.fleet.trends.tire_history import TireHistory
from gateway.fleet.trends.trend_line import date_of, runs_of_outliers
from gateway.fleet.trends.trend_result import PairTrend, TrendNumber, asymmetry_of

_ANGLES: Final = 180.0 / math.pi


def axle_pairs(tires: Sequence[TireHistory]) -> Iterator[PairTrend]:
    """Yield the asymmetry of wheels whose positions differ in left and right only, over common recordings."""
    by_vehicle: dict[str, dict[str, list[TireHistory]]] = defaultdict(lambda: defaultdict(list))
    for tire in tires:
        by_vehicle[tire.vehicle][tire.position].append(tire)
    for vehicle, wheels in by_vehicle.items():
        for left_position in wheels:
            right_position = right_of(left_position)
            if right_position in wheels:
                numbers = tuple(
                    _difference(quantity, wheels[left_position], wheels[right_position])
                    for quantity in declared()
                    if quantity.compared
                )
                if not all(tire.is_identified for side in (left_position, right_position) for tire in wheels[side]):
                    numbers = tuple(map(of_unidentified_tire, numbers))
                yield PairTrend(vehicle, left_position, right_position, numbers)


def _difference(
    compared: Declared, left_tires: Sequence[TireHistory], right_tires: Sequence[TireHistory]
) -> TrendNumber:
    quantity = asymmetry_of(compared)
    first, second = _by_path(left_tires, compared.column), _by_path(right_tires, compared.column)
    times = {
        path: (int(time_ns), path)
        for tire in left_tires
        for path, time_ns in zip(tire.paths, tire.time_ns, strict=True)
    }
    paths = sorted(first.keys() & second.keys(), key=lambda path: times[path])
    differences = np.array([first[path][0] - second[path][0] for path in paths]) * _ANGLES
    stds = np.array([math.hypot(first[path][1], second[path][1]) for path in paths]) * _ANGLES
    if len(paths) < LEAST_FREEDOM + 1:
        reason = Reason(FleetCode.TREND_TOO_FEW, count=len(paths), needed=LEAST_FREEDOM + 1)
        return TrendNumber(quantity, unit="deg", reasons=(reason,))
    design = np.ones((len(paths), 1))
    search = find_outliers(design, differences, weights_of(design, differences, stds), family=1)
    fit = search.fit
    if fit is None:
        return TrendNumber(quantity, unit="deg", reasons=(Reason(FleetCode.TREND_UNDETERMINED),))
    # What all recordings share, such as the roll of a sensor, is part of the stated errors only.
    value, std = float(fit.coefficients[0]), math.hypot(fit.std(0), shared_std(stds))
    doubts = [
        first[path][2] or second[path][2]
        for path, left_out in zip(paths, search.is_outlier, strict=True)
        if not left_out
    ]
    reasons = [doubt] if (doubt := doubt_of(doubts)) is not None else []
    is_outlier = search.is_outlier
    for begin, end in runs_of_outliers(search):
        if end == len(paths):
            reasons.append(Reason(FleetCode.TREND_NEWEST_LEFT, count=end - begin, date=date_of(times[paths[begin]][0])))
    notes = [Reason(FleetCode.TREND_OUTLIERS_LEFT_OUT, count=int(is_outlier.sum()))] if is_outlier.any() else []
    return TrendNumber(
        quantity,
        value,
        std,
        "deg",
        Status.PROVISIONAL if reasons else Status.VALID,
        (*reasons, *notes),
        fit.freedom + 1,
        fit.freedom,
        value - 2.0 * std,
        value + 2.0 * std,
    )


def _by_path(tires: Sequence[TireHistory], name: str) -> dict[str, tuple[float, float, str]]:
    """Return value, standard error and doubt of a quantity by the path of the recording."""
    by_path: dict[str, tuple[float, float, str]] = {}
    for tire in tires:
        values, stds = tire.column(name), tire.column(f"{name}_std")
        doubts = tire.doubts_of(name)
        rows = np.flatnonzero(np.isfinite(values))
        by_path |= {tire.paths[i]: (float(values[i]), float(stds[i]), doubts[i]) for i in rows}
    return by_path
