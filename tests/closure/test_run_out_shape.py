"""Shape with run-out against shapes that were each solved under the load of their own angle."""

import math

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from gateway.closure.model.baseline import Shape, slopes, stepped
from gateway.closure.model.exact_baseline import ExactCore
from gateway.closure.model.ring_options import RingOptions
from gateway.closure.model.run_out_shape import LoadedShape, load_steps, out_of_round
from gateway.closure.model.sensor_signal import THETA
from tests.closure.sensor_data import CONDITIONS, rms

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
    change = expected - loaded[2].shape.waveform.radial_m
    assert rms(result - expected) < 2e-3 * rms(change)


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
