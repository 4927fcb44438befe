"""Print how many rates of pressure loss are valid, and how many of those are false, on random fleets with a leak.

    python tools/bench_leaks.py [FLEETS]

The generator shares nothing with `gateway.fleet.trends`: it integrates the moles of gas in four tires, each with its
own permeation and one with a hole, through a season of weather with parked and driven temperatures. Of 60 recordings,
the last one to ten are after the begin of the leak. Some fleets have sensors without a temperature, whose pressures
follow the weather; some measure against vacuum; drivers fill up all wheels or one, and holes were mended before.
"""

import math
import sys
from collections import Counter
from pathlib import Path
from typing import Final, NamedTuple

if __name__ == "__main__":  # started by its path
    sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from gateway.core.estimates.estimator import Status
from gateway.core.types import FloatArray
from gateway.fleet.trends.fleet_analysis import analyse
from gateway.fleet.trends.tire_history import MONTH_NS, TireHistory
from gateway.fleet.trends.trend_result import Quantity, TrendNumber

COUNT: Final = 60
WHEELS: Final = ("FL", "FR", "RL", "RR")
_MONTH_DAYS: Final = MONTH_NS / 86_400e9
_NORMAL_KPA: Final = 101.325
_STEP_DAYS: Final = 0.02
_FALSE_ERRORS: Final = 3.5
# A leak that has let out less than this many scatters of a recording is not visible in any of them.
_VISIBLE: Final = 3.0


class LeakyFleet(NamedTuple):
    """Four wheels: (4,) true losses in kPa a month at the last recording; what the leak has let out, in scatters."""

    histories: list[TireHistory]
    losses_kpa: FloatArray
    let_out: float
    kpa_a_day: float


def _flow(absolute_kpa: float, ambient_kpa: float) -> float:
    """Return the flow of air through a nozzle over its choked flow at 1 kPa (ISO 9300, gamma 1.4)."""
    ratio = min(ambient_kpa / absolute_kpa, 1.0)
    if ratio <= 0.5283:
        return absolute_kpa
    return absolute_kpa * math.sqrt(max(ratio ** (2 / 1.4) - ratio ** (2.4 / 1.4), 0.0)) / 0.25882


def _wandering(rng: np.random.Generator, days: int, std: float) -> FloatArray:
    """Return (days + 2,) values of weather."""
    values = [rng.normal(0.0, std)]
    for _ in range(days + 1):
        values.append(0.8 * values[-1] + 0.6 * rng.normal(0.0, std))
    return np.array(values)


