"""Experiment design: the recording that distinguishes two explanations."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from gateway.core.reasons import Reason
from gateway.core.types import FloatArray
from gateway.diagnosis.angle.fit import Fit
from gateway.diagnosis.effects.effect import CIRCUMFERENTIAL, LATERAL, RADIAL, GroupConditions, ModelledBlock
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.report.experiment_design import NOTHING, deciding_recording
from tests.diagnosis.planted_campaign import (
    ALL_AXES,
    BLOCKS,
    LOAD_N,
    ONE_SPEED,
    PRESSURE_PA,
    REVOLUTIONS,
    WARM,
    Plant,
    Sideways,
    among,
    campaign_of,
    conditions,
    drift,
    evaluated,
    fast_clock,
    fitted,
    gain,
    larger_belt,
    ring,
    sideways,
    turned,
    with_lateral_means,
)

OMEGA = conditions().omega_radps
NOISY = 7.0
SPEED_SQUARED: Callable[[GroupConditions], float] = lambda group_conditions: (group_conditions.omega_radps / OMEGA) ** 2  # noqa: E731
SLOWER = Reason(DiagnosisCode.RECORD_AGAIN, how="ratio", quantity="speed", ratio=0.25)
FASTER = Reason(DiagnosisCode.RECORD_AGAIN, how="ratio", quantity="speed", ratio=1.5)
REVERSED = Reason(DiagnosisCode.RECORD_AGAIN, how="reversed")
WARMER = Reason(DiagnosisCode.RECORD_AGAIN, how="warmer", difference_k=20.0)
CASES: list[tuple[Callable[[GroupConditions], float], Reason]] = [
    # At a quarter of the speed it vanishes; a true effect is largest at the highest speed.
    (SPEED_SQUARED, SLOWER),
    (
        lambda group_conditions: 1.0 if group_conditions.omega_radps != 0.6 * OMEGA else -3.0,
        Reason(DiagnosisCode.RECORD_AGAIN, how="ratio", quantity="speed", ratio=0.6),
    ),
    (lambda group_conditions: -1.0 if group_conditions.reverse else 1.0, REVERSED),
    (lambda group_conditions: (group_conditions.temperature_degc - 5.0) / 20.0, WARMER),
    (
        lambda group_conditions: group_conditions.load_n / LOAD_N,
        Reason(DiagnosisCode.RECORD_AGAIN, how="ratio", quantity="load", ratio=1.4),
    ),
    (
        lambda group_conditions: group_conditions.pressure_pa / PRESSURE_PA,
        Reason(DiagnosisCode.RECORD_AGAIN, how="ratio", quantity="pressure", ratio=0.7),
    ),
]


@cache
def with_constant() -> tuple[Sideways, Fit]:
    """Return an effect that is the same everywhere, found in one recording."""
    constant = Sideways("constant")
    return constant, fitted(campaign_of(ONE_SPEED, sideways(3.0), axes=ALL_AXES), constant)[0]


@pytest.mark.parametrize(("goes_with", "recording"), CASES, ids=[str(reason.code) for _, reason in CASES])
def test_recording_at_the_condition_that_differs(
    goes_with: Callable[[GroupConditions], float], recording: Reason
) -> None:
    constant, fit = with_constant()
    assert deciding_recording(fit, constant, Sideways("other", goes_with)) == recording


@pytest.mark.parametrize(("size_mps2", "recording"), [(20.0, FASTER), (0.7, NOTHING)])
def test_faster_recording_decides_when_effect_grows(size_mps2: float, recording: Reason) -> None:
    """A weak effect is not resolved by one more recording, whatever its speed."""
    growing, constant = Sideways("growing", SPEED_SQUARED), Sideways("constant")
    fit, _ = fitted(campaign_of(ONE_SPEED, sideways(size_mps2), noise_mps2=NOISY, axes=ALL_AXES), growing)
    assert deciding_recording(fit, growing, constant) == recording


def test_most_informative_recording_is_chosen() -> None:
    """A warmer tire and the other direction both separate them; the direction is better."""
    constant, fit = with_constant()
    other = Sideways(
        "other",
        lambda group_conditions: (
            (group_conditions.temperature_degc - 5.0) / 20.0 * (-1.0 if group_conditions.reverse else 1.0)
        ),
    )
    assert deciding_recording(fit, constant, other) == REVERSED


@pytest.mark.parametrize(
    ("groups", "plant", "name", "rival", "recording"),
    [
        (WARM, gain, "gain", "gain-temperature drift", WARMER),
        (WARM, drift, "gain-temperature drift", "gain", WARMER),
        (ONE_SPEED, turned(LATERAL, 0.004), "roll tilt", "zero-g offset", FASTER),
        (ONE_SPEED, sideways(4.0), "zero-g offset", "roll tilt", SLOWER),
    ],
)
def test_pairs_of_the_catalogue(
    groups: tuple[GroupConditions, ...], plant: Plant, name: str, rival: str, recording: Reason
) -> None:
    effects = among(name, rival)
    fit, _ = fitted(campaign_of(groups, plant, noise_mps2=0.7 * NOISY, axes=ALL_AXES), effects[name])
    assert deciding_recording(fit, effects[name], effects[rival]) == recording


@pytest.mark.parametrize(
    ("plant", "name", "rival"),
    [
        (fast_clock, "sample clock error", "rolling radius"),
        (larger_belt, "rolling radius", "sample clock error"),
        (gain, "gain", "sample clock error"),
    ],
)
def test_clock_error_needs_another_clock(plant: Plant, name: str, rival: str) -> None:
    effects = among(name, rival)
    fit, _ = fitted(campaign_of(ONE_SPEED, plant), effects[name])
    result = deciding_recording(fit, effects[name], effects[rival])
    assert result == Reason(DiagnosisCode.RECORD_AGAIN, how="live")


@pytest.mark.parametrize(
    ("plant", "name", "rival", "noise_mps2"),
    [(gain, "gain", "rolling radius", 0.1), (larger_belt, "rolling radius", "gain", 0.25)],
)
def test_gravity_separates_gain_from_radius_when_slow(plant: Plant, name: str, rival: str, noise_mps2: float) -> None:
    """At speed a share of gravity is less than what their equations leave, a hundredth of what they add."""
    effects = among(name, rival)
    campaign = campaign_of((conditions(90.0),), plant, noise_mps2=noise_mps2)
    result, _ = evaluated(campaign, effects[name])
    assert deciding_recording(result.fit, effects[name], effects[rival]) == SLOWER


def test_conditions_start_from_the_largest_group() -> None:
    constant = Sideways("constant")
    other = Sideways("other", lambda group_conditions: -1.0 if group_conditions.temperature_degc == 45.0 else 1.0)
    two = conditions(temperature_degc=30.0), conditions()
    campaign = campaign_of(two, sideways(20.0), noise_mps2=NOISY, axes=ALL_AXES)
    results = []
    for more in range(2):
        groups = list(campaign.groups)
        blocks = groups[more].blocks
        groups[more] = replace(groups[more], blocks=tuple(replace(block, count=2 * block.count) for block in blocks))
        fit, _ = fitted(replace(campaign, groups=tuple(groups)), constant)
        results.append(deciding_recording(fit, constant, other))
    assert results == [NOTHING, WARMER]


class Stiffer(Sideways):
    """Change of the waveform by a softer radial sidewall, as if it were a sensor effect."""

    def derivative(self, group_conditions: ModelledBlock, parameters: FloatArray) -> FloatArray:
        row = np.zeros((1, *group_conditions.signal_mps2.shape))
        change = ring(rs=2.7).sensor.radial_m - ring().sensor.radial_m
        there = np.interp(group_conditions.theta_rad, ring().theta_rad, change)
        row[0, RADIAL] = (
            self.goes_with(group_conditions.conditions) * group_conditions.conditions.omega_radps**2 * there
        )
        return row


class TestUndecidable:
    def test_identical_effects_are_never_separated(self) -> None:
        """Nor beside another effect, which grows with the conditions; nor where there is hardly any noise."""
        true, twin, beside = Sideways("true"), Sideways("twin"), among("pitch tilt")["pitch tilt"]

        def both(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
            return sideways(3.0)(
                turned(CIRCUMFERENTIAL, 0.01)(signal, theta, group_conditions), theta, group_conditions
            )

        fit, _ = fitted(campaign_of(ONE_SPEED, both, noise_mps2=0.2, axes=ALL_AXES), true, beside)
        assert deciding_recording(fit, true, twin) == NOTHING

    def test_another_load_has_its_own_ring_parameters(self) -> None:
        """The state's own parameters absorb the change that resembles a stiffer sidewall."""
        true, other = Stiffer("true"), Stiffer("other", lambda group_conditions: group_conditions.load_n / LOAD_N)
        fit, _ = fitted(campaign_of(ONE_SPEED), true)
        position = fit.model.layout.effect("true").start
        fit = replace(fit, vector=np.where(np.arange(len(fit.vector)) == position, 6.0, fit.vector))
        assert deciding_recording(fit, true, other) == NOTHING

    def test_existing_evidence_is_not_counted(self) -> None:
        """The rival leaves 20 of 1000 in chi-square in two recordings; a third one adds 10, not 30.

        The blocks agree exactly, so the scatter counts half.
        """
        std = NOISY * (REVOLUTIONS * BLOCKS * 2) ** -0.5
        true, rival = Sideways("true"), Sideways("rival", bent=0.02**0.5)
        two = campaign_of((conditions(), conditions(time_s=60.0)), noise_mps2=NOISY, axes=ALL_AXES)
        fit, _ = fitted(with_lateral_means(two, [500.0**0.5 * std] * BLOCKS), true)
        without, _ = fitted(with_lateral_means(two, [500.0**0.5 * std] * BLOCKS), rival)
        assert without.misfit - fit.misfit == pytest.approx(20.0, rel=0.05)
        assert deciding_recording(fit, true, rival) == NOTHING
