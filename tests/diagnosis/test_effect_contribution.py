"""The correction table of named effects."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gateway.core.revolutions.effect_correction import CorrectionTable
from gateway.diagnosis.data.campaign_data import Block, Campaign, Group
from gateway.diagnosis.effects.angle_orders import ORDERS
from gateway.diagnosis.effects.catalogue import catalogue
from gateway.diagnosis.model.closure_model import ClosureModel
from gateway.diagnosis.model.exact_baseline import ExactCore
from gateway.diagnosis.report.effect_contribution import contribution_table
from gateway.diagnosis.result import Finding, Fitted, Verdict
from tests.diagnosis.belt_data import rolling_at

PITCH_RAD = 0.02


def group(speed_kmh: float, count: int, state: int = 0, *, reverse: bool = False) -> Group:
    conditions = replace(rolling_at(speed_kmh), reverse=reverse)
    block = Block(count, conditions, np.zeros((3, ORDERS), complex))
    return Group(f"{speed_kmh}", 0, state, conditions, (block,), np.ones((3, ORDERS)), 0.24)


def pitched(*groups: Group, found_rad: float = PITCH_RAD) -> tuple[Any, Finding]:
    """Return the fit of a pitched sensor on recordings of these conditions, and the finding."""
    campaign = Campaign("FL", ("synthetic",), groups, max(entry.state for entry in groups) + 1, {})
    model = ClosureModel(campaign, ExactCore(), [catalogue()["pitch tilt"]])  # type: ignore[list-item]
    vector, _ = model.layout.priors(model.core, model.effects)
    vector[model.layout.effect("pitch tilt")] = PITCH_RAD
    fit: Any = SimpleNamespace(model=model, vector=vector, covariance=1e-8 * np.eye(len(vector)))
    result = Finding(
        "pitch tilt",
        Verdict.NAMED,
        {"pitch_rad": Fitted(found_rad, 1e-3, "rad", 180.0 / np.pi, "deg")},
        100.0,
        90.0,
        9.0,
        5.0,
    )
    return fit, result


def table(*groups: Group) -> CorrectionTable:
    fit, result = pitched(*groups)
    made = contribution_table(fit, (result,))
    assert made is not None
    return made


def leak(made: CorrectionTable) -> float:
    """Return the mean that the radial axis leaves on the circumferential one, over R omega^2."""
    return float((made.orders_mps2[0, 0, 0].real) / (made.radius_m * made.omega_radps[0] ** 2))


def test_forward_recordings_are_preferred() -> None:
    made = table(group(60.0, 20), group(80.0, 10), group(90.0, 500, reverse=True))
    assert leak(made) == pytest.approx(np.sin(PITCH_RAD), rel=0.02)
    # The reverse recording's speed was not recorded forward.
    assert made.omega_range_radps[1] == pytest.approx(1.1 * rolling_at(80.0).omega_radps)


def test_forward_state_is_preferred() -> None:
    made = table(group(60.0, 20, state=0), group(90.0, 500, state=1, reverse=True))
    assert made.omega_range_radps[1] == pytest.approx(1.1 * rolling_at(60.0).omega_radps)
    assert leak(made) > 0.0


def test_reverse_only_uses_sensor_axes() -> None:
    made = table(group(60.0, 20, reverse=True))
    # As glued, the radial axis leaks into +circumferential whichever way the wheel turns.
    assert leak(made) == pytest.approx(np.sin(PITCH_RAD), rel=0.02)
