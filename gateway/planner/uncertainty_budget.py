"""Budget of standard errors: what each statement contributes, and what a better one would bring.

The latest revolutions of a wheel are estimated again with the error of one statement taken away. What the variance
loses is the part of that statement. So a budget knows what a formula does not: that another statement may know a factor
better, as the belt width of the new tire does. The promise of a better statement is made the same way.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from firmware_protocol.messages import Environment
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.results import RevolutionResult
from gateway.core.estimates.revolution_block import RevolutionArrays
from gateway.core.estimates.sensor_claims import HAND_MOUNTED_STD_M, UNKNOWN_OFFSET_STD_M
from gateway.core.estimates.tire_data import ASSUMED_DEGC, DIFFERENCE_STD_K, UNKNOWN_DIFFERENCE_K
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.core.quantity_catalogue import CATALOGUE
from gateway.core.reasons import Code, Reason
from gateway.core.text.numbers import plain_name, split_name
from gateway.core.text.readout import DISTANCE
from gateway.core.text.wording import text
from gateway.core.wheels.tire_estimates import TireEstimates
from gateway.planner.reasons import PlannerCode

REVOLUTIONS: Final = 64
"""Latest revolutions that a budget is made of; averages of fifty have settled in them."""
# What is left of an error that is taken away.
_VANISHING: Final = 1e-3
# What the latest revolutions alone leave open of a statement, over the error by all revolutions, from which they say
# nothing of that error: a steady value over a stretch of braking, for example.
_LEFT_OPEN: Final = 1.1
# Share of the variance from which a statement is named.
_NAMED: Final = 0.2


@dataclass(frozen=True, slots=True)
class Source:
    """A statement with a standard error.

    Attributes:
        name: as people call it.
        unit: of its error; empty where that is given over its value.
        better: error that a careful statement has.
        how: how it is made.
        stated: returns its error in a setup; None where nothing is stated.
        with_error: returns the setup with another error.
        is_assumed: whether its error is that of a statement which is missing.
    """

    name: str
    unit: str
    better: float
    how: str
    stated: Callable[[WheelSetup], float | None]
    with_error: Callable[[WheelSetup, float], WheelSetup]
    is_assumed: bool = False

    @property
    def is_relative(self) -> bool:
        """Whether its error is given over its value."""
        return not self.unit


def _claimed(name: str) -> tuple[Callable[[WheelSetup], float | None], Callable[[WheelSetup, float], WheelSetup]]:
    """Return what reads and sets an error of the sensor's claims."""

    def with_error(setup: WheelSetup, error: float) -> WheelSetup:
        changes: dict[str, Any] = {name: error}
        return replace(setup, sensor=replace(setup.sensor, **changes))

    return lambda setup: getattr(setup.sensor, name), with_error


def _pressure_std(setup: WheelSetup) -> float | None:
    if setup.pressure_pa is None:
        return setup.pressure_relative_std or None
    return max(setup.pressure_std_pa / setup.pressure_pa, setup.pressure_relative_std)


def _with_pressure_std(setup: WheelSetup, error: float) -> WheelSetup:
    return replace(setup, pressure_std_pa=0.0, pressure_relative_std=error)


def _with_reference(setup: WheelSetup, **errors: Any) -> WheelSetup:
    tire = setup.tire
    return replace(setup, tire=replace(tire, reference=replace(tire.reference, **errors)))


def _with_temperature(setup: WheelSetup, error_k: float) -> WheelSetup:
    """Return the setup with a temperature of the new tire: the error rests on whether it is known, not on its value."""
    return _with_reference(setup, temperature_degc=ASSUMED_DEGC) if error_k < UNKNOWN_DIFFERENCE_K else setup


def _with_depth(setup: WheelSetup, error_m: float) -> WheelSetup:
    """Return the setup with a depth of the sensor, at which it is taken to be while none is stated."""
    return replace(setup, sensor=replace(setup.sensor, offset_m=0.0, offset_std_m=error_m))


