"""What a sensor will measure: refusals, doubts and errors by simulated drives."""

import json
import math
from functools import cache

import numpy as np
import pytest

from firmware_protocol.codec import encode_frame
from firmware_protocol.messages import Frame, MessageType, SampleBlock
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.errors import ConfigError
from gateway.core.reasons import Code
from gateway.core.text.wording import text
from gateway.core.trust.reasons import TrustCode
from gateway.planner.accelerometer import Accelerometer, parse_accelerometers, shipped_accelerometers
from gateway.planner.link_load import BLOCK_SAMPLES, PowerModel, link_load
from gateway.planner.planned_errors import SensorPlan, plan_sensor
from gateway.planner.reasons import PlannerCode
from gateway.planner.views.sensor_plan import plan_json, plan_lines
from gateway.simulator.scenario import load_scenario
from tests.testkit.commands import invoked

QUIET = Accelerometer(name="quiet", range_g=500.0, rate_hz=4000.0, noise_mg_rthz=1.0)


@cache
def planned(sensor: Accelerometer, speed_kmh: float = 80.0, wheels: int = 4) -> SensorPlan:
    return plan_sensor(load_scenario("lab"), sensor, speed_kmh / 3.6, wheels=wheels)


def codes(sensor: Accelerometer, speed_kmh: float = 80.0) -> list[Code]:
    return [reason.code for reason in planned(sensor, speed_kmh).reasons]


def scatter(result: SensorPlan, quantity: str, revolutions: int) -> float:
    return next(e.scatter for e in result.errors if (e.quantity, e.revolutions) == (quantity, revolutions))


def test_noise_grows_the_scatter_and_revolutions_reduce_it():
    quiet, noisy = planned(QUIET), planned(QUIET.model_copy(update={"noise_mg_rthz": 20.0}))
    assert quiet.usable
    assert noisy.usable
    assert scatter(noisy, "Cw", 10) > 5.0 * scatter(quiet, "Cw", 10)
    assert scatter(noisy, "Cw", 100) < 0.6 * scatter(noisy, "Cw", 10)
    assert {e.quantity for e in quiet.errors} >= {"speed_mps", "contact_length_m", "wear_mm", "load_by_width_n", "Ts"}


def test_ac_corner_is_undone_and_its_tolerance_named():
    # Not undone, it would move Ts by more than a tenth.
    sensor = QUIET.model_copy(update={"highpass_hz": 6.0})
    assert TrustCode.SENSOR_AC_CORNER in codes(sensor)
    assert abs(stays(sensor, "Ts")) < 0.05 * 2.53


def stays(sensor: Accelerometer, quantity: str, wheels: int = 4) -> float:
    errors = planned(sensor, wheels=wheels).errors
    return next(e.stays for e in errors if (e.quantity, e.revolutions) == (quantity, 100))


def test_clock_of_the_sensor_is_seen_by_the_stamps():
    off = QUIET.model_copy(update={"rate_error_percent": 0.2})
    # Taken for nominal, it would move the speed by 0.2 %. It is measured after two seconds, which averages keep.
    assert abs(stays(off, "speed_mps")) < 5e-4 * 80.0 / 3.6
    assert scatter(planned(off), "Cw", 100) > 1.3 * scatter(planned(QUIET), "Cw", 100)


def test_cross_axis_sensitivity_biases_by_its_sign():
    # The drives have the same noise, so that the difference is the axis that leaks.
    plain, *crossed = (
        stays(QUIET.model_copy(update={"cross_axis_percent": percent}), "Ts", wheels=2) for percent in (0.0, 5.0, -5.0)
    )
    biases = [each - plain for each in crossed]
    assert abs(biases[0]) > 0.02
    assert biases[1] == pytest.approx(-biases[0], rel=0.2)


def test_gain_and_zero_of_the_data_sheet_are_in_the_stated_errors():
    loose = QUIET.model_copy(update={"gain_error_percent": 10.0, "zero_g_offset_g": 2.0})
    late = [error for error in planned(loose).errors if error.revolutions == 100]
    assert {error.quantity for error in late} == {error.quantity for error in planned(QUIET).errors}
    assert all(error.valid_share == 1.0 and abs(error.stays) < 2.0 * error.stated for error in late)
    assert codes(loose) == []


def test_what_the_estimators_refuse_is_named():
    scenario = load_scenario("lab")
    (first, *_) = scenario.wheels()
    wrong = first.model_copy(update={"stated": first.stated.model_copy(update={"radius_mm": 360.0})})
    plan = plan_sensor(scenario.model_copy(update={"wheel": (wrong,)}), QUIET, 80.0 / 3.6, wheels=3)
    assert (TrustCode.WOULD_FIT, "radius") in [inner.kind for reason in plan.reasons for inner in reason]


@pytest.mark.parametrize(
    ("changed", "code"),
    [
        ({"range_g": 100.0}, PlannerCode.PLAN_RANGE),
        ({"survival_g": 100.0}, PlannerCode.PLAN_SURVIVAL),
        ({"rate_hz": 1000.0}, PlannerCode.PLAN_RATE),
        ({"rate_hz": None}, PlannerCode.PLAN_MISSING),
        ({"noise_mg_rthz": None}, PlannerCode.PLAN_MISSING),
    ],
)
def test_refusals_are_named_and_have_no_errors(changed, code):
    sensor = QUIET.model_copy(update=changed)
    assert code in codes(sensor)
    assert not planned(sensor).usable
    assert planned(sensor).errors == ()


