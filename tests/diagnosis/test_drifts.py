"""Recordings that are not stationary: residuals that change, and a tilt, gain or load that drifts."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gateway.core.types import ComplexArray, FloatArray
from gateway.diagnosis.angle.residual import GroupResidual
from gateway.diagnosis.data.campaign_data import Campaign
from gateway.diagnosis.data.revolution_orders import waveform_orders
from gateway.diagnosis.effects.effect import CIRCUMFERENTIAL, RADIAL, GroupConditions
from gateway.diagnosis.remainder import unexplained_orders
from gateway.diagnosis.remainder.drifts import drifts_of, with_drifts
from gateway.diagnosis.remainder.non_stationary import SCALING, beside_changes, changing
from gateway.diagnosis.result import Drift, Finding, Fitted, Scaling, ScalingStatus, Unexplained, Verdict
from gateway.diagnosis.views.phrases import residual_sentence
from tests.diagnosis.planted_campaign import (
    ALL_AXES,
    BLOCKS,
    ONE_SPEED,
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


LATERAL_ORDER_3 = (np.arange(3) == 1)[:, None] * (np.arange(111) == 3)


def swept(size_mps2: float) -> Campaign:
    """Return a campaign whose lateral order 3 goes from -2 to 2 sizes over the five blocks."""
    still = campaign_of(ONE_SPEED, axes=ALL_AXES)
    return with_blocks(still, lambda k, orders: orders + size_mps2 * (k - 2.0) * LATERAL_ORDER_3)


def test_sweep_has_axis_orders_and_size():
    (entry,) = changing(*fitted(swept(3.0)))
    assert (entry.axis, entry.lock, entry.orders, entry.scaling) == ("lateral", "angle", (3, 3), SCALING)
    assert entry.changes
    # Mean square of (-2 .. 2) is 2, of a cosine half.
    assert entry.rms_mps2 == pytest.approx(3.0, rel=0.1)
    assert entry.std_mps2 == pytest.approx(0.5 * 2.0**0.5 * 20.0**-0.5 * 2.0**0.5 * 5.0**-0.5, rel=0.5)
    assert entry.largest_in


@pytest.mark.parametrize("groups", [ONE_SPEED, TWO_SPEEDS])
def test_scatter_alone_is_no_change(groups):
    assert changing(*fitted(campaign_of(groups, axes=ALL_AXES))) == ()
    assert changing(*fitted(swept(0.15))) == (), "a change as large as the scatter"


def test_single_revolution_blocks_are_skipped():
    """With one revolution per block, the differences between blocks are the scatter itself."""
    still = campaign_of(ONE_SPEED, axes=ALL_AXES)
    group = still.groups[0]
    few = replace(group, blocks=tuple(replace(block, count=1) for block in group.blocks[:4]))
    away = with_blocks(replace(still, groups=(few,)), lambda k, orders: orders + 40.0 * (k == 0) * LATERAL_ORDER_3)
    assert changing(*fitted(away)) == ()


def test_residual_following_speed_is_no_change():
    def faster(campaign: Campaign) -> Campaign:
        """The blocks' speeds grow by 1 % each, and with their squares what is there, 100 m/s^2 unknown to the model."""
        groups = []
        for group in campaign.groups:
            blocks = []
            for k, block in enumerate(group.blocks):
                share = 1.0 + 0.01 * (k - 2.0)
                current = replace(block.conditions, omega_radps=block.conditions.omega_radps * share)
                orders = (block.orders_mps2 + 100.0 * LATERAL_ORDER_3) * share**2
                blocks.append(replace(block, conditions=current, orders_mps2=orders))
            groups.append(replace(group, blocks=tuple(blocks)))
        return replace(campaign, groups=tuple(groups))

    result = changing(*fitted(faster(campaign_of(ONE_SPEED, axes=ALL_AXES))))
    assert [entry for entry in result if entry.axis == "lateral"] == []


def test_orders_of_a_change_are_listed_once():
    (change,) = changing(*fitted(swept(3.0)))
    tone = Unexplained("lateral", "time", None, (20.0, 22.0), None, Scaling(ScalingStatus.KNOWN, 0.0), 1.0, 0.1)
    multiple = replace(tone, lock_known=False)
    elsewhere = replace(multiple, axis="radial")
    assert beside_changes((tone, multiple, elsewhere), (change,)) == (tone, elsewhere)
    assert beside_changes((tone, multiple), ()) == (tone, multiple)


def test_residual_seen_only_together_has_mean_size(monkeypatch):
    """No single recording shows it significantly."""
    order_2 = (np.arange(3) == 1)[:, None] * (np.arange(111) == 2)
    # A size of 1 and a scatter of 1: as in every one of forty recordings, two standard errors of noise.
    single = GroupResidual(2.0 * order_2.astype(np.complex128), order_2.astype(np.float64))
    monkeypatch.setattr(unexplained_orders, "group_residuals", lambda *_: (single,) * 40)
    fit = SimpleNamespace(model=SimpleNamespace(campaign=campaign_of(ONE_SPEED * 40)))
    (entry,) = unexplained_orders.unexplained(fit, None)
    assert entry.rms_mps2 == pytest.approx(1.0)
    assert entry.std_mps2 == pytest.approx(40.0**-0.5)
