"""Bound and bias of radial and tangential damping (ring paper, Eq. 11)."""

import math

import pytest

from gateway.papers.damping_figure import damping_bound, fitted_dampings


def test_noise_alone_parts_both_dampings() -> None:
    reference = damping_bound(torque_known=True)
    assert reference.radial == pytest.approx(0.016, abs=0.001)
    assert reference.tangential == pytest.approx(0.136, abs=0.01)
    assert math.isnan(reference.torque_nm)


def test_unknown_torque_costs_a_factor_of_three() -> None:
    reference, free = damping_bound(torque_known=True), damping_bound(torque_known=False)
    assert free.radial == pytest.approx(3.1 * reference.radial, rel=0.1)
    assert free.tangential == pytest.approx(3.0 * reference.tangential, rel=0.1)
    assert free.torque_nm == pytest.approx(28.0, abs=2.0)


def test_light_load_fits_both_dampings() -> None:
    """On the lightly loaded ring Eq. 11 is right, so that the bias at 5000 N is that of the load."""
    radial, tangential = fitted_dampings(50.0, ratio=3.0)
    assert radial == pytest.approx(1.0, abs=0.02)
    assert tangential == pytest.approx(3.0, abs=0.1)


def test_loaded_belt_hides_the_tangential_damping() -> None:
    radial, tangential = fitted_dampings(5000.0)
    assert radial == pytest.approx(1.55, abs=0.05)
    assert tangential < 0.0
