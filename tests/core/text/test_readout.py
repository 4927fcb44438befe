import dataclasses
import math

import pytest

from gateway.console.wheel_panel import shown_numbers
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.reasons import CoreCode, Reason
from gateway.core.text.numbers import MISSING, show
from gateway.core.text.readout import read_result
from gateway.core.text.wording import text
from gateway.papers.reasons import PaperCode
from gateway.ring.reasons import RingCode

LINEAR = Reason(PaperCode.LINEAR_RING)
FEW = Reason(CoreCode.NOT_SETTLED, revolutions=3.0, needed=8.0)
AT_ZERO = Reason(RingCode.FIT_AT_ZERO, number="Rs")
SATURATED = Reason(EstimateCode.RADIAL_SATURATED)


def test_numbers_are_shown_without_ratios(made):
    reading = read_result(made.result())
    assert [number.label for number in reading.numbers] == ["Bs", "Cw", "Rs", "Ts"]
    assert reading.status is Status.VALID
    assert reading.note == ""
    assert [estimate.name for estimate in reading.further] == ["contact_length_m"]
    assert reading.speed.text() == "65.000 ± 0.022 km/h"
    assert reading.leading.text() == "-13.740 ± 0.097 deg"
    assert reading.trailing.text() == "13.51 ± 0.10 deg"


def test_shift_of_an_edge_is_not_taken_for_the_edge(made):
    shift = Estimate("leading_edge_shift_rad", 0.01, 0.001, Status.VALID)
    result = made.result()
    reading = read_result(dataclasses.replace(result, estimates=(*result.estimates, shift)))
    assert reading.leading.text() == "-13.740 ± 0.097 deg"
    assert shift in reading.further


def test_other_quantities_are_rounded_when_asked_for(made, monkeypatch):
    shown = []
    for module in ("core.text.readout", "console.wheel_panel"):
        monkeypatch.setattr(f"gateway.{module}.show", lambda e: shown.append(e.name) or show(e))
    wheel = made.wheel("FL")
    reading = read_result(wheel.last)
    assert "contact_length_m" not in shown
    assert "contact" in {number.label for number in shown_numbers(wheel, reading)}
    assert "contact_length_m" in shown


@pytest.mark.parametrize("first", ["peak", "adhesion_line"])
def test_first_of_the_ply_steer_angles_is_the_one_shown_live(made, first):
    names = sorted(["peak", "first_half", "adhesion_line", "contact_line"], key=lambda name: name != first)
    angles = [Estimate(f"ply_steer_{name}_rad", 0.001 * len(name), 1e-4, Status.VALID) for name in names]
    details = [Estimate("sensor_roll_rad", 0.01, 1e-3, Status.VALID), Estimate("speed_age_s", 1.0, 0.0, Status.VALID)]
    wheel = made.wheel("FL", result={"estimates": (*made.result().estimates, *angles, *details)})
    numbers = [(shown.label, shown.value) for shown in shown_numbers(wheel, read_result(wheel.last))]
    assert ("ply steer", pytest.approx(math.degrees(angles[0].value))) in numbers
    labels = [label for label, _ in numbers]
    assert labels.count("ply steer") == 1
    assert not {"sensor roll", "speed age"} & set(labels)


def test_ratios_are_shown_without_a_load(made):
    reading = read_result(made.result(load_n=None))
    assert [number.label for number in reading.numbers] == ["Bs/Cw", "Rs/Cw", "Ts/Cw"]
    assert reading.ratios_only
    assert reading.status is Status.VALID
    assert reading.note == f"ratios only: {text(made.needs_load)}"


def test_reasons_are_those_of_the_worst_status(made):
    estimates = (
        Estimate("Bs", 3e-3, 1e-4, Status.VALID, (LINEAR,)),
        Estimate("Cw", 0.2, 0.01, Status.PROVISIONAL, (FEW,)),
        Estimate.invalid("Rs", AT_ZERO),
    )
    reading = read_result(made.result(estimates=estimates))
    assert reading.status is Status.INVALID
    assert reading.reasons == (AT_ZERO,)
    assert read_result(made.result(estimates=estimates[:2])).reasons == (FEW,)
    assert read_result(made.result(estimates=estimates[:1])).reasons == (LINEAR,)


def test_faults_come_before_other_reasons(made):
    faults = (Reason(EstimateCode.SAMPLES_LOST), Reason(EstimateCode.RADIAL_SATURATED))
    reading = read_result(made.result(status=Status.INVALID, reasons=(AT_ZERO,), faults=faults))
    assert reading.reasons == faults
    assert reading.note == f"{text(faults[0])}; {text(faults[1])}"


def test_reasons_of_speed_and_angles_are_shown(made):
    result = made.result()
    estimates = (Estimate("speed_mps", 18.0, 0.1, Status.PROVISIONAL, (SATURATED,)), *result.estimates[1:])
    assert read_result(dataclasses.replace(result, estimates=estimates)).reasons == (SATURATED,)


@pytest.mark.parametrize("status", [Status.VALID, Status.PROVISIONAL])
def test_status_is_that_of_the_speed_where_no_estimator_of_numbers_runs(made, status):
    reasons = () if status is Status.VALID else (SATURATED,)
    speed, turn = (
        Estimate("speed_mps", 18.0, 0.1, status, reasons),
        Estimate("turn_rate_radps", 0.1, 0.01, Status.VALID),
    )
    reading = read_result(made.result(estimates=(speed, turn)))
    assert reading.status is status
    assert "no estimates" not in reading.note
    assert reading.further == (turn,)


def test_revolution_is_shown_without_estimates(made):
    reading = read_result(made.result(estimates=()))
    assert reading.speed.text() == "65.00 km/h"
    assert reading.leading.text() == "-13.740 ± 0.097 deg"
    assert reading.status is Status.INVALID
    assert reading.note == "no estimates"
    result = made.result(estimates=())
    blind = dataclasses.replace(
        result, revolution=dataclasses.replace(result.revolution, trailing_edge_rad=math.nan, omega_radps=math.nan)
    )
    assert read_result(blind).trailing.number.joined() == MISSING
    assert read_result(blind).speed.number.joined() == MISSING


def test_rotation_and_distance_are_read(made):
    measured = made.result()
    rolled = Estimate("distance_m", 1234.5, 12.0, Status.VALID)
    reading = read_result(dataclasses.replace(measured, estimates=(*measured.estimates, rolled)))
    assert reading.distance.text() == "1234 ± 12 m"
    # Without an estimate of it, the rotation is the revolution's own.
    assert reading.rotation.value == pytest.approx(measured.revolution.omega_radps * 30.0 / math.pi)
    assert reading.rotation.unit == "rpm"
    assert read_result(measured).distance is None
