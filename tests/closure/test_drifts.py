"""Drifts within a recording: a tilt that creeps, a gain that drifts and a load that falls, made without the closure."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gateway.closure.data.campaign_data import Campaign
from gateway.closure.data.revolution_orders import waveform_orders
from gateway.closure.effects.effect import CIRCUMFERENTIAL, RADIAL, GroupConditions
from gateway.closure.inference.drifts import drifts_of, with_drifts
from gateway.closure.inference.non_stationary import SCALING, changing
from gateway.closure.result import Drift, Finding, Fitted, Unexplained, Verdict
from gateway.types import ComplexArray, FloatArray
from gateway.views.report.phrases import residual_sentence
from tests.closure.planted_campaign import (
    BLOCKS,
    TWO_SPEEDS,
    Plant,
    among,
    campaign_of,
    fitted,
    nothing,
    ring,
    signal_of,
    turned,
    with_blocks,
)

BLOCK_S = 2.0
NAMES = ("pitch tilt", "gain", "zero-g offset", "circumferential gain", "rolling radius", "roll tilt")


def timed(campaign: Campaign) -> Campaign:
    """Return the campaign with times of its blocks."""
    groups = [
        replace(
            group,
            blocks=tuple(
                replace(block, conditions=replace(block.conditions, time_s=BLOCK_S * number))
                for number, block in enumerate(group.blocks)
            ),
        )
        for group in campaign.groups
    ]
    return replace(campaign, groups=tuple(groups))


def orders_of(plant: Plant, conditions: GroupConditions) -> ComplexArray:
    return np.asarray(waveform_orders(plant(signal_of(conditions), ring(conditions.load_n).theta_rad, conditions)))


def changed(plants: list[Plant]) -> Campaign:
    """Return a campaign whose blocks read one plant after the other."""
    campaign = timed(campaign_of(TWO_SPEEDS, noise_mps2=0.5))
    groups = []
    for group in campaign.groups:
        steady = orders_of(nothing, group.conditions)
        blocks = [
            replace(block, orders_mps2=block.orders_mps2 + orders_of(plant, group.conditions) - steady)
            for block, plant in zip(group.blocks, plants, strict=True)
        ]
        groups.append(replace(group, blocks=tuple(blocks)))
    return replace(campaign, groups=tuple(groups))


def scaled(size: float) -> Plant:
    def plant(signal: FloatArray, theta: FloatArray, conditions: GroupConditions) -> FloatArray:
        read = signal.copy()
        read[RADIAL] *= 1.0 + size
        return read

    return plant


def under_load(load_n: float) -> Plant:
    return lambda signal, theta, conditions: signal_of(replace(conditions, load_n=load_n))


def drifts_found(campaign: Campaign, *effects: str) -> tuple[Drift, ...]:
    fit, data = fitted(campaign, *among(*effects).values())
    assert changing(fit, data)
    return drifts_of(fit, data, tuple(among(*NAMES).values()))


def sentence(drifts: tuple[Drift, ...]) -> str:
    entry = Unexplained("radial", "angle", (1, 9), (1.0, 9.0), None, SCALING, 2.0, 0.1, changes=True, drifts=drifts)
    return residual_sentence(entry)


CREEP = np.radians([1.0, 1.1, 1.2, 1.3, 1.4])


def test_tilt_that_creeps_has_its_ends_and_its_rate() -> None:
    drifts = drifts_found(changed([turned(CIRCUMFERENTIAL, angle) for angle in CREEP.tolist()]), "pitch tilt")
    assert {(drift.name, drift.parameter, drift.rivals) for drift in drifts} == {("pitch tilt", "pitch_rad", ())}
    for drift in drifts:
        rate = (CREEP[-1] - CREEP[0]) / ((BLOCKS - 1) * BLOCK_S / 60.0)
        assert drift.per_minute.value == pytest.approx(rate, abs=3.0 * drift.per_minute.std)
        assert drift.per_minute.std < 0.1 * rate
        assert drift.begin.value == pytest.approx(CREEP[0], rel=0.03)
        assert drift.end.value == pytest.approx(CREEP[-1], rel=0.03)
    assert "drift of pitch tilt: pitch 3.0" in sentence(drifts)
    assert "deg per minute, from 1.00" in sentence(drifts)
    (wide,) = with_drifts([Finding("pitch tilt", Verdict.NAMED, {"pitch_rad": Fitted(0.02, 1e-6)}, 1.0, 1.0)], drifts)
    assert wide.parameters["pitch_rad"].std == pytest.approx(np.ptp(CREEP) / math.sqrt(12.0), rel=0.05)


def test_gain_that_drifts_needs_no_gain_on_average() -> None:
    drifts = drifts_found(changed([scaled(0.005 * (number - 2.0)) for number in range(BLOCKS)]))
    assert {drift.name for drift in drifts} == {"gain"}
    assert [drift.end.value - drift.begin.value for drift in drifts] == pytest.approx([0.02] * 2, rel=0.1)


def test_load_that_falls_is_load() -> None:
    loads = [4500.0 * (1.0 - 0.01 * (number - 2.0)) for number in range(BLOCKS)]
    drifts = drifts_found(changed([under_load(load) for load in loads]))
    assert {drift.name for drift in drifts} == {"load"}
    assert "drift of load: -" in sentence(drifts)
    for drift in drifts:
        assert drift.end.value - drift.begin.value == pytest.approx(math.log(loads[-1] / loads[0]), rel=0.1)


def test_wave_of_no_quantity_and_scatter_are_no_drift() -> None:
    campaign = timed(campaign_of(TWO_SPEEDS, noise_mps2=0.5))
    wave = (np.arange(3) == RADIAL)[:, None] * (np.arange(111) == 57)
    fit, data = fitted(with_blocks(campaign, lambda number, orders: orders + 3.0 * (number - 2.0) * wave))
    assert changing(fit, data)
    assert not drifts_of(fit, data, tuple(among(*NAMES).values()))
    assert not drifts_of(*fitted(campaign), tuple(among(*NAMES).values()))