SOURCES: Final = (
    Source(
        "load", "", 0.02, "weighed",
        lambda setup: setup.load_std_n / setup.load_n if setup.load_n else None,
        lambda setup, error: replace(setup, load_std_n=error * (setup.load_n or 0.0)),
    ),
    Source("pressure", "", 0.01, "checked with a calibrated gauge", _pressure_std, _with_pressure_std),
    Source(
        "belt radius", "", 0.003, "rolled over ten turns",
        lambda setup: setup.radius_std_m / setup.radius_m,
        lambda setup, error: replace(setup, radius_std_m=error * setup.radius_m),
    ),
    Source("sampling rate", "", 1e-5, "compared with a clock", *_claimed("rate_std")),
    Source("gain", "", 0.003, "calibrated", *_claimed("gain_std")),
    Source("lateral gain", "", 0.01, "calibrated", *_claimed("lateral_gain_std")),
    Source("circumferential gain", "", 0.01, "calibrated", *_claimed("along_gain_std")),
    Source("linearity", "", 0.001, "calibrated", *_claimed("nonlinearity_std")),
    Source("zero-g offset", "m/s²", 0.2, "calibrated", *_claimed("zero_g_std_mps2")),
    Source(
        "sensor depth", "m", 2e-4, "measured in a cut tire",
        lambda setup: None if setup.sensor.offset_m is None else setup.sensor.offset_std_m,
        lambda setup, error: replace(setup, sensor=replace(setup.sensor, offset_std_m=error)),
    ),
    Source(
        "depth of the sensor", "m", HAND_MOUNTED_STD_M, "measured",
        lambda setup: UNKNOWN_OFFSET_STD_M if setup.sensor.offset_m is None else None,
        _with_depth, is_assumed=True,
    ),
    Source(
        "softening by temperature", "/K", 5e-4, "calibrated at two temperatures",
        lambda setup: setup.tire.reference.softening_std_per_k,
        lambda setup, error: _with_reference(setup, softening_std_per_k=error),
    ),
    Source(
        "temperature of the new tire", "K", DIFFERENCE_STD_K, "measured",
        lambda setup: (
            UNKNOWN_DIFFERENCE_K if setup.tire.reference.Bs and setup.tire.reference.temperature_degc is None else None
        ),
        _with_temperature, is_assumed=True,
    ),
    Source(
        "Bs of the new tire", "", 0.003, "calibrated",
        lambda setup: setup.tire.reference.Bs_std / setup.tire.reference.Bs if setup.tire.reference.Bs else None,
        lambda setup, error: _with_reference(setup, Bs_std=error * (setup.tire.reference.Bs or 0.0)),
    ),
    Source(
        "ring thickness", "m", 1e-4, "measured",
        lambda setup: setup.tire.ring_thickness_std_m or None,
        lambda setup, error: replace(setup, tire=replace(setup.tire, ring_thickness_std_m=error)),
    ),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Promise:
    """What a better statement would bring.

    Attributes:
        source: the statement.
        stated: its present error.
        std: standard error of the quantity with `source.better`.
        is_assumed: whether nobody stated the present error.
    """

    source: Source
    stated: float
    std: float
    is_assumed: bool = False


@dataclass(frozen=True, slots=True)
class Budget:
    """Parts of the standard error of one quantity.

    Attributes:
        estimate: of the latest revolution, as it was printed.
        parts: standard error by each statement, in the quantity's unit; those without any are left out. Statements that
            one measurement bounds together, as the steady value does radius and gain, each have what they share.
        scatter_std: the part that differs between revolutions.
        model_std: what is left: models, the reference tire, and statements that share an error.
        promise: of the largest part, where that is worth naming and can be stated better.
    """

    estimate: Estimate
    parts: Mapping[str, float]
    scatter_std: float
    model_std: float
    promise: Promise | None = None

    @property
    def largest(self) -> str:
        """Name of the largest part; empty where scatter and model exceed every statement."""
        name = max(self.parts, key=lambda source: self.parts[source], default="")
        return name if name and self.parts[name] >= max(self.scatter_std, self.model_std) else ""

    def all_parts(self) -> dict[str, float]:
        """Return the parts with those of scatter and model."""
        return {**self.parts, "scatter": self.scatter_std, "model": self.model_std}

    @property
    def summary(self) -> str:
        """The advice, or without one the sentence that names the largest part."""
        parts = self.all_parts()
        largest = max(parts, key=lambda part: parts[part])
        return self.advice or self._sentence(PlannerCode.LARGEST_PART, largest)

    @property
    def advice(self) -> str:
        """The sentence that says which statement helps most; empty where none does."""
        promise = self.promise
        if promise is None:
            return ""
        source = promise.source
        factor = 100.0 if source.is_relative else 1.0
        return self._sentence(
            PlannerCode.STATE_MISSING if promise.is_assumed else PlannerCode.STATE_BETTER,
            source.name,
            of=" %" if source.is_relative else f" {source.unit}",
            how=source.how,
            improved=split_name(self.estimate.name)[1].factor * promise.std,
            stated=factor * promise.stated,
            better=factor * source.better,
        )

    def _sentence(self, code: Code, part: str, **values: Any) -> str:
        unit = split_name(self.estimate.name)[1]
        return text(
            Reason(
                code,
                quantity=plain_name(self.estimate.name),
                unit=f" {unit.symbol}" if unit.symbol else "",
                std=unit.factor * self.estimate.std,
                part=unit.factor * self.all_parts()[part],
                source=part,
                **values,
            )
        )


class LatestRevolutions:
    """Keeps the latest revolutions of the wheels of a vehicle."""

    def __init__(self, setups: Iterable[WheelSetup]) -> None:
        """Take the wheels; those of others are left out."""
        self._setups = {setup.position: setup for setup in setups}
        self._latest: dict[str, deque[RevolutionResult]] = {}

    def add(self, result: RevolutionResult) -> None:
        """Take one revolution."""
        if result.position in self._setups:
            self._latest.setdefault(result.position, deque(maxlen=REVOLUTIONS)).append(result)

    def budgets(self) -> dict[str, list[Budget]]:
        """Return the budgets of each wheel, by position."""
        return {position: budgets(self._setups[position], [*runs]) for position, runs in sorted(self._latest.items())}


def budgets(setup: WheelSetup, results: Sequence[RevolutionResult]) -> list[Budget]:
    """Return the budgets of the latest estimates of a wheel.

    Args:
        setup: of the wheel, as it was estimated.
        results: of its latest consecutive revolutions, at least one; `REVOLUTIONS` are enough.

    Returns:
        One for each estimate whose error these revolutions reproduce: what only earlier ones told of a statement is not
        in them.
    """
    estimators = _estimators_of(results[-1])
    base = _latest(setup, results, estimators)
    errors = {source: error for source in SOURCES if (error := source.stated(setup))}
    without = {
        source: _latest(source.with_error(setup, _VANISHING * error), results, estimators)
        for source, error in errors.items()
    }
    improved: dict[str, dict[str, Estimate]] = {}
    result = []
    for estimate in results[-1].estimates:
        name, repeated = estimate.name, base.get(estimate.name)
        if repeated is None or Status.INVALID in (estimate.status, repeated.status) or not estimate.std > 0.0:
            continue
        # A distance is that of the whole recording, and grows with what rests on the statements.
        scale = estimate.value / repeated.value if name == DISTANCE else 1.0
        if scale**2 * (repeated.std**2 - repeated.scatter_std**2) > (_LEFT_OPEN * estimate.std) ** 2:
            continue
        scale = min(scale, estimate.std / repeated.std)
        parts = {
            source: min(scale * part, estimate.std)
            for source in errors
            if (part := _part(repeated, without[source].get(name)))
        }
        explained = math.hypot(estimate.scatter_std, *parts.values())
        largest = max(parts, key=lambda source: parts[source], default=None)
        promise = None
        if largest is not None and parts[largest] ** 2 > _NAMED * estimate.std**2 and errors[largest] > largest.better:
            if largest.name not in improved:
                improved[largest.name] = _latest(largest.with_error(setup, largest.better), results, estimators)
            gain = scale * _part(repeated, improved[largest.name].get(name))
            if gain > 0.0:
                is_assumed = largest.is_assumed or largest.name in setup.assumed_errors
                std = math.sqrt(max(estimate.std**2 - gain**2, 0.0))
                promise = Promise(largest, errors[largest], std, is_assumed)
        residual, by_name = math.sqrt(max(estimate.std**2 - explained**2, 0.0)), {key.name: parts[key] for key in parts}
        result.append(Budget(estimate, by_name, estimate.scatter_std, residual, promise))
    return result


def _part(estimate: Estimate, without: Estimate | None) -> float:
    """Return the standard error that goes with an error; 0 where none does."""
    if without is None or without.status is Status.INVALID:
        return 0.0
    variance = estimate.std**2 - without.std**2
    return math.sqrt(variance) if variance > 1e-6 * estimate.std**2 else 0.0


def _estimators_of(result: RevolutionResult) -> tuple[str, ...]:
    """Return the estimators of a result: a later one that gives the same quantities prefixes its name to them."""
    names = {estimate.name for estimate in result.estimates}
    return tuple(_estimators_in(names))


def _estimators_in(names: set[str]) -> Iterator[str]:
    listed: set[str] = set()
    for estimator, quantities in CATALOGUE.items():
        distinct = {
            f"{estimator}:{quantity.name}" if quantity.name in listed else quantity.name for quantity in quantities
        }
        if distinct <= names:
            listed |= {quantity.name for quantity in quantities}
            yield estimator
        elif distinct & names and not any(quantity.name in listed for quantity in quantities):
            # One that gives fewer where there is no axis or no statement for the others.
            yield estimator


def _latest(setup: WheelSetup, results: Sequence[RevolutionResult], estimators: Sequence[str]) -> dict[str, Estimate]:
    """Return the latest estimates of revolutions that are estimated again with a setup, by name."""
    tire = TireEstimates(setup, estimators)
    revolutions = [result.revolution for result in results]
    ends_us = [1e6 * (revolution.start_s + revolution.period_s) for revolution in revolutions]
    conditions = results[-1].conditions
    reading = Environment(conditions.pressure_pa, conditions.temperature_degc, None)
    for end_us in ends_us:
        tire.environment(int(end_us) - 1, reading, 0.0)
    hosts_ns = [result.host_ns for result in results]
    repeated = tire.take_block(RevolutionArrays(revolutions), ends_us, hosts_ns, [()] * len(results))
    return {estimate.name: estimate for estimate in repeated[-1].estimates}
