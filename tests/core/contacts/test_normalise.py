import math

import numpy as np
import pytest

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.revolutions.angle_resampling import Phase, angle_grid, fit_phase
from tests.testkit.exact_ring import RADIUS_M, cosine_orders, omega_at, on_grid, sampled, solution
from tests.testkit.single_revolution import normalise_radial, resample_revolution


def steady_phase(samples: float = 1024.0) -> Phase:
    return fit_phase(0.0, samples)


def measured(speed_kmh: float, gravity_mps2: float = STANDARD_GRAVITY_MPS2) -> np.ndarray:
    radial, _ = solution().sensor.specific_force(omega_at(speed_kmh), gravity_mps2=gravity_mps2)
    return on_grid(radial)


@pytest.mark.parametrize("speed_kmh", [10.0, 30.0, 120.0])
def test_gravity_is_removed_at_belt_angle(speed_kmh: float) -> None:
    clean = measured(speed_kmh, 0.0)
    result = normalise_radial(measured(speed_kmh), steady_phase())
    assert result.used_belt_angle
    assert result.constant_mps2 == 0.0
    remainder = np.abs(result.radial_mps2 - clean).max()
    # The residual of the material angle is several times larger: over 0.24 rad of contact it turns, the belt does not.
    with_material_angle = np.abs(measured(speed_kmh) - STANDARD_GRAVITY_MPS2 * np.cos(angle_grid()) - clean).max()
    assert remainder < 0.01 * STANDARD_GRAVITY_MPS2
    assert with_material_angle > 5.0 * remainder


def test_belt_angle_closes_and_is_flat_in_contact() -> None:
    psi = normalise_radial(measured(65.0), steady_phase()).belt_angle_rad
    theta = angle_grid()
    assert psi[0] == pytest.approx(-math.pi, abs=0.01)
    assert np.abs(psi[np.abs(theta) < 0.12]).max() < 0.02


@pytest.mark.parametrize("speed_kmh", [10.0, 65.0])
def test_radius_restores_ac_coupled_signal(speed_kmh: float) -> None:
    clean = measured(speed_kmh, 0.0)
    coupled = measured(speed_kmh)
    steady = omega_at(speed_kmh) ** 2 * RADIUS_M
    result = normalise_radial(coupled - coupled.mean(), steady_phase(), ac_coupled=True, steady_mps2=steady)
    assert result.used_belt_angle
    # By its extension the belt's mean differs from R Omega^2 by 0.01 %.
    assert np.abs(result.radial_mps2 - clean).max() < 0.01 * STANDARD_GRAVITY_MPS2 + 5e-4 * steady


@pytest.mark.parametrize("speed_kmh", [10.0, 65.0])
def test_contact_plateau_restores_ac_coupled_signal(speed_kmh: float) -> None:
    clean = measured(speed_kmh, 0.0)
    coupled = measured(speed_kmh)
    result = normalise_radial(coupled - coupled.mean(), steady_phase(), ac_coupled=True)
    assert result.used_belt_angle
    steady = omega_at(speed_kmh) ** 2 * RADIUS_M
    assert np.abs(result.radial_mps2 - clean).max() < 0.08 * steady
    shape = result.radial_mps2 - result.radial_mps2.mean()
    assert np.abs(shape - (clean - clean.mean())).max() < 0.02 * STANDARD_GRAVITY_MPS2


@pytest.mark.parametrize("acceleration", [-3.0, 3.0])
@pytest.mark.parametrize("ac_coupled", [False, True])
def test_accelerating_wheel_gives_steady_waveform(acceleration: float, ac_coupled: bool) -> None:
    truth = solution()
    samples, contacts = sampled(truth, 9600.0, 40.0, acceleration_mps2=acceleration)
    phase = fit_phase(contacts[1], contacts[2], contacts[0])
    wave = resample_revolution(samples[:, 1:], phase)[0]
    omega = 2.0 * math.pi * 9600.0 / phase.samples
    steady = omega**2 * RADIUS_M
    expected = omega**2 * on_grid(truth.sensor.radial_m)
    result = normalise_radial(
        wave - (wave.mean() if ac_coupled else 0.0), phase, ac_coupled=ac_coupled, steady_mps2=steady
    )
    orders, true_orders = cosine_orders(result.radial_mps2), cosine_orders(expected)
    # Order 1 keeps the axle's own acceleration along the road.
    assert np.abs(orders[1:] - true_orders[1:]).max() < 2e-3 * np.abs(true_orders).max()
    if not ac_coupled:
        # Without correction, the sawtooth of the speed leaves far more.
        assert np.abs(wave - expected).max() > 5.0 * np.abs(result.radial_mps2 - expected).max()


def test_ac_coupled_without_contact_stays_ac() -> None:
    wave = 3.0 * np.cos(4.0 * angle_grid()) + STANDARD_GRAVITY_MPS2 * np.cos(angle_grid())
    result = normalise_radial(wave, steady_phase(), ac_coupled=True)
    assert not result.used_belt_angle
    assert result.constant_mps2 == 0.0
    np.testing.assert_allclose(result.radial_mps2, 3.0 * np.cos(4.0 * angle_grid()), atol=1e-9)


def test_implausible_mean_uses_material_angle() -> None:
    wave = measured(65.0) - 5000.0
    result = normalise_radial(wave, steady_phase())
    assert not result.used_belt_angle
    np.testing.assert_allclose(result.radial_mps2, wave - STANDARD_GRAVITY_MPS2 * np.cos(angle_grid()))


def test_normalise_passes_nan() -> None:
    wave = measured(65.0)
    wave[3] = np.nan
    for ac_coupled in (False, True):
        assert np.isnan(normalise_radial(wave, steady_phase(), ac_coupled=ac_coupled).radial_mps2[3])
