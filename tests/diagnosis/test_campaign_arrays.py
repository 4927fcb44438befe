"""Grouping, order coefficients, scatter and deviations of synthetic revolutions."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.core.revolutions.order_spectrum import order_coefficients
from gateway.diagnosis.data.condition_groups import alike, far_apart, folded, modes, most_informative, tire_states
from gateway.diagnosis.data.revolution_deviations import deviation_rate_hz, deviations
from gateway.diagnosis.data.revolution_orders import carried_order, waveform_orders
from gateway.diagnosis.data.revolution_scatter import settle
from gateway.diagnosis.effects.angle_orders import ORDERS
from gateway.forces.nonsynchronous_spectrum import welch_spectrum
from tests.diagnosis.planted_campaign import conditions

N = 1024
THETA = -math.pi + 2 * math.pi * np.arange(N) / N
ORDER = np.arange(ORDERS)


def tire(theta=THETA):
    """A waveform with two sharp edges, as a contact has."""
    return 1000 * (1 - np.exp(-((theta / 0.25) ** 8)) + 0.2 * np.cos(theta) * np.exp(-np.abs(theta)))


def axes_of(radial):
    return np.stack([0.3 * np.gradient(radial), np.full_like(radial, np.nan), radial])


class TestGrouping:
    @given(st.lists(st.floats(-5, 5) | st.just(math.nan), max_size=60), st.floats(0.01, 2))
    def test_labels_are_complete_and_narrow(self, values, width):
        values = np.array(values)
        labels = modes(values, width)
        assert (labels >= 0).all()
        for label in np.unique(labels):
            selected = values[labels == label]
            assert np.isnan(selected).all() or np.ptp(selected) <= width + 1e-12

    def test_plateau_beside_a_ramp_stays_whole(self):
        plateau = np.full(50, 1.0) + 0.004 * np.sin(np.arange(50))
        values = np.concatenate((np.linspace(0.5, 1.0, 40), plateau, np.linspace(1.0, 1.5, 40)))
        labels = modes(values, 0.03)
        assert len(set(labels[40:90].tolist())) == 1

    def test_groups_are_uniform_and_complete(self):
        rng = np.random.default_rng(3)
        omega = np.concatenate((np.full(20, 50.0), np.full(20, 80.0), np.full(20, 50.0)))
        omega = omega * (1 + 0.002 * rng.standard_normal(60))
        load = np.full(60, 4000.0)
        load[40:] = 5000.0
        groups = alike(omega, load, np.full(60, 2e5), np.full(60, 25.0))
        assert [len(group) for group in groups] == [20, 20, 20]
        warm = np.repeat([20.0, 26.0, 31.0], 20)
        assert len(alike(np.full(60, 50.0), np.full(60, 4e3), np.full(60, 2e5), warm)) == 2  # within 5 K of each other

    def test_ramp_is_split_within_three_percent(self):
        omega = np.geomspace(30.0, 90.0, 400)
        groups = alike(omega, np.full(400, 4e3), np.full(400, 2e5), np.full(400, np.nan))
        assert sorted(np.concatenate(groups).tolist()) == list(range(400))
        assert all(omega[group].max() / omega[group].min() <= 1.031 for group in groups)
        assert len(groups) >= 36

    @given(st.integers(0, 300), st.integers(2, 12))
    def test_folds_are_consecutive_and_even(self, count, folds):
        parts = folded(count, folds)
        sizes = [part.stop - part.start for part in parts]
        assert sum(sizes) == count
        assert [part.start for part in parts] == [0, *[part.stop for part in parts[:-1]]][: len(parts)]
        assert len(parts) == (folds if count >= 2 * folds else count)
        assert max(sizes, default=0) - min(sizes, default=0) <= 1

    def test_unknown_loads_are_grouped_by_contact(self):
        load = np.array([4000, 4040, 5000, 4000, 4000, 4000.0])
        pressure = np.array([2.0e5, 2.01e5, 2e5, 2.4e5, 2e5, 2e5])
        angle = np.array([0.2, 0.2, 0.23, 0.18, 0.20, 0.26])
        reference = np.array([True, True, True, True, False, False])
        assert tire_states(load, pressure, angle, reference).tolist() == [0, 0, 1, 2, 3, 4]


class TestInformative:
    def taken(self, recording, state, omega, count, most):
        return most_informative(
            *map(np.asarray, (recording, state)), np.asarray(omega), np.asarray(count, float), most
        ).tolist()

    def test_far_apart_groups_cover_speeds_loads_and_directions(self):
        groups = [
            conditions(speed, load_n=load, reverse=reverse)
            for speed, load, reverse in (
                (60.0, 4500.0, False),
                (61.0, 4500.0, False),
                (62.0, 4500.0, False),
                (100.0, 4500.0, False),
                (60.0, 6000.0, False),
                (60.0, 4500.0, True),
            )
        ]
        assert far_apart(np.arange(6), groups, 4).tolist() == [0, 3, 4, 5]
        assert far_apart(np.arange(3), groups, 4).tolist() == [0, 1, 2]

    def test_few_groups_are_all_taken(self):
        assert self.taken([0, 0, 1], [0, 0, 1], [50, 60, 50], [10, 20, 30], 12) == [0, 1, 2]

    def test_largest_group_of_each_recording_is_kept(self):
        taken = self.taken([0, 0, 1, 1, 2, 2], [0] * 6, [50, 51, 50, 51, 50, 51], [5, 9, 9, 5, 5, 9], 2)
        assert taken == [1, 2, 5]

    def test_distant_speeds_come_first(self):
        omega = np.geomspace(30, 90, 34)
        count = np.full(34, 8.0)
        count[[3, 30]] = 60.0
        taken = self.taken([0] * 34, [0] * 34, omega, count, 8)
        assert len(taken) == 8
        assert {3, 30} <= set(taken)
        steps = np.diff(np.log(omega[taken]))
        assert steps.min() > 0.09
        assert np.ptp(np.log(omega[taken])) > 0.75 * math.log(3)

    def test_another_tire_state_is_kept(self):
        assert self.taken([0] * 4, [0, 0, 0, 1], [50, 51, 52, 50], [90, 80, 70, 30], 2) == [0, 3]


class TestOrders:
    def test_coefficients_match_direct_projection(self):
        wave = tire(THETA - 0.1)
        orders = waveform_orders(wave)
        assert orders.shape == (ORDERS,)
        for n in (1, 7, 60, 110):
            direct = 2 / N * (wave @ np.cos(n * THETA) - 1j * (wave @ np.sin(n * THETA)))
            assert orders[n] == pytest.approx(direct, abs=1e-9)
        assert orders[0] == pytest.approx(wave.mean())

    def test_coefficients_match_the_pipeline_to_order_60(self):
        wave = tire(THETA + 0.2)
        np.testing.assert_allclose(waveform_orders(wave)[:61], order_coefficients(wave), atol=1e-9)

    def test_few_samples_carry_few_orders(self):
        assert carried_order(100) == 28
        assert carried_order(1000) == 110


class TestScatter:
    def orders(self, count, rng, *, jitter=0.0, sigma=0.4, omega=None):
        """Orders of jittering revolutions, speeds and rotations, with white noise of known variance."""
        omega = np.full(count, 60.0) if omega is None else omega
        turned = jitter * rng.standard_normal(count)
        waves = []
        for index in range(count):
            wave = axes_of(tire(THETA + turned[index])) * (omega[index] / omega.mean()) ** 2
            waves.append(waveform_orders(wave + sigma * math.sqrt(N / 2) * rng.standard_normal((3, N))))
        return np.stack(waves), omega, turned

    def test_alignment_removes_jitter_from_the_mean(self):
        rng = np.random.default_rng(1)
        orders, omega, turned = self.orders(80, rng, jitter=0.01)
        settled = settle(orders, omega, np.zeros(80))
        truth = waveform_orders(tire())
        high = slice(20, 80)
        smeared = np.abs(orders[:, 2].mean(axis=0) - truth)[high]
        remaining = np.abs(settled.orders_mps2[:, 2].mean(axis=0) * np.exp(-1j * ORDER * turned.mean()) - truth)[high]
        assert np.sqrt(np.mean(smeared**2)) > 3 * np.sqrt(np.mean(remaining**2))
        # Noise contributes 0.4 / sqrt(80) in cosine and sine.
        assert np.sqrt(np.mean(remaining**2)) == pytest.approx(0.4 * math.sqrt(2 / 80), rel=0.3)
        np.testing.assert_allclose(settled.shift_rad, turned - turned.mean(), atol=1.5e-3)
        assert settled.shift_rad.mean() == pytest.approx(0, abs=1e-12)

    @pytest.mark.parametrize("count", [4, 6, 30, 200])
    def test_variance_is_per_coefficient_and_revolution(self, count):
        results = []
        for seed in range(8):
            orders, omega, _ = self.orders(count, np.random.default_rng(seed), jitter=0.002)
            results.append(settle(orders, omega, np.zeros(count)).variance[2])
        mean = np.mean(results, axis=0)
        assert mean[1:].mean() == pytest.approx(0.16, rel=0.06)
        assert mean[0] == pytest.approx(0.08, rel=0.5)
        # Neighbouring orders compensate for few revolutions.
        assert np.std([item[60] for item in results]) < 0.16 * 0.45

    def test_speed_dependence_is_no_scatter(self):
        rng = np.random.default_rng(2)
        orders, omega, _ = self.orders(60, rng, omega=60 * np.linspace(0.985, 1.015, 60))
        assert settle(orders, omega, np.zeros(60)).variance[2, 1:].mean() == pytest.approx(0.16, rel=0.1)

    def test_gravity_and_drift_are_no_scatter(self):
        rng = np.random.default_rng(2)
        omega = 60 * np.linspace(0.985, 1.015, 60)
        drift = 20 * np.sin(np.arange(60))
        orders, _, _ = self.orders(60, rng, omega=omega, sigma=0.02)
        orders[:, 2, 1] += 9.8
        orders[:, 0, 0] += 0.32 * drift
        settled = settle(orders, omega, drift)
        assert settled.variance[0, 0] < 0.02**2
        assert settled.variance[2, 1] < 2 * 0.02**2

    def test_only_rare_outliers_are_removed(self):
        rng = np.random.default_rng(4)
        orders, omega, _ = self.orders(40, rng)
        blow = waveform_orders(np.where(np.abs(THETA - 2) < 0.05, 300.0, 0.0))
        rare = orders.copy()
        rare[[7, 19], 2] += blow
        settled = settle(rare, omega, np.zeros(40))
        assert np.flatnonzero(settled.wild).tolist() == [7, 19]
        assert settled.variance[2, 1:].mean() == pytest.approx(0.16, rel=0.1)
        often = orders.copy()
        often[::4, 2] += blow
        assert not settle(often, omega, np.zeros(40)).wild.any()

    def test_absent_axes_and_orders_stay_unknown(self):
        orders, omega, _ = self.orders(10, np.random.default_rng(5))
        orders[:, :, 70:] = math.nan
        settled = settle(orders, omega, np.zeros(10))
        assert np.isnan(settled.variance[1]).all()
        assert np.isnan(settled.variance[2, 70:]).all()
        assert np.isfinite(settled.variance[2, :70]).all()
        assert np.isfinite(settled.orders_mps2[:, 2, :70]).all()
        assert np.isnan(settled.orders_mps2[:, 1]).all()

    def test_two_revolutions_give_a_variance(self):
        orders, omega, _ = self.orders(2, np.random.default_rng(6))
        settled = settle(orders, omega, np.zeros(2))
        assert settled.variance[2, 1:].mean() == pytest.approx(0.16, rel=0.35)

    def test_noiseless_signal_has_positive_variance(self):
        orders, omega, _ = self.orders(6, np.random.default_rng(6), sigma=0.0)
        assert (settle(orders, omega, np.zeros(6)).variance[2] > 0).all()


class TestDeviations:
    def made(self, *, omega, tone_hz=230.0, tone=3.0, noise=0.0, shift=0.0, gap=False, rng=None):
        """Waveforms of revolutions of a tire with a tone in time on it."""
        rng = rng or np.random.default_rng(1)
        waves, period, begin = [], 2 * math.pi / omega, 0.0
        turned = shift * rng.standard_normal(len(omega))
        for position, item in enumerate(omega):
            time = begin + (THETA % (2 * math.pi)) / item
            wave = (item / omega.mean()) ** 2 * tire(THETA + turned[position]) + 9.8 * np.cos(THETA)
            wave = wave + tone * math.sqrt(2) * np.sin(2 * math.pi * tone_hz * time)
            waves.append(np.stack([wave, np.full(N, np.nan), wave + noise * rng.standard_normal(N)]))
            begin += period[position]
        index = np.arange(len(omega))
        if gap:
            index[len(omega) // 2 :] += 1
        rate = deviation_rate_hz(9600.0, N / period.max())
        runs = deviations(
            np.stack(waves).astype(np.float32),
            index=index,
            shift_rad=turned,
            period_s=period,
            omega_radps=omega,
            omega_dot_radps2=np.zeros(len(omega)),
            rate_hz=rate,
        ).runs
        return runs, rate

    @pytest.mark.parametrize("spread", [0.0, 0.01])
    def test_tone_is_kept_and_tire_removed(self, spread):
        runs, rate = self.made(omega=60.0 * (1 + spread * np.linspace(-1, 1, 120)))
        assert rate == 4000.0
        (run,) = runs
        assert run.dtype == np.float32
        assert np.isnan(run[1]).all()
        spectrum = welch_spectrum(run[2].astype(float), rate, 4000)
        assert spectrum.frequency_hz[np.argmax(spectrum.density_m2ps3)] == pytest.approx(230, abs=1)
        assert spectrum.rms_mps2(220, 240)[0] == pytest.approx(3.0, rel=0.02)
        assert spectrum.rms_mps2(5, 215)[0] < 0.15
        assert spectrum.rms_mps2(245, 1700)[0] < 0.15

    def test_high_tones_do_not_alias(self):
        (run,), rate = self.made(omega=np.full(120, 60.0), tone_hz=1560.3)
        assert welch_spectrum(run[2].astype(float), rate, 4000).rms_mps2(1540, 1580)[0] == pytest.approx(3, rel=0.03)
        (run,), _ = self.made(omega=np.full(120, 60.0), tone_hz=2700.7)
        assert np.std(run[2]) < 0.05

    def test_white_noise_keeps_its_density(self):
        (run,), rate = self.made(omega=np.full(100, 60.0), tone=0.0, noise=2.0)
        spectrum = welch_spectrum(run[2].astype(float), rate, 1000)
        density = 2.0**2 * 2 / (N * 60.0 / (2 * math.pi))
        for low, high in ((20, 400), (400, 1000), (1000, 1600)):
            assert spectrum.rms_mps2(low, high)[0] ** 2 / (high - low) == pytest.approx(density, rel=0.08)

    def test_known_jitter_is_no_deviation(self):
        (run,), _ = self.made(omega=np.full(100, 60.0), tone=0.0, shift=0.01)
        # Gravity does not jitter with the contact: 9.8 times 0.01.
        assert np.std(run[2]) < 0.12

    def test_a_gap_ends_a_run(self):
        runs, _ = self.made(omega=np.full(40, 60.0), gap=True)
        assert len(runs) == 2

    def test_low_speed_or_rate_reduces_bandwidth(self):
        assert deviation_rate_hz(2000.0, 1e4) == pytest.approx(1240)
        assert deviation_rate_hz(9600.0, 3000.0) == pytest.approx(1860)

    def test_single_revolutions_give_none(self):
        assert self.made(omega=np.full(1, 60.0))[0] == ()
