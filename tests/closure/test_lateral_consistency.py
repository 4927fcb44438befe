"""Agreement of the belt stiffnesses of lateral effects."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gateway.closure.effects.effect import LATERAL, GroupConditions
from gateway.closure.effects.lateral_loads import STIFFNESSES
from gateway.closure.inference.lateral_consistency import agree, another_belt, common
from gateway.physics.lateral_belt import LateralBelt, solve_lateral_belt
from gateway.types import FloatArray
from tests.closure.planted_campaign import ALL_AXES, TWO_SPEEDS, Plant, among, campaign_of, fitted, ring

EFFECTS = among("ply steer", "conicity", "roll tilt")
PRIOR = np.array([parameter.prior_std for parameter in STIFFNESSES])
BELT = LateralBelt()
OTHER = replace(BELT, tread_stiffness_npm2=0.25 * BELT.tread_stiffness_npm2)


def bent_by(ply_steer: LateralBelt, cone: LateralBelt) -> Plant:
    """Return a tire whose ply steer bends one belt and whose conicity bends another; the physics module's own."""
    sheared = solve_lateral_belt(ring(), replace(ply_steer, coupling_length_m=1.2e-3))
    curved = solve_lateral_belt(ring(), replace(cone, coupling_length_m=0.0, conicity_rad=0.03))

    def plant(signal: FloatArray, theta: FloatArray, here: GroupConditions) -> FloatArray:
        read = signal.copy()
        read[LATERAL] += here.omega_radps**2 * (sheared.lateral_m + curved.lateral_m)
        return read

    return plant


@pytest.mark.parametrize(("cone", "same"), [(BELT, True), (OTHER, False)])
def test_conicity_on_another_belt_is_refused(cone: LateralBelt, same: bool) -> None:
    campaign = campaign_of(TWO_SPEEDS, bent_by(BELT, cone), noise_mps2=0.03, axes=ALL_AXES)
    ply_steer, conicity = EFFECTS["ply steer"], EFFECTS["conicity"]
    fit, _ = fitted(campaign, ply_steer, conicity)
    reason = another_belt(fit, conicity, [ply_steer], 1.0)
    assert (reason is None) is same
    assert reason is None or reason["effect"] == "ply steer"
    # An effect is not compared with itself or with effects without a belt.
    assert not another_belt(fit, conicity, [conicity, EFFECTS["roll tilt"]], 1.0)
    assert not another_belt(fit, EFFECTS["roll tilt"], [ply_steer, conicity], 1.0)


@pytest.mark.parametrize(
    ("difference", "std", "same"),
    [
        # Differences within the accuracy of the equations are accepted, however small the errors.
        ((0.15, -0.15, 0.15), 0.01, True),
        ((0.0, 0.0, 1.4), 0.01, False),
        ((0.0, 0.0, 1.4), 0.4, True),
        ((0.9, -0.8, 0.7), 0.05, False),
    ],
)
def test_stiffnesses_agree_within_errors(difference: tuple[float, ...], std: float, same: bool) -> None:
    values = np.concatenate([np.array(difference) + 0.3, np.full(3, 0.3)])
    assert agree(values, std**2 * np.eye(6)) is same


def test_unknown_stiffnesses_may_differ() -> None:
    """An effect hardly constrains common growth of all three: that direction is open, the others are not."""
    open_one = np.full((3, 3), 0.6**2) + 0.02**2 * np.eye(3)
    covariance = np.block([[open_one, np.zeros((3, 3))], [np.zeros((3, 3)), open_one]])
    assert agree(np.array([1.0, 1.0, 1.0, -0.5, -0.5, -0.5]), covariance)
    assert not agree(np.array([1.0, 1.0, 1.0, -0.5, 1.0, 2.5]), covariance)


def posterior(information: FloatArray, data: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the estimates of two sets with a prior each, and their covariance."""
    covariance = np.linalg.inv(information + np.diag(np.tile(PRIOR, 2) ** -2.0))
    return covariance @ information @ data, covariance


def test_one_belt_has_one_prior() -> None:
    """Two estimates with a prior each, correlated or not, combine to that of all data with one prior."""
    rng = np.random.default_rng(3)
    root, data = rng.normal(size=(6, 6)), rng.normal(size=6)
    information = root @ root.T
    both = np.vstack([np.eye(3), np.eye(3)])
    combined = both.T @ information @ both
    belt, _ = common(*posterior(information, data), PRIOR)
    assert belt == pytest.approx(np.linalg.inv(combined + np.diag(PRIOR**-2.0)) @ both.T @ information @ data)


def test_prior_belts_are_rare_by_chance_only() -> None:
    rng = np.random.default_rng(5)
    roots = rng.normal(size=(6, 6)) * np.array([5.0, 5.0, 2.0, 1.0, 0.5, 0.5])
    information = roots @ roots.T
    odds = []
    for _ in range(1000):
        belt = rng.normal(size=3) * PRIOR
        data = np.tile(belt, 2) + np.linalg.cholesky(np.linalg.inv(information)) @ rng.normal(size=6)
        odds.append(common(*posterior(information, data), PRIOR)[1])
    assert np.quantile(odds, [0.1, 0.5, 0.9]) == pytest.approx([0.1, 0.5, 0.9], abs=0.04)


@pytest.mark.parametrize(("bending_ln", "is_rare"), [(0.5, False), (1.3, True)])
def test_common_pull_exceeds_each_pull(bending_ln: float, is_rare: bool) -> None:
    """Each one alone is plausible for a car tire's belt, and they agree."""
    values, covariance = np.array([bending_ln, 0.0, 0.0, bending_ln, 0.0, 0.0]), 0.5**2 * np.eye(6)
    assert bending_ln < STIFFNESSES[0].high
    assert agree(values, covariance)
    belt, odds = common(values, covariance, PRIOR)
    assert belt[0] > 1.4 * bending_ln
    assert (odds < 1e-4) is is_rare


def test_uninformative_data_give_no_reason() -> None:
    values, covariance = posterior(1e-4 * np.eye(6), np.full(6, 40.0))
    assert common(values, covariance, PRIOR)[1] == 1.0
