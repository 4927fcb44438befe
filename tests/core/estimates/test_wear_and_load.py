"""Wear and load of simulated tires, through the whole pipeline."""

import math
import re
from dataclasses import replace

import pytest

from gateway.core.estimates.disagreement import disagreement_std
from gateway.core.estimates.estimator import Estimate, Status, TireConditions
from gateway.core.estimates.load import LoadEstimator
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.tire_data import LoadCalibration, ReferenceNumbers, TireData
from gateway.core.estimates.wear import WearEstimator
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.core.reasons import Code, Reason, codes_of
from gateway.core.text.wording import text
from tests.testkit.exact_ring import solution
from tests.testkit.revolution_data import exact_wave, make_revolution, settled
from tests.testkit.simulated_wheel import last, simulated

# The simulator's new tire.
NEW = TireData(0.015, reference=ReferenceNumbers(3.08e-3, 0.195, 2.97, 2.53, pressure_pa=210e3, temperature_degc=25.0))
ESTIMATORS = ("load", "wear", "weak-form", "kinematic")  # in any order


def wheel(load_n: float | None, tire: TireData = NEW) -> WheelSetup:
    return WheelSetup("FL", 0, 0, 0.32, load_n=load_n, tire=tire)


@pytest.mark.parametrize("wear_mm", [0.0, 2.9, 6.4])
def test_wear_follows_from_bending(wear_mm: float) -> None:
    result = last(simulated(f"[tire]\nwear_mm = {wear_mm}", 14.0, wheel(5000.0), ESTIMATORS)[0])["wear_mm"]
    assert result.status is Status.VALID
    assert result.value == pytest.approx(wear_mm, abs=0.03)
    assert result.std < 0.1


def test_wear_without_load_uses_the_ratio() -> None:
    result = last(simulated("[tire]\nwear_mm = 4", 14.0, wheel(None), ESTIMATORS)[0])
    assert Reason(EstimateCode.FROM_RATIO, ratio="Bs/Cw") in result["wear_mm"].reasons
    assert result["wear_mm"].value == pytest.approx(4.0, abs=0.05)
    assert result["wear_number"].value == pytest.approx(4.0 / 320.0, abs=2e-4)


def test_pressure_is_not_mistaken_for_wear() -> None:
    results, _ = simulated("", 14.0, wheel(5000.0), ESTIMATORS, "pressure_kpa = 180")
    assert last(results)["wear_mm"].value == pytest.approx(0.0, abs=0.03)
    # Without compensation 180 kPa would look like a stiffer ring: (210 / 180)^(1/3) is 0.8 mm of 15.
    uncompensated = replace(NEW, reference=replace(NEW.reference, pressure_pa=None))
    results, _ = simulated("", 14.0, wheel(5000.0, uncompensated), ESTIMATORS, "pressure_kpa = 180")
    result = last(results)["wear_mm"]
    assert EstimateCode.PRESSURE_NOT_COMPENSATED in codes_of(result.reasons)
    assert result.value < -0.6


def test_wear_shows_in_the_snapshot() -> None:
    from firmware_protocol.decoder import FrameDecoder
    from gateway.core.config.validation import parse_document
    from gateway.core.wheels.wheels import Pipeline
    from gateway.simulator.scenario_model import Scenario
    from gateway.simulator.simulation import simulate

    scenario = parse_document(Scenario, "[[wheel]]\nposition = 'FL'\nwheel = 0\n[wheel.tire]\nwear_mm = 3", "test")
    setup, decoder = wheel(None), FrameDecoder()
    with_wear = Pipeline((setup,), setup, ESTIMATORS)
    without = Pipeline((setup,), setup, ("kinematic",))
    for chunk in simulate(scenario, duration_s=8.0).chunks("link", 10**18):
        frames = decoder.feed(chunk.data)
        with_wear.frames("link", frames, chunk.host_ns)
        without.frames("link", frames, chunk.host_ns)
    (snapshot,) = with_wear.wheels()
    assert snapshot.wear_mm.value == pytest.approx(3.0, abs=0.1)
    # Without a stated load the estimated one is shown.
    assert snapshot.load_n == pytest.approx(5000.0, rel=0.02)
    (snapshot,) = without.wheels()
    assert snapshot.wear_mm is None
    assert snapshot.load_n is None


