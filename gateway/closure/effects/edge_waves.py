"""Travelling edge waves: wave packets that a tread sends along the belt from both edges of the contact."""

from __future__ import annotations

from typing import Final

import numpy as np

from gateway.closure.effects.base import (
    CIRCUMFERENTIAL,
    FIELD_SIZE,
    NOWHERE,
    RADIAL,
    Conditions,
    Here,
    Parameter,
    Stage,
)
from gateway.closure.effects.belt import SLOPE_ORDERS, relative_offset
from gateway.closure.effects.belt_packets import Packet, decaying, free_part, pulse, seen
from gateway.types import FloatArray

# A short packet answers to orders two or three off its own, so that a scan of every sixth finds any. Behind the contact
# they are below the tread's own order.
ORDERS_BEFORE: Final = tuple(float(order) for order in range(20, 105, 6))
ORDERS_AFTER: Final = ORDERS_BEFORE[:10]
_DECAYS: Final = (5.0, 1.4, 0.7)
# A linear fit from here sees slopes by shape through these amplitudes: with small ones it would leap.
_START_AHEAD: Final = (0.3, 0.3, 30.0, 0.25, 0.09)
# Those of a tread of 67 pitches.
_START: Final = (0.3, 0.3, 92.0, 4.0, 0.3, 0.3, 52.0, 1.4, 67.0, *_START_AHEAD)
NO_PITCH: Final = (0.0, 0.0, 0.0, 30.0, 0.25, 0.09)
"""The last parameters of waves that stand still, without a packet ahead."""
_ORDER: Final = np.arange(FIELD_SIZE // 2 + 1)
# Orders that the curvature of a closed belt has, and their slope.
_CLOSED: Final = np.where(_ORDER > 1, 1.0, 0.0)
_SLOPE: Final = np.where((_ORDER > 1) & (_ORDER <= SLOPE_ORDERS), 1j * _ORDER, 0.0)
# Places of amplitudes, of the pitch, and of what shapes each packet but for its order.
_AMPLITUDES: Final = [0, 1, 4, 5, 9, 10]
_PITCH: Final = 8
# Errors from 0 at which a pitch is told.
_TOLD: Final = 3.0
_OWN: Final = ([0, 1, 3], [4, 5, 7], [9, 10, 12, 13])
# A measured tire has 0.3 near the edge; a wave as large as the centripetal acceleration would lift the belt off.
_LARGEST: Final = 0.6


def _packet(name: str) -> tuple[Parameter, Parameter, Parameter]:
    return (
        Parameter(f"{name}_cosine", "", -_LARGEST, _LARGEST, 0.2, 1e-6, factor=100.0, display_unit="% of R omega^2"),
        Parameter(f"{name}_sine", "", -_LARGEST, _LARGEST, 0.2, 1e-6, factor=100.0, display_unit="% of R omega^2"),
        # From the ring's own smooth shape up to the orders that still repeat.
        Parameter(f"{name}_order", "per revolution", 10.0, 110.0, 25.0, 1e-4, prior_mean=50.0),
    )


def _decay(name: str) -> Parameter:
    # From once around and on to two waves. The rate, not the length: it may pass through 0 on a fit's way.
    return Parameter(f"{name}_decay_per_rad", "1/rad", 0.1, 10.0, 2.0, 1e-4, prior_mean=1.5)


class EdgeWaves:
    """Decaying packets from the leading and the trailing edge, and one packet on its own ahead of the contact."""

    name = "travelling edge waves"
    summary = "The tread sends wave packets along the belt from both edges of the contact, alike in every revolution."
    equation = (
        "R omega^2 (a cos(n d) + b sin(n d)) exp(-decay d) on either side, d = distance from the edge, and "
        "R omega^2 (a cos(n x) + b sin(n x)) exp(-x^2 / (2 width^2)) ahead, x = d - place; orders 0 and 1 taken out; "
        "circumferential: -(e/R) kappa times its slope, kappa = 1 - pitch / n (ahead as before)"
    )
    parameters = (
        *_packet("before"),
        _decay("before"),
        *_packet("after"),
        _decay("after"),
        # 60 to 80 blocks are on a car's tire; 0 would be a wave that stands still on the road.
        Parameter("pitch", "per revolution", -5.0, 130.0, 60.0, 1e-3),
        *_packet("ahead"),
        Parameter("ahead_place_rad", "rad", 0.0, 1.0, 0.2, 1e-5, prior_mean=0.25),
        # From a wave at the highest orders to the free belt's near half.
        Parameter("ahead_width_rad", "rad", 0.02, 0.4, 0.05, 1e-5, prior_mean=0.09),
    )
    seen_by = (
        "Radial, outside the contact, above the ring's own orders; with omega^2; across the circumferential offset, "
        "which tells by kappa which way they run and how fast."
    )
    confused_with = (
        "Tire-locked edge waves, which stand still; tread pitch of the same order (0.9 alike), which is in the contact "
        "as well; torsional ripple of that order (0.6, which is all around); edge scatter and shear flexibility at the "
        "edges themselves (0.2)."
    )
    form_of = "edge waves"
    already_in = NOWHERE
    stage = Stage.BELT
    axes = (CIRCUMFERENTIAL, RADIAL)
    linear = False
    # After, before, and after again now that the packet before is known.
    scan = ((6, ORDERS_AFTER), (2, ORDERS_BEFORE), (6, ORDERS_AFTER), (3, _DECAYS), (7, _DECAYS))

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return one start; `scan` goes on from it."""
        return (_START,)

    def reason_against(self, parameters: FloatArray, std: FloatArray) -> str:
        """Refuse a pitch that is not told from 0 (such waves stand still), and packets that end within one wave."""
        pitch, error = float(parameters[_PITCH]), float(std[_PITCH])
        if pitch > _TOLD * error:
            return no_wave(parameters, std)
        return f"its pitch, {pitch:.3g} +- {error:.2g} per revolution, is not told from 0: such waves stand still"

    def contribution(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return the packets; nothing without amplitude, whatever the orders."""
        if not parameters[_AMPLITUDES].any():
            return np.zeros_like(here.signal_mps2)
        packets, shares, _ = _packets(here, parameters)
        waves = np.stack([(amplitude * packet.curve).real for amplitude, packet in packets])
        return felt(here, waves.sum(axis=0), shares @ waves)

    def derivative(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return the derivatives by amplitudes, shapes and pitch."""
        packets, shares, answers = _packets(here, parameters)
        rows = np.zeros((len(parameters), len(here.theta_rad)))
        along = np.zeros_like(rows)
        for (amplitude, packet), share, places, answer in zip(packets, shares, _OWN, answers, strict=True):
            wave = amplitude * packet.curve
            own = [packet.curve.real, packet.curve.imag, *((by * wave).real for by in packet.shape_by)]
            rows[places] = own
            along[places] = share * rows[places]
            # What the order and the share that a sensor sees answer to.
            by_order = (packet.order_by * wave).real
            for place, order_by, share_by in answer:
                rows[place] += order_by * by_order
                along[place] += (order_by * share) * by_order + share_by * wave.real
        return felt(here, rows, along)


def no_wave(parameters: FloatArray, std: FloatArray) -> str:
    """Return that a packet at an edge fades before it has gone through one wave, in words; empty where none does.

    Args:
        parameters: of either form of waves.
        std: of them.
    """
    for side, at in (("ahead of", 0), ("behind", 4)):
        order, decay = float(parameters[at + 2]), float(parameters[at + 3])
        if np.hypot(*parameters[at : at + 2]) > _TOLD * np.hypot(*std[at : at + 2]) and order < 2.0 * np.pi * decay:
            return f"{side} the contact it fades within {order / (2.0 * np.pi * decay):.2f} of a wave: a bump, no wave"
    return ""


Answers = list[tuple[int, float, float]]


def _packets(
    here: Here, parameters: FloatArray
) -> tuple[list[tuple[complex, Packet]], FloatArray, tuple[Answers, Answers, Answers]]:
    """Return the packets before, after and ahead.

    Returns:
        amplitude and packet; kappa (3,); what the order that a sensor sees, and kappa, answer to: place of a parameter,
        derivative of the order, derivative of kappa.
    """
    p = parameters.tolist()
    speed = here.conditions.radius_m * here.conditions.omega_radps
    free = free_part(here)
    before, after = seen(p[2], p[_PITCH], speed), seen(p[6], p[_PITCH], speed)
    # On the same belt, so as fast as the packet before: its order answers to speed by the same factor.
    order = p[11]
    packets = [
        (complex(p[0], -p[1]), decaying(free, 0, p[2] * before.stretch, p[3])),
        (complex(p[4], -p[5]), decaying(free, 1, p[6] * after.stretch, p[7])),
        (complex(p[9], -p[10]), pulse(free, order * before.stretch, p[12], p[13])),
    ]
    (share_2, share_8), (stretch_2, stretch_8) = before.share_by, before.stretch_by
    answers: tuple[Answers, Answers, Answers] = (
        [(2, before.stretch + p[2] * stretch_2, share_2), (_PITCH, p[2] * stretch_8, share_8)],
        [
            (6, after.stretch + p[6] * after.stretch_by[0], after.share_by[0]),
            (_PITCH, p[6] * after.stretch_by[1], after.share_by[1]),
        ],
        [(11, before.stretch, 0.0), (2, order * stretch_2, share_2), (_PITCH, order * stretch_8, share_8)],
    )
    return packets, np.array([before.share, after.share, before.share]), answers


def felt(here: Here, wave: FloatArray, along: FloatArray | None = None) -> FloatArray:
    """Return what a wave of the belt's curvature adds to the axes.

    Args:
        here: the block.
        wave: (..., FIELD_SIZE) in R omega^2.
        along: what of it changes along the belt as it does for the sensor, kappa times the wave; None for all of it.

    Returns:
        (..., 3, FIELD_SIZE), m/s^2.
    """
    scale = here.conditions.radius_m * here.conditions.omega_radps**2
    result = np.zeros((*wave.shape[:-1], 3, wave.shape[-1]))
    spectrum = np.fft.rfft(wave, axis=-1) * (scale * _CLOSED)
    result[..., RADIAL, :] = np.fft.irfft(spectrum, n=FIELD_SIZE, axis=-1)
    offset = relative_offset(here)
    if offset:
        if along is not None:
            spectrum = np.fft.rfft(along, axis=-1) * scale
        result[..., CIRCUMFERENTIAL, :] = np.fft.irfft(spectrum * (-offset * _SLOPE), n=FIELD_SIZE, axis=-1)
    return result


EFFECT = EdgeWaves()
