"""Revolutions and averages made from waveforms, for estimator tests."""

from __future__ import annotations

import math

import numpy as np

from gateway.estimators.estimator import AngleAverage, Revolution, TireConditions
from gateway.physics.rolling_ring import RingSolution
from gateway.reasons import Reason
from gateway.signal.contact_edges import find_contact_edges
from gateway.signal.order_spectrum import coefficient_std, order_coefficients, sample_std
from gateway.signal.synchronous_average import RunningAverage
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
    coefficient = coefficient_std(wave, 1069.0)
    if edges is None:
        found = find_contact_edges(wave, 1069.0, coefficient)
        edges, stds = (found.leading_rad, found.trailing_rad), (found.leading_std_rad, found.trailing_std_rad)
    else:
        stds = (edge_std, edge_std)
    return Revolution(
        index=0,
        start_s=1.0,
        period_s=2.0 * math.pi / OMEGA,
        omega_radps=OMEGA,
        omega_dot_radps2=0.0,
        radial_mps2=wave,
        axes_mps2=np.stack([np.full_like(wave, np.nan), np.full_like(wave, np.nan), wave]),
        orders_mps2=order_coefficients(wave, order_max),
        order_max=order_max,
        leading_edge_rad=edges[0],
        trailing_edge_rad=edges[1],
        leading_edge_std_rad=stds[0],
        trailing_edge_std_rad=stds[1],
        noise_mps2=sample_std(coefficient, 1069.0, 1024),
        missing_fraction=missing_fraction,
        saturated=saturated,
        ac_coupled=False,
        faults=faults,
        period_std_s=period_std_s,
    )


def take(average: RunningAverage, revolution: Revolution) -> AngleAverage:
    return average.update(
        revolution.radial_mps2,
        revolution.orders_mps2,
        revolution.omega_radps,
        edges_rad=(revolution.leading_edge_rad, revolution.trailing_edge_rad),
        edges_std_rad=(revolution.leading_edge_std_rad, revolution.trailing_edge_std_rad),
        noise_mps2=revolution.noise_mps2,
    )


def settled(revolution: Revolution, count: int = 10) -> AngleAverage:
    average = RunningAverage()
    for _ in range(count - 1):
        take(average, revolution)
    return take(average, revolution)


def exact_wave(ring: RingSolution) -> np.ndarray:
    return OMEGA**2 * on_grid(ring.sensor.radial_m)
