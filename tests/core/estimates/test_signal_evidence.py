"""Evidence of the signal against what is stated, through the whole pipeline and on single comparisons."""

import math
from dataclasses import replace

import pytest

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.estimates.estimator import Estimate, Status, TireConditions
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.sensor_claims import UNKNOWN_OFFSET_STD_M, SensorClaims
from gateway.core.estimates.wheel_setup import ReferenceNumbers, TireData, WheelSetup
from gateway.core.quantity import Basis
from gateway.core.reasons import Code, CoreCode, Reason, codes_of
from gateway.core.ring_quantities import RING_NUMBERS
from gateway.core.trust.reasons import TrustCode
from gateway.core.trust.refuted_sums import Equations
from gateway.core.trust.sensor_measurement import Measured
from gateway.core.trust.signal_evidence import Contradiction, Subject, assess
from tests.testkit.simulated_wheel import last, restated, simulated

SETUP = WheelSetup("FL", 0, 0, 0.32, radius_std_m=0.0032, load_n=5000.0, pressure_pa=210e3)
DEFAULT = ("kinematic", "weak-form")
PLAIN = "[sensor]\nrange_g = 1000"
DEEP = PLAIN + "\noffset_mm = 8"


def reasons_by_code(reasons: tuple[Reason, ...]) -> dict[Code, Reason]:
    """Return reasons and those nested in them, by code."""
    return {inner.code: inner for reason in reasons for outer in reason for inner in outer}


def test_half_the_rate_makes_speed_invalid() -> None:
    results, snapshot = restated(PLAIN, 4.0, SETUP, (*DEFAULT, "self-calibration"), rate_factor=0.5)
    result = last(results)
    assert result["speed_mps"].status is Status.INVALID
    assert result["gain"].status is Status.INVALID
    (reason,) = result["speed_mps"].reasons
    assert reason.code is TrustCode.MAY_CHANGE_BY
    assert reason["effect"] == pytest.approx(1.0, abs=0.01)
    contradiction = reason["why"]
    assert contradiction["ratio"] == pytest.approx(4.0, abs=0.05)
    cause, missed = contradiction["causes"]
    assert cause.kind == (TrustCode.WOULD_FIT, "rate")
    assert missed == Reason(TrustCode.WOULD_FIT, what="contacts", every=2.0)
    assert cause["rate_hz"] == pytest.approx(9600.0, rel=1e-4)
    assert [flag.name for flag in snapshot.flags] == ["steady value"]


def test_first_revolution_already_contradicts_the_rate() -> None:
    results, _ = restated(PLAIN, 4.0, SETUP, DEFAULT, rate_factor=0.5)
    assert all(last(results[:n])["speed_mps"].status is Status.INVALID for n in range(1, len(results)))


def test_metres_taken_for_g_are_named() -> None:
    _, snapshot = restated(PLAIN, 4.0, SETUP, DEFAULT, unit_factor=STANDARD_GRAVITY_MPS2)
    (flag,) = snapshot.flags
    assert flag.reason["causes"] == (Reason(TrustCode.WOULD_FIT, what="mps2"),)


def test_wrong_radius_makes_speed_provisional() -> None:
    results, _ = simulated(PLAIN, 4.0, replace(SETUP, radius_m=0.30, radius_std_m=0.003), DEFAULT)
    result = last(results)
    for name in ("speed_mps", "contact_length_m", *RING_NUMBERS):
        assert result[name].status is Status.PROVISIONAL
    causes = {cause["what"]: cause for cause in result["speed_mps"].reasons[0]["why"]["causes"]}
    assert causes["radius"]["radius_m"] == pytest.approx(0.32, abs=0.001)
    assert result["Bs/Cw"].status is Status.VALID
    assert result["leading_edge_rad"].status is Status.VALID


@pytest.mark.parametrize("factor", [2.0, 1.6, 1.0 / 1.7])
def test_a_radius_wrong_by_far_leaves_nothing_valid_that_rests_on_it(factor: float) -> None:
    """A diameter for the radius, or the rim for the belt: the rate would explain it too, and nothing decides."""
    setup = replace(SETUP, radius_m=factor * 0.32, radius_std_m=factor * 0.0032)
    result = last(simulated(PLAIN, 4.0, setup, (*DEFAULT, "distance"))[0])
    for name in ("speed_mps", "distance_m", "contact_length_m", *RING_NUMBERS):
        assert result[name].status is not Status.VALID, result[name]
    assert result["leading_edge_rad"].status is Status.VALID


