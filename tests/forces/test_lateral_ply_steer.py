"""Ply steer estimator on simulated belts, through the pipeline of a wheel."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from firmware_protocol.messages import Coupling
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.estimates.estimator import Estimate, Revolution, Status, TireConditions
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.registry import make_estimator
from gateway.core.estimates.revolution_block import one_revolution
from gateway.core.estimates.sensor_claims import SensorClaims
from gateway.core.estimates.tire_data import TireData
from gateway.core.reasons import Reason, codes_of
from gateway.core.revolutions.sensor_mounting import RollCalibration
from gateway.core.trust.reasons import TrustCode
from gateway.forces.belt_laminate import BeltLaminate, StatedPly
from gateway.forces.lateral_belt import LateralBelt, LateralSolution
from gateway.forces.lateral_shape import LateralAverage, lateral_record, slopes
from gateway.forces.ply_steer import (
    AHEAD_NAME,
    CONICITY_NAME,
    LAMINATE_NAMES,
    LINE_NAME,
    NAMES,
    OFFSET_NAME,
    PEAK_OVER_LAMINATE,
    PEAK_OVER_LAMINATE_STD,
    ROLL_NAME,
    PlySteerEstimator,
)
from gateway.forces.reasons import ForceCode
from gateway.ring.reasons import RingCode
from gateway.ring.rolling_ring import RingSolution
from tests.testkit.revolution_data import settled
from tools.generators.lateral_signals import RADIUS_M, Sensor, lateral, radial, samples, through_pipeline

CONDITIONS = TireConditions(RADIUS_M)
# Noise that dithers the 16-bit steps of 0.6 m/s^2 and is otherwise negligible.
QUIET = Sensor(noise_mg=1.0)


def true_deg(ring: RingSolution, shape: LateralSolution) -> np.ndarray:
    """Return peak, first half and adhesion line of the belt's shape, by finite differences and polyfit."""
    fine = np.linspace(ring.leading_edge_rad, ring.trailing_edge_rad, 2001)
    y = np.interp(fine, shape.theta_rad, shape.y_m)
    slope = np.interp(fine, shape.theta_rad, shape.slope_rad)
    sign = np.sign(np.polyfit(fine, y, 1)[0])
    steep = int((sign * slope).argmax())
    same = sign * slope > 0
    first = 0 if same[:steep].all() else int(np.flatnonzero(~same[:steep])[-1]) + 1
    last = len(fine) if same[steep:].all() else steep + int(np.flatnonzero(~same[steep:])[0])
    half = (y[1000] - y[0]) / (RADIUS_M * (fine[1000] - fine[0]))
    line = np.polyfit(RADIUS_M * fine[first:last], y[first:last], 1)[0]
    return np.degrees([slope[steep], half, line])


@lru_cache(maxsize=32)
def rolled(
    ring: RingSolution,
    belt: LateralBelt = LateralBelt(),  # noqa: B008 - frozen
    sensor: Sensor = QUIET,
    count: int = 15,
    acceleration_mps2: float = 0.0,
    slip_deg: float = 0.0,
) -> tuple[Revolution, ...]:
    values = samples(
        ring, [(count, lateral(ring, belt, math.radians(slip_deg)))], sensor, acceleration_mps2=acceleration_mps2
    )
    return tuple(r.revolution for r in through_pipeline(values, sensor) if not r.revolution.faults)


def estimate(
    revolutions: Sequence[Revolution],
    estimator: PlySteerEstimator | None = None,
    conditions: TireConditions | None = None,
) -> dict[str, Estimate]:
    estimator = estimator or PlySteerEstimator()
    average = settled(revolutions[0])
    result: tuple[Estimate, ...] = ()
    for revolution in revolutions:
        result = estimator.update(revolution, average, conditions or CONDITIONS)
    return {e.name: e for e in result}


def angles_deg(result: dict[str, Estimate]) -> np.ndarray:
    return np.degrees([result[name].value for name in NAMES])


@pytest.mark.parametrize("load_n", [2000.0, 5000.0, 8000.0])
@pytest.mark.parametrize("pressure_pa", [1.7e5, 2.5e5])
def test_angles_match_those_of_the_belt(load_n: float, pressure_pa: float) -> None:
    ring = radial(load_n, pressure_pa)
    result = estimate(rolled(ring))
    # Bench: rms 0.002 deg over the grid, largest 0.007 (first half, which the edges' error reaches).
    assert angles_deg(result) == pytest.approx(true_deg(ring, lateral(ring)), abs=0.009)
    assert all(result[name].status is Status.VALID for name in NAMES)


