"""Histories of tires with planted trends, as a dataset of recordings gives them."""

import math

import numpy as np
from numpy.typing import NDArray

from gateway.core.constants import STANDARD_ATMOSPHERE_PA, ZERO_CELSIUS_K
from gateway.fleet.trends.tire_history import MONTH_NS, TireHistory
from gateway.fleet.trends.trend_result import TireTrend, TrendNumber

BEGIN_NS = 1_767_225_600 * 10**9
KM_A_MONTH = 1200.0
NUMBERS = {"Bs": 3.08e-3, "Cw": 0.195, "Rs": 2.97, "Ts": 2.53}


def history(
    seed: int = 1,
    count: int = 100,
    *,
    months: float = 8.0,
    wear_mm_per_1000km: float = 0.05,
    leak_pa: float = 0.0,
    noise_growth: float = 0.0,
    softening: float = 0.006,
    stiffening: float = 0.0,
    vehicle: str = "car",
    position: str = "FL",
    sensor_id: str = "0000a000",
    has_odometer: bool = True,
    scatter: float = 1.0,
) -> TireHistory:
    """Return a tire whose true trends are as given: wear, leak in Pa a month, ln(noise) and ln(Cw) per month."""
    rng = np.random.default_rng(seed)
    index = np.sort(rng.uniform(0.0, months, count))
    index[0], index[-1] = 0.0, months
    km = KM_A_MONTH * index
    degc = 30.0 + 8.0 * np.sin(2.0 * math.pi * index / 12.0) + rng.normal(0.0, 4.0, count)
    warm = (degc + ZERO_CELSIUS_K) / (20.0 + ZERO_CELSIUS_K)
    cold_pa = 220e3 - leak_pa * index
    pressure_pa = (cold_pa + STANDARD_ATMOSPHERE_PA) * warm - STANDARD_ATMOSPHERE_PA + rng.normal(0.0, 500.0, count)
    speed = rng.uniform(10.0, 25.0, count)
    load = rng.normal(1.0, 0.01 * scatter, count)
    columns: dict[str, NDArray[np.float64]] = {
        "wear_mm": wear_mm_per_1000km * km * 1e-3 + rng.normal(0.0, 0.08 * scatter, count),
        "wear_mm_std": np.full(count, 0.25),
        "pressure_pa": pressure_pa,
        "pressure_measured": np.ones(count),
        "temperature_degc": degc,
        "load_n": np.full(count, 4000.0),
        "load_std_n": np.full(count, 80.0),
        "estimated_load_n": 4000.0 * load * (1.0 + rng.normal(0.0, 0.003, count)),
        "estimated_load_n_std": np.full(count, 90.0),
        "contact_length_m": 0.12 * load,
        "contact_length_m_std": np.full(count, 0.003),
        "speed_mean_mps": speed,
        "noise_mps2": 5.0 * (speed / 15.0) * np.exp(noise_growth * index + rng.normal(0.0, 0.05, count)),
        "samples": np.full(count, 60_000.0),
        "samples_lost": np.abs(rng.normal(0.0, 6.0, count)),
        "samples_saturated": np.zeros(count),
        "mounting_offset_m": rng.normal(0.0, 2e-5, count),
        "mounting_offset_m_std": np.full(count, 1e-4),
        "mounting_offset_std_m": np.full(count, 1e-4),
        "gain": rng.normal(1.0, 1e-3, count),
        "gain_std": np.full(count, 5e-3),
        "ply_steer_contact_line_rad": rng.normal(3e-3, 2e-4, count),
        "ply_steer_contact_line_rad_std": np.full(count, 4e-4),
    }
    for name, value in NUMBERS.items():
        over_pressure = 1.0 if name == "Cw" else 220e3 / pressure_pa
        drift = stiffening * index if name == "Cw" else 0.0
        warmth = -softening * (degc - 25.0) if name != "Cw" else 0.0
        columns[name] = value * over_pressure * load * np.exp(drift + warmth + rng.normal(0.0, 0.004 * scatter, count))
        columns[f"{name}_std"] = 0.02 * columns[name]
    return TireHistory(
        vehicle=vehicle,
        position=position,
        sensor_id=sensor_id,
        recordings=tuple(f"{vehicle}_{n:04d}.mcap" for n in range(count)),
        paths=tuple(f"/data/{vehicle}/{n:04d}.mcap" for n in range(count)),
        time_ns=(BEGIN_NS + np.round(index * MONTH_NS)).astype(np.int64),
        km=km + 20_000.0,
        has_odometer=has_odometer,
        columns=columns,
        invalid={"zero_g_offset_mps2": "needs two speeds"},
    )


def number(tire: TireTrend, quantity: str) -> TrendNumber:
    return next(entry for entry in tire.numbers if entry.quantity == quantity)
