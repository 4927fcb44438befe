"""Distance, road class and cavity of simulated wheels, whose truth the estimators do not share."""

import math
from dataclasses import replace

import numpy as np
import pytest

from firmware_protocol.decoder import FrameDecoder
from gateway.core.config.validation import parse_document
from gateway.core.config.vehicle import Tire
from gateway.core.estimates.distance import DistanceEstimator
from gateway.core.estimates.estimator import Estimate, Status, TireConditions
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.results import RevolutionResult
from gateway.core.estimates.tire_data import TireData
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.core.reasons import Reason, codes_of
from gateway.core.revolutions.angle_resampling import angle_grid
from gateway.core.trust.reasons import TrustCode
from gateway.core.wheels.tire_estimates import _Series
from gateway.core.wheels.wheels import Pipeline
from gateway.forces.cavity import CavityEstimator
from gateway.forces.reasons import ForceCode
from gateway.forces.road_roughness import RoadRoughnessEstimator, class_letter
from gateway.forces.rolling_spectrum import SPECTRUM_S, RollingSpectrum
from gateway.simulator.road_profile import QuarterCar, RoadProfile, RoadRide, roughness_m3
from gateway.simulator.scenario_model import Scenario
from gateway.simulator.simulation import simulate
from tests.testkit.exact_ring import RADIUS_M, solution
from tests.testkit.revolution_data import CONDITIONS, exact_wave, make_revolution, settled
from tests.testkit.simulated_wheel import last, simulated

# A cheap sensor: the fewer samples, the faster the test.
SENSOR = '[sensor]\naxes = ["radial"]\nrate_hz = 3000\nnoise_mg_rthz = 5\n'
SETUP = WheelSetup("FL", 0, 0, 0.32, load_n=5000.0, pressure_pa=210e3)
REVOLUTION = make_revolution(exact_wave(solution()))
AVERAGE = settled(REVOLUTION)
CAR = QuarterCar(470.0, 40.0, 25e3, 1500.0, 229e3, 0.15)


def driven(tables: str, seconds: float, estimator: str, wheel: str = "", setup: WheelSetup = SETUP) -> RevolutionResult:
    return simulated(f"[motion]\nspeed_kmh = 65\n{SENSOR}{tables}", seconds, setup, ("kinematic", estimator), wheel)[0]


@pytest.mark.parametrize("letter", ["A", "C"])
def test_road_class_is_found(letter: str) -> None:
    result = last(driven(f"[road]\nprofile = '{letter}'", 9.0, "road"))["road_class"]
    assert result.status is Status.VALID
    assert abs(result.value - (1.0 + "ABCD".index(letter))) < 2.0 * result.std
    assert 0.15 < result.std < 0.45
    assert class_letter(result.value) == result.reasons[0]["letter"] == letter


def test_road_roughness_is_not_determined_on_an_even_road() -> None:
    result = last(driven("[road]\nleading_jitter_mm = 0.8\ntrailing_jitter_mm = 0.8", 9.0, "road"))
    assert result["road_class"].status is Status.INVALID
    assert codes_of(result["road_class"].reasons) == (ForceCode.ROAD_BELOW_NOISE,)
    assert result["road_class"].reasons[0]["letter"] == "A"


def test_road_needs_speed_and_revolutions() -> None:
    estimator = RoadRoughnessEstimator()
    slow = estimator.update(REVOLUTION, AVERAGE, replace(CONDITIONS, radius_m=0.05))
    assert codes_of(slow[0].reasons) == (ForceCode.TOO_SLOW_FOR_ROAD,)
    assert codes_of(estimator.update(REVOLUTION, AVERAGE, CONDITIONS)[0].reasons) == (TrustCode.NEEDS_REVOLUTIONS,)


def road_over_dropout(gap_s: float) -> Estimate:
    """Return the class after 70 revolutions on a rough road, a dropout before the 25th of them."""
    rng, estimator, angles = np.random.default_rng(2), RoadRoughnessEstimator(), angle_grid(len(REVOLUTION.radial_mps2))
    for index in range(70):
        radial = np.interp(angles / (1.0 + rng.normal(0.0, 0.02)), angles, REVOLUTION.radial_mps2)
        start_s = index * REVOLUTION.period_s + gap_s * (index >= 25)
        revolution = replace(REVOLUTION, index=index, start_s=start_s, radial_mps2=radial)
        revolution = replace(revolution, follows=index > 0 and not (gap_s and index == 25))
        result, _ = estimator.update(revolution, AVERAGE, CONDITIONS)
    return result


