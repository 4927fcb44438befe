"""Sensor nonlinearity: against samples changed one by one, and its separation from scaling effects."""

import numpy as np
import pytest

from gateway.closure.effects.effect import RADIAL, GroupConditions
from gateway.closure.inference.findings import fitted_parameter
from gateway.types import FloatArray
from gateway.views.report.quantities import show_fitted
from tests.closure.planted_campaign import (
    TWO_SPEEDS,
    Plant,
    among,
    campaign_of,
    conditions,
    gain,
    larger_belt,
    searched,
)
from tests.closure.sensor_data import OMEGA, applied, at_angles, block_of, plan_of, rms, samples, tail

NAME = "sensor nonlinearity"
EFFECTS = among(NAME, "gain", "rolling radius", "run-out", "clipping", "zero-g offset")
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
    block = block_of(speed_kmh)
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
    posterior, search = searched(campaign_of(groups, bent(square, cube)), EFFECTS)
    assert posterior.identified() == (NAME,)
    fit = posterior.best.fit
    assert fit.misfit < 1.05 * search.data.size
    where = fit.model.layout.effect(NAME)
    std = np.sqrt(np.diagonal(fit.covariance))[where]
    assert np.all(np.abs(fit.vector[where] - [square, cube]) < 4.0 * std)


@pytest.mark.parametrize(("plant", "name"), [(gain, "gain"), (larger_belt, "rolling radius")])
def test_scaling_effects_are_not_taken_for_nonlinearity(plant: Plant, name: str) -> None:
    posterior, _ = searched(campaign_of(TWO_SPEEDS, plant), EFFECTS)
    assert name in posterior.best.names | set(*posterior.alternatives())
    assert posterior.probability([NAME]) < 0.05


def test_two_scaling_effects_together_are_not_taken_for_nonlinearity() -> None:
    """At two speeds and two temperatures the nonlinearity alone explains what a gain and its drift do."""
    groups = (conditions(48.0, temperature_degc=25.0), conditions(67.0, temperature_degc=63.0))

    def plant(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
        read = signal.copy()
        read[RADIAL] *= 1.005 + 5e-5 * (group_conditions.temperature_degc - 25.0)
        return read

    posterior, _ = searched(campaign_of(groups, plant), EFFECTS | among("gain-temperature drift"))
    assert posterior.best.names == {"rolling radius", "gain-temperature drift"}
    assert frozenset({"gain", "gain-temperature drift"}) in posterior.every
    assert posterior.probability([NAME]) < 0.5


def test_plausible_range_is_in_display_units() -> None:
    square, cube = EFFECTS[NAME].parameters
    assert square.high * 2000.0 == pytest.approx(0.03)
    assert cube.low * 2000.0**2 == pytest.approx(-0.03)
    assert square.high * square.factor == pytest.approx(1.5)
    assert cube.high * cube.factor == pytest.approx(0.75)
    shown = [show_fitted(term.name, fitted_parameter(term, term.high, 1e-3 * term.high)) for term in (square, cube)]
    assert [(number.label, number.unit) for number in shown] == [
        ("square", "% at 1000 m/s²"),
        ("cube", "% at 1000 m/s²"),
    ]
