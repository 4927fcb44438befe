"""Revolutions and averages made from waveforms, for estimator tests."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from gateway.core.estimates.estimator import AngleAverage, Revolution, TireConditions
from gateway.core.estimates.revolution_block import extended
from gateway.core.reasons import Reason
from gateway.core.revolutions.order_spectrum import order_coefficients
from gateway.core.revolutions.synchronous_average import RunningAverage
from gateway.papers.ring_data import waveform_revolution
from gateway.ring.rolling_ring import RingSolution
from tests.testkit.exact_ring import PRESSURE_PA, RADIUS_M, omega_at, on_grid

OMEGA = omega_at(65.0)
CONDITIONS = TireConditions(radius_m=RADIUS_M, load_n=5000.0, pressure_pa=PRESSURE_PA)


def make_revolution(
    wave: np.ndarray,
    *,
    edges: tuple[float, float] | None = None,
    edge_std: float = 0.0,
    order_max: int = 60,
    faults: tuple[Reason, ...] = (),
    saturated: bool = False,
    missing_fraction: float = 0.0,
    period_std_s: float = 1e-5,
) -> Revolution:
    """Wrap a normalised radial waveform; edges are found in it unless given."""
    revolution = waveform_revolution(wave, samples=1069.0, omega_radps=OMEGA)
    if edges is not None:
        revolution = replace(
            revolution,
            leading_edge_rad=edges[0],
            trailing_edge_rad=edges[1],
            leading_edge_std_rad=edge_std,
            trailing_edge_std_rad=edge_std,
        )
    return replace(
        revolution,
        start_s=1.0,
        orders_mps2=order_coefficients(wave, order_max),
        order_max=order_max,
        missing_fraction=missing_fraction,
        saturated=saturated,
        faults=faults,
        period_std_s=period_std_s,
    )


def plain_revolution(points: int = 8, **changes: Any) -> Revolution:
    """Return a revolution without a signal, for what only passes its numbers on."""
    values = {
        "index": 0,
        "start_s": 0.0,
        "period_s": 0.1,
        "omega_radps": 20.0 * math.pi,
        "omega_dot_radps2": 0.0,
        "radial_mps2": np.zeros(points),
        "axes_mps2": np.zeros((3, points)),
        "orders_mps2": np.zeros(61, dtype=np.complex128),
        "order_max": 60,
        "leading_edge_rad": -0.2,
        "trailing_edge_rad": 0.2,
        "leading_edge_std_rad": 0.001,
        "trailing_edge_std_rad": 0.001,
        "noise_mps2": 1.0,
        "missing_fraction": 0.0,
        "saturated": False,
        "ac_coupled": False,
    }
    return Revolution(**values | changes)


def settled(revolution: Revolution, count: int = 10) -> AngleAverage:
    average = RunningAverage()
    for _ in range(count - 1):
        extended(average, revolution)
    return extended(average, revolution)


def exact_wave(ring: RingSolution) -> np.ndarray:
    return OMEGA**2 * on_grid(ring.sensor.radial_m)