def test_contacts_before_and_after_a_dropout_are_no_row() -> None:
    whole, interrupted = road_over_dropout(0.0), road_over_dropout(2.0)
    assert interrupted.status is whole.status is Status.VALID
    assert abs(interrupted.value - whole.value) < whole.std


@pytest.mark.parametrize("gap_at", [None, 20])
def test_spectrum_is_of_uninterrupted_rolling(gap_at: int | None) -> None:
    spectrum = RollingSpectrum()
    count = math.ceil(SPECTRUM_S / REVOLUTION.period_s)
    revolutions = (replace(REVOLUTION, index=index, follows=index != gap_at) for index in range(1, count + 1))
    assert any(spectrum.take(revolution, AVERAGE)[0] for revolution in revolutions) is (gap_at is None)


def test_profile_has_the_density_of_its_class() -> None:
    profile = RoadProfile(roughness_m3("B"), 2.0, 0.0, np.random.default_rng(3))
    height = profile(np.arange(1 << 17) * 0.06)
    pieces = height.reshape(32, -1) * np.hanning(4096)
    density = (
        np.square(np.abs(np.fft.rfft(pieces, axis=1))).mean(axis=0) * 2.0 * 0.06 / np.square(np.hanning(4096)).sum()
    )
    frequency = np.fft.rfftfreq(4096, 0.06)
    inside = (frequency > 0.05) & (frequency < 2.0)
    ratio = density[inside] * np.square(frequency[inside] / 0.1) / 64e-6
    assert ratio.mean() == pytest.approx(1.0, abs=0.05)


def test_ride_has_the_load_of_its_quarter_car() -> None:
    profile = RoadProfile(roughness_m3("B"), 2.0, CAR.contact_m, np.random.default_rng(4))
    ride = RoadRide(profile, CAR, 1000.0)
    load, hub = ride(18.0 * np.arange(60_000) / 1000.0)
    expected = CAR.load_std_n(roughness_m3("B"), 2.0, 18.0)
    # The averaging over the contact's length, which the expectation leaves out, is worth some per cent.
    assert load.std() == pytest.approx(expected, rel=0.1)
    # The balance of the unsprung mass: tire force less the strut's, which is small at the wheel hop.
    fast = np.diff(load, 2)
    assert np.corrcoef(fast, np.diff(hub, 2))[0, 1] > 0.95


def test_load_below_the_unsprung_weight_is_rejected() -> None:
    from gateway.core.errors import TreadlinkError

    with pytest.raises((ValueError, TreadlinkError), match="unsprung"):
        driven("[road]\nprofile = 'A'\nunsprung_kg = 600", 1.0, "road")


def air_hz(degc: float, length_m: float) -> float:
    return math.sqrt(1.4 * 287.05 * (273.15 + degc)) / length_m


def in_cavity(hertz: float, length_m: float | None, std_m: float, measured: str = "temperature_degc = 40") -> dict:
    setup = replace(SETUP, tire=TireData(cavity_length_m=length_m, cavity_length_std_m=std_m))
    tables = f"[vibration]\ncavity_rms_mps2 = 6\ncavity_hz = {hertz}"
    return last(driven(tables, 10.0, "cavity", measured, setup))


def test_cavity_gives_the_temperature_of_the_gas() -> None:
    result = in_cavity(air_hz(43.0, 1.65), 1.65, 0.003)
    warm = result["cavity_temperature_degc"]
    assert warm.status is not Status.INVALID
    assert abs(warm.value - 43.0) < 2.0 * warm.std < 12.0
    ratio = result["cavity_gas_ratio"]
    assert abs(ratio.value - 1.0) < 2.0 * ratio.std
    assert ForceCode.CAVITY_CONTRADICTED not in codes_of(ratio.reasons)


def test_other_gas_contradicts_the_temperature() -> None:
    result = in_cavity(air_hz(40.0, 1.65) * math.sqrt(1.4), 1.65, 0.01)
    assert result["cavity_gas_ratio"].value == pytest.approx(1.4, abs=0.08)
    assert result["cavity_gas_ratio"].status is Status.PROVISIONAL
    # Whether it is another gas or the line of a motor, the frequency may not be the cavity's.
    for name in ("cavity_hz", "cavity_temperature_degc", "cavity_gas_ratio"):
        assert result[name].status is Status.PROVISIONAL
        assert result[name].reasons[0].code is ForceCode.CAVITY_CONTRADICTED


