"""Rows of the table of recordings: one wheel of one recording, accumulated revolution by revolution."""

import json
import math
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import asdict
from typing import Final

from gateway.core.estimates.estimator import Estimate, Status, TireConditions
from gateway.core.estimates.results import RevolutionResult, WheelSnapshot
from gateway.core.estimates.weighted_mean import MeanEstimate, WeightedMean, mean_estimate
from gateway.core.quantity_catalogue import quantity_of
from gateway.core.reasons import CoreCode, Reason
from gateway.core.table_columns import RECORDING_HEAD, RECORDING_PARTS, RECORDING_TAIL
from gateway.core.text.numbers import RENAMED, distinct_name
from gateway.core.text.table_sinks import Cell
from gateway.core.text.wording import as_json, joined

_RESERVED_NAMES: Final = frozenset((*RECORDING_HEAD, *RECORDING_TAIL))
# Share of the revolutions that are valid where a row is.
_LEAST_VALID_SHARE: Final = 0.5


class _Quantity:
    """One estimate over a recording; the mean is that of the valid values, of provisional ones where there is none."""

    def __init__(self, *, is_steady: bool = False) -> None:
        """Start without values.

        Args:
            is_steady: whether no drive changes it, so that values of one recording differ by their errors only.
        """
        self._is_steady = is_steady
        self._means = {Status.VALID: WeightedMean(), Status.PROVISIONAL: WeightedMean()}
        self._reasons: dict[Status, tuple[Reason, ...]] = {}
        # Revolutions since the first with a value: an estimator that has just begun has none.
        self._revolutions = 0
        self._doubts: Counter[tuple[object, ...]] = Counter()
        self._doubt_by_kind: dict[tuple[object, ...], Reason] = {}

    def add(self, estimate: Estimate) -> None:
        self._reasons[estimate.status] = estimate.reasons
        has_value = estimate.status is not Status.INVALID and math.isfinite(estimate.value)
        if has_value:
            self._means[estimate.status].add(estimate.value, estimate.std, estimate.scatter_std)
        elif not self._revolutions:
            return
        self._revolutions += 1
        if estimate.status is not Status.VALID and estimate.reasons:
            doubt = estimate.reasons[0]
            self._doubts[doubt.kind] += 1
            self._doubt_by_kind[doubt.kind] = doubt

    @property
    def valid(self) -> WeightedMean:
        """Mean of the valid values."""
        return self._means[Status.VALID]

    def cells(self) -> tuple[Cell, ...]:
        """Return the cells in the order of RECORDING_PARTS."""
        for status, mean in self._means.items():
            if mean.count:
                return self._mean_cells(status, mean)
        return None, None, None, 0, str(Status.INVALID), joined(self._reasons.get(Status.INVALID, ()))

    def _mean_cells(self, status: Status, mean: WeightedMean) -> tuple[Cell, ...]:
        reasons = self._reasons[status]
        doubts: list[Reason] = []
        if status is Status.VALID and mean.count < _LEAST_VALID_SHARE * self._revolutions:
            doubts.append(Reason(CoreCode.ROW_FEW_VALID, count=mean.count, of=self._revolutions))
            doubts += [self._doubt_by_kind[kind] for kind, _ in self._doubts.most_common(1)]
        status = Status.PROVISIONAL if doubts or (self._is_steady and mean.varies) else status
        reasons = (*doubts, *mean.reasons, *reasons)
        return mean.value, mean.std, mean.scatter, mean.count, str(status), joined(reasons)


