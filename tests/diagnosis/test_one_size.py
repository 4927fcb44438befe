"""Effects that have no one size, or that are buried in what is left, and errors by what is left."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gateway.core.types import FloatArray
from gateway.diagnosis.angle.fit import Fit
from gateway.diagnosis.angle.likelihood import Whitened
from gateway.diagnosis.angle.remainder_freedom import beside_remainder
from gateway.diagnosis.angle.residual import GroupResidual
from gateway.diagnosis.data.campaign_data import Campaign
from gateway.diagnosis.effects.angle_orders import ORDERS
from gateway.diagnosis.effects.effect import CIRCUMFERENTIAL, RADIAL, GroupConditions
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.report import one_size
from gateway.diagnosis.report.findings import of_common_size
from gateway.diagnosis.report.one_size import change_within, disagreement, fitted_alone, of_one_size
from gateway.diagnosis.result import Finding, Verdict
from tests.diagnosis.planted_campaign import Plant, among, campaign_of, conditions, fitted, gain
from tests.diagnosis.test_sensor_depth import at_depth

SPEEDS = tuple(conditions(speed) for speed in (40.0, 90.0, 65.0))
DEPTH_M = 6e-3


def turned(angle_rad: float, delay_s: float) -> Plant:
    """Return a sensor below the belts whose circumferential axis reads at another angle and another time."""

    def plant(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
        read = at_depth(DEPTH_M)(signal, theta, group_conditions)
        order = np.arange(read.shape[1] // 2 + 1)
        ahead = angle_rad - delay_s * group_conditions.omega_radps
        spectrum = np.fft.rfft(read[CIRCUMFERENTIAL]) * np.exp(1j * order * ahead)
        read[CIRCUMFERENTIAL] = np.fft.irfft(spectrum, n=read.shape[1])
        return read

    return plant


def of_depth(campaign: Campaign) -> Campaign:
    groups = []
    for number, group in enumerate(campaign.groups):
        groups.append(replace(group, recording=number, declared_offset_m=DEPTH_M))
    return replace(campaign, groups=tuple(groups), recordings=("a", "b", "c"))


def judged(plant: Plant, name: str) -> tuple[Finding, Fit, Whitened]:
    fit, data = fitted(of_depth(campaign_of(SPEEDS, plant)), *among(name).values())
    finding = Finding(name, Verdict.NAMED, _fitted(fit, name), 100.0, 1.0)
    (result,) = of_one_size([finding], fit, data)
    return result, fit, data


def _fitted(fit: Fit, name: str):  # type: ignore[no-untyped-def]
    from gateway.diagnosis.bayes.parameter_estimates import fitted_parameter

    (effect,) = (effect for effect in fit.model.effects if effect.name == name)
    values, variances = fit.parameters_of(name)
    return {
        parameter.name: fitted_parameter(parameter, float(value), math.sqrt(float(variance)))
        for parameter, value, variance in zip(effect.parameters, values, variances, strict=True)
    }


@pytest.mark.parametrize(
    ("plant", "name"), [(turned(0.0, 120e-6), "circumferential delay"), (turned(0.016, 0.0), "circumferential shift")]
)
def test_effect_of_one_size_stays_with_its_sizes(plant: Plant, name: str) -> None:
    finding, fit, _ = judged(plant, name)
    assert finding.verdict is Verdict.NAMED
    assert [size.label for size in finding.single_sizes] == ["a", "b", "c"]
    true = next(iter(finding.parameters.values())).value
    assert all(abs(size.value - true) < 4.0 * size.std + 0.03 * abs(true) for size in finding.single_sizes)
    square, freedom = disagreement(fitted_alone(fit), fit.model.effects[0])
    assert freedom == 2
    assert square < 9.0


@pytest.mark.parametrize(
    ("plant", "name"), [(turned(0.016, 0.0), "circumferential delay"), (turned(0.0, 120e-6), "circumferential shift")]
)
def test_delay_and_shift_have_no_one_size_where_the_other_is_true(plant: Plant, name: str) -> None:
    finding, _, _ = judged(plant, name)
    assert finding.verdict is Verdict.REFUSED
    assert finding.reason is not None
    assert finding.reason.code in {DiagnosisCode.SIZES_DIFFER, DiagnosisCode.SMALLER_THAN_LEFT}
    assert disagreement(fitted_alone(judged(plant, name)[1]), among(name)[name])[0] > 50.0


def sagging(share: float, campaign: Campaign) -> Campaign:
    """Return a campaign whose signal falls by a share from the first to the last block of each group."""
    groups = []
    for group in campaign.groups:
        factors = 1.0 + share * np.linspace(0.5, -0.5, len(group.blocks))
        blocks = tuple(
            replace(block, orders_mps2=factor * block.orders_mps2)
            for block, factor in zip(group.blocks, factors.tolist(), strict=True)
        )
        groups.append(replace(group, blocks=blocks))
    return replace(campaign, groups=tuple(groups))


@pytest.mark.parametrize("share", [0.0, 0.01])
def test_size_that_changes_within_a_recording_is_not_one(share: float) -> None:
    """A supply that sags, its mean taken for a constant gain."""
    campaign = sagging(share, of_depth(campaign_of(SPEEDS, gain)))
    fit, data = fitted(campaign, *among("gain").values())
    (finding,) = of_one_size([Finding("gain", Verdict.NAMED, _fitted(fit, "gain"), 100.0, 1.0)], fit, data)
    square, freedom = change_within(fit, data, fit.model.effects[0])
    assert freedom == 3
    if share:
        assert finding.reason is not None
        assert finding.reason.code is DiagnosisCode.SIZE_CHANGES
        assert square > 50.0
    else:
        assert finding.verdict is Verdict.NAMED
        assert square < 9.0


def test_speeds_of_a_single_recording_are_compared() -> None:
    campaign = of_depth(campaign_of(SPEEDS, turned(0.016, 0.0)))
    campaign = replace(campaign, groups=tuple(replace(group, recording=0) for group in campaign.groups))
    fit, _ = fitted(replace(campaign, recordings=("a",)), *among("circumferential delay").values())
    alone = fitted_alone(fit)
    assert [single.label for single in alone] == [group.label for group in campaign.groups]
    assert disagreement(alone, fit.model.effects[0])[0] > 50.0


def test_errors_grow_by_what_is_left_and_not_by_noise() -> None:
    def wave(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
        read = at_depth(DEPTH_M)(signal, theta, group_conditions)
        read[RADIAL] += 0.01 * np.abs(read[RADIAL]).max() * np.cos(7.0 * theta + 0.4)
        return read

    ratios = []
    for plant in (at_depth(DEPTH_M), wave):
        fit, data = fitted(of_depth(campaign_of(SPEEDS, plant)))
        wide = beside_remainder(fit, data)
        states = fit.model.layout.states
        ratios.append(np.sqrt(np.diagonal(wide.covariance)[states] / np.diagonal(fit.covariance)[states]).max())
    assert ratios[0] < 1.6
    assert ratios[1] > 1.2 * ratios[0]


def offset(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
    return signal + np.array([[0.0], [0.0], [3.0]])


def on_the_move(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
    """Return the signal of a wheel that turns slower than its contacts come, by the same rate at every speed."""
    return signal * (1.0 - 0.2 / group_conditions.omega_radps)


@pytest.mark.parametrize(("plant", "verdict"), [(offset, Verdict.NAMED), (on_the_move, Verdict.REFUSED)])
def test_effect_that_is_there_only_between_recordings_is_not_identified(plant: Plant, verdict: Verdict) -> None:
    campaign = campaign_of(SPEEDS, plant)
    groups = tuple(replace(group, recording=number) for number, group in enumerate(campaign.groups))
    campaign = replace(campaign, groups=groups, recordings=("a", "b", "c"))
    fit, data = fitted(campaign, *among("zero-g offset", "gain").values())
    finding = Finding("zero-g offset", Verdict.NAMED, _fitted(fit, "zero-g offset"), 100.0, 1.0)
    (single,) = of_one_size([finding], fit, data)
    (result,) = of_common_size([replace(single, verdict=Verdict.NAMED)])
    assert result.verdict is verdict
    if result.reason is not None and verdict is Verdict.REFUSED:
        assert result.reason.code is DiagnosisCode.SIZES_DIFFER
        assert dict(result.reason.values)["freedom"] == 1


def test_effect_without_which_the_ring_has_no_shape_is_not_buried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its size is not known."""
    fit: Any = SimpleNamespace(model=SimpleNamespace(campaign=SimpleNamespace(groups=[SimpleNamespace(recording=0)])))
    residual = GroupResidual(np.full((3, ORDERS), 10.0 + 0.0j), np.ones((3, ORDERS)))
    monkeypatch.setattr(one_size, "group_residuals", lambda *_: (residual,))
    for size_mps2, is_buried in ((1.0, True), (100.0, False), (math.nan, False)):
        added = [np.full((3, ORDERS), complex(size_mps2))]
        monkeypatch.setattr(one_size, "added_by", lambda *_, added=added: added)
        assert (one_size._buried(fit, fit, fit) is not None) == is_buried
