"""Held-out error: every fold predicted by what the other folds determine."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from gateway.core.types import FloatArray
from gateway.diagnosis.angle.fit import Fit
from gateway.diagnosis.angle.residual import group_residuals
from gateway.diagnosis.data.campaign_data import Campaign
from gateway.diagnosis.data.revolution_orders import waveform_orders
from gateway.diagnosis.effects.angle_orders import ORDERS
from gateway.diagnosis.effects.effect import CIRCUMFERENTIAL, LATERAL, RADIAL, GroupConditions
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.report.hold_out import HeldOutErrors, alignment_note, hold_out, jackknife
from gateway.diagnosis.search.set_search import baseline_fit
from tests.diagnosis.planted_campaign import (
    ALL_AXES,
    BLOCKS,
    ONE_SPEED,
    REVOLUTIONS,
    TWO_SPEEDS,
    Sideways,
    among,
    campaign_of,
    nothing,
    searched,
    sideways,
    signal_of,
    turned,
    wave,
    with_blocks,
)

ROLL_RAD = 0.03
ROLL = turned(LATERAL, ROLL_RAD)
EFFECTS = among("roll tilt")
NAMES = frozenset(["roll tilt"])
# Mean square of a curve from the squares of its orders.
POWER = np.where(np.arange(ORDERS) == 0, 1.0, 0.5)


# On the belt; no effect of the catalogue describes it.
BUMP = wave(RADIAL, lambda theta: 60.0 * np.exp(-np.square((theta - 1.5) / 0.05)))


def held_out(campaign: Campaign) -> HeldOutErrors:
    posterior, search = searched(campaign, EFFECTS)
    return hold_out(posterior, search.data, tuple(posterior.every.values()))


@cache
def rolled() -> HeldOutErrors:
    return held_out(campaign_of(TWO_SPEEDS, ROLL, axes=ALL_AXES))


@cache
def plain() -> HeldOutErrors:
    return held_out(campaign_of(ONE_SPEED, nothing, axes=ALL_AXES))


def planted() -> float:
    """Return the mean square of what a roll tilt adds to the lateral axis, per axis and curve."""
    squares = [
        float((POWER * np.abs(math.sin(ROLL_RAD) * waveform_orders(signal_of(item)[RADIAL])) ** 2).sum())
        for item in TWO_SPEEDS
    ]
    return sum(squares) / (3 * len(TWO_SPEEDS))


def test_every_revolution_is_held_out_once() -> None:
    summary = rolled().summary
    assert (summary.revolutions, summary.folds) == (len(TWO_SPEEDS) * BLOCKS * REVOLUTIONS, BLOCKS)
    assert [axis.axis for axis in summary.axes] == ["circumferential", "lateral", "radial"]


def test_error_of_an_undisturbed_ring_is_its_noise() -> None:
    """The noise is that of the blocks beside the signal that was planted, computed by explicit sums."""
    campaign, errors = campaign_of(ONE_SPEED, nothing, axes=ALL_AXES), plain()
    truth = waveform_orders(signal_of(ONE_SPEED[0]))
    blocks = np.stack([block.orders_mps2 for block in campaign.groups[0].blocks])
    rms = math.sqrt(float((POWER * np.abs(blocks - truth) ** 2).sum()) / (3 * BLOCKS))
    assert errors.summary.rms_before_mps2 == pytest.approx(rms, rel=0.02)
    assert errors.summary.rms_after_mps2 == pytest.approx(rms, rel=0.02)
    assert errors.noise_mps2 == pytest.approx(rms, rel=0.1)
    assert errors.with_discrepancy_mps2 == pytest.approx(rms, rel=0.02)


def test_planted_effect_lowers_the_error_to_the_noise() -> None:
    errors = rolled()
    assert set(errors.chosen) == {NAMES}
    assert errors.summary.rms_after_mps2 == pytest.approx(errors.noise_mps2, rel=0.05)
    fall = errors.summary.rms_before_mps2**2 - errors.summary.rms_after_mps2**2
    assert fall == pytest.approx(planted(), rel=0.1)
    assert errors.rms_of[NAMES] == errors.summary.rms_after_mps2
    assert errors.rms_of[frozenset()] == errors.summary.rms_before_mps2


def test_error_is_reported_by_axis() -> None:
    summary = rolled().summary
    by_axis = {axis.axis: axis for axis in summary.axes}
    lateral = by_axis["lateral"]
    assert lateral.before_mps2 > 2.0 * lateral.after_mps2
    assert lateral.before_weighted > 2.0
    assert lateral.after_weighted == pytest.approx(1.0, abs=0.1)
    for name in ("circumferential", "radial"):
        assert by_axis[name].after_mps2 == pytest.approx(by_axis[name].before_mps2, rel=0.05)
    mean_square = np.mean([axis.after_mps2**2 for axis in summary.axes])
    assert summary.rms_after_mps2 == pytest.approx(math.sqrt(mean_square))


def test_discrepancy_lowers_the_error_of_the_unexplained() -> None:
    errors = held_out(campaign_of(ONE_SPEED, BUMP, axes=ALL_AXES))
    assert errors.summary.rms_after_mps2 > 1.5 * errors.noise_mps2
    assert errors.with_discrepancy_mps2 < 1.3 * errors.noise_mps2
    radial = next(axis for axis in errors.summary.axes if axis.axis == "radial")
    assert radial.with_discrepancy_mps2 < 0.4 * radial.after_mps2


def test_effect_in_one_fold_does_not_predict_it() -> None:
    """Its size without the fold is a quarter in the others: 1 + 4/16 of the square is left, in-sample 4/5."""
    campaign = campaign_of(ONE_SPEED, axes=ALL_AXES)
    shift = np.zeros((3, ORDERS), complex)
    shift[LATERAL] = math.sin(0.004) * waveform_orders(signal_of(ONE_SPEED[0]))[RADIAL]
    errors = held_out(with_blocks(campaign, lambda k, orders: orders + shift * (k == 2)))
    square = float((POWER * np.abs(shift) ** 2).sum()) / (3 * BLOCKS)
    without = errors.rms_of[frozenset()] ** 2 - plain().rms_of[frozenset()] ** 2
    assert without > 0.9 * square
    if NAMES in errors.rms_of:
        assert errors.rms_of[NAMES] ** 2 - plain().rms_of[frozenset()] ** 2 > 1.1 * square
    assert errors.with_discrepancy_mps2**2 - plain().with_discrepancy_mps2 ** 2 > 0.9 * square


def tread_void(signal: FloatArray, theta: FloatArray, conditions: GroupConditions) -> FloatArray:
    """A wave of the lateral axis, and a kink beside the contact that no effect describes."""
    read = sideways(3.0)(signal, theta, conditions)
    square = np.square((theta - 0.3) / 0.09)
    kink = 300.0 * (1.0 - square) * np.exp(-0.5 * square)
    read[RADIAL] += kink
    read[CIRCUMFERENTIAL] += 0.7 * kink
    return read


def test_ring_is_taken_at_its_best_before_and_after() -> None:
    """The lateral effect is not credited with what a better fit of the ring's own parameters does."""
    campaign = campaign_of(ONE_SPEED, tread_void, axes=ALL_AXES)
    posterior, search = searched(campaign, {"one": Sideways("one")})
    assert posterior.best.names == {"one"}
    errors = hold_out(posterior, search.data)

    def remainder_mps2(fit: Fit) -> float:
        return math.sqrt(
            sum(
                float((POWER * np.abs(group_residual.orders_mps2) ** 2).sum())
                for group_residual in group_residuals(fit, search.data)
            )
            / 3.0
        )

    least = remainder_mps2(baseline_fit(campaign, search.core, search.data))
    assert remainder_mps2(posterior.baseline.fit) > 1.02 * least
    noise = errors.noise_mps2
    assert errors.summary.rms_before_mps2 == pytest.approx(math.hypot(least, noise), rel=0.01)
    assert errors.fit_of[frozenset()].applied is None
    for axis in errors.summary.axes:
        if axis.axis != "lateral":
            assert axis.after_mps2 == pytest.approx(axis.before_mps2, rel=0.01)
    lateral = errors.summary.axes[LATERAL]
    assert lateral.after_mps2 == pytest.approx(lateral.noise_mps2, rel=0.05)
    assert lateral.before_mps2 > 1.5 * lateral.after_mps2


