import math
from dataclasses import replace

import numpy as np
import pytest

from gateway.core.estimates.estimator import Estimate, Revolution, Status
from gateway.core.estimates.kinematic import KinematicEstimator
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.reasons import Code, Reason, codes_of
from gateway.core.revolutions.reasons import RevolutionCode
from tests.testkit.exact_ring import RADIUS_M, solution
from tests.testkit.revolution_data import CONDITIONS, exact_wave, make_revolution, settled

WAVE = exact_wave(solution())


def estimates_of(revolution: Revolution) -> dict[str, Estimate]:
    average = settled(make_revolution(WAVE))
    return {e.name: e for e in KinematicEstimator().update(revolution, average, CONDITIONS)}


def test_speed_edges_and_length() -> None:
    revolution = make_revolution(WAVE, period_std_s=2e-5)
    estimates = estimates_of(revolution)
    assert list(estimates) == [
        "speed_mps",
        "angular_speed_radps",
        "rotation_rpm",
        "leading_edge_rad",
        "trailing_edge_rad",
        "contact_length_m",
        "contact_fraction",
    ]
    assert {e.status for e in estimates.values()} == {Status.VALID}
    speed = estimates["speed_mps"]
    assert speed.value == pytest.approx(65.0 / 3.6)
    relative_std = math.hypot(2e-5 / revolution.period_s, CONDITIONS.claims.rate_std)
    assert speed.std == pytest.approx(speed.value * relative_std)
    rotation = estimates["rotation_rpm"]
    assert rotation.value == pytest.approx(60.0 / revolution.period_s)
    assert rotation.std == pytest.approx(rotation.value * relative_std)
    assert estimates["angular_speed_radps"].value == pytest.approx(revolution.omega_radps)
    truth = solution()
    length = estimates["contact_length_m"]
    assert abs(length.value - RADIUS_M * (truth.trailing_edge_rad - truth.leading_edge_rad)) < 1.5 * length.std
    edges_std = revolution.trailing_edge_std_rad + revolution.leading_edge_std_rad
    assert length.std == pytest.approx(RADIUS_M * edges_std, rel=0.01)
    fraction = estimates["contact_fraction"]
    assert fraction.value == pytest.approx(length.value / (2.0 * math.pi * RADIUS_M))
    assert fraction.std == pytest.approx(edges_std / (2.0 * math.pi))


def test_late_bending_is_in_the_error_of_the_edges() -> None:
    """A belt with a loss of 0.2 in bending at order 12 bends 0.0167 rad late."""
    spectrum = np.fft.rfft(WAVE)
    late = np.fft.irfft(spectrum / (1.0 + 0.0167j * np.arange(len(spectrum))), n=len(WAVE))
    estimates = estimates_of(make_revolution(late))
    truth = solution()
    for name in ("leading_edge_rad", "trailing_edge_rad"):
        error = abs(estimates[name].value - getattr(truth, name))
        assert 0.008 < error < 2.5 * estimates[name].std
    half_rad = estimates["contact_length_m"].value / (2.0 * RADIUS_M)
    half_std_rad = estimates["contact_length_m"].std / (2.0 * RADIUS_M)
    assert abs(half_rad - 0.5 * (truth.trailing_edge_rad - truth.leading_edge_rad)) < 2.0 * half_std_rad


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"saturated": True}, EstimateCode.RADIAL_SATURATED),
        ({"faults": (Reason(RevolutionCode.CONTACT_HAS_NO_SLOPE),)}, RevolutionCode.CONTACT_HAS_NO_SLOPE),
    ],
)
def test_doubtful_revolutions_are_provisional_with_a_reason(change: dict[str, object], code: Code) -> None:
    estimates = estimates_of(make_revolution(WAVE, **change))
    assert {e.status for e in estimates.values()} == {Status.PROVISIONAL}
    assert all(code in codes_of(e.reasons) for e in estimates.values())


def test_lost_samples_lower_no_status_where_times_and_edges_have_errors_for_them() -> None:
    lost = (
        Reason(EstimateCode.SAMPLES_LOST),
        Reason(EstimateCode.CONTACT_INTERPOLATED),
        Reason(EstimateCode.CONTACT_NOT_SEEN),
    )
    estimates = estimates_of(make_revolution(WAVE, missing_fraction=0.03, faults=lost))
    assert {e.status for e in estimates.values()} == {Status.VALID}
    assert codes_of(estimates["speed_mps"].reasons) == (EstimateCode.CONTACT_INTERPOLATED,)
    assert codes_of(estimates["contact_length_m"].reasons) == (
        EstimateCode.CONTACT_INTERPOLATED,
        EstimateCode.CONTACT_NOT_SEEN,
    )
    without = estimates_of(make_revolution(WAVE, edges=(math.nan, math.nan), faults=lost[:1]))
    assert without["speed_mps"].status is Status.VALID
    assert without["contact_length_m"].status is Status.INVALID
    assert codes_of(without["contact_length_m"].reasons) == (EstimateCode.SAMPLES_LOST,)


def test_speed_is_valid_without_edges() -> None:
    nan = math.nan
    revolution = replace(
        make_revolution(WAVE),
        leading_edge_rad=nan,
        trailing_edge_rad=nan,
        leading_edge_std_rad=nan,
        trailing_edge_std_rad=nan,
    )
    estimates = estimates_of(revolution)
    assert estimates["speed_mps"].status is Status.VALID
    for name in ("leading_edge_rad", "trailing_edge_rad", "contact_length_m", "contact_fraction"):
        assert estimates[name].status is Status.INVALID
        assert estimates[name].reasons
        assert math.isnan(estimates[name].value)


def test_unknown_timing_error_is_nan_not_zero() -> None:
    assert math.isnan(estimates_of(make_revolution(WAVE, period_std_s=math.nan))["speed_mps"].std)


def test_nan_waveform_does_not_raise() -> None:
    estimates = estimates_of(replace(make_revolution(WAVE), radial_mps2=np.full(1024, np.nan), omega_radps=math.nan))
    assert estimates["speed_mps"].status is Status.INVALID


def test_radius_error_scales_speed_and_length() -> None:
    revolution = make_revolution(WAVE, period_std_s=2e-5)
    conditions = replace(CONDITIONS, radius_std_m=0.01 * CONDITIONS.radius_m)
    results = {e.name: e for e in KinematicEstimator().update(revolution, settled(revolution), conditions)}
    without = estimates_of(revolution)
    for name in ("speed_mps", "contact_length_m"):
        assert results[name].std == pytest.approx(math.hypot(without[name].std, 0.01 * results[name].value))
    for name in ("leading_edge_rad", "contact_fraction"):
        assert results[name] == without[name]
