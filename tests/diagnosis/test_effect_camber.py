"""Undeclared camber: against the simulator, and beside the zero-g offset, which no rolling tire separates from it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gateway.core.reasons import Reason
from gateway.core.types import FloatArray
from gateway.diagnosis.effects.effect import LATERAL, GroupConditions
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.report.findings import findings_of
from tests.diagnosis.planted_campaign import ALL_AXES, TWO_SPEEDS, Plant, among, campaign_of, searched, sideways
from tests.diagnosis.sensor_data import G, applied, at_angles, block_of, plan_of, samples, tail

EFFECTS = among("camber", "zero-g offset", "roll tilt")


def on_all_axes(signal: FloatArray, theta: FloatArray, _: GroupConditions) -> FloatArray:
    return signal + np.array([[0.8], [0.5], [1.5]])


@pytest.mark.parametrize("camber_deg", [-5.0, 2.0])
def test_camber_matches_the_simulator(camber_deg: float) -> None:
    leaning, angle = tail(samples(plan_of(f"camber_deg = {camber_deg}")))
    plain, _ = tail(samples(plan_of()))
    block = block_of()
    added = applied(block, camber=(math.radians(camber_deg),)).signal_mps2 - block.signal_mps2
    expected = at_angles(added, angle)
    assert expected[:, LATERAL] == pytest.approx(G * math.sin(math.radians(camber_deg)))
    remainder = leaning - plain - expected
    # Two converters' steps of 0.075 m/s^2; the loss of gravity in the wheel's plane, g (1 - cos 5 deg), is as small.
    assert np.abs(remainder).max() < 0.15
    assert abs(float(remainder[:, LATERAL].mean())) < 0.06


def test_ac_coupled_sensor_does_not_pass_camber() -> None:
    block = block_of()
    ac = replace(block, conditions=replace(block.conditions, ac_coupled=True))
    assert not EFFECTS["camber"].contribution(ac, np.array([0.05])).any()  # type: ignore[union-attr]
    assert not EFFECTS["camber"].derivative(ac, np.array([0.05])).any()  # type: ignore[union-attr]


def test_lateral_constant_is_camber_or_zero_g_offset() -> None:
    """No rolling tire separates them; a recording at rest does."""
    posterior, _ = searched(campaign_of(TWO_SPEEDS, sideways(0.8), axes=ALL_AXES), EFFECTS)
    assert [set(group) for group in posterior.alternatives()] == [{"camber", "zero-g offset"}]
    for finding in findings_of(posterior, EFFECTS, {}):
        assert finding.decide_with == Reason(DiagnosisCode.RECORD_AGAIN, how="at_rest")


@pytest.mark.parametrize("plant", [sideways(2.0), on_all_axes], ids=["more than 6 deg", "on other axes too"])
def test_implausible_camber_is_a_zero_g_offset(plant: Plant) -> None:
    posterior, _ = searched(campaign_of(TWO_SPEEDS, plant, axes=ALL_AXES), EFFECTS)
    assert posterior.identified() == ("zero-g offset",)
    assert posterior.alternatives() == ()