GIVEN = {"Bs": Estimate("Bs", 2e-3, 4e-5, Status.VALID), "Bs/Cw": Estimate("Bs/Cw", 0.01026, 4e-4, Status.VALID)}
CONDITIONS = TireConditions(0.32, 5000.0, 210e3, 25.0, tire=NEW, given={"weak-form": GIVEN})
UNDATED = replace(NEW.reference, temperature_degc=None)
REVOLUTION = make_revolution(exact_wave(solution()))
AVERAGE = settled(REVOLUTION)


def wear_of(conditions: TireConditions) -> Estimate:
    return WearEstimator().update(REVOLUTION, AVERAGE, conditions)[0]


def test_wear_error_combines_all_sources() -> None:
    ratio = (2e-3 / 3.08e-3) ** (1 / 3)
    by_ratio = 15.0 * ratio / 3.0
    softening = 0.006 * 2.0
    assert wear_of(CONDITIONS).value == pytest.approx(15.0 * (1.0 - ratio))
    assert wear_of(CONDITIONS).std == pytest.approx(by_ratio * math.hypot(0.02, softening))
    reference = replace(CONDITIONS, tire=replace(NEW, reference=replace(NEW.reference, Bs_std=3.08e-5)))
    assert wear_of(reference).std == pytest.approx(by_ratio * math.hypot(0.02, 0.01, softening))
    thickness = replace(CONDITIONS, tire=replace(NEW, ring_thickness_std_m=0.001))
    assert wear_of(thickness).std == pytest.approx(math.hypot(by_ratio * math.hypot(0.02, softening), 1.0 - ratio))


@pytest.mark.parametrize("warmer_k", [-20.0, 20.0])
def test_wear_is_corrected_for_temperature(warmer_k: float) -> None:
    softer = {"Bs": Estimate("Bs", 3.08e-3 * math.exp(-0.006 * warmer_k), 3e-5, Status.VALID)}
    result = wear_of(replace(CONDITIONS, given={"weak-form": softer}, temperature_degc=25.0 + warmer_k))
    assert result.value == pytest.approx(0.0, abs=1e-9)
    assert result.std == pytest.approx(5.0 * math.hypot(3.0 / 308.0, 0.003 * warmer_k, 0.012), rel=5e-3)


@pytest.mark.parametrize("known", [{"temperature_degc": None}, {"tire": replace(NEW, reference=UNDATED)}])
def test_unknown_temperature_is_in_the_error_of_the_wear(known: dict[str, object]) -> None:
    # 10 % softer rubber is half a millimetre of a ring of 15 mm.
    softer = {"Bs": Estimate("Bs", 0.9 * 3.08e-3, 3e-6, Status.VALID)}
    result = wear_of(replace(CONDITIONS, given={"weak-form": softer}, **known))
    assert EstimateCode.TEMPERATURE_NOT_COMPENSATED in codes_of(result.reasons)
    assert result.value == pytest.approx(0.5, abs=0.03)
    assert result.value < 1.5 * result.std


def test_unknown_pressure_makes_the_wear_provisional() -> None:
    result = wear_of(replace(CONDITIONS, pressure_pa=None))
    assert result.status is Status.PROVISIONAL
    assert EstimateCode.PRESSURE_NOT_COMPENSATED in codes_of(result.reasons)
    assert result.std > 0.1 / 3.0 * 15.0 * 0.85


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"tire": replace(NEW, ring_thickness_m=None)}, EstimateCode.NEEDS_RING_THICKNESS),
        ({"tire": replace(NEW, reference=ReferenceNumbers())}, EstimateCode.NEEDS_REFERENCE_NUMBER),
        ({"given": {}}, EstimateCode.NEEDS_ESTIMATOR),
        ({"given": {"ring-paper": GIVEN}}, EstimateCode.NEEDS_ESTIMATOR),
        ({"given": {"weak-form": {}}}, EstimateCode.NUMBER_MISSING),
        ({"tire": replace(NEW, reference=replace(NEW.reference, estimator="nosuch"))}, EstimateCode.UNKNOWN_ESTIMATOR),
    ],
)
def test_missing_wear_inputs_are_reported(change: dict[str, object], code: Code) -> None:
    result = wear_of(replace(CONDITIONS, **change))
    assert result.status is Status.INVALID
    assert codes_of(result.reasons) == (code,)


