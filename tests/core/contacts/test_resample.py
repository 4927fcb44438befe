import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.core.revolutions.angle_resampling import (
    MARGIN_SAMPLES,
    Phase,
    angle_grid,
    elapsed_angles,
    fit_phase,
)
from gateway.core.revolutions.order_spectrum import order_coefficients
from tests.testkit.single_revolution import resample_revolution


def tone(order: int, samples: float, start: float, rows: int) -> np.ndarray:
    angle = 2.0 * math.pi * (np.arange(rows) - start) / samples
    return np.cos(order * angle) + 0.5 * np.sin(order * angle)


@pytest.mark.parametrize(
    ("rate_hz", "speed_kmh", "limit"),
    [(9600, 65, 1e-3), (9600, 10, 1e-3), (25600, 80, 1e-3), (9600, 250, 1e-3), (2000, 40, 1e-3), (2000, 65, 5e-3)],
)
def test_orders_to_60_are_preserved(rate_hz: float, speed_kmh: float, limit: float) -> None:
    samples = 2.0 * math.pi * 0.32 / (speed_kmh / 3.6) * rate_hz
    start = 40.37
    phase = fit_phase(start, start + samples)
    for order in (1, 2, 5, 20, 40, 60):
        wave = tone(order, samples, start, int(samples) + 100)[:, np.newaxis]
        coefficients = order_coefficients(resample_revolution(wave, phase)[0])
        assert abs(coefficients[order] - (1.0 - 0.5j)) < limit
        coefficients[order] = 0.0
        assert np.abs(coefficients).max() < limit


def test_first_half_maps_to_positive_angles() -> None:
    ramp = np.arange(600.0)[:, np.newaxis]
    (wave,) = resample_revolution(ramp, Phase(50.0, 550.0, 2.0 * math.pi / 500.0, 0.0), n=1000)
    theta = angle_grid(1000)
    expected = 50.0 + 500.0 * np.where(theta >= 0.0, theta, theta + 2.0 * math.pi) / (2.0 * math.pi)
    np.testing.assert_allclose(wave, expected, atol=1e-6)


@pytest.mark.parametrize("acceleration", [-3.0, 3.0])
@pytest.mark.parametrize("speed_kmh", [20.0, 65.0])
def test_constant_acceleration_is_corrected(acceleration: float, speed_kmh: float) -> None:
    rate, start = 9600.0, 3000.25
    omega, omega_dot = speed_kmh / 3.6 / 0.32, acceleration / 0.32
    t = (np.arange(9000) - start) / rate
    angle = omega * t + 0.5 * omega_dot * t**2
    wave = np.cos(5.0 * angle) + np.sin(31.0 * angle)

    def position(turns: int) -> float:
        a = 2.0 * math.pi * turns
        return start + rate * 2.0 * a / (omega + math.sqrt(omega**2 + 2.0 * omega_dot * a))

    for neighbours in ({"previous": position(-1)}, {"following": position(2)}):
        phase = fit_phase(start, position(1), **neighbours)
        assert phase.acceleration * rate**2 == pytest.approx(omega_dot, rel=1e-9)
        coefficients = order_coefficients(resample_revolution(wave[:, np.newaxis], phase)[0])
        assert abs(coefficients[5] - 1.0) < 1e-4
        assert abs(coefficients[31] + 1j) < 1e-3
    # Without a neighbour the speed is taken as constant; the test must be able to detect that.
    warped = order_coefficients(resample_revolution(wave[:, np.newaxis], fit_phase(start, position(1)))[0])
    assert abs(warped[31] + 1j) > 0.02


@settings(max_examples=60)
@given(
    start=st.floats(0.0, 1e4),
    period=st.floats(60.0, 2e4),
    before=st.floats(0.3, 3.5),
    after=st.floats(0.3, 3.5),
)
def test_phase_is_monotonic_between_contacts(start: float, period: float, before: float, after: float) -> None:
    phase = fit_phase(start, start + period, start - before * period, start + (1.0 + after) * period)
    positions = phase.positions(np.linspace(0.0, 2.0 * math.pi, 400))
    assert positions[0] == pytest.approx(start, abs=1e-6)
    assert positions[-1] == pytest.approx(start + period, abs=1e-6 * period)
    assert (np.diff(positions) > 0.0).all()
    elapsed = positions - phase.start
    np.testing.assert_allclose(
        phase.rate * elapsed + 0.5 * phase.acceleration * elapsed**2, np.linspace(0.0, 2.0 * math.pi, 400), atol=1e-9
    )


def test_stop_before_revolution_is_not_acceleration() -> None:
    assert fit_phase(1000.0, 1500.0, previous=-1000.0).acceleration == 0.0


@settings(max_examples=25)
@given(fraction=st.floats(0.0, 1.0), period=st.floats(150.0, 1500.0))
def test_fractional_centres_do_not_shift_phase(fraction: float, period: float) -> None:
    start = 30.0 + fraction
    wave = tone(7, period, start, int(period) + 80)[:, np.newaxis]
    coefficients = order_coefficients(resample_revolution(wave, fit_phase(start, start + period))[0])
    assert abs(coefficients[7] - (1.0 - 0.5j)) < 2e-4


@pytest.mark.parametrize("samples", [700.3, 1069.4, 6949.0])
def test_noise_above_grid_does_not_alias(samples: float) -> None:
    rng = np.random.default_rng(7)
    noise = rng.normal(size=(int(samples) + 60, 40))
    waves = resample_revolution(noise, fit_phase(20.2, 20.2 + samples))
    coefficients = order_coefficients(waves)[:, 1:]
    spread = math.sqrt(0.5 * float(np.mean(np.abs(coefficients) ** 2)))
    assert spread == pytest.approx(math.sqrt(2.0 / samples), rel=0.05)


def test_samples_beyond_margin_have_no_effect() -> None:
    rng = np.random.default_rng(3)
    wave = rng.normal(size=(700, 1))
    phase = fit_phase(100.5, 600.25)
    expected = resample_revolution(wave, phase)
    wave[: 100 - MARGIN_SAMPLES] = 1e6
    np.testing.assert_array_equal(resample_revolution(wave, phase), expected)
    cut = resample_revolution(wave[84:618], Phase(16.5, 516.25, phase.rate, phase.acceleration))
    np.testing.assert_allclose(cut, expected, atol=2e-4)


def test_nan_axis_does_not_affect_others() -> None:
    wave = np.ones((400, 3))
    wave[:, 1] = np.nan
    result = resample_revolution(wave, fit_phase(50.0, 350.0))
    assert np.isnan(result[1]).all()
    np.testing.assert_allclose(result[[0, 2]], 1.0)


def test_elapsed_angles_match_grid() -> None:
    np.testing.assert_allclose(elapsed_angles(64), angle_grid(64) % (2.0 * math.pi), atol=1e-12)


def test_invalid_arguments_raise() -> None:
    wave = np.zeros((100, 1))
    with pytest.raises(ValueError, match="cover"):
        resample_revolution(wave, fit_phase(50.0, 120.0))
    with pytest.raises(ValueError, match="even"):
        resample_revolution(wave, fit_phase(10.0, 90.0), n=101)
    for end in (10.0, 5.0, math.nan, math.inf):
        with pytest.raises(ValueError, match="revolution"):
            fit_phase(10.0, end)
