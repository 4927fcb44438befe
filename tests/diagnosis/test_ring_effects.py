"""Ring effects: parameters against the solver in SI units, smoothness, and the baseline models that take them."""

import math
from typing import cast

import numpy as np
import pytest

from gateway.core.types import FloatArray
from gateway.diagnosis.effects.catalogue import candidates, catalogue
from gateway.diagnosis.effects.effect import BaselineModel, GroupConditions, RingEffect
from gateway.diagnosis.effects.ring_options import RingOptions
from gateway.diagnosis.model.exact_baseline import ExactCore
from gateway.diagnosis.model.series_baseline import SeriesCore
from gateway.ring.reference_tire import TABLE_3_NUMBERS
from gateway.ring.rolling_ring import RingParameters, RingSolution, solve_rolling_ring
from gateway.ring.rolling_ring.sensor_waveform import waveform_orders

STEADY = GroupConditions(56.0, 0.0, 0.32, 5000.0, 2.1e5, 25.0, 25.0, 9600.0, 0.0)
SERIES_ONLY = ("belt kinematics (n^2-1)", "pressure shape", "geometric tension loss")
EXACT = (
    "structural damping",
    "tread damping (shifted pressure)",
    "bending damping",
    "contact asymmetry",
    "belt extension",
    "shear flexibility",
    "rotary inertia",
    "drum curvature",
    "sidewall stiffening",
)


def ring_effect(name: str) -> RingEffect:
    return cast(RingEffect, catalogue()[name])


def exact(name: str, value: float, core: ExactCore, conditions: GroupConditions = STEADY) -> FloatArray:
    """Return the orders of both axes of the exact core with an effect, (2, 111) complex."""
    options = ring_effect(name).options(RingOptions(), np.array([value]), conditions)
    wave = core.shape(np.zeros(5), conditions, options, 0.24).waveform
    return waveform_orders(np.stack([wave.radial_m, wave.circumferential_m]), 110)


def solved(
    conditions: GroupConditions = STEADY,
    *,
    drum_radius_m: float = math.inf,
    torque_nm: float | None = None,
    **si: float,
):
    """Return the orders of Table 3's ring with SI fields, solved without the closure."""
    fields = {"extension_stiffness_n": 2e10, **si}
    ring = RingParameters.from_numbers(*TABLE_3_NUMBERS, radius_m=0.32, pressure_pa=conditions.pressure_pa, **fields)
    solution: RingSolution = solve_rolling_ring(
        ring, conditions.load_n, conditions.pressure_pa, conditions.omega_radps, nodes=960,
        drum_radius_m=drum_radius_m, axle_torque_nm=torque_nm,
    )  # fmt: skip
    return waveform_orders(np.stack([solution.sensor.radial_m, solution.sensor.circumferential_m]), 110)


KW = TABLE_3_NUMBERS[2] * 2.1e5
EI = TABLE_3_NUMBERS[0] * 0.32**4 * 2.1e5


@pytest.mark.parametrize(
    ("name", "value", "si"),
    [
        ("structural damping", 200.0 / KW, {"foundation_damping_nspm2": 200.0}),
        ("tread damping (shifted pressure)", 5e4 / 7e7, {"tread_damping_nspm2": 5e4}),
        ("bending damping", 3e-4, {"bending_damping_nm2s": 3e-4 * EI}),
        ("contact asymmetry", 0.05, {"torque_nm": 0.05 * 5000.0 * 0.32}),
        ("contact asymmetry", -0.2, {"torque_nm": -0.2 * 5000.0 * 0.32}),
        ("belt extension", 1.0 / 5e6 - 1.0 / 2e10, {"extension_stiffness_n": 5e6}),
        ("shear flexibility", EI / 6e4, {"shear_stiffness_n": 6e4}),
        ("rotary inertia", 1.5e-4, {"rotary_inertia_kgm": 1.5e-4}),
        ("drum curvature", 1.0 / 0.85, {"drum_radius_m": 0.85}),
        ("drum curvature", -1.0 / 1.9, {"drum_radius_m": -1.9}),
        ("sidewall stiffening", 5.0, {"sidewall_stiffening_pm": 5.0}),
    ],
)
def test_parameter_matches_the_solver_in_si_units(name: str, value: float, si: dict[str, float]) -> None:
    result, true = exact(name, value, ExactCore()), solved(**si)
    plain = solved()
    change = float(np.abs(true - plain).max())
    assert change > 1e-4 * float(np.abs(plain[0, 2:]).max())
    assert np.abs(result - true).max() < 1e-4 * change


