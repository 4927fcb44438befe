"""Damping from the phases of a linear ring under a symmetric contact pressure."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.estimators.sidewall_damping import SidewallDamping, sidewall_damping
from gateway.physics.belt_shape import MAX_ORDER
from gateway.physics.reference_tire import TABLE_3_NUMBERS
from gateway.physics.ring_series import modal_stiffness

NUMBERS = np.array(TABLE_3_NUMBERS)
ORDERS = np.arange(MAX_ORDER + 1, dtype=np.float64)
STIFFNESS = modal_stiffness(ORDERS, NUMBERS.tolist())
SIDEWALL = ORDERS * (ORDERS**2 + 1.0) / STIFFNESS
BENDING = ORDERS * modal_stiffness(ORDERS, [float(NUMBERS[0]), 0.0, 0.0, 0.0]) / STIFFNESS
UNDAMPED = 100.0 * np.exp(-((ORDERS / 12.0) ** 2))
MOST = 16


def fitted(sidewall: float, bending: float) -> SidewallDamping:
    damped = UNDAMPED / (1.0 + 1j * (sidewall * SIDEWALL + bending * BENDING))
    found = sidewall_damping(damped, NUMBERS, MAX_ORDER)
    assert found is not None
    return found


def even_error(found: SidewallDamping, sidewall: float, bending: float) -> np.ndarray:
    damped = UNDAMPED / (1.0 + 1j * (sidewall * SIDEWALL + bending * BENDING))
    return (damped.real + found.correction - UNDAMPED)[2:MOST]


def test_sidewall_damping_is_found_and_taken_away() -> None:
    found = fitted(0.01, 0.0)
    assert found.damping == pytest.approx(0.01)
    assert np.abs(even_error(found, 0.01, 0.0)).max() < 1e-9
    assert np.abs(found.by_bending).max() < 1e-9


def test_bending_damping_shows_in_the_error() -> None:
    found = fitted(0.01, 0.004)
    left = even_error(found, 0.01, 0.004)
    assert np.abs(left).max() > 1e-3
    assert (left + found.by_bending[2:MOST]) == pytest.approx(np.zeros(MOST - 2), abs=1e-9)