def leaky_fleet(seed: int, after: int) -> LeakyFleet:
    """Return a fleet whose first wheel, by chance any, leaks since a time before the last recordings; 0 for none."""
    rng = np.random.default_rng([4711, seed])
    days = np.sort(rng.uniform(0.0, float(rng.choice([45, 90, 180])), COUNT))
    span, leaking = math.ceil(days[-1]), int(rng.integers(4))
    share, kpa_a_day = float(rng.uniform()), float(10.0 ** rng.uniform(0.0, 1.3))
    begin = days[-after - 1] + share * (days[-after] - days[-after - 1]) if after else math.inf
    air_degc = (
        rng.uniform(-5, 25) + 8 * np.sin(np.arange(span + 2) / 58.0 + rng.uniform(0, 6)) + _wandering(rng, span, 3.0)
    )
    ambient = rng.choice([_NORMAL_KPA, 95.0]) + _wandering(rng, span, 0.8)
    placard = rng.uniform(190.0, 290.0)
    cold = placard + rng.uniform(-8.0, 8.0, 4)
    permeation = rng.uniform(0.0, 2.5, 4) / _MONTH_DAYS / 220.0
    hole = kpa_a_day / _flow(placard + _NORMAL_KPA, _NORMAL_KPA)
    # An earlier hole, mended with a refill.
    old = tuple(np.sort(rng.uniform(0.1, 0.7, 2)) * days[-1]) if rng.random() < 0.15 else (math.inf, math.inf)
    old_hole = rng.uniform(0.3, 2.0) / 300.0
    fills = [(float(day), int(rng.integers(5))) for day in rng.uniform(0.0, days[-1], int(rng.integers(0, 4)))]
    no_degc, is_absolute, follows = rng.random() < 0.2, rng.random() < 0.5, rng.random() < 0.1
    noise, degc_noise = rng.uniform(0.2, 0.8), rng.uniform(0.05, 0.4)
    warm = 273.15 + np.stack([np.interp(days, np.arange(span + 2), air_degc) + rng.uniform(8.0, 25.0, COUNT)] * 4)
    warm += rng.normal(0.0, 0.7, (4, COUNT))
    moles = (cold + _NORMAL_KPA) / 293.15  # pressure over temperature, at one volume
    at_begin = moles.copy()
    seen = np.empty((4, COUNT))
    time = float(days[0])
    for number, day in enumerate(days):
        while time < day:
            step = min(_STEP_DAYS, day - time)
            kelvin, outside = 273.15 + np.interp(time, np.arange(span + 2), air_degc), ambient[int(time)]
            moles -= step * permeation * (moles * kelvin - outside) / kelvin
            for is_open, size in ((time >= begin, hole), (old[0] <= time < old[1], old_hole)):
                if is_open:
                    flow = _flow(float(moles[leaking] * kelvin), outside)
                    moles[leaking] -= step * size * flow * math.sqrt(kelvin / 293.15) / kelvin
            if time < begin <= time + step:
                at_begin = moles.copy()
            if time <= old[1] < time + step:
                moles[leaking] = (placard + _NORMAL_KPA) / 293.15
            for fill_time, which in fills:
                if time <= fill_time < time + step and (follows or fill_time < begin):
                    wanted = (placard + rng.uniform(-1.0, 6.0, 4) + outside) / kelvin
                    filled = np.maximum(moles, wanted)
                    moles = np.where((np.arange(4) == which) | (which == 4), filled, moles)
            time += step
        seen[:, number] = moles * warm[:, number] - (_NORMAL_KPA if is_absolute else ambient[int(day)])
    measured = np.maximum(seen + rng.normal(0.0, noise, seen.shape), 0.0)
    degc = np.full(seen.shape, 25.0) if no_degc else warm - 273.15 + rng.normal(0.0, degc_noise, seen.shape)
    # At the weather of the last day, as pressure at 20 °C.
    at_20 = 293.15 / kelvin * _MONTH_DAYS
    losses = permeation * (moles * kelvin - outside) * at_20
    if after:
        losses[leaking] += hole * _flow(float(moles[leaking] * kelvin), outside) * math.sqrt(kelvin / 293.15) * at_20
    let_out = (at_begin - moles)[leaking] * 293.15 if after else 0.0
    scatter = math.hypot(noise, 1.0 if no_degc else degc_noise)
    names = tuple(f"r{number:03d}" for number in range(COUNT))
    times_ns = np.round(days / _MONTH_DAYS * MONTH_NS).astype(np.int64)
    histories = [
        TireHistory(
            f"car {seed}", position, f"{seed:04d}{wheel}", names, names, times_ns,
            40.0 * days, True,
            {
                "pressure_pa": 1e3 * measured[wheel],
                "temperature_degc": degc[wheel],
                "pressure_measured": np.ones(COUNT),
                "revolutions": np.full(COUNT, 500.0),
            },
            {},
        )
        for wheel, position in enumerate(WHEELS)
    ]  # fmt: skip
    order = [leaking, *(wheel for wheel in range(4) if wheel != leaking)]
    return LeakyFleet([histories[wheel] for wheel in order], losses[order], float(let_out / scatter), kpa_a_day)


def _loss(fleet: LeakyFleet, used: int) -> tuple[TrendNumber, ...]:
    """Return the losses of the wheels by the first recordings."""
    keep = np.arange(COUNT) < used
    trends = analyse([history.chosen(keep, 1) for history in fleet.histories], recordings=4 * used)
    return tuple(
        next(number for number in tire.numbers if number.quantity == Quantity.PRESSURE_LOSS) for tire in trends.tires
    )


def counted(fleets: int, *, shows: bool = False) -> Counter[str]:
    """Return the counts over fleets with a leak of one to ten recordings, with one of ten, and without one."""
    counts: Counter[str] = Counter()
    for seed in range(fleets):
        for after in (1 + seed % 10, 10, 0):
            fleet = leaky_fleet(seed, after)
            losses = _loss(fleet, COUNT)
            for wheel, (loss, true_kpa) in enumerate(zip(losses, fleet.losses_kpa, strict=True)):
                kind = (
                    "tight" if wheel or not after else "leak" if fleet.let_out >= _VISIBLE else "leak, not visible yet"
                )
                is_valid = loss.status is Status.VALID
                is_false = is_valid and abs(loss.value - true_kpa) > _FALSE_ERRORS * loss.std
                counts[f"{kind}: wheels"] += 1
                counts[f"{kind}: valid rate"] += is_valid
                counts[f"{kind}: false rate"] += is_false
                if shows and (is_false or (kind == "leak" and not is_valid and after > 3)):
                    print(
                        "FALSE" if is_false else "not valid", seed, kind, after, f"{fleet.kpa_a_day:.1f} a day, "
                        f"{fleet.let_out:.1f} scatters, true {true_kpa:.2f}: {loss.value:.2f} ± {loss.std:.2f}",
                        *(reason.code.name for reason in loss.reasons),
                    )  # fmt: skip
        fleet = leaky_fleet(seed, 10)
        within = any(_loss(fleet, used)[0].status is Status.VALID for used in range(COUNT, COUNT - 7, -1))
        counts["leak: valid rate within ten recordings"] += within
        counts["leak: fleets"] += 1
    return counts


if __name__ == "__main__":
    for name, count in sorted(counted(int(sys.argv[1]) if len(sys.argv) > 1 else 200, shows="-v" in sys.argv).items()):
        print(f"{count:6d}  {name}")