@pytest.mark.parametrize(
    "name", ["structural damping", "tread damping (shifted pressure)", "bending damping", "rotary inertia"]
)
def test_losses_and_inertia_grow_with_speed(name: str) -> None:
    slow = GroupConditions(30.0, 0.0, 0.32, 5000.0, 2.1e5, 25.0, 25.0, 9600.0, 0.0)
    core, size = ExactCore(), ring_effect(name).parameters[0].step
    plain = exact(name, 0.0, core)
    ratio = np.linalg.norm(exact(name, size, core) - plain) / np.linalg.norm(exact(name, size, core, slow) - plain)
    assert ratio == pytest.approx((56.0 / 30.0) ** (2 if name == "rotary inertia" else 1), rel=0.02)


@pytest.mark.parametrize("name", EXACT)
def test_waveform_is_smooth_from_zero(name: str) -> None:
    """Differences over half the step and twice the step give the same derivative."""
    core, step = ExactCore(), ring_effect(name).parameters[0].step
    plain = exact(name, 0.0, core)
    slopes = [(exact(name, factor * step, core) - plain) / (factor * step) for factor in (0.5, 1.0, 2.0)]
    for axis in (0, 1):
        size = float(np.linalg.norm(slopes[1][axis]))
        if size > 1e-3 * float(np.linalg.norm(slopes[1])):
            assert np.linalg.norm(slopes[0][axis] - slopes[1][axis]) < 0.08 * size
            assert np.linalg.norm(slopes[2][axis] - slopes[1][axis]) < 0.08 * size


@pytest.mark.parametrize("name", EXACT)
def test_change_for_a_trial_is_that_of_the_shape(name: str) -> None:
    """Shear flexibility has one more unknown than the ring without it."""
    effect, core = ring_effect(name), ExactCore()
    after = effect.options(RingOptions(), np.array(effect.start_values[0]), STEADY)
    (change,) = core.changes(np.zeros(5), STEADY, RingOptions(), after, (), 0.24)
    plain, there = (core.shape(np.zeros(5), STEADY, options, 0.24) for options in (RingOptions(), after))
    result, true = (
        waveform_orders(item, 60)
        for item in (change.waveform.radial_m, there.waveform.radial_m - plain.waveform.radial_m)
    )
    assert np.abs(result - true).max() < 0.15 * np.abs(true).max()


@pytest.mark.parametrize("name", EXACT)
def test_shapes_beside_another_are_those_of_rings_solved_anew(name: str) -> None:
    effect, core = ring_effect(name), ExactCore()
    start = np.array(effect.start_values[0])
    steps = np.diag([parameter.step for parameter in effect.parameters])
    options, *others = (effect.options(RingOptions(), values, STEADY) for values in (start, *(start + steps)))
    core.refine(np.zeros(5), STEADY, options)
    near = core.beside(np.zeros(5), STEADY, options, others, 0.24)
    base, *anew = (core.shape(np.zeros(5), STEADY, each, 0.24) for each in (options, *others))
    for shape, true in zip(near, anew, strict=True):
        change = waveform_orders(np.subtract(true.waveform, base.waveform), 110)
        error = waveform_orders(np.subtract(shape.waveform, true.waveform), 110)
        assert np.linalg.norm(error) < 0.03 * np.linalg.norm(change)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("structural damping", 3e-4),
        ("tread damping (shifted pressure)", 5e-4),
        ("bending damping", 4e-4),
        ("contact asymmetry", 0.05),
    ],
)
def test_losses_shift_the_contact_and_traction_is_antisymmetric(name: str, value: float) -> None:
    core = ExactCore()
    options = ring_effect(name).options(RingOptions(), np.array([value]), STEADY)
    shape = core.shape(np.zeros(5), STEADY, options, 0.24)
    centre = 0.5 * (shape.leading_edge_rad + shape.trailing_edge_rad)
    orders = waveform_orders(shape.waveform.radial_m, 110)
    assert np.abs(orders.imag).max() > 1e-3 * np.abs(orders[2:].real).max()
    if name == "contact asymmetry":
        braked = ring_effect(name).options(RingOptions(), np.array([-value]), STEADY)
        mirrored = waveform_orders(core.shape(np.zeros(5), STEADY, braked, 0.24).waveform.radial_m, 110)
        assert np.abs(orders - mirrored.conj()).max() < 1e-6
    else:
        assert centre < -1e-3


