"""Status of estimates after all that is known against them, drifting averages and old pressures; their names."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_protocol.messages import Environment
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.sensor_claims import SensorClaims
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.core.quantity import Basis
from gateway.core.quantity_catalogue import CATALOGUE, quantity_of
from gateway.core.reasons import Reason, codes_of
from gateway.core.revolutions.synchronous_average import DEFAULT_HORIZON_REVOLUTIONS
from gateway.core.trust.qualification import OwnDrift, provisional_where, qualified
from gateway.core.trust.reasons import TrustCode
from gateway.core.trust.sensor_limits import Doubt
from gateway.core.trust.signal_evidence import Evidence
from gateway.core.wheels.old_pressure import change_since_reading_pa
from gateway.core.wheels.outside_readings import OutsideReading
from gateway.core.wheels.tire_estimates import TireEstimates
from gateway.core.wheels.wheels import Pipeline
from gateway.forces.ply_steer import HORIZON_REVOLUTIONS
from tests.core.wheels.rolling_signals import LOAD_N, PRESSURE_PA, RADIUS_M
from tests.testkit.simulated_wheel import last, simulated

NOTHING = Evidence(0.0, 0.0, True, 0.0, 0.0, 0.3, 0.003)
NAMES = sorted({quantity.name for quantities in CATALOGUE.values() for quantity in quantities})
DOUBT = Reason(EstimateCode.SAMPLES_LOST)


def judged(name: str, value: float, std: float) -> Estimate:
    return qualified((Estimate(name, value, std, Status.VALID),), NOTHING, (), None)[0]


@pytest.mark.parametrize(
    ("name", "value", "std"),
    [
        ("wear_mm", -0.94, 0.10),
        ("gain", 0.001, 0.0006),
        ("gain", 1.9, 0.1),
        ("zero_g_offset_mps2", 1017.0, 0.6),
        ("roll_tilt_rad", 0.52, 0.003),
        ("sensor_roll_rad", -0.52, 0.003),
        ("cavity_temperature_degc", 240.0, 10.0),
        ("longitudinal_ratio", 3.0, 0.1),
        ("rolling_resistance", 1.4, 0.31),
        ("Cw", 0.51, 0.051),
        ("Rs", 0.11, 0.01),
        ("speed_mps", 400.0, 3.0),
        ("wear_mm", -0.1, 0.0),
    ],
)
def test_what_is_not_possible_is_not_valid(name: str, value: float, std: float) -> None:
    estimate = judged(name, value, std)
    assert estimate.status is Status.PROVISIONAL
    (reason,) = estimate.reasons
    assert reason.code is TrustCode.NOT_POSSIBLE
    assert estimate.value == value


@pytest.mark.parametrize(
    ("name", "value", "std"),
    [("wear_mm", -0.2, 0.1), ("gain", 1.03, 0.01), ("roll_tilt_rad", 0.1, 0.001), ("Rs", 2.9, 0.1)],
)
def test_what_is_possible_within_its_error_stays_valid(name: str, value: float, std: float) -> None:
    assert judged(name, value, std) == Estimate(name, value, std, Status.VALID)


@given(name=st.sampled_from(NAMES), value=st.floats(allow_nan=False), std=st.floats(min_value=0.0) | st.just(math.nan))
def test_no_valid_value_is_beyond_its_limits(name: str, value: float, std: float) -> None:
    estimate = judged(name, value, std)
    least, greatest = quantity_of(name).possible
    if estimate.status is Status.VALID and not least <= value <= greatest:
        assert max(least - value, value - greatest) <= 2.5 * std


@pytest.mark.parametrize("name", NAMES)
def test_doubts_reach_what_rests_on_the_samples_and_the_waveform(name: str) -> None:
    estimate = Estimate(name, 0.5 * sum(quantity_of(name).possible), 0.1, Status.VALID)
    (doubted,) = qualified((estimate,), NOTHING, (Doubt(Basis.SAMPLES, DOUBT),), None)
    assert (doubted.status is Status.PROVISIONAL) == (Basis.SAMPLES in quantity_of(name).rests_on)
    (uncorrected,) = qualified((estimate,), NOTHING, (), DOUBT)
    is_affected = Basis.WAVEFORM in quantity_of(name).rests_on
    assert (TrustCode.EFFECTS_NOT_SUBTRACTED in codes_of(uncorrected.reasons)) == is_affected


def test_every_quantity_has_limits() -> None:
    assert [name for name in NAMES if not all(map(math.isfinite, quantity_of(name).possible))] == []


@pytest.mark.parametrize(("name", "value"), [("Cw", 0.9), ("Rs", 55.0), ("Cw", 0.02)])
def test_numbers_of_no_tire_leave_nothing_valid_that_their_causes_scale(name: str, value: float) -> None:
    """A load in kg, that of the axle, or half the pressure scales all four numbers."""
    numbers = {"Bs": 3e-3, "Cw": 0.2, "Rs": 3.0, "Ts": 2.5, "Bs/Cw": 0.015} | {name: value}
    estimates = tuple(Estimate(each, size, 0.01 * size, Status.VALID) for each, size in numbers.items())
    judged_ones = {each.name: each for each in qualified(estimates, NOTHING, (), None)}
    assert {each for each, estimate in judged_ones.items() if estimate.status is Status.VALID} == {"Bs/Cw"}
    for each in {"Bs", "Cw", "Rs", "Ts"} - {name}:
        if judged_ones[each].reasons:
            assert TrustCode.NOT_POSSIBLE in codes_of(judged_ones[each].reasons)


def test_a_ratio_of_no_tire_leaves_nothing_valid_that_rests_on_the_shape() -> None:
    """No load scales a ratio: the signal is not that of a belt alone."""
    ratios = {"Bs": (3e-3, 3e-5), "Bs/Cw": (0.015, 2e-4), "Ts/Cw": (107.0, 7.0)}
    estimates = tuple(Estimate(name, *value, Status.VALID) for name, value in ratios.items())
    for estimate in qualified(estimates, NOTHING, (), None):
        assert (estimate.status, codes_of(estimate.reasons)) == (Status.PROVISIONAL, (TrustCode.NOT_POSSIBLE,))


def test_a_reason_is_given_once() -> None:
    estimate = Estimate("Cw", 0.2, 0.01, Status.PROVISIONAL, (DOUBT,))
    assert provisional_where((estimate,), Basis.PRESSURE, DOUBT) == (estimate,)


@pytest.mark.parametrize("verified", [False, True])
def test_sign_of_an_unverified_lateral_axis_is_noted(verified: bool) -> None:
    setup = WheelSetup("FL", 0, 0, 0.32, sensor=SensorClaims(lateral_is_left=verified))
    result = last(simulated("[tire]\ncord_angle_deg = 20", 4.0, setup, ("kinematic", "ply-steer"))[0])
    for name, estimate in result.items():
        noted = TrustCode.LATERAL_SIGN_UNVERIFIED in codes_of(estimate.reasons)
        rests = Basis.SIGN in quantity_of(name).rests_on and estimate.status is not Status.INVALID
        assert noted == (rests and not verified), name
    # The size holds.
    assert result["ply_steer_contact_line_rad"].status is Status.VALID


PRESSURE_SETUP = WheelSetup("FL", 0, 0, 0.32, load_n=4200.0, pressure_std_pa=1000.0)


def reading(pressure_pa: float | None) -> Environment:
    return Environment(pressure_pa, 30.0, None)


def test_error_of_a_falling_pressure_is_that_of_its_fall_until_the_next_reading() -> None:
    tire = TireEstimates(PRESSURE_SETUP, ("kinematic",))
    for second, pressure_pa in enumerate((210e3, 209e3, 197e3, 185e3)):
        tire.environment(1_000_000 * second, reading(pressure_pa), 0.0)
    stds = [tire.conditions(1e6 * at_s, 0.0).pressure_std_pa for at_s in (0.5, 1.5, 2.5, 3.5)]
    fall = 12e3 / math.sqrt(3.0)
    assert stds == pytest.approx([1000.0, 1000.0, fall, fall])
    # The pressure at the end of each interval is within two of these errors.
    assert 2.0 * fall > 12e3


def test_readings_without_a_pressure_say_nothing_of_its_change() -> None:
    readings = [(3, reading(None), 0.0), (2, reading(200e3), 0.0), (1, reading(None), 0.0), (0, reading(203e3), 0.0)]
    assert change_since_reading_pa(readings) == pytest.approx(3e3 / math.sqrt(3.0))
    assert change_since_reading_pa(readings[:2]) == 0.0


def test_the_last_pressure_holds_over_readings_without_one_and_grows_old() -> None:
    tire = TireEstimates(replace(PRESSURE_SETUP, pressure_pa=250e3), ("kinematic",))
    for second in range(30):
        pressure_pa = 160e3 if second < 10 and second % 2 == 0 else None
        tire.environment(1_000_000 * second, Environment(pressure_pa, 20.0 + second, None), 0.0)
        conditions = tire.conditions(1e6 * second, 0.0)
        assert (conditions.pressure_pa, conditions.temperature_degc) == (160e3, 20.0 + second)
        assert conditions.pressure_measured
    assert tire._old_pressure_s(13e6, 0.0) is None
    assert tire._old_pressure_s(29e6, 0.0) == 21.0
    tire.environment(30_000_000, Environment(150e3, None, None), 0.0)
    assert tire.conditions(30e6, 0.0).temperature_degc == 49.0


def test_the_last_pressure_from_outside_holds_likewise() -> None:
    tire = TireEstimates(replace(PRESSURE_SETUP, pressure_pa=250e3), ("kinematic",))
    for second, pressure_pa in enumerate((166e3, 160e3, None, None, None)):
        at_ns = 1_000_000_000 * second
        tire.outside.add(OutsideReading(at_ns, Environment(pressure_pa, 20.0 + second, None), 500.0, 2.5))
    conditions = tire.conditions(0.0, 4e9)
    assert (conditions.pressure_pa, conditions.temperature_degc) == (160e3, 24.0)
    assert conditions.pressure_std_pa == pytest.approx(6e3 / math.sqrt(3.0))
    assert tire._old_pressure_s(0.0, 4e9) == tire.outside_old_s(4e9) == 3.0


def test_present_pressure_is_that_of_the_latest_revolution() -> None:
    """The hub's sensor has fallen silent at 4 s; a receiver has the pressure since 3000 s."""
    tire = TireEstimates(replace(PRESSURE_SETUP, pressure_pa=230e3), ("kinematic",))
    tire.environment(4_000_000, Environment(250e3, 20.0, None), 0.0)
    tire.outside.add(OutsideReading(3_000_000_000_000, Environment(180e3, 20.0, None), 500.0, 300.0))
    for end_us, expected_pa in ((4e6, 250e3), (3001e6, 180e3)):
        tire._revolution_end_us = end_us
        assert tire.conditions(math.inf, math.inf).pressure_pa == expected_pa
    assert tire.outside_old_s(1e13) == 7000.0
    tire.environment(3_002_000_000, Environment(240e3, 20.0, None), 0.0)
    assert tire.conditions(math.inf, math.inf).pressure_pa == 240e3


