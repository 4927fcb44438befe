"""A wheel that turns: its rate, and ply steer corrected after straights, widened where only a steady turn was seen."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from independent_tire.driving import MARGIN, OVERSAMPLED, Course, DrivenTire
from independent_tire.sideways import Sides
from independent_tire.steady import roll_steadily
from independent_tire.tires import TIRES

from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.results import RevolutionResult
from gateway.core.quantity import Basis
from gateway.core.quantity_catalogue import quantity_of
from gateway.core.reasons import codes_of
from gateway.forces.lateral_belt import LateralBelt
from gateway.forces.ply_steer import AHEAD_NAME, LINE_NAME, NAMES
from gateway.forces.reasons import ForceCode
from gateway.forces.turning import NAMES as TURNING_NAMES
from gateway.forces.turning import TurningEstimator
from gateway.ring.turning_wheel import HubMotion, turning_acceleration
from tests.testkit.revolution_data import settled
from tools.generators.lateral_signals import RADIUS_M, Sensor, disturbed, lateral, radial, samples, through_pipeline

SPEED_MPS = 65.0 / 3.6
SENSOR = Sensor(noise_mg=5.0, road_mps2=0.5, seed=3)
STEADY = roll_steadily(replace(TIRES[1], elements=240, friction=0.8, slip_scale=0.04), 4000.0)
SIDES = Sides(1.6e6, 1e3, 2.5e5, 8e6, 1.0, coupling_m=1.2e-3)
PLY_STEER = (AHEAD_NAME, LINE_NAME, NAMES[0])


@cache
def estimates(
    turn_radps: float, camber_radps: float, straights: int, slip_deg: float = 0.0, after: int = 0
) -> dict[str, Estimate]:
    """Return the estimates after straights, 60 revolutions of a turn and straights `after` it."""
    return {each.name: each for each in driven(turn_radps, camber_radps, straights, slip_deg, after)[-1].estimates}


@cache
def driven(
    turn_radps: float, camber_radps: float, straights: int, slip_deg: float, after: int = 0
) -> list[RevolutionResult]:
    ring = radial()
    straight, turned = lateral(ring), lateral(ring, LateralBelt(), math.radians(slip_deg))
    parts = [part for part in ((straights, straight), (60, turned), (after, straight)) if part[0]]
    values = samples(ring, parts, SENSOR)
    omega = SPEED_MPS / RADIUS_M
    phase = omega * np.arange(len(values)) / SENSOR.rate_hz - 0.7 * math.pi
    moves = (phase > math.pi * (2.0 * straights - 1.0)) & (
        phase < math.pi * (2.0 * (straights + 60 + 2 * (not after)) - 1.0)
    )
    motion = HubMotion(turn_radps=turn_radps, camber_radps=camber_radps, left_mps2=SPEED_MPS * turn_radps)
    values += moves[:, np.newaxis] * turning_acceleration(phase, omega, RADIUS_M, motion)
    values[:, 1] += moves * SPEED_MPS * turn_radps
    return through_pipeline(values, SENSOR, ["ply-steer", "turning"])


@pytest.mark.parametrize("name", PLY_STEER)
@pytest.mark.parametrize("straights", [0, 60])
@pytest.mark.parametrize(
    ("turn_radps", "camber_radps"), [(0.1, 0.0), (-0.1, 0.0), (0.3, 0.0), (0.0, 0.05), (0.0, -0.08)]
)
def test_turn_is_within_the_errors_of_ply_steer(
    name: str, straights: int, turn_radps: float, camber_radps: float
) -> None:
    straight, turned = estimates(0.0, 0.0, straights)[name], estimates(turn_radps, camber_radps, straights)[name]
    if turned.status is Status.VALID:
        # A turn without side force from the first revolution on is an unusual tire nearly as well.
        assert abs(turned.value - straight.value) < (2.5 if straights else 3.5) * turned.std


@pytest.mark.parametrize(("turn_radps", "camber_radps"), [(0.3, 0.0), (0.0, 0.05)])
def test_turn_after_straights_is_removed(turn_radps: float, camber_radps: float) -> None:
    straight, turned = estimates(0.0, 0.0, 60), estimates(turn_radps, camber_radps, 60)
    for name in PLY_STEER:
        assert turned[name].status is Status.VALID
        assert math.degrees(turned[name].value - straight[name].value) == pytest.approx(0.0, abs=0.015)


def test_turn_of_a_whole_recording_widens_the_errors() -> None:
    straight, turned = estimates(0.0, 0.0, 0)[AHEAD_NAME], estimates(0.1, 0.0, 0)[AHEAD_NAME]
    assert straight.std < math.radians(0.02)
    assert turned.std > 1.8 * straight.std


@pytest.mark.parametrize(("turn_radps", "slip_deg"), [(0.3, 0.8), (-0.1, -0.3)])
def test_turn_rate_after_straights_is_that_of_the_wheel(turn_radps: float, slip_deg: float) -> None:
    turned = estimates(turn_radps, 0.0, 60, slip_deg)
    rate, radius, acceleration = (turned[name] for name in (TURNING_NAMES[0], TURNING_NAMES[1], TURNING_NAMES[3]))
    # A straight and then a curve, or a curve and then a straight: one curve does not show which.
    assert rate.status is radius.status is Status.PROVISIONAL
    assert codes_of(rate.reasons)[0] is ForceCode.STRAIGHT_NOT_SHOWN
    assert rate.value == pytest.approx(turn_radps, abs=min(2.5 * rate.std, 0.05))
    assert radius.value == pytest.approx(SPEED_MPS / rate.value, rel=1e-3)
    assert acceleration.value == pytest.approx(SPEED_MPS * rate.value, rel=1e-3)


def test_turn_rate_is_valid_after_a_whole_curve() -> None:
    after = estimates(0.3, 0.0, 60, 0.8, after=30)
    rate = after["turn_rate_radps"]
    assert rate.status is after["lateral_acceleration_mps2"].status is Status.VALID
    assert rate.value == pytest.approx(0.0, abs=3.0 * rate.std)
    assert rate.std < 0.01
    assert after["curve_radius_m"].status is Status.INVALID


def test_few_revolutions_are_no_straight() -> None:
    rate = estimates(0.3, 0.0, 60, 0.8, after=6)["turn_rate_radps"]
    assert rate.status is Status.PROVISIONAL
    assert codes_of(rate.reasons)[0] is ForceCode.STRAIGHT_NOT_SHOWN


def test_camber_rate_after_straights_is_that_of_the_wheel() -> None:
    camber = estimates(0.0, 0.05, 60)["camber_rate_radps"]
    assert camber.value == pytest.approx(0.05, abs=min(2.5 * camber.std, 0.01))


def test_rates_of_a_slalom_have_no_part_of_the_slip_that_changes() -> None:
    step = 1.0 / (SENSOR.rate_hz * OVERSAMPLED)
    time = step * np.arange(round(18.0 / step) + 2 * MARGIN)
    inside, none = np.clip(time - 4.0, 0.0, 1.0), 0.0 * time
    slip = math.radians(1.2) * inside * np.sin(2.0 * (time - 4.0))
    heading = np.cumsum(0.12 * inside * np.sin(2.0 * (time - 4.0))) * step
    course = Course(step, SPEED_MPS + none, heading, slip, none, none, none)
    felt, _, yaw = DrivenTire(STEADY, SIDES, np.radians([-2.0, -1.0, 0.0, 1.0, 2.0]), 4e-3).felt(course, 0.0)
    turns, cambers = [], []
    for result in through_pipeline(disturbed(felt, SENSOR), SENSOR, ["turning"], load_n=4000.0)[-60:]:
        rates = {estimate.name: estimate.value for estimate in result.estimates}
        begin = round(result.revolution.start_s * SENSOR.rate_hz)
        turns.append(rates["turn_rate_radps"] - yaw[begin : begin + round(result.revolution.period_s * 9600.0)].mean())
        cambers.append(rates["camber_rate_radps"])
    # The slip changes by 0.03 rad/s rms, which looks like a camber rate of 0.02 rad/s.
    assert np.sqrt(np.mean(np.square(turns))) < 0.02
    assert np.sqrt(np.mean(np.square(cambers))) < 0.01


def pulls(
    seconds: float, changes_s: dict[float, float], turn_radps: float, slip_deg: float, camber_deg: float = 0.0
) -> dict[str, list[float]]:
    """Return errors over standard errors of valid turn and camber rates, where a share of a turn changes at times."""
    step = 1.0 / (SENSOR.rate_hz * OVERSAMPLED)
    time = step * np.arange(round(seconds / step) + 2 * MARGIN)
    share, none = 0.0 * time, 0.0 * time
    for at_s, change in changes_s.items():
        share += change * (0.5 - 0.5 * np.cos(math.pi * np.clip((time - at_s) / 0.7, 0.0, 1.0)))
    heading, camber = np.cumsum(turn_radps * share) * step, math.radians(camber_deg) * share
    course = Course(step, SPEED_MPS + none, heading, math.radians(slip_deg) * share, camber, none, none)
    felt, _, yaw = DrivenTire(STEADY, SIDES, np.radians([-2.0, -1.0, 0.0, 1.0, 2.0]), 4e-3).felt(course, 0.0)
    truths = {"turn_rate_radps": yaw, "camber_rate_radps": np.gradient(camber, step)[MARGIN::OVERSAMPLED]}
    errors: dict[str, list[float]] = {name: [] for name in truths}
    for result in through_pipeline(disturbed(felt, SENSOR), SENSOR, ["turning"], load_n=4000.0):
        begin = round(result.revolution.start_s * SENSOR.rate_hz)
        during = slice(begin, begin + round(result.revolution.period_s * SENSOR.rate_hz))
        for estimate in result.estimates:
            if estimate.status is Status.VALID and estimate.name in truths and len(yaw[during]):
                truth = truths[estimate.name][during].mean()
                errors[estimate.name].append((estimate.value - truth) / estimate.std)
    return errors


def test_rates_are_within_their_errors_where_a_curve_begins_and_ends() -> None:
    errors = pulls(26.0, {4.0: 1.0, 8.0: -1.0, 13.0: -1.0, 17.0: 1.0, 21.0: 1.0}, 0.17, 1.6, 1.0)
    assert min(len(each) for each in errors.values()) > 100
    assert max(np.max(np.abs(each)) for each in errors.values()) < 3.5


@pytest.mark.parametrize(("turn_radps", "slip_deg", "least"), [(0.09, 0.8, 200), (0.04, 0.3, 0)])
def test_a_curve_that_a_recording_begins_in_is_no_straight(turn_radps: float, slip_deg: float, least: int) -> None:
    errors = pulls(40.0, {-1.0: -1.0, 6.0: 1.0, 13.0: 1.0, 17.0: -1.0, 23.0: -1.0, 29.0: 1.0}, turn_radps, slip_deg)
    assert len(errors["turn_rate_radps"]) >= least
    assert np.max(np.abs(errors["turn_rate_radps"]), initial=0.0) < 3.5


@pytest.mark.parametrize(
    ("turn_radps", "camber_radps", "names"),
    [(0.3, 0.0, (*TURNING_NAMES[:2], TURNING_NAMES[3])), (0.0, 0.05, TURNING_NAMES[2:3])],
)
def test_a_wrong_radius_or_rate_changes_the_turn_as_declared_and_as_its_error_says(
    turn_radps: float, camber_radps: float, names: tuple[str, ...]
) -> None:
    results = driven(turn_radps, camber_radps, 60, 0.0)
    average = settled(results[0].revolution)

    def last(radius: float = 1.0, rate: float = 1.0, radius_std_m: float = 0.0) -> dict[str, Estimate]:
        estimator, estimates = TurningEstimator(), ()
        for result in results:
            of = result.revolution
            conditions = replace(result.conditions, radius_m=radius * RADIUS_M, radius_std_m=radius_std_m)
            revolution = replace(
                of, omega_radps=rate * of.omega_radps, period_s=of.period_s / rate, omega_dot_radps2=0.0
            )
            estimates = estimator.update(revolution, average, conditions)
        return {estimate.name: estimate for estimate in estimates}

    right, unsure = last(), last(radius_std_m=0.02 * RADIUS_M)
    wrong = {Basis.RADIUS: last(radius=1.02), Basis.RATE: last(rate=1.02)}
    for name in names:
        value, powers = right[name].value, quantity_of(name).powers
        for basis, estimates in wrong.items():
            power = math.log(estimates[name].value / value) / math.log(1.02)
            assert power == pytest.approx(powers.get(basis, 0.0), abs=0.05), (name, basis)
        by_radius = math.sqrt(unsure[name].std ** 2 - right[name].std ** 2)
        assert by_radius == pytest.approx(0.02 * abs(powers.get(Basis.RADIUS, 0.0) * value), abs=1e-9), name


def test_straight_driving_has_no_radius() -> None:
    straight = estimates(0.0, 0.0, 60)
    assert abs(straight["turn_rate_radps"].value) < straight["turn_rate_radps"].std
    assert straight["turn_rate_radps"].std < 0.01
    assert straight["curve_radius_m"].status is Status.INVALID


def test_sensor_roll_does_not_contain_the_lateral_acceleration() -> None:
    straight, turned = estimates(0.0, 0.0, 60)["sensor_roll_rad"], estimates(0.3, 0.0, 60)["sensor_roll_rad"]
    assert turned.value == pytest.approx(straight.value, abs=0.3 * straight.std)
