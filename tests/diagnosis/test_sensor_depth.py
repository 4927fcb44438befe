"""Sensors below the neutral layer, on a soft bond, or not linear, against planted samples, and what confounds them."""

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.types import ComplexArray, FloatArray
from gateway.diagnosis.bayes.parameter_estimates import fitted_parameter
from gateway.diagnosis.effects.axis_errors import GainBelowZero
from gateway.diagnosis.effects.belt_geometry import relative_curvature, relative_offset
from gateway.diagnosis.effects.effect import CIRCUMFERENTIAL, FIELD_SIZE, LATERAL, RADIAL, GroupConditions
from gateway.diagnosis.effects.lateral_response import Load, Stiffness, unit_response
from gateway.diagnosis.views.quantities import show_fitted
from gateway.forces.lateral_belt import LateralBelt, LateralSolution, solve_lateral_belt
from gateway.ring.rolling_ring.sensor_waveform import sensor_waveform
from tests.diagnosis.belt_data import RADIUS_M as BELT_RADIUS_M
from tests.diagnosis.belt_data import TIRE, block_of
from tests.diagnosis.planted_campaign import (
    ALL_AXES,
    PLANE,
    RADIUS_M,
    TWO_SPEEDS,
    Plant,
    among,
    campaign_of,
    conditions,
    fitted,
    gain,
    larger_belt,
    nothing,
    ring,
    searched,
)
from tests.diagnosis.sensor_data import OMEGA, applied, at_angles, plan_of, rms, samples, tail
from tests.diagnosis.sensor_data import block_of as sampled_block

DEPTHS_M = (0.0, 4e-3, 8e-3, 12e-3)
# A belt whose stiffnesses differ from a car tire's, which the effects start from.
BELT = LateralBelt(bending_stiffness_nm2=1.4e3, sidewall_stiffness_npm2=2e5, tread_stiffness_npm2=1e7)
TRUE = np.array([BELT.coupling_length_m, math.log(1.4), math.log(0.8), math.log(1.25)])


@lru_cache(maxsize=1)
def lateral() -> LateralSolution:
    return solve_lateral_belt(ring(), BELT)


def at_depth(depth_m: float) -> Plant:
    """Return what a sensor at a depth reads; its lateral axis reads the same at any depth."""
    wave = sensor_waveform(ring().position_m, RADIUS_M, depth_m)

    def plant(signal: FloatArray, theta: FloatArray, conditions: GroupConditions) -> FloatArray:
        square, read = conditions.omega_radps**2, np.zeros_like(signal)
        read[RADIAL] = square * wave.radial_m + STANDARD_GRAVITY_MPS2 * wave.gravity_radial
        read[CIRCUMFERENTIAL] = square * wave.circumferential_m + STANDARD_GRAVITY_MPS2 * wave.gravity_circumferential
        read[LATERAL] = square * lateral().lateral_m
        return read

    return plant


@pytest.mark.parametrize("as_paper", [False, True])
@pytest.mark.parametrize("depth_m", DEPTHS_M)
def test_curvature_is_the_neutral_layers(depth_m: float, as_paper: bool) -> None:
    position, plain = block_of(offset_m=depth_m), block_of()
    if as_paper:
        nothing = np.zeros(FIELD_SIZE)
        radial, along = position.shape.radial_m, position.shape.circumferential_m
        position = replace(position, shape=type(position.shape)(radial - radial.mean(), along, *(nothing,) * 4))
    neutral = plain.shape.radial_m / BELT_RADIUS_M
    assert relative_curvature(position) == pytest.approx(neutral, abs=2e-3)
    # Belt extension stretches what the sensor reads.
    strain = position.conditions.load_n / TIRE.extension_stiffness_n
    assert relative_offset(position) * BELT_RADIUS_M == pytest.approx(depth_m, abs=strain * BELT_RADIUS_M)


@pytest.mark.parametrize("load", Load)
def test_lateral_response_does_not_depend_on_depth(load: Load) -> None:
    shallow, deep = (unit_response(block_of(offset_m=depth), load, Stiffness()) for depth in (0.0, 12e-3))
    assert deep.lateral_m == pytest.approx(shallow.lateral_m, abs=1e-3 * np.abs(shallow.lateral_m).max())


