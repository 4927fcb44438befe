"""Tire-locked edge waves: wave packets that a tread sends along the belt from both edges of the contact."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.closure.effects.base import CIRCUMFERENTIAL, NOWHERE, RADIAL, Conditions, Here, Parameter, Stage
from gateway.closure.effects.belt import relative_offset, slopes, without_low_orders

FloatArray = NDArray[np.float64]

# Measured packets are of order 30 to 45 (docs/accuracy.md). A short packet answers to orders one or two off its own,
# so a scan of every third finds any: 24 of 24 drawn at random, where all pairs of every seventh found 20.
_ORDERS: Final = tuple(float(order) for order in range(20, 63, 3))
_DECAYS: Final = (5.0, 1.4, 0.7)
# A linear fit from here sees slopes by order and decay through these amplitudes: with small ones it would leap.
_START: Final = (0.1, 0.1, 40.0, 2.5)
# A tenth is what measured tires show at most; a wave as large as the centripetal acceleration would lift the belt off.
_LARGEST: Final = 0.3
# A packet swells from nothing over this angle, as measured ones do: the edge itself is the ring's.
_ONSET_RAD: Final = 0.03


def _side(side: str) -> tuple[Parameter, ...]:
    return (
        Parameter(f"{side}_cosine", "", -_LARGEST, _LARGEST, 0.1, 1e-6, factor=100.0, display_unit="% of R omega^2"),
        Parameter(f"{side}_sine", "", -_LARGEST, _LARGEST, 0.1, 1e-6, factor=100.0, display_unit="% of R omega^2"),
        # From the ring's own smooth shape up to the orders that still repeat.
        Parameter(f"{side}_order", "per revolution", 10.0, 105.0, 12.0, 1e-4, prior_mean=40.0),
        # From once around and on to two waves. The rate, not the length: it may pass through 0 on a fit's way.
        Parameter(f"{side}_decay_per_rad", "1/rad", 0.1, 10.0, 1.5, 1e-4, prior_mean=1.0),
    )


class EdgeWaves:
    """Two decaying packets, ahead of the leading edge and behind the trailing edge."""

    name = "tire-locked edge waves"
    summary = "The tread sends wave packets along the belt from both edges of the contact, alike in every revolution."
    equation = (
        "R omega^2 (a cos(n d) + b sin(n d)) exp(-decay d) on either side, d = distance from the edge; orders 0 and "
        "1 taken out; circumferential: -(e/R) of its slope"
    )
    parameters = (*_side("before"), *_side("after"))
    seen_by = (
        "Radial, outside the contact, above the ring's own orders; with omega^2; across the circumferential offset."
    )
    confused_with = (
        "Tread pitch of the same order (0.9 alike), which is in the contact as well; torsional ripple of that order "
        "(0.6, which is all around); edge scatter and shear flexibility at the edges themselves (0.2)."
    )
    already_in = NOWHERE
    stage = Stage.BELT
    axes = (CIRCUMFERENTIAL, RADIAL)
    linear = False
    # Before, after, and before again now that the packet after is known.
    scan = ((2, _ORDERS), (6, _ORDERS), (2, _ORDERS), (3, _DECAYS), (7, _DECAYS))

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return one start, from which `scan` goes on."""
        return ((*_START, *_START),)

    def contribution(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return the packets; nothing without amplitude, whatever the orders."""
        if not parameters[[0, 1, 4, 5]].any():
            return np.zeros_like(here.signal_mps2)
        basis = _packets(here, parameters)[:, :2]
        return felt(here, np.tensordot(parameters.reshape(2, 4)[:, :2], basis, 2))

    def derivative(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return the derivatives by amplitudes, orders and decays."""
        rows = []
        for (cosine, sine, _, _), basis in zip(parameters.reshape(2, 4), _packets(here, parameters), strict=True):
            rows += [basis[0], basis[1], cosine * basis[2] + sine * basis[3], cosine * basis[4] + sine * basis[5]]
        return felt(here, np.stack(rows))


def _packets(here: Here, parameters: FloatArray) -> FloatArray:
    """Return the bases of both packets, (2, 6, FIELD_SIZE)."""
    return np.stack(
        [
            _packet(np.mod(here.leading_edge_rad - here.theta_rad, 2.0 * math.pi), here, parameters[2:4]),
            _packet(np.mod(here.theta_rad - here.trailing_edge_rad, 2.0 * math.pi), here, parameters[6:8]),
        ]
    )


def _packet(distance: FloatArray, here: Here, order_and_decay: FloatArray) -> FloatArray:
    """Return cosine and sine packet, then both differentiated by order, and by decay, (6, FIELD_SIZE)."""
    order, decay = order_and_decay
    outside = distance < 2.0 * math.pi - (here.trailing_edge_rad - here.leading_edge_rad)
    swell = -np.expm1(-np.square(distance / _ONSET_RAD))
    envelope = np.where(outside, swell * np.exp(-decay * distance), 0.0)
    cosine, sine = envelope * np.cos(order * distance), envelope * np.sin(order * distance)
    return np.stack([cosine, sine, -distance * sine, distance * cosine, -distance * cosine, -distance * sine])


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
