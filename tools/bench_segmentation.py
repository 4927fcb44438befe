"""Contacts found in wheels made by independent formulas: missed and false ones, exactness, cost.

Run `python tools/bench_segmentation.py`; `--count 60` takes some minutes and gives the figures of
docs/explanation/segmentation.md. Every row is a family of wheels drawn at random: radius 0.25 to 0.55 m, contact half
angle 0.08 to 0.5 rad, 2 to 25.6 kHz, either sign, AC- or DC-coupled, gain, offset, bandwidth, noise up to
15 mg/sqrt(Hz) unless stated.
"""

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from gateway.core.contacts.segmentation import find_contacts
from gateway.core.types import FloatArray
from tools.generators.segmentation_signals import MEASURED, Case, judge, make_signal, segment

Rng = np.random.Generator
Draw = Callable[[Rng], dict[str, object]]

RATES_HZ = (2000.0, 3200.0, 4800.0, 6400.0, 9600.0, 12800.0, 25600.0)


def wheel(seed: int, draw: Draw) -> Case:
    """Draw a wheel, a sensor and the properties of the family."""
    rng = np.random.default_rng(seed)
    shapes = ("ring", "packets", "measured") if MEASURED.exists() else ("ring", "packets")
    shape = str(rng.choice(shapes))
    ac = rng.random() < 0.4
    case = Case(
        rate_hz=float(rng.choice(RATES_HZ)),
        radius_m=float(rng.uniform(0.25, 0.55)),
        half_rad=float(rng.uniform(0.1, 0.3) if shape == "measured" else rng.uniform(0.08, 0.5)),
        shape=shape,
        density_mg=log(rng, 0.125, 15.0),
        highpass_hz=log(rng, 0.05, 2.0) if ac else 0.0,
        highpass_order=int(rng.choice((1, 2))),
        lowpass_hz=float(rng.choice((0.0, 500.0, 1000.0, 2000.0))),
        offset_g=0.0 if ac else float(rng.uniform(-5.0, 5.0)),
        gain=float(rng.uniform(0.9, 1.1)),
        sign=int(rng.choice((-1, 1))),
        seed=seed,
    )
    for name, value in draw(rng).items():
        setattr(case, name, value)
    return case


