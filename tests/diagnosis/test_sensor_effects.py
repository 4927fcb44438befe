"""Effects of the sensor and its axes against samples changed one by one: gains, delays, length and friction.

Delay, length and friction are planted by interpolation in time, by means over points, and by the rate law of Dahl.
Load and speed change together, so that a length, locked to the angle, and a filter, locked to frequency, are rivals.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from gateway.core.types import FloatArray
from gateway.diagnosis.bayes.parameter_estimates import fitted_parameter
from gateway.diagnosis.effects.angle_orders import ORDERS, field_orders
from gateway.diagnosis.effects.catalogue import catalogue
from gateway.diagnosis.effects.effect import (
    CIRCUMFERENTIAL,
    FIELD_SIZE,
    RADIAL,
    GroupConditions,
    ModelledBlock,
    RingEffect,
)
from gateway.diagnosis.effects.ring_options import RingOptions
from gateway.ring.rolling_ring import RingParameters, solve_rolling_ring
from gateway.ring.rolling_ring.sensor_waveform import SensorWaveform
from gateway.simulator.tire_table import look_up
from tests.diagnosis.planted_campaign import RADIUS_M, TWO_SPEEDS, Plant, among, campaign_of, conditions, ring, searched
from tests.diagnosis.sensor_data import (
    CONDITIONS,
    OMEGA,
    RATE,
    THETA,
    G,
    applied,
    at_angles,
    block_of,
    effect_of,
    plan_of,
    rms,
    samples,
    tail,
)


@pytest.mark.parametrize(
    ("sensor", "parameters", "close"),
    [
        ("roll_deg = 3.0", {"roll_tilt": (math.radians(3.0),)}, 2e-3),
        ("pitch_deg = -2.0", {"pitch_tilt": (math.radians(-2.0),)}, 2e-3),
        (
            "roll_deg = -4.0\npitch_deg = 3.0",
            {"roll_tilt": (math.radians(-4.0),), "pitch_tilt": (math.radians(3.0),)},
            2e-3,
        ),
        ("gain_error_percent = [0.0, 0.0, 3.0]", {"gain": (0.03,)}, 3e-3),
        ("zero_g_offset_g = [1.0, -2.0, 3.0]", {"zero_g_offset": (G, -2.0 * G, 3.0 * G)}, 3e-3),
        ("bandwidth_hz = 700.0", {"anti_alias_filter": (1.0 / 700.0, 1.0)}, 0.01),
        ("bandwidth_hz = 1500.0", {"anti_alias_filter": (1.0 / 1500.0, 1.0)}, 0.03),
        ("coupling = 'ac'\nhighpass_hz = 2.0", {"AC_coupling": (2.0, 0.0)}, 2e-3),
        (
            "roll_deg = 2.0\npitch_deg = 1.5\ngain_error_percent = [0.0, 0.0, -4.0]\nzero_g_offset_g = [0.5, 1.0, -2.0]"
            "\nbandwidth_hz = 900.0\ncoupling = 'ac'\nhighpass_hz = 1.0",
            {
                "roll_tilt": (math.radians(2.0),),
                "pitch_tilt": (math.radians(1.5),),
                "gain": (-0.04,),
                "zero_g_offset": (0.5 * G, G, -2.0 * G),
                "anti_alias_filter": (1.0 / 900.0, 1.0),
                "AC_coupling": (1.0, 0.0),
            },
            4e-3,
        ),
    ],
)
def test_contribution_matches_the_simulated_sensor(sensor: str, parameters: dict, close: float) -> None:
    until_s = 3.0 if "coupling" in sensor else 0.5
    measured, angle = tail(samples(plan_of(sensor=sensor), until_s))
    plain, _ = tail(samples(plan_of(), until_s))
    block = block_of()
    # A contact is found behind the filter, as late as the low orders.
    late = math.sqrt(2.0) * OMEGA / (2.0 * math.pi) * parameters.get("anti_alias_filter", (0.0,))[0]
    expected = at_angles(applied(block, **parameters).signal_mps2, angle - late) - at_angles(block.signal_mps2, angle)
    assert rms(expected) > 2.0
    assert rms(measured - plain - expected) < close * rms(expected) + 0.03


@pytest.mark.parametrize(("resonance_hz", "quality"), [(700.0, 10.0), (1000.0, 10.0), (1000.0, 20.0)])
def test_mounting_resonance_matches_the_simulated_one(resonance_hz: float, quality: float) -> None:
    """The simulated bond has viscous damping, the effect's a loss factor: they agree at the resonance."""
    defect = f"[wheel.defect]\nloose_hz = {resonance_hz}\nloose_q = {quality}"
    measured, angle = tail(samples(plan_of(defect), 0.5))
    plain, _ = tail(samples(plan_of(), 0.5))
    block = block_of()
    parameters = ((2.0 * math.pi * resonance_hz) ** -2, 1.0, 1.0 / quality)
    expected = at_angles(applied(block, mounting_resonance=parameters).signal_mps2 - block.signal_mps2, angle)
    assert rms(expected) > 0.5
    assert rms(measured - plain - expected) < 0.1 * rms(expected)


