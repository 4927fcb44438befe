"""A sensor on a soft bond: found by its resonance, with viscous damping that the effect does not have."""

import math

import numpy as np
import pytest

from gateway.closure.effects.effect import GroupConditions
from gateway.types import ComplexArray, FloatArray
from tests.closure.planted_campaign import PLANE, TWO_SPEEDS, Plant, among, campaign_of, nothing, searched

EFFECTS = among("mounting resonance", "anti-alias filter", "mounting offset")


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
    posterior, _ = searched(campaign, EFFECTS)
    assert posterior.identified() == ("mounting resonance",)
    fit = posterior.best.fit
    where = fit.model.layout.effect("mounting resonance")
    mass_over_stiffness_s2, ratio, _ = fit.vector[where]
    assert 0.5 / math.pi / math.sqrt(mass_over_stiffness_s2) == pytest.approx(resonance_hz, rel=0.1)
    assert ratio == pytest.approx(1.0, abs=0.15)


def test_low_pass_is_no_resonance() -> None:
    posterior, _ = searched(campaign_of(TWO_SPEEDS, butterworth(700.0), axes=PLANE, noise_mps2=0.3), EFFECTS)
    assert posterior.identified() == ("anti-alias filter",)


def test_firm_bond_has_no_resonance() -> None:
    posterior, _ = searched(campaign_of(TWO_SPEEDS, nothing, axes=PLANE), EFFECTS)
    assert posterior.identified() == ()
    assert posterior.probability(["mounting resonance"]) < 0.1
