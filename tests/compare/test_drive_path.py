"""Path of a car by its wheels: a lap of which the samples are positions differentiated twice, and its errors."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from gateway.compare.views.drive import Drive
from gateway.compare.views.drive_page import drive_page
from gateway.compare.views.drive_path import MAX_LEGS, CarPath, WheelPath, car_path
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.results import RevolutionResult
from gateway.forces.lateral_belt import LateralBelt
from tools.generators.lateral_signals import RADIUS_M, Sensor, lateral, radial, samples, through_pipeline

SPEED_MPS, RATE_HZ, LAP_M = 65.0 / 3.6, 4800.0, 2000.0


def lap_yaw(time_s: np.ndarray, length_m: float = LAP_M) -> np.ndarray:
    """Return the yaw rate of a lap that closes: two equal halves of a straight and a turn of 180 degrees."""
    half_s = 0.5 * length_m / SPEED_MPS
    within = np.mod(time_s, half_s) / half_s
    # A quarter of each half is straight; the curve begins and ends within a tenth.
    shape = np.interp(within, [0.0, 0.3, 0.4, 0.9, 1.0], [0.0, 0.0, 1.0, 1.0, 0.0])
    return math.pi / (0.6 * half_s) * shape


def added_by_turning(time_s: np.ndarray, yaw: np.ndarray, phase: np.ndarray, side_m: np.ndarray) -> np.ndarray:
    """Return what a turning hub adds to the axes of a sensor: positions differentiated twice, turning less straight."""
    step = time_s[1] - time_s[0]
    heading = np.concatenate([[0.0], np.cumsum(0.5 * (yaw[1:] + yaw[:-1])) * step])
    hubs = [np.exp(1j * angle) * SPEED_MPS for angle in (heading, 0.0 * heading)]
    accelerations = []
    for velocity, angle in zip(hubs, (heading, 0.0 * heading), strict=True):
        hub = np.concatenate([[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1])) * step])
        flat = hub + (-RADIUS_M * np.sin(phase) + 1j * side_m) * np.exp(1j * angle)
        read = np.zeros(len(flat), complex)
        read[1:-1] = (flat[2:] - 2.0 * flat[1:-1] + flat[:-2]) / step**2
        accelerations.append(read * np.exp(-1j * angle))
    added = accelerations[0] - accelerations[1]
    return np.stack([-np.cos(phase) * added.real, added.imag, np.sin(phase) * added.real], axis=1)


@cache
def lap(seed: int, side: float) -> tuple[RevolutionResult, ...]:
    """Return the revolutions of a wheel on a lap of 2 km."""
    ring = radial()
    sensor = Sensor(rate_hz=RATE_HZ, noise_mg=5.0, road_mps2=0.5, roll_rad=0.01 * seed, seed=seed)
    omega = SPEED_MPS / RADIUS_M
    count = round(LAP_M / SPEED_MPS * omega / math.tau)
    middles = (np.arange(count) + 0.5) * math.tau / omega
    load_kg = 5000.0 / STANDARD_GRAVITY_MPS2
    forces = [lateral(ring, LateralBelt(), angle).side_force_n for angle in (0.0, math.radians(0.5))]
    per_force = math.radians(0.5) / (forces[1] - forces[0])
    slips = np.round(np.degrees(load_kg * SPEED_MPS * side * lap_yaw(middles) * per_force), 1)
    begins = np.flatnonzero(np.diff(slips, prepend=math.nan))
    counts = np.diff([*begins.tolist(), count]).tolist()
    shapes = [lateral(ring, LateralBelt(), math.radians(float(slips[begin]))) for begin in begins]
    values = samples(ring, list(zip(counts, shapes, strict=True)), sensor)
    time_s = np.arange(len(values)) / RATE_HZ
    phase = omega * time_s - 0.7 * math.pi
    wrapped = np.mod(phase + math.pi, math.tau) - math.pi
    theta = np.append(ring.theta_rad, math.pi)
    # The belt's own lateral place differs little: that of the straight stands for all.
    orders = np.fft.rfft(shapes[0].lateral_m)
    numbers = np.arange(len(orders))
    place_m = np.fft.irfft(np.where(numbers > 0, -orders / np.maximum(numbers, 1) ** 2, 0.0), len(ring.theta_rad))
    lateral_m = CubicSpline(theta, np.append(place_m, place_m[0]), bc_type="periodic")(wrapped)
    values += added_by_turning(time_s, side * lap_yaw(time_s), phase, lateral_m)
    return tuple(through_pipeline(values, sensor, ["kinematic", "distance", "turning"]))


def path_of(results: tuple[RevolutionResult, ...]) -> CarPath:
    wheel = WheelPath()
    for result in results:
        wheel.add(result, round((result.revolution.start_s + result.revolution.period_s) * 1e9))
    path = car_path({"FL": wheel})
    assert path is not None
    return path


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "side"), [(1, 1.0), (3, 1.0), (4, -1.0), (5, -1.0)])
def test_lap_of_2_km_closes_within_its_ellipse(seed: int, side: float) -> None:
    path = path_of(lap(seed, side))
    end = path.position_m[-1]
    assert path.length_m == pytest.approx(LAP_M, rel=0.005)
    assert not path.is_lost
    # 99 % of a normal distribution of two numbers; the ellipse is no excuse for any end.
    assert end @ np.linalg.solve(path.covariance_m2[-1], end) < 9.2
    assert path.ellipse(-1)[0] < 0.2 * LAP_M


def driven(
    made, counts: int, *, turn: float, shared: float = 0.0, random: float = 0.0, fixes: bool = False, stop: int = 0
):
    """Return revolutions of 2 m in 0.1 s; from one of them on after a gap of 5 s in which the wheel rolled 100 m."""
    results = []
    for index in range(counts):
        rate = Estimate("turn_rate_radps", turn, math.hypot(shared, random), Status.VALID, (), random)
        late = bool(stop) and index >= stop
        rolled = Estimate("distance_m", 2.0 * (index + 1) + 100.0 * late, 3.0 if late else 0.0, Status.VALID)
        estimates = [Estimate("speed_mps", 20.0, 0.0, Status.VALID), rate, rolled]
        if fixes:
            north = math.degrees(2.0 * index / 6_371_000.0)
            estimates += [Estimate("latitude_deg", 60.0 + north, 1e-5, Status.VALID)]
            estimates += [Estimate("longitude_deg", -180.0, 1e-5, Status.VALID)]
        result = made.result(index=index, estimates=tuple(estimates))
        start_s = 0.1 * index + 5.0 * late
        results.append(replace(result, revolution=replace(result.revolution, start_s=start_s, period_s=0.1)))
    return tuple(results)


def test_path_of_a_steady_turn_is_a_circle_however_many_revolutions_are_joined(made) -> None:
    for count in (50, MAX_LEGS + 7, 5 * MAX_LEGS + 3):
        path = path_of(driven(made, count, turn=0.2, random=0.01, shared=0.002))
        radius, angle = 100.0, 0.02 * count
        end = radius * np.array([math.sin(angle), 1.0 - math.cos(angle)])
        np.testing.assert_allclose(path.position_m[-1], end, atol=1e-6)
        assert len(path.position_m) <= MAX_LEGS


def test_errors_of_a_straight_are_those_of_its_random_paths(made) -> None:
    count, random = 200, 0.05
    path = path_of(driven(made, count, turn=0.0, random=random))
    headings = np.cumsum(np.random.default_rng(1).normal(0.0, 0.1 * random, (4000, count)), axis=1)
    aside = 2.0 * headings.sum(axis=1).std()
    assert path.ellipse(-1)[0] == pytest.approx(aside, rel=0.05)


def test_gap_is_bridged_by_the_distance_and_widens_the_ellipse(made) -> None:
    whole, gap = (path_of(driven(made, 100, turn=0.0, random=0.001, stop=stop)) for stop in (0, 50))
    assert gap.position_m[-1, 0] - whole.position_m[-1, 0] == pytest.approx(100.0, abs=0.5)
    assert gap.ellipse(-1)[0] > 20.0 * whole.ellipse(-1)[0]
    assert path_of(driven(made, 400, turn=0.0, random=0.001, shared=0.1)).is_lost


def test_receiver_is_turned_to_the_path(made) -> None:
    path = path_of(driven(made, 50, turn=0.0, fixes=True))
    assert path.apart_m < 0.05
    np.testing.assert_allclose(path.received_m[-1] - path.received_m[0], [98.0, 0.0], atol=0.1)


def with_receiver(results: tuple[RevolutionResult, ...], speed_mps: float, yaw, side: float, mirror: float = 1.0):
    """Return revolutions of a lap with positions of a receiver, as data sheets state them; the car starts at N 40 E."""
    step_s = 1e-3
    time_s = np.arange(0.0, results[-1].revolution.start_s + 1.0, step_s)
    heading = math.radians(-40.0) + np.cumsum(side * yaw(time_s)) * step_s
    way = np.cumsum(np.exp(1j * heading)) * speed_mps * step_s
    rng = np.random.default_rng(7)
    off = rng.normal(0.0, 2.1, 2)
    fixed = []
    for result in results:
        off = 0.99 * off + math.sqrt(1.0 - 0.99**2) * rng.normal(0.0, 2.1, 2)
        point = way[round((result.revolution.start_s + result.revolution.period_s) / step_s)]
        latitude = 60.0 + math.degrees((point.real + off[0]) / 6_371_000.0)
        # The left of north is the west.
        longitude = 11.0 + math.degrees((off[1] - mirror * point.imag) / 6_371_000.0) / math.cos(math.radians(60.0))
        named = (("latitude_deg", latitude), ("longitude_deg", longitude))
        estimates = tuple(Estimate(name, value, 2e-5, Status.VALID) for name, value in named)
        fixed.append(replace(result, estimates=(*result.estimates, *estimates)))
    return tuple(fixed)


def assert_receiver_is_within_the_ellipses(path: CarPath) -> None:
    # It has a position at the end of each leg, and the path begins before the first.
    away = path.received_m - path.position_m[1:]
    errors = path.covariance_m2[1:] + 2.0 * 2.1**2 * np.eye(2)
    assert (np.einsum("ni,nij,nj->n", away, np.linalg.inv(errors), away) < 9.2).all()


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_receiver_and_wheels_draw_the_same_lap_within_its_ellipses(made, side: float) -> None:
    rng, length_m = np.random.default_rng(3), 22.0 * SPEED_MPS
    results = []
    for result in driven(made, 220, turn=0.0, shared=0.01, random=0.02):
        speed, turn, rolled = result.estimates
        true = side * float(lap_yaw(np.array([result.revolution.start_s + 0.05]), length_m)[0])
        off = 0.01 + rng.normal(0.0, 0.02)
        results.append(replace(result, estimates=(speed, turn._replace(value=true + off), rolled)))

    def drawn(mirror: float) -> CarPath:
        return path_of(with_receiver(tuple(results), 20.0, lambda time_s: lap_yaw(time_s, length_m), side, mirror))

    path = drawn(1.0)
    assert 2.0 < path.apart_m < 12.0
    assert_receiver_is_within_the_ellipses(path)
    # In the same metres: its steps are as long as those of the wheels.
    lengths = [np.hypot(*np.diff(points[::20], axis=0).T).sum() for points in (path.received_m, path.position_m[1:])]
    assert lengths[0] == pytest.approx(lengths[1], rel=0.05)
    # A lap to the other side fits nowhere.
    assert drawn(-1.0).apart_m > 3.0 * path.apart_m


@pytest.mark.slow
def test_receiver_is_within_the_ellipses_of_a_lap_of_2_km() -> None:
    path = path_of(with_receiver(lap(1, 1.0), SPEED_MPS, lap_yaw, 1.0))
    assert_receiver_is_within_the_ellipses(path)


def test_page_draws_the_path_or_says_that_there_is_no_turn_rate(made) -> None:
    drive = Drive("a.mcap")
    drive.add(made.result())
    assert "No path: no wheel has both speed and turn rate." in drive_page([drive])
    for result in driven(made, 30, turn=0.1, random=0.01, fixes=True):
        drive.add(result)
    page = drive_page([drive])
    assert '<polyline class="car" points="' in page
    assert '<polyline class="received" points=""' not in page
    assert "The receiver&#39;s positions are" in page
    assert "Dashed: the receiver, moved and turned to fit." in page
    assert "No path" not in page