@pytest.mark.parametrize("load", [1.0, 1.05, 1.3])
def test_wears_that_disagree_include_their_difference(load: float) -> None:
    """A stated load that is wrong changes Bs and not its ratio to Cw."""
    stated = {**GIVEN, "Bs": Estimate("Bs", 2e-3 * load, 4e-5 * load, Status.VALID)}
    by_number, exact = wear_of(replace(CONDITIONS, given={"weak-form": stated})), wear_of(CONDITIONS)
    assert (EstimateCode.WEARS_DISAGREE in codes_of(by_number.reasons)) == (load > 1.2)
    assert abs(by_number.value - exact.value) <= 1.05 * by_number.std
    assert load > 1.0 or by_number.std == exact.std


def test_wear_drift_follows_the_wear() -> None:
    estimator = WearEstimator()
    for index in range(1001):
        worn = (1.0 - 0.0002 * index / 15.0) ** 3 * 3.08e-3
        stated = {"weak-form": {"Bs": Estimate("Bs", worn, 1e-6, Status.VALID)}}
        result = estimator.update(replace(REVOLUTION, index=index), AVERAGE, replace(CONDITIONS, given=stated))[2]
        assert (result.status is Status.INVALID) == (index < 300)
    assert result.value == pytest.approx(0.2, rel=1e-6)
    assert result.std == pytest.approx(5.0 * 0.012)
    assert result.reasons == (Reason(EstimateCode.OVER_REVOLUTIONS, revolutions=1000.0),)


CALIBRATION = LoadCalibration(4093.0, 0.20787, 209e3, 1.340, 0.237, 0.382, 0.006, (0.135, 0.311), (190e3, 230e3))
CALIBRATED = replace(NEW, load_calibration=CALIBRATION)


@pytest.mark.parametrize("load_n", [3000.0, 6500.0])
def test_load_from_angle_and_from_width(load_n: float) -> None:
    results, _ = simulated("", 14.0, wheel(None, CALIBRATED), ESTIMATORS, f"load_n = {load_n}")
    result = last(results)
    assert result["load_by_angle_n"].value == pytest.approx(load_n, rel=0.03)
    assert abs(result["load_by_angle_n"].value - load_n) < 3.0 * result["load_by_angle_n"].std
    assert result["load_by_width_n"].value == pytest.approx(load_n, rel=0.01)
    assert result["load_n"].value == result["load_by_width_n"].value
    assert EstimateCode.FROM_BELT_WIDTH in codes_of(result["load_n"].reasons)


def test_load_follows_every_revolution() -> None:
    results, truth = simulated(
        "", 14.0, wheel(None, CALIBRATED), ("kinematic", "load"), "load_n = [[0, 4000], [6, 4000], [8, 6000]]"
    )
    for result in results[40:]:
        actual = {estimate.name: estimate for estimate in result.estimates}["load_by_angle_n"]
        true = truth.load_n(result.revolution.start_s)
        assert actual.value == pytest.approx(true, rel=0.06)
        assert abs(actual.value - true) < 2.0 * actual.std


def test_stated_load_does_not_set_the_estimate() -> None:
    # The wheel carries 6000 N, the vehicle file states 5000 N.
    result = last(simulated("", 14.0, wheel(5000.0), ESTIMATORS, "load_n = 6000")[0])
    assert result["load_n"].value == pytest.approx(6000.0, rel=0.01)
    assert result["load_n"].status is Status.PROVISIONAL
    assert EstimateCode.LOAD_CONTRADICTED in codes_of(result["load_n"].reasons)
    (doubt,) = [reason for reason in result["Bs"].reasons if reason.code is EstimateCode.WIDTH_CONTRADICTED]
    # Value and error have the same number of digits.
    assert re.search(r"Cw, .* is \d\.\d{3} ± \d\.\d{3} times that of the new tire", text(doubt))
    assert EstimateCode.WIDTH_CONTRADICTED not in codes_of(result["load_by_width_n"].reasons)