@pytest.mark.parametrize(("radius", "gain"), [(0.05, 8.0), (-0.05, -7.0)])
def test_radius_and_gain_that_hide_each_other_widen_what_rests_on_them(radius: float, gain: float) -> None:
    tables = PLAIN + f"\ngain_error_percent = [{gain}, {gain}, {gain}]\n[motion]\nspeed_kmh = 50"
    stated_m = 0.32 * (1.0 + radius)
    setup = replace(SETUP, radius_m=stated_m, radius_std_m=0.01 * stated_m, load_std_n=50.0, pressure_std_pa=1e3)
    results, truth = simulated(tables, 8.0, setup, DEFAULT)
    result, numbers = last(results), truth.numbers(7.0)
    true = {"speed_mps": 50.0 / 3.6, **{name: getattr(numbers, name) for name in RING_NUMBERS}}
    for name, value in true.items():
        estimate = result[name]
        assert estimate.status is not Status.VALID or abs(estimate.value - value) < 2.5 * estimate.std, estimate


def test_all_stated_well_contradicts_nothing() -> None:
    results, truth = simulated(PLAIN, 4.0, SETUP, DEFAULT)
    result = last(results)
    for name in ("speed_mps", "leading_edge_rad", *RING_NUMBERS, "Bs/Cw"):
        assert result[name].status is Status.VALID, result[name]
    for name in RING_NUMBERS:
        assert abs(result[name].value - getattr(truth.numbers(3.0), name)) < 3.0 * result[name].std


@pytest.mark.parametrize("claims", [SensorClaims(), SensorClaims(offset_m=0.008)])
def test_depth_is_measured_and_used(claims: SensorClaims) -> None:
    """A sensor 8 mm below the neutral layer moves Ts by 40 standard errors where that is not used."""
    results, truth = simulated(DEEP, 6.0, replace(SETUP, sensor=claims), DEFAULT)
    conditions = results[-1].conditions
    assert conditions.sensor_offset_m == pytest.approx(0.008, abs=3.0 * conditions.sensor_offset_std_m)
    assert conditions.sensor_offset_std_m < 3e-4
    result = last(results)
    for name in RING_NUMBERS:
        assert result[name].status is Status.VALID
        assert abs(result[name].value - getattr(truth.numbers(5.0), name)) < 3.0 * result[name].std


@pytest.mark.parametrize("stated_m", [0.0, 0.003])
def test_wrong_depth_makes_numbers_provisional(stated_m: float) -> None:
    setup = replace(SETUP, sensor=SensorClaims(offset_m=stated_m))
    results, truth = simulated(DEEP, 6.0, setup, (*DEFAULT, "self-calibration"))
    result = last(results)
    for name in (*RING_NUMBERS, "Bs/Cw"):
        assert result[name].status is Status.PROVISIONAL
        assert codes_of(result[name].reasons)[:2] == (TrustCode.ERROR_COVERS, TrustCode.OFFSET_CONTRADICTED)
    for name in RING_NUMBERS:
        assert abs(result[name].value - getattr(truth.numbers(5.0), name)) < 3.0 * result[name].std
    assert result["speed_mps"].status is Status.VALID
    assert result["sensor_offset_m"].status is Status.VALID


def test_depth_unknown_to_all_widens_the_error() -> None:
    """A radial axis alone does not tell the depth."""
    tables = DEEP + '\naxes = ["radial"]'
    results, truth = simulated(tables, 6.0, SETUP, DEFAULT)
    assert results[-1].conditions.sensor_offset_std_m == pytest.approx(UNKNOWN_OFFSET_STD_M, rel=0.01)
    result = last(results)
    for name in RING_NUMBERS:
        assert abs(result[name].value - getattr(truth.numbers(5.0), name)) < 3.0 * result[name].std
    assert TrustCode.OFFSET_UNKNOWN in codes_of(result["Cw"].reasons)


def test_unknown_radius_is_measured() -> None:
    setup = replace(SETUP, radius_m=0.4, radius_std_m=0.08)
    results, _ = simulated(PLAIN, 4.0, setup, DEFAULT)
    conditions = results[-1].conditions
    assert conditions.radius_m == pytest.approx(0.32, rel=0.003)
    assert 0.004 < conditions.radius_std_m < 0.008


