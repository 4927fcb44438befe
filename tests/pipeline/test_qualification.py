"""Status of estimates after all that is known against them."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.estimators.estimator import Estimate, Status
from gateway.estimators.sensor_claims import SensorClaims
from gateway.estimators.signal_evidence import Evidence
from gateway.pipeline.qualification import provisional_where, qualified
from gateway.pipeline.sensor_limits import Doubt
from gateway.pipeline.wheel_setup import WheelSetup
from gateway.quantity import Basis
from gateway.quantity_catalogue import CATALOGUE, quantity_of
from gateway.reasons import Code, Reason, codes_of
from tests.testkit.simulated_wheel import last, simulated

NOTHING = Evidence(0.0, 0.0, True, 0.0, 0.0, 0.3, 0.003)
NAMES = sorted({quantity.name for quantities in CATALOGUE.values() for quantity in quantities})
DOUBT = Reason(Code.SAMPLES_LOST)


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
        ("wear_mm", -0.1, 0.0),
    ],
)
def test_what_is_not_possible_is_not_valid(name: str, value: float, std: float) -> None:
    estimate = judged(name, value, std)
    assert estimate.status is Status.PROVISIONAL
    (reason,) = estimate.reasons
    if std:
        assert reason.code is Code.NOT_POSSIBLE
        assert reason["errors"] > 2.5
    else:
        assert reason.code is Code.NOT_POSSIBLE_AT_ALL
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
    estimate = Estimate(name, 1.0, 0.1, Status.VALID)
    (doubted,) = qualified((estimate,), NOTHING, (Doubt(Basis.SAMPLES, DOUBT),), None)
    assert (doubted.status is Status.PROVISIONAL) == (Basis.SAMPLES in quantity_of(name).rests_on)
    (uncorrected,) = qualified((estimate,), NOTHING, (), DOUBT)
    is_affected = Basis.WAVEFORM in quantity_of(name).rests_on
    assert (Code.EFFECTS_NOT_SUBTRACTED in codes_of(uncorrected.reasons)) == is_affected


def test_a_reason_is_given_once() -> None:
    estimate = Estimate("Cw", 0.2, 0.01, Status.PROVISIONAL, (DOUBT,))
    assert provisional_where((estimate,), Basis.PRESSURE, DOUBT) == (estimate,)


@pytest.mark.parametrize("verified", [False, True])
def test_sign_of_an_unverified_lateral_axis_is_noted(verified: bool) -> None:
    setup = WheelSetup("FL", 0, 0, 0.32, sensor=SensorClaims(lateral_is_left=verified))
    result = last(simulated("[tire]\ncord_angle_deg = 20", 4.0, setup, ("kinematic", "ply-steer"))[0])
    for name, estimate in result.items():
        noted = Code.LATERAL_SIGN_UNVERIFIED in codes_of(estimate.reasons)
        rests = Basis.SIGN in quantity_of(name).rests_on and estimate.status is not Status.INVALID
        assert noted == (rests and not verified), name
    # The size holds.
    assert result["ply_steer_contact_line_rad"].status is Status.VALID