def test_load_near_a_contradiction_widens_errors() -> None:
    # The wheel carries 5000 N: three standard errors more, less than three of load, pressure and radius together.
    setup = replace(wheel(4850.0), load_std_n=48.5, radius_std_m=0.001)
    result = last(simulated("", 8.0, setup, ESTIMATORS)[0])
    for name in ("Bs", "Cw", "Rs", "load_by_width_n", "pressure_number"):
        assert result[name].status is Status.VALID, result[name]
        assert result[name].std > 0.013 * result[name].value
    assert EstimateCode.WIDTH_DISAGREES in codes_of(result["Cw"].reasons)


def test_assumed_load_is_not_compared_with_the_width() -> None:
    """Without a stated load 4000 N are assumed, which a load of 4100 N nearly contradicts."""
    near, far = (last(simulated("", 8.0, wheel(None), ESTIMATORS, f"load_n = {load_n}")[0]) for load_n in (4100, 5000))
    result = near["load_by_width_n"]
    assert EstimateCode.WIDTH_DISAGREES not in codes_of(result.reasons)
    assert result.std / result.value == pytest.approx(
        far["load_by_width_n"].std / far["load_by_width_n"].value, rel=0.2
    )


def test_load_by_angle_is_corrected_for_wear() -> None:
    result = last(simulated("[tire]\nwear_mm = 5", 14.0, wheel(None, CALIBRATED), ESTIMATORS)[0])
    by_angle = result["load_by_angle_n"]
    (softer,) = (reason for reason in by_angle.reasons if reason.code is EstimateCode.CORRECTED_FOR_BENDING)
    assert softer["change"] == pytest.approx((10.0 / 15.0) ** 3 - 1.0, abs=0.01)
    assert abs(by_angle.value - 5000.0) < 2.0 * by_angle.std < 1000.0
    assert result["load_n"].value == pytest.approx(5000.0, rel=0.01)
    assert EstimateCode.FROM_BELT_WIDTH in codes_of(result["load_n"].reasons)


def test_unknown_wear_is_in_the_error_of_the_load() -> None:
    results, _ = simulated("[tire]\nwear_mm = 6", 8.0, wheel(None, CALIBRATED), ("kinematic", "load"))
    by_angle = last(results)["load_by_angle_n"]
    assert EstimateCode.WEAR_UNKNOWN in codes_of(by_angle.reasons)
    assert by_angle.value > 1.2 * 5000.0
    assert by_angle.value - 5000.0 < 2.0 * by_angle.std


def test_pressure_number() -> None:
    result = LoadEstimator().update(REVOLUTION, AVERAGE, CONDITIONS)[3]
    half = 0.5 * (REVOLUTION.trailing_edge_rad - REVOLUTION.leading_edge_rad)
    assert result.value == pytest.approx(5000.0 / (2.0 * 210e3 * half * 0.32**2))
    assert result.value == pytest.approx(0.485, rel=0.025)  # physics notes, section 1


def test_stated_load_that_steps_widens_the_pressure_number() -> None:
    tire = replace(NEW, reference=replace(NEW.reference, Cw=None))
    results, truth = simulated(
        "", 8.0, wheel(4000.0, tire), ("kinematic", "load"), "load_n = [[0, 4000], [5, 4000], [5.1, 6000]]"
    )
    relative: list[float] = []
    for result in results[20:]:
        number = {estimate.name: estimate for estimate in result.estimates}["pressure_number"]
        middle_s = result.revolution.start_s + 0.5 * result.revolution.period_s
        leading_rad, trailing_rad = truth.contact_edges_rad(middle_s)
        conditions = result.conditions
        assert conditions.pressure_pa is not None
        scale = conditions.pressure_pa * conditions.radius_m**2
        assert abs(number.value - truth.load_n(middle_s) / (scale * (trailing_rad - leading_rad))) < 3.5 * number.std
        relative.append(number.std / number.value)
    # Before the step the error is that of the stated load and pressure.
    assert relative[0] < 0.15 < 0.2 < relative[-1]