def test_mounting_resonance_is_lower_along_the_inner_liner() -> None:
    block = block_of()
    made = applied(block, mounting_resonance=(2.5e-8, 2.0, 0.1)).signal_mps2 - block.signal_mps2
    alike = applied(block, mounting_resonance=(1e-7, 1.0, 0.1)).signal_mps2 - block.signal_mps2
    assert made[:RADIAL] == pytest.approx(alike[:RADIAL])
    assert rms(made[RADIAL]) < 0.5 * rms(alike[RADIAL])


def test_mounting_in_reverse_matches_the_simulated_sensor() -> None:
    sensor = "pitch_deg = 2.0\nroll_deg = 1.0\nzero_g_offset_g = [3.0, 1.0, 0.5]"
    motion = "[wheel.motion]\ndirection = 'reverse'"
    measured, angle = tail(samples(plan_of(motion, sensor)))
    plain, _ = tail(samples(plan_of(motion)))
    block = block_of(wheel=motion)
    block = replace(block, conditions=replace(block.conditions, reverse=True))
    parameters = {"roll_tilt": (math.radians(1.0),), "pitch_tilt": (math.radians(2.0),)}
    after = applied(block, **parameters, zero_g_offset=(3.0 * G, G, 0.5 * G)).signal_mps2
    # The campaign's circumferential axis points along the rotation.
    difference = (measured - plain) * [-1.0, 1.0, 1.0]
    assert rms(difference - at_angles(after - block.signal_mps2, angle)) < 0.1


def test_gain_drifts_from_the_calibration_temperature() -> None:
    drift = "gain_drift_percent_per_k = [0.0, 0.0, 0.1]"
    warm, angle = tail(samples(plan_of("temperature_degc = 45.0", drift)))
    plain, _ = tail(samples(plan_of("temperature_degc = 45.0")))
    block = block_of()
    block = replace(block, conditions=replace(block.conditions, temperature_degc=45.0))
    expected = at_angles(applied(block, gain_temperature_drift=(1e-3, 25.0)).signal_mps2 - block.signal_mps2, angle)
    assert warm - plain == pytest.approx(expected, abs=0.15)
    assert rms(expected[:, RADIAL]) == pytest.approx(0.02 * rms(plain[:, RADIAL]), rel=0.01)
    assert not effect_of("gain-temperature drift").starts((CONDITIONS, CONDITIONS))


@pytest.mark.parametrize("speed_kmh", [50.0, 65.0, 80.0])
def test_clipping_limit_is_the_same_at_every_speed(speed_kmh: float) -> None:
    limit_g = 110.0
    plan = plan_of(f"[wheel.defect]\nclip_g = {limit_g}", "", speed_kmh)
    omega = speed_kmh / 3.6 / 0.32
    measured, angle = tail(samples(plan), omega)
    plain, _ = tail(samples(plan_of("", "", speed_kmh)), omega)
    block = block_of(speed_kmh)
    expected = at_angles(applied(block, clipping=(1.0 / (limit_g * G), 0.0)).signal_mps2 - block.signal_mps2, angle)
    # On the grid the corners ring a little.
    assert rms(measured - plain - expected) < 0.02 * rms(expected) + 0.1
    assert (rms(expected) > 5.0) == (speed_kmh > 50.0)


