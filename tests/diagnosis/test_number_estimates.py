"""Estimates of the tire's numbers and their standard errors."""

from dataclasses import replace

import numpy as np
import pytest

from gateway.core.types import ComplexArray, FloatArray
from gateway.diagnosis.angle.fit import Fit, fit_model
from gateway.diagnosis.angle.likelihood import whiten
from gateway.diagnosis.angle.number_estimates import (
    belt_widths,
    belt_widths_apart,
    estimates_of,
    open_effects,
    still_determined,
    widened,
)
from gateway.diagnosis.checks.reference_model import on_exact_ring
from gateway.diagnosis.data.campaign_data import Campaign
from gateway.diagnosis.effects.angle_orders import field_orders
from gateway.diagnosis.effects.catalogue import candidates, catalogue, corrections
from gateway.diagnosis.effects.effect import CIRCUMFERENTIAL, BaselineModel, GroupConditions
from gateway.diagnosis.effects.ring_options import RingOptions
from gateway.diagnosis.model.baseline import Shape, moved
from gateway.diagnosis.model.baseline_registry import angle_effects, make_core
from gateway.diagnosis.model.closure_model import ClosureModel
from gateway.diagnosis.model.exact_baseline import ExactCore
from gateway.diagnosis.model.sensor_signal import base_signal
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.report.findings import apart_from, confirmed
from gateway.diagnosis.result import Finding, Fitted, TireState, Verdict
from gateway.diagnosis.views.quantities import show_fitted
from gateway.ring.rolling_ring import RingParameters, solve_rolling_ring
from tests.diagnosis.planted_campaign import (
    LOAD_N,
    ONE_SPEED,
    PRESSURE_PA,
    RADIUS_M,
    TWO_SPEEDS,
    among,
    campaign_of,
    conditions,
    evaluated,
    fitted,
    larger_belt,
    nothing,
    ring,
    searched,
    started,
    turned,
)

# Of `ring`, and the share by which `larger_belt` is larger.
TRUTH = {"Bs": 2.6e-3, "Cw": 0.21, "Rs": 2.6, "Ts": 2.2, "tread_stiffness_npm2": 6e7}
LARGER = 0.016
NUMBERS = ("Bs", "Cw", "Rs", "Ts")
RADIUS = among("rolling radius")["rolling radius"]


