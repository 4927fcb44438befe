"""Print the findings of trends on random healthy fleets, and how many planted faults they find.

    python tools/bench_fleets.py [HEALTHY [FIRST_SEED [PLANTED]]]

A fleet is a vehicle with four sensors and sixty recordings in 45 to 180 days. The generator shares nothing with
`gateway.fleet.trends`. Every fleet has what is no fault: persons and luggage, trips in the mountains, weather and its
pressure, warm tires, drivers who fill up, several recordings on a day, roads that excite more or less, wear, rubber
that ages, sensors that resolve 0.1 to 2.5 kPa and 1 K, lost samples in tunnels, errors of the load that go with the
speed. A fault is planted in one wheel; the others are healthy.
"""

import math
import sys
from collections import Counter
from pathlib import Path
from typing import Any, Final, NamedTuple

if __name__ == "__main__":  # started by its path
    sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from gateway.core.text.wording import text
from gateway.core.types import FloatArray
from gateway.fleet.trends.fleet_analysis import analyse
from gateway.fleet.trends.tire_history import MONTH_NS, TireHistory

COUNT: Final = 60
WHEELS: Final = ("FL", "FR", "RL", "RR")
_MONTH_DAYS: Final = MONTH_NS / 86_400e9
_SEA_KPA: Final = 101.325
# Words of the codes of findings that tell a fault.
FAULTS: Final = {
    "slow leak": "LOSES_PRESSURE LOSS_CHANGED PRESSURE_FELL",
    "leak from a date on": "LOSES_PRESSURE LOSS_CHANGED PRESSURE_FELL",
    "fast wear": "WEARS_FAST WEARS_SHORT WEAR_CHANGED",
    "load of a wheel steps": "LEVEL_CHANGED estimated_load_n",
    "noise grows tenfold": "SENSOR_NOISE noise_mps2",
    "gain steps by -2 %": "SENSOR_GAIN gain",
    "pressure sensor sticks": "PRESSURE_STUCK",
    "sensor comes loose": "SENSOR_MOVES mounting_offset_m",
    "samples are lost": "SENSOR_LOSSES samples_lost",
    "sidewall softens": "STIFFNESS_DRIFTS Rs",
}
"""Planted faults."""


class Fault(NamedTuple):
    """A fault of the first wheel: what it is, and when it begins, as a share of the time."""

    name: str = ""
    begin: float = 0.0


def _weather(rng: np.random.Generator, days: int, std: float) -> FloatArray:
    """Return (days + 2,) values that follow each other by days."""
    values = [rng.normal(0.0, std)]
    for _ in range(days + 1):
        values.append(0.8 * values[-1] + 0.6 * rng.normal(0.0, std))
    return np.array(values)


def _pressures(rng: np.random.Generator, days: FloatArray, degc: FloatArray, loss: FloatArray) -> FloatArray:
    """Return (4, n) gauge pressures in kPa of tires that lose by `loss` (4, n), without resolution and noise."""
    span = math.ceil(days[-1])
    placard = rng.uniform(200.0, 280.0)
    cold = placard + rng.uniform(-6.0, 6.0, 4)[:, None] - loss
    for day in rng.uniform(0.1, 0.8, int(rng.integers(0, 3))) * days[-1]:
        # A fault is not filled up: it would be another one.
        for wheel in np.flatnonzero(np.ptp(loss, axis=1) < 20.0):
            lacks = placard + rng.uniform(0.0, 6.0) - float(np.interp(day, days, cold[wheel]))
            cold[wheel] += np.where(days > day, max(lacks, 0.0), 0.0)
    warm = (cold + _SEA_KPA) * (degc + 273.15) / 293.15
    if rng.random() < 0.5:
        return np.asarray(warm - _SEA_KPA)
    height_m = np.where(rng.random(COUNT) < 0.1, rng.uniform(300.0, 1200.0, COUNT), rng.uniform(0.0, 80.0, COUNT))
    outside = _SEA_KPA * np.exp(-height_m / 8400.0) + np.interp(days, np.arange(span + 2), _weather(rng, span, 0.8))
    return np.asarray(warm - outside)


