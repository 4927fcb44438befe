"""The least sensor that reaches the errors wanted: at each rate, the largest noise, by simulated drives."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from firmware_protocol.wire import MAX_RATE_HZ, MIN_RATE_HZ
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.planner.accelerometer import Accelerometer
from gateway.planner.planned_errors import plan_sensor, tire_at
from gateway.planner.wants import Want
from gateway.simulator.scenario_model import Scenario

RATES_HZ: Final = (*(MIN_RATE_HZ * 2.0**doubled for doubled in range(4)), float(MAX_RATE_HZ))
"""Rates that are tried, from below."""
NOISES_MG_RTHZ: Final = tuple(
    mantissa * 10.0**decade for decade in (-2, -1, 0, 1, 2) for mantissa in (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)
)
"""Noise densities that are tried, from below."""
# Trials of a rate, at most: the smallest noise, then bisection.
_TRIALS: Final = 1 + math.ceil(math.log2(len(NOISES_MG_RTHZ)))
# Range beyond the peak, in standard deviations of the noise.
_HEADROOM: Final = 5.0
# Rates that are tried beyond the least one: a faster sensor may be noisier.
_FASTER: Final = 1


@dataclass(frozen=True, slots=True)
class WorstError:
    """The quantity that is nearest to its largest error, or beyond it.

    Attributes:
        quantity: its name.
        speed_mps: where.
        error: root sum of squares of scatter and what stays; infinite where too few drives gave an estimate.
        wanted: its largest error.
    """

    quantity: str
    speed_mps: float
    error: float
    wanted: float

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
        on_share: called with the share of the trials that are done, 0 to 1, were every rate tried.
    """
    done = 0
    peak_g = max(tire_at(scenario, speed).peak_mps2 for speed in speeds_mps) / STANDARD_GRAVITY_MPS2

    def tried(rate_hz: float, noise_mg_rthz: float) -> tuple[float, WorstError]:
        range_g = peak_g + _HEADROOM * 1e-3 * noise_mg_rthz * math.sqrt(0.5 * rate_hz)
        sensor = Accelerometer(name="least", range_g=range_g, rate_hz=rate_hz, noise_mg_rthz=noise_mg_rthz)
        worst: WorstError | None = None
        nonlocal done
        for speed_mps in speeds_mps:
            on_share(done / (len(RATES_HZ) * _TRIALS * len(speeds_mps)))
            done += 1
            plan = plan_sensor(scenario, sensor, speed_mps, wheels=wheels, seed=seed)
            errors = {
                error.quantity: math.hypot(error.scatter, error.stays)
                for error in plan.errors
                # Drives without an estimate would make the others look better than the sensor is.
                if error.revolutions == revolutions and error.wheels == wheels
            }
            for want in wants:
                error = WorstError(want.quantity, speed_mps, errors.get(want.quantity, math.inf), want.error)
                worst = error if worst is None or error.share > worst.share else worst
            if worst is not None and worst.share > 1.0:
                break
        assert worst is not None, "no error is wanted"
        return range_g, worst

    enough = 0
    for index, rate_hz in enumerate(RATES_HZ):
        done = index * _TRIALS * len(speeds_mps)
        least = largest_noise(rate_hz, tried)
        yield least
        enough += least.reached
        if enough > _FASTER:
            return


def largest_noise(rate_hz: float, tried: Callable[[float, float], tuple[float, WorstError]]) -> LeastSensor:
    """Return the largest noise that reaches the errors at a rate: bisection, as errors grow with the noise."""
    range_g, worst = tried(rate_hz, NOISES_MG_RTHZ[0])
    if worst.share > 1.0:
        return LeastSensor(rate_hz, math.nan, math.nan, worst)
    reached, missed = 0, len(NOISES_MG_RTHZ)
    while missed - reached > 1:
        middle = (reached + missed) // 2
        next_range_g, next_worst = tried(rate_hz, NOISES_MG_RTHZ[middle])
        if next_worst.share <= 1.0:
            reached, range_g, worst = middle, next_range_g, next_worst
        else:
            missed = middle
    return LeastSensor(rate_hz, range_g, NOISES_MG_RTHZ[reached], worst)
