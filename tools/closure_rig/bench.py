"""Baseline of a case: a tire, a sensor and runs that the exact baseline model describes completely."""

import math
from dataclasses import dataclass, replace

import numpy as np

# As stiff as the closure's own ring; at 20 GN a belt stretches by a millionth.
EXTENSION_STIFFNESS_MN = 20_000.0
# With 2880, Bs and the tread's stiffness are 0.016 % too low and 0.07 % too high, a third of what a case's errors are.
RING_NODES = 5760
SAMPLE_RATE_HZ = 9600.0
REFERENCE_DEGC = 25.0
"""Temperature at which the simulator's gains hold."""


@dataclass(frozen=True, slots=True)
class Run:
    """One recording's conditions, all of them declared.

    Attributes:
        speed_kmh: mean; it drifts slightly.
        load_n: wheel load.
        pressure_kpa: gauge.
        temperature_degc: of sensor and inner liner.
        reverse: whether the tire rolls backwards.
    """

    speed_kmh: float
    load_n: float
    pressure_kpa: float
    temperature_degc: float = REFERENCE_DEGC
    reverse: bool = False


@dataclass(frozen=True, slots=True)
class Bench:
    """A tire, a sensor and a campaign without undeclared effects: undamped inextensible ring, no ply steer, flat road.

    Attributes:
        radius_mm: belt radius.
        numbers: Bs, Cw, Rs, Ts at `reference_kpa`.
        reference_kpa: pressure at which they hold.
        pressure_share: share of the sidewall's stiffness that grows with pressure.
        mass_kgpm: of the belt.
        tread_mpa: stiffness of the tread.
        offset_mm: of the sensor below the neutral layer, declared.
        rate_hz: sampling rate.
        noise_mg_rthz: density on circumferential, lateral, radial.
        lateral: lateral stiffnesses of the belt, by the scenario's keys.
        runs: recordings.
    """

    radius_mm: float
    numbers: tuple[float, float, float, float]
    reference_kpa: float
    pressure_share: float
    mass_kgpm: float
    tread_mpa: float
    offset_mm: float
    rate_hz: float
    noise_mg_rthz: tuple[float, float, float]
    lateral: dict[str, float]
    runs: tuple[Run, ...]

    @property
    def highest_baseline_mps2(self) -> float:
        """R Omega^2 of the fastest run."""
        return (max(run.speed_kmh for run in self.runs) / 3.6) ** 2 / (self.radius_mm * 1e-3)


def draw_bench(rng: np.random.Generator) -> Bench:
    """Return a passenger car tire, a sensor, and seven runs that separate speed, load, pressure and temperature."""
    paper = (3.0833e-3, 0.1953, 2.9740, 2.5289)
    spread = (0.35, 0.2, 0.25, 0.4)
    bs, cw, rs, ts = (value * math.exp(rng.uniform(-s, s)) for value, s in zip(paper, spread, strict=True))
    pressure, light, heavy = rng.uniform(190.0, 230.0), rng.uniform(2800.0, 4000.0), rng.uniform(4800.0, 6200.0)
    noise = 3.0 * 5.0 ** rng.uniform(0.0, 1.0)
    first, second, third = (noise * rng.uniform(0.8, 1.25, 3)).tolist()
    return Bench(
        radius_mm=float(rng.uniform(290.0, 345.0)),
        numbers=(bs, cw, rs, ts),
        reference_kpa=200.0,
        pressure_share=float(rng.uniform(0.2, 0.8)),
        mass_kgpm=float(rng.uniform(2.5, 5.0)),
        tread_mpa=float(70.0 * math.exp(rng.uniform(-0.4, 0.4))),
        offset_mm=float(rng.choice([0.0, rng.uniform(1.0, 6.0)])),
        rate_hz=SAMPLE_RATE_HZ,
        noise_mg_rthz=(first, second, third),
        lateral={
            "lateral_shear_stiffness_mn": float(1.6 * math.exp(rng.uniform(-0.3, 0.3))),
            "lateral_bending_stiffness_knm2": float(math.exp(rng.uniform(-0.5, 0.5))),
            "lateral_sidewall_stiffness_mpa": float(0.25 * math.exp(rng.uniform(-0.3, 0.3))),
            "lateral_tread_stiffness_mpa": float(8.0 * math.exp(rng.uniform(-0.3, 0.3))),
        },
        runs=(
            Run(50.0, light, pressure),
            Run(90.0, light, pressure),
            Run(65.0, heavy, pressure),
            Run(90.0, heavy, pressure),
            Run(65.0, light, pressure + rng.uniform(30.0, 50.0)),
            Run(85.0, light, pressure, temperature_degc=REFERENCE_DEGC + rng.uniform(30.0, 45.0)),
            Run(65.0, light, pressure, reverse=True),
        ),
    )


def draw_campaign(rng: np.random.Generator, *, warm: bool = False) -> Bench:
    """Return a tire, a sensor, and two or three runs whose speed, load, pressure and temperature differ at random.

    Args:
        rng: random numbers.
        warm: one run is made warm, for what only temperature shows.
    """
    bench = draw_bench(rng)
    light, heavy = bench.runs[0].load_n, bench.runs[2].load_n
    usual, higher = bench.runs[0].pressure_kpa, bench.runs[4].pressure_kpa
    first = Run(float(rng.uniform(40.0, 60.0)), light if rng.random() < 0.5 else heavy, usual)
    runs = [first]
    for _ in range(int(rng.integers(1, 3))):
        run = replace(first, speed_kmh=float(first.speed_kmh * rng.uniform(1.25, 1.8)))
        if rng.random() < 0.4:
            run = replace(run, load_n=heavy if first.load_n == light else light)
        if rng.random() < 0.2:
            run = replace(run, pressure_kpa=higher)
        if rng.random() < 0.25 or (warm and len(runs) == 1):
            run = replace(run, temperature_degc=REFERENCE_DEGC + float(rng.uniform(30.0, 45.0)))
        if rng.random() < 0.2:
            run = replace(run, reverse=True)
        runs.append(run)
    return replace(bench, runs=tuple(runs))