@pytest.mark.parametrize(
    "belt",
    [
        LateralBelt(bending_stiffness_nm2=4e3),
        LateralBelt(sidewall_stiffness_npm2=1.3e5, tread_stiffness_npm2=1.2e7),
        LateralBelt(coupling_length_m=-2e-3),
    ],
)
def test_angles_match_on_other_belts(belt: LateralBelt) -> None:
    ring = radial()
    assert angles_deg(estimate(rolled(ring, belt))) == pytest.approx(true_deg(ring, lateral(ring, belt)), abs=0.008)


def test_asked_definition_comes_first_with_the_same_numbers() -> None:
    asked = replace(CONDITIONS, tire=TireData(ply_steer_definition="adhesion_line"))
    usual, headed = (estimate(rolled(radial(5000.0, 2.5e5)), conditions=position) for position in (CONDITIONS, asked))
    assert next(iter(headed)) == "ply_steer_adhesion_line_rad"
    assert headed == usual


def test_roll_tilt_is_calibrated() -> None:
    straight = estimate(rolled(radial()))
    for degrees in (-2.0, 2.0):
        tilted = estimate(rolled(radial(), sensor=replace(QUIET, roll_rad=math.radians(degrees))))
        assert math.degrees(tilted[ROLL_NAME].value) == pytest.approx(degrees, abs=0.02)
        assert angles_deg(tilted) == pytest.approx(angles_deg(straight), abs=0.005)
        assert tilted[ROLL_NAME].status is Status.VALID
    # Without calibration the error would be gross.
    raw = rolled(radial(), sensor=replace(QUIET, roll_rad=math.radians(2.0)))[0]
    edges = (raw.leading_edge_rad, raw.trailing_edge_rad)
    remainder = np.degrees(slopes(lateral_record(raw, 0.0), edges, RADIUS_M).values_rad)
    assert np.abs(remainder - angles_deg(straight)).max() > 0.1


def test_offset_camber_and_yaw_stay_within_the_error() -> None:
    straight = angles_deg(estimate(rolled(radial())))
    for sensor in (
        replace(QUIET, lateral_offset_mps2=1.0),
        replace(QUIET, camber_rad=math.radians(3)),
        replace(QUIET, yaw_rad=math.radians(1)),
    ):
        result = estimate(rolled(radial(), sensor=sensor))
        stated = np.degrees([result[name].std for name in NAMES])
        assert np.all(np.abs(angles_deg(result) - straight) < 1.5 * stated)
        assert np.all(stated < 0.02)


def test_zero_that_nearly_contradicts_the_roll_widens_the_error() -> None:
    """A lateral zero of 4.5 g looks like a roll of 2.5 deg, which is within three errors of mounting by hand."""
    result = estimate(rolled(radial(), sensor=replace(QUIET, lateral_offset_mps2=44.0)))
    stated = np.degrees([result[name].std for name in NAMES])
    assert np.all(np.abs(angles_deg(result) - angles_deg(estimate(rolled(radial())))) < 3.0 * stated)
    assert abs(result[CONICITY_NAME].value) < 3.0 * result[CONICITY_NAME].std


def with_orders(revolutions: Sequence[Revolution], order_max: int) -> list[Revolution]:
    """Return revolutions of a slower sampling."""
    return [replace(revolution, order_max=order_max) for revolution in revolutions]


@pytest.mark.parametrize("order_max", [12, 18])
def test_few_orders_widen_the_error_of_the_peak(order_max: int) -> None:
    ring = radial()
    result = estimate(with_orders(rolled(ring), order_max))
    assert all(result[name].status is Status.VALID for name in NAMES)
    stated = np.degrees([result[name].std for name in NAMES])
    assert np.all(np.abs(angles_deg(result) - true_deg(ring, lateral(ring))) < 2.0 * stated)
    peak = result["ply_steer_peak_rad"]
    assert peak.std > 0.034 * (18.0 / order_max) ** 3 * abs(peak.value)


def test_too_few_orders_make_slopes_provisional() -> None:
    result = estimate(with_orders(rolled(radial()), 9))
    assert result[LINE_NAME].status is Status.PROVISIONAL
    assert Reason(RingCode.TOO_FEW_ORDERS, orders=9, needed=10) in result[LINE_NAME].reasons


