"""Response of the rolling ring to a change at one place: limits that follow from other solutions."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from gateway.core.types import ComplexArray
from gateway.ring.rolling_ring import (
    Change,
    LoadedBelt,
    RingParameters,
    RingSolution,
    Slope,
    TreadBlocks,
    block_response,
    loaded_belt,
    local_response,
    solve_rolling_ring,
)
from gateway.ring.rolling_ring import local_changes as module
from gateway.ring.rolling_ring.block_vibration import pushed_response
from gateway.ring.rolling_ring.force_balance import belt_balance, edge_tread_npm2, ring_grid

OMEGA_RADPS, NODES, PATTERNS = 55.0, 480, 4
RING = RingParameters.from_numbers(
    2.6e-3, 0.21, 2.6, 2.2, radius_m=0.31, pressure_pa=2.2e5, tread_stiffness_npm2=6e7, extension_stiffness_n=2e10
)


@lru_cache
def solved(load_n: float = 4500.0) -> RingSolution:
    return solve_rolling_ring(RING, load_n, 2.2e5, OMEGA_RADPS, nodes=NODES)


def loaded(tread_npm2: float) -> RingSolution:
    return solve_rolling_ring(
        replace(RING, tread_stiffness_npm2=tread_npm2), 4500.0, 2.2e5, OMEGA_RADPS, nodes=4 * NODES
    )


def belt() -> LoadedBelt:
    return loaded_belt(solved())


@pytest.fixture(autouse=True)
def few_patterns(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "PATTERNS", PATTERNS)


def response(change: Change) -> ComplexArray:
    result: ComplexArray = local_response(belt(), OMEGA_RADPS, 1e-6, 0.0, (change,))[0, 0]
    return result


def test_steady_rim_moves_the_belt_as_another_load_does() -> None:
    """Pattern 0 of the axle's height is the change of the shape between two loads, over that of the height."""
    low, high = solved(4480.0), solved(4520.0)
    slope = (high.sensor.radial_m - low.sensor.radial_m) / (high.axle_height_m - low.axle_height_m)
    result = response(Change.RIM)[0, 0].real
    assert np.linalg.norm(result - slope) < 0.05 * np.linalg.norm(slope)


def test_stiffer_tread_all_around_is_that_of_another_ring() -> None:
    soft, stiff = (loaded(tread_npm2) for tread_npm2 in (5.94e7, 6.06e7))
    slope = (stiff.sensor.radial_m - soft.sensor.radial_m)[::4] / 0.02
    # The load is the same, so that the axle moves.
    rise_m = (stiff.axle_height_m - soft.axle_height_m) / 0.02
    result = (response(Change.TREAD_STIFFNESS) + rise_m * response(Change.RIM))[0, 0].real
    assert np.linalg.norm(result - slope) < 0.02 * np.linalg.norm(slope)


@pytest.mark.parametrize("edge", [0.1, 0.45, 0.55, 0.9])
def test_contact_is_as_long_as_its_push_is_positive(edge: float) -> None:
    """A push that is level in the middle, by nodes of one; the edges are between nodes."""
    solution, nodes = belt(), np.arange(float(NODES))
    push = np.minimum(20.0 + edge - np.abs(nodes - 240.0), 6.0)
    road = solution.balance(solution.law).road._replace(unclipped_npm=push)
    added = edge_tread_npm2(solution.law, road, 0.0)[:, 1, 1] / solution.law.tread_npm2
    assert np.count_nonzero(push > 0.0) - added.sum() == pytest.approx(2.0 * (20.0 + edge))


@pytest.mark.parametrize("change", [Change.BENDING, Change.MASS, Change.SIDEWALL, Change.TREAD, Change.RIM])
@pytest.mark.parametrize("count", [3, 40, 80])
def test_every_other_node_answers_as_all_do(change: Change, count: int) -> None:
    """An extensible belt; chords over two segments are longer where the road bends it flat, its tension is not."""
    ring = replace(RING, extension_stiffness_n=4e8)
    fine = loaded_belt(solve_rolling_ring(ring, 4500.0, 2.2e5, OMEGA_RADPS, nodes=3 * NODES))
    whole, half = (
        local_response(belt, OMEGA_RADPS, 2e-5, 0.003, (change,), (count,))[0, 0, 0] for belt in (fine, fine.coarser())
    )
    assert np.linalg.norm(half - whole[:, ::2]) < 0.03 * np.linalg.norm(whole[:, ::2])


def test_tread_all_around_is_an_axle_that_is_lower() -> None:
    tread, rim = response(Change.TREAD)[0], response(Change.RIM)[0]
    assert np.abs(tread + rim).max() < 1e-7 * np.abs(rim).max()


def test_mass_all_around_changes_nothing_of_an_inextensible_belt() -> None:
    everywhere, once = np.abs(response(Change.MASS)[[0, 2]]).max(axis=(1, 2))
    assert everywhere < 1e-4 * once


def test_push_of_tread_blocks_is_answered_as_their_stiffness_is() -> None:
    current, blocks = belt(), TreadBlocks(7.0, 3.5, 3e-5, 3e-5)
    grid = ring_grid(NODES)
    push = belt_balance(current.law, grid, current.state, current.height_m, current.traction).road.force_npm
    forces = push * current.law.radius_m * grid.step_rad * np.exp(7j * grid.theta_rad)[:, None]
    result = pushed_response(current, blocks, OMEGA_RADPS, forces[None], np.zeros(1), 0.004)[0, 0]
    reference = block_response(current, blocks, OMEGA_RADPS, 0.004).signal
    assert np.abs(result - reference).max() < 1e-6 * np.abs(reference).max()


def test_response_to_another_damper_follows_from_terms_at_the_usual_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """The lowest waves are near resonance, where a tenth less of a damper is a tenth more of a response."""
    value, first, second = local_response(
        belt(), OMEGA_RADPS, 1e-6, 0.0, (Change.RIM,), (2, 6, 12), slopes=Slope.DAMPING
    )
    usual = module._SIDEWALL_RATIO
    for ratio in (0.033, 0.05):
        z = usual / ratio - 1.0
        monkeypatch.setattr(module, "_SIDEWALL_RATIO", ratio)
        exact = local_response(belt(), OMEGA_RADPS, 1e-6, 0.0, (Change.RIM,), (2, 6, 12))[0]
        error = np.linalg.norm(value + z * first + z * z * second - exact) / np.linalg.norm(exact - value)
        assert error < 0.05
        assert np.linalg.norm(exact - value) > 0.02 * np.linalg.norm(exact)


@pytest.mark.parametrize("change", list(Change))
def test_response_of_a_heavier_belt_follows_from_its_slope(change: Change) -> None:
    """A percent more mass changes a response by up to a sixth."""
    value, slope = local_response(belt(), OMEGA_RADPS, 2e-5, 0.003, (change,), (2, 17, 40), slopes=Slope.MASS)
    for x in (-2e-3, 1e-3):
        exact = local_response(belt(), OMEGA_RADPS, 2e-5, 0.003, (change,), (2, 17, 40), log_mass=x)[0]
        changed = np.linalg.norm(exact - value)
        assert np.linalg.norm(value + x * slope - exact) < 0.05 * changed
        assert changed > 1e-3 * np.linalg.norm(exact)
