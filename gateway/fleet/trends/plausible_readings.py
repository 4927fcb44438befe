"""Pressures and temperatures of a history without those that a sensor cannot have measured."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from gateway.core.constants import STANDARD_ATMOSPHERE_PA, TIRE_DEGC, ZERO_CELSIUS_K
from gateway.core.reasons import Reason
from gateway.core.types import BoolArray, FloatArray
from gateway.fleet.reasons import FleetCode
from gateway.fleet.trends.tire_history import TireHistory

# Recordings in a row, and change of the pressure that their temperatures ask for, from which the same value is no
# measurement, beside the sensor's resolution: those of tires have up to 2.5 kPa.
_LEAST_RUN: Final = 4
_LEAST_EXPECTED_PA: Final = 4000.0
_MOST_RESOLUTION_PA: Final = 2500.0
# Other wheels of the vehicle that tell what ambient pressure and altitude did.
_LEAST_OTHERS: Final = 2
# No sensor of a tire resolves it.
_ROUNDING_PA: Final = 1.0


class PlausibleReadings(NamedTuple):
    """Readings of a tire over its recordings.

    Attributes:
        pressure_pa: (n,) gauge pressure, NaN where the sensor was stuck.
        temperature_degc: (n,) NaN where no tire has it.
        is_impossible: (n,) whether the temperature is one that no tire has.
        findings: what was left out.
    """

    pressure_pa: FloatArray
    temperature_degc: FloatArray
    is_impossible: BoolArray
    findings: tuple[Reason, ...]

    @property
    def has_temperature(self) -> bool:
        """Whether any recording has one."""
        return bool(np.isfinite(self.temperature_degc).any())


def plausible_readings(history: TireHistory, other_wheels: Sequence[TireHistory] = ()) -> PlausibleReadings:
    """Return the readings without temperatures that no tire has, and without pressures of a stuck sensor.

    Args:
        history: of the tire.
        other_wheels: of its vehicle.
    """
    degc, pressure_pa = history.column("temperature_degc"), history.column("pressure_pa").copy()
    with np.errstate(invalid="ignore"):
        impossible = (degc < TIRE_DEGC[0]) | (degc > TIRE_DEGC[1])
    findings: list[Reason] = []
    if impossible.any():
        worst = float(degc[impossible][np.argmax(np.abs(degc[impossible]))])
        findings.append(
            Reason(
                FleetCode.TREND_TEMPERATURE_IMPOSSIBLE,
                temperature_degc=worst,
                count=int(impossible.sum()),
                since_s=1e-9 * float(history.time_ns[np.flatnonzero(impossible)[0]]),
            )
        )
    degc = np.where(impossible, np.nan, degc)
    measured = np.flatnonzero((history.column("pressure_measured") > 0.0) & np.isfinite(pressure_pa))
    steps_pa = np.diff(np.unique(pressure_pa[measured]))
    least_pa = _LEAST_EXPECTED_PA + min(steps_pa[steps_pa > _ROUNDING_PA], default=0.0)
    least_pa = min(least_pa, _LEAST_EXPECTED_PA + _MOST_RESOLUTION_PA)
    for run in _runs(pressure_pa[measured]):
        rows = measured[run]
        if not _LEAST_RUN <= rows.size < measured.size:
            continue
        shared_pa = _shared_change(other_wheels, [history.paths[row] for row in rows.tolist()])
        if _is_stuck(float(pressure_pa[rows[0]]), degc[rows], shared_pa, least_pa):
            first, last = (
                str(np.datetime64(int(history.time_ns[row]), "ns").astype("datetime64[D]")) for row in rows[[0, -1]]
            )
            findings.append(
                Reason(
                    FleetCode.TREND_PRESSURE_STUCK,
                    pressure_pa=float(pressure_pa[rows[0]]),
                    count=int(rows.size),
                    first=first,
                    last=last,
                    **history.since(int(rows[0])),
                )
            )
            pressure_pa[rows] = np.nan
    return PlausibleReadings(pressure_pa, degc, np.asarray(impossible, dtype=bool), tuple(findings))


def _runs(values: FloatArray) -> list[slice]:
    """Return the runs of readings that are equal but for rounding."""
    edges = [0, *(np.flatnonzero(np.abs(np.diff(values)) > _ROUNDING_PA) + 1).tolist(), len(values)]
    return [slice(begin, end) for begin, end in pairwise(edges)]


def _shared_change(other_wheels: Sequence[TireHistory], paths: Sequence[str]) -> FloatArray:
    """Return (n,) the change of the other wheels' cold pressures since the first of some recordings.

    It is 0 where fewer than two of them have measured them: those that repeat a value too tell nothing.
    """
    changes = []
    for wheel in other_wheels:
        row_of = {path: row for row, path in enumerate(wheel.paths)}
        if not row_of.keys() >= set(paths):
            continue
        rows = [row_of[path] for path in paths]
        gauge_pa, degc = wheel.column("pressure_pa")[rows], wheel.column("temperature_degc")[rows]
        cold_pa = (gauge_pa + STANDARD_ATMOSPHERE_PA) * ZERO_CELSIUS_K / (degc + ZERO_CELSIUS_K)
        if np.all(wheel.column("pressure_measured")[rows] > 0.0) and float(np.ptp(gauge_pa)) > _ROUNDING_PA:
            changes.append(cold_pa - cold_pa[0])
    finite_changes = [change for change in changes if np.isfinite(change).all()]
    return np.median(finite_changes, axis=0) if len(finite_changes) >= _LEAST_OTHERS else np.zeros(len(paths))


def _is_stuck(pressure_pa: float, degc: FloatArray, shared_pa: FloatArray, least_pa: float) -> bool:
    """Return whether a closed volume of gas cannot have kept its pressure at these temperatures.

    What the other wheels have in common is the ambient pressure, which a sensor against vacuum does not feel.
    """
    is_known = np.isfinite(degc)
    if is_known.sum() < _LEAST_RUN:
        return False
    kelvin = degc[is_known] + ZERO_CELSIUS_K
    cold_pa = (pressure_pa + STANDARD_ATMOSPHERE_PA) * ZERO_CELSIUS_K / kelvin.mean()
    expected_pa = np.stack([cold_pa + shared_pa[is_known], np.full(kelvin.size, cold_pa)]) * kelvin / ZERO_CELSIUS_K
    return float(np.ptp(expected_pa, axis=1).min()) >= least_pa