def test_zero_offset_is_contradicted_by_two_speeds() -> None:
    tables = PLAIN + "\nzero_g_offset_g = [0, 0, 1.5]\n[motion]\nspeed_kmh = [[0, 40], [12, 90]]"
    results, truth = simulated(tables, 12.0, SETUP, DEFAULT)
    result = last(results)
    assert TrustCode.ZERO_CONTRADICTED in reasons_by_code(result["Cw"].reasons)
    for name in RING_NUMBERS:
        assert result[name].status is Status.PROVISIONAL
        assert abs(result[name].value - getattr(truth.numbers(11.0), name)) < 3.0 * result[name].std


@pytest.mark.parametrize("load_n", [4000.0, 6000.0])
def test_wrong_load_is_contradicted_by_the_width(load_n: float) -> None:
    """The width of the belt is that of the new tire, whatever its wear."""
    reference = ReferenceNumbers(3.08e-3, 0.195, 2.97, 2.53, pressure_pa=210e3)
    setup = replace(SETUP, load_n=load_n, tire=TireData(reference=reference))
    result = last(simulated(PLAIN, 4.0, setup, (*DEFAULT, "load"))[0])
    for name in RING_NUMBERS:
        assert result[name].status is Status.PROVISIONAL
        assert codes_of(result[name].reasons) == (EstimateCode.WIDTH_CONTRADICTED,)
    assert result["pressure_number"].status is Status.PROVISIONAL
    assert EstimateCode.WIDTH_CONTRADICTED in codes_of(result["pressure_number"].reasons)
    assert result["Bs/Cw"].status is Status.VALID


CONDITIONS = TireConditions(0.32, 4200.0, 210e3, radius_std_m=0.0032)
SPEED = Estimate("speed_mps", 18.0, 0.001, Status.VALID)


def measured(ratio: float, *, gain: float = 1.0, gain_std: float = 0.01, offset_m: float | None = 0.0) -> Measured:
    """Return a measurement of one speed with R Omega^2 = 1000 m/s^2."""
    return Measured(
        revolutions=20,
        ac_coupled=False,
        rate_hz=9600.0,
        steady_mps2=1000.0,
        mean_square=1.3,
        by_mean=Equations(8e7, 8e4, 80.0, 8e7 * (ratio - 1.0), 8e4 * (ratio - 1.0)),
        by_gravity=Equations(gain_std**-2.0, 0.0, 1.0, (gain - 1.0) / gain_std**2, 0.0),
        contact_gain=None,
        offset_m=None if offset_m is None else (offset_m, 1e-4),
    )


@pytest.mark.parametrize("ratio", [0.985, 1.0, 1.01])
def test_ratio_within_errors_changes_nothing(ratio: float) -> None:
    evidence = assess(measured(ratio), CONDITIONS, 1000.0, ac_coupled=False)
    assert evidence.contradictions == ()
    assert evidence.radius_m == CONDITIONS.radius_m
    share = math.sqrt(1.0 / 6.0) * abs(ratio - 1.0) * CONDITIONS.radius_m
    assert evidence.radius_std_m == pytest.approx(math.hypot(CONDITIONS.radius_std_m, share), rel=0.05)
    assert evidence.qualified(SPEED) == SPEED


@pytest.mark.parametrize("ratio", [0.96, 1.04])
def test_ratio_near_a_contradiction_widens_the_errors(ratio: float) -> None:
    """A radius that is 4 % off is within three errors of a gain known to 1.5 %."""
    without_gravity = measured(ratio, gain_std=1.0)
    evidence = assess(without_gravity, replace(CONDITIONS, radius_std_m=0.001), 1000.0, ac_coupled=False)
    assert evidence.contradictions == ()
    assert evidence.radius_m == CONDITIONS.radius_m
    assert 3.0 * evidence.radius_std_m > 0.04 * CONDITIONS.radius_m
    assert 3.0 * evidence.gain_std > 0.04
    # As if the zero-g offset were wrong by as much as the steady value.
    assert 3.0 * evidence.steady_std_mps2 > 40.0
    speed = evidence.qualified(SPEED)
    assert speed.status is Status.VALID
    assert codes_of(speed.reasons) == (TrustCode.STEADY_VALUE_DISAGREES,)
    assert evidence.qualified(SPEED._replace(name="leading_edge_rad")).reasons == ()
    # The rate may be the wrong statement: it would be off by half as much.
    in_use = evidence.applied_to(CONDITIONS).claims
    assert 4.0 * in_use.rate_std > 0.02
    assert replace(in_use, rate_std=CONDITIONS.claims.rate_std) == CONDITIONS.claims


