"""Print times to the pressure warning and false warnings over the ambient temperature, on random drives.

    python tools/bench_pressure_warning.py [DRIVES]

The generator shares nothing with `gateway.inflation`: it integrates the moles of gas and the temperatures of air and
liner of a rolling tire, with sun, hills and a sensor with a zero error, noise, steps and a lag. A drive begins cold, as
UN R141, Annex 3, 2 wants it, or after a stop with warm tires.
"""

import sys
from pathlib import Path
from typing import Final, NamedTuple

if __name__ == "__main__":  # started by its path
    sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from gateway.core.estimates.results import WheelSnapshot, WheelState
from gateway.inflation.placard import Placard
from gateway.inflation.pressure_warning import LOW, PressureWarning

AMBIENT_DEGC: Final = (-20.0, 0.0, 20.0, 40.0, 60.0)
_SEA_KPA: Final = 101.325


class Drive(NamedTuple):
    """Second by second: temperature and gauge pressure as measured; share of the warm pressure that is lost.

    Attributes:
        degc: (n,) measured temperature.
        kpa: (n,) measured gauge pressure.
        lost: (n,) true loss over the warm pressure, of what was inflated to the placard.
        speed_mps: (n,) of the car.
        placard_kpa: cold pressure.
        inflated_degc: temperature of the tire when it was inflated.
    """

    degc: np.ndarray
    kpa: np.ndarray
    lost: np.ndarray
    speed_mps: np.ndarray
    placard_kpa: float
    inflated_degc: float


def drive(
    seed: int, ambient_degc: float, kind: str, *, starts_warm: bool = False, inflated_degc: float | None = None
) -> Drive:
    """Return an hour of driving of one tire.

    Args:
        seed: of all chances.
        ambient_degc: air and cold tire.
        kind: `puncture`: a hole lets out 20 % and more in one to five minutes; `leak`: in 10 to 40 min; `diffusion`:
            20 % and 7 kPa are lost before the drive; `low`: 10 %; `healthy`: nothing.
        starts_warm: a stop of some minutes before.
        inflated_degc: temperature at which it was inflated; that of the ambient when None.
    """
    rng = np.random.default_rng([141, seed])
    seconds = 4500
    placard = float(rng.uniform(190.0, 340.0))
    inflated = ambient_degc if inflated_degc is None else inflated_degc
    speed = np.clip(
        rng.choice([14.0, 22.0, 33.0]) + 5.0 * np.sin(np.arange(seconds) / rng.uniform(60, 400)), 11.0, 42.0
    )
    speed[: int(rng.integers(5, 60))] = 0.0
    # Heat of rolling against convection; the liner follows the rubber, the air follows liner and rim.
    rise, minutes = rng.uniform(0.45, 0.8), rng.uniform(12.0, 22.0)
    sun = rng.uniform(0.0, 8.0) if ambient_degc > 0.0 else 0.0
    liner = air = ambient_degc + (sun if not starts_warm else rise * 25.0 + rng.uniform(0.0, 10.0))
    moles = (placard + _SEA_KPA) / (inflated + 273.15)
    whole, start, hole_s = moles, int(rng.integers(600, 1500)), rng.uniform(60.0, 300.0)
    if kind in ("diffusion", "low"):
        kelvin = air + 273.15
        warm = whole * kelvin - _SEA_KPA
        part = 0.8 * warm - 7.0 if kind == "diffusion" else 0.9 * warm
        moles = (part + _SEA_KPA) / kelvin
    if kind == "leak":
        hole_s, start = rng.uniform(600.0, 2400.0), 300
    height_m = np.cumsum(np.sin(np.arange(seconds) / rng.uniform(300, 900)) * rng.uniform(-0.8, 0.8))
    outside = _SEA_KPA * np.exp(-np.clip(height_m, -300.0, 1800.0) / 8400.0)
    zero, step, noise = rng.uniform(-2.5, 2.5), rng.choice([0.1, 1.0, 2.5]), rng.uniform(0.1, 0.8)
    absolute_degc_zero = rng.uniform(-2.0, 2.0)
    degc, kpa, lost = np.empty(seconds), np.empty(seconds), np.empty(seconds)
    lag_degc = liner
    for second in range(seconds):
        target = ambient_degc + (rise * speed[second] if speed[second] else 0.3 * sun)
        liner += (target - liner) / (60.0 * minutes)
        air += (0.75 * liner + 0.25 * ambient_degc - air) / 180.0
        lag_degc += (liner - lag_degc) / 20.0
        kelvin = air + 273.15
        if kind in ("puncture", "leak") and second >= start and whole - moles < 0.45 * whole:
            moles -= 0.2 * (1.0 - _SEA_KPA / (whole * kelvin)) * whole / hole_s
        gauge = moles * kelvin - outside[second]
        lost[second] = 1.0 - (moles * kelvin - _SEA_KPA) / (whole * kelvin - _SEA_KPA)
        kpa[second] = gauge + zero
        degc[second] = lag_degc + absolute_degc_zero
    kpa = step * np.round((kpa + rng.normal(0.0, noise, seconds)) / step)
    degc = np.round(degc + rng.normal(0.0, 0.2, seconds))
    return Drive(degc, kpa, lost, speed, placard, inflated)


