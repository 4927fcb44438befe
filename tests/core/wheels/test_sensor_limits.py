"""What is known of a sensor, what its signal says against its hello, and what clipping below its range biases."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from firmware_protocol.messages import Coupling
from gateway.core.estimates.estimator import Status
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.sensor_claims import SensorClaims
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.core.reasons import Code, Reason, codes_of
from gateway.core.trust.reasons import TrustCode
from gateway.core.trust.sensor_limits import (
    SensorLimits,
    coarse_steps,
    held_samples,
    high_corner,
    narrow_band,
    step_counts,
)
from gateway.core.wheels.reasons import WheelCode
from gateway.core.wheels.sample_content import SampleContent, is_chosen
from gateway.core.wheels.wheels import Pipeline
from tests.core.session.hub_frames import HELLO
from tests.testkit.signing_hub import hello_message
from tests.testkit.simulated_wheel import last, simulated

SETUP = WheelSetup("FL", 0, 0, 0.32, load_n=5000.0, pressure_pa=210e3)
ESTIMATORS = ("kinematic", "weak-form")
SPEED = "[motion]\nspeed_kmh = 65\n"


def statuses(tables: str, setup: WheelSetup = SETUP) -> dict[str, tuple[Status, tuple[Code, ...]]]:
    result = last(simulated(tables + SPEED, 4.0, setup, ESTIMATORS)[0])
    return {name: (estimate.status, codes_of(estimate.reasons)) for name, estimate in result.items()}


def test_limits_begin_where_a_number_is_biased_by_a_percent() -> None:
    assert narrow_band(None, 9.0) is narrow_band(60.0 * 9.0, 9.0) is None
    assert narrow_band(59.0 * 9.0, 9.0)["ratio"] == pytest.approx(59.0)
    assert high_corner(None, 9.0) is high_corner(0.9, 9.0) is None
    assert high_corner(0.95, 9.0).code is TrustCode.SENSOR_AC_CORNER
    assert coarse_steps(1.0, 0.5) is None
    assert coarse_steps(1.0, 0.49).code is TrustCode.SENSOR_STEPS


def revolution_counts(samples: int, seed: int) -> np.ndarray:
    """Counts of a revolution: slow away from the contact, which a sixteenth of the samples crosses at once."""
    angle = 2.0 * np.pi * (np.arange(samples) / samples + np.random.default_rng(seed).random())
    return 9000.0 + 200.0 * np.cos(angle) + 100.0 * np.sin(2.0 * angle) - 9000.0 * (np.cos(angle) > 0.98)


@given(step=st.floats(5.0, 60.0), samples=st.integers(100, 1500), seed=st.integers(0, 99))
def test_steps_show_in_few_samples_and_in_no_fine_sensor(step: float, samples: int, seed: int) -> None:
    fine = revolution_counts(samples, seed)
    coarse = np.rint(np.rint(fine / step) * step).astype(np.int16)
    assert step_counts(coarse) == pytest.approx(step, abs=1.0)
    assert step_counts(fine.astype(np.int16)) < 5.0
    assert step_counts(np.zeros(samples, np.int16)) == 1.0


@given(bits=st.integers(5, 7), samples=st.integers(200, 1500), seed=st.integers(0, 99))
def test_steps_of_floating_point_are_those_about_the_steady_value(bits: int, samples: int, seed: int) -> None:
    fine = revolution_counts(samples, seed)
    unit = 2.0 ** (np.floor(np.log2(np.maximum(np.abs(fine), 1.0))) - bits)
    assert step_counts(np.rint(np.rint(fine / unit) * unit).astype(np.int16)) >= 0.9 * 2.0 ** (13 - bits) / 2.0


def contact_counts(samples: int, seed: int) -> np.ndarray:
    """Counts of a revolution whose contact begins and ends within a twentieth of a turn."""
    angle = np.arange(samples) / samples + np.random.default_rng(seed).random()
    depth = np.clip((np.abs((angle % 1.0) - 0.5) - 0.04) / 0.05, 0.0, 1.0)
    return 9000.0 * depth + 200.0 * np.cos(2.0 * np.pi * angle)


@given(hold=st.integers(2, 20), turn=st.integers(25, 60), seed=st.integers(0, 99), step=st.sampled_from([1.0, 32.0]))
def test_held_values_show_and_those_of_a_coarse_sensor_do_not(hold: int, turn: int, seed: int, step: float) -> None:
    """Held over as many samples as 1 in `turn` of a revolution, one is sent late now and then."""
    values = np.rint(np.rint(contact_counts(turn, seed) / step) * step).astype(np.int16)
    lengths = hold + (np.random.default_rng(seed).random(turn) < 0.3)
    held = np.concatenate([np.repeat(values, lengths), np.repeat(values, lengths)])
    assert held_samples(held, step) == pytest.approx(hold, abs=1.0)
    whole = np.rint(np.rint(contact_counts(turn * hold, seed) / step) * step).astype(np.int16)
    assert held_samples(np.concatenate([whole, whole]), step) == 1.0


def test_held_values_end_the_band() -> None:
    revolution = simulated("[sensor]\nrange_g = 1000\n" + SPEED, 4.0, SETUP, ESTIMATORS)[0][-1].revolution
    limits = SensorLimits(hello_message(1, 0), None, ac_coupled=False)
    held = np.repeat(contact_counts(40, 1), 14).astype(np.int16)
    (doubt,) = limits.doubts(revolution, held, 0.32)
    wheel_hz = revolution.omega_radps / (2.0 * math.pi)
    assert doubt.reason.code is TrustCode.SAMPLES_HELD
    assert doubt.reason["ratio"] == pytest.approx(0.443 * revolution.rate_hz / 14.0 / wheel_hz)
    assert doubt.share > 0.01


@pytest.mark.parametrize(("corner_hz", "doubted"), [(0.5, False), (2.0, True)])
def test_high_corner_doubts_numbers_and_not_the_contact(corner_hz: float, doubted: bool) -> None:
    result = statuses(f"[sensor]\nrange_g = 1000\ncoupling = 'ac'\nhighpass_hz = {corner_hz}\n")
    assert (TrustCode.SENSOR_AC_CORNER in result["Ts"][1]) == doubted
    assert result["Ts"][0] is not Status.VALID or not doubted
    assert result["contact_length_m"][0] is Status.VALID
    assert result["speed_mps"][0] is Status.VALID


@pytest.mark.parametrize(("step_mg", "doubted"), [(10.0, False), (1000.0, True)])
def test_steps_that_no_noise_blurs_doubt_the_waveform(step_mg: float, doubted: bool) -> None:
    result = statuses(f"[sensor]\nrange_g = 400\nnoise_mg_rthz = [0.5, 0.5, 0.5]\nresolution_mg = {step_mg}\n")
    assert (TrustCode.SENSOR_STEPS in result["Ts"][1]) == doubted
    assert result["contact_length_m"][0] is Status.VALID


def test_narrow_band_doubts_all_but_times() -> None:
    setup = replace(SETUP, sensor=SensorClaims(bandwidth_hz=300.0))
    result = statuses("[sensor]\nrange_g = 1000\nbandwidth_hz = 300\n", setup)
    assert result["contact_length_m"] == (Status.PROVISIONAL, (TrustCode.SENSOR_BAND,))
    assert TrustCode.SENSOR_BAND in result["Bs"][1]
    assert result["speed_mps"][0] is Status.VALID


def test_bias_by_a_band_has_a_size_where_a_contact_was_lost() -> None:
    revolution = simulated("[sensor]\nrange_g = 1000\n" + SPEED, 4.0, SETUP, ESTIMATORS)[0][-1].revolution
    lost = replace(revolution, leading_edge_rad=math.nan, trailing_edge_rad=math.nan)
    counts = np.arange(100, dtype=np.int16)
    limits = SensorLimits(hello_message(1, 0), 300.0, ac_coupled=False)
    shares = [doubt.share for each in (lost, revolution, lost) for doubt in limits.doubts(each, counts, 0.32)]
    assert shares[0] == 0.0
    assert shares[1] == shares[2]
    assert 0.01 < shares[1] < 0.2


@pytest.mark.parametrize(
    ("sensor", "claims", "biased"),
    [
        ("bandwidth_hz = 200\n", SensorClaims(bandwidth_hz=200.0), ("contact_length_m", "Bs")),
        ("resolution_mg = 400\nnoise_mg_rthz = [0.2, 0.2, 0.2]\n", SensorClaims(), ("Ts",)),
    ],
)
def test_bias_by_a_limit_is_within_three_errors(sensor: str, claims: SensorClaims, biased: tuple[str, ...]) -> None:
    """Against the same wheel with a sensor that has no limits; each bias is 5 % and more."""
    quiet = "[sensor]\nrange_g = 1000\n"
    tables = f"{quiet}noise_mg_rthz = [2, 2, 2]\n{SPEED}"
    true = last(simulated(tables, 4.0, SETUP, ESTIMATORS)[0])
    setup = replace(SETUP, sensor=claims)
    result = last(simulated(f"{quiet}{sensor}{SPEED}", 4.0, setup, ESTIMATORS)[0])
    for name in biased:
        bias = result[name].value - true[name].value
        assert abs(bias) > 0.05 * true[name].value
        assert abs(bias) < 3.0 * result[name].std


@pytest.mark.parametrize("corner_hz", [0.3, 0.9, 4.0])
def test_stated_ac_corner_is_undone_in_numbers_and_forces(corner_hz: float) -> None:
    """Against a sensor that passes the steady value, on a wheel that turns 9 times a second."""
    quiet = "[sensor]\nrange_g = 1000\nnoise_mg_rthz = [2, 2, 2]\n"
    names = ("Bs", "Cw", "Rs", "Ts", "longitudinal_force_n", "axle_torque_nm")
    estimators = (*ESTIMATORS, "longitudinal-force")
    true = last(simulated(quiet + SPEED, 4.0, SETUP, estimators)[0])
    tables = f"{quiet}coupling = 'ac'\nhighpass_hz = {corner_hz}\n{SPEED}"
    result = last(simulated(tables, 4.0, SETUP, estimators)[0])
    for name in names:
        assert abs(result[name].value - true[name].value) < result[name].std, name
    assert result["contact_length_m"].value == pytest.approx(true["contact_length_m"].value, rel=2e-3)


CLIPPED_SETUP = WheelSetup("FL", 0, 0, 0.32, load_n=5000.0)


@pytest.mark.parametrize("rate_hz", [2000.0, 9600.0])
def test_undeclared_clipping_is_a_fault(roll, to_frames, rate_hz: float) -> None:
    signal = roll(65.0, 5.0, rate_hz).radial_mps2
    estimators = ("kinematic", "self-calibration")
    pipeline = Pipeline((CLIPPED_SETUP,), CLIPPED_SETUP, estimators)
    results = pipeline.frames("link", to_frames(np.minimum(signal, 1350.0), rate_hz), 10**18)
    assert len(results) > 30
    assert all(Reason(WheelCode.RADIAL_CLIPPED) in result.revolution.faults for result in results)
    assert pipeline.average_mps2("FL") is None
    gain = {estimate.name: estimate for estimate in results[-1].estimates}["gain"]
    assert gain.status is Status.INVALID
    assert codes_of(gain.reasons) == (EstimateCode.REVOLUTION_NOT_USED, WheelCode.RADIAL_CLIPPED)
    whole = Pipeline((CLIPPED_SETUP,), CLIPPED_SETUP, estimators).frames("link", to_frames(signal, rate_hz), 10**18)
    assert not any(result.revolution.faults for result in whole)


BLOCKS = 16
Words = NDArray[np.int16]


def codes_of_stream(words: Words, **hello: object) -> set[Code]:
    content, codes = SampleContent(), set()
    for rows in np.array_split(words.astype("<i2"), BLOCKS):
        codes |= {code for code, _ in content.block(HELLO._replace(**hello), rows)}
    return codes


def wheel(seed: int, noise: float, steady: float) -> Words:
    """Return 864 rows of a wheel that rolls: a steady value with dips, and noise."""
    rng = np.random.default_rng(seed)
    dips = 1.0 - np.exp(-(((np.arange(864) % 200 - 100) / 10.0) ** 6))
    rows = np.stack([0.2 * steady * np.gradient(dips) * 20, 0.0 * dips, steady * dips], axis=1)
    return np.clip(np.round(rows + rng.normal(0.0, noise, rows.shape)), -32768, 32767).astype("<i2")


@given(st.integers(0, 2**31), st.floats(0.6, 300.0), st.floats(-15_000.0, 15_000.0))
def test_right_bytes_pass_and_swapped_ones_are_named(seed: int, noise: float, steady: float) -> None:
    words = wheel(seed, noise, steady)
    assert codes_of_stream(words) == set()
    assert codes_of_stream(words.byteswap()) == {WheelCode.SAMPLES_BYTES_SWAPPED}


@given(st.integers(0, 2**31), st.integers(1, 15))
def test_left_aligned_words_of_fewer_bits_pass(seed: int, shift: int) -> None:
    words = np.random.default_rng(seed).integers(-(2 ** (15 - shift)), 2 ** (15 - shift), (864, 3)) << shift
    assert codes_of_stream(words.astype("<i2")) == set()


def test_noise_over_the_full_scale_and_still_samples_pass() -> None:
    assert codes_of_stream(np.random.default_rng(1).integers(-32768, 32768, (864, 3)).astype("<i2")) == set()
    assert codes_of_stream(np.full((864, 3), 1000, "<i2")) == set()


@pytest.mark.parametrize(
    ("hello", "named"),
    [
        ({"coupling": Coupling.DC}, False),
        ({"coupling": Coupling.AC}, True),
        ({"coupling": Coupling.AC, "highpass_hz": 2.0}, True),
        # It passes what is steady for seconds.
        ({"coupling": Coupling.AC, "highpass_hz": 0.05}, False),
        # The steady value is the stated zero.
        ({"coupling": Coupling.AC, "offset_counts": (0.0, 0.0, 7000.0)}, False),
    ],
)
def test_a_steady_value_contradicts_ac_coupling(hello: dict[str, object], named: bool) -> None:
    words = wheel(1, 20.0, 7600.0)
    assert codes_of_stream(words, **hello) == ({WheelCode.HELLO_AC_WITH_STEADY_VALUE} if named else set())


def test_ac_coupled_wheel_and_gravity_alone_pass() -> None:
    words = wheel(1, 20.0, 7600.0).astype(float)
    assert codes_of_stream(np.round(words - words.mean(axis=0)), coupling=Coupling.AC) == set()
    assert codes_of_stream(wheel(1, 2.0, 9.81 / 0.125), coupling=Coupling.AC) == set()


def test_the_level_between_contacts_is_no_steady_value() -> None:
    """Of an AC-coupled sensor, and no block has met a contact."""
    words = wheel(1, 20.0, 7600.0).astype(float)
    between = (words - words.mean(axis=0))[words[:, 2] > 7500]
    assert between[:, 2].mean() > 300
    assert codes_of_stream(np.round(between), coupling=Coupling.AC) == set()


def test_one_block_in_32_is_chosen_at_distances_that_differ() -> None:
    places = np.flatnonzero([is_chosen(first) for first in range(0, 36 * 100_000, 36)])
    assert len(places) == pytest.approx(100_000 / 32, rel=0.05)
    assert len(set(np.diff(places).tolist())) > 2
