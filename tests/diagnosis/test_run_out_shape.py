"""Shapes of a tire that is out of round once or twice a turn, against shapes solved at each angle and exact rings.

The belt follows its equilibrium, which the linear answer of a vibrating ring comes down to at low speed.
"""

import math
from functools import lru_cache

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.types import ComplexArray, FloatArray
from gateway.diagnosis.effects.angle_orders import THETA
from gateway.diagnosis.effects.effect import CIRCUMFERENTIAL, RADIAL, GroupConditions
from gateway.diagnosis.effects.ring_options import RingOptions
from gateway.diagnosis.model.baseline import Shape, slopes, stepped
from gateway.diagnosis.model.exact_baseline import ExactCore
from gateway.diagnosis.model.run_out_shape import LoadedShape, load_steps, out_of_round
from tests.diagnosis.planted_campaign import NODES, RADIUS_M, among, campaign_of, conditions, nothing, ring, searched
from tests.diagnosis.sensor_data import CONDITIONS, rms

SWING_PM = 50.0


def shape_under(core: ExactCore, share: float) -> Shape:
    """Return the shape of the reference tire under a larger load by this share."""
    return core.shape(np.full(5, -math.log1p(share)), CONDITIONS, RingOptions(), 0.24)


@pytest.mark.parametrize(("height_mm", "phase_deg"), [(0.3, 0.0), (1.0, 40.0), (1.6, 180.0), (2.7, 300.0)])
def test_each_angle_has_the_shape_under_its_own_load(height_mm: float, phase_deg: float) -> None:
    core, height_m, phase_rad = ExactCore(), 1e-3 * height_mm, math.radians(phase_deg)
    cosine_m, sine_m = height_m * math.cos(phase_rad), height_m * math.sin(phase_rad)
    swing = SWING_PM * height_m
    shares = np.linspace(-swing, swing, 9)
    solved = np.stack([shape_under(core, float(share)).waveform.radial_m for share in shares])
    position = CubicSpline(shares, solved)(swing * np.cos(THETA - phase_rad))[
        np.arange(len(THETA)), np.arange(len(THETA))
    ]
    # An axle that sinks in proportion to the load.
    loaded = [LoadedShape(shape_under(core, share), 0.3 - share / SWING_PM) for share in load_steps(cosine_m, sine_m)]
    result = out_of_round(loaded, CONDITIONS.radius_m, cosine_m, sine_m).waveform.radial_m
    expected = position * (1.0 + cosine_m / CONDITIONS.radius_m)
    change = expected - loaded[len(loaded) // 2].shape.waveform.radial_m
    assert rms(result - expected) < 2e-3 * rms(change)


def test_shape_changes_smoothly_with_the_height() -> None:
    """Heights from 0.3 to 1.3 mm, with loads that swing by more and more: no second difference is far from others."""
    core = ExactCore()
    heights_m = 1e-3 * np.geomspace(0.3, 1.3, 49)
    shapes = np.stack(
        [
            core.shape(np.zeros(5), CONDITIONS, RingOptions(runout_sine_m=float(height_m)), 0.24).waveform.radial_m
            for height_m in heights_m
        ]
    )
    sizes = np.array([rms(second) for second in np.diff(shapes, 2, axis=0)])
    assert sizes.max() < 6.0 * np.median(sizes)


def test_derivatives_are_those_of_the_point_itself() -> None:
    """At a point near one whose derivatives are known: a fit would stop where those of its way lead it."""
    core, fresh = ExactCore(), ExactCore()
    near, point = np.zeros(5), np.full(5, 0.004)
    core.tangent(near, CONDITIONS, RingOptions(), 0.24)
    result = core.tangent(point, CONDITIONS, RingOptions(), 0.24)
    expected = fresh.tangent(point, CONDITIONS, RingOptions(), 0.24)
    for slope, other in zip(result, expected, strict=True):
        assert rms(slope.waveform.radial_m - other.waveform.radial_m) < 1e-6 * rms(other.waveform.radial_m)


OPTIONS = RingOptions(runout_cosine_m=-1.5e-3, runout_sine_m=4e-4)


def test_grid_error_is_measured_with_the_run_out() -> None:
    parameters, coarse, fine = np.zeros(5), ExactCore(), ExactCore((2880,))
    coarse.refine(parameters, CONDITIONS, OPTIONS)
    result = coarse.shape(parameters, CONDITIONS, OPTIONS, 0.24).waveform.radial_m
    expected = fine.shape(parameters, CONDITIONS, OPTIONS, 0.24).waveform.radial_m
    coarse.refine(parameters, CONDITIONS, RingOptions())
    as_round = coarse.shape(parameters, CONDITIONS, OPTIONS, 0.24).waveform.radial_m
    assert rms(result - expected) < 0.3 * rms(as_round - expected)


def test_derivatives_are_those_with_run_out() -> None:
    parameters, core = np.zeros(5), ExactCore()
    current = core.shape(parameters, CONDITIONS, OPTIONS, 0.24)
    there = [core.shape(item, CONDITIONS, OPTIONS, 0.24) for item in stepped(parameters, core.steps)]
    round_slopes = core.tangent(parameters, CONDITIONS, RingOptions(), 0.24)
    result = core.tangent(parameters, CONDITIONS, OPTIONS, 0.24)
    for expected, item, as_round in zip(slopes(current, there, core.steps), result, round_slopes, strict=True):
        wanted, got, plain = (item.waveform.radial_m for item in (expected, item, as_round))
        assert rms(got - wanted) < 0.01 * rms(wanted)
        assert rms(plain - wanted) > 0.03 * rms(wanted)


NAME = "run-out of order 2"
GROUPS = (conditions(10.0), conditions(14.0))
COSINE_M, SINE_M = 4e-4, -3e-4
EFFECTS = among(NAME, "torsional ripple", "imbalance and hub motion", "gain", "rolling radius")
_HIGHEST = 200


def derivatives(curve: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Return the first two derivatives of a closed curve (NODES,) by the angle."""
    order = np.fft.fftfreq(NODES, 1.0 / NODES)
    spectrum = np.where(np.abs(order) <= _HIGHEST, np.fft.fft(curve), 0.0)
    return np.fft.ifft(1j * order * spectrum), np.fft.ifft(-(order**2) * spectrum)


@lru_cache
def path(load_n: float) -> tuple[ComplexArray, ComplexArray]:
    """Return where each node is as it passes, and the belt's direction there, as complex numbers."""
    solved = [ring(round(factor * load_n)) for factor in np.linspace(0.95, 1.05, 7).tolist()]
    theta, middle = solved[0].theta_rad, solved[3].axle_height_m
    low_m = np.array([middle - s.axle_height_m for s in solved])
    belts = np.array([s.position_m[:, 0] + 1j * s.position_m[:, 1] for s in solved])
    slopes = np.array([derivatives(belt)[0] for belt in belts])
    high_m = COSINE_M * np.cos(2.0 * theta) + SINE_M * np.sin(2.0 * theta)
    weights = np.array(
        [math.prod((high_m - other) / (low - other) for other in low_m if other != low) for low in low_m]
    )
    along = (weights * slopes).sum(axis=0)
    return (weights * belts).sum(axis=0), along / np.abs(along)


def oval(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
    point, along = path(group_conditions.load_n)
    # The point itself rides on the radius that is larger by the height at the sensor.
    felt = (1.0 + COSINE_M / RADIUS_M) * group_conditions.omega_radps**2 * derivatives(point)[
        1
    ] + 1j * STANDARD_GRAVITY_MPS2
    read = signal.copy()
    read[RADIAL], read[CIRCUMFERENTIAL] = (felt * (1j * along).conj()).real, (felt * along.conj()).real
    return read


def test_oval_tire_is_run_out_of_order_2() -> None:
    posterior, _ = searched(campaign_of(GROUPS, oval, noise_mps2=0.02), EFFECTS)
    assert posterior.identified() == (NAME,)
    fit = posterior.best.fit
    cosine, sine = fit.vector[fit.model.layout.effect(NAME)].tolist()
    assert math.hypot(cosine - COSINE_M, sine - SINE_M) < 0.05 * math.hypot(COSINE_M, SINE_M)


def test_round_tire_has_none() -> None:
    posterior, _ = searched(campaign_of(GROUPS, nothing, noise_mps2=0.02), EFFECTS)
    assert posterior.identified() == ()
