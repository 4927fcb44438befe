"""A tire that is out of round twice a turn: the path of a point on exact rings whose axle is low where a high spot is.

The belt follows its equilibrium, which the linear answer of a vibrating ring comes down to at low speed.
"""

import math
from functools import lru_cache

import numpy as np

from gateway.closure.effects.effect import CIRCUMFERENTIAL, RADIAL, GroupConditions
from gateway.constants import STANDARD_GRAVITY_MPS2
from gateway.types import ComplexArray, FloatArray
from tests.closure.planted_campaign import NODES, RADIUS_M, among, campaign_of, conditions, nothing, ring, searched

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