def fleet(seed: int, fault: Fault = Fault()) -> list[TireHistory]:  # noqa: B008
    """Return the histories of the four wheels of a vehicle; a fault is that of the first one returned."""
    rng = np.random.default_rng([8191, seed])
    whole = float(rng.choice([45, 90, 180]))
    days = np.sort(rng.uniform(0.0, whole, COUNT))
    # Some drives follow another one on the same day.
    for again in rng.choice(np.arange(1, COUNT), 12, replace=False):
        days[again] = days[again - 1] + rng.uniform(0.05, 0.3)
    days = np.sort(days)
    span, share = math.ceil(days[-1]), (days - days[0]) / (days[-1] - days[0])
    faulty = int(rng.integers(4))
    wheel_of = np.arange(4) == faulty
    after = np.maximum(days - fault.begin * whole, 0.0) if fault.name else np.zeros(COUNT)
    since = (after > 0.0).astype(np.float64)
    speed = np.exp(rng.normal(math.log(rng.uniform(13.0, 22.0)), 0.25, COUNT)).clip(8.0, 36.0)
    season = rng.uniform(0, 2.0 * math.pi)
    air = rng.uniform(0, 22) + 9.0 * np.sin(np.arange(span + 2) / 58.0 + season) + _weather(rng, span, 3.0)
    warming = rng.uniform(4.0, 10.0) + 0.6 * speed + rng.normal(0.0, 3.0, COUNT)
    degc = np.interp(days, np.arange(span + 2), air) + warming + rng.normal(0.0, 0.7, (4, COUNT))
    km = rng.uniform(4e3, 6e4) + rng.uniform(20.0, 80.0) * days
    # Persons in front and behind, luggage, fuel; a wheel of an axle has half of it.
    persons, usual = rng.choice([0, 0, 0, 1, 1, 2, 3], COUNT), rng.uniform(3200.0, 4800.0)
    luggage_n = np.where(rng.random(COUNT) < 0.15, rng.uniform(100.0, 500.0, COUNT), 0.0)
    fuel_n = 150.0 * np.mod(rng.uniform() - days * rng.uniform(0.05, 0.15), 1.0)
    axle = np.array([1.0, 1.0, 0.85, 0.85])[:, None] * usual
    load = axle + np.array([0.2, 0.2, 0.4, 0.4])[:, None] * (700.0 * persons + luggage_n + fuel_n) / 2.0
    load *= 1.0 + 0.15 * since * (wheel_of[:, None] if fault.name == "load of a wheel steps" else 0.0)
    loss = rng.uniform(0.2, 1.6, 4)[:, None] * days / _MONTH_DAYS
    if fault.name == "slow leak":
        loss[faulty] += rng.uniform(5.0, 9.0) * days / _MONTH_DAYS
    elif fault.name == "leak from a date on":
        loss[faulty] += min(rng.uniform(1.0, 4.0), 120.0 / max(after[-1], 1e-9)) * after
    true_kpa = _pressures(rng, days, degc, loss)
    step_kpa, noise_kpa = rng.choice([0.1, 1.0, 2.5]), rng.uniform(0.2, 0.6)
    kpa = step_kpa * np.round((true_kpa + rng.normal(0.0, noise_kpa, (4, COUNT))) / step_kpa)
    if fault.name == "pressure sensor sticks":
        kpa[faulty] = np.where(since > 0.0, kpa[faulty, int(since.argmax()) - 1], kpa[faulty])
    measured_degc = np.round(degc + rng.normal(0.0, 0.3, (4, 1)) + rng.normal(0.0, 0.2, (4, COUNT)))
    wear_rate = rng.uniform(0.03, 0.06) * np.exp(rng.normal(0.0, 0.1, 4))
    wear_rate *= np.where(wheel_of & (fault.name == "fast wear"), 4.0, 1.0)
    wear = wear_rate[:, None] * (km - km[0]) * 1e-3 + rng.uniform(0.0, 1.0, (4, 1))
    thickness_mm = rng.uniform(12.0, 16.0)
    of_load = 1.0 + 0.01 * np.log(speed / 17.0) * rng.normal(0.0, 1.0, (4, 1)) + rng.normal(0.0, 0.01, (4, COUNT))
    road = np.exp(rng.normal(0.0, 0.2, COUNT)) * np.where(rng.random(COUNT) < 0.05, 1.6, 1.0)
    noise = rng.uniform(2.0, 8.0, (4, 1)) * (speed / 15.0) * road * np.exp(rng.normal(0.0, 0.05, (4, COUNT)))
    loose = since * rng.uniform(1.5, 2.5) if fault.name == "sensor comes loose" else np.zeros(COUNT)
    lost = 60_000.0 * np.where(rng.random((4, COUNT)) < 0.1, rng.uniform(0.0, 4e-3, (4, COUNT)), 5e-5)
    clipped = np.where((speed > 30.0) & (rng.random((4, COUNT)) < 0.3), rng.uniform(0.0, 20.0, (4, COUNT)), 0.0)
    ageing = rng.uniform(0.0, 0.8, (4, 1)) * days / _MONTH_DAYS * 1e-2
    names = tuple(f"r{number:02d}" for number in range(COUNT))
    times_ns = np.round((19_000.0 + days) * 86_400e9).astype(np.int64)
    histories = []
    for wheel, position in enumerate(WHEELS):
        is_faulty = wheel == faulty
        pressure, stiff = true_kpa[wheel] / 230.0, np.exp(ageing[wheel] - 0.005 * (degc[wheel] - 25.0))
        size = load[wheel] / axle[wheel]
        remaining = 1.0 - wear[wheel] / thickness_mm
        scatter = rng.normal(0.0, 1.0, (5, COUNT))
        if is_faulty and fault.name == "noise grows tenfold":
            noise[wheel] *= 10.0**share
        if is_faulty and fault.name == "samples are lost":
            lost[wheel] += 60_000.0 * 0.03 * share
        gain = 1.0 + rng.normal(0.0, 2e-3) + rng.normal(0.0, 1e-3, COUNT)
        gain -= 0.02 * since * (is_faulty and fault.name == "gain steps by -2 %")
        soft = 0.2 * share if is_faulty and fault.name == "sidewall softens" else 0.0
        columns: dict[str, Any] = {
            "pressure_pa": 1e3 * kpa[wheel],
            "pressure_measured": np.ones(COUNT),
            "temperature_degc": measured_degc[wheel],
            "revolutions": np.full(COUNT, 500.0),
            "speed_mean_mps": speed,
            "load_n": np.full(COUNT, usual),
            "load_std_n": np.full(COUNT, 0.02 * usual),
            "estimated_load_n": load[wheel] * of_load[wheel],
            "estimated_load_n_std": np.full(COUNT, 0.02 * usual),
            "contact_length_m": 0.12 * (size / pressure) ** 0.5 * (1.0 + 0.006 * scatter[0]),
            "contact_length_m_std": np.full(COUNT, 2e-3),
            "wear_mm": wear[wheel] + 0.8 * (of_load[wheel] - 1.0) / 0.02 * 0.05 + rng.normal(0.0, 0.06, COUNT),
            "wear_mm_std": np.full(COUNT, 0.25),
            "ring_thickness_m": np.full(COUNT, 1e-3 * thickness_mm),
            "noise_mps2": noise[wheel],
            "samples": np.full(COUNT, 60_000.0),
            "samples_lost": np.round(lost[wheel]),
            "samples_saturated": np.round(clipped[wheel]),
            "mounting_offset_m": 1e-3 * (loose * is_faulty + rng.normal(0.0, 0.05, COUNT)),
            "mounting_offset_std_m": np.full(COUNT, 1e-4),
            "gain": gain,
            "gain_std": np.full(COUNT, 5e-3),
            "stated_radius_m": np.full(COUNT, 0.31),
            "ply_steer_contact_line_rad": rng.normal(3e-3, 2e-4, COUNT),
            "ply_steer_contact_line_rad_std": np.full(COUNT, 4e-4),
            "Bs": 3.1e-3 * remaining**3 * stiff / pressure * size**0.3 * np.exp(0.012 * scatter[1]),
            "Cw": 0.195 * (size / pressure) ** 0.2 * np.exp(0.006 * scatter[2]),
            "Rs": 2.9 * stiff / pressure**0.5 * size**0.2 * np.exp(0.015 * scatter[3] - soft),
            "Ts": 2.5 * stiff / pressure**0.5 * size**0.2 * np.exp(0.015 * scatter[4]),
        }
        columns |= {f"{name}_std": 0.02 * columns[name] for name in ("Bs", "Cw", "Rs", "Ts")}
        history = TireHistory(
            f"car {seed}", position, f"{seed:04d}{wheel}", names, names, times_ns, km, True, columns, {}
        )
        histories.append(history)
    return [histories[faulty], *(other for other in histories if other is not histories[faulty])]


