"""Estimates of a fit and their standard errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gateway.closure.closed_loop import diagnose
from gateway.closure.data.campaign_data import ORDERS
from gateway.closure.effects.catalogue import catalogue
from gateway.closure.effects.effect import BaselineModel, GroupConditions
from gateway.closure.inference import hold_out as held_out
from gateway.closure.inference import number_estimates as estimates
from gateway.closure.inference import validated_selection as closing
from gateway.closure.inference.confounders import rivals_of
from gateway.closure.inference.fit import linearised
from gateway.closure.inference.forward_selection import select
from gateway.closure.inference.likelihood import whiten
from gateway.closure.inference.number_estimates import estimates_of, full_covariance
from gateway.closure.model.baseline_registry import make_core
from gateway.closure.result import FAR_OFF, Verdict
from gateway.physics.rolling_ring import RingParameters, solve_rolling_ring
from gateway.reasons import Code, Reason
from gateway.types import FloatArray
from tests.closure.planted_campaign import (
    LOAD_N,
    ONE_SPEED,
    PRESSURE_PA,
    RADIUS_M,
    TWO_SPEEDS,
    among,
    campaign_of,
    conditions,
    fitted,
    gain,
    larger_belt,
    nothing,
    ring,
)

# Of `ring`, and the share by which `larger_belt` is larger.
TRUTH = {"Bs": 2.6e-3, "Cw": 0.21, "Rs": 2.6, "Ts": 2.2, "tread_stiffness_npm2": 6e7}
LARGER = 0.016
NUMBERS = ("Bs", "Cw", "Rs", "Ts")
RADIUS = among("rolling radius")["rolling radius"]


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
    fit, data = fitted(campaign_of(TWO_SPEEDS, larger_belt, noise_mps2=0.2), RADIUS)
    found, determined = estimates_of(fit, data)
    for name, truth in TRUTH.items():
        assert found[name].value == pytest.approx(truth, rel=0.01, abs=3.0 * found[name].std), name
        assert determined[name]
    # As good as those of a ring that has the stated radius.
    plain, _ = estimates_of(*fitted(campaign_of(TWO_SPEEDS, nothing, noise_mps2=0.2)))
    for name in NUMBERS[:3]:
        assert found[name].value == pytest.approx(plain[name].value, rel=0.004), name
    true_angle = ring(LOAD_N, (1.0 + LARGER) * RADIUS_M).half_angle_rad
    assert found["contact_half_angle_rad"].value == pytest.approx(true_angle, rel=2e-3)


def test_radius_error_is_propagated(monkeypatch: pytest.MonkeyPatch) -> None:
    fit, data = fitted(campaign_of(TWO_SPEEDS, larger_belt, noise_mps2=0.2), RADIUS)
    covariance = np.zeros((len(fit.vector), len(fit.vector)))
    place = fit.model.layout.effect("rolling radius").start
    covariance[place, place] = 0.01**2
    monkeypatch.setattr(estimates, "full_covariance", lambda *_: covariance)
    found, _ = estimates_of(fit, data)
    for name in TRUTH:
        assert found[name].std / found[name].value == pytest.approx(2.0 * 0.01 / (1.0 + LARGER), rel=0.01), name
    for name in ("Rs/Cw", "contact_half_angle_rad"):
        assert found[name].std < 1e-9 * found[name].value, name


def test_confounders_widen_the_error() -> None:
    effects = among("gain", "rolling radius")
    fit, data = fitted(campaign_of(ONE_SPEED, gain, noise_mps2=5.0), effects["gain"])
    rivals = rivals_of(fit, effects["gain"], effects, data)
    assert set(rivals) == {"rolling radius"}
    alone, _ = estimates_of(fit, data)
    found, determined = estimates_of(fit, data, [tuple(rivals.values())])
    other, _ = estimates_of(rivals["rolling radius"], data)
    for number in NUMBERS:
        apart = found[number].value - other[number].value
        assert found[number].value == alone[number].value
        assert found[number].std == pytest.approx(np.hypot(alone[number].std, apart))
        assert determined[number]
    # A radius 1 % larger makes stiffnesses 2 % smaller.
    assert other["Cw"].value / found["Cw"].value == pytest.approx(0.98, abs=0.005)


def test_diagnosis_widens_undecided_estimates(monkeypatch: pytest.MonkeyPatch) -> None:
    few = {name: catalogue()[name] for name in ("rolling radius", "sample clock error", "gain", "zero-g offset")}
    for module in (closing, held_out):
        monkeypatch.setattr(module, "candidates", lambda _model: few)
    diagnosis = diagnose(campaign_of(ONE_SPEED, larger_belt, noise_mps2=1.0))
    (finding,) = (f for f in diagnosis.findings if f.verdict is Verdict.INDISTINGUISHABLE)
    assert {finding.name, *finding.rivals} >= {"rolling radius", "sample clock error"}
    for name in NUMBERS:
        found = diagnosis.estimates_after[name]
        # Of a clock that runs fast the numbers are those of the stated radius, 3 % larger.
        assert found.std > 0.02 * found.value
        assert found.value == pytest.approx(TRUTH[name], abs=2.0 * found.std)


def test_series_errors_cover_equation_errors() -> None:
    """It does not average out over blocks and recordings of one state: the same is left in all of them."""
    campaign = campaign_of([conditions(speed, load_n=5500.0) for speed in (40.0, 60.0, 80.0, 100.0)], noise_mps2=0.3)
    core = make_core(BaselineModel.SERIES)
    lacking = among("pressure shape", "geometric tension loss")
    found = select(campaign, core, whiten(campaign, with_mean=core.mean), lacking)
    values, _ = estimates_of(found.final, found.data)
    for name in NUMBERS:
        assert values[name].value == pytest.approx(TRUTH[name], abs=3.0 * values[name].std), name
    assert values["Bs"].std < 0.03 * TRUTH["Bs"]


def test_model_error_is_correlated_over_orders() -> None:
    fit, data = fitted(campaign_of(TWO_SPEEDS, noise_mps2=1.0))
    share = 3e-3
    sizes = [share * np.abs(orders[0]) for orders in data.orders]
    doubting = data.doubting([sizes])
    there = linearised(fit.model, doubting, fit.vector, fit.prior_mean, fit.prior_std)
    # Only what the equations leave, nothing seen of it.
    exact = replace(doubting, orders=there.predicted)
    total = full_covariance(there, exact) - there.covariance()
    rng = np.random.default_rng(4)
    smooth = np.ones(7) / np.sqrt(7.0)
    shifts = []
    for _ in range(400):
        real, imaginary = rng.standard_normal((2, 3, ORDERS + 6))
        error = np.stack([np.convolve(axis, smooth, mode="valid") for axis in real + 1j * imaginary])
        gradient = np.zeros(len(fit.vector))
        for rows, variance in zip(there.rows, doubting.variance, strict=True):
            used = rows.weight > 0.0
            left = np.where(used, np.where(used, rows.weight, 1.0) ** -2.0 - variance, 0.0)
            white = rows.weight * np.sqrt(np.maximum(left, 0.0)) * error
            gradient[rows.places] += (rows.rows.conj() * white[:, None]).real.sum(axis=(0, 2, 3))
        shifts.append(there.covariance() @ gradient)
    states = fit.model.layout.states
    drawn = np.std(shifts, axis=0)[states]
    assert np.sqrt(np.diagonal(total))[states] == pytest.approx(drawn, rel=0.15)


def test_each_state_is_judged_separately(monkeypatch: pytest.MonkeyPatch) -> None:
    """The model lacks something under one load of three, and all together stand at the noise."""
    for module in (closing, held_out):
        monkeypatch.setattr(module, "candidates", lambda _model: {})

    def bent(signal: FloatArray, theta: FloatArray, here: GroupConditions) -> FloatArray:
        bump = np.exp(-0.5 * np.square((theta - 1.9) / 0.08))
        return signal + (22.0 * bump if here.load_n == 5500.0 else 0.0)

    loads = (conditions(60.0), conditions(60.0, load_n=3500.0), conditions(60.0, load_n=5500.0))
    diagnosis = diagnose(campaign_of(loads, bent, noise_mps2=1.5))
    assert diagnosis.held_out.rms_after_mps2 < FAR_OFF * diagnosis.noise_floor_mps2
    for name, known in diagnosis.determined.items():
        assert known == ("5500 N" not in name), name
    note = diagnosis.notes[0]
    assert isinstance(note, Reason)
    assert [state["load_n"] for state in note if state.code is Code.STATE_WITH_ERROR] == [5500.0]
