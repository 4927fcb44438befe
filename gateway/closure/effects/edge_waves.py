"""Tire-locked edge waves: wave packets that a tread sends along the belt from both edges of the contact."""

from __future__ import annotations

import itertools
import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.closure.effects.base import CIRCUMFERENTIAL, NOWHERE, RADIAL, Conditions, Here, Parameter, Stage
from gateway.closure.effects.belt import relative_offset, slopes, without_low_orders
from gateway.estimators.forward_waves import packet_basis

FloatArray = NDArray[np.float64]

# Measured packets are of order 30 to 45 (docs/accuracy.md). A short packet answers to orders some way off its own, so
# a coarse grid of starts finds any; each side has its own order.
_START_ORDERS: Final = (22.0, 29.0, 36.0, 43.0, 50.0, 57.0)
_START_DECAY_RAD: Final = 0.4
# A linear fit from here sees slopes by order and decay through these amplitudes: with small ones it would leap.
_START_SHARE: Final = 0.1
# A tenth is what measured tires show at most; a wave as large as the centripetal acceleration would lift the belt off.
_LARGEST: Final = 0.3


def _side(side: str) -> tuple[Parameter, ...]:
    return (
        Parameter(f"{side}_cosine", "", -_LARGEST, _LARGEST, 0.1, 1e-6, factor=100.0, display_unit="% of R omega^2"),
        Parameter(f"{side}_sine", "", -_LARGEST, _LARGEST, 0.1, 1e-6, factor=100.0, display_unit="% of R omega^2"),
        # From the ring's own smooth shape up to the orders that still repeat.
        Parameter(f"{side}_order", "per revolution", 10.0, 105.0, 12.0, 1e-4, prior_mean=40.0),
        # From two waves to once around and more.
        Parameter(f"{side}_decay_rad", "rad", 0.1, 6.0, 0.7, 1e-5, prior_mean=1.0),
    )


class EdgeWaves:
    """Two decaying packets, ahead of the leading edge and behind the trailing edge."""

    name = "tire-locked edge waves"
    summary = "The tread sends wave packets along the belt from both edges of the contact, alike in every revolution."
    equation = (
        "R omega^2 (a cos(n d) + b sin(n d)) exp(-d / decay) on either side, d = distance from the edge; orders 0 and "
        "1 taken out; circumferential: -(e/R) of its slope"
    )
    parameters = (*_side("before"), *_side("after"))
    seen_by = (
        "Radial, outside the contact, above the ring's own orders; with omega^2; across the circumferential offset."
    )
    confused_with = (
        "Bs, the tread's stiffness and shear at the edges themselves; tread pitch, which is one order in and about "
        "the contact; a low-pass filter or a loose sensor, which ring in Hz: another speed decides."
    )
    already_in = NOWHERE
    stage = Stage.BELT
    axes = (CIRCUMFERENTIAL, RADIAL)
    linear = False

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return every pair of orders of a grid, with packets short enough to find what lies between."""
        return tuple(
            (_START_SHARE, _START_SHARE, before, _START_DECAY_RAD, _START_SHARE, _START_SHARE, after, _START_DECAY_RAD)
            for before, after in itertools.product(_START_ORDERS, repeat=2)
        )

    def contribution(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return the packets; nothing without amplitude, whatever the orders."""
        if not parameters[[0, 1, 4, 5]].any():
            return np.zeros_like(here.signal_mps2)
        basis = _packets(here, parameters)[:, :2]
        return felt(here, np.tensordot(parameters.reshape(2, 4)[:, :2], basis, 2))

    def derivative(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return the derivatives by amplitudes, orders and decays."""
        rows = []
        for (cosine, sine, _, decay), basis in zip(parameters.reshape(2, 4), _packets(here, parameters), strict=True):
            rows += [basis[0], basis[1], cosine * basis[2] + sine * basis[3]]
            # The basis has its derivatives by the decay's logarithm.
            rows.append((cosine * basis[4] + sine * basis[5]) / max(decay, _SHORTEST_RAD))
        return felt(here, np.stack(rows))


# A fit on its way may try less.
_SHORTEST_RAD: Final = 0.02


def _packets(here: Here, parameters: FloatArray) -> FloatArray:
    """Return the bases of both packets, (2, 6, FIELD_SIZE)."""
    free = 2.0 * math.pi - (here.trailing_edge_rad - here.leading_edge_rad)
    sides = ((here.leading_edge_rad, -1, parameters[2:4]), (here.trailing_edge_rad, 1, parameters[6:8]))
    return np.stack(
        [
            packet_basis(here.theta_rad, edge, direction, free, float(order), max(float(decay), _SHORTEST_RAD))
            for edge, direction, (order, decay) in sides
        ]
    )


def felt(here: Here, wave: FloatArray) -> FloatArray:
    """Return what a wave of the belt's curvature, (..., FIELD_SIZE) in R omega^2, adds to the axes, (..., 3, ..)."""
    scale = here.conditions.radius_m * here.conditions.omega_radps**2
    radial = scale * without_low_orders(wave)
    result = np.zeros((*wave.shape[:-1], 3, wave.shape[-1]))
    result[..., RADIAL, :] = radial
    offset = relative_offset(here)
    if offset:
        result[..., CIRCUMFERENTIAL, :] = -offset * slopes(radial)[0]
    return result


EFFECT = EdgeWaves()