@pytest.mark.parametrize("declared", [True, False])
@pytest.mark.parametrize("depth_m", DEPTHS_M)
def test_ply_steer_is_recovered_at_any_depth(depth_m: float, declared: bool) -> None:
    made = campaign_of(TWO_SPEEDS, at_depth(depth_m), axes=ALL_AXES)
    if declared:
        made = replace(made, groups=tuple(replace(group, declared_offset_m=depth_m) for group in made.groups))
        effects = among("ply steer")
    else:
        effects = among("mounting offset", "ply steer")
    fit, _ = fitted(made, *effects.values())
    std = np.sqrt(np.diagonal(fit.covariance))
    where = fit.model.layout.effect("ply steer")
    assert (np.abs(fit.vector[where] - TRUE) < 3.0 * std[where]).all()
    assert std[where][0] < 0.02 * TRUE[0]
    if not declared:
        offset = fit.model.layout.effect("mounting offset")
        assert abs(fit.vector[offset][0] - depth_m) < 3.0 * std[offset][0]


BOND_EFFECTS = among("mounting resonance", "anti-alias filter", "mounting offset")


def filtered(gain: ComplexArray, signal: FloatArray) -> FloatArray:
    return np.asarray(np.fft.irfft(np.fft.rfft(signal) * gain, n=signal.shape[1]))


