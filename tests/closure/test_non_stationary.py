"""Non-stationary residuals."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gateway.closure.data.campaign_data import Campaign
from gateway.closure.inference import residual
from gateway.closure.inference.non_stationary import SCALING, beside_changes, changing
from gateway.closure.result import Scaling, ScalingStatus, Unexplained
from tests.closure.planted_campaign import ALL_AXES, ONE_SPEED, TWO_SPEEDS, campaign_of, fitted, with_blocks

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
    single = residual.GroupResidual(2.0 * order_2.astype(np.complex128), order_2.astype(np.float64))
    monkeypatch.setattr(residual, "group_residuals", lambda *_: (single,) * 40)
    fit = SimpleNamespace(model=SimpleNamespace(campaign=campaign_of(ONE_SPEED * 40)))
    (entry,) = residual.unexplained(fit, None)
    assert entry.rms_mps2 == pytest.approx(1.0)
    assert entry.std_mps2 == pytest.approx(40.0**-0.5)
