"""Side force, aligning moment and friction from the lateral shape of the free belt."""

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from gateway.core.estimates.estimator import Estimate, Status, TireConditions
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.sensor_claims import SensorClaims
from gateway.core.estimates.tire_data import TireData
from gateway.core.quantity_catalogue import quantity_of
from gateway.core.reasons import Reason, codes_of
from gateway.core.trust.reasons import TrustCode
from gateway.forces.free_belt import displacement_rows
from gateway.forces.friction_use import FrictionUseEstimator, share_of_trail
from gateway.forces.lateral_belt import LateralBelt, LateralSolution, solve_lateral_belt
from gateway.forces.lateral_deformation import ORDERS, lateral_coefficients
from gateway.forces.reasons import ForceCode
from gateway.forces.side_force import HORIZON_REVOLUTIONS, NAMES, SideForceEstimator
from gateway.forces.side_force_calibration import LinearLaw, SideForceCalibration, fit_linear_law
from gateway.ring.reasons import RingCode
from tests.testkit.exact_ring import PRESSURE_PA, RADIUS_M, on_grid, solution
from tests.testkit.revolution_data import CONDITIONS, OMEGA, exact_wave, make_revolution, settled

GOOD = make_revolution(exact_wave(solution()))
AVERAGE = settled(GOOD)
SLIPS_DEG = (-4.0, -1.0, 0.0, 1.0, 4.0)


@lru_cache(maxsize=16)
def belt(slip_deg: float, stiffness: float = 1e3, friction: float = 1.0) -> LateralSolution:
    lateral = LateralBelt(bending_stiffness_nm2=stiffness, friction=friction)
    return solve_lateral_belt(solution(), lateral, slip_angle_rad=math.radians(slip_deg))


def displaced(result: LateralSolution) -> np.ndarray:
    return displacement_rows(solution().half_angle_rad) @ lateral_coefficients(on_grid(result.lateral_m))


def calibration() -> SideForceCalibration:
    points = [belt(slip) for slip in (-1.0, 0.0, 1.0)]
    shift, yaw = np.array([displaced(point) for point in points]).T
    stds, small = [1e-6] * 3, [1.0] * 3
    half = solution().half_angle_rad
    return SideForceCalibration(
        fit_linear_law(shift.tolist(), stds, [p.side_force_n for p in points], small),
        fit_linear_law((yaw / RADIUS_M).tolist(), stds, [p.aligning_moment_nm for p in points], small),
        (half, half),
        (PRESSURE_PA, PRESSURE_PA),
    )


def follow(slip_deg: float, conditions: TireConditions, revolutions: int = 16, seed: int = 5) -> dict[str, Estimate]:
    rng = np.random.default_rng(seed)
    estimator = SideForceEstimator()
    last: tuple[Estimate, ...] = ()
    for _ in range(revolutions):
        lateral = OMEGA**2 * on_grid(belt(slip_deg).lateral_m) + rng.normal(0.0, 0.5, 1024)
        axes = np.stack([np.full(1024, np.nan), lateral, GOOD.radial_mps2])
        last = estimator.update(replace(GOOD, axes_mps2=axes), AVERAGE, conditions)
    return {estimate.name: estimate for estimate in last}


@pytest.mark.parametrize("stiffness", [200.0, 1e3, 4e3])
def test_force_and_moment_are_linear_in_displacement(stiffness: float) -> None:
    results = [belt(slip, stiffness) for slip in SLIPS_DEG]
    shift, yaw = np.array([displaced(item) for item in results]).T
    for displacement, force, share in (
        (shift, [item.side_force_n for item in results], 0.005),
        (yaw, [item.aligning_moment_nm for item in results], 0.005),
    ):
        line = np.polyval(np.polyfit(displacement, force, 1), displacement)
        assert line == pytest.approx(force, abs=share * float(np.ptp(force)))


def test_gravity_of_order_one_does_not_matter() -> None:
    clean = lateral_coefficients(on_grid(belt(1.0).lateral_m))
    tilted = clean.copy()
    tilted[[0, len(ORDERS)]] += 1e-3
    rows = displacement_rows(solution().half_angle_rad)
    assert rows @ tilted == pytest.approx(rows @ clean)


