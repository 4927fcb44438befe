"""Signals that are not those of a ring: nothing of them determines a number."""

import numpy as np
import pytest

from gateway.core.types import FloatArray
from gateway.diagnosis.angle.residual import left_shares
from gateway.diagnosis.closed_loop import diagnose
from gateway.diagnosis.effects.effect import CIRCUMFERENTIAL, LATERAL, RADIAL, GroupConditions
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.views.phrases import why_undetermined
from tests.diagnosis.planted_campaign import ALL_AXES, ONE_SPEED, RADIUS_M, Plant, campaign_of, fitted, nothing, turned


def dip(signal: FloatArray, theta: FloatArray, conditions: GroupConditions) -> FloatArray:
    """A smooth dip of 0.2 rad and a slope of its own: a half angle and a tread fit it, but no ring does."""
    steady = conditions.omega_radps**2 * RADIUS_M
    bell = np.exp(-0.5 * (theta / 0.2) ** 2)
    read = np.zeros_like(signal)
    read[RADIAL] = steady * (1.0 - bell)
    read[CIRCUMFERENTIAL] = -0.5 * steady * theta * bell
    return read


@pytest.mark.parametrize("plant", [nothing, turned(LATERAL, 0.1)])
def test_ring_leaves_little(plant: Plant) -> None:
    """The lateral axis does not count: the ring's numbers do not rest on it."""
    fit, data = fitted(campaign_of(ONE_SPEED, plant, axes=ALL_AXES))
    assert max(left_shares(fit, data)) < 0.01


def test_nothing_is_determined_by_another_signal() -> None:
    diagnosis = diagnose(campaign_of(ONE_SPEED, dip, noise_mps2=0.5), expired=lambda: True)
    (note,) = [note for note in diagnosis.notes if note.code is DiagnosisCode.NOT_A_RING]
    assert note["recordings"] == ("run 1",)
    assert not any(diagnosis.determined.values())
    assert not any(diagnosis.determined_before.values())
    assert why_undetermined(diagnosis, ["Cw"]) == "the signal is not that of a rolling tire's belt: see the notes"
