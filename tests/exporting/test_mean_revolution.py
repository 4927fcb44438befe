import math
from types import SimpleNamespace

import numpy as np
import pytest

from gateway.core.revolutions.order_spectrum import order_coefficients
from gateway.exporting.mean_revolution import MeanOfRevolutions

N = 256


def revolutions(count, seed=3):
    rng = np.random.default_rng(seed)
    theta = -np.pi + 2 * np.pi * np.arange(N) / N
    for omega in rng.uniform(50.0, 60.0, count):
        axes = np.array([np.sin(theta), np.full(N, np.nan), np.cos(theta)]) + rng.normal(0.0, 0.1, (3, N))
        yield axes, omega**2 * (1.0 - np.cos(theta)) + rng.normal(0.0, 1.0, N), omega


def added(items):
    total = MeanOfRevolutions(N)
    for axes, radial, omega in items:
        total.add(
            SimpleNamespace(
                axes_mps2=axes,
                radial_mps2=radial,
                orders_mps2=order_coefficients(radial),
                omega_radps=omega,
                leading_edge_rad=-0.2,
                trailing_edge_rad=0.2,
                leading_edge_std_rad=0.01,
                trailing_edge_std_rad=0.01,
                noise_mps2=1.0,
            )
        )
    return total.mean()


def test_mean_and_scatter_equal_those_of_numpy():
    items = list(revolutions(40))
    mean = added(items)
    axes = np.array([axes for axes, _, _ in items])
    omegas = np.array([omega for _, _, omega in items])
    assert mean.count == 40
    assert mean.omega_radps == pytest.approx(omegas.mean())
    assert mean.omega_std_radps == pytest.approx(omegas.std(ddof=1))
    np.testing.assert_allclose(mean.axes_mps2, axes.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(mean.axes_scatter_mps2, axes.std(axis=0, ddof=1), rtol=1e-9)


def test_radial_axis_is_scaled_to_the_mean_speed():
    items = list(revolutions(40))
    mean = added(items)
    scaled = np.array([radial * (mean.omega_radps / omega) ** 2 for _, radial, omega in items])
    np.testing.assert_allclose(mean.radial.radial_mps2, scaled.mean(axis=0), rtol=1e-9)
    np.testing.assert_allclose(mean.radial.scatter_mps2, scaled.std(axis=0, ddof=1), rtol=1e-9)
    np.testing.assert_allclose(
        mean.radial.orders_mps2, order_coefficients(mean.radial.radial_mps2), rtol=1e-6, atol=1e-6
    )


def test_absent_axis_stays_unknown():
    assert np.isnan(added(revolutions(3)).axes_mps2[1]).all()


def test_single_revolution_has_no_scatter():
    mean = added(revolutions(1))
    assert math.isnan(mean.omega_std_radps)
    assert np.isnan(mean.axes_scatter_mps2).all()


def test_nothing_added_has_no_mean():
    assert MeanOfRevolutions(N).mean() is None