@pytest.mark.parametrize(("folds", "count"), [(2, REVOLUTIONS), (2, 1), (3, 1)])
def test_few_folds_and_revolutions_work(folds: int, count: int) -> None:
    campaign = campaign_of(ONE_SPEED, ROLL, axes=ALL_AXES)
    (group,) = campaign.groups
    blocks = tuple(replace(block, count=count) for block in group.blocks[:folds])
    variance = group.variance * count / REVOLUTIONS
    few = replace(campaign, groups=(replace(group, blocks=blocks, variance=variance),))
    errors = held_out(few)
    assert (errors.summary.folds, errors.summary.revolutions) == (folds, folds * count)
    assert set(errors.chosen) == {NAMES}
    assert errors.summary.rms_before_mps2 > 2.0 * errors.summary.rms_after_mps2
    assert errors.summary.rms_after_mps2 == pytest.approx(errors.noise_mps2, rel=0.1)


def test_group_with_fewer_folds_is_held_out_too() -> None:
    campaign = campaign_of(TWO_SPEEDS, axes=ALL_AXES)
    short = replace(campaign.groups[1], blocks=campaign.groups[1].blocks[:2])
    errors = held_out(replace(campaign, groups=(campaign.groups[0], short)))
    assert errors.summary.folds == BLOCKS
    assert errors.summary.rms_after_mps2 == pytest.approx(errors.noise_mps2, rel=0.1)