@pytest.mark.parametrize(("gain", "contradicted"), [(1.0, True), (1.04, False)])
def test_speed_by_gravity_is_compared_with_that_by_the_radius(gain: float, contradicted: bool) -> None:
    """A steady value that is 4 % off may be a gain known to 1.5 %, but not one that gravity shows to be right."""
    conditions = replace(CONDITIONS, radius_std_m=0.001)
    seen = measured(1.04, gain=gain)
    evidence = assess(seen, conditions, 1000.0, ac_coupled=False)
    assert [contradiction.subject for contradiction in evidence.contradictions] == [Subject.STEADY] * contradicted
    # What moves the hub may be in gravity's order too.
    moving = assess(seen._replace(hub_mps2=1.0), conditions, 1000.0, ac_coupled=False)
    assert moving.contradictions == ()


def test_gravity_decides_between_gain_and_radius() -> None:
    by_gain = assess(measured(1.1, gain=1.1), CONDITIONS, 1000.0, ac_coupled=False)
    assert set(by_gain.contradictions[0].ratios) == {"gain"}
    assert by_gain.qualified(SPEED).status is Status.VALID
    by_radius = assess(measured(1.1), CONDITIONS, 1000.0, ac_coupled=False)
    assert "gain" not in by_radius.contradictions[0].ratios
    assert by_radius.qualified(SPEED).status is Status.PROVISIONAL


def test_effect_within_the_error_leaves_estimate_valid() -> None:
    evidence = assess(measured(1.1), CONDITIONS, 1000.0, ac_coupled=False)
    wide = SPEED._replace(std=8.0)
    assert evidence.qualified(wide) == wide


def test_invalid_estimate_stays_as_it_is() -> None:
    evidence = assess(measured(4.0), CONDITIONS, 1000.0, ac_coupled=False)
    invalid = Estimate.invalid("speed_mps", Reason(EstimateCode.NO_CONTACT_EDGES))
    assert evidence.qualified(invalid) is invalid


def test_rate_near_a_contradiction_widens_the_measured_depth() -> None:
    """A rate of 9984 Hz for 9600 Hz is within three errors of a gain known to 3 %."""
    claims = SensorClaims(gain_std=0.03)
    setup = replace(SETUP, sensor=claims)
    result = last(restated(DEEP, 4.0, setup, ("kinematic", "self-calibration"), rate_factor=1.04)[0])
    for name, true in (("sensor_offset_m", 0.008), ("speed_mps", 65.0 / 3.6)):
        assert result[name].status is Status.VALID
        assert abs(result[name].value - true) < 3.0 * result[name].std
    # Beyond the gains of two axes, 4.2 %.
    assert result["sensor_offset_m"].std > 0.048 * result["sensor_offset_m"].value


def test_agreeing_depths_are_averaged() -> None:
    conditions = replace(CONDITIONS, claims=SensorClaims(offset_m=0.0051, offset_std_m=1e-4))
    evidence = assess(measured(1.0, offset_m=0.005), conditions, 1000.0, ac_coupled=False)
    assert evidence.sensor_offset_m == pytest.approx(0.00505)
    assert evidence.sensor_offset_std_m == pytest.approx(1e-4 / math.sqrt(2.0))


def test_contradicted_gain_widens_the_measured_depth() -> None:
    evidence = assess(measured(1.1, gain=1.1, offset_m=0.01), CONDITIONS, 1000.0, ac_coupled=False)
    assert evidence.sensor_offset_std_m == pytest.approx(0.01 * (1.0 - 1.0 / 1.1), rel=0.05)


@pytest.mark.parametrize("ratio", [4.117, 7.0])
def test_without_a_single_cause_rate_radius_and_gain_are_all_doubted(ratio: float) -> None:
    """Half the rate, and a radius 3 % too small: the ratio of the steady values is no square of a usual factor."""
    evidence = assess(measured(ratio, gain=1.3), CONDITIONS, 1000.0, ac_coupled=False)
    (contradiction,) = evidence.contradictions
    assert contradiction.reason["causes"] == (Reason(TrustCode.NO_SINGLE_CAUSE),)
    for name in ("speed_mps", "angular_speed_radps", "rotation_rpm", "distance_m", "Bs"):
        assert evidence.qualified(Estimate(name, 12.6, 0.0014, Status.VALID)).status is Status.INVALID, name


