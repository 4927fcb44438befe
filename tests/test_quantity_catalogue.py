"""One declaration of every quantity, and what follows from it."""

from __future__ import annotations

import importlib
import math

import pytest

from gateway.estimators.estimator import Estimate, Status
from gateway.estimators.registry import ESTIMATORS
from gateway.estimators.signal_evidence import Contradiction, Subject
from gateway.quantity_catalogue import CATALOGUE, Basis, quantity_of, rests_on_times_alone
from gateway.reasons import Code, Reason

RATE = Contradiction(Subject.STEADY, Reason(Code.NO_SINGLE_CAUSE), {Basis.RATE: 2.0})
LOST_STEADY_VALUE = Contradiction(Subject.COUPLING, Reason(Code.NO_STEADY_VALUE), {Basis.COUPLING: math.nan})


def test_every_estimator_declares_its_quantities_once() -> None:
    assert list(CATALOGUE) == list(ESTIMATORS)
    for estimator, quantities in CATALOGUE.items():
        names = [quantity.name for quantity in quantities]
        assert len(set(names)) == len(names), estimator
        module = importlib.import_module(ESTIMATORS[estimator].split(":")[0])
        assert set(getattr(module, "NAMES", ())) <= set(names), estimator


def test_a_name_has_one_meaning() -> None:
    for quantities in CATALOGUE.values():
        for quantity in quantities:
            assert quantity_of(quantity.name) == quantity
            assert quantity_of(f"some-estimator:{quantity.name}") == quantity
            least, greatest = quantity.possible
            assert least < greatest
            assert quantity.description


def test_what_is_not_declared_rests_on_the_whole_signal() -> None:
    assert quantity_of("of_a_plug_in_mps2").rests_on == {Basis.SAMPLES, Basis.WAVEFORM, Basis.COUPLING}


def test_only_the_distance_rests_on_times_alone() -> None:
    assert [name for name in CATALOGUE if rests_on_times_alone(name)] == ["distance"]
    assert not rests_on_times_alone("of-a-plug-in")


@pytest.mark.parametrize(
    ("name", "value", "effect"),
    [
        ("angular_speed_radps", 12.6, 1.0),
        ("rotation_rpm", 120.0, 1.0),
        ("cavity_temperature_degc", 20.0, 3.0),
        ("belt_shift_m", 2e-3, 0.75),
        ("belt_yaw_rad", 0.01, 0.75),
        ("side_force_n", 900.0, 0.75),
        ("aligning_moment_nm", 20.0, 0.75),
        ("ply_steer_peak_rad", 3e-3, 0.75),
        ("leading_edge_rad", -0.2, 0.0),
        ("ply_steer_laminate_rad", 3e-3, 0.0),
    ],
)
def test_a_wrong_rate_reaches_all_that_rests_on_it(name: str, value: float, effect: float) -> None:
    assert RATE.effect_on(Estimate(name, value, 1e-6, Status.VALID)) == pytest.approx(effect)


@pytest.mark.parametrize("name", ["cavity_hz", "cavity_temperature_degc", "cavity_gas_ratio", "water_wedge_rad"])
def test_a_high_pass_leaves_lines_and_edges(name: str) -> None:
    assert LOST_STEADY_VALUE.effect_on(Estimate(name, 1.0, 0.1, Status.VALID)) == 0.0


@pytest.mark.parametrize("name", ["load_by_width_n", "pressure_number", "wear_drift_mm", "side_force_n"])
def test_an_old_pressure_reaches_all_that_rests_on_it(name: str) -> None:
    assert Basis.PRESSURE in quantity_of(name).rests_on