def test_unknown_cavity_length_gives_the_frequency_alone() -> None:
    result = in_cavity(214.0, None, 0.0)
    assert result["cavity_hz"].value == pytest.approx(214.0, abs=1.5)
    assert codes_of(result["cavity_temperature_degc"].reasons) == (ForceCode.NEEDS_CAVITY_LENGTH,)


@pytest.mark.parametrize(("size", "inches"), [("205/55 R16", 16.0), ("195R14C", 14.0), ("335/65R22.5", 22.5)])
def test_cavity_length_follows_from_the_rim_of_the_size(size: str, inches: float) -> None:
    tire = Tire(size=size, radius_mm=400.0)
    assert tire.cavity_length_m == pytest.approx(math.pi * (0.394 + 0.0127 * inches))
    assert tire.cavity_length_std_m == pytest.approx(0.02 * tire.cavity_length_m)
    assert Tire(size="unknown", radius_mm=400.0).cavity_length_m is None


def test_cavity_waits_for_uninterrupted_rolling() -> None:
    result = CavityEstimator().update(REVOLUTION, AVERAGE, TireConditions(0.32))
    assert {codes_of(item.reasons) for item in result} == {(ForceCode.NEEDS_UNINTERRUPTED_ROLLING,)}


def during(results: tuple[RevolutionResult, ...], first_s: float, last_s: float) -> list[dict[str, Estimate]]:
    start = results[0].revolution.start_s
    return [
        {estimate.name: estimate for estimate in result.estimates}
        for result in results
        if first_s < result.revolution.start_s - start < last_s
    ]


TURN_M = 2.0 * math.pi * RADIUS_M


def rolled(starts_s: list[float], radius_std_m: float = 0.0) -> Estimate:
    estimator = DistanceEstimator()
    conditions = replace(CONDITIONS, radius_std_m=radius_std_m)
    for start_s in starts_s:
        (result,) = estimator.update(replace(REVOLUTION, start_s=start_s), AVERAGE, conditions)
    return result


def test_distance_is_one_circumference_a_turn() -> None:
    result = rolled([k * REVOLUTION.period_s for k in range(10)], radius_std_m=0.01 * RADIUS_M)
    assert result.value == pytest.approx(10.0 * TURN_M)
    assert result.std == pytest.approx(0.1 * TURN_M)
    assert result.status is Status.VALID


def test_short_gap_counts_whole_turns() -> None:
    result = rolled([k * REVOLUTION.period_s for k in (0, 1, 4.02, 5.02)])
    assert result.value == pytest.approx(6.0 * TURN_M)
    assert result.status is Status.VALID
    assert result.std == 0.0


def test_long_gap_is_bridged_with_its_error() -> None:
    period = REVOLUTION.period_s
    result = rolled([0.0, period, 2.0 * period + 10.0])
    assert result.status is Status.PROVISIONAL
    assert result.value == pytest.approx(3.0 * TURN_M + 10.0 / period * TURN_M)
    # 2 m/s^2 over ten seconds are up to 50 m to either side.
    assert result.std == pytest.approx(50.0 / math.sqrt(3.0))
    (bridged,) = result.reasons
    assert bridged["duration_s"] == pytest.approx(10.0)


@pytest.mark.parametrize("gap_s", [3.0, 8.0, 15.0, 30.0])
def test_error_of_a_bridged_distance_covers_a_brisk_drive_wherever_it_is_silent(gap_s: float) -> None:
    # Up to 3 m/s^2 between 30 and 100 km/h, again and again.
    time_s = np.arange(0.0, 120.0, 0.01)
    speed_mps = np.interp(time_s % 30.0, [0, 4, 9, 14, 19, 26, 29, 30], [11.1, 18, 18, 27.8, 27.8, 8.3, 8.3, 11.1])
    distance_m = np.concatenate([[0.0], np.cumsum(0.01 * speed_mps)])
    pulls = []
    for begin_s in np.arange(0.0, 30.0, 0.5):
        ends = [round(100.0 * at_s) for at_s in (begin_s, begin_s + gap_s)]
        first, last = (
            replace(REVOLUTION, omega_radps=speed / RADIUS_M, period_s=TURN_M / speed, start_s=start_s)
            for speed, start_s in zip(
                speed_mps[ends], (begin_s - TURN_M / speed_mps[ends[0]], ends[1] / 100.0), strict=True
            )
        )
        estimator = DistanceEstimator()
        estimator.update(first, AVERAGE, CONDITIONS)
        (result,) = estimator.update(last, AVERAGE, CONDITIONS)
        error_m = result.value - 2.0 * TURN_M - (distance_m[ends[1]] - distance_m[ends[0]])
        pulls.append(error_m / max(result.std, 0.5 * TURN_M))
    assert np.sqrt(np.mean(np.square(pulls))) < 1.2
    assert np.abs(pulls).max() < 3.0


