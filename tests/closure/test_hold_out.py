"""Nested hold-out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from gateway.closure.data.campaign_data import ORDERS, Campaign
from gateway.closure.effects.catalogue import catalogue
from gateway.closure.effects.effect import CIRCUMFERENTIAL, LATERAL, RADIAL, BaselineModel, GroupConditions
from gateway.closure.inference.hold_out import FoldError, agreement, hold_out, hold_out_fold, over_noise, summary
from gateway.closure.model.exact_baseline import ExactCore
from gateway.physics.rolling_ring import RingNotConvergedError
from gateway.types import ComplexArray, FloatArray
from tests.closure.planted_campaign import (
    ALL_AXES,
    BLOCKS,
    ONE_SPEED,
    REVOLUTIONS,
    TWO_SPEEDS,
    Plant,
    campaign_of,
    conditions,
    fitted,
    nothing,
    orders_of,
    signal_of,
    turned,
    with_blocks,
)

FOLD = 2
ROLL_RAD = 0.03
NOISE_MPS2 = 1.0
ROLL = turned(LATERAL, ROLL_RAD)
WITHOUT = frozenset(catalogue()) - {"roll tilt", "gain", "zero-g offset", "clipping"}
# Mean square of a curve from the squares of its orders.
POWER = np.where(np.arange(ORDERS) == 0, 1.0, 0.5)


def bump(signal: FloatArray, theta: FloatArray, here: GroupConditions) -> FloatArray:
    """A bump on the belt that no effect of the catalogue describes."""
    read = signal.copy()
    read[RADIAL] += 60.0 * np.exp(-np.square((theta - 1.5) / 0.05))
    return read


def rolled(groups: Sequence[GroupConditions] = ONE_SPEED, plant: Plant = ROLL) -> Campaign:
    return campaign_of(groups, plant, noise_mps2=NOISE_MPS2, axes=ALL_AXES)


@cache
def start(groups: tuple[GroupConditions, ...] = ONE_SPEED) -> FloatArray:
    """Return the initial vector of searches, from other data of the same tire without effects."""
    fit, _ = fitted(campaign_of(groups, nothing, noise_mps2=NOISE_MPS2, axes=ALL_AXES, seed=2))
    return fit.vector


def held_out(campaign: Campaign, begin: FloatArray, fold: int = FOLD) -> FoldError:
    error = hold_out_fold(campaign, BaselineModel.EXACT, begin, fold, WITHOUT)
    assert error is not None
    return error


class TestLeakage:
    """Only order 0 and 1 of the fold are changed, in phase: then its size and scatter, which weigh, stay the same."""

    def turned_round(self, campaign: Campaign, angle_rad: float, fold: int = FOLD) -> Campaign:
        low = np.where(np.arange(ORDERS) < 2, np.exp(1j * angle_rad), 1.0)
        return with_blocks(campaign, lambda k, orders: orders * low if k == fold else orders)

    def test_held_out_fold_is_unseen(self) -> None:
        campaign = rolled()
        angles = (0.0, 2.0, 4.0, 5.5)
        errors = [held_out(self.turned_round(campaign, angle), start()) for angle in angles]
        assert [error.effects for error in errors] == [("roll tilt",)] * len(angles)
        low = campaign.groups[0].blocks[FOLD].orders_mps2[:, :2]
        size = float((POWER[:2] * np.abs(low) ** 2).sum())
        # Of one prediction P, the square of data exp(ia) D less P is c - 2 Re(exp(ia) D P*): three angles give it all.
        terms = np.array([[1.0, math.cos(angle), math.sin(angle)] for angle in angles])
        for name in ("before", "after"):
            values = np.array([getattr(error, name) for error in errors])
            found = np.linalg.solve(terms[:3], values[:3])
            assert terms[3] @ found == pytest.approx(values[3], rel=1e-9)
            # As large as twice the data: the prediction is nowhere near what the fold was turned to.
            assert np.hypot(*found[1:]) == pytest.approx(2.0 * size, rel=0.01)
            assert values.max() > 1e3 * values.min()
        assert [error.noise for error in errors] == pytest.approx([errors[0].noise] * len(angles), rel=1e-12)

    def test_scatter_of_the_fold_is_unseen(self) -> None:
        campaign = rolled()
        real, imaginary = np.random.default_rng(5).normal(0.0, 500.0, (2, 3, ORDERS))
        wild = with_blocks(campaign, lambda k, orders: orders + (real + 1j * imaginary if k == FOLD else 0.0))
        here, there = held_out(campaign, start()), held_out(wild, start())
        assert there.effects == here.effects
        assert there.noise == here.noise
        change = (POWER * (real**2 + imaginary**2)).sum()
        assert there.after - here.after == pytest.approx(change, rel=0.02)

    def test_change_of_a_seen_fold_hides_the_effect(self) -> None:
        campaign = rolled()
        assert held_out(self.turned_round(campaign, 2.0, FOLD + 1), start()).effects == ()

    def test_effect_in_one_fold_is_not_found_without_it(self) -> None:
        plain, crooked = rolled(plant=nothing), rolled()
        there = crooked.groups[0].blocks[FOLD].orders_mps2
        mixed = with_blocks(plain, lambda k, orders: there if k == FOLD else orders)
        alone = held_out(mixed, start())
        assert alone.effects == ()
        assert alone.after == alone.before > 2.0 * alone.noise
        # The empirical correction does not learn it either.
        assert alone.empirical > 0.9 * alone.before

    def test_start_has_no_influence(self) -> None:
        campaign = rolled()
        elsewhere = start() + 0.05 * np.random.default_rng(3).standard_normal(len(start()))
        here, there = held_out(campaign, start()), held_out(campaign, elsewhere)
        assert there.effects == here.effects
        assert there.before == pytest.approx(here.before, rel=1e-3)
        assert there.after == pytest.approx(here.after, rel=1e-3)


class TestErrors:
    """Error of a fold against the planted signal, by explicit sums."""

    def test_error_is_planted_plus_noise(self) -> None:
        campaign = rolled(TWO_SPEEDS)
        error = held_out(campaign, start(TWO_SPEEDS))
        planted = sum(
            float((POWER * np.abs(math.sin(ROLL_RAD) * orders_of(signal_of(here)[RADIAL])) ** 2).sum())
            for here in TWO_SPEEDS
        )
        noise = len(TWO_SPEEDS) * 3 * ORDERS * NOISE_MPS2**2 / REVOLUTIONS
        spread = noise * math.sqrt(1.0 / (len(TWO_SPEEDS) * 3 * ORDERS))
        assert error.effects == ("roll tilt",)
        assert error.curves == len(TWO_SPEEDS) * 3
        assert error.revolutions == len(TWO_SPEEDS) * REVOLUTIONS
        assert error.noise == pytest.approx(noise, rel=0.01)
        assert error.after == pytest.approx(noise, abs=4.0 * spread)
        assert error.before - error.after == pytest.approx(planted, rel=0.05)

    def test_error_by_tire_state(self) -> None:
        """A deviation at one load counts as an error of that state, however many good states there are."""
        loads = (conditions(60.0), conditions(40.0), conditions(60.0, load_n=5500.0))

        def heavy(signal: FloatArray, theta: FloatArray, here: GroupConditions) -> FloatArray:
            return bump(signal, theta, here) if here.load_n == 5500.0 else signal

        error = held_out(campaign_of(loads, heavy, noise_mps2=NOISE_MPS2), start(loads))
        assert sum(after for after, _ in error.states.values()) == pytest.approx(error.after)
        assert sum(noise for _, noise in error.states.values()) == pytest.approx(error.noise)
        (good, bad), found = (0, 1), over_noise([error, error])
        assert found[good] == pytest.approx(1.0, abs=0.1)
        assert found[bad] == pytest.approx(math.sqrt(error.states[bad][0] / error.states[bad][1]))
        assert found[bad] > 1.5

    def test_absent_axes_and_orders_do_not_count(self) -> None:
        campaign = rolled()
        few = with_blocks(campaign, lambda _, orders: np.where(np.arange(ORDERS) < 60, orders, np.nan))
        flat = with_blocks(campaign, lambda _, orders: np.where((np.arange(3) == LATERAL)[:, None], np.nan, orders))
        whole, low, plane = (held_out(one, start()) for one in (campaign, few, flat))
        assert low.noise == pytest.approx(whole.noise * 60 / ORDERS, rel=0.05)
        assert (low.curves, plane.curves) == (3, 2)
        assert plane.noise == pytest.approx(whole.noise * 2 / 3, rel=0.01)

    def test_fold_missing_in_some_groups(self) -> None:
        campaign = rolled(TWO_SPEEDS)
        short = replace(campaign.groups[1], blocks=campaign.groups[1].blocks[:FOLD])
        ragged = replace(campaign, groups=(campaign.groups[0], short))
        error = held_out(ragged, start(TWO_SPEEDS))
        assert (error.curves, error.revolutions) == (3, REVOLUTIONS)
        assert error.noise == pytest.approx(3 * ORDERS * NOISE_MPS2**2 / REVOLUTIONS, rel=0.01)

    def test_empirical_correction_uses_other_folds(self) -> None:
        campaign = rolled(plant=bump)
        error = held_out(campaign, start())
        assert error.effects == ()
        assert error.before == error.after > 3.0 * error.noise
        # The mean of four folds has a quarter of a fold's noise, so it is subtracted only where it is significant.
        assert 0.85 * error.noise < error.empirical < 1.15 * error.noise


class TestFolds:
    def test_processes_give_the_same_result(self) -> None:
        """Of two present effects, one may be found."""
        without = frozenset(catalogue()) - {"roll tilt", "gain"}
        campaign = rolled(plant=lambda *of: turned(CIRCUMFERENTIAL, 0.005)(ROLL(*of), *of[1:]))
        # The data of the time-locked part are irrelevant.
        loaded = replace(campaign.groups[0], deviations_mps2=(np.ones((3, 8)),), deviation_rate_hz=100.0)
        campaign = replace(campaign, groups=(loaded,))
        finished: dict[int, list[int]] = {1: [], 2: []}
        folds = (4, 0, 1)
        one, two = (
            hold_out(
                campaign, BaselineModel.EXACT, start(), folds, without=without, jobs=jobs, on_fold=finished[jobs].append
            )
            for jobs in (1, 2)
        )
        assert finished == {1: [1, 2, 3], 2: [1, 2, 3]}
        for fold, here, there in zip(folds, one, two, strict=True):
            alone = hold_out_fold(campaign, BaselineModel.EXACT, start(), fold, without)
            assert alone is not None
            for error in (here, there):
                assert error.effects == alone.effects == ("roll tilt",)
                assert (error.curves, error.revolutions) == (alone.curves, alone.revolutions)
                for name in ("before", "after", "empirical", "noise"):
                    assert getattr(error, name) == pytest.approx(getattr(alone, name), rel=1e-9)
        assert len({error.before for error in one}) == len(folds)

    def test_excluded_effects_are_no_candidates(self) -> None:
        campaign = rolled()
        (error,) = hold_out(campaign, BaselineModel.EXACT, start(), [FOLD], without=frozenset(catalogue()) - {"gain"})
        assert error.effects == ()
        assert error.after == error.before

    def test_indispensable_fold_is_skipped(self, monkeypatch: pytest.MonkeyPatch) -> None:
        campaign = rolled()
        solves = {name: getattr(ExactCore, name) for name in ("shape", "refine")}
        done = 0

        # Fold 1 comes second from either end.
        def counted(count: int) -> None:
            nonlocal done
            done = count

        def failing(name: str) -> object:
            def solve(*args: object) -> object:
                if done == 1:
                    raise RingNotConvergedError("no equilibrium")
                return solves[name](*args)

            return solve

        for name in solves:
            monkeypatch.setattr(ExactCore, name, failing(name))
        errors = hold_out(campaign, BaselineModel.EXACT, start(), (0, 1, 2), without=WITHOUT, on_fold=counted)
        assert done == 3
        assert errors == [held_out(campaign, start(), 0), held_out(campaign, start(), 2)]


def error_of(before: float, after: float, *effects: str, curves: int = 2, revolutions: int = 7) -> FoldError:
    return FoldError(before, after, 0.5 * after, 0.25 * after, curves, revolutions, effects)


class TestSummary:
    def test_summary_is_rms_over_all_curves(self) -> None:
        errors = [error_of(40.0, 10.0), error_of(8.0, 6.0, curves=6, revolutions=5)]
        figures, noise, empirical = summary(errors)
        assert figures.rms_before_mps2 == pytest.approx(math.sqrt(48.0 / 8.0))
        assert figures.rms_after_mps2 == pytest.approx(math.sqrt(16.0 / 8.0))
        assert (figures.revolutions, figures.folds) == (12, 2)
        assert noise == pytest.approx(math.sqrt(4.0 / 8.0))
        assert empirical == pytest.approx(math.sqrt(8.0 / 8.0))

    def test_summary_matches_the_data(self) -> None:
        """Two folds against an error computed from the truth: nothing planted, so all there is is noise."""
        campaign = rolled(plant=nothing)
        errors = hold_out(campaign, BaselineModel.EXACT, start(), range(BLOCKS), without=WITHOUT)
        figures, noise, _ = summary(errors)
        truth = orders_of(signal_of(ONE_SPEED[0]))
        blocks = np.stack([block.orders_mps2 for block in campaign.groups[0].blocks])
        squares: ComplexArray = POWER * np.abs(blocks - truth) ** 2
        rms = math.sqrt(float(squares.sum()) / (3 * BLOCKS))
        assert figures.rms_before_mps2 == figures.rms_after_mps2 == pytest.approx(rms, rel=0.02)
        assert noise == pytest.approx(rms, rel=0.1)
        assert (figures.revolutions, figures.folds) == (BLOCKS * REVOLUTIONS, BLOCKS)

    def test_agreement_counts_folds(self) -> None:
        errors = [error_of(1.0, 1.0, "gain", "run-out"), error_of(1.0, 1.0), error_of(1.0, 1.0, "gain")]
        assert agreement(errors) == {"gain": 2, "run-out": 1}
        assert agreement([]) == {}