def test_memories_are_those_of_the_averages() -> None:
    assert quantity_of("Bs").memory_revolutions == DEFAULT_HORIZON_REVOLUTIONS
    assert quantity_of("ply_steer_peak_rad").memory_revolutions == HORIZON_REVOLUTIONS


def estimates(value: float, status: Status = Status.VALID) -> tuple[Estimate, ...]:
    return Estimate("Bs", value, 0.01, status), Estimate("speed_mps", value, 0.01, Status.VALID)


def test_steady_value_keeps_its_error() -> None:
    drift = OwnDrift("weak-form")
    assert drift.applies
    assert not OwnDrift("kinematic").applies
    for _ in range(60):
        number, speed = drift.widened(estimates(1.0))
        assert number.std == pytest.approx(0.01)
        assert speed.std == 0.01


@pytest.mark.parametrize("memory", [50])
def test_ramp_is_in_the_error_within_the_memory(memory: int) -> None:
    drift = OwnDrift("weak-form")
    for index in range(200):
        number, speed = drift.widened(estimates(0.01 * index))
    lag = 0.01 * (memory - 1)
    assert lag < 2.0 * number.std < 2.0 * lag
    assert speed.std == 0.01


def test_step_is_forgotten_with_the_average_and_values_in_doubt_do_not_count() -> None:
    drift = OwnDrift("weak-form")
    drift.widened(estimates(5.0, Status.PROVISIONAL))
    assert drift.widened(estimates(1.0))[0].std == pytest.approx(0.01)
    assert drift.widened(estimates(2.0))[0].std > 0.5
    for _ in range(60):
        number, _ = drift.widened(estimates(2.0))
    assert number.std == pytest.approx(0.01)
    drift.widened(estimates(3.0))
    drift.reset()
    assert drift.widened(estimates(9.0))[0].std == pytest.approx(0.01)


NAMED_SETUP = WheelSetup("FL", 0, 0, RADIUS_M, load_n=LOAD_N, pressure_pa=PRESSURE_PA)


def test_later_estimators_prefix_shared_names(roll, to_frames) -> None:
    frames = to_frames(roll(65.0, 1.2).radial_mps2)

    def names_and_values(*estimators: str) -> dict[str, float]:
        pipeline = Pipeline([NAMED_SETUP], NAMED_SETUP, estimators)
        results = pipeline.frames("link", frames, 10**18) + pipeline.finish()
        last = results[-1].estimates
        assert len({e.name for e in last}) == len(last)
        return {e.name: e.value for e in last}

    both = names_and_values("ring-paper", "weak-form")
    weak, paper = names_and_values("weak-form"), names_and_values("ring-paper")
    assert {"Bs", "Ts/Cw", "ring-paper:Bs", "ring-paper:Ts/Cw"} <= set(both)
    assert {name: both[name] for name in weak} == weak
    assert {name: both[f"ring-paper:{name}"] for name in paper} == paper
    assert both["Cw"] != both["ring-paper:Cw"]
