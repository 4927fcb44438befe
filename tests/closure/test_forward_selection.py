"""Forward selection of effects on an independent exact ring."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gateway.closure.closed_loop import diagnose
from gateway.closure.effects.catalogue import candidates, catalogue
from gateway.closure.effects.effect import CIRCUMFERENTIAL, LATERAL, RADIAL, BaselineModel, GroupConditions
from gateway.closure.inference import acceptance_tests as acceptance
from gateway.closure.inference.ablation import taken_out
from gateway.closure.inference.candidate_selection import is_taken
from gateway.closure.inference.candidate_trial import refit, try_effect
from gateway.closure.inference.confounders import fit_without
from gateway.closure.inference.forward_selection import Selection, select
from gateway.closure.inference.likelihood import whiten
from gateway.closure.model.baseline_registry import angle_effects, make_core
from gateway.closure.model.closure_model import AngleEffect
from gateway.closure.result import FAR_OFF
from gateway.reasons import Code
from gateway.types import FloatArray
from tests.closure.planted_campaign import (
    ALL_AXES,
    Plant,
    among,
    campaign_of,
    conditions,
    fitted,
    gain,
    nothing,
    ring,
    turned,
)

CONDITIONS = (conditions(60.0), conditions(40.0), conditions(60.0, load_n=5500.0), conditions(60.0, load_n=3500.0))


def selected(model: BaselineModel, plant: Plant = nothing) -> Selection:
    campaign = campaign_of(CONDITIONS, plant, noise_mps2=1.5)
    core = make_core(model)
    return select(campaign, core, whiten(campaign, with_mean=core.mean), angle_effects(candidates(model)))


def angle_effect(name: str) -> AngleEffect:
    return angle_effects(catalogue())[name]


@pytest.mark.parametrize(
    ("model", "lacking"),
    [
        (
            BaselineModel.PAPER,
            {"gravity", "belt kinematics (n^2-1)", "pressure shape", "geometric tension loss"},
        ),
        (BaselineModel.SERIES, {"pressure shape", "geometric tension loss"}),
        (BaselineModel.EXACT, set()),
    ],
)
def test_undisturbed_ring_lacks_only_model_terms(model: BaselineModel, lacking: set[str]) -> None:
    found = selected(model)
    assert {step.effect.name for step in found.steps} == lacking
    assert found.final.misfit < 1.1 * found.data.used
    for name in lacking - {"pressure shape"}:
        # Physics fixes the size: present or absent.
        assert found.final.vector[found.final.model.layout.effect(name)] == pytest.approx(1.0, abs=0.05)


def test_large_gain_is_found_alone() -> None:
    def large(signal: FloatArray, theta: FloatArray, here: GroupConditions) -> FloatArray:
        return gain(gain(signal, theta, here), theta, here)

    found = selected(BaselineModel.EXACT, large)
    (step,) = found.steps
    # Only gravity would distinguish them, and the noise hides it.
    assert step.effect.name in {"gain", "rolling radius"}
    assert found.final.vector[found.final.model.layout.effect(step.effect.name)] == pytest.approx(0.0201, rel=0.02)
    assert found.final.misfit < 1.1 * found.data.used


def test_small_tilt_has_a_realistic_trial() -> None:
    angle_rad = 5e-5
    fit, data = fitted(campaign_of(CONDITIONS, turned(LATERAL, angle_rad), noise_mps2=0.05, axes=ALL_AXES))
    trial = try_effect(fit, data, angle_effect("roll tilt"))
    assert trial is not None
    assert trial.vector[trial.model.layout.effect("roll tilt")] == pytest.approx(angle_rad, rel=0.1)
    # The full fit confirms the prediction of the trial.
    assert trial.misfit == pytest.approx(refit(trial, fit, data).misfit, abs=3.0)


def test_effect_on_one_axis_only_is_refused() -> None:
    def pickup(signal: FloatArray, theta: FloatArray, here: GroupConditions) -> FloatArray:
        # As a sensor 0.3 mm lower reads along the circumference; the radial axis knows nothing of it.
        read = signal.copy()
        read[CIRCUMFERENTIAL] += 0.001 * np.gradient(signal[RADIAL], theta)
        return read

    campaign = campaign_of(CONDITIONS, pickup, noise_mps2=0.2)
    found = select(campaign, make_core(BaselineModel.EXACT), whiten(campaign, with_mean=True), among("mounting offset"))
    assert not found.steps
    reason = found.refused["mounting offset"][0]
    assert reason is not None
    assert reason.code is Code.SIZE_DIFFERS_BETWEEN_AXES


def test_indirectly_affected_axis_is_not_tested() -> None:
    """A tilt brings the offset to the lateral axis; what the tilt does not tell there is not the offset's."""
    depth_m, tilt_rad = 0.005, 0.05

    def plant(signal: FloatArray, theta: FloatArray, here: GroupConditions) -> FloatArray:
        slope = np.gradient(signal[RADIAL], theta) / here.omega_radps**2
        curvature = ring(here.load_n).sensor.radial_m / here.radius_m
        offset = here.omega_radps**2 * depth_m * np.stack([-slope / here.radius_m, 0.0 * slope, -np.square(curvature)])
        read = signal + offset
        read[LATERAL] = math.sin(tilt_rad) * (signal[RADIAL] + 4.0 * offset[RADIAL])
        read[RADIAL] *= math.cos(tilt_rad)
        return read

    effects = list(among("mounting offset", "roll tilt").values())
    fit, _ = fitted(campaign_of(CONDITIONS, plant, noise_mps2=0.2, axes=ALL_AXES), *effects)
    offset, _ = effects
    assert fit.vector[fit.model.layout.effect(offset.name)] == pytest.approx(depth_m, rel=0.1)
    assert not acceptance.lopsided(fit, offset, 1.0)


