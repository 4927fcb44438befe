"""Causes of the laws' rig: of laws that the library has, finite, and not without an effect."""

import itertools
import math

import numpy as np
import pytest
from law_rig.causes import belt_causes, chain_causes, outside_causes
from law_rig.unread_causes import unread_belt_causes, unread_chain_causes, unread_outside_causes

from gateway.diagnosis.effects.angle_orders import THETA
from gateway.diagnosis.effects.effect import GroupConditions
from gateway.diagnosis.laws.library import library

CONDITIONS = GroupConditions(55.0, 0.0, 0.31, 4500.0, 2.2e5, 25.0, 25.0, 9600.0, 0.0)
NAMES = set(library())


@pytest.mark.parametrize("seed", range(3))
def test_every_cause_changes_a_signal_and_stays_finite(seed: int) -> None:
    rng = np.random.default_rng(seed)
    # A contact with steep edges, which a slew limit needs.
    edge = np.exp(-(((np.abs(THETA) - 0.25) / 0.03) ** 2)) * np.sign(THETA)
    signal = np.array([300.0 * edge, 15.0 * np.cos(THETA), np.where(np.abs(THETA) < 0.25, 0.0, 900.0)])
    chains = (*chain_causes(rng), *unread_chain_causes(rng))
    assert {cause.law for cause in chains} <= NAMES
    assert all(math.isfinite(cause.size) and cause.size for cause in chains)
    faults = [(cause.name, cause.fault) for cause in chains]
    for name, fault in itertools.chain(faults, outside_causes(rng), unread_outside_causes(rng)):
        read = fault(signal, CONDITIONS)
        assert np.isfinite(read).all(), name
        assert np.abs(read - signal).max() > 1e-6, name


def test_changes_of_the_belt_are_of_laws_in_the_library() -> None:
    causes = (*belt_causes(), *unread_belt_causes())
    assert {cause.law for cause in causes} <= NAMES
    assert len({cause.name for cause in causes}) == len(causes)
    assert all(math.isfinite(cause.size) and cause.size for cause in causes)
