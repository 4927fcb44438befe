"""Conditions, running average and estimators of one wheel's tire."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Final

import numpy as np

from firmware_protocol.messages import Axis, Environment
from gateway.core.estimates.doubt_rules import DoubtRule
from gateway.core.estimates.estimator import (
    AngleAverage,
    Estimate,
    Estimator,
    Revolution,
    Status,
    TireConditions,
)
from gateway.core.estimates.registry import in_order, make_estimator
from gateway.core.estimates.results import RevolutionResult, SensorFlag
from gateway.core.estimates.revolution_block import BlockEstimator, RevolutionArrays, RevolutionBlock, measured_shares
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.core.quantity import Basis
from gateway.core.quantity_catalogue import rests_on_times_alone
from gateway.core.reasons import CoreCode, Reason
from gateway.core.revolutions.coupling_highpass import behind_highpass
from gateway.core.revolutions.synchronous_average import AverageSteps, RunningAverage
from gateway.core.trust.contact_trend import ContactTrend
from gateway.core.trust.lost_revolutions import LossStreak
from gateway.core.trust.qualification import Qualification, provisional_where
from gateway.core.trust.self_calibration import SelfCalibrationEstimator
from gateway.core.trust.sensor_limits import Doubt
from gateway.core.trust.signal_evidence import Evidence, assess
from gateway.core.types import ComplexArray, FloatArray
from gateway.core.wheels.old_pressure import Reading, change_since_reading_pa, old_pressure_s
from gateway.core.wheels.outside_readings import OutsideReading, OutsideReadings
from gateway.core.wheels.reasons import WheelCode

# Environment readings kept for revolutions that are not complete yet.
_ENVIRONMENT_DEPTH: Final = 64
# Revolutions worked on together, which bounds the memory.
_LONGEST_BLOCK: Final = 64


def _at_rate(conditions: TireConditions, rate_std: float) -> TireConditions:
    """Return conditions with a relative error of the sampling rate beside what is stated of it."""
    if not rate_std:
        return conditions
    claims = conditions.claims
    return replace(conditions, claims=replace(claims, rate_std=math.hypot(claims.rate_std, rate_std)))


def _in_trend(conditions: TireConditions, revolution: Revolution, trend: ContactTrend) -> TireConditions:
    """Return conditions with the error of the load that a trend of the contact shows."""
    error = trend.take(revolution, conditions.pressure_pa)
    if not error or conditions.load_n is None or DoubtRule.OWN_DRIFT not in conditions.rules:
        return conditions
    return replace(conditions, load_std_n=math.hypot(conditions.load_std_n, error * conditions.load_n))


def _first_known(measured: float | None, fallback: float | None) -> float | None:
    return fallback if measured is None else measured


def _with_pressure(outside: Sequence[OutsideReading]) -> list[OutsideReading]:
    return [entry for entry in outside if entry.reading.pressure_pa is not None]


class _PausedSteps:
    """The running average after each of revolutions of which some have faults and leave it unchanged."""

    def __init__(
        self,
        arrays: RevolutionArrays,
        taken: Sequence[int],
        steps: AverageSteps | None,
        before: AverageSteps | None,
    ) -> None:
        self._arrays = arrays
        self._steps, self._previous = steps, before
        # Step after each revolution, -1 before the first.
        self._step_indices = np.searchsorted(np.array(taken, dtype=np.intp), np.arange(len(arrays)), side="right") - 1

    def _fallback_step(self, index: int) -> tuple[AverageSteps, int]:
        if self._previous is not None:
            return self._previous, len(self._previous.counts) - 1
        # Without any average the revolution stands for itself, in spite of its faults.
        return _average(RunningAverage(), self._arrays, [index]), 0

    @cached_property
    def _parts(self) -> list[tuple[AverageSteps, int]]:
        return [
            (self._steps, int(step)) if self._steps is not None and step >= 0 else self._fallback_step(index)
            for index, step in enumerate(self._step_indices)
        ]

    @cached_property
    def edges_rad(self) -> Sequence[tuple[float, float]]:
        return [steps.edges_rad[step] for steps, step in self._parts]

    @cached_property
    def counts(self) -> Sequence[int]:
        return [steps.counts[step] for steps, step in self._parts]

    @cached_property
    def effective_counts(self) -> Sequence[float]:
        return [steps.effective_counts[step] for steps, step in self._parts]

    @cached_property
    def scatters(self) -> Sequence[float]:
        return [steps.scatters[step] for steps, step in self._parts]

    @cached_property
    def spectra(self) -> ComplexArray:
        return np.stack([steps.spectra[step] for steps, step in self._parts])

    def edges_std_rad(self, index: int) -> tuple[float, float]:
        steps, step = self._parts[index]
        return steps.edges_std_rad(step)

    def at(self, index: int) -> AngleAverage:
        steps, step = self._parts[index]
        return steps.at(step)


def _average(average: RunningAverage, arrays: RevolutionArrays, indices: Sequence[int]) -> AverageSteps:
    """Add some of the revolutions, at least one, to an average; return it after each."""
    revolutions, radial, orders = arrays.revolutions, arrays.radial_mps2, arrays.orders_mps2
    # Without a copy where all are taken, as nearly always.
    if len(indices) < len(arrays):
        revolutions, radial, orders = [revolutions[index] for index in indices], radial[indices], orders[indices]
    finite = np.isfinite(radial)
    if not finite.all():
        radial = np.where(np.logical_and.reduce(finite, axis=1, keepdims=True), radial, 0.0)
    return average.update_block(
        radial,
        orders,
        [revolution.omega_radps for revolution in revolutions],
        edges_rad=[(revolution.leading_edge_rad, revolution.trailing_edge_rad) for revolution in revolutions],
        edges_std_rad=[
            (revolution.leading_edge_std_rad, revolution.trailing_edge_std_rad) for revolution in revolutions
        ],
        noise_mps2=[revolution.noise_mps2 for revolution in revolutions],
        measured=measured_shares(revolutions),
    )


class _Series:
    """Average, self-calibration and estimators of revolutions that may be averaged together."""

    def __init__(self, setup: WheelSetup, estimators: Sequence[str], other: _Series | None = None) -> None:
        self.average = RunningAverage()
        # Always on, because what it measures decides how far the other estimates hold.
        self.calibration = SelfCalibrationEstimator()
        calibrations = {self.calibration.name: self.calibration}
        common = {
            shared.name: shared for shared in (other.estimators if other else ()) if rests_on_times_alone(shared.name)
        }
        present: dict[str, Estimator] = {**calibrations, **common}
        self.estimators: list[Estimator] = [present.get(name) or make_estimator(name) for name in in_order(estimators)]
        self.loss_streak = LossStreak()
        self.contact_trend = ContactTrend()
        self.qualifications = {estimator.name: Qualification(estimator.name, setup) for estimator in self.estimators}

    def reset(self) -> None:
        """Forget everything, as after a change of tire."""
        self.average.reset()
        self.calibration.reset()
        self.loss_streak.reset()
        self.contact_trend.reset()
        for estimator in self.estimators:
            estimator.reset()
            self.qualifications[estimator.name].reset()


class TireEstimates:
    """Turns a wheel's revolutions into results; one instance per wheel.

    Attributes:
        last: the latest result, None before the first revolution.
        rejected: revolutions with faults, which stay out of the average.
        outside: readings of receivers beside the hub.
        evidence: what the signal says for or against what is stated; None before the first revolution.
    """

    def __init__(self, setup: WheelSetup, estimators: Sequence[str]) -> None:
        """Make the estimators; they run in the registry's order."""
        self._setup = setup
        self._names = tuple(estimators)
        self._current = _Series(setup, estimators)
        # Revolutions with and without known effects subtracted are averaged separately.
        self._series = {False: self._current}
        self._environment: deque[Reading] = deque(maxlen=_ENVIRONMENT_DEPTH)
        self._revolution_end_us = -math.inf
        self.outside = OutsideReadings()
        # Conditions made from the latest readings that were used.
        self._conditions_cache: tuple[Reading | None, OutsideReading | None, TireConditions | None] = None, None, None
        self.last: RevolutionResult | None = None
        self.rejected = 0
        self.evidence: Evidence | None = None

    def reset(self) -> None:
        """Forget everything, as after a change of tire."""
        for series in self._series.values():
            series.reset()
        self.evidence = None

    def forget_environment(self) -> None:
        """Forget readings: the hub's time has restarted."""
        self._environment.clear()
        self._revolution_end_us = -math.inf

    def environment(self, tick_us: int, environment: Environment, pressure_error_pa: float) -> None:
        """Add a pressure and temperature reading with its hub time and the error that sensor health gives it."""
        self._environment.append((tick_us, environment, pressure_error_pa))

    def take_block(
        self,
        arrays: RevolutionArrays,
        ends_us: Sequence[float],
        hosts_ns: Sequence[int],
        doubts: Sequence[Sequence[Doubt]],
    ) -> list[RevolutionResult]:
        """Estimate consecutive revolutions; the size of the blocks does not change the results.

        The running average is known at the end of a block only. Whoever uses it must end blocks at places that do not
        depend on how the samples arrived. Environment readings up to the last end must have been given.

        Args:
            arrays: the revolutions, in order.
            ends_us: hub time of the end of each.
            hosts_ns: host time of the end of each, ns since the epoch.
            doubts: about the sensor in each; what rests on it is provisional.

        Returns:
            One result per revolution.
        """
        results: list[RevolutionResult] = []
        self._revolution_end_us = ends_us[-1]
        revolutions, first = arrays.revolutions, 0
        for end in range(1, len(revolutions) + 1):
            corrected = revolutions[first].uncorrected is None
            is_same_series = end < len(revolutions) and (revolutions[end].uncorrected is None) is corrected
            if not is_same_series or end - first == _LONGEST_BLOCK:
                rows = slice(first, end)
                results += self._estimate_series(arrays.part(rows), ends_us[rows], hosts_ns[rows], doubts[rows])
                first = end
        return results

    def _estimate_series(
        self,
        arrays: RevolutionArrays,
        ends_us: Sequence[float],
        hosts_ns: Sequence[int],
        doubts: Sequence[Sequence[Doubt]],
    ) -> list[RevolutionResult]:
        """Estimate revolutions of one series: all with known effects subtracted, or none."""
        revolutions = arrays.revolutions
        uncorrected = revolutions[0].uncorrected is not None
        if uncorrected not in self._series:
            self._series[uncorrected] = _Series(self._setup, self._names, self._current)
        self._current = series = self._series[uncorrected]
        averages = self._update_average(arrays)
        nominals = [
            _in_trend(_at_rate(self.conditions(end_us, host_ns), revolution.rate_std), revolution, series.contact_trend)
            for end_us, host_ns, revolution in zip(ends_us, hosts_ns, revolutions, strict=True)
        ]
        measured = series.calibration.measure(RevolutionBlock(revolutions, arrays, averages, nominals))
        by_estimator: list[dict[str, dict[str, Estimate]]] = [{} for _ in revolutions]
        evidences = [
            assess(
                measurement,
                condition,
                condition.radius_m * revolution.omega_radps**2,
                ac_coupled=revolution.ac_coupled,
                lost=lost,
                full_scale_mps2=revolution.full_scale_mps2,
            )
            for (measurement, lost), condition, revolution in zip(measured, nominals, revolutions, strict=True)
        ]
        self.evidence = evidences[-1]
        conditions = [
            evidence.applied_to(condition, by_others)
            for evidence, condition, by_others in zip(evidences, nominals, by_estimator, strict=True)
        ]
        block = RevolutionBlock(revolutions, arrays, averages, conditions)
        nominal_block = RevolutionBlock(revolutions, arrays, averages, nominals)
        streaks = [series.loss_streak.take(revolution) for revolution in revolutions]
        estimates: list[list[Estimate]] = [[] for _ in revolutions]
        for estimator in series.estimators:
            if estimator is series.calibration:
                raw_estimates = series.calibration.estimates(nominal_block, [evidence.unsure for evidence in evidences])
            elif isinstance(estimator, BlockEstimator):
                raw_estimates = estimator.update_block(block)
            else:
                raw_estimates = [
                    estimator.update(revolution, averages.at(index), conditions[index])
                    for index, revolution in enumerate(revolutions)
                ]
            qualification = series.qualifications[estimator.name]
            finals = qualification.of_block(raw_estimates, revolutions, evidences, doubts, streaks)
            for index, final in enumerate(finals):
                by_estimator[index][estimator.name] = {estimate.name: estimate for estimate in final}
                estimates[index] += final
        results = []
        for index, revolution in enumerate(revolutions):
            old_s = self._old_pressure_s(ends_us[index], hosts_ns[index])
            final = self._finished(estimates[index], by_estimator[index], old_s)
            measurement, _ = measured[index]
            lags = (None, None) if measurement is None else measurement.relations.lags
            results.append(
                RevolutionResult(
                    self._setup.position, hosts_ns[index], revolution, conditions[index], final, axis_lags=lags
                )
            )
        self.last = results[-1]
        return results

    def _finished(
        self, estimates: list[Estimate], by_estimator: Mapping[str, Mapping[str, Estimate]], old_s: float | None
    ) -> tuple[Estimate, ...]:
        """Return the estimates of a revolution with distinct names, and with the doubt of an old pressure.

        A name that an earlier estimator has used is prefixed with the estimator's: `ring-paper:Bs`.
        """
        if len({estimate.name for estimate in estimates}) < len(estimates):
            estimates, used_names = [], set[str]()
            for estimator, named in by_estimator.items():
                for name, estimate in named.items():
                    distinct = estimate._replace(name=f"{estimator}:{name}") if name in used_names else estimate
                    estimates.append(distinct)
                used_names.update(named)
        final = tuple(estimates)
        if old_s is None:
            return final
        return provisional_where(final, Basis.PRESSURE, Reason(WheelCode.PRESSURE_OLD, age_s=old_s))

    def _update_average(self, arrays: RevolutionArrays) -> AverageSteps:
        """Update the running average with the revolutions that have no faults; return it after each revolution."""
        accepted = [index for index, revolution in enumerate(arrays.revolutions) if not revolution.faults]
        self.rejected += len(arrays) - len(accepted)
        previous = self._current.average.steps
        steps = _average(self._current.average, arrays, accepted) if accepted else None
        if steps is not None and len(accepted) == len(arrays):
            return steps
        return _PausedSteps(arrays, accepted, steps, previous)

    def conditions(self, tick_us: float, host_ns: float) -> TireConditions:
        """Return the conditions of the tire at a hub time, which is `host_ns` by the host's clock."""
        # The latest reading before that time.
        reading = next((entry for entry in reversed(self._environment) if entry[0] <= tick_us), None)
        outside = self._outside_at(tick_us, host_ns)
        latest = outside[0] if outside else None
        cached_reading, cached_outside, conditions = self._conditions_cache
        if conditions is None or cached_reading is not reading or cached_outside is not latest:
            conditions = self._conditions(reading, outside)
            self._conditions_cache = reading, latest, conditions
        return conditions

    def _old_pressure_s(self, tick_us: float, host_ns: float) -> float | None:
        """Return the age of the measured pressure in use; None while it is current."""
        outside = _with_pressure(self._outside_at(tick_us, host_ns))
        return outside[0].old_s(host_ns) if outside else old_pressure_s(self._environment, tick_us)

    def outside_old_s(self, host_ns: float) -> float | None:
        """Return the age of a reading from outside that is in use and old at a time, else None."""
        outside = self._outside_at(math.inf, host_ns)
        used = _with_pressure(outside) or outside
        return used[0].old_s(host_ns) if used else None

    def _outside_at(self, tick_us: float, host_ns: float) -> list[OutsideReading]:
        """Return the readings from outside in use, the latest first: while the sensor of the wheel brings none."""
        if not self.outside:
            return []
        if tick_us == math.inf:  # now
            tick_us = max([self._revolution_end_us, *(tick for tick, _, _ in self._environment)])
        is_measured = any(tick <= tick_us and entry.pressure_pa is not None for tick, entry, _ in self._environment)
        is_current = is_measured and old_pressure_s(self._environment, tick_us) is None
        return [] if is_current else self.outside.until(host_ns)

    def _conditions(self, reading: Reading | None, outside: Sequence[OutsideReading]) -> TireConditions:
        pressure, measured_degc = self._setup.pressure_pa, None
        pressure_std, change_pa = self._setup.pressure_std_pa, 0.0
        # A reading without a pressure says nothing of it: the last one holds, and grows old. So does a temperature.
        readings = [(entry.host_ns, entry.reading, entry.pressure_std_pa) for entry in _with_pressure(outside)]
        if reading is not None:
            sensor_readings = [entry for entry in reversed(self._environment) if entry[0] <= reading[0]]
            temperatures = (entry[1].temperature_degc for entry in sensor_readings)
            measured_degc = next((degc for degc in temperatures if degc is not None), None)
            # One from outside comes in the place of an old one.
            readings = readings or [entry for entry in sensor_readings if entry[1].pressure_pa is not None]
        if readings:
            change_pa = change_since_reading_pa(readings)
            pressure, pressure_std = readings[0][1].pressure_pa, max(pressure_std, readings[0][2])
        if outside and measured_degc is None:
            measured_degc = outside[0].reading.temperature_degc
        if pressure is not None:
            pressure_std = max(pressure_std, self._setup.pressure_relative_std * pressure)
        return TireConditions(
            radius_m=self._setup.radius_m,
            load_n=self._setup.load_n,
            pressure_pa=pressure,
            temperature_degc=_first_known(measured_degc, self._setup.temperature_degc),
            load_std_n=self._setup.load_std_n,
            # What is no more than the errors of two readings is no change.
            pressure_std_pa=max(pressure_std, change_pa),
            radius_std_m=self._setup.radius_std_m,
            claims=self._setup.sensor,
            tire=self._setup.tire,
            rules=self._setup.rules,
            pressure_measured=bool(readings),
        )

    def flags(self) -> tuple[SensorFlag, ...]:
        """Return what the signal contradicts of what is stated."""
        contradictions = self.evidence.contradictions if self.evidence is not None else ()
        return tuple(SensorFlag(str(contradiction.subject), contradiction.reason) for contradiction in contradictions)

    @property
    def average(self) -> AngleAverage | None:
        """The running average, None before the first revolution without a fault."""
        return self._current.average.latest

    @property
    def average_mps2(self) -> FloatArray | None:
        """Waveform of the running average, (n,), None before the first revolution without a fault."""
        return self._current.average.waveform_mps2

    @property
    def scatter_mps2(self) -> FloatArray | None:
        """Standard deviation of the waveform from revolution to revolution, (n,), None likewise."""
        return self._current.average.scatter_mps2

    def average_as_measured(self, *, ac_coupled: bool, corner_hz: float = 0.0) -> AngleAverage | None:
        """Return the running average including known effects, as in the samples in which contacts are searched.

        Args:
            ac_coupled: whether the sensor passes no steady value.
            corner_hz: of that coupling.
        """
        average, table = self.average, self._setup.correction
        if average is None:
            return None
        radial_mps2 = average.radial_mps2
        if table is not None and self._current is self._series[False]:
            added = table.contribution_mps2(average.omega_radps, ac_coupled=ac_coupled)[Axis.RADIAL]
            radial_mps2 = radial_mps2 + added
        if corner_hz:
            radial_mps2 = behind_highpass(radial_mps2, 2.0 * math.pi * corner_hz / average.omega_radps)
        return average if radial_mps2 is average.radial_mps2 else replace(average, radial_mps2=radial_mps2)

    def contribution(
        self, omega_radps: float, conditions: TireConditions, *, sensor_id: int, ac_coupled: bool
    ) -> tuple[FloatArray | None, Reason | None]:
        """Return the contribution of known effects to a revolution, (3, n), or None with the reason if there is one."""
        table = self._setup.correction
        if table is None:
            return None, None
        refusal = table.refusal(omega_radps, conditions.load_n, conditions.pressure_pa)
        if table.sensor_id is not None and table.sensor_id != sensor_id:
            refusal = Reason(
                CoreCode.EFFECTS_OF_OTHER_SENSOR, found_on=f"{table.sensor_id:08x}", sensor=f"{sensor_id:08x}"
            )
        if refusal is not None:
            return None, refusal
        return table.contribution_mps2(omega_radps, ac_coupled=ac_coupled), None

    def latest(self, name: str) -> Estimate | None:
        """Return the latest estimate of a name, None where it is invalid or no estimator gives it."""
        estimates = self.last.estimates if self.last is not None else ()
        return next((e for e in estimates if e.name == name and e.status is not Status.INVALID), None)