def warned(driven: Drive, *, states_temperature: bool) -> tuple[int | None, str]:
    """Return the second of the warning, None without one, and the course that it tells."""
    degc = driven.inflated_degc if states_temperature else None
    watch = PressureWarning({"FL": (Placard(1e3 * driven.placard_kpa, temperature_degc=degc), 0.0)})
    for second, (kpa, temperature, speed) in enumerate(zip(driven.kpa, driven.degc, driven.speed_mps, strict=True)):
        state = WheelState.ROLLING if speed > 0.0 else WheelState.STANDSTILL
        wheel = WheelSnapshot("FL", state=state, pressure_pa=1e3 * kpa, temperature_degc=float(temperature))
        watch.take(wheel, float(second), is_current=True)
        for alarm in watch.alarms():
            if alarm.name == LOW:
                return second, str(alarm.reason["course"])
    return None, ""


class Row(NamedTuple):
    """Drives that warn, of those drives the ones of the right course; minutes after 20 %, and loss at the warning."""

    warned: int
    named: int
    minutes: np.ndarray
    lost: np.ndarray


def measured(kind: str, ambient_degc: float, drives: int, *, states_temperature: bool, **how) -> Row:
    """Return the row of a kind of drives."""
    minutes, lost, named = [], [], 0
    for seed in range(drives):
        driven = drive(seed, ambient_degc, kind, **how)
        second, course = warned(driven, states_temperature=states_temperature)
        if second is None:
            continue
        reached = np.flatnonzero(driven.lost >= 0.2)
        driving = np.cumsum(driven.speed_mps > 0.0) / 60.0
        minutes.append(driving[second] - driving[reached[0]] if reached.size else np.nan)
        lost.append(driven.lost[second])
        named += course == ("fast" if kind == "puncture" else "slow")
    return Row(len(lost), named, np.array(minutes), np.array(lost))


def main(drives: int) -> None:
    """Print the table."""
    cases = (
        ("puncture, cold start", "puncture", {}),
        ("puncture, warm start", "puncture", {"starts_warm": True}),
        ("diffusion, cold start", "diffusion", {}),
        ("diffusion, warm start", "diffusion", {"starts_warm": True}),
        ("leak in 10 to 40 min", "leak", {}),
        ("healthy, inflated at ambient", "healthy", {}),
        ("healthy, warm start", "healthy", {"starts_warm": True}),
        ("healthy, inflated at 20 °C", "healthy", {"inflated_degc": 20.0}),
        ("10 % low", "low", {}),
    )
    for states in (True, False):
        print(f"\ntemperature of the inflation {'' if states else 'not '}stated; of {drives} drives: warned, of these")
        print("named rightly, longest time from 20 % to the warning, losses at the warning")
        print(f"{'':30}" + "".join(f"{degc:>26.0f} °C" for degc in AMBIENT_DEGC))
        for label, kind, how in cases:
            cells = []
            for degc in AMBIENT_DEGC:
                row = measured(kind, degc, drives, states_temperature=states, **how)
                is_fault = row.warned > 0 and kind not in ("healthy", "low")
                named = f" {row.named:3d} named" if kind in ("puncture", "diffusion") else ""
                late = f" {np.nanmax(row.minutes):5.1f} min" if is_fault else ""
                lost = f" {100 * row.lost.min():.0f}-{100 * row.lost.max():.0f} %" if row.warned else ""
                cells.append(f"{row.warned:d}{named}{late}{lost}")
            print(f"{label:30}" + "".join(f"{cell:>29}" for cell in cells))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 50)