@lru_cache(maxsize=4)
def two_speeds(offset_mps2: float) -> tuple[Revolution, ...]:
    """Return revolutions at two speeds of a rolled sensor with an error of its lateral zero."""
    sensor = replace(QUIET, lateral_offset_mps2=offset_mps2, roll_rad=0.02)
    both: list[Revolution] = []
    for speed in (50.0, 100.0):
        values = samples(radial(), [(40, lateral(radial()))], sensor, speed_kmh=speed)
        both += [r.revolution for r in through_pipeline(values, sensor) if not r.revolution.faults]
    return tuple(both)


def test_offset_beyond_the_stated_zero_is_measured_and_reported() -> None:
    result = estimate(two_speeds(9.8))
    offset = result[OFFSET_NAME]
    assert offset.status is Status.PROVISIONAL
    assert codes_of(offset.reasons) == (ForceCode.LATERAL_ZERO_CONTRADICTED,)
    assert abs(offset.value - 9.8) < 3.0 * offset.std < 1.5
    assert result[ROLL_NAME].value == pytest.approx(0.02, abs=1e-3)
    assert angles_deg(result) == pytest.approx(true_deg(radial(), lateral(radial())), abs=0.012)


def test_offset_within_the_stated_zero_is_valid() -> None:
    for offset, claims in ((0.5, SensorClaims()), (9.8, SensorClaims(zero_g_std_mps2=8.0))):
        result = estimate(two_speeds(offset), conditions=replace(CONDITIONS, claims=claims))[OFFSET_NAME]
        assert result.status is Status.VALID
        assert abs(result.value - offset) < 3.0 * result.std


def test_offset_at_one_speed_is_not_separated_from_roll() -> None:
    result = estimate(rolled(radial(), LateralBelt(), replace(QUIET, lateral_offset_mps2=2.0)))[OFFSET_NAME]
    assert result.status is Status.PROVISIONAL
    assert codes_of(result.reasons) == (TrustCode.NEEDS_TWO_SPEEDS,)
    assert result.std > 0.9


def test_unlikely_roll_at_one_speed_makes_slopes_provisional() -> None:
    """A lateral zero of 6 g looks like a roll of 3.3 deg, and that like conicity."""
    sensor = replace(QUIET, lateral_offset_mps2=59.0)
    revolutions = rolled(radial(), LateralBelt(), sensor)
    for claims, is_unlikely in ((SensorClaims(), True), (SensorClaims(roll_rad=math.radians(3.3)), False)):
        result = estimate(revolutions, conditions=replace(CONDITIONS, claims=claims))
        for name in (NAMES[1], CONICITY_NAME):
            assert (ForceCode.ROLL_UNLIKELY in codes_of(result[name].reasons)) is is_unlikely
            assert result[name].status is Status.PROVISIONAL


def test_stated_roll_is_compared_with_the_measured_one() -> None:
    for stated_deg, status in ((1.1, Status.VALID), (6.0, Status.PROVISIONAL)):
        claims = SensorClaims(roll_rad=math.radians(stated_deg))
        result = estimate(two_speeds(0.5), conditions=replace(CONDITIONS, claims=claims))[ROLL_NAME]
        assert result.status is status
        assert (ForceCode.ROLL_CONTRADICTED in codes_of(result.reasons)) is (status is Status.PROVISIONAL)
        assert result.value == pytest.approx(0.02, abs=1e-3)


def test_acceleration_does_not_change_the_angle() -> None:
    fast = estimate(rolled(radial(), count=20, acceleration_mps2=3.0))
    assert angles_deg(fast) == pytest.approx(angles_deg(estimate(rolled(radial()))), abs=0.004)


def test_scatter_matches_the_stated_error() -> None:
    sensor = Sensor(noise_mg=15.0)
    revolutions = rolled(radial(), sensor=sensor, count=120)
    ring = radial()
    records = [lateral_record(r, 0.0) for r in revolutions]
    edges = (ring.leading_edge_rad, ring.trailing_edge_rad)
    rows = slopes(records[0], edges, RADIUS_M).rows
    bound = 15e-3 * STANDARD_GRAVITY_MPS2 / math.sqrt(revolutions[0].period_s) / revolutions[0].omega_radps ** 2
    scatter = np.std([rows @ record.lateral_m for record in records], axis=0, ddof=1)
    assert scatter == pytest.approx(np.linalg.norm(rows, axis=1) * bound, rel=0.25)
    # The estimate's own error, without mounting and edges.
    average = LateralAverage(100.0, RollCalibration())
    for revolution in revolutions:
        block = one_revolution(revolution, settled(revolution), CONDITIONS)
        record = average.update(block, [0]).records[-1]()
    stated = np.sqrt(np.sum((rows @ record.covariance) * rows, axis=1))
    assert stated == pytest.approx(scatter / math.sqrt(len(revolutions)), rel=0.3)