def findings_of(histories: list[TireHistory]) -> list[list[tuple[str, str]]]:
    """Return code with series, and sentence, of each finding of each wheel."""
    return [
        [(f"{finding.code.name} {dict(finding.values).get('name', '')}", text(finding)) for finding in tire.findings]
        for tire in analyse(histories, recordings=4 * COUNT).tires
    ]


def is_found(name: str, findings: list[tuple[str, str]]) -> bool:
    """Return whether findings of a wheel tell a fault."""
    return any(word in told for word in FAULTS[name].split() for told, _ in findings)


def main(healthy: int, first: int, planted: int) -> None:
    """Print the counts, and each false or missed finding."""
    false = 0
    for seed in range(first, first + healthy):
        histories = fleet(seed)
        for history, findings in zip(histories, findings_of(histories), strict=True):
            false += len(findings)
            for finding in findings:
                print(f"false: {history.vehicle} {history.position}: {finding[0]}: {finding[1]}")
    detected, clean = 0, 0
    missed: Counter[str] = Counter()
    for number in range(planted):
        name = list(FAULTS)[number % len(FAULTS)]
        seed = first + 5000 + number
        histories = fleet(seed, Fault(name, float(np.random.default_rng(seed).uniform(0.4, 0.85))))
        of_wheels = findings_of(histories)
        is_told = is_found(name, of_wheels[0])
        detected += is_told
        others = sum(map(len, of_wheels)) - is_told
        clean += is_told and not others
        missed[name] += not is_told
        if not is_told or others:
            print(f"{'found with others' if is_told else 'missed'}: {histories[0].vehicle}, {name}")
            for history, told in zip(histories, of_wheels, strict=True):
                for finding in told:
                    print(f"    {history.position}: {finding[0]}: {finding[1]}")
    print(f"healthy fleets: {healthy}, false findings: {false}")
    print(f"planted faults: {planted}, found: {detected}, as the only finding: {clean}, missed: {dict(+missed)}")


if __name__ == "__main__":
    main(*(int(word) for word in [*sys.argv[1:], *("50", "3000", "40")[len(sys.argv) - 1 :]]))
