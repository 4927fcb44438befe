"""The least sensor that reaches the errors wanted: at each rate, the largest noise, by simulated drives."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce
from itertools import dropwhile
from statistics import median
from typing import Final

from firmware_protocol.wire import MAX_RATE_HZ, MIN_RATE_HZ
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.estimates.estimator import Status
from gateway.core.estimates.results import RevolutionResult
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.planner.accelerometer import Accelerometer
from gateway.planner.planned_errors import driven, sampling_rate_hz, tire_at
from gateway.planner.uncertainty_budget import SOURCES, Budget, Source, budgets
from gateway.planner.wants import Want
from gateway.simulator.scenario_model import Scenario

RATES_HZ: Final = (*(MIN_RATE_HZ * 2.0**doubled for doubled in range(4)), float(MAX_RATE_HZ))
"""Rates that are tried, from below."""
NOISES_MG_RTHZ: Final = tuple(
    mantissa * 10.0**decade for decade in (-2, -1, 0, 1, 2) for mantissa in (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)
)
"""Noise densities that are tried, from below."""
Drives = tuple[WheelSetup, list[list[RevolutionResult]]]
"""What is stated of a wheel, and the revolutions of its drives."""
# Trials of a rate, at most: the smallest noise, then bisection.
_TRIALS: Final = 1 + math.ceil(math.log2(len(NOISES_MG_RTHZ)))
# Range beyond the peak, in standard deviations of the noise.
_HEADROOM: Final = 5.0
# Rates that are tried beyond the least one: a faster sensor may be noisier.
_FASTER: Final = 1
# Rate of the sensor that statements are looked at with.
_QUIET_HZ: Final = 8000.0


@dataclass(frozen=True, slots=True)
class WorstError:
    """The quantity that is nearest to its largest error, or beyond it.

    Attributes:
        quantity: its name.
        speed_mps: where.
        error: standard error that will be printed, the median of the drives; infinite where most are not valid.
        wanted: its largest error.
        minutes: of driving from which on every error is printed as small as is wanted.
    """

    quantity: str
    speed_mps: float
    error: float
    wanted: float
    minutes: float = math.nan

    @property
    def share(self) -> float:
        """Error over what is wanted: 1 and less is reached."""
        return self.error / self.wanted


@dataclass(frozen=True, slots=True)
class LeastSensor:
    """What a sensor needs at one rate.

    Attributes:
        rate_hz: sampling rate.
        range_g: least range: the peak at the fastest speed, with the noise; NaN where the errors are not reached.
        noise_mg_rthz: largest noise density of `NOISES_MG_RTHZ`; NaN likewise.
        worst: with this noise, or without reach with the smallest.
    """

    rate_hz: float
    range_g: float
    noise_mg_rthz: float
    worst: WorstError

    @property
    def reached(self) -> bool:
        """Whether every error is reached at every speed."""
        return self.worst.share <= 1.0


def least_sensors(
    scenario: Scenario,
    wants: Sequence[Want],
    speeds_mps: Sequence[float],
    *,
    revolutions: int,
    wheels: int,
    seed: int = 0,
    better: Sequence[Source] = (),
    on_share: Callable[[float], None] = lambda _share: None,
) -> Iterator[LeastSensor]:
    """Yield what a sensor needs at each of `RATES_HZ`, up to one rate beyond the least that reaches every error.

    The sensor is DC coupled, with its whole band, 16 bit over its range, and neither gain error nor zero offset.

    Args:
        scenario: gives tire, load, pressure and disturbances.
        wants: largest errors.
        speeds_mps: at which each has to be reached.
        revolutions: after which, one of `AFTER`.
        wheels: simulated drives of each trial.
        seed: of the random numbers.
        better: statements that are made with their better errors.
        on_share: called with the share of the trials that are done, 0 to 1, were every rate tried.
    """
    trials_done = 0
    peak_g = _peak_g(scenario, speeds_mps)
    drive = drives_of(scenario, revolutions=revolutions, wheels=wheels, seed=seed, better=better)

    def tried(rate_hz: float, noise_mg_rthz: float) -> tuple[float, WorstError]:
        range_g = peak_g + _HEADROOM * 1e-3 * noise_mg_rthz * math.sqrt(0.5 * rate_hz)
        sensor = Accelerometer(name="least", range_g=range_g, rate_hz=rate_hz, noise_mg_rthz=noise_mg_rthz)
        return range_g, _worst_error(partial(drive, sensor), wants, speeds_mps, revolutions, show)

    def show() -> None:
        nonlocal trials_done
        on_share(trials_done / (len(RATES_HZ) * _TRIALS * len(speeds_mps)))
        trials_done += 1

    enough = 0
    for index, rate_hz in enumerate(RATES_HZ):
        trials_done = index * _TRIALS * len(speeds_mps)
        candidate = largest_noise(rate_hz, tried)
        yield candidate
        enough += candidate.reached
        if enough > _FASTER:
            return


def drives_of(
    scenario: Scenario, *, revolutions: int, wheels: int, seed: int = 0, better: Sequence[Source] = ()
) -> Callable[[Accelerometer, float], Drives]:
    """Return what drives a sensor at a speed; the arguments are as in `least_sensors`."""
    return partial(driven, scenario, wheels=wheels, seed=seed, revolutions=revolutions, statements=_improver(better))


def reaching_parts(
    least: LeastSensor,
    parts: Sequence[Accelerometer],
    wants: Sequence[Want],
    speeds_mps: Sequence[float],
    revolutions: int,
    drive: Callable[[Accelerometer, float], Drives],
) -> list[Accelerometer]:
    """Return the parts that reach the errors as `least` does, with band, gain and zero of their data sheets.

    A noise that is not known counts as none.
    """
    return [
        part
        for part in parts
        if part.range_g >= least.range_g
        and sampling_rate_hz(part) >= least.rate_hz
        and (part.noise_mg_rthz or 0.0) <= least.noise_mg_rthz
        and _worst_error(partial(drive, part), wants, speeds_mps, revolutions).share <= 1.0
    ]


def better_statements(
    scenario: Scenario, wants: Sequence[Want], speeds_mps: Sequence[float], *, revolutions: int
) -> tuple[list[Source], list[str]]:
    """Return the statements to make better so that a quiet sensor reaches the errors, and what each brings."""
    improved: list[Source] = []
    advice: list[str] = []
    short_drive = partial(driven, wheels=1, revolutions=revolutions)
    sensor = Accelerometer(
        name="quiet", range_g=2.0 * _peak_g(scenario, speeds_mps), rate_hz=_QUIET_HZ, noise_mg_rthz=NOISES_MG_RTHZ[0]
    )
    while True:
        failing: list[Budget | None] = []
        for speed_mps in speeds_mps:
            setup, (drive,) = short_drive(scenario, sensor, speed_mps, statements=_improver(improved))
            # A slow drive may give no revolution.
            by_name = {each.estimate.name: each for each in budgets(setup, drive[:revolutions])} if drive else {}
            unmet = [want for want in wants if not _std_in(by_name, want.quantity) <= want.error]
            failing += [by_name.get(want.quantity) for want in unmet]
        promise = next((budget.promise for budget in failing if budget is not None and budget.promise), None)
        if not failing or promise is None or promise.source in improved or len(improved) == len(SOURCES):
            return improved, advice
        improved.append(promise.source)
        advice.append(next(budget.advice for budget in failing if budget is not None and budget.promise is promise))


def _std_in(by_name: Mapping[str, Budget], name: str) -> float:
    return by_name[name].estimate.std if name in by_name else math.inf


def _improver(sources: Sequence[Source]) -> Callable[[WheelSetup], WheelSetup]:
    """Return what makes a setup with the better errors of statements."""
    return lambda setup: reduce(lambda varied, source: source.with_error(varied, source.better), sources, setup)


def _peak_g(scenario: Scenario, speeds_mps: Sequence[float]) -> float:
    return max(tire_at(scenario, speed).peak_mps2 for speed in speeds_mps) / STANDARD_GRAVITY_MPS2


def _worst_error(
    drive: Callable[[float], Drives],
    wants: Sequence[Want],
    speeds_mps: Sequence[float],
    revolutions: int,
    on_speed: Callable[[], None] = lambda: None,
) -> WorstError:
    """Return the worst error of a sensor's drives, by speed, up to the first speed at which one is not reached."""
    errors: list[WorstError] = []
    for speed_mps in speeds_mps:
        on_speed()
        setup, drives = drive(speed_mps)
        turn_min = 2.0 * math.pi * setup.radius_m / speed_mps / 60.0
        errors += [_printed_error(drives, want, speed_mps, revolutions, turn_min) for want in wants]
        if any(error.share > 1.0 for error in errors):
            break
    worst = max(errors, key=lambda error: error.share)
    return replace(worst, minutes=max(error.minutes for error in errors))