@pytest.mark.parametrize("slip_deg", [-4.0, 0.5, 4.0])
def test_calibrated_force_is_within_errors(slip_deg: float) -> None:
    conditions = replace(CONDITIONS, tire=TireData(added=(calibration(),)))
    result, truth = follow(slip_deg, conditions), belt(slip_deg)
    force, moment = result["side_force_n"], result["aligning_moment_nm"]
    assert force.status is Status.VALID
    assert abs(force.value - truth.side_force_n) < 3.0 * force.std
    assert abs(moment.value - truth.aligning_moment_nm) < 3.0 * moment.std
    # A large constant slip is a curve nearly as well, whose lateral acceleration is in the roll.
    assert force.std < 250.0


def test_scattering_part_is_what_repeated_drives_scatter() -> None:
    """Eight drives: their scatter is known to 27 %."""
    conditions = replace(CONDITIONS, tire=TireData(added=(calibration(),)))
    drives = [follow(1.0, conditions, seed=seed) for seed in range(8)]
    for name in NAMES:
        values, stated = np.array([(drive[name].value, drive[name].scatter_std) for drive in drives]).T
        assert 0.5 < float(np.std(values, ddof=1)) / math.sqrt(float(np.mean(stated**2))) < 1.6, name
        assert quantity_of(name).correlated_revolutions == HORIZON_REVOLUTIONS


def test_force_needs_a_calibration() -> None:
    result = follow(1.0, CONDITIONS)
    assert result["belt_shift_m"].status is Status.VALID
    assert codes_of(result["side_force_n"].reasons) == (ForceCode.NEEDS_SIDE_FORCE_CALIBRATION,)


def test_what_scales_the_axis_is_in_shift_and_yaw_but_cancels_in_calibrated_forces() -> None:
    exact = replace(
        CONDITIONS, tire=TireData(added=(calibration(),)), claims=SensorClaims(gain_std=0.0, lateral_gain_std=0.0)
    )
    sure = follow(4.0, exact)
    claims = replace(exact.claims, lateral_gain_std=0.06)
    unsure = follow(4.0, replace(exact, claims=claims, gain_std=0.015, radius_std_m=0.01 * RADIUS_M))
    for name, share in zip(NAMES, (math.hypot(0.06, 0.015), math.hypot(0.06, 0.015, 0.01), 0.0, 0.0), strict=True):
        added = math.sqrt(unsure[name].std ** 2 - sure[name].std ** 2)
        assert added == pytest.approx(share * abs(sure[name].value), rel=1e-6), name


def test_other_contact_length_makes_force_provisional() -> None:
    law = calibration()
    elsewhere = replace(law, half_angle_range_rad=(0.1, 0.12))
    result = follow(1.0, replace(CONDITIONS, tire=TireData(added=(elsewhere,))))
    assert result["side_force_n"].status is Status.PROVISIONAL
    assert EstimateCode.HALF_ANGLE_OUTSIDE_CALIBRATION in codes_of(result["side_force_n"].reasons)


def test_force_at_another_pressure_has_the_error_of_the_sidewalls() -> None:
    tire = TireData(added=(calibration(),))
    same = follow(4.0, replace(CONDITIONS, tire=tire))["side_force_n"]
    near = follow(4.0, replace(CONDITIONS, tire=tire, pressure_pa=0.93 * PRESSURE_PA))["side_force_n"]
    far = follow(4.0, replace(CONDITIONS, tire=tire, pressure_pa=1.3 * PRESSURE_PA))["side_force_n"]
    assert (same.status, near.status, far.status) == (Status.VALID, Status.VALID, Status.PROVISIONAL)
    assert codes_of(far.reasons) == (EstimateCode.PRESSURE_OUTSIDE_CALIBRATION,)
    # Sidewalls that the pressure alone stiffens, and such as it does not change.
    for estimate, ratio in ((near, 0.93), (far, 1.3)):
        assert abs(same.value * ratio - estimate.value) < 2.0 * estimate.std
        assert estimate.std > same.std


def test_calibration_of_unknown_pressure_makes_force_provisional() -> None:
    unknown = replace(calibration(), pressure_range_pa=None)
    result = follow(1.0, replace(CONDITIONS, tire=TireData(added=(unknown,))))
    assert codes_of(result["side_force_n"].reasons) == (ForceCode.SIDE_FORCE_PRESSURE_UNKNOWN,)
    assert result["belt_shift_m"].status is Status.VALID


def test_no_lateral_axis_gives_nothing() -> None:
    assert SideForceEstimator().update(GOOD, AVERAGE, CONDITIONS) == ()