def test_absent_axes_have_no_error() -> None:
    posterior, search = searched(campaign_of(ONE_SPEED), {})
    errors = hold_out(posterior, search.data)
    assert [axis.axis for axis in errors.summary.axes] == ["circumferential", "radial"]


def moved_edges(campaign: Campaign) -> Campaign:
    """Say that the blocks were aligned: as recorded, each has 5 m/s^2 more on the radial axis in order 40."""
    added = np.zeros((3, ORDERS), complex)
    added[RADIAL, 40] = 5.0
    (group,) = campaign.groups
    blocks = tuple(replace(block, as_recorded_mps2=block.orders_mps2 + added) for block in group.blocks)
    return replace(campaign, groups=(replace(group, blocks=blocks),))


def test_error_is_given_without_alignment_too() -> None:
    assert plain().summary.as_recorded is None
    assert alignment_note(plain().summary) == ()
    summary = held_out(moved_edges(campaign_of(ONE_SPEED, axes=ALL_AXES))).summary
    recorded = summary.as_recorded
    assert recorded is not None
    # Half its square is its mean square, on one axis of three.
    assert recorded.rms_after_mps2**2 - summary.rms_after_mps2**2 == pytest.approx(12.5 / 3.0, rel=0.2)
    assert recorded.rms_before_mps2 == recorded.rms_after_mps2
    assert (recorded.revolutions, recorded.parameters) == (BLOCKS * REVOLUTIONS, 4 * BLOCKS * REVOLUTIONS)
    (note,) = alignment_note(summary)
    assert (note.code, note["after_mps2"]) == (DiagnosisCode.EDGES_ALIGNED, recorded.rms_after_mps2)
    hardly = recorded._replace(rms_before_mps2=1.01 * summary.rms_before_mps2, rms_after_mps2=summary.rms_after_mps2)
    assert alignment_note(replace(summary, as_recorded=hardly)) == ()


def test_every_block_has_its_error() -> None:
    summary = rolled().summary
    assert len(summary.blocks) == len(TWO_SPEEDS) * BLOCKS
    assert {block.revolutions for block in summary.blocks} == {REVOLUTIONS}
    for of, total in (("before_mps2", summary.rms_before_mps2), ("after_mps2", summary.rms_after_mps2)):
        assert math.sqrt(np.mean([getattr(block, of) ** 2 for block in summary.blocks])) == pytest.approx(total)
    assert 0.0 < summary.std_after_mps2 < 0.1 * summary.rms_after_mps2


def test_errors_of_the_errors_follow_the_scatter_of_blocks() -> None:
    """Mean squares of chi-square form: an rms of n blocks of k values has the relative error 1 / sqrt(2 n k)."""
    rng = np.random.default_rng(4)
    results = []
    for _ in range(400):
        before = rng.chisquare(50, 10)
        results.append(
            (math.sqrt(before.sum() / 500), jackknife([np.array([item, 0.25 * item]) for item in before], [50.0] * 10))
        )
    spread = np.std([rms for rms, _ in results])
    assert spread == pytest.approx(1.0 / math.sqrt(1000.0), rel=0.1)
    assert np.sqrt(np.mean([errors[0] ** 2 for _, errors in results])) == pytest.approx(spread, rel=0.1)
    # Both go together: their ratio is certain.
    assert max(errors[2] for _, errors in results) < 1e-9
    assert all(math.isnan(item) for item in jackknife([np.ones(2)], [1.0]))
