"""What a fit says of the tire: at the radius that it has, with errors that know of what is not decided."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.closure import closing, estimates, held_out
from gateway.closure.diagnose import diagnose
from gateway.closure.diagnosis import Verdict
from gateway.closure.effects.catalogue import catalogue
from gateway.closure.estimates import estimates_of
from gateway.closure.rivals import rivals_of
from gateway.physics.rolling_ring import RingParameters, solve_rolling_ring
from tests.closure.planted_campaign import (
    LOAD_N,
    ONE_SPEED,
    PRESSURE_PA,
    RADIUS_M,
    TWO_SPEEDS,
    among,
    campaign_of,
    fitted,
    gain,
    larger_belt,
    nothing,
    ring,
)

# Of `ring`, and the share by which `larger_belt` is larger.
TRUTH = {"Bs": 2.6e-3, "Cw": 0.21, "Rs": 2.6, "Ts": 2.2, "tread_stiffness_npm2": 6e7}
LARGER = 0.016
NUMBERS = ("Bs", "Cw", "Rs", "Ts")
RADIUS = among("rolling radius")["rolling radius"]


def test_the_same_waveform_means_stiffnesses_that_fall_with_the_radius_squared() -> None:
    """At the same load and pressure: the shape over R is the same, the contact's angle too."""
    factor = (1.0 + LARGER) ** -2
    plain, larger = (
        solve_rolling_ring(
            RingParameters.from_numbers(
                *(scale * TRUTH[name] for name in NUMBERS),
                radius_m=radius,
                pressure_pa=PRESSURE_PA,
                tread_stiffness_npm2=scale * TRUTH["tread_stiffness_npm2"],
            ),
            LOAD_N,
            PRESSURE_PA,
            55.0,
            nodes=720,
        )
        for radius, scale in ((RADIUS_M, 1.0), ((1.0 + LARGER) * RADIUS_M, factor))
    )
    assert larger.sensor.radial_m / (1.0 + LARGER) == pytest.approx(plain.sensor.radial_m, rel=1e-3)
    assert larger.half_angle_rad == pytest.approx(plain.half_angle_rad, rel=1e-5)


def test_with_a_larger_radius_the_numbers_are_those_of_the_larger_ring() -> None:
    fit, data = fitted(campaign_of(TWO_SPEEDS, larger_belt, noise_mps2=0.2), RADIUS)
    found, determined = estimates_of(fit, data)
    for name, truth in TRUTH.items():
        assert found[name].value == pytest.approx(truth, rel=0.01, abs=3.0 * found[name].std), name
        assert determined[name]
    # As good as those of a ring that has the stated radius.
    plain, _ = estimates_of(*fitted(campaign_of(TWO_SPEEDS, nothing, noise_mps2=0.2)))
    for name in NUMBERS[:3]:
        assert found[name].value == pytest.approx(plain[name].value, rel=0.004), name
    true_angle = ring(LOAD_N, (1.0 + LARGER) * RADIUS_M).half_angle_rad
    assert found["contact_half_angle_rad"].value == pytest.approx(true_angle, rel=2e-3)


def test_how_well_the_radius_is_known_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    fit, data = fitted(campaign_of(TWO_SPEEDS, larger_belt, noise_mps2=0.2), RADIUS)
    covariance = np.zeros((len(fit.vector), len(fit.vector)))
    place = fit.model.layout.effect("rolling radius").start
    covariance[place, place] = 0.01**2
    monkeypatch.setattr(estimates, "full_covariance", lambda *_: covariance)
    found, _ = estimates_of(fit, data)
    for name in TRUTH:
        assert found[name].std / found[name].value == pytest.approx(2.0 * 0.01 / (1.0 + LARGER), rel=0.01), name
    for name in ("Rs/Cw", "contact_half_angle_rad"):
        assert found[name].std < 1e-9 * found[name].value, name


def test_what_is_undecided_widens_the_error() -> None:
    effects = among("gain", "rolling radius")
    fit, data = fitted(campaign_of(ONE_SPEED, gain, noise_mps2=5.0), effects["gain"])
    rivals = rivals_of(fit, effects["gain"], effects, data)
    assert set(rivals) == {"rolling radius"}
    alone, _ = estimates_of(fit, data)
    found, determined = estimates_of(fit, data, [tuple(rivals.values())])
    other, _ = estimates_of(rivals["rolling radius"], data)
    for number in NUMBERS:
        apart = found[number].value - other[number].value
        assert found[number].value == alone[number].value
        assert found[number].std == pytest.approx(np.hypot(alone[number].std, apart))
        assert determined[number]
    # A radius 1 % larger makes stiffnesses 2 % smaller.
    assert other["Cw"].value / found["Cw"].value == pytest.approx(0.98, abs=0.005)


def test_a_diagnosis_widens_what_it_leaves_undecided(monkeypatch: pytest.MonkeyPatch) -> None:
    few = {name: catalogue()[name] for name in ("rolling radius", "sample clock error", "gain", "zero-g offset")}
    for module in (closing, held_out):
        monkeypatch.setattr(module, "candidates", lambda _model: few)
    diagnosis = diagnose(campaign_of(ONE_SPEED, larger_belt, noise_mps2=1.0))
    (finding,) = (f for f in diagnosis.findings if f.verdict is Verdict.INDISTINGUISHABLE)
    assert {finding.name, *finding.rivals} >= {"rolling radius", "sample clock error"}
    for name in NUMBERS:
        found = diagnosis.estimates_after[name]
        # Of a clock that runs fast the numbers are those of the stated radius, 3 % larger.
        assert found.std > 0.02 * found.value
        assert found.value == pytest.approx(TRUTH[name], abs=2.0 * found.std)