def test_fit_returns_the_law_it_was_made_from() -> None:
    law = LinearLaw(5e5, 0.0, 1e-4, 0.0)
    shifts = [-2e-3, 0.0, 1e-3, 3e-3]
    result = fit_linear_law(shifts, [1e-5] * 4, [law.force(s, 0.0)[0] for s in shifts], [10.0] * 4)
    assert result.factor == pytest.approx(5e5)
    assert result.zero == pytest.approx(1e-4)
    assert 0.0 < result.factor_std < 1e4


def test_fit_needs_two_points() -> None:
    with pytest.raises(ValueError, match="two points"):
        fit_linear_law([1e-3], [1e-5], [100.0], [1.0])


def given(pull: float, side_n: float, moment_nm: float) -> TireConditions:
    def made(name: str, value: float, std: float) -> Estimate:
        return Estimate(name, value, std, Status.VALID)

    return replace(
        CONDITIONS,
        given={
            "longitudinal-force": {"longitudinal_ratio": made("longitudinal_ratio", pull, 0.002)},
            "side-force": {
                "side_force_n": made("side_force_n", side_n, 20.0),
                "aligning_moment_nm": made("aligning_moment_nm", moment_nm, 0.5),
            },
        },
    )


def friction(conditions: TireConditions) -> dict[str, Estimate]:
    return {e.name: e for e in FrictionUseEstimator().update(GOOD, AVERAGE, conditions)}


def test_friction_used_is_the_ratio_of_forces() -> None:
    used = friction(given(0.3, 2000.0, -30.0))["friction_used"]
    assert used.value == pytest.approx(0.5)
    assert used.std == pytest.approx(math.hypot(0.6 * 0.002, 0.8 * 0.004), rel=0.01)
    assert used.status is Status.VALID


def test_without_side_force_friction_is_provisional() -> None:
    given_ = {"longitudinal-force": {"longitudinal_ratio": Estimate("longitudinal_ratio", -0.2, 0.01, Status.VALID)}}
    used = friction(replace(CONDITIONS, given=given_))["friction_used"]
    assert used.value == pytest.approx(0.2)
    assert codes_of(used.reasons) == (ForceCode.FRICTION_OF_LONGITUDINAL_ONLY, EstimateCode.NEEDS_ESTIMATOR)


def test_friction_says_what_the_side_force_lacks() -> None:
    whole = given(0.3, 2000.0, -30.0)
    uncalibrated = Estimate.invalid("side_force_n", Reason(ForceCode.NEEDS_SIDE_FORCE_CALIBRATION))
    for conditions, code in (
        (replace(whole, load_n=None), RingCode.NEEDS_LOAD),
        (replace(whole, given={**whole.given, "side-force": {}}), TrustCode.AXIS_MISSING),
        (
            replace(whole, given={**whole.given, "side-force": {"side_force_n": uncalibrated}}),
            ForceCode.NEEDS_SIDE_FORCE_CALIBRATION,
        ),
    ):
        estimates = friction(conditions)
        assert codes_of(estimates["friction_used"].reasons) == (ForceCode.FRICTION_OF_LONGITUDINAL_ONLY, code)
        assert codes_of(estimates["sliding_share"].reasons) == (code,)


@pytest.mark.parametrize(("slip_deg", "friction_limit"), [(1.0, 1.0), (4.0, 1.0), (4.0, 0.5), (2.0, 0.5)])
def test_sliding_share_is_within_three_errors(slip_deg: float, friction_limit: float) -> None:
    truth = belt(slip_deg, 1e3, friction_limit)
    share = friction(given(0.0, truth.side_force_n, truth.aligning_moment_nm))["sliding_share"]
    true = truth.sliding.sum() / solution().in_contact.sum()
    assert abs(share.value - true) < 3.0 * share.std
    assert share.std < 0.3


def test_braking_leaves_the_sliding_share_open() -> None:
    share = friction(given(-0.4, 1000.0, -20.0))["sliding_share"]
    assert codes_of(share.reasons) == (ForceCode.SLIP_NOT_LATERAL,)


def test_trail_falls_as_the_contact_slides() -> None:
    assert share_of_trail(1.0, 2.0) == pytest.approx(0.0, abs=0.01)
    assert share_of_trail(0.0, 2.0) == pytest.approx(1.0, abs=0.02)
    # Parabola: trail ratio (1 - s)^3 / (1 - s + s^2 / 3) at a sliding share s.
    assert share_of_trail(0.125 / (0.5 + 0.25 / 3.0), 2.0) == pytest.approx(0.5, abs=0.01)
