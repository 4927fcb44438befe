"""Slip calibration: the law, its fit to runs of known slip, and the runs that it refuses."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gateway.core.errors import CalibrationError
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.sensor_claims import SensorClaims
from gateway.core.revolutions.sensor_mounting import RollCalibration
from gateway.forces.reasons import ForceCode
from gateway.forces.slip_calibration import SlipCalibration
from gateway.forces.slip_fit import SlipFit, SlipRun, SlipRunRevolutions, fit_slip_calibration
from tests.testkit.exact_ring import RADIUS_M, solution
from tests.testkit.revolution_data import CONDITIONS, exact_wave, make_revolution

DEG = math.radians(1.0)
PLY, CONE, SHARE, BEND = 0.12 * DEG, -0.03 * DEG, 0.22, 3.0
ZERO_STD, SLIP_STD, NOISE = 0.03 * DEG, 0.02 * DEG, 0.002 * DEG
BY_YAW = 0.009 * DEG
FORWARD = ((-1.0, False), (0.0, False), (1.0, False))
BOTH = (*FORWARD, (0.5, False), (0.0, True), (1.0, True))


def run(slip_deg: float, is_reverse: bool, rng: np.random.Generator | None, off: tuple[float, float]) -> SlipRun:
    """Return a run that follows the law; `off` are the zero of the slip and the sensor's yaw, with `rng` noise too."""
    sign = -1.0 if is_reverse else 1.0
    normal = rng.normal if rng else lambda: 0.0
    slip = slip_deg * DEG + sign * off[0] + SLIP_STD * normal()
    slope = sign * PLY + CONE + SHARE * slip * (1.0 - BEND * abs(slip)) + BY_YAW * off[1] + NOISE * normal()
    return SlipRun(
        name=f"{slip_deg:+g}",
        slip_rad=slip_deg * DEG,
        slip_std_rad=SLIP_STD,
        is_reverse=is_reverse,
        slope_rad=slope,
        noise_std_rad=NOISE,
        shared_std_rad=(0.0, BY_YAW, 0.0, 0.0),
        scale_std=0.015,
        half_angle_rad=0.2,
        pressure_pa=2e5,
        revolutions=40,
    )


def runs(which: tuple[tuple[float, bool], ...], rng: np.random.Generator | None = None) -> list[SlipRun]:
    off = (ZERO_STD * rng.normal(), rng.normal()) if rng else (0.0, 0.0)
    return [run(slip, is_reverse, rng, off) for slip, is_reverse in which]


def fitted(which: tuple[tuple[float, bool], ...]) -> SlipFit:
    return fit_slip_calibration(runs(which), ZERO_STD)


def test_both_directions_separate_ply_steer_and_conicity() -> None:
    law = fitted(BOTH).calibration
    assert law.belt_share == pytest.approx(SHARE, rel=0.01)
    assert law.zero_rad == pytest.approx(PLY + CONE, abs=1e-3 * DEG)
    assert law.ply_steer_rad == pytest.approx(PLY, abs=1e-3 * DEG)
    assert law.conicity_rad == pytest.approx(CONE, abs=1e-3 * DEG)
    # A misaligned zero of the slip angles is ply steer to all runs, but not conicity.
    assert law.ply_steer_std_rad > SHARE * ZERO_STD > 0.5 * law.conicity_std_rad


def test_scale_of_the_slopes_has_the_errors_of_the_lateral_gain_and_the_radius() -> None:
    wave = exact_wave(solution())
    revolution = replace(make_revolution(wave), axes_mps2=np.stack([wave, wave, wave]))
    conditions = replace(CONDITIONS, claims=SensorClaims(lateral_gain_std=0.06), gain_std=0.015, radius_std_m=0.003)
    revolutions = SlipRunRevolutions(RollCalibration())
    assert all(revolutions.add(revolution, conditions) for _ in range(20))
    measured = revolutions.run("straight", 0.0, 0.0, is_reverse=False)
    assert measured.scale_std == pytest.approx(math.hypot(0.06, 0.015, 0.003 / RADIUS_M))


def test_forward_runs_do_not_separate_them() -> None:
    law = fitted(FORWARD).calibration
    assert law.ply_steer_rad is None
    assert law.conicity_rad is None
    assert law.zero_rad == pytest.approx(PLY + CONE, abs=1e-3 * DEG)


def test_calibration_errors_hold() -> None:
    rng = np.random.default_rng(7)
    pulls = []
    for _ in range(150):
        law = fit_slip_calibration(runs(BOTH, rng), ZERO_STD).calibration
        assert law.ply_steer_rad is not None
        assert law.conicity_rad is not None
        pulls.append(
            [
                (law.belt_share - SHARE) / law.belt_share_std,
                (law.zero_rad - PLY - CONE) / law.zero_std_rad,
                (law.ply_steer_rad - PLY) / law.ply_steer_std_rad,
                (law.conicity_rad - CONE) / law.conicity_std_rad,
            ]
        )
    rms = np.sqrt(np.mean(np.square(pulls), axis=0))
    assert (rms < 1.15).all(), rms
    # The share's error includes that of the law, which these runs follow exactly.
    assert (rms[1:] > 0.8).all(), rms