def test_drum_reads_less_than_zero_in_the_contact() -> None:
    options = ring_effect("drum curvature").options(RingOptions(), np.array([1.0 / 0.85]), STEADY)
    shape = ExactCore().shape(np.zeros(5), STEADY, options, 0.24)
    # V^2 kappa over omega^2 is -R^2 / Rd, and the tread lets the middle bend a little more.
    assert float(shape.waveform.radial_m[256]) == pytest.approx(-(0.32**2) / 0.85, rel=0.3)


def test_pressure_shape_changes_with_load() -> None:
    effect = ring_effect("pressure shape")
    parameters = np.array([-0.36, -0.59, -0.1, 0.6, -0.3, -0.2])
    nominal = effect.options(RingOptions(), parameters, STEADY)
    assert (nominal.pressure_p2, nominal.pressure_p4, nominal.pressure_p6) == pytest.approx((-0.36, -0.59, -0.1))
    heavy = effect.options(
        RingOptions(), parameters, GroupConditions(56.0, 0.0, 0.32, 8000.0, 2.1e5, 25.0, 25.0, 9600.0, 0.0)
    )
    assert heavy.pressure_p2 == pytest.approx(-0.36 + 0.6 * math.log(1.6))
    assert heavy.pressure_p4 == pytest.approx(-0.59 - 0.3 * math.log(1.6))
    assert heavy.pressure_p6 == pytest.approx(-0.1 - 0.2 * math.log(1.6))


@pytest.mark.parametrize("name", SERIES_ONLY)
def test_series_corrections_leave_the_exact_ring_unchanged(name: str) -> None:
    effect = ring_effect(name)
    options = effect.options(RingOptions(), np.array(effect.starts((STEADY,))[0]), STEADY)
    series = SeriesCore()
    moved = series.shape(np.zeros(4), STEADY, options, 0.24).waveform.radial_m
    plain = series.shape(np.zeros(4), STEADY, RingOptions(), 0.24).waveform.radial_m
    assert np.linalg.norm(moved - plain) > 0.01 * np.linalg.norm(plain)
    core = ExactCore()
    same = core.shape(np.zeros(5), STEADY, options, 0.24).waveform.radial_m
    assert same == pytest.approx(core.shape(np.zeros(5), STEADY, RingOptions(), 0.24).waveform.radial_m, abs=1e-9)


def test_candidates_depend_on_the_baseline_model() -> None:
    results = {model: set(candidates(model)) for model in BaselineModel}
    assert results[BaselineModel.PAPER] >= set(SERIES_ONLY)
    assert not results[BaselineModel.EXACT] & set(SERIES_ONLY)
    assert results[BaselineModel.EXACT] >= set(EXACT)
    assert not results[BaselineModel.PAPER] & set(EXACT)


@pytest.mark.parametrize(("name", "value"), [("belt extension", -1e-6), ("shear flexibility", -1e-6)])
def test_impossible_values_raise(name: str, value: float) -> None:
    with pytest.raises(ValueError, match="must"):
        ring_effect(name).options(RingOptions(), np.array([value]), STEADY)