def test_reason_names_conicity_and_orders() -> None:
    result = estimate(rolled(radial()))
    for name in NAMES:
        assert result[name].reasons == (
            Reason(ForceCode.INCLUDES_CONICITY),
            Reason(ForceCode.ORDERS_USED, first=1, last=40),
        )
    values = [result[name].value for name in NAMES]
    assert len({round(math.degrees(value), 2) for value in values}) == 3  # the definitions differ


def test_first_revolutions_and_faults_are_provisional() -> None:
    revolutions = rolled(radial())
    first = estimate(revolutions[:3])
    assert first[NAMES[0]].status is Status.PROVISIONAL
    assert first[ROLL_NAME].status is Status.PROVISIONAL
    estimator = PlySteerEstimator()
    before = estimate(revolutions, estimator)
    bad = replace(revolutions[0], faults=(Reason(EstimateCode.SAMPLES_LOST),), axes_mps2=revolutions[0].axes_mps2 * 3)
    after = estimate([bad], estimator)
    assert after[NAMES[0]].value == before[NAMES[0]].value
    assert after[NAMES[0]].status is Status.PROVISIONAL
    assert EstimateCode.SAMPLES_LOST in codes_of(after[NAMES[0]].reasons)
    assert after[ROLL_NAME].value == before[ROLL_NAME].value
    assert before[ROLL_NAME].status is Status.VALID
    assert after[ROLL_NAME].status is Status.PROVISIONAL
    assert EstimateCode.SAMPLES_LOST in codes_of(after[ROLL_NAME].reasons)


def test_ac_coupling_adds_roll_tilt_to_the_error() -> None:
    values = samples(radial(), [(15, lateral(radial()))], QUIET)
    values = values - values.mean(axis=0)
    revolutions = [r.revolution for r in through_pipeline(values, QUIET, coupling=Coupling.AC)]
    result = estimate([r for r in revolutions if not r.faults])
    assert result[ROLL_NAME].status is Status.INVALID
    assert result[NAMES[0]].status is Status.PROVISIONAL
    assert ForceCode.ROLL_NOT_CALIBRATED in codes_of(result[NAMES[0]].reasons)
    assert math.degrees(result[NAMES[0]].std) > 0.04


def test_no_estimates_without_a_lateral_axis() -> None:
    values = samples(radial(), [(4, lateral(radial()))], QUIET)
    for name in ("ply-steer", "slip-angle"):
        results = through_pipeline(values, QUIET, [name], axes=0b101)
        assert results
        assert all(r.estimates == () for r in results)


def test_non_finite_values_are_rejected() -> None:
    good = rolled(radial())[0]
    for name in ("ply-steer", "slip-angle"):
        estimator = make_estimator(name)
        axes = good.axes_mps2.copy()
        axes[1, 5] = np.nan
        for bad in (
            replace(good, axes_mps2=axes),
            replace(good, omega_radps=math.nan),
            replace(good, order_max=0),
        ):
            for result in estimator.update(bad, settled(good), CONDITIONS):
                assert result.status is Status.INVALID
                assert math.isnan(result.value)
                assert result.reasons
        no_contact = replace(settled(good), leading_edge_rad=math.nan)
        assert all(e.status is Status.INVALID for e in estimator.update(good, no_contact, CONDITIONS))
        no_radius = estimator.update(good, settled(good), TireConditions(math.nan))
        assert all(e.status is Status.INVALID for e in no_radius)


def test_reset_forgets() -> None:
    estimator = PlySteerEstimator()
    first = estimate(rolled(radial())[:5], estimator)
    estimate(rolled(radial(), LateralBelt(coupling_length_m=-2e-3)), estimator)
    estimator.reset()
    assert estimate(rolled(radial())[:5], estimator) == first