@pytest.mark.parametrize("share", [0.5, 0.8, 0.97])
@pytest.mark.parametrize("speed_kmh", [40.0, 100.0])
def test_clipped_cosine_has_its_exact_coefficients(share: float, speed_kmh: float) -> None:
    """Corners fold into no order that is compared: what folds would look like a low-pass."""
    block = block_of(speed_kmh)
    top = CONDITIONS.radius_m * block.conditions.omega_radps**2
    signal = np.zeros_like(block.signal_mps2)
    signal[RADIAL] = top * np.cos(3.0 * THETA)
    cut = applied(replace(block, signal_mps2=signal), clipping=(1.0 / (share * top), 0.0)).signal_mps2 - signal
    # Minus the integral of (cos t - share) cos(n t) / pi over the part that is cut off, from above and from below.
    n, end = np.arange(3, ORDERS // 3, 2), math.acos(share)
    above = np.sin((n - 1) * end) / (n - 1) + np.sin((n + 1) * end) / (n + 1) - 2.0 * share * np.sin(n * end) / n
    orders = field_orders(cut)[RADIAL]
    # The grid starts at -pi, where the cosine is negative.
    assert orders[3 * n] == pytest.approx(-2.0 * top / math.pi * above, abs=4e-6 * top)
    orders[3 : 3 * n[-1] + 1 : 6] = 0.0
    assert np.abs(orders).max() < 4e-6 * top


def test_knee_matches_the_mean_of_noisy_clipped_revolutions() -> None:
    block, limit, noise = block_of(), 1250.0, 40.0
    noisy = block.signal_mps2[RADIAL] + noise * np.random.default_rng(1).standard_normal((20_000, FIELD_SIZE))
    mean = np.clip(noisy, -limit, limit).mean(axis=0)
    softly = applied(block, clipping=(1.0 / limit, noise / limit)).signal_mps2[RADIAL]
    hard = applied(block, clipping=(1.0 / limit, 0.0)).signal_mps2[RADIAL]
    assert rms(softly - mean) < 1.15 * noise / math.sqrt(len(noisy))
    assert rms(hard - mean) > 4.0 * rms(softly - mean)


@pytest.mark.parametrize("clock_ppm", [-900.0, 900.0])
def test_fast_clock_makes_the_wheel_look_slow(clock_ppm: float) -> None:
    """The rate error is that of an unmeasured rate: the samples are assumed to come at RATE."""
    error_ppm = math.copysign(9000.0, clock_ppm)
    plan = plan_of(sensor=f"rate_error_ppm = {error_ppm}", hub=f"clock_ppm = {clock_ppm}")
    share = (1.0 + error_ppm * 1e-6) * (1.0 + clock_ppm * 1e-6) - 1.0
    measured, angle = tail(samples(plan), OMEGA, RATE * (1.0 + share))
    seen = block_of(65.0 / (1.0 + share))
    after = applied(seen, sample_clock_error=(share,))
    plane = [CIRCUMFERENTIAL, RADIAL]
    assert rms((measured - at_angles(after.signal_mps2, angle))[:, plane]) < 0.3
    assert rms((measured - at_angles(seen.signal_mps2, angle))[:, plane]) > 10.0


@pytest.mark.parametrize("offset_m", [0.0, 6e-3])
def test_larger_belt_scales_the_ring_only(offset_m: float) -> None:
    share = 0.03
    ring = RingParameters.from_numbers(3.08e-3, 0.195, 2.97, 2.53, radius_m=0.32, pressure_pa=2.1e5)
    larger = RingParameters.from_numbers(
        3.08e-3,
        0.195,
        2.97,
        2.53,
        radius_m=0.32 * (1.0 + share),
        pressure_pa=2.1e5,
        extension_stiffness_n=ring.extension_stiffness_n * (1.0 + share) ** 2,
    )
    stated = solve_rolling_ring(ring, 5000.0, 2.1e5, OMEGA, nodes=FIELD_SIZE, sensor_offset_m=offset_m)
    load_n = 5000.0 * (1.0 + share) ** 2
    true = solve_rolling_ring(larger, load_n, 2.1e5, OMEGA, nodes=FIELD_SIZE, sensor_offset_m=offset_m)
    omega_dot = 8.0
    # A revolution from contact centre to contact centre, its omega the mean: slower in its first half.
    elapsed = np.where(THETA >= 0.0, THETA - math.pi, THETA + math.pi)

    def signal_from(wave: SensorWaveform) -> np.ndarray:
        signal = np.zeros((3, FIELD_SIZE))
        radial, along = wave.specific_force(OMEGA, omega_dot)
        signal[RADIAL] = radial + 2.0 * omega_dot * elapsed * wave.radial_m
        signal[CIRCUMFERENTIAL] = along + 2.0 * omega_dot * elapsed * wave.circumferential_m
        return signal

    conditions = replace(CONDITIONS, omega_dot_radps2=omega_dot)
    block = ModelledBlock(conditions, THETA, signal_from(stated.sensor), stated.sensor, -0.24, 0.24)
    after = applied(block, rolling_radius=(share,)).signal_mps2
    assert rms(after - signal_from(true.sensor)) < 2e-4 * rms(after)
    assert rms(after - (1.0 + share) * block.signal_mps2) > 0.1


def test_mounting_offset_matches_the_simulated_sensor() -> None:
    effect = catalogue()["mounting offset"]
    assert isinstance(effect, RingEffect)
    declared = RingOptions(sensor_offset_m=0.002)
    assert effect.options(declared, np.zeros(1), CONDITIONS) == declared
    options = effect.options(declared, np.array([0.006]), CONDITIONS)
    plan = plan_of(sensor="offset_mm = 8.0")
    truth = look_up(plan.table().waveform(5000.0, 2.1e5, OMEGA), THETA)
    ring = plan.tire.ring
    wave = solve_rolling_ring(ring, 5000.0, 2.1e5, OMEGA, nodes=720, sensor_offset_m=options.sensor_offset_m).sensor
    coarse = np.interp(THETA, -math.pi + 2.0 * math.pi / 720 * np.arange(720), wave.circumferential_m)
    assert rms(coarse - truth[:, 1]) < 0.02 * rms(truth[:, 1])
    assert rms(truth[:, 1]) > 0.005


def test_ac_coupled_mean_lags_behind_a_changing_speed() -> None:
    """The mean of a high-pass of a steadily growing signal is its rate of change times 1 / (2 pi corner)."""
    corner_hz, omega_dot_radps2 = 0.2, 0.5
    block = block_of(omega_dot_radps2=omega_dot_radps2)
    lag_s = 1.0 / (2.0 * math.pi * corner_hz)
    passed = applied(block, AC_coupling=(corner_hz, lag_s)).signal_mps2
    time_s = np.arange(0.0, 20.0, 1.0 / RATE)
    omega = OMEGA + omega_dot_radps2 * (time_s - time_s[-1])
    mean = block.signal_mps2[RADIAL].mean() * (omega / OMEGA) ** 2
    high = lfilter(*butter(1, corner_hz, "high", fs=RATE), mean)
    assert passed[RADIAL].mean() == pytest.approx(high[-1], rel=0.03)
    assert high[-1] > 1.0


def test_ac_coupled_sensor_passes_no_constant() -> None:
    block = block_of()
    ac = replace(block, conditions=replace(block.conditions, ac_coupled=True))
    effect = effect_of("zero-g offset")
    values = np.array([1.0, 2.0, 3.0])
    assert not effect.contribution(ac, values).any()
    assert not effect.derivative(ac, values).any()
    passed = applied(block, AC_coupling=(0.3, 1.0)).signal_mps2
    assert np.abs(passed.mean(axis=1)).max() < 1e-9


def test_filter_delay_is_left_to_the_contact_centre() -> None:
    block = block_of()
    effect = effect_of("anti-alias filter")
    before = np.fft.rfft(block.signal_mps2[RADIAL])[1:6]

    def turned(inverse_corner_s: float) -> np.ndarray:
        added = effect.contribution(block, np.array([inverse_corner_s, 1.0]))[RADIAL]
        return np.angle(np.fft.rfft(block.signal_mps2[RADIAL] + added)[1:6] / before)

    order_hz = np.arange(1, 6) * block.conditions.omega_radps / (2.0 * math.pi)
    x = order_hz / 600.0
    # A delay would be sqrt(2) x; the remaining phase begins with the cube.
    assert turned(1.0 / 600.0) == pytest.approx(-math.sqrt(2.0) / 3.0 * x**3, rel=0.05)
    assert turned(1.0 / 300.0) == pytest.approx(8.0 * turned(1.0 / 600.0), rel=0.2)


NAMES = ("circumferential gain", "mounting offset", "gain", "shear flexibility")
GAIN_DEPTH_M, GAIN = 0.003, 0.05


def sensor(depth_m: float, gain: float) -> Callable[[FloatArray, FloatArray, GroupConditions], FloatArray]:
    """Return what a sensor below the neutral layer reads whose circumferential axis has a gain error."""

    def plant(signal: FloatArray, theta: FloatArray, conditions: GroupConditions) -> FloatArray:
        read = signal.copy()
        # V^2 kappa of the neutral layer, without gravity.
        bent = conditions.omega_radps**2 * ring(conditions.load_n).sensor.radial_m
        orders = np.fft.fftfreq(len(theta), 1.0 / len(theta))
        slope = np.fft.ifft(1j * orders * np.fft.fft(bent)).real
        share = depth_m / conditions.radius_m
        read[CIRCUMFERENTIAL] = (1.0 + gain) * (signal[CIRCUMFERENTIAL] - share * slope)
        read[RADIAL] -= share * np.square(bent) / (conditions.radius_m * conditions.omega_radps**2)
        return read

    return plant


@pytest.mark.parametrize(
    ("depth_m", "gain", "identified"),
    [
        (0.0, GAIN, {"circumferential gain"}),
        (GAIN_DEPTH_M, 0.0, {"mounting offset"}),
        (GAIN_DEPTH_M, GAIN, {"circumferential gain", "mounting offset"}),
    ],
)
def test_circumferential_gain_is_no_depth(depth_m: float, gain: float, identified: set[str]) -> None:
    """Gravity tells: it grows with the gain, but not with the depth."""
    posterior, _ = searched(campaign_of(TWO_SPEEDS, sensor(depth_m, gain), noise_mps2=0.3), among(*NAMES))
    assert set(posterior.identified()) == identified
    fit = posterior.best.fit
    for name, truth in (("circumferential gain", gain), ("mounting offset", depth_m)):
        if name in identified:
            where = fit.model.layout.effect(name)
            value, std = float(fit.vector[where][0]), math.sqrt(fit.covariance[where, where][0, 0])
            assert value == pytest.approx(truth, abs=3.0 * std), name
            assert std < 0.2 * truth, name


def test_gain_is_a_part_of_the_error_of_what_goes_with_it() -> None:
    for effect in among("ply steer", "conicity", "carcass compliance").values():
        size = effect.parameters[0]
        reference, unsure = (fitted_parameter(size, 2e-3, 3e-5, gain_std) for gain_std in (0.0, 0.02))
        assert reference.std == pytest.approx(3e-5)
        assert unsure.std == pytest.approx(5e-5)
    (offset,) = among("mounting offset")["mounting offset"].parameters
    assert fitted_parameter(offset, 2e-3, 3e-5, 0.02).std == pytest.approx(3e-5)


GROUPS = (conditions(60.0, load_n=4500.0), conditions(90.0, load_n=3600.0))
DEPTH_M = 0.004
LATE_S, LENGTH_M, CORNER_HZ, FRICTION_MPS2 = 90e-6, 0.022, 531.0, 4.0
_POINTS, _HALVINGS, PRESLIDING = 65, 30, 30.0


def sampled_at(signal: FloatArray, theta: FloatArray, angle: FloatArray) -> FloatArray:
    """Return a periodic signal (3, n) at angles by linear interpolation."""
    return np.stack([np.interp(angle, theta, row, period=2.0 * math.pi) for row in signal])


def late(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
    """A circumferential axis that is read after the others."""
    read = signal.copy()
    read[CIRCUMFERENTIAL] = sampled_at(signal, theta, theta - group_conditions.omega_radps * LATE_S)[CIRCUMFERENTIAL]
    return read


def long(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
    """A board that reads the mean over points along its length."""
    reach = 0.5 * LENGTH_M / RADIUS_M * (1.0 - 1.0 / _POINTS)
    points = [sampled_at(signal, theta, theta + shift) for shift in np.linspace(-reach, reach, _POINTS)]
    return np.asarray(np.mean(points, axis=0))


def slow(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
    """A converter with a low-pass of two poles, stepped through time until it repeats."""
    step = float(theta[1] - theta[0]) / group_conditions.omega_radps * 2.0 * math.pi * CORNER_HZ
    read, value, rate = signal.copy(), signal[:, 0].copy(), np.zeros(3)
    for number in range(2 * len(theta)):
        rate += step * (signal[:, number % len(theta)] - value - math.sqrt(2.0) * rate)
        value = value + step * rate
        read[:, number % len(theta)] = value
    # The contact is timed behind the filter.
    return sampled_at(read, theta, theta + group_conditions.omega_radps * math.sqrt(2.0) / (2.0 * math.pi * CORNER_HZ))


def rubbing(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
    """An element held by friction that grows towards its limit with the element's own way (Dahl), way by way."""
    read = sensor(DEPTH_M, 0.0)(signal, theta, group_conditions)
    axis, force, moved = read[CIRCUMFERENTIAL].tolist(), 0.0, float(read[CIRCUMFERENTIAL, 0])
    for number in range(2 * len(axis)):
        change = axis[number % len(axis)] - moved - force
        limit, low, high = math.copysign(FRICTION_MPS2, change), 0.0, abs(change) + 2.0 * FRICTION_MPS2
        for _ in range(_HALVINGS):
            way = 0.5 * (low + high)
            held = limit + (force - limit) * math.exp(-way * PRESLIDING / FRICTION_MPS2)
            low, high = (way, high) if way + abs(held - force) < abs(change) else (low, way)
        moved, force = moved + math.copysign(way, change), held
        read[CIRCUMFERENTIAL, number % len(axis)] = moved
    return read


def below(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
    """A late axis of a sensor below the neutral layer, whose circumferential axis is not gravity alone."""
    return late(sensor(DEPTH_M, 0.0)(signal, theta, group_conditions), theta, group_conditions)


@pytest.mark.parametrize(
    ("plant", "name", "size"),
    [
        (below, "circumferential delay", LATE_S),
        (long, "sensor length", LENGTH_M),
        (slow, "anti-alias filter", 1.0 / CORNER_HZ),
        (rubbing, "circumferential hysteresis", FRICTION_MPS2),
    ],
)
def test_cause_is_identified_beside_its_rivals(plant: Plant, name: str, size: float) -> None:
    rivals = (
        "circumferential delay",
        "sensor length",
        "anti-alias filter",
        "circumferential hysteresis",
        "mounting offset",
    )
    posterior, _ = searched(campaign_of(GROUPS, plant, noise_mps2=0.5), among(*rivals))
    identified = set(posterior.identified()) - {"mounting offset"}
    assert identified == {name}
    fit = posterior.best.fit
    assert float(fit.vector[fit.model.layout.effect(name)][0]) == pytest.approx(size, rel=0.05)


def test_filter_at_a_single_speed_may_be_a_length() -> None:
    """What is locked to frequency is certain only if its rival locked to the angle loses."""
    posterior, _ = searched(campaign_of(GROUPS[:1], slow, noise_mps2=0.5), among("sensor length", "anti-alias filter"))
    assert not posterior.identified()
    assert {"sensor length", "anti-alias filter"} in [set(names) for names in posterior.alternatives()]
