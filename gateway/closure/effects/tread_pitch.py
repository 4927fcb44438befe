"""Tread pitch: the pattern's blocks pass the contact under the sensor, in the same phase every revolution."""

from __future__ import annotations

from typing import Final

import numpy as np

from gateway.closure.effects.base import CIRCUMFERENTIAL, NOWHERE, RADIAL, Conditions, Here, Parameter, Stage
from gateway.closure.effects.edge_waves import felt
from gateway.types import FloatArray

# Passenger car tires have 50 to 80 pitches, truck and winter patterns from 40, fine ones up to 110.
_START_ORDERS: Final = tuple(float(order) for order in range(44, 110, 3))
_START_WIDTH_RAD: Final = 0.25
_WIDTHS_RAD: Final = (0.1, 0.5)
# A linear fit from here sees slopes by order and width through these amplitudes: with small ones it would leap.
_START_SHARE: Final = 0.1
# 10 m/s^2 at 65 km/h is 1 % of R omega^2; a pattern that breaks the belt's curvature by a fifth has no ribs.
_LARGEST: Final = 0.2
_NARROWEST_RAD: Final = 0.02


class TreadPitch:
    """A wave of the pattern's order over the contact, fading beyond its edges."""

    name = "tread pitch"
    summary = "The tread's blocks bend the belt in and near the contact at the order of their number, tire-locked."
    equation = "R omega^2 (a cos(N theta) + b sin(N theta)) exp(-d^2 / (2 width^2)), d = distance beyond the edges"
    parameters = (
        Parameter("cosine", "", -_LARGEST, _LARGEST, 0.05, 1e-6, factor=100.0, display_unit="% of R omega^2"),
        Parameter("sine", "", -_LARGEST, _LARGEST, 0.05, 1e-6, factor=100.0, display_unit="% of R omega^2"),
        Parameter("order", "per revolution", 40.0, 115.0, 25.0, 1e-4, prior_mean=70.0),
        # From a block's length to half the free belt.
        Parameter("width_rad", "rad", 0.05, 1.5, 0.3, 1e-5, prior_mean=0.3),
    )
    seen_by = "Radial, in and about the contact, at the pattern's order: it does not average out; with omega^2."
    confused_with = (
        "Edge waves of the same order (0.9 alike), which leave the contact alone and have an order for each side; an "
        "electrical tone or a resonance at N revolutions a second, which stays in Hz at another speed."
    )
    already_in = NOWHERE
    stage = Stage.BELT
    axes = (CIRCUMFERENTIAL, RADIAL)
    linear = False
    scan = ((3, _WIDTHS_RAD),)

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return the orders of patterns; a wave over the contact answers to orders two off its own."""
        return tuple((_START_SHARE, _START_SHARE, order, _START_WIDTH_RAD) for order in _START_ORDERS)

    def contribution(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return the wave."""
        if not parameters[:2].any():
            return np.zeros_like(here.signal_mps2)
        return felt(here, np.tensordot(parameters[:2], _waves(here, parameters)[0], 1))

    def derivative(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return the derivatives by amplitudes, order and width."""
        cosine, sine = (float(value) for value in parameters[:2])
        waves, by_order, by_width = _waves(here, parameters)
        return felt(
            here,
            np.stack(
                [
                    waves[0],
                    waves[1],
                    cosine * by_order[0] + sine * by_order[1],
                    cosine * by_width[0] + sine * by_width[1],
                ]
            ),
        )


def _waves(here: Here, parameters: FloatArray) -> FloatArray:
    """Return cosine and sine wave, and both differentiated by order and by width, (3, 2, FIELD_SIZE).

    Rolling the other way the pattern is the mirror image.
    """
    order, width = float(parameters[2]), max(float(parameters[3]), _NARROWEST_RAD)
    theta = here.theta_rad
    beyond = np.maximum(np.maximum(here.leading_edge_rad - theta, theta - here.trailing_edge_rad), 0.0)
    square = np.square(beyond / width)
    envelope = np.exp(-0.5 * square)
    side = -1.0 if here.conditions.reverse else 1.0
    cosine, sine = envelope * np.cos(order * theta), side * envelope * np.sin(order * theta)
    waves = np.stack([cosine, sine])
    return np.stack([waves, np.stack([-side * theta * sine, side * theta * cosine]), waves * (square / width)])


EFFECT = TreadPitch()