def test_turns_between_contacts_that_were_not_seen_need_not_be_whole() -> None:
    estimator = DistanceEstimator()
    for faults, std in (((), 0.0), ((Reason(EstimateCode.CONTACT_INTERPOLATED),), 0.5 * TURN_M)):
        (result,) = estimator.update(replace(REVOLUTION, turns=2, faults=faults), AVERAGE, CONDITIONS)
        assert result.std == pytest.approx(std)


def test_restarted_hub_time_makes_the_distance_provisional() -> None:
    result = rolled([100.0, 100.0 + REVOLUTION.period_s, 2.0])
    assert codes_of(result.reasons) == (EstimateCode.DISTANCE_INTERRUPTED,)
    assert result.value == pytest.approx(3.0 * TURN_M)


def test_reset_starts_at_zero() -> None:
    estimator = DistanceEstimator()
    estimator.update(REVOLUTION, AVERAGE, CONDITIONS)
    estimator.reset()
    assert estimator.update(REVOLUTION, AVERAGE, CONDITIONS)[0].value == pytest.approx(TURN_M)


def test_unknown_radius_gives_no_distance() -> None:
    (result,) = DistanceEstimator().update(REVOLUTION, AVERAGE, replace(CONDITIONS, radius_m=math.nan))
    assert result.status is Status.INVALID


def test_simulated_distance_over_a_drive() -> None:
    setup = WheelSetup("FL", 0, 0, 0.32, load_n=5000.0, radius_std_m=0.0032)
    tables = "[motion]\nspeed_kmh = [[0, 40], [10, 80], [20, 60]]"
    results, truth = simulated(tables, 20.0, setup, ("kinematic", "distance"))
    result = last(results)
    first, end = results[0].revolution.start_s, results[-1].revolution.start_s + results[-1].revolution.period_s
    shift = truth.hub_s(0.0)
    angles = truth.angle_rad(np.array([first - shift, end - shift]))
    assert result["distance_m"].value == pytest.approx(0.32 * float(angles[1] - angles[0]), rel=1e-4)
    assert result["distance_m"].std == pytest.approx(0.01 * result["distance_m"].value, rel=1e-3)
    omega = truth.omega_radps(0.5 * (results[-1].revolution.start_s + end) - shift)
    assert result["angular_speed_radps"].value == pytest.approx(omega, rel=2e-3)
    assert result["rotation_rpm"].value == pytest.approx(60.0 / results[-1].revolution.period_s, rel=1e-9)


@pytest.mark.parametrize("step_us", [300_000, -100_000, 8000])
def test_step_of_the_hubs_clock_is_neither_distance_nor_speed(step_us: int) -> None:
    text = "[motion]\nspeed_kmh = 80\n[[wheel]]\nposition = 'FL'\nwheel = 0\n"
    simulation, decoder = simulate(parse_document(Scenario, text, "test"), duration_s=8.0), FrameDecoder()
    setup = replace(SETUP, position="FL", radius_m=0.32, radius_std_m=0.0032)
    pipeline, results = Pipeline((setup,), setup, ("kinematic", "distance")), []
    for chunk in simulation.chunks("link", 10**18):
        for frame in decoder.feed(chunk.data):
            stepped = frame._replace(tick_us=frame.tick_us + step_us * (frame.tick_us > 4_000_000))
            results += pipeline.frames("link", (stepped,), chunk.host_ns)
    results += pipeline.finish()
    estimates = [{estimate.name: estimate for estimate in result.estimates} for result in results]
    assert len(results) > 80
    for turns, result in enumerate(estimates, 1):
        assert result["distance_m"].value == pytest.approx(2.0 * math.pi * 0.32 * turns)
        assert abs(result["angular_speed_radps"].value - 80.0 / 3.6 / 0.32) < 4.0 * result["angular_speed_radps"].std


def test_distance_goes_on_where_known_effects_do_not_hold() -> None:
    with_effects = _Series(SETUP, ("kinematic", "distance"))
    without = _Series(SETUP, ("kinematic", "distance"), with_effects)
    shared, separate = (
        [made for made in series.estimators if made.name == "distance"] for series in (with_effects, without)
    )
    assert shared[0] is separate[0]
    assert without.estimators[0] is not with_effects.estimators[0]
