"""A late axis, a long sensor and one with friction are no filter and no tire.

They are planted by interpolation in time, by means over points, and by the rate law of Dahl, which has no sharp turns.

Load and speed change together, so that a length, locked to the angle, and a filter, locked to frequency, are rivals.
"""

import math

import numpy as np
import pytest

from gateway.closure.effects.effect import CIRCUMFERENTIAL, GroupConditions
from gateway.types import FloatArray
from tests.closure.planted_campaign import RADIUS_M, Plant, among, campaign_of, conditions, searched
from tests.closure.test_effect_gain import sensor

GROUPS = (conditions(60.0, load_n=4500.0), conditions(90.0, load_n=3600.0))
DEPTH_M = 0.004
LATE_S, LENGTH_M, CORNER_HZ, FRICTION_MPS2 = 90e-6, 0.022, 531.0, 4.0
_POINTS, _HALVINGS, PRESLIDING = 65, 30, 30.0


def sampled_at(signal: FloatArray, theta: FloatArray, angle: FloatArray) -> FloatArray:
    """Return a periodic signal (3, n) at angles by linear interpolation."""
    return np.stack([np.interp(angle, theta, row, period=2.0 * math.pi) for row in signal])


def late(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
    """A circumferential axis that is read after the others."""
    read = signal.copy()
    read[CIRCUMFERENTIAL] = sampled_at(signal, theta, theta - group_conditions.omega_radps * LATE_S)[CIRCUMFERENTIAL]
    return read


def long(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
    """A board that reads the mean over points along its length."""
    reach = 0.5 * LENGTH_M / RADIUS_M * (1.0 - 1.0 / _POINTS)
    points = [sampled_at(signal, theta, theta + shift) for shift in np.linspace(-reach, reach, _POINTS)]
    return np.asarray(np.mean(points, axis=0))


def slow(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
    """A converter with a low-pass of two poles, stepped through time until it repeats."""
    step = float(theta[1] - theta[0]) / group_conditions.omega_radps * 2.0 * math.pi * CORNER_HZ
    read, value, rate = signal.copy(), signal[:, 0].copy(), np.zeros(3)
    for number in range(2 * len(theta)):
        rate += step * (signal[:, number % len(theta)] - value - math.sqrt(2.0) * rate)
        value = value + step * rate
        read[:, number % len(theta)] = value
    # The contact is timed behind the filter.
    return sampled_at(read, theta, theta + group_conditions.omega_radps * math.sqrt(2.0) / (2.0 * math.pi * CORNER_HZ))


def rubbing(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
    """An element held by friction that grows towards its limit with the element's own way (Dahl), way by way."""
    read = sensor(DEPTH_M, 0.0)(signal, theta, group_conditions)
    axis, force, moved = read[CIRCUMFERENTIAL].tolist(), 0.0, float(read[CIRCUMFERENTIAL, 0])
    for number in range(2 * len(axis)):
        change = axis[number % len(axis)] - moved - force
        limit, low, high = math.copysign(FRICTION_MPS2, change), 0.0, abs(change) + 2.0 * FRICTION_MPS2
        for _ in range(_HALVINGS):
            way = 0.5 * (low + high)
            held = limit + (force - limit) * math.exp(-way * PRESLIDING / FRICTION_MPS2)
            low, high = (way, high) if way + abs(held - force) < abs(change) else (low, way)
        moved, force = moved + math.copysign(way, change), held
        read[CIRCUMFERENTIAL, number % len(axis)] = moved
    return read


def below(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
    """A late axis of a sensor below the neutral layer, whose circumferential axis is not gravity alone."""
    return late(sensor(DEPTH_M, 0.0)(signal, theta, group_conditions), theta, group_conditions)


@pytest.mark.parametrize(
    ("plant", "name", "size"),
    [
        (below, "circumferential delay", LATE_S),
        (long, "sensor length", LENGTH_M),
        (slow, "anti-alias filter", 1.0 / CORNER_HZ),
        (rubbing, "circumferential hysteresis", FRICTION_MPS2),
    ],
)
def test_cause_is_identified_beside_its_rivals(plant: Plant, name: str, size: float) -> None:
    rivals = (
        "circumferential delay",
        "sensor length",
        "anti-alias filter",
        "circumferential hysteresis",
        "mounting offset",
    )
    posterior, _ = searched(campaign_of(GROUPS, plant, noise_mps2=0.5), among(*rivals))
    identified = set(posterior.identified()) - {"mounting offset"}
    assert identified == {name}
    fit = posterior.best.fit
    assert float(fit.vector[fit.model.layout.effect(name)][0]) == pytest.approx(size, rel=0.05)


def test_filter_at_a_single_speed_may_be_a_length() -> None:
    """What is locked to frequency is certain only if its rival locked to the angle loses."""
    posterior, _ = searched(campaign_of(GROUPS[:1], slow, noise_mps2=0.5), among("sensor length", "anti-alias filter"))
    assert not posterior.identified()
    assert {"sensor length", "anti-alias filter"} in [set(names) for names in posterior.alternatives()]
