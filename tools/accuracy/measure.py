"""Bias and standard deviation of every estimator in one case, with the Cramer-Rao bound."""

import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from accuracy.cases import RADIUS_M, REFERENCE_PA, RING_THICKNESS_MM, Case
from accuracy.chain import Turn, hello_of, turns_of
from accuracy.signals import samples_of, truth_of
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.registry import make_estimator
from gateway.core.estimates.revolution_block import extended
from gateway.core.estimates.tire_data import ReferenceNumbers, TireData
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.core.reasons import Reason
from gateway.core.revolutions.synchronous_average import RunningAverage
from gateway.planner.cramer_rao import cramer_rao, order_variance, relative_bounds, waveform_sensitivity
from gateway.ring.reference_tire import TABLE_3_NUMBERS

LONG = 100
# Of one revolution each, without averaging; after LONG revolutions the mean of theirs counts.
PER_REVOLUTION = ("kinematic",)
# A fit of these takes a second: fewer of them, and on the final average only.
SLOW = ("forward",)
# What may be 0 has no relative error: these are in mm, by this factor.
ABSOLUTE = {"wear_mm": 1.0, "sensor_offset_m": 1e3}


@dataclass(frozen=True, slots=True)
class Effort:
    """Number of revolutions and runs of a measurement.

    Attributes:
        clean: revolutions averaged without noise, for the bias of the method.
        single: revolutions estimated one by one.
        single_slow: likewise for slow estimators.
        runs: runs of LONG revolutions.
    """

    clean: int = 20
    single: int = 40
    single_slow: int = 12
    runs: int = 6


@dataclass(slots=True)
class Sample:
    """Errors of one quantity from one estimator, with the stated standard errors.

    Attributes:
        errors: estimate over truth minus 1, of the estimates that were given at all.
        stated: their stated standard errors, relative too.
        valid: how many were called valid.
        asked: how many were asked for.
    """

    errors: list[float] = field(default_factory=list)
    stated: list[float] = field(default_factory=list)
    valid: int = 0
    asked: int = 0

    def add(self, estimate: Estimate, truth: float) -> None:
        """Add an estimate; the error of ABSOLUTE quantities is in mm."""
        self.asked += 1
        self.valid += estimate.status is Status.VALID
        if math.isfinite(estimate.value):
            factor = ABSOLUTE.get(estimate.name, 1.0 / abs(truth) if truth else math.nan)
            self.errors.append((estimate.value - truth) * factor)
            self.stated.append(estimate.std * factor)

    @property
    def bias(self) -> float:
        """Mean error; NaN without estimates."""
        return float(np.mean(self.errors)) if self.errors else math.nan

    @property
    def std(self) -> float:
        """Standard deviation; NaN for fewer than three estimates."""
        return float(np.std(self.errors, ddof=1)) if len(self.errors) > 2 else math.nan

    @property
    def rms(self) -> float:
        """Root mean square error."""
        return float(np.sqrt(np.mean(np.square(self.errors)))) if self.errors else math.nan

    @property
    def worth(self) -> float:
        """Rms of the errors over their stated standard errors; 1 when these are right."""
        squares = [(e / s) ** 2 for e, s in zip(self.errors, self.stated, strict=True) if s > 0.0]
        return math.sqrt(sum(squares) / len(squares)) if squares else math.nan


@dataclass(slots=True)
class Outcome:
    """Results of one case. Keys are (estimator, quantity).

    Attributes:
        case: the case.
        clean: without noise.
        single: of one revolution.
        long: after LONG.
        bound: of one revolution, relative, by quantity.
        reasons: last reasons why an estimate was not valid, after LONG.
    """

    case: Case
    clean: dict[tuple[str, str], Sample] = field(default_factory=dict)
    single: dict[tuple[str, str], Sample] = field(default_factory=dict)
    long: dict[tuple[str, str], Sample] = field(default_factory=dict)
    bound: dict[str, float] = field(default_factory=dict)
    reasons: dict[tuple[str, str], tuple[Reason, ...]] = field(default_factory=dict)


def truths(case: Case) -> dict[str, float]:
    """Return the true value of every quantity that an estimator may give."""
    ring = truth_of(case)
    numbers = ring.numbers
    return {
        "speed_mps": case.speed_kmh / 3.6,
        "half_angle_rad": ring.half_angle_rad,
        "load_by_width_n": case.load_n,
        "wear_mm": case.wear_mm,
        "sensor_offset_m": case.offset_m,
        "Bs": numbers.Bs,
        "Cw": numbers.Cw,
        "Rs": numbers.Rs,
        "Ts": numbers.Ts,
        "Bs/Cw": numbers.Bs / numbers.Cw,
        "Rs/Cw": numbers.Rs / numbers.Cw,
        "Ts/Cw": numbers.Ts / numbers.Cw,
    }


