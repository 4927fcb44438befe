"""Faulty sensors: effect on the estimates, and one notice at the faulty wheel only."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from firmware_protocol.messages import Axis, Environment
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.estimates.estimator import Status
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.results import Alarm, RevolutionResult
from gateway.core.reasons import Code, Notice, Reason, codes_of
from gateway.core.session.core import SessionCore
from gateway.core.session.reasons import SessionCode
from gateway.core.text.wording import notice_text
from gateway.core.trust.reasons import TrustCode
from gateway.core.trust.sensor_health import SensorHealth, expected_pressure_change_pa, tilt_rad
from gateway.core.wheels.reasons import WheelCode
from gateway.importing.import_map import load_map
from gateway.importing.importer import import_file
from tests.reliability.streams import simulated
from tools.reliability.sensors import SCENARIO

ROOT = Path(__file__).parents[2]
SPEED_MPS = 65.0 / 3.6
HALF_ANGLE_RAD = 0.2383


@dataclass(frozen=True)
class Ride:
    results: list[RevolutionResult]
    notices: list[Notice]
    alarms: tuple[Alarm, ...]

    def of(self, position: str) -> list[RevolutionResult]:
        return [result for result in self.results if result.position == position]

    def last(self, name: str, position: str = "W1"):
        return next(estimate for estimate in self.of(position)[-1].estimates if estimate.name == name)

    def flags(self, position: str = "W1") -> set[str]:
        return {alarm.name for alarm in self.alarms if alarm.position == position}


@pytest.fixture(scope="module")
def ride(tmp_path_factory) -> Callable[..., Ride]:
    def run(faulty: str = "", duration: float = 7.0, change: Callable[[str], str] = lambda toml: toml) -> Ride:
        path = tmp_path_factory.mktemp("ride") / "s.toml"
        path.write_text(SCENARIO.format(duration=duration, faulty=faulty))
        items, toml = simulated(f"sim:{path}?speed=max")
        core = SessionCore(parse_vehicle(change(toml), "s"))
        results: list[RevolutionResult] = []
        for number, item in enumerate(items):
            results += core.take(item)
            if number % 20 == 0:
                core.tick(item.host_ns)
        alarms = core.snapshot(0.0).alarms
        results += core.finish()
        notices = [notice for notice in core.take_notices() if notice.subject in ("W1", "W2")]
        return Ride(results, notices, alarms)

    return run


@pytest.fixture(scope="module")
def good(ride) -> Ride:
    return ride()


def test_good_sensors_are_not_flagged(good: Ride) -> None:
    assert good.notices == []
    assert good.flags("W1") == good.flags("W2") == set()
    assert good.last("speed_mps").value == pytest.approx(SPEED_MPS, rel=1e-3)
    assert good.last("trailing_edge_rad").value == pytest.approx(HALF_ANGLE_RAD, abs=0.004)


@pytest.mark.parametrize(
    ("faulty", "flag"),
    [
        ("defect = {dead_from_s = 4}", "dead"),
        ("defect = {stuck_from_s = 4}", "stuck"),
        ('defect = {stuck_from_s = 4, axes = ["radial"]}', "stuck"),
        ('defect = {dead_from_s = 4, axes = ["radial"]}', "stuck"),
    ],
)
def test_dead_sensor_gives_no_more_revolutions(ride, good: Ride, faulty: str, flag: str) -> None:
    broken = ride(faulty)
    assert broken.flags() & {"dead", "stuck"} == {flag}
    assert broken.flags("W2") == set()
    assert len(broken.notices) == 1
    revolutions = broken.of("W1")
    until_s = revolutions[0].revolution.start_s + 4.0
    assert max(result.revolution.start_s + result.revolution.period_s for result in revolutions) < until_s + 0.3
    for estimate in revolutions[-1].estimates:
        if estimate.name == "speed_mps" and estimate.status is Status.VALID:
            assert estimate.value == pytest.approx(SPEED_MPS, rel=0.01)
    assert len(broken.of("W2")) == len(good.of("W2"))


@pytest.mark.parametrize(
    ("faulty", "fault"),
    [("sensor = {range_g = 60}", EstimateCode.RADIAL_SATURATED), ("defect = {clip_g = 60}", WheelCode.RADIAL_CLIPPED)],
)
def test_saturated_sensor_gives_no_valid_estimate(ride, faulty: str, fault: Code) -> None:
    clipped = ride(faulty)
    assert len(clipped.of("W1")) > 45
    for result in clipped.of("W1"):
        assert Reason(fault) in result.revolution.faults
        # Whole turns are counted whatever the amplitude.
        valid = {estimate.name for estimate in result.estimates if estimate.status is Status.VALID}
        assert valid <= {"distance_m"}
    assert ("saturated" in clipped.flags()) == ("range_g" in faulty)
    assert clipped.last("speed_mps").value == pytest.approx(SPEED_MPS, rel=1e-3)
    assert {result.revolution.faults for result in clipped.of("W2")} == {()}


@pytest.mark.parametrize("hertz", [200, 300])
def test_loose_sensor_is_flagged_with_larger_errors(ride, good: Ride, hertz: int) -> None:
    loose = ride(f"defect = {{loose_hz = {hertz}}}")
    assert loose.flags() == {"loose"}
    assert loose.flags("W2") == set()
    (notice,) = loose.notices
    assert f"{hertz} Hz" in notice_text(notice)
    assert loose.last("speed_mps").value == pytest.approx(SPEED_MPS, rel=2e-3)
    for name in ("Bs", "Cw", "Rs", "Ts", "contact_length_m"):
        assert good.last(name).status is Status.VALID
        assert loose.last(name).status is not Status.VALID
        assert TrustCode.SENSOR_LOOSE in codes_of(loose.last(name).reasons)


@pytest.mark.parametrize(("axis", "name"), [("roll_deg", "lateral"), ("pitch_deg", "circumferential")])
def test_tilted_sensor_is_flagged_and_measures_speed(ride, axis: str, name: str) -> None:
    tilted = ride(f"sensor = {{{axis} = 30}}")
    (notice,) = [notice for notice in tilted.notices if notice.reason["alarm"].code is TrustCode.SENSOR_TILTED]
    assert f"the {name} axis" in notice_text(notice)
    assert "tilted by 30 deg" in notice_text(notice)
    assert tilted.flags() == {"mounting", "steady value"}
    assert tilted.last("speed_mps").value == pytest.approx(SPEED_MPS, rel=1e-3)
    if axis == "roll_deg":
        assert tilted.last("sensor_roll_rad").value == pytest.approx(math.radians(30), abs=0.01)


def test_swapped_axes_give_a_reason_only(ride) -> None:
    swapped = ride("sensor = {roll_deg = 90}")
    assert swapped.of("W1") == []
    assert "tilted by 90 deg, or its axes are swapped" in notice_text(swapped.notices[0])
    assert len(swapped.of("W2")) > 45


def test_outward_radial_axis_is_inverted_and_reported(ride) -> None:
    reversed_ = ride("sensor = {radial_sign = -1, sign_declared = false}")
    assert "points outward" in notice_text(reversed_.notices[0])
    assert reversed_.last("speed_mps").value == pytest.approx(SPEED_MPS, rel=1e-3)
    assert reversed_.last("trailing_edge_rad").value == pytest.approx(HALF_ANGLE_RAD, abs=0.004)


def test_swapped_wheels(ride) -> None:
    def swap(toml: str) -> str:
        return toml.replace("0000a001", "X").replace("0000a002", "0000a001").replace("X", "0000a002")

    swapped = ride(change=swap)
    assert swapped.flags("W1") == swapped.flags("W2") == {"wrong sensor"}
    assert swapped.notices[0].reason["alarm"] == Reason(
        SessionCode.OTHER_SENSOR, how="swapped", sensor="0000a001", owner="W2", position="W1"
    )
    assert len(swapped.notices) == 2
    assert swapped.last("speed_mps").value == pytest.approx(SPEED_MPS, rel=1e-3)


def test_unknown_sensor_is_reported(ride) -> None:
    renewed = ride(change=lambda toml: toml.replace("0000a001", "0000beef"))
    assert renewed.flags() == {"wrong sensor"}
    assert renewed.notices[0].reason["alarm"] == Reason(
        SessionCode.OTHER_SENSOR, how="replaced", sensor="0000a001", expected="0000beef"
    )


def test_frozen_pressure_widens_dependent_errors(ride) -> None:
    frozen = ride("defect = {pressure_stuck_from_s = 2}\ntemperature_degc = [[0, 20], [20, 45]]", duration=20.0)
    assert frozen.flags() == {"pressure frozen"}
    (notice,) = frozen.notices
    assert notice.reason["alarm"].code is TrustCode.PRESSURE_FROZEN
    conditions = frozen.of("W1")[-1].conditions
    assert conditions.pressure_std_pa == pytest.approx(expected_pressure_change_pa(210e3, 20.0, 45.0), rel=0.1)
    assert frozen.of("W2")[-1].conditions.pressure_std_pa < 5000.0
    widened, sharp = frozen.last("Cw"), frozen.last("Cw", "W2")
    # The width of the new tire knows load, pressure and radius together, whatever the pressure reads.
    assert widened.std > sharp.std
    assert abs(widened.value - sharp.value) < 3 * widened.std


def test_pressure_following_temperature_is_not_frozen() -> None:
    health = SensorHealth((2,), np.ones(1), np.zeros(1), 9600.0, is_dc=True)
    for warmer in range(60):
        error = health.environment(Environment(210e3 + 1000.0 * (warmer // 3), 20.0 + warmer / 3, 3.0))
        assert error == 0.0
    assert health.flags() == ()


def test_standstill_is_not_a_fault() -> None:
    rng = np.random.default_rng(1)
    health = SensorHealth((0, 1, 2), np.full(3, 0.15), np.zeros(3), 9600.0, is_dc=True)
    for _ in range(50):
        health.samples(np.rint(rng.normal([0, 0, 65], 2.0, (960, 3))).astype(np.int16))
    assert health.flags() == ()


@pytest.mark.parametrize("angle_deg", [-170, -40, 0, 10, 19, 21, 45, 120])
def test_tilt_is_reported_from_20_degrees(angle_deg: float) -> None:
    angle = math.radians(angle_deg)
    result = tilt_rad(np.array([0.0, 1000.0 * math.sin(angle), 1000.0 * math.cos(angle)]))
    folded = min(abs(angle_deg), 180 - abs(angle_deg))
    if folded < 20:
        assert result is None
    else:
        assert result is not None
        assert result[0] is Axis.LATERAL
        assert math.degrees(result[1]) == pytest.approx(folded)


def test_measured_tire_shows_no_ringing(tmp_path: Path) -> None:
    measured = ROOT / ".." / "shared" / "measured" / "innerliner_drum_80kmh.csv"
    if not measured.exists():
        pytest.skip(f"the measured recording is not at {measured}")
    target = tmp_path / "drum.mcap"
    import_file(measured, load_map(ROOT / "examples" / "innerliner_drum_80kmh.map.toml"), target)
    items, toml = simulated(f"replay:{target}?speed=max")
    core = SessionCore(parse_vehicle(toml, "drum"))
    revolutions = [result.revolution for item in items for result in core.take(item)]
    revolutions += [result.revolution for result in core.finish()]
    health = SensorHealth((2,), np.ones(1), np.zeros(1), 25600.0, is_dc=True)
    health.revolutions(revolutions * 4)  # five revolutions are too few to decide
    assert len(revolutions) == 5
    assert health.flags() == ()