def test_two_directions_separate_ply_steer_and_conicity() -> None:
    """In reverse the coupling changes sign, the cone does not."""
    ring = radial()
    cone = LateralBelt(conicity_rad=0.01)
    forward = angles_deg(estimate(rolled(ring, cone)))
    reverse = angles_deg(estimate(rolled(ring, replace(cone, coupling_length_m=-cone.coupling_length_m))))
    # Only the mean over a fixed half is linear; peak and adhesion line lie elsewhere on every shape.
    ply_steer, conicity = 0.5 * (forward[1] - reverse[1]), 0.5 * (forward[1] + reverse[1])
    assert ply_steer == pytest.approx(true_deg(ring, lateral(ring))[1], abs=0.01)
    only_cone = true_deg(ring, lateral(ring, replace(cone, coupling_length_m=0.0)))
    assert conicity == pytest.approx(only_cone[1], abs=0.01)
    assert abs(conicity) > 0.005


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_pure_conicity_has_no_ply_steer_sign(seed: int) -> None:
    cone = LateralBelt(coupling_length_m=0.0, conicity_rad=math.radians(0.3))
    result = estimate(rolled(radial(), cone, replace(Sensor(noise_mg=5.0), seed=seed), 40))
    for name in ("ply_steer_peak_rad", "ply_steer_adhesion_line_rad"):
        assert result[name].status is Status.INVALID
        assert codes_of(result[name].reasons) == (EstimateCode.SIGN_NOT_DETERMINED,)
    assert abs(result[LINE_NAME].value) < 3.0 * result[LINE_NAME].std
    assert result[LINE_NAME].status is Status.PROVISIONAL
    conicity = result[CONICITY_NAME]
    true = half_difference_deg(radial(), lateral(radial(), cone))
    assert conicity.status is Status.PROVISIONAL
    assert codes_of(conicity.reasons) == (ForceCode.CONICITY_NOT_SEPARATED,)
    assert math.degrees(conicity.value) == pytest.approx(true, abs=3.0 * math.degrees(conicity.std))


def half_difference_deg(ring: RingSolution, shape: LateralSolution) -> float:
    leading, trailing = ring.leading_edge_rad, ring.trailing_edge_rad
    y = np.interp([leading, 0.5 * (leading + trailing), trailing], shape.theta_rad, shape.y_m)
    return math.degrees((y[2] - 2.0 * y[1] + y[0]) / (RADIUS_M * (trailing - leading)))


@pytest.mark.parametrize("conicity_deg", [-0.5, 0.5])
def test_contact_line_does_not_contain_conicity(conicity_deg: float) -> None:
    ring = radial()
    plain = estimate(rolled(ring))
    coned = estimate(rolled(ring, LateralBelt(conicity_rad=math.radians(conicity_deg))))
    assert coned[LINE_NAME].value == pytest.approx(plain[LINE_NAME].value, abs=math.radians(0.003))
    assert abs(coned[NAMES[1]].value - plain[NAMES[1]].value) > math.radians(0.03)
    assert plain[CONICITY_NAME].status is Status.PROVISIONAL
    assert codes_of(plain[CONICITY_NAME].reasons) == (ForceCode.CONICITY_NOT_SEPARATED,)


@pytest.mark.parametrize("slip_deg", [-2.0, -0.5, 0.5, 2.0])
def test_slip_that_nobody_states_is_in_the_errors(slip_deg: float) -> None:
    """It moves the line by several of the errors without it, and bends the contact as conicity would."""
    ring = radial()
    plain = estimate(rolled(ring))
    slipping = estimate(rolled(ring, slip_deg=slip_deg))
    for name in (*NAMES, LINE_NAME):
        if slipping[name].status is not Status.INVALID:
            assert abs(slipping[name].value - plain[name].value) < 3.0 * slipping[name].std, name
    assert abs(slipping[NAMES[1]].value - plain[NAMES[1]].value) > 3.0 * plain[NAMES[1]].std
    assert slipping[CONICITY_NAME].status is Status.PROVISIONAL


def test_missing_circumferential_axis_keeps_the_error_of_yaw() -> None:
    deep = radial(offset_m=5e-3)
    revolutions = rolled(deep)
    whole = estimate(revolutions)[LINE_NAME]
    estimator, average = PlySteerEstimator(), settled(revolutions[0])
    conditions = replace(CONDITIONS, sensor_offset_m=4e-3, sensor_offset_std_m=3e-3)
    for revolution in revolutions:
        axes = revolution.axes_mps2.copy()
        axes[0] = np.nan
        results = {e.name: e for e in estimator.update(replace(revolution, axes_mps2=axes), average, conditions)}
    assert results[LINE_NAME].std == pytest.approx(whole.std, rel=0.3)