def bounds(case: Case) -> dict[str, float]:
    """Return the relative Cramer-Rao bound of one revolution, for the base tire with unknown tread stiffness."""
    sensitivity = waveform_sensitivity(case.ring, case.load_n, case.pressure_pa, case.omega_radps, nodes=960)
    highest = math.floor(0.5 * case.rate_hz * sensitivity.period_s)
    variance = order_variance(
        sensitivity.period_s,
        case.noise_mg_rthz * 1e-3 * STANDARD_GRAVITY_MPS2,
        road_rms_mps2=case.road_rms_mps2,
        max_order=min(150, highest),
    )
    result = relative_bounds(sensitivity, cramer_rao(sensitivity, variance))
    # In mm, as it may be 0.
    result["wear_mm"] *= RING_THICKNESS_MM - case.wear_mm
    return result


def measure(case: Case, estimators: Sequence[str], effort: Effort) -> Outcome:
    """Return the results of the estimators in one case."""
    outcome = Outcome(case, bound=bounds(case))
    truth = truths(case)
    if case.acceleration_mps2:
        del truth["speed_mps"]  # a speed that changes has no mean that the revolutions share
    seed = zlib.crc32(f"{case.group} {case.name}".encode())
    clean = _turns(case, effort.clean, np.random.default_rng(seed), noise=False)
    _add(outcome.clean, _after(estimators, clean), truth)
    quick = [name for name in estimators if name not in SLOW]
    share, slow_share = (math.ceil(wanted / max(effort.runs, 1)) for wanted in (effort.single, effort.single_slow))
    for run in range(effort.runs):
        turns = _turns(case, LONG, np.random.default_rng([seed, run + 1]), noise=True)
        final = _after(estimators, turns)
        _add(outcome.long, final, truth)
        outcome.reasons |= {
            (name, e.name): e.reasons for name, result in final.items() for e in result if e.status is not Status.VALID
        }
        for index, turn in enumerate(turns[:share]):
            _add(outcome.single, _after(estimators if index < slow_share else quick, [turn]), truth)
    return outcome


def _turns(case: Case, revolutions: int, rng: np.random.Generator, *, noise: bool) -> list[Turn]:
    new = ReferenceNumbers(*TABLE_3_NUMBERS, pressure_pa=REFERENCE_PA)
    setup = WheelSetup(
        "bench",
        0,
        0,
        RADIUS_M,
        load_n=case.load_n,
        pressure_pa=case.pressure_pa,
        tire=TireData(ring_thickness_m=1e-3 * RING_THICKNESS_MM, reference=new),
    )
    samples = samples_of(case, revolutions, rng, noise=noise)
    turns = turns_of(samples.counts, hello_of(case.rate_hz, samples.range_mps2, 7), setup)
    usable = [turn for turn in turns if not turn.revolution.faults]
    return usable[:revolutions]


def _after(names: Sequence[str], turns: Sequence[Turn]) -> dict[str, tuple[Estimate, ...]]:
    """Return the estimates after these revolutions, made in the same way as by the pipeline."""
    estimators = [make_estimator(name) for name in names]
    average = RunningAverage(horizon_revolutions=LONG)
    history: dict[str, list[tuple[Estimate, ...]]] = {name: [] for name in names}
    for index, turn in enumerate(turns):
        latest = extended(average, turn.revolution)
        earlier: dict[str, dict[str, Estimate]] = {}
        conditions = replace(turn.conditions, given=earlier)
        for estimator in estimators:
            if estimator.name in SLOW and index < len(turns) - 1:
                continue
            result = estimator.update(turn.revolution, latest, conditions)
            earlier[estimator.name] = {estimate.name: estimate for estimate in result}
            history[estimator.name].append(_with_half_angle(result))
    return {name: _mean(result) if name in PER_REVOLUTION else result[-1] for name, result in history.items() if result}


def _with_half_angle(estimates: tuple[Estimate, ...]) -> tuple[Estimate, ...]:
    by_name = {estimate.name: estimate for estimate in estimates}
    leading, trailing = by_name.get("leading_edge_rad"), by_name.get("trailing_edge_rad")
    if leading is None or trailing is None or "half_angle_rad" in by_name:
        return estimates
    half = Estimate(
        "half_angle_rad",
        0.5 * (trailing.value - leading.value),
        0.5 * math.hypot(leading.std, trailing.std),
        leading.status,
        leading.reasons,
    )
    return (*estimates, half)


def _mean(history: list[tuple[Estimate, ...]]) -> tuple[Estimate, ...]:
    """Return the mean over revolutions of estimates that are made from single revolutions."""
    rows = []
    for column in zip(*history, strict=True):
        values = [estimate.value for estimate in column if math.isfinite(estimate.value)]
        mean = float(np.mean(values)) if values else math.nan
        rows.append(Estimate(column[0].name, mean, column[-1].std, column[-1].status, column[-1].reasons))
    return tuple(rows)


def _add(
    into: dict[tuple[str, str], Sample], result: Mapping[str, Sequence[Estimate]], truth: dict[str, float]
) -> None:
    for name, estimates in result.items():
        for estimate in estimates:
            if estimate.name in truth:
                into.setdefault((name, estimate.name), Sample()).add(estimate, truth[estimate.name])