def bent(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
    """A bump that no effect describes, at the highest load only."""
    bump = np.exp(-0.5 * np.square((theta - 0.4) / 0.08))
    return signal + (22.0 * bump if group_conditions.load_n == 5500.0 else 0.0)


def test_stiffnesses_fall_with_radius_squared() -> None:
    """At the same load and pressure: the shape over R is the same, the contact's angle too."""
    factor = (1.0 + LARGER) ** -2
    plain, larger = (
        solve_rolling_ring(
            RingParameters.from_numbers(
                *(scale * TRUTH[name] for name in NUMBERS),
                radius_m=radius,
                pressure_pa=PRESSURE_PA,
                tread_stiffness_npm2=scale * TRUTH["tread_stiffness_npm2"],
            ),
            LOAD_N,
            PRESSURE_PA,
            55.0,
            nodes=720,
        )
        for radius, scale in ((RADIUS_M, 1.0), ((1.0 + LARGER) * RADIUS_M, factor))
    )
    assert larger.sensor.radial_m / (1.0 + LARGER) == pytest.approx(plain.sensor.radial_m, rel=1e-3)
    assert larger.half_angle_rad == pytest.approx(plain.half_angle_rad, rel=1e-5)


def test_numbers_refer_to_the_fitted_radius() -> None:
    fit, _ = fitted(campaign_of(TWO_SPEEDS, larger_belt, noise_mps2=0.2), RADIUS)
    estimates, determined = estimates_of([(fit, 1.0)])
    for name, truth in TRUTH.items():
        assert estimates[name].value == pytest.approx(truth, rel=0.01, abs=3.0 * estimates[name].std), name
        assert determined[name]
    # As good as those of a ring that has the stated radius.
    plain, _ = estimates_of([(fitted(campaign_of(TWO_SPEEDS, nothing, noise_mps2=0.2))[0], 1.0)])
    for name in NUMBERS[:3]:
        assert estimates[name].value == pytest.approx(plain[name].value, rel=0.004), name
    true_angle = ring(LOAD_N, (1.0 + LARGER) * RADIUS_M).half_angle_rad
    assert estimates["contact_half_angle_rad"].value == pytest.approx(true_angle, rel=2e-3)


def test_radius_error_is_propagated() -> None:
    fit, _ = fitted(campaign_of(TWO_SPEEDS, larger_belt, noise_mps2=0.2), RADIUS)
    covariance = np.zeros((len(fit.vector), len(fit.vector)))
    position = fit.model.layout.effect("rolling radius").start
    covariance[position, position] = 0.01**2
    vars(fit)["covariance"] = covariance
    estimates, _ = estimates_of([(fit, 1.0)])
    for name in TRUTH:
        assert estimates[name].std / estimates[name].value == pytest.approx(2.0 * 0.01 / (1.0 + LARGER), rel=0.01), name
    # The solver's grid alone.
    assert estimates["Rs/Cw"].std == pytest.approx(np.hypot(5e-5, 8e-5) * estimates["Rs/Cw"].value)
    assert estimates["contact_half_angle_rad"].std == pytest.approx(4e-4 * estimates["contact_half_angle_rad"].value)


def test_grid_error_is_within_the_stated_shares() -> None:
    """Orders of a ring on a far finer grid, fitted by the model's: the shift of its parameters."""
    rng, core = np.random.default_rng(5), ExactCore()
    conditions = campaign_of(ONE_SPEED).groups[0].conditions
    shifts = []
    for _ in range(6):
        position = 0.25 * rng.standard_normal(5)
        core.refine(position, conditions, RingOptions())
        shape, tangents = (
            core.shape(position, conditions, RingOptions(), 0.0),
            core.tangent(position, conditions, RingOptions(), 0.0),
        )
        fine = ExactCore((7200,)).shape(position, conditions, RingOptions(), 0.0)
        current = orders_of(shape, conditions)
        rows = [orders_of(moved(shape, tangent, 1e-3), conditions) - current for tangent in tangents]
        rows.append(-1e-3j * np.arange(current.shape[1]) * current)
        columns = np.stack([1e3 * row.ravel() for row in rows], axis=1)
        apart = (orders_of(fine, conditions) - current).ravel()
        both = np.concatenate([columns.real, columns.imag]), np.concatenate([apart.real, apart.imag])
        shifts.append(np.linalg.lstsq(*both, rcond=None)[0][:5])
    rms = np.sqrt(np.mean(np.square(shifts), axis=0))
    # The finer grid's own error is a fiftieth of the coarse one's before its correction.
    assert np.all(rms < 1.5 * np.array([5e-5, 8e-5, 5e-5, 2.5e-4, 3.5e-4]))
    assert rms[4] > 1e-4


def test_mixture_of_sets_widens_the_errors() -> None:
    """The variance is the sets' own, by weight, and that of their values: the error covers the choice."""
    campaign = campaign_of(ONE_SPEED, larger_belt)
    effects = among("sample clock error", "rolling radius")
    fits = [fitted(campaign, effect)[0] for effect in effects.values()]
    first, other = (estimates_of([(fit, 1.0)])[0] for fit in fits)
    mixed, _ = estimates_of([(fits[0], 0.3), (fits[1], 0.7)])
    for name in TRUTH:
        mean = 0.3 * first[name].value + 0.7 * other[name].value
        apart = 0.21 * (first[name].value - other[name].value) ** 2
        within = 0.3 * first[name].std ** 2 + 0.7 * other[name].std ** 2
        assert mixed[name].value == pytest.approx(mean), name
        assert mixed[name].std == pytest.approx(np.sqrt(within + apart)), name
    # With a clock that runs fast the numbers are those of the stated radius, 3 % apart.
    assert abs(first["Cw"].value / other["Cw"].value - 1.0) == pytest.approx(2.0 * LARGER, rel=0.2)


def test_open_effect_is_held_responsible_for_errors() -> None:
    """Rotary inertia is a part of Bs at one speed: what is possible of it is most of the error of Bs alone."""
    campaign = campaign_of(ONE_SPEED, nothing, noise_mps2=0.2)
    without, with_it = fitted(campaign)[0], fitted(campaign, among("rotary inertia")["rotary inertia"])[0]
    sets = [(without, 0.9), (with_it, 0.1)]
    mixed, _ = estimates_of(sets)
    (result,) = open_effects(sets, mixed)
    assert (result.name, result.numbers) == ("rotary inertia", ("Bs",))
    assert result.probability == pytest.approx(0.1)
    alone, _ = estimates_of([(without, 1.0)])
    assert result.ratio == pytest.approx(mixed["Bs"].std / alone["Bs"].std)
    assert open_effects([(without, 1.0)], alone) == ()
    # What widens the errors of all sets alike is not the effect's.
    wide = {name: replace(item, std=item.std + 2.0 * mixed[name].std) for name, item in mixed.items()}
    assert open_effects(sets, wide) == ()


def test_likely_effect_makes_errors_by_its_possible_absence() -> None:
    campaign = campaign_of(ONE_SPEED, larger_belt, noise_mps2=0.2)
    sets = [(fitted(campaign)[0], 0.05), (fitted(campaign, RADIUS)[0], 0.95)]
    mixed, _ = estimates_of(sets)
    (result,) = open_effects(sets, mixed)
    assert result.name == "rolling radius"
    reference, _ = estimates_of(sets[1:])
    assert result.ratio == pytest.approx(max(mixed[name].std / reference[name].std for name in result.numbers))
    assert open_effects([(sets[0][0], 0.005), (sets[1][0], 0.995)], mixed) == (), "an identified one is not open"


def test_undecided_sets_cover_the_truth() -> None:
    posterior, _ = searched(
        campaign_of(ONE_SPEED, larger_belt), among("rolling radius", "sample clock error", "zero-g offset")
    )
    assert posterior.identified() == ()
    values, _ = estimates_of([(item.fit, weight) for item, weight in posterior.considered])
    for name in NUMBERS:
        assert values[name].value == pytest.approx(TRUTH[name], abs=2.0 * values[name].std), name
        assert values[name].std > 0.01 * values[name].value


def test_unexplained_widens_the_errors_of_its_state() -> None:
    """The model lacks something under one load of two; the errors there cover it."""
    loads = (conditions(60.0), conditions(60.0, load_n=5500.0))
    plain, disturbed = (
        estimates_of([(evaluated(campaign_of(loads, plant, noise_mps2=0.5))[0].fit, 1.0)])[0]
        for plant in (nothing, bent)
    )
    heavy = next(name for name in plain if "5500 N" in name).partition(" (")[2]
    for name in NUMBERS:
        there = f"{name} ({heavy}"
        assert disturbed[name].std < 1.3 * plain[name].std, name
        assert disturbed[there].value == pytest.approx(TRUTH[name], abs=3.0 * disturbed[there].std), name
    # Bending is the number that a narrow bump resembles.
    assert disturbed[f"Bs ({heavy}"].std > 2.0 * plain[f"Bs ({heavy}"].std


def orders_of(shape: Shape, conditions: GroupConditions) -> ComplexArray:
    return field_orders(base_signal(ExactCore(), shape, conditions).signal_mps2)


def test_distance_to_the_farthest_better_model_is_part_of_the_error() -> None:
    campaign = campaign_of(TWO_SPEEDS, larger_belt, noise_mps2=0.2)
    after, _ = estimates_of([(fitted(campaign, RADIUS)[0], 1.0)])
    plain = fitted(campaign)[0]
    alone, _ = estimates_of([(plain, 1.0)])
    before, _ = estimates_of([(plain, 1.0)], [alone, after])
    for name in TRUTH:
        apart = before[name].value - after[name].value
        assert before[name].value == alone[name].value
        assert before[name].std == pytest.approx(np.hypot(alone[name].std, apart)), name
        assert abs(before[name].value - TRUTH[name]) < 2.0 * before[name].std, name


def fit_of_series(campaign: Campaign, *others: str) -> Fit:
    """Return the fit of the series with all its corrections and other effects."""
    model = BaselineModel.PAPER
    core, effects = make_core(model), angle_effects(candidates(model))
    there = ClosureModel(campaign, core, tuple(effects[name] for name in (*corrections(model), *others)))
    start, _ = there.priors()
    for effect in there.effects:
        start[there.layout.effect(effect.name)] = effect.start_values[0]
    return fit_model(there, whiten(campaign, core), start, from_afar=True)


def test_series_carries_the_error_of_its_equations() -> None:
    """A series with all its corrections matches the ring to the noise; its numbers are off by many of their errors."""
    campaign = campaign_of(TWO_SPEEDS, noise_mps2=0.5)
    fit = fit_of_series(campaign)
    exact = on_exact_ring(fit)
    assert exact is not None
    estimates, _ = estimates_of([(fit, 1.0)], [exact.numbers])
    for name in NUMBERS:
        assert estimates[name].value == pytest.approx(TRUTH[name], abs=2.0 * estimates[name].std), name
    assert on_exact_ring(fitted(campaign)[0]) is None


def test_effects_of_a_series_carry_the_error_of_its_equations() -> None:
    name = "sensor nonlinearity"
    fit = fit_of_series(campaign_of(TWO_SPEEDS, noise_mps2=0.5), name)
    exact = on_exact_ring(fit)
    assert exact is not None
    assert set(exact.parameters) == {name}
    layout = fit.model.layout
    places = range(*layout.effect(name).indices(len(fit.vector)))
    parameters = {
        parameter.name: Fitted(float(fit.vector[position]), float(np.sqrt(fit.covariance[position, position])))
        for parameter, position in zip(catalogue()[name].parameters, places, strict=True)
    }
    stated = [Finding(item, Verdict.NAMED, parameters, 1.0, 1.0) for item in (name, "gravity")]
    result, unknown = apart_from(stated, exact.parameters)
    for item, there_value in zip(parameters, exact.parameters[name].tolist(), strict=True):
        assert result.parameters[item].value == parameters[item].value
        assert result.parameters[item].std == pytest.approx(
            np.hypot(parameters[item].std, parameters[item].value - there_value)
        )
        assert result.parameters[item].std > 1.05 * parameters[item].std
    assert unknown == stated[1]


def test_states_of_one_assumed_load_have_estimates_of_their_own() -> None:
    campaign = campaign_of(ONE_SPEED)
    (group,) = campaign.groups
    contacts = tuple(replace(group, state=state, load_known=False) for state in range(3))
    fit, _ = started(replace(campaign, groups=contacts, states=3))
    fit.vector[fit.model.layout.state(2)] += 0.1
    estimates, determined = estimates_of([(fit, 1.0)])
    keys = [name for name, estimate in estimates.items() if estimate.quantity == "Cw"]
    assert keys == ["Cw", "Cw (4500 N, 220 kPa, contact 2)", "Cw (4500 N, 220 kPa, contact 3)"]
    assert estimates[keys[2]].value == pytest.approx(np.exp(0.1) * estimates[keys[1]].value)
    assert determined.keys() == estimates.keys()
    labels = [show_fitted(name, estimates[name]).label for name in keys]
    assert [label.rpartition(", ")[2] for label in labels[1:]] == ["contact 2)", "contact 3)"]


def test_number_worse_than_a_third_is_not_determined() -> None:
    fit, _ = fitted(campaign_of(ONE_SPEED))
    _, determined = estimates_of([(fit, 1.0)])
    assert determined["Cw"]
    vars(fit)["covariance"] = 1.0 * np.eye(len(fit.vector))
    _, determined = estimates_of([(fit, 1.0)])
    assert not any(determined[name] for name in NUMBERS)


def test_what_is_left_of_the_plane_bears_on_what_is_determined() -> None:
    fit, _ = fitted(campaign_of(ONE_SPEED))
    cw = estimates_of([(fit, 1.0)])[0]["Cw"]
    vars(fit)["covariance"] = np.square(0.15 * cw.value / cw.std) * fit.covariance
    sets = [(fit, 1.0)]
    # An error of 15 % counts as one of 29 % and of 31 %.
    assert [estimates_of(sets, left_ratio=ratio)[1]["Cw"] for ratio in (1.0, 1.93**2, 2.07**2)] == [True, True, False]
    # So little left is not noted either.
    vars(fit)["covariance"] = np.square(1.9) * fit.covariance
    assert estimates_of(sets, left_ratio=1.9)[1]["Cw"]
    assert not estimates_of(sets, left_ratio=2.1)[1]["Cw"]


def two_loads() -> Campaign:
    return campaign_of((conditions(60.0), conditions(60.0, load_n=5500.0)))


def of_states(second_cw: float) -> dict[str, Fitted]:
    """Two states: the load of the second may be stated wrongly."""
    return {
        "Cw": Fitted(0.195, 0.0003, quantity="Cw"),
        "Bs": Fitted(3.08e-3, 1e-6, quantity="Bs"),
        "Rs/Cw": Fitted(15.2, 0.1, quantity="Rs/Cw"),
        "Cw (5500 N, 220 kPa)": Fitted(second_cw, 0.0003, quantity="Cw", state=TireState(5500.0, PRESSURE_PA)),
    }


def apart_in(campaign: Campaign, estimates: dict[str, Fitted]) -> tuple[Fitted, Fitted] | None:
    return belt_widths_apart(belt_widths(campaign, estimates).values())


def test_states_whose_cw_agree_keep_their_errors() -> None:
    assert apart_in(two_loads(), of_states(0.1962)) is None
    assert apart_in(campaign_of(ONE_SPEED), {"Cw": Fitted(0.195, 0.0003, quantity="Cw")}) is None


def test_a_load_stated_wrongly_is_in_the_errors() -> None:
    estimates = of_states(0.1755)
    apart = apart_in(two_loads(), estimates)
    assert apart is not None
    assert (apart[0].value, apart[1].value) == (0.1755, 0.195)
    result = widened(estimates, *apart)
    share = np.log(0.195 / 0.1755)
    assert result["Bs"].std == pytest.approx(share * 3.08e-3, rel=1e-3)
    assert result["Rs/Cw"] == estimates["Rs/Cw"]
    assert still_determined(result, {"Bs": True, "Cw": False}) == {"Bs": True, "Cw": False}
    estimates = of_states(0.13)
    far = apart_in(two_loads(), estimates)
    assert far is not None
    assert still_determined(widened(estimates, *far), {"Bs": True}) == {"Bs": False}


@pytest.mark.parametrize(("value", "std"), [(0.2, 0.012), (0.17, 0.02)])
def test_an_uncertain_state_hides_no_contradiction(value: float, std: float) -> None:
    high, low = (Fitted(width, 0.0003, quantity="Cw") for width in (0.195, 0.1755))
    assert belt_widths_apart([high, Fitted(value, std, quantity="Cw"), low]) == (low, high)


def test_an_assumed_load_or_pressure_contradicts_no_stated_one() -> None:
    campaign = two_loads()
    light, heavy = campaign.groups
    for assumed in (replace(heavy, load_known=False), replace(heavy, pressure_known=False)):
        assert apart_in(replace(campaign, groups=(light, assumed)), of_states(0.13)) is None


def test_nothing_of_a_contradicted_state_is_determined() -> None:
    fit, _ = fitted(campaign_of(ONE_SPEED, nothing))
    _, sure = estimates_of([(fit, 1.0)])
    _, contradicted = estimates_of([(fit, 1.0)], contradicted=frozenset([0]))
    assert any(sure.values())
    assert not any(contradicted.values())


def test_exact_ring_does_not_confirm_what_absorbs_errors_of_a_series() -> None:
    """At nothing on the exact ring: rejected, with what is open beside it. An effect that is there stays."""
    campaign = campaign_of(TWO_SPEEDS, turned(CIRCUMFERENTIAL, 0.03))
    exact = on_exact_ring(fit_of_series(campaign, "sensor nonlinearity", "pitch tilt"))
    assert exact is not None
    assert set(exact.absent) == {"sensor nonlinearity"}
    assert exact.absent["sensor nonlinearity"] < 9.0
    result = confirmed(
        [
            Finding("pitch tilt", Verdict.NAMED, {}, 100.0, 1.0),
            Finding("gain", Verdict.INDISTINGUISHABLE, {}, 100.0, 1.0, rivals=("sensor nonlinearity",)),
            Finding("sensor nonlinearity", Verdict.INDISTINGUISHABLE, {}, 100.0, 1.0, rivals=("gain",)),
        ],
        exact.absent,
    )
    assert [item.verdict for item in result] == [Verdict.NAMED, Verdict.REFUSED, Verdict.REFUSED]
    assert [item.reason.code for item in result[1:] if item.reason is not None] == [DiagnosisCode.NOT_ON_EXACT_RING] * 2
    assert result[1].rivals == ()