def hz_of(signal: FloatArray, conditions: GroupConditions) -> FloatArray:
    return np.arange(signal.shape[1] // 2 + 1) * conditions.omega_radps / (2.0 * math.pi)


def soft_bond(resonance_hz: float, quality: float) -> Plant:
    """Return a mass on a spring with viscous damping, m z'' = k (y - z) + c (y' - z'), on all axes."""

    def plant(signal: FloatArray, theta: FloatArray, conditions: GroupConditions) -> FloatArray:
        x = hz_of(signal, conditions) / resonance_hz
        return filtered((1.0 + 1j * x / quality) / (1.0 - x * x + 1j * x / quality), signal)

    return plant


def butterworth(corner_hz: float) -> Plant:
    def plant(signal: FloatArray, theta: FloatArray, conditions: GroupConditions) -> FloatArray:
        x = hz_of(signal, conditions) / corner_hz
        # The contact centre is found behind the filter, as late as the low orders are.
        return filtered(np.exp(1j * math.sqrt(2.0) * x) / (1.0 - x * x + 1j * math.sqrt(2.0) * x), signal)

    return plant


@pytest.mark.parametrize(("resonance_hz", "quality"), [(800.0, 12.0), (1500.0, 10.0)])
def test_soft_bond_is_named_with_its_resonance(resonance_hz: float, quality: float) -> None:
    campaign = campaign_of(TWO_SPEEDS, soft_bond(resonance_hz, quality), axes=PLANE, noise_mps2=0.3)
    posterior, _ = searched(campaign, BOND_EFFECTS)
    assert posterior.identified() == ("mounting resonance",)
    fit = posterior.best.fit
    where = fit.model.layout.effect("mounting resonance")
    mass_over_stiffness_s2, ratio, _ = fit.vector[where]
    assert 0.5 / math.pi / math.sqrt(mass_over_stiffness_s2) == pytest.approx(resonance_hz, rel=0.1)
    assert ratio == pytest.approx(1.0, abs=0.15)


def test_low_pass_is_no_resonance() -> None:
    posterior, _ = searched(campaign_of(TWO_SPEEDS, butterworth(700.0), axes=PLANE, noise_mps2=0.3), BOND_EFFECTS)
    assert posterior.identified() == ("anti-alias filter",)


def test_firm_bond_has_no_resonance() -> None:
    posterior, _ = searched(campaign_of(TWO_SPEEDS, nothing, axes=PLANE), BOND_EFFECTS)
    assert posterior.identified() == ()
    assert posterior.probability(["mounting resonance"]) < 0.1


NAME = "sensor nonlinearity"
NONLINEAR_EFFECTS = among(NAME, "gain", "rolling radius", "run-out", "clipping", "zero-g offset")
# One percent at 2000 m/s^2 each.
SQUARE, CUBE = 0.01 / 2000.0, 0.01 / 2000.0**2
THREE_LOADS = tuple(conditions(load_n=load_n) for load_n in (3500.0, 4500.0, 5500.0))


def bent(square: float, cube: float) -> Plant:
    def plant(signal: FloatArray, theta: FloatArray, _: GroupConditions) -> FloatArray:
        read = signal.copy()
        read[RADIAL] += square * signal[RADIAL] ** 2 + cube * signal[RADIAL] ** 3
        return read

    return plant


@pytest.mark.parametrize(("square", "cube"), [(SQUARE, 0.0), (0.0, -CUBE), (-SQUARE, 2.0 * CUBE)])
@pytest.mark.parametrize("speed_kmh", [45.0, 65.0])
def test_nonlinearity_matches_samples_changed_one_by_one(square: float, cube: float, speed_kmh: float) -> None:
    plain, angle = tail(samples(plan_of(speed_kmh=speed_kmh)), OMEGA * speed_kmh / 65.0)
    read = plain[:, RADIAL] * (1.0 + plain[:, RADIAL] * (square + cube * plain[:, RADIAL]))
    block = sampled_block(speed_kmh)
    added = applied(block, sensor_nonlinearity=(square, cube)).signal_mps2 - block.signal_mps2
    expected = at_angles(added, angle)
    assert rms(read - plain[:, RADIAL] - expected[:, RADIAL]) < 5e-3 * rms(expected[:, RADIAL])
    assert not expected[:, :RADIAL].any()


@pytest.mark.parametrize(
    ("groups", "square", "cube"), [(TWO_SPEEDS, SQUARE, 0.0), (THREE_LOADS, 0.0, -CUBE)], ids=["square", "cube"]
)
def test_nonlinearity_is_separated_from_scaling_effects(
    groups: tuple[GroupConditions, ...], square: float, cube: float
) -> None:
    """One speed is enough: the shares of overshoot and free arc differ."""
    posterior, search = searched(campaign_of(groups, bent(square, cube)), NONLINEAR_EFFECTS)
    assert posterior.identified() == (NAME,)
    fit = posterior.best.fit
    assert fit.misfit < 1.05 * search.data.size
    where = fit.model.layout.effect(NAME)
    std = np.sqrt(np.diagonal(fit.covariance))[where]
    assert np.all(np.abs(fit.vector[where] - [square, cube]) < 4.0 * std)


@pytest.mark.parametrize(("plant", "name"), [(gain, "gain"), (larger_belt, "rolling radius")])
def test_scaling_effects_are_not_taken_for_nonlinearity(plant: Plant, name: str) -> None:
    posterior, _ = searched(campaign_of(TWO_SPEEDS, plant), NONLINEAR_EFFECTS)
    assert name in posterior.best.names | set(*posterior.alternatives())
    assert posterior.probability([NAME]) < 0.05


def test_two_scaling_effects_together_are_not_taken_for_nonlinearity() -> None:
    """At two speeds and two temperatures the nonlinearity alone explains what a gain and its drift do."""
    groups = (conditions(48.0, temperature_degc=25.0), conditions(67.0, temperature_degc=63.0))

    def plant(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
        read = signal.copy()
        read[RADIAL] *= 1.005 + 5e-5 * (group_conditions.temperature_degc - 25.0)
        return read

    posterior, _ = searched(campaign_of(groups, plant), NONLINEAR_EFFECTS | among("gain-temperature drift"))
    assert posterior.best.names == {"rolling radius", "gain-temperature drift"}
    assert frozenset({"gain", "gain-temperature drift"}) in posterior.every
    assert posterior.probability([NAME]) < 0.5


def test_plausible_range_is_in_display_units() -> None:
    square, cube = NONLINEAR_EFFECTS[NAME].parameters
    assert square.high * 2000.0 == pytest.approx(0.03)
    assert cube.low * 2000.0**2 == pytest.approx(-0.03)
    assert square.high * square.factor == pytest.approx(1.5)
    assert cube.high * cube.factor == pytest.approx(0.75)
    shown = [show_fitted(term.name, fitted_parameter(term, term.high, 1e-3 * term.high)) for term in (square, cube)]
    assert [(number.label, number.unit) for number in shown] == [
        ("square", "% at 1000 m/s²"),
        ("cube", "% at 1000 m/s²"),
    ]


def test_depth_that_the_recordings_measured_is_free() -> None:
    # What import measured is off by a fault of the axis itself; nothing states the depth.
    depth_m, share = 8e-3, 0.06

    def lopsided(signal: FloatArray, theta: FloatArray, conditions: GroupConditions) -> FloatArray:
        read = at_depth(depth_m)(signal, theta, conditions)
        read[CIRCUMFERENTIAL] -= share * np.minimum(read[CIRCUMFERENTIAL], 0.0)
        return read

    made = campaign_of(TWO_SPEEDS, lopsided, axes=ALL_AXES)
    measured = tuple(
        replace(
            group,
            declared_offset_m=7.75e-3,
            conditions=replace(group.conditions, offset_measured=True),
            blocks=tuple(
                replace(block, conditions=replace(block.conditions, offset_measured=True)) for block in group.blocks
            ),
        )
        for group in made.groups
    )
    error = GainBelowZero(CIRCUMFERENTIAL, 1)
    fit, _ = fitted(replace(made, groups=measured), error)
    where = fit.model.layout.sensor
    depth_std_m = math.sqrt(float(fit.covariance[where, where][0, 0]))
    assert 7.75e-3 + float(fit.vector[where][0]) == pytest.approx(depth_m, abs=3.0 * depth_std_m + 2e-5)
    assert float(fit.vector[fit.model.layout.effect(error.name)][0]) == pytest.approx(-share, rel=0.05)
