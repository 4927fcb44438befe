"""The plan of the next recording against the diagnosis once that recording is made, on rings of their own."""

import json
import math
from collections.abc import Sequence
from functools import cache

import pytest

from gateway.closure.angle.number_estimates import estimates_of
from gateway.closure.angle.set_evidence import Evaluated
from gateway.closure.bayes.posterior import over
from gateway.closure.effects.effect import GroupConditions
from gateway.closure.model.closure_model import AngleEffect
from gateway.closure.result import Fitted
from gateway.closure.search.tempered_posterior import Posterior
from gateway.planning.next_recording import RecordingPlan, plan_recordings
from gateway.planning.wants import Want
from gateway.views.plans.recording_plan import recording_plan_json, recording_plan_lines
from tests.closure.planted_campaign import (
    ALL_AXES,
    BLOCKS,
    ONE_SPEED,
    REVOLUTIONS,
    Sideways,
    campaign_of,
    conditions,
    evaluated,
    sideways,
)

OMEGA = conditions().omega_radps
CONSTANT = Sideways("constant")
GROWING = Sideways("growing", lambda group_conditions: (group_conditions.omega_radps / OMEGA) ** 2)
RIVALS = CONSTANT, GROWING
# The plan's recordings last longer than those of the planted campaigns: the errors are compared at equal revolutions.
TURNS = BLOCKS * REVOLUTIONS


@cache
def evaluation(groups: tuple[GroupConditions, ...], noise_mps2: float, *effects: AngleEffect) -> Evaluated:
    campaign = campaign_of(groups, sideways(20.0), noise_mps2=noise_mps2, axes=ALL_AXES)
    return evaluated(campaign, *effects)[0]


def posterior_of(
    groups: tuple[GroupConditions, ...], effects: Sequence[AngleEffect], noise_mps2: float = 7.0
) -> tuple[Posterior, dict[str, Fitted]]:
    every = [evaluation(groups, noise_mps2, *chosen) for chosen in ((), *((effect,) for effect in effects))]
    posterior = over({each.names: each for each in every})
    return posterior, estimates_of([(each.fit, weight) for each, weight in posterior.considered])[0]


@cache
def plan_between_rivals() -> RecordingPlan:
    posterior, estimates = posterior_of(ONE_SPEED, RIVALS)
    return plan_recordings(posterior, estimates, speeds_mps=[30.0 / 3.6, 60.0 / 3.6])


def at_speed(plan: RecordingPlan, kmh: float) -> list:
    current = conditions()
    return [
        recording
        for recording in plan.recordings
        if math.isclose(3.6 * recording.speed_mps, kmh)
        and (recording.load_n, recording.pressure_pa, recording.is_reversed)
        == (current.load_n, current.pressure_pa, False)
    ]


def test_recording_at_the_speed_that_differs_decides_between_rivals() -> None:
    plan = plan_between_rivals()
    assert set(plan.open_effects) == {"constant", "growing"}
    (slow,), (same,) = at_speed(plan, 30.0), at_speed(plan, 60.0)
    assert slow.suffices
    assert slow.decided > 0.9
    assert plan.recordings[0] == slow
    assert not same.suffices
    assert same.decided < 0.1
    assert same.log_odds < 1.0 < slow.log_odds


def test_recording_that_suffices_names_the_effect_once_it_is_made() -> None:
    after, _ = posterior_of((conditions(60.0), conditions(30.0)), RIVALS)
    assert after.identified() == ("constant",)


def test_no_recording_decides_what_is_alike_everywhere() -> None:
    posterior, estimates = posterior_of(ONE_SPEED, (CONSTANT, Sideways("same")))
    plan = plan_recordings(posterior, estimates, speeds_mps=[30.0 / 3.6, 90.0 / 3.6])
    assert not any(recording.suffices for recording in plan.recordings)
    assert max(recording.decided for recording in plan.recordings) == 0.0
    assert list(recording_plan_lines(plan))[-1] == "  none of these suffices alone"


@pytest.mark.parametrize("kmh", [60.0, 30.0])
def test_expected_errors_are_those_after_the_recording(monkeypatch: pytest.MonkeyPatch, kmh: float) -> None:
    """Noise is large: the errors are of the scatter rather than of the discrepancy."""
    posterior, estimates = posterior_of(ONE_SPEED, (CONSTANT,), 30.0)
    duration_s = TURNS * 2.0 * math.pi / conditions(kmh).omega_radps
    monkeypatch.setattr("gateway.planning.next_recording.DURATIONS_S", (duration_s,))
    plan = plan_recordings(posterior, estimates, speeds_mps=[kmh / 3.6])
    (recording,) = at_speed(plan, kmh)
    assert recording.revolutions == TURNS
    _, made = posterior_of((conditions(60.0), conditions(kmh)), (CONSTANT,), 30.0)
    for name in ("Bs", "Cw", "Rs", "Ts"):
        assert recording.errors[name] < plan.errors[name] * (1.0 + 1e-9)
        assert recording.errors[name] == pytest.approx(made[name].std, rel=0.25)


def test_wanted_error_takes_the_least_duration_that_reaches_it() -> None:
    posterior, estimates = posterior_of(ONE_SPEED, (), 30.0)
    loose = plan_recordings(posterior, estimates, speeds_mps=[60.0 / 3.6])
    want = Want("Ts", 0.5 * loose.errors["Ts"])
    plan = plan_recordings(posterior, estimates, wants=[want], speeds_mps=[60.0 / 3.6])
    (recording,) = at_speed(plan, 60.0)
    assert not plan.open_effects
    assert recording.errors["Ts"] <= want.error or not recording.suffices
    assert recording.duration_s > 10.0
    document = json.loads(json.dumps(recording_plan_json(plan), allow_nan=False))
    assert document["wanted"] == {"Ts": want.error}
    assert document["recordings"][0]["log_odds"] is None