def log(rng: Rng, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def ramp(start: float, end: float, acceleration: float) -> Callable[[FloatArray], FloatArray]:
    low, high = sorted((start, end))
    return lambda t: np.clip(start + np.sign(end - start) * acceleration * 3.6 * t, low, high)


def knots(times: object, speeds: object) -> Callable[[FloatArray], FloatArray]:
    return lambda t: np.interp(t, times, speeds)  # type: ignore[call-overload, no-any-return]


def steady(low: float, high: float, duration_s: float, **more: tuple[float, float]) -> Draw:
    """Constant speed and further properties, each between two bounds."""

    def draw(rng: Rng) -> dict[str, object]:
        drawn = {name: float(rng.uniform(*bounds)) for name, bounds in more.items()}
        return {"kmh": float(rng.uniform(low, high)), "duration_s": duration_s, **drawn}

    return draw


def moving(speed: Callable[[FloatArray], FloatArray], duration_s: float) -> Draw:
    return lambda _: {"kmh": speed, "duration_s": duration_s}


def town(rng: Rng, *, stops: float = 0.0, impacts: float = 0.0) -> dict[str, object]:
    """Speeds of 10 to 70 km/h every 2 to 6 s, joined by straight lines: up to 8 m/s^2, with jumps of it."""
    times = np.cumsum(rng.uniform(2.0, 6.0, 12))
    speeds = np.where(rng.random(12) < stops, 0.0, rng.uniform(10.0, 70.0, 12))
    road = float(rng.uniform(0.0, 3.0))
    return {"kmh": knots(times, speeds), "duration_s": 30.0, "road_mps2": road, "impacts_per_s": impacts}


def clipped(rng: Rng) -> dict[str, object]:
    """A range of 0.35 to 1.5 times R Omega^2."""
    kmh = float(rng.uniform(20.0, 250.0))
    return {"kmh": kmh, "duration_s": 3.0, "range_g": max(16.0, (kmh / 3.6) ** 2 / 4.0 * float(rng.uniform(0.35, 1.5)))}


def turning(rng: Rng) -> dict[str, object]:
    kmh = float(rng.uniform(5.0, 25.0))
    back = 6.0 + 2.0 * kmh / 3.6 / float(rng.uniform(1.0, 6.0))
    return {"kmh": knots([0.0, 6.0, back, 40.0], [kmh, kmh, -kmh, -kmh]), "duration_s": back + 6.0}


FAMILIES: dict[str, Draw] = {
    "10 to 20 km/h": steady(10.0, 20.0, 8.0),
    "20 to 100 km/h": steady(20.0, 100.0, 4.0),
    "100 to 250 km/h": steady(100.0, 250.0, 2.5),
    "0 to 250 km/h at 3 m/s2": moving(ramp(0.0, 250.0, 3.0), 24.0),
    "120 to 0 km/h at 3 m/s2": moving(ramp(120.0, 0.0, 3.0), 14.0),
    "200 to 0 km/h at 8 m/s2": moving(ramp(200.0, 0.0, 8.0), 10.0),
    "stop and start": moving(knots([0, 3, 6, 12, 15, 20], [40, 40, 0, 0, 30, 30]), 20.0),
    "town, up to 8 m/s2": town,
    "town, stops, impacts": lambda rng: town(rng, stops=0.3, impacts=0.4),
    "70 mg, 10 to 25 km/h": steady(10.0, 25.0, 8.0, density_mg=(70.0, 70.0)),
    "20 to 70 mg, faster": steady(25.0, 250.0, 4.0, density_mg=(20.0, 70.0)),
    "road 5 to 20, 10 to 30": steady(10.0, 30.0, 6.0, road_mps2=(5.0, 20.0)),
    "road 5 to 20, faster": steady(30.0, 250.0, 4.0, road_mps2=(5.0, 20.0)),
    "impacts, 10 to 40 km/h": steady(10.0, 40.0, 8.0, impacts_per_s=(0.3, 1.5)),
    "impacts, faster": steady(40.0, 250.0, 6.0, impacts_per_s=(0.5, 2.0)),
    "1 % of frames lost": steady(15.0, 250.0, 5.0, loss=(0.01, 0.01)),
    "5 % of frames lost": steady(15.0, 250.0, 5.0, loss=(0.05, 0.05)),
    "bursts of 2 to 12 frames": steady(15.0, 250.0, 6.0, burst=(0.004, 0.004)),
    "clipped": clipped,
    "creeping below 9.5 km/h": steady(0.5, 9.5, 20.0),
    "turning back": turning,
    "standing": steady(0.0, 0.0, 8.0, density_mg=(0.125, 70.0)),
}


def row(name: str, draw: Draw, count: int) -> str:
    """Roll a family and summarise the results."""
    verdicts = []
    for seed in range(count):
        signal = make_signal(wheel(1000 * (1 + list(FAMILIES).index(name)) + seed, draw))
        verdicts.append(judge(signal, segment(signal)[0]))
    due = sum(v.due for v in verdicts)
    missed, false = sum(v.missed for v in verdicts), sum(v.false for v in verdicts)
    centre = np.concatenate([np.abs(v.centre_percent) for v in verdicts]) if verdicts else np.empty(0)
    z = [float(np.sqrt(np.mean(np.square(v.z)))) for v in verdicts if v.z]
    bias = [abs(v.bias_percent) for v in verdicts if v.z]
    exact = (
        f"{np.percentile(centre, 95):7.3f} {centre.max():7.2f} {np.percentile(bias, 95):7.3f} "
        f"{np.median(z):5.2f} {np.percentile(z, 90):6.2f}"
        if len(centre)
        else ""
    )
    return (
        f"{name:26} {due:6d} {missed:6d} {100.0 * missed / max(due, 1):6.2f} {false:6d} "
        f"{sum(v.predicted for v in verdicts):6d}  {exact}"
    )


def costs() -> list[str]:
    """CPU time of the segmenter at 9600 Hz."""
    lines = []
    for kmh in (20.0, 65.0, 200.0):
        signal = make_signal(Case(kmh=kmh, duration_s=20.0, seed=3))
        begin = time.process_time()
        pairs = segment(signal)[0]
        each_us = 1e6 * (time.process_time() - begin) / len(pairs)
        window = signal.radial_mps2[: round(3.0 * 9600)]
        begin = time.process_time()
        for _ in range(20):
            find_contacts(window, 9600.0)
        search_ms = 1e3 * (time.process_time() - begin) / 20
        lines.append(
            f"{kmh:5.0f} km/h {each_us:8.0f} us a revolution, first search included {search_ms:8.2f} ms a search"
        )
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=6, help="wheels a family")
    parser.add_argument("--family", action="append", choices=list(FAMILIES), help="only these")
    arguments = parser.parse_args()
    print(f"{arguments.count} wheels a family; centre and speed bias in % of the period, z = error / stated error")
    print(f"{'family':26} {'due':>6} {'missed':>6} {'%':>6} {'false':>6} {'placed':>6}  ", end="")
    print(f"{'95 %':>7} {'worst':>7} {'bias':>7} {'z':>5} {'z 90 %':>6}")
    for name in arguments.family or FAMILIES:
        print(row(name, FAMILIES[name], arguments.count), flush=True)
    print(*costs(), sep="\n")


if __name__ == "__main__":
    main()
