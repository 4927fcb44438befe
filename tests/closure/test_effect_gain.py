"""Gains of the axes: that of the circumferential one is no depth, and sizes on the lateral axis go with its own."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from gateway.closure.effects.effect import CIRCUMFERENTIAL, RADIAL, GroupConditions
from gateway.closure.inference.findings import fitted_parameter
from gateway.types import FloatArray
from tests.closure.planted_campaign import TWO_SPEEDS, among, campaign_of, ring, searched

NAMES = ("circumferential gain", "mounting offset", "gain", "shear flexibility")
DEPTH_M, GAIN = 0.003, 0.05


def sensor(depth_m: float, gain: float) -> Callable[[FloatArray, FloatArray, GroupConditions], FloatArray]:
    """Return what a sensor below the neutral layer reads whose circumferential axis has a gain error."""

    def plant(signal: FloatArray, theta: FloatArray, conditions: GroupConditions) -> FloatArray:
        read = signal.copy()
        # V^2 kappa of the neutral layer, without gravity.
        bent = conditions.omega_radps**2 * ring(conditions.load_n).sensor.radial_m
        orders = np.fft.fftfreq(len(theta), 1.0 / len(theta))
        slope = np.fft.ifft(1j * orders * np.fft.fft(bent)).real
        share = depth_m / conditions.radius_m
        read[CIRCUMFERENTIAL] = (1.0 + gain) * (signal[CIRCUMFERENTIAL] - share * slope)
        read[RADIAL] -= share * np.square(bent) / (conditions.radius_m * conditions.omega_radps**2)
        return read

    return plant


@pytest.mark.parametrize(
    ("depth_m", "gain", "identified"),
    [
        (0.0, GAIN, {"circumferential gain"}),
        (DEPTH_M, 0.0, {"mounting offset"}),
        (DEPTH_M, GAIN, {"circumferential gain", "mounting offset"}),
    ],
)
def test_circumferential_gain_is_no_depth(depth_m: float, gain: float, identified: set[str]) -> None:
    """Gravity tells: it grows with the gain, but not with the depth."""
    posterior, _ = searched(campaign_of(TWO_SPEEDS, sensor(depth_m, gain), noise_mps2=0.3), among(*NAMES))
    assert set(posterior.identified()) == identified
    fit = posterior.best.fit
    for name, truth in (("circumferential gain", gain), ("mounting offset", depth_m)):
        if name in identified:
            where = fit.model.layout.effect(name)
            value, std = float(fit.vector[where][0]), math.sqrt(fit.covariance[where, where][0, 0])
            assert value == pytest.approx(truth, abs=3.0 * std), name
            assert std < 0.2 * truth, name


def test_gain_is_a_part_of_the_error_of_what_goes_with_it() -> None:
    for effect in among("ply steer", "conicity", "carcass compliance").values():
        size = effect.parameters[0]
        reference, unsure = (fitted_parameter(size, 2e-3, 3e-5, gain_std) for gain_std in (0.0, 0.02))
        assert reference.std == pytest.approx(3e-5)
        assert unsure.std == pytest.approx(5e-5)
    (offset,) = among("mounting offset")["mounting offset"].parameters
    assert fitted_parameter(offset, 2e-3, 3e-5, 0.02).std == pytest.approx(3e-5)
