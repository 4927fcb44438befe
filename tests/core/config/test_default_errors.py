"""What is stated without a standard error has that of such a value, and `doctor` says which."""

from pathlib import Path

import pytest

from gateway.bench.commands.doctor_checks import check_config
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.estimates.estimator import Status
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.ring_quantities import RING_NUMBERS
from tests.testkit.simulated_wheel import last, simulated

WHEEL = '[[wheel]]\nposition = "FL"\nhub = 0\nwheel = 0\nload_n = {load}\n'
TIRE = "[tire]\nradius_mm = 320\nradius_std_mm = 1\npressure_kpa = 210\n"
REFERENCE = "[tire.reference]\nBs = 3.08e-3\nCw = 0.195\nRs = 2.97\nTs = 2.53\nCw_std = 0.002\npressure_kpa = 210\n"
ESTIMATORS = ("kinematic", "weak-form", "load")


def setup_of(load: float, *, reference: bool = False, more: str = ""):
    text = TIRE + (REFERENCE if reference else "") + WHEEL.format(load=load) + more
    return parse_vehicle(text, "test").wheel_setups()[0]


def test_load_and_pressure_without_an_error_have_one() -> None:
    setup = setup_of(5000.0)
    assert setup.load_std_n == pytest.approx(500.0)
    assert (setup.pressure_std_pa, setup.pressure_relative_std) == (0.0, 0.05)
    assert setup_of(5000.0, more="load_std_n = 0.0\n").load_std_n == 0.0
    stated = parse_vehicle(TIRE + "pressure_std_kpa = 2\n" + WHEEL.format(load=5000.0), "test").wheel_setups()[0]
    assert (stated.pressure_std_pa, stated.pressure_relative_std) == (2e3, 0.0)


@pytest.mark.parametrize("load", [4000.0, 5000.0, 6000.0])
def test_numbers_of_a_wrong_load_are_true_within_its_default_error(load: float) -> None:
    results, truth = simulated("", 6.0, setup_of(load), ESTIMATORS)
    numbers, result = truth.numbers(1.0), last(results)
    for name in RING_NUMBERS:
        assert result[name].status is Status.VALID
        assert result[name].std > 0.1 * result[name].value
        assert abs(result[name].value - getattr(numbers, name)) < 2.5 * result[name].std


def test_width_of_the_new_tire_caps_the_error() -> None:
    result = last(simulated("", 6.0, setup_of(5000.0, reference=True), ESTIMATORS)[0])
    assert EstimateCode.SCALE_BY_WIDTH in [reason.code for reason in result["Cw"].reasons]
    for name in ("Bs", "Cw", "Rs"):
        assert result[name].std < 0.05 * result[name].value
    # The load by the width rests on pressure and radius, which the width does not know apart.
    assert 0.05 * 5000.0 < result["load_by_width_n"].std < 0.07 * 5000.0
    assert abs(result["load_by_width_n"].value - 5000.0) < 2.0 * result["load_by_width_n"].std


def test_doctor_lists_errors_that_are_assumed(tmp_path: Path) -> None:
    path = tmp_path / "car.toml"
    path.write_text(TIRE + WHEEL.format(load=5000.0), encoding="utf-8")
    (line,) = [check.text for check in check_config(path) if "assumed" in check.text]
    assert "10 % of the load (FL)" in line
    assert "5 % of the pressure (FL)" in line
    assert "0.01 % of the sampling rate (FL)" in line
    assert "radius" not in line