def test_edge_waves_stand_or_travel() -> None:
    standing, travelling = angle_effect("tire-locked edge waves"), angle_effect("travelling edge waves")
    assert is_taken(travelling, [standing])
    assert is_taken(standing, [travelling])
    assert not is_taken(angle_effect("gain"), [standing, travelling])


@pytest.mark.parametrize(("curvature", "may_be"), [(0.003, True), (-0.0003, True), (-0.007, False), (-0.5, True)])
def test_hollow_road_is_an_inner_drum(curvature: float, may_be: bool) -> None:
    effect = angle_effect("drum curvature")
    assert (effect.reason_against(np.array([curvature]), np.array([2e-4])) is None) is may_be


@pytest.mark.parametrize(("decay", "may_be"), [(4.0, True), (20.0, False)])
def test_wave_has_at_least_one_wavelength(decay: float, may_be: bool) -> None:
    effect = angle_effect("tire-locked edge waves")
    values = np.array([0.1, 0.1, 60.0, decay, 0.1, 0.1, 52.0, 1.4])
    assert (effect.reason_against(values, np.full(8, 0.01)) is None) is may_be
    # A wave that is indistinguishable from zero cannot be wrong.
    assert effect.reason_against(values, np.full(8, 0.1)) is None


def test_large_residual_determines_no_estimate() -> None:
    def bent(signal: FloatArray, theta: FloatArray, here: GroupConditions) -> FloatArray:
        # No effect of the catalogue grows with the fifth power of the speed.
        bump = np.exp(-0.5 * np.square((theta - 1.9) / 0.08))
        return signal + 60.0 * (here.omega_radps / 55.0) ** 5 * bump

    few = (conditions(60.0), conditions(40.0))
    near, far = (diagnose(campaign_of(few, plant, noise_mps2=1.5)) for plant in (nothing, bent))
    assert far.held_out.rms_after_mps2 > FAR_OFF * far.noise_floor_mps2
    assert any(near.determined.values())
    assert not any(far.determined.values())


def test_ablation_matches_a_fit_without_the_effect() -> None:
    effect = angle_effect("zero-g offset")
    fit, data = fitted(campaign_of(CONDITIONS, noise_mps2=1.5), effect)
    without = fit_without(fit, effect, data)
    assert without is not None
    linear = taken_out(fit, effect)
    assert linear.held_out == pytest.approx(without.held_out(), abs=0.5)
    assert linear.fall == pytest.approx(without.misfit - fit.misfit, abs=0.5)
    # An absent effect lowers nothing.
    assert acceptance.useless(
        effect, linear.fall, linear.held_out - fit.held_out(), acceptance.overdispersion(fit, data)
    )
