"""Recordings of different tires or loads under one statement, at speeds at which their contacts are not compared."""

from dataclasses import replace

import numpy as np
import pytest

from gateway.closure.closed_loop import diagnose
from gateway.closure.effects.effect import CIRCUMFERENTIAL, RADIAL, BaselineModel, GroupConditions
from gateway.closure.inference.recordings_apart import recordings_apart
from gateway.closure.model.baseline_registry import make_core
from gateway.reasons import Code
from gateway.types import FloatArray
from gateway.views.report.phrases import why_undetermined
from tests.closure.planted_campaign import (
    LOAD_N,
    TWO_SPEEDS,
    Plant,
    campaign_of,
    conditions,
    larger_belt,
    nothing,
    signal_of,
)

SLOW = conditions(30.0).omega_radps


def overloaded(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
    """The slow recording has a fifth more load than is stated."""
    return (
        signal_of(replace(group_conditions, load_n=1.2 * LOAD_N))
        if group_conditions.omega_radps < 1.1 * SLOW
        else signal
    )


def humming(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
    """Waves behind the contact that nothing in the catalogue explains, at the faster speed only."""
    read = signal.copy()
    if group_conditions.omega_radps > 1.1 * SLOW:
        wave = 20.0 * np.exp(-np.square((theta - 0.6) / 0.3)) * np.cos(40.0 * theta)
        read[RADIAL] += wave
        read[CIRCUMFERENTIAL] += 0.4 * wave
    return read


@pytest.mark.parametrize("plant", [nothing, larger_belt, humming])
def test_one_tire_is_not_apart(plant: Plant) -> None:
    assert recordings_apart(campaign_of(TWO_SPEEDS, plant), make_core(BaselineModel.EXACT)) == []


def test_wrong_load_at_another_speed_is_apart() -> None:
    (apart,) = recordings_apart(campaign_of(TWO_SPEEDS, overloaded), make_core(BaselineModel.EXACT))
    # The numbers are over the stated load.
    assert (apart.low_recording, apart.high_recording) == (1, 0)
    assert apart.low.value == pytest.approx(apart.high.value / 1.2, rel=0.02)


def test_recordings_apart_determine_nothing() -> None:
    diagnosis = diagnose(campaign_of(TWO_SPEEDS, overloaded), expired=lambda: True)
    (note,) = [note for note in diagnosis.notes if note.code is Code.NUMBERS_CONTRADICT]
    assert (note["recording"], note["other"]) == ("run 2", "run 1")
    assert not any(diagnosis.determined.values())
    assert why_undetermined(diagnosis, ["Cw"]) == "the recordings contradict each other: see the notes"