def _printed_error(
    drives: Sequence[Sequence[RevolutionResult]], want: Want, speed_mps: float, revolutions: int, turn_min: float
) -> WorstError:
    """Return the error of a quantity that most drives print after some revolutions."""
    rows = [
        [
            estimate.std if estimate.status is Status.VALID else math.inf
            for result in drive[:revolutions]
            for estimate in result.estimates
            if estimate.name == want.quantity
        ]
        for drive in drives
    ]
    complete = [row for row in rows if len(row) == revolutions] or [[math.inf] * revolutions]
    medians = [median(stds) for stds in zip(*complete, strict=True)]
    unmet = sum(1 for _ in dropwhile(lambda std: std <= want.error, reversed(medians)))
    return WorstError(want.quantity, speed_mps, medians[-1], want.error, turn_min * (unmet + 1))


def largest_noise(rate_hz: float, tried: Callable[[float, float], tuple[float, WorstError]]) -> LeastSensor:
    """Return the largest noise that reaches the errors at a rate: bisection, as errors grow with the noise."""
    range_g, worst = tried(rate_hz, NOISES_MG_RTHZ[0])
    if worst.share > 1.0:
        return LeastSensor(rate_hz, math.nan, math.nan, worst)
    reached_index, missed_index = 0, len(NOISES_MG_RTHZ)
    while missed_index - reached_index > 1:
        middle = (reached_index + missed_index) // 2
        next_range_g, next_worst = tried(rate_hz, NOISES_MG_RTHZ[middle])
        if next_worst.share <= 1.0:
            reached_index, range_g, worst = middle, next_range_g, next_worst
        else:
            missed_index = middle
    return LeastSensor(rate_hz, range_g, NOISES_MG_RTHZ[reached_index], worst)