def test_load_that_the_contact_angle_disagrees_with_widens_the_pressure_number() -> None:
    # Without the width of the new tire, which would contradict it.
    tire = replace(CALIBRATED, reference=replace(NEW.reference, Cw=None))
    conditions = replace(CONDITIONS, load_n=None, tire=tire, given={})
    angle = LoadEstimator().update(REVOLUTION, AVERAGE, conditions)[1]
    relative: list[float] = []
    for errors in (0.0, 2.5):
        stated = replace(conditions, load_n=angle.value + errors * angle.std)
        number = LoadEstimator().update(REVOLUTION, AVERAGE, stated)[3]
        assert number.status is Status.VALID
        relative.append(number.std / number.value)
    by_load = disagreement_std(2.5 * angle.std, angle.std) / (angle.value + 2.5 * angle.std)
    assert relative[1] == pytest.approx(math.hypot(relative[0], by_load))


@pytest.mark.parametrize(
    ("conditions", "code"),
    [
        (TireConditions(0.32), EstimateCode.NEEDS_PRESSURE),
        (TireConditions(0.32, pressure_pa=210e3), EstimateCode.NEEDS_LOAD_CALIBRATION),
        (TireConditions(0.32, pressure_pa=210e3), EstimateCode.NEEDS_REFERENCE_NUMBER),
        (
            TireConditions(0.32, pressure_pa=2e5, tire=TireData(reference=ReferenceNumbers(Cw=0.2, estimator="magic"))),
            EstimateCode.UNKNOWN_ESTIMATOR,
        ),
    ],
)
def test_missing_load_inputs_are_reported(conditions: TireConditions, code: Code) -> None:
    result = LoadEstimator().update(REVOLUTION, AVERAGE, conditions)[0]
    assert result.status is Status.INVALID
    assert code in codes_of(result.reasons)


def test_calibration_outside_its_range_is_provisional() -> None:
    narrow = replace(CALIBRATION, half_angle_range_rad=(0.3, 0.4))
    conditions = replace(CONDITIONS, tire=replace(NEW, load_calibration=narrow), given={})
    result = LoadEstimator().update(REVOLUTION, AVERAGE, conditions)[1]
    assert result.status is Status.PROVISIONAL
    assert codes_of(result.reasons) == (
        EstimateCode.HALF_ANGLE_OUTSIDE_CALIBRATION,
        EstimateCode.WEAR_UNKNOWN,
        EstimateCode.TEMPERATURE_NOT_COMPENSATED,
    )


@pytest.mark.parametrize("factor", [1.0, 1.3])
def test_loads_that_disagree_include_their_difference(factor: float) -> None:
    """A calibration of another tread gives 1.3 times the load, and nothing says which of both loads is right."""
    plain, _ = simulated("", 14.0, wheel(None, replace(CALIBRATED, wear_m=0.0)), ESTIMATORS)
    calibration = replace(CALIBRATION, load_n=CALIBRATION.load_n * factor)
    results, _ = simulated(
        "", 14.0, wheel(None, replace(CALIBRATED, wear_m=0.0, load_calibration=calibration)), ESTIMATORS
    )
    before, after = last(plain), last(results)
    loads = [after[name] for name in ("load_by_angle_n", "load_by_width_n", "load_n")]
    assert {load.status for load in loads} == {Status.VALID}
    for load in loads:
        assert abs(load.value - 5000.0) < 3.0 * load.std
        assert (EstimateCode.LOADS_DISAGREE in codes_of(load.reasons)) == (factor > 1.0)
    # Two right loads agree: their errors hardly grow.
    assert factor > 1.0 or after["load_n"].std == before["load_n"].std < 0.04 * 5000.0


@pytest.mark.parametrize("share", [0.7, 1.3])
def test_load_by_width_is_not_behind_a_step_of_the_load(share: float) -> None:
    stated = replace(wheel(4500.0), load_std_n=25.0, radius_std_m=0.0032, pressure_relative_std=0.005)
    loads = f"load_n = [[0, 4500], [6, 4500], [6.01, {4500 * share}]]"
    results, _ = simulated("", 8.0, stated, ESTIMATORS, loads)
    before = [last((result,))["load_by_width_n"] for result in results if result.revolution.start_s < 5.8]
    assert before[-1].std < 0.03 * before[-1].value
    # The simulated load changes within a quarter of a second, the edges within a revolution or two.
    after = [result for result in results if result.revolution.start_s > 6.4]
    assert len(after) > 10
    for result in after:
        load = last((result,))["load_by_width_n"]
        assert load.status is not Status.VALID or abs(load.value - 4500.0 * share) < 3.0 * load.std