@pytest.mark.parametrize("name", ["Bs", "load_by_width_n"])
def test_error_of_a_number_does_not_cover_a_wrong_radius(name: str) -> None:
    """A zero-g offset, which the errors cover, is another possible cause."""
    ratios = {Basis.RADIUS: 0.93, Basis.ZERO: math.nan}
    contradiction = Contradiction(Subject.STEADY, Reason(CoreCode.NO_STEADY_VALUE), ratios)
    estimate = Estimate(name, 1.0, 0.004, Status.VALID)
    change = 0.93**-2.0 - 1.0 if name == "Bs" else 1.0 - 0.93**2.0
    assert contradiction.effect_on(estimate) == pytest.approx(change)
    assert math.isnan(contradiction.effect_on(Estimate("Bs/Cw", 1.0, 0.004, Status.VALID)))


def test_zero_that_no_sensor_has_does_not_move_the_steady_value() -> None:
    """One of 40 revolutions with a speed 6.5 % too high would separate gain and zero, at 2000 m/s^2."""
    expected = [1950.0] * 39 + [2210.0]
    rows = [(steady / 0.5, 1.0 / 0.5, (1950.0 - steady) / 0.5) for steady in expected]
    sums = Equations(
        sum(a * a for a, _, _ in rows),
        sum(a * b for a, b, _ in rows),
        sum(b * b for _, b, _ in rows),
        sum(a * item for a, _, item in rows),
        sum(b * item for _, b, item in rows),
    )
    evidence = assess(measured(1.0)._replace(by_mean=sums, steady_mps2=1950.0), CONDITIONS, 1950.0, ac_coupled=False)
    assert evidence.contradictions == ()
    assert evidence.qualified(SPEED).status is Status.VALID


def test_error_by_the_shape_is_bounded() -> None:
    """A waveform without a steady value has any mean square; it must not hide the contradiction."""
    flat = measured(0.01, offset_m=None)._replace(mean_square=5000.0)
    assert [
        contradiction.subject for contradiction in assess(flat, CONDITIONS, 1000.0, ac_coupled=False).contradictions
    ] == [Subject.STEADY]


def test_notes_stand_beside_a_contradiction() -> None:
    """What is against an estimate does not hide what else is to be known of it."""
    contradiction = Contradiction(Subject.STEADY, Reason(TrustCode.NO_SINGLE_CAUSE), {Basis.RADIUS: 1.05})
    moving, note = Reason(TrustCode.HUB_MOVES, amplitude_mps2=2.0), Reason(EstimateCode.NO_CONTACT_EDGES)
    evidence = assess(None, CONDITIONS, 1000.0, ac_coupled=False)._replace(
        contradictions=(contradiction,), offset_is_known=False, hub_motion=moving
    )
    result = evidence.qualified(Estimate("Ts", 2.5, 0.05, Status.VALID, (note,)))
    assert result.status is Status.PROVISIONAL
    assert [reason.code for reason in result.reasons] == [
        TrustCode.MAY_CHANGE_BY, note.code, TrustCode.OFFSET_UNKNOWN, moving.code,
    ]  # fmt: skip


def test_change_without_bound_has_no_size() -> None:
    """A gain of a tenth would need a tenfold radius."""
    contradiction = Contradiction(Subject.GRAVITY, Reason(TrustCode.NO_SINGLE_CAUSE), {Basis.RADIUS: 10.0})
    evidence = assess(None, CONDITIONS, 1000.0, ac_coupled=False)._replace(contradictions=(contradiction,))
    result = evidence.qualified(SPEED)
    assert result.status is Status.INVALID
    assert result.reasons[0].code is TrustCode.NOTHING_FOLLOWS


@pytest.mark.parametrize("revolutions", [1, 7, 8])
def test_motion_of_the_hub_is_noted_after_enough_revolutions(revolutions: int) -> None:
    """The errors contain it from the first revolution on."""
    moving = measured(1.0)._replace(revolutions=revolutions, hub_mps2=2.0)
    evidence = assess(moving, TireConditions(0.32), 1000.0, ac_coupled=False)
    assert evidence.hub_mps2 == 2.0
    assert (evidence.hub_motion is not None) == (revolutions >= 8)