def test_gain_and_radius_errors_scale_the_angle() -> None:
    revolutions, estimator = rolled(radial()), PlySteerEstimator()
    average = settled(revolutions[0])
    conditions = replace(CONDITIONS, gain_std=0.03, radius_std_m=0.04 * RADIUS_M)
    for revolution in revolutions:
        results = {e.name: e for e in estimator.update(revolution, average, conditions)}
    plain = estimate(revolutions)
    for name in (*NAMES, LINE_NAME):
        # The standard error is that of the last renewal.
        assert results[name].std == pytest.approx(math.hypot(plain[name].std, 0.05 * plain[name].value), rel=2e-3)


def laminate_of(angle_deg: float) -> TireData:
    """Return a tire whose plies lie 1.2 mm apart, the inner one at an angle."""
    plies = tuple(
        StatedPly(math.radians(angle), 1.2e-3, 200e9, 0.22, math.radians(0.5), 0.03e-3)
        for angle in (angle_deg, -angle_deg)
    )
    return TireData(added=(BeltLaminate(plies, 6e6, 1.2e6),))


def with_laminate(revolutions: Sequence[Revolution], angle_deg: float) -> dict[str, Estimate]:
    conditions = TireConditions(RADIUS_M, radius_std_m=0.002, tire=laminate_of(angle_deg))
    return estimate(revolutions, conditions=conditions)


def test_laminate_angle_stands_with_the_measured_peak() -> None:
    # The belt of the signal has g = +1.2 mm: plies at -26.6 deg inside.
    revolutions = rolled(radial(), LateralBelt(), QUIET, 40)
    result = with_laminate(revolutions, -26.6)
    angle, peak = result["ply_steer_laminate_rad"], result["ply_steer_peak_rad"]
    assert angle.status is Status.VALID
    assert angle.value == pytest.approx(1.2e-3 / RADIUS_M, rel=0.01)
    assert 0.02 < angle.std / angle.value < 0.1
    assert abs(peak.value - PEAK_OVER_LAMINATE * angle.value) < 3.0 * PEAK_OVER_LAMINATE_STD * angle.value
    assert result["laminate_b16_n"].value / result["laminate_a66_npm"].value == pytest.approx(angle.value * RADIUS_M)
    assert result["laminate_b16_n"].std > 0.0


@pytest.mark.parametrize("angle_deg", [26.6, -12.0])
def test_laminate_that_differs_from_the_peak_is_provisional(angle_deg: float) -> None:
    angle = with_laminate(rolled(radial(), LateralBelt(), QUIET, 40), angle_deg)["ply_steer_laminate_rad"]
    assert angle.status is Status.PROVISIONAL
    assert ForceCode.LAMINATE_DIFFERS in codes_of(angle.reasons)


def test_no_laminate_estimates_without_plies() -> None:
    assert not set(LAMINATE_NAMES) & set(estimate(rolled(radial())))


@pytest.mark.parametrize("load_n", [3000.0, 6000.0])
def test_slope_ahead_matches_that_of_the_belt(load_n: float) -> None:
    ring = radial(load_n)
    shape = lateral(ring)
    ahead = (ring.theta_rad > ring.leading_edge_rad - 0.8) & (ring.theta_rad < ring.leading_edge_rad)
    result = estimate(rolled(ring, LateralBelt(), Sensor(noise_mg=1.0), 30))[AHEAD_NAME]
    assert result.status is Status.VALID
    assert result.value == pytest.approx(-shape.slope_rad[ahead].min(), abs=math.radians(0.005))
    assert ForceCode.INCLUDES_CONICITY in codes_of(result.reasons)


def test_slope_ahead_follows_pressure_more_than_the_peak() -> None:
    soft, hard = (estimate(rolled(radial(4000.0, pressure))) for pressure in (1.8e5, 2.7e5))
    factor = {name: soft[name].value / hard[name].value for name in (AHEAD_NAME, NAMES[0])}
    assert factor[AHEAD_NAME] > 1.25
    assert factor[NAMES[0]] < 1.05
