"""Pressures and temperatures of a history without those that a sensor cannot have measured."""

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


def plausible_readings(history: TireHistory) -> PlausibleReadings:
    """Return the readings without temperatures that no tire has, and without pressures of a stuck sensor."""
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
        if rows.size < measured.size and _is_stuck(pressure_pa[rows], degc[rows], least_pa):
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


def _is_stuck(pressure_pa: FloatArray, degc: FloatArray, least_pa: float) -> bool:
    """Return whether a closed volume of gas cannot have kept its pressure at these temperatures."""
    finite_degc = degc[np.isfinite(degc)]
    if len(pressure_pa) < _LEAST_RUN or finite_degc.size < _LEAST_RUN:
        return False
    absolute_pa = float(pressure_pa[0]) + STANDARD_ATMOSPHERE_PA
    return absolute_pa * float(np.ptp(finite_degc)) / (float(finite_degc.mean()) + ZERO_CELSIUS_K) >= least_pa
