"""One declaration of every quantity, and what follows from it."""

import ast
import dataclasses
import importlib
import math
import re
from collections.abc import Iterator

import pytest

from gateway.core.estimates.estimator import Estimate, Revolution, Status, TireConditions
from gateway.core.estimates.registry import ESTIMATORS
from gateway.core.quantity import Basis
from gateway.core.quantity_catalogue import CATALOGUE, declared, quantity_of, rests_on_times_alone
from gateway.core.reasons import CoreCode, Reason
from gateway.core.recording.revolution_fields import CONDITIONS
from gateway.core.trust.reasons import TrustCode
from gateway.core.trust.signal_evidence import Contradiction, Evidence, Subject
from tests.test_import_rules import dotted, modules

RATE = Contradiction(Subject.STEADY, Reason(TrustCode.NO_SINGLE_CAUSE), {Basis.RATE: 2.0})
LOST_STEADY_VALUE = Contradiction(Subject.COUPLING, Reason(CoreCode.NO_STEADY_VALUE), {Basis.COUPLING: math.nan})


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
            assert quantity.is_stated_too == (quantity.name in CONDITIONS)


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


@pytest.mark.parametrize("basis", [Basis.AXES, Basis.ALONG])
def test_an_axis_that_is_another_leaves_nothing_valid_that_is_read_from_it(basis: Basis) -> None:
    wrong_axis = Contradiction(Subject.AXES, Reason(TrustCode.AXES_SWAPPED), {basis: 0.0})
    names = {
        Basis.AXES: {"turn_rate_radps", "curve_radius_m", "side_force_n", "friction_used"},
        Basis.ALONG: {"road_grade_rad", "pitch_tilt_rad", "sensor_offset_m"},
    }
    evidence = Evidence.of_contradictions((wrong_axis,))
    for other, read in names.items():
        statuses = {evidence.qualified(Estimate(name, 0.05, 1e-3, Status.VALID)).status for name in read}
        assert statuses == {Status.INVALID if other is basis else Status.VALID}


def test_gain_of_the_lateral_axis_changes_the_curve_radius_as_the_turn_rate() -> None:
    gain = Contradiction(Subject.TURN_RATE, Reason(TrustCode.NO_SINGLE_CAUSE), {Basis.AXES: 0.8})
    assert gain.effect_on(Estimate("turn_rate_radps", 0.2, 1e-3, Status.VALID)) == pytest.approx(0.2)
    assert gain.effect_on(Estimate("curve_radius_m", 60.0, 0.3, Status.VALID)) == pytest.approx(0.25)


@pytest.mark.parametrize("name", ["cavity_hz", "cavity_temperature_degc", "cavity_gas_ratio"])
def test_a_high_pass_leaves_lines_and_edges(name: str) -> None:
    assert LOST_STEADY_VALUE.effect_on(Estimate(name, 1.0, 0.1, Status.VALID)) == 0.0


@pytest.mark.parametrize("name", ["load_by_width_n", "pressure_number", "wear_drift_mm", "side_force_n"])
def test_an_old_pressure_reaches_all_that_rests_on_it(name: str) -> None:
    assert Basis.PRESSURE in quantity_of(name).rests_on


# Rooms of estimators.
ESTIMATING = tuple(f"gateway.{room}." for room in ("core.estimates", "core.trust", "forces", "ring", "papers"))
# Modules that may list quantities by name, each with the reason.
LISTS = {
    "gateway.diagnosis.angle.number_estimates": "errors of the closed loop's own grid, by parameter of its ring",
    "gateway.diagnosis.model.tire_state": "parameters of the closed loop's ring that the sidewall gives",
    "gateway.importing.reference_comparison": "estimate that is compared with each channel of a rig",
    "gateway.planner.cramer_rao": "equations of the bound of each quantity",
    "gateway.planner.planned_errors": "true values of a simulated wheel",
}


def is_exempt(module: str) -> bool:
    """Estimators give quantities, and the papers' figures show those of the papers."""
    return module in LISTS or module.startswith(ESTIMATING)


def fields_of_a_revolution() -> set[str]:
    """Return names that are also fields of a revolution or of its conditions, or a column of a recording's row."""
    return {field.name for kind in (Revolution, TireConditions) for field in dataclasses.fields(kind)} | {"distance_m"}


def listed_names(node: ast.AST) -> Iterator[str]:
    """Yield the texts that a collection literal holds, also in nested ones, or a text that is split."""
    if isinstance(node, (ast.List, ast.Set, ast.Tuple)):
        for item in node.elts:
            yield from listed_names(item)
    elif isinstance(node, ast.Dict):
        for item in (*node.keys, *node.values):
            if item is not None:
                yield from listed_names(item)
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "split":
        yield from re.split(r"[\s,|]+", ast.unparse(node.func.value).strip("'\""))
    elif isinstance(node, ast.Constant):
        yield str(node.value)


def lists_of_quantities(source: str) -> list[str]:
    """Return `line: names` of every list of two quantities or more in a module."""
    names = {name for item in declared() for name in (item.name, item.column)} - fields_of_a_revolution()
    result = ((node, names.intersection(listed_names(node))) for node in ast.walk(ast.parse(source)))
    return [f"{node.lineno}: {sorted(listed)}" for node, listed in result if len(listed) > 1]  # type: ignore[attr-defined]


SOURCES = {dotted(name): path.read_text("utf-8") for name, path in modules()}


def test_no_other_module_lists_quantities_by_name() -> None:
    results = {module: lists_of_quantities(source) for module, source in SOURCES.items() if not is_exempt(module)}
    assert {module: lists for module, lists in results.items() if lists} == {}


def test_exceptions_are_needed() -> None:
    assert [module for module in LISTS if not lists_of_quantities(SOURCES[module])] == []


@pytest.mark.parametrize(
    "source",
    [
        'A = ("Bs", "Cw")',
        'A = {"wear_mm": 1, "gain": 2}',
        'A = {1: "wear_mm", 2: ("x", "gain")}',
        'A = frozenset({"wear_mm", "estimated_load_n"})',
        'A = "wear_mm gain".split()',
    ],
)
def test_a_list_of_quantities_is_recognised(source: str) -> None:
    assert lists_of_quantities(source)
    assert not lists_of_quantities(source.replace("wear_mm", "omega_radps").replace('"Bs"', '"load_n"'))
