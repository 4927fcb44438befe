"""Belt curvature behind a sensor below the neutral layer, and the lateral loads that it bends."""

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from gateway.closure.effects.belt_geometry import relative_curvature, relative_offset
from gateway.closure.effects.effect import CIRCUMFERENTIAL, FIELD_SIZE, LATERAL, RADIAL, GroupConditions
from gateway.closure.model.lateral_response import Load, Stiffness, unit_response
from gateway.constants import STANDARD_GRAVITY_MPS2
from gateway.physics.lateral_belt import LateralBelt, LateralSolution, solve_lateral_belt
from gateway.physics.rolling_ring.sensor_waveform import sensor_waveform
from gateway.types import FloatArray
from tests.closure.belt_data import RADIUS_M as BELT_RADIUS_M
from tests.closure.belt_data import TIRE, block_of
from tests.closure.planted_campaign import ALL_AXES, RADIUS_M, TWO_SPEEDS, Plant, among, campaign_of, fitted, ring

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