@pytest.mark.parametrize(
    ("changed", "code"),
    [
        ({"bandwidth_hz": 500.0}, TrustCode.SENSOR_BAND),
        ({"resolution_mg": 400.0}, TrustCode.SENSOR_STEPS),
    ],
)
def test_doubts_leave_the_sensor_usable(changed, code):
    sensor = QUIET.model_copy(update=changed)
    assert code in codes(sensor)
    assert planned(sensor).usable


def test_shipped_list_has_sources_and_no_guessed_noise():
    parts = shipped_accelerometers().sensor
    assert len(parts) >= 12
    assert all(part.source for part in parts)
    assert len({part.name for part in parts}) == len(parts)


def test_shipped_parts_that_can_be_planned_have_their_steps_and_others_say_what_is_missing():
    parts = shipped_accelerometers().sensor
    complete = [part for part in parts if not part.missing()]
    assert {part.name for part in complete} >= {"ADXL372", "ADXL375", "LSM6DSV320X high-g"}
    assert all(part.resolution_mg is not None or part.interface == "analog" for part in complete)
    unknown = next(part for part in parts if part.name == "ADXL1004")
    (reason,) = planned(unknown, 100.0).reasons
    assert text(reason) == "its data sheet does not state noise: state it with --sensors"


def test_fault_of_a_list_names_the_key():
    with pytest.raises(ConfigError, match="range_g"):
        parse_accelerometers('[[sensor]]\nname = "x"\nrange_g = -1.0\n', "parts.toml")


def test_command_prints_and_writes_what_is_refused(tmp_path):
    out = tmp_path / "plan.json"
    done = invoked("plan", "lab", "--sensor", "H3LIS331DL", "--speed", "60", "--json", out)
    assert done.exit_code == 1
    assert "not usable" in done.output
    assert "1000 samples per second" in done.output
    (entry,) = json.loads(out.read_text())
    assert entry["reasons"][0]["code"] == "plan_rate"


def test_bound_lies_below_the_scatter_and_scales_with_the_noise():
    noisy = QUIET.model_copy(update={"noise_mg_rthz": 20.0})
    bounds = [
        {(e.quantity, e.revolutions): e.bound for e in planned(sensor).errors if math.isfinite(e.bound)}
        for sensor in (noisy, noisy.model_copy(update={"noise_mg_rthz": 40.0}))
    ]
    assert {name for name, _ in bounds[0]} >= {"speed_mps", "contact_length_m", "wear_mm", "Ts/Cw"}
    for (name, count), bound in bounds[0].items():
        # The scatter of four drives is known to a third.
        assert bounds[1][name, count] == pytest.approx(2.0 * bound, rel=0.01)
        assert scatter(planned(noisy), name, count) > 0.3 * bound


def test_fastest_speed_is_where_the_range_ends():
    plan = planned(QUIET)
    square_ratio = (QUIET.range_g - 1.0) / (plan.peak_mps2 / STANDARD_GRAVITY_MPS2 - 1.0)
    limit_kmh = 3.6 * plan.speed_mps * math.sqrt(square_ratio)
    assert PlannerCode.PLAN_RANGE not in codes(QUIET, 0.995 * limit_kmh)
    assert PlannerCode.PLAN_RANGE in codes(QUIET, 1.005 * limit_kmh)


POWER = PowerModel(radio_kbps=700.0, radio_ma=6.0, controller_ma=1.0, battery_mah=210.0)


def test_link_carries_the_frames_of_the_wire():
    counts = np.zeros((BLOCK_SAMPLES, 1), np.int16)
    frame = encode_frame(Frame(MessageType.SAMPLES, 0, 0, 0, 0, SampleBlock(0, 0b100, counts)))
    assert link_load(3600.0, None, None).data_kbps == pytest.approx(8e-3 * len(frame) * 3600.0 / BLOCK_SAMPLES)


def test_battery_lasts_by_the_currents_and_the_radio_share():
    load = link_load(3600.0, 0.5, POWER)
    assert load.radio_share == pytest.approx(load.data_kbps / 700.0)
    assert load.battery_h == pytest.approx(210.0 / (1.5 + 6.0 * load.radio_share))
    assert math.isnan(link_load(3600.0, None, POWER).battery_h)
    overloaded = link_load(50_000.0, 0.5, POWER)
    assert overloaded.radio_share > 1.0
    assert math.isnan(overloaded.battery_h)


def test_lines_say_what_the_link_and_the_battery_do():
    sensor = QUIET.model_copy(update={"noise_mg_rthz": None})
    text = "\n".join(plan_lines(planned(sensor), POWER))
    assert "87 kbit/s, radio on 12 % of the time, battery: the sensor's current is unknown" in text
    slow = POWER.model_copy(update={"radio_kbps": 50.0})
    assert "more than the 50 kbit/s of the radio" in "\n".join(plan_lines(planned(sensor), slow))
    fed = planned(sensor.model_copy(update={"current_ma": 0.5}))
    assert "93.5 h from 210 mAh" in "\n".join(plan_lines(fed, POWER))
    (row,) = json.loads(plan_json([fed], POWER))
    assert row["battery_h"] == pytest.approx(93.5, abs=0.1)