class WheelRow:
    """The row of one wheel of one recording."""

    def __init__(self) -> None:
        self._revolutions = self._valid = self._saturated = 0
        self._distance_m = self._rolling_s = self._missing_s = 0.0
        self._speed_mps = (math.inf, -math.inf)
        self._load, self._pressure = WeightedMean(), WeightedMean()
        self._temperature, self._noise = WeightedMean(), WeightedMean()
        self._temperatures = (math.inf, -math.inf)
        self._faults: Counter[Reason] = Counter()
        self._estimates: dict[str, _Quantity] = {}
        self._last: RevolutionResult | None = None

    def add(self, result: RevolutionResult) -> None:
        """Take one revolution."""
        revolution, conditions = result.revolution, result.conditions
        self._last = result
        self._revolutions += 1
        self._saturated += bool(revolution.saturated)
        self._distance_m += 2.0 * math.pi * conditions.radius_m * revolution.turns
        self._rolling_s += revolution.period_s
        self._missing_s += revolution.missing_fraction * revolution.period_s
        self._speed_mps = _extended(self._speed_mps, revolution.omega_radps * conditions.radius_m)
        self._faults.update(revolution.faults)
        if not revolution.faults:
            self._valid += 1
            if math.isfinite(revolution.noise_mps2):
                self._noise.add(revolution.noise_mps2, math.nan)
        if conditions.load_n is not None:
            self._load.add(conditions.load_n, conditions.load_std_n)
        if conditions.pressure_pa is not None:
            self._pressure.add(conditions.pressure_pa, conditions.pressure_std_pa)
        if conditions.temperature_degc is not None and math.isfinite(conditions.temperature_degc):
            self._temperature.add(conditions.temperature_degc, math.nan)
            self._temperatures = _extended(self._temperatures, conditions.temperature_degc)
        for estimate in result.estimates:
            name = distinct_name(estimate.name, _RESERVED_NAMES)
            quantity = self._estimates.get(name)
            if quantity is None:
                quantity = self._estimates[name] = _Quantity(is_steady=quantity_of(name).is_steady)
            quantity.add(estimate)

    def cells(self, wheel: WheelSnapshot | None, estimates: Sequence[str]) -> dict[str, Cell]:
        """Return the cells that revolutions and the last state of the wheel decide.

        Args:
            wheel: its last state, None when it is not known.
            estimates: names of the dataset's columns; others go into `other_estimates`.
        """
        has_rolled, conditions = self._rolling_s > 0.0, self._last.conditions if self._last is not None else None
        cells: dict[str, Cell] = {
            "revolutions": self._revolutions,
            "revolutions_valid": self._valid,
            "revolutions_saturated": self._saturated,
            "distance_m": self._distance_m,
            "rolling_s": self._rolling_s,
            "speed_mean_mps": self._distance_m / self._rolling_s if has_rolled else None,
            "speed_min_mps": self._speed_mps[0] if has_rolled else None,
            "speed_max_mps": self._speed_mps[1] if has_rolled else None,
            "load_n": self._load.value,
            "load_std_n": self._load.std,
            "pressure_pa": self._pressure.value,
            "pressure_std_pa": self._pressure.std,
            "temperature_degc": self._temperature.value,
            "temperature_min_degc": self._temperatures[0] if self._temperature.count else None,
            "temperature_max_degc": self._temperatures[1] if self._temperature.count else None,
            "radius_m": conditions.radius_m if conditions is not None else None,
            "mounting_offset_m": conditions.sensor_offset_m if conditions is not None else None,
            "mounting_offset_std_m": conditions.sensor_offset_std_m if conditions is not None else None,
            **self._tire_fields(),
            "noise_mps2": self._noise.value,
            "missing_fraction": self._missing_s / self._rolling_s if has_rolled else None,
            "faults": json_cell([{**as_json(fault), "count": n} for fault, n in self._faults.most_common()]),
        }
        if wheel is not None:
            cells |= self._samples(wheel)
        return cells | self._estimate_cells(estimates)

    def _samples(self, wheel: WheelSnapshot) -> dict[str, Cell]:
        """Return the samples of a wheel, and why it has no revolution where it has none."""
        counters = wheel.counters
        cells: dict[str, Cell] = {
            "rate_hz": wheel.rate_hz or None,
            "samples": counters.samples,
            "samples_lost": counters.samples_lost,
            "samples_saturated": counters.samples_saturated,
        }
        if self._last is None and wheel.missing is not None:
            cells["missing"] = json.dumps(as_json(wheel.missing), ensure_ascii=False)
        return cells

    def _estimate_cells(self, estimates: Sequence[str]) -> dict[str, Cell]:
        """Return the cells of estimates that have columns, and the others in one cell."""
        cells: dict[str, Cell] = {}
        for name in estimates:
            collected = self._estimates.get(name)
            if collected is not None:
                cells |= dict(zip((name + part for part in RECORDING_PARTS), collected.cells(), strict=True))
        others = {
            name: dict(zip((part or "value" for part in RECORDING_PARTS), collected.cells(), strict=True))
            for name, collected in self._estimates.items()
            if name not in estimates
        }
        cells["other_estimates"] = json.dumps(others, ensure_ascii=False, allow_nan=False) if others else None
        return cells

    def quantities(self) -> Iterator[tuple[str, tuple[Cell, ...]]]:
        """Yield the name of each estimate, and its cells in the order of RECORDING_PARTS."""
        for name, collected in self._estimates.items():
            yield name.removeprefix(RENAMED), collected.cells()

    def means(self) -> dict[str, MeanEstimate]:
        """Return the means over the valid revolutions by quantity, with their uncertainty."""
        named = {name.removeprefix(RENAMED): collected.valid for name, collected in self._estimates.items()}
        return {
            name: mean_estimate(mean, quantity_of(name).correlated_revolutions)
            for name, mean in named.items()
            if mean.count
        }

    @property
    def conditions(self) -> TireConditions | None:
        """Of the last revolution, None without one."""
        return None if self._last is None else self._last.conditions

    def _tire_fields(self) -> dict[str, Cell]:
        """Return what the configuration states of the tire, and when the hub's clock was zero."""
        if self._last is None:
            return {}
        tire, revolution = self._last.conditions.tire, self._last.revolution
        calibration = tire.load_calibration
        return {
            "ring_thickness_m": tire.ring_thickness_m,
            "reference": json.dumps(asdict(tire.reference), sort_keys=True),
            "load_calibration": json.dumps(asdict(calibration), sort_keys=True) if calibration is not None else None,
            "hub_zero_utc": self._last.host_ns - round((revolution.start_s + revolution.period_s) * 1e9),
        }


def _extended(span: tuple[float, float], value: float) -> tuple[float, float]:
    return (min(span[0], value), max(span[1], value)) if math.isfinite(value) else span


def json_cell(entries: Collection[object]) -> str | None:
    """Return entries as JSON, None without any."""
    return json.dumps(entries, ensure_ascii=False, allow_nan=False) if entries else None
