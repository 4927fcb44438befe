"""Trend of the contact: a leak that nobody measures, and what is none."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from gateway.core.trust.contact_trend import ContactTrend

HALF_RAD = 0.2


def errors(load_over_pressure, speeds_mps=None, scatter=0.004, seed=1, pressure_pa=2e5):
    """Return the error after each contact under a relative load over pressure, with edges that scatter."""
    rng, trend = np.random.default_rng(seed), ContactTrend()
    speeds = np.full(len(load_over_pressure), 20.0) if speeds_mps is None else speeds_mps
    halves = HALF_RAD * np.sqrt(load_over_pressure) * (1.0 + scatter * rng.standard_normal(len(load_over_pressure)))
    return np.array(
        [
            trend.take(
                SimpleNamespace(leading_edge_rad=-half, trailing_edge_rad=half, omega_radps=speed / 0.3, faults=()),
                pressure_pa,
            )
            for half, speed in zip(halves, speeds, strict=True)
        ]
    )


@pytest.mark.parametrize("change", [-0.2, 0.06, 0.25])
@pytest.mark.parametrize("seed", range(4))
def test_a_change_that_nobody_states_is_within_three_errors(change: float, seed: int) -> None:
    result = errors(np.linspace(1.0, 1.0 + change, 40), seed=seed)
    assert abs(math.log1p(change)) < 3.0 * result[-1] < 3.0 * abs(change)


@pytest.mark.parametrize("seed", range(20))
def test_scatter_and_a_swinging_load_are_no_trend(seed: int) -> None:
    assert errors(np.ones(300), seed=seed).max() < 0.02
    swinging = 1.0 + 0.1 * np.sin(np.arange(300) / 6.0 + seed)
    assert errors(swinging, seed=seed)[60:].max() < 0.04


def test_a_contact_that_the_speed_changes_is_no_trend() -> None:
    speeds = np.linspace(10.0, 40.0, 60)
    assert errors(1.0 - 0.05 * np.log(speeds / 10.0), speeds).max() < 0.02


def test_a_measured_pressure_that_falls_with_the_contact_explains_it() -> None:
    trend, falling = ContactTrend(), np.linspace(1.0, 0.8, 40)
    for share in falling:
        half = HALF_RAD / math.sqrt(share)
        revolution = SimpleNamespace(leading_edge_rad=-half, trailing_edge_rad=half, omega_radps=60.0, faults=())
        error = trend.take(revolution, 2e5 * share)
    assert error < 1e-3


def test_faults_and_lost_contacts_change_nothing() -> None:
    trend = ContactTrend()
    sound = SimpleNamespace(leading_edge_rad=-0.2, trailing_edge_rad=0.2, omega_radps=60.0, faults=())
    for _ in range(20):
        assert trend.take(sound, None) < 1e-5
    for other in ({"faults": ("any",), "trailing_edge_rad": 0.5}, {"trailing_edge_rad": math.nan}):
        assert trend.take(SimpleNamespace(**{**vars(sound), **other}), None) < 1e-5
