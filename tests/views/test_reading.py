import dataclasses
import math

from gateway.estimators.base import Estimate, Status
from gateway.views.numbers import MISSING
from gateway.views.readout import read_result


def test_numbers_are_shown_and_their_ratios_are_not(made):
    reading = read_result(made.result())
    assert [number.label for number in reading.numbers] == ["Bs", "Cw", "Rs", "Ts"]
    assert reading.status is Status.VALID
    assert reading.note == ""
    assert [other.label for other in reading.others] == ["contact length"]
    assert reading.speed.text() == "65.000 ± 0.022 km/h"
    assert reading.leading.text() == "-13.740 ± 0.097 deg"
    assert reading.trailing.text() == "13.51 ± 0.10 deg"


def test_ratios_stand_in_when_the_load_is_missing(made):
    reading = read_result(made.result(load_n=None))
    assert [number.label for number in reading.numbers] == ["Bs/Cw", "Rs/Cw", "Ts/Cw"]
    assert reading.ratios_only
    assert reading.status is Status.VALID
    assert reading.note == f"ratios only: {made.needs_load}"


def test_worst_status_and_its_reason_win(made):
    estimates = (
        Estimate("Bs", 3e-3, 1e-4, Status.VALID, "linear ring"),
        Estimate("Cw", 0.2, 0.01, Status.PROVISIONAL, "few revolutions"),
        Estimate("Rs", math.nan, math.nan, Status.INVALID, "the fit puts it at zero"),
    )
    reading = read_result(made.result(estimates=estimates))
    assert reading.status is Status.INVALID
    assert reading.note == "the fit puts it at zero"
    assert read_result(made.result(estimates=estimates[:2])).note == "few revolutions"
    assert read_result(made.result(estimates=estimates[:1])).note == "linear ring"


def test_fault_of_the_revolution_comes_first(made):
    result = made.result(status=Status.INVALID, reason="no contact", faults=("one frame lost", "saturated"))
    assert read_result(result).note == "one frame lost; saturated"


def test_reason_of_the_angles_is_told_when_the_numbers_have_none(made):
    result = made.result()
    estimates = (Estimate("speed_mps", 18.0, 0.1, Status.PROVISIONAL, "sensor saturated"), *result.estimates[1:])
    assert read_result(dataclasses.replace(result, estimates=estimates)).note == "sensor saturated"


def test_without_estimates_the_revolution_speaks(made):
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
