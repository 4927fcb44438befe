"""Covariance of the quantities of a revolution, held against draws of the errors that they share."""

import numpy as np
import pytest

from gateway.estimators.covariance import covariance, scatter_correlation

NAMES = ("speed_mps", "contact_length_m", "Bs", "contact_fraction")
VALUES = np.array([20.0, 0.15, 3e-3, 0.08])
# Of radius, rate, gain, load and pressure.
ERRORS = np.array([0.01, 0.002, 0.015, 0.03, 0.02])


def relative(draw: np.ndarray) -> np.ndarray:
    """Return the relative errors of the quantities of NAMES, (n, 4), from those of the causes, (n, 5)."""
    radius, rate, _, load, pressure = draw.T
    return np.stack([radius + rate, radius, load - pressure - 2.0 * radius, 0.0 * radius], axis=1)


def test_shared_causes_connect_quantities_as_random_errors_do() -> None:
    rng = np.random.default_rng(1)
    drawn = np.cov((relative(rng.normal(0.0, ERRORS, (200_000, 5))) * VALUES).T)
    constant = np.sqrt(np.diagonal(drawn))
    stated = covariance(NAMES, VALUES, constant, np.zeros(4), ERRORS, np.eye(4))
    scale = np.multiply.outer(VALUES, VALUES)
    np.testing.assert_allclose(stated / scale, drawn / scale, atol=2e-6)


def test_errors_beyond_the_causes_and_scatter_weaken_the_correlation() -> None:
    constant, scatter = 0.02 * VALUES, 0.01 * VALUES
    stated = covariance(NAMES, VALUES, constant, scatter, ERRORS, np.eye(4))
    assert np.diagonal(stated) == pytest.approx(constant**2 + scatter**2)
    assert (np.linalg.eigvalsh(stated / np.multiply.outer(VALUES, VALUES)) >= 0.0).all()
    assert stated[0, 1] == pytest.approx(0.01**2 * VALUES[0] * VALUES[1])
    # Bs is better known than load, pressure and radius together, by the belt width of the new tire.
    assert abs(stated[0, 2]) < 0.01 * 0.02 * VALUES[0] * VALUES[2]


def test_scatter_is_correlated_by_what_changes_neither_steadily_nor_alone() -> None:
    rng = np.random.default_rng(2)
    common, drive = rng.normal(size=(2, 4000)), np.linspace(0.0, 500.0, 4000)
    series = np.stack([common[0] + drive, 3.0 * common[0] - drive, common[1] + drive], axis=1)
    correlation = scatter_correlation(series)
    assert correlation[0, 1] == pytest.approx(1.0, abs=1e-6)
    assert abs(correlation[0, 2]) < 0.1
    assert (scatter_correlation(series[:5]) == np.eye(3)).all()
