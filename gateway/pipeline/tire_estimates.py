"""Conditions, running average and estimators of one wheel's tire."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Final

import numpy as np

from firmware_protocol.messages import Axis, Environment
from gateway.estimators.estimator import AngleAverage, Estimate, Estimator, Revolution, Status, TireConditions
from gateway.estimators.registry import in_order, make_estimator
from gateway.estimators.self_calibration import SelfCalibrationEstimator
from gateway.estimators.signal_evidence import Evidence, assess
from gateway.pipeline.old_pressure import old_pressure_s, rest_on_old_pressure
from gateway.pipeline.results import RevolutionResult, SensorFlag
from gateway.pipeline.wheel_setup import WheelSetup
from gateway.reasons import Code, Reason
from gateway.signal.synchronous_average import RunningAverage
from gateway.types import FloatArray

# Environment readings kept for revolutions that are not complete yet.
_ENVIRONMENT_DEPTH: Final = 64
# Estimators that known effects, which are locked to the wheel's angle, do not change.
_UNAFFECTED: Final = frozenset({"kinematic", "asynchronous"})
# Estimate that rests on the times of contacts alone.
_SPEED: Final = "speed_mps"


class _Series:
    """Average, self-calibration and estimators of revolutions that may be averaged together."""

    def __init__(self, estimators: Sequence[str]) -> None:
        self.average = RunningAverage()
        # Always on, because what it measures decides how far the other estimates hold.
        self.calibration = SelfCalibrationEstimator()
        self.estimators: list[Estimator] = [
            self.calibration if name == self.calibration.name else make_estimator(name) for name in in_order(estimators)
        ]

    def reset(self) -> None:
        """Forget everything, as after a change of tire."""
        self.average.reset()
        self.calibration.reset()
        for estimator in self.estimators:
            estimator.reset()


class TireEstimates:
    """Turns a wheel's revolutions into results; one instance per wheel.

    Attributes:
        last: the latest result, None before the first revolution.
        rejected: revolutions with faults, which stay out of the average.
        evidence: what the signal says for or against what is stated; None before the first revolution.
    """

    def __init__(self, setup: WheelSetup, estimators: Sequence[str]) -> None:
        """Make the estimators; they run in the registry's order."""
        self._setup = setup
        self._names = tuple(estimators)
        self._current = _Series(estimators)
        # Revolutions with and without known effects subtracted are averaged separately.
        self._series = {False: self._current}
        self._environment: deque[tuple[int, Environment, float]] = deque(maxlen=_ENVIRONMENT_DEPTH)
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

    def environment(self, tick_us: int, environment: Environment, pressure_error_pa: float) -> None:
        """Add a pressure and temperature reading with its hub time and the error that sensor health gives it."""
        self._environment.append((tick_us, environment, pressure_error_pa))

    def take_block(
        self,
        revolutions: Sequence[Revolution],
        ends_us: Sequence[float],
        hosts_ns: Sequence[int],
        doubts: Sequence[Reason | None],
    ) -> list[RevolutionResult]:
        """Estimate consecutive revolutions; the size of the blocks does not change the results.

        The running average is known at the end of a block only. Whoever uses it must end blocks at places that do not
        depend on how the samples arrived. Environment readings up to the last end must have been given.

        Args:
            revolutions: in order; their arrays may be rows of stacked arrays.
            ends_us: hub time of the end of each.
            hosts_ns: host time of the end of each, ns since the epoch.
            doubts: about the sensor; makes all estimates of that revolution but the speed provisional.

        Returns:
            One result per revolution.
        """
        return [
            self._take(revolution, end_us, host_ns, doubt)
            for revolution, end_us, host_ns, doubt in zip(revolutions, ends_us, hosts_ns, doubts, strict=True)
        ]

    def _take(self, revolution: Revolution, end_us: float, host_ns: int, doubt: Reason | None) -> RevolutionResult:
        uncorrected = revolution.uncorrected is not None
        if uncorrected not in self._series:
            self._series[uncorrected] = _Series(self._names)
        self._current = self._series[uncorrected]
        average = self._take_in(revolution)
        conditions, estimates = self._estimate(revolution, average, self.conditions(end_us), doubt)
        old_s = old_pressure_s(self._environment, end_us)
        if old_s is not None:
            estimates = rest_on_old_pressure(estimates, old_s)
        self.last = RevolutionResult(self._setup.position, host_ns, revolution, conditions, estimates)
        return self.last

    def _estimate(
        self, revolution: Revolution, average: AngleAverage, stated: TireConditions, doubt: Reason | None
    ) -> tuple[TireConditions, tuple[Estimate, ...]]:
        """Run the estimators in order; each gets the estimates of those before it, and the conditions in use.

        A name that an earlier estimator has used is prefixed with the estimator's: `ring-paper:Bs`.
        """
        calibration = self._current.calibration
        calibrated = calibration.update(revolution, average, stated)
        self.evidence = evidence = assess(
            calibration.measured,
            stated,
            stated.radius_m * revolution.omega_radps**2,
            ac_coupled=revolution.ac_coupled,
        )
        conditions = evidence.applied_to(stated)
        given: dict[str, dict[str, Estimate]] = {}
        seeing = replace(conditions, given=MappingProxyType(given))
        estimates: list[Estimate] = []
        taken: set[str] = set()
        for estimator in self._current.estimators:
            is_calibration = estimator is calibration
            made = calibrated if is_calibration else estimator.update(revolution, average, seeing)
            if revolution.uncorrected is not None and estimator.name not in _UNAFFECTED:
                made = tuple(_doubted(estimate, revolution.uncorrected) for estimate in made)
            made = tuple(evidence.qualified(estimate) for estimate in made)
            if doubt is not None:
                made = tuple(
                    estimate if estimate.name == _SPEED else _provisional(estimate, doubt) for estimate in made
                )
            found = {estimate.name: estimate for estimate in made}
            given[estimator.name] = found
            for name, estimate in found.items():
                estimates.append(replace(estimate, name=f"{estimator.name}:{name}") if name in taken else estimate)
            taken.update(found)
        return conditions, tuple(estimates)

    def _take_in(self, revolution: Revolution) -> AngleAverage:
        """Update the running average, or leave it unchanged when the revolution has faults."""
        latest = self._current.average.latest
        if revolution.faults:
            self.rejected += 1
            if latest is not None:
                return latest
        target = self._current.average if not revolution.faults else RunningAverage()
        finite = np.isfinite(revolution.radial_mps2).all()
        return target.update(
            revolution.radial_mps2 if finite else np.zeros_like(revolution.radial_mps2),
            revolution.orders_mps2,
            revolution.omega_radps,
            edges_rad=(revolution.leading_edge_rad, revolution.trailing_edge_rad),
            edges_std_rad=(revolution.leading_edge_std_rad, revolution.trailing_edge_std_rad),
            noise_mps2=revolution.noise_mps2,
        )

    def conditions(self, tick_us: float) -> TireConditions:
        """Return the conditions of the tire at hub time `tick_us`."""
        pressure, temperature = self._setup.pressure_pa, self._setup.temperature_degc
        pressure_std = self._setup.pressure_std_pa
        # The latest reading before that time.
        taken = next((entry for entry in reversed(self._environment) if entry[0] <= tick_us), None)
        if taken is not None:
            _, reading, pressure_error = taken
            pressure = reading.pressure_pa if reading.pressure_pa is not None else pressure
            temperature = reading.temperature_degc if reading.temperature_degc is not None else temperature
            pressure_std = max(pressure_std, pressure_error)
        return TireConditions(
            radius_m=self._setup.radius_m,
            load_n=self._setup.load_n,
            pressure_pa=pressure,
            temperature_degc=temperature,
            load_std_n=self._setup.load_std_n,
            pressure_std_pa=pressure_std,
            radius_std_m=self._setup.radius_std_m,
            claims=self._setup.sensor,
            tire=self._setup.tire,
        )

    def flags(self) -> tuple[SensorFlag, ...]:
        """Return what the signal contradicts of what is stated."""
        contradictions = self.evidence.contradictions if self.evidence is not None else ()
        return tuple(SensorFlag(str(found.subject), found.reason) for found in contradictions)

    @property
    def average(self) -> AngleAverage | None:
        """The running average, None before the first revolution without a fault."""
        return self._current.average.latest

    def average_as_measured(self, *, ac_coupled: bool) -> AngleAverage | None:
        """Return the running average including known effects, as in the samples in which contacts are searched."""
        average, table = self.average, self._setup.correction
        if average is None or table is None or self._current is not self._series[False]:
            return average
        added = table.contribution_mps2(average.omega_radps, ac_coupled=ac_coupled)[Axis.RADIAL]
        return replace(average, radial_mps2=average.radial_mps2 + added)

    def contribution(
        self, omega_radps: float, end_us: float, *, sensor_id: int, ac_coupled: bool
    ) -> tuple[FloatArray | None, Reason | None]:
        """Return the contribution of known effects to a revolution, (3, n), or None with the reason if there is one."""
        table = self._setup.correction
        if table is None:
            return None, None
        conditions = self.conditions(end_us)
        refusal = table.refusal(omega_radps, conditions.load_n, conditions.pressure_pa)
        if table.sensor_id is not None and table.sensor_id != sensor_id:
            refusal = Reason(Code.EFFECTS_OF_OTHER_SENSOR, found_on=f"{table.sensor_id:08x}", sensor=f"{sensor_id:08x}")
        if refusal is not None:
            return None, refusal
        return table.contribution_mps2(omega_radps, ac_coupled=ac_coupled), None

    def latest(self, name: str) -> Estimate | None:
        """Return the latest estimate of a name, None where it is invalid or no estimator gives it."""
        estimates = self.last.estimates if self.last is not None else ()
        return next((e for e in estimates if e.name == name and e.status is not Status.INVALID), None)


def _doubted(estimate: Estimate, why: Reason) -> Estimate:
    """Return an estimate of a waveform that still contains the known effects."""
    return _provisional(estimate, Reason(Code.EFFECTS_NOT_SUBTRACTED, why=why))


def _provisional(estimate: Estimate, doubt: Reason) -> Estimate:
    """Return an estimate that is provisional at best, with the reason."""
    status = Status.PROVISIONAL if estimate.status is Status.VALID else estimate.status
    if any(doubt in reason for reason in estimate.reasons):
        return replace(estimate, status=status)  # inherited from the estimate that this one is made of
    return replace(estimate, status=status, reasons=(*estimate.reasons, doubt))