def test_slip_of_a_slope_inverts_the_law() -> None:
    law = fitted(BOTH).calibration
    for slip in (-1.5 * DEG, 0.0, 0.3 * DEG, 2.0 * DEG):
        assert law.slip_at(law.slope_at(slip), 0.0)[0] == pytest.approx(slip, abs=1e-12)
    assert np.linalg.eigvalsh(law.covariance).min() > -1e-18
    _, calibration_only = law.slip_at(law.zero_rad, 0.0)
    assert law.slip_at(law.zero_rad, NOISE)[1] > calibration_only == pytest.approx(law.zero_std_rad / law.belt_share)


def test_slope_beyond_the_law_has_no_slip() -> None:
    law = replace(fitted(BOTH).calibration, saturation_prad=10.0)
    slip_rad, std_rad = law.slip_at(law.zero_rad + 0.1, 0.0)
    assert math.isnan(slip_rad)
    assert math.isnan(std_rad)
    assert [reason.code for reason in law.outside(0.2, 2e5, slip_rad)] == [ForceCode.SLIP_BEYOND_LAW]


def test_ranges_are_those_of_the_runs() -> None:
    law = fitted(BOTH).calibration
    assert law.outside(0.2, 2e5, 0.5 * DEG) == ()
    results = [reason.code for reason in law.outside(0.3, 1.5e5, 3.0 * DEG)]
    expected = [
        EstimateCode.HALF_ANGLE_OUTSIDE_CALIBRATION,
        EstimateCode.PRESSURE_OUTSIDE_CALIBRATION,
        ForceCode.SLIP_OUTSIDE_CALIBRATION,
    ]
    assert results == expected


def test_contradicting_run_is_refused_by_name() -> None:
    wrong = runs(BOTH)
    wrong[3] = replace(wrong[3], slip_rad=-wrong[3].slip_rad, name="bend.mcap")
    with pytest.raises(CalibrationError, match=r"freedom 3; the others agree without bend.mcap") as caught:
        fit_slip_calibration(wrong, ZERO_STD)
    assert "sign" in caught.value.remedy
    assert "or without" not in str(caught.value)


@pytest.mark.parametrize(
    ("which", "message"),
    [
        (((0.0, True), (1.0, True)), "no run rolls forward"),
        (((0.0, False), (0.02, False)), "share is not determined"),
        (((0.5, False), (0.5, False)), "share is not determined"),
        (((0.0, False), (3.0, False)), "too much slip"),
    ],
)
def test_runs_that_do_not_determine_the_law_are_refused(which: tuple[tuple[float, bool], ...], message: str) -> None:
    with pytest.raises(CalibrationError, match=message) as caught:
        fitted(which)
    assert caught.value.remedy


def test_runs_at_different_loads_are_refused() -> None:
    mixed = runs(FORWARD)
    mixed[1] = replace(mixed[1], half_angle_rad=0.24)
    with pytest.raises(CalibrationError, match="half angles differ"):
        fit_slip_calibration(mixed, ZERO_STD)


def test_turned_sign_of_slip_is_refused() -> None:
    turned = [replace(drive, slip_rad=-drive.slip_rad) for drive in runs(FORWARD)]
    with pytest.raises(CalibrationError, match="share is negative"):
        fit_slip_calibration(turned, ZERO_STD)


@pytest.mark.parametrize("pressure_pa", [-1300.0, 0.0, 9e3, 2e6])
def test_a_pressure_that_no_table_states_is_refused(pressure_pa: float) -> None:
    flat = [replace(drive, pressure_pa=pressure_pa) for drive in runs(FORWARD)]
    with pytest.raises(CalibrationError, match="kPa are required") as caught:
        fit_slip_calibration(flat, ZERO_STD)
    assert caught.value.remedy


def test_a_belt_share_above_1_is_refused() -> None:
    scaled = [replace(drive, slope_rad=1.3 / SHARE * drive.slope_rad) for drive in runs(FORWARD)]
    with pytest.raises(CalibrationError, match=r"share is above 1: 1\.3\d* ± 0\.\d") as caught:
        fit_slip_calibration(scaled, ZERO_STD)
    assert "slip_deg" in caught.value.remedy


def test_two_runs_have_no_degrees_of_freedom() -> None:
    fit = fitted(FORWARD[1:])
    assert fit.degrees_of_freedom == 0
    assert math.isnan(fit.probability)
    assert np.isnan(fit.left_out).all()


def test_share_needs_no_runs_beyond_its_law() -> None:
    assert isinstance(fitted(FORWARD).calibration, SlipCalibration)
    assert np.isfinite(fitted(BOTH).left_out).all()
    assert np.abs(fitted(BOTH).left_out).max() < 1.0
