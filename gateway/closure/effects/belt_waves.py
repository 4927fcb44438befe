"""Waves on the belt: travelling and tire-locked edge waves, and the tread pitch in the contact."""

from __future__ import annotations

from typing import Final

import numpy as np

from gateway.closure.effects.belt_geometry import SLOPE_ORDERS, relative_offset
from gateway.closure.effects.effect import (
    CIRCUMFERENTIAL,
    FIELD_SIZE,
    RADIAL,
    Confounder,
    ModelledBlock,
    Parameter,
    SignalEffect,
    Stage,
)
from gateway.closure.effects.wave_packets import Packet, decaying, free_belt, pulse, sensor_view
from gateway.reasons import Code, Reason
from gateway.types import FloatArray

_EDGE_WAVES: Final = "edge waves"
# A short packet responds to orders two or three off its own, so that a scan of every sixth finds any. Behind the
# contact they are below the tread's own order.
_ORDERS_BEFORE: Final = tuple(float(order) for order in range(20, 105, 6))
_ORDERS_AFTER: Final = _ORDERS_BEFORE[:10]
_DECAYS: Final = (5.0, 1.4, 0.7)
# After, before, and after again now that the packet before is known; then both decays.
_EDGE_SCAN: Final = ((6, _ORDERS_AFTER), (2, _ORDERS_BEFORE), (6, _ORDERS_AFTER), (3, _DECAYS), (7, _DECAYS))
# A linear fit sees derivatives by shape through these amplitudes: with small ones its step would be too large.
_START_AHEAD: Final = (0.3, 0.3, 30.0, 0.25, 0.09)
# Those of a tread of 67 pitches.
_START_TRAVELLING: Final = (0.3, 0.3, 92.0, 4.0, 0.3, 0.3, 52.0, 1.4, 67.0, *_START_AHEAD)
_START_LOCKED: Final = (0.3, 0.3, 40.0, 2.5, 0.3, 0.3, 40.0, 2.5)
# The last parameters of tire-locked waves: no pitch, no packet ahead.
_NO_PITCH: Final = (0.0, 0.0, 0.0, 30.0, 0.25, 0.09)
_ORDER: Final = np.arange(FIELD_SIZE // 2 + 1)
# Orders that the curvature of a closed belt has, and their slope.
_CLOSED: Final = np.where(_ORDER > 1, 1.0, 0.0)
_CLOSED_SLOPE: Final = np.where((_ORDER > 1) & (_ORDER <= SLOPE_ORDERS), 1j * _ORDER, 0.0)
# Indices of the amplitudes, of the pitch, and of the parameters that shape each packet but for its order.
_AMPLITUDES: Final = [0, 1, 4, 5, 9, 10]
_PITCH: Final = 8
_OWN: Final = ([0, 1, 3], [4, 5, 7], [9, 10, 12, 13])
# Standard errors from 0 at which a pitch or an amplitude is determined.
_DETERMINED_SIGMAS: Final = 3.0
# A measured tire has 0.3 near the edge; a wave as large as the centripetal acceleration would lift the belt off.
_MAX_EDGE_AMPLITUDE: Final = 0.6

# Passenger car tires have 50 to 80 pitches, truck and winter patterns from 40, fine ones up to 110.
_PITCH_START_ORDERS: Final = tuple(float(order) for order in range(44, 110, 3))
_PITCH_START_WIDTH_RAD: Final = 0.25
_PITCH_WIDTHS_RAD: Final = (0.1, 0.5)
_PITCH_START_SHARE: Final = 0.1
# 10 m/s^2 at 65 km/h is 1 % of R omega^2; a pattern that changes the belt's curvature by a fifth has no ribs.
_MAX_PITCH_AMPLITUDE: Final = 0.2
_MIN_PITCH_WIDTH_RAD: Final = 0.02

_PERCENT_OF_R_OMEGA2: Final = "% of R omega^2"


def _amplitude(name: str, most: float, prior_std: float) -> Parameter:
    return Parameter(name, "", -most, most, prior_std, 1e-6, factor=100.0, display_unit=_PERCENT_OF_R_OMEGA2)


def _packet(name: str) -> tuple[Parameter, Parameter, Parameter]:
    return (
        _amplitude(f"{name}_cosine", _MAX_EDGE_AMPLITUDE, 0.2),
        _amplitude(f"{name}_sine", _MAX_EDGE_AMPLITUDE, 0.2),
        # From the ring's own smooth shape up to the orders that still repeat.
        Parameter(f"{name}_order", "per revolution", 10.0, 110.0, 25.0, 1e-4, prior_mean=50.0),
    )


def _decay(name: str) -> Parameter:
    # From once around and on to two waves. The rate, not the length: a fit may pass through 0.
    return Parameter(f"{name}_decay_per_rad", "1/rad", 0.1, 10.0, 2.0, 1e-4, prior_mean=1.5)


class TravellingEdgeWaves(SignalEffect):
    """Decaying packets from the leading and the trailing edge, and a separate packet ahead of the contact."""

    name = "travelling edge waves"
    rank = 170
    summary = "The tread sends wave packets along the belt from both edges of the contact, alike in every revolution."
    equation = (
        "R omega^2 (a cos(n d) + b sin(n d)) exp(-decay d) on either side, d = distance from the edge, and "
        "R omega^2 (a cos(n x) + b sin(n x)) exp(-x^2 / (2 width^2)) ahead, x = d - place; orders 0 and 1 removed; "
        "circumferential: -(e/R) kappa times its slope, kappa = 1 - pitch / n (ahead as before)"
    )
    source = "empirical packets with the kinematics of waves on a rolling belt"
    parameters = (
        *_packet("before"),
        _decay("before"),
        *_packet("after"),
        _decay("after"),
        # 60 to 80 blocks are on a car's tire; 0 would be a wave that is stationary on the road.
        Parameter("pitch", "per revolution", -5.0, 130.0, 60.0, 1e-3),
        *_packet("ahead"),
        Parameter("ahead_place_rad", "rad", 0.0, 1.0, 0.2, 1e-5, prior_mean=0.25),
        # From a wave at the highest orders to the free belt's near half.
        Parameter("ahead_width_rad", "rad", 0.02, 0.4, 0.05, 1e-5, prior_mean=0.09),
    )
    axes = (CIRCUMFERENTIAL, RADIAL)
    observed_in = (
        "radial axis, outside the contact, above the ring's own orders; grows with omega^2; the circumferential axis of"
        " an offset sensor gives kappa, hence direction and speed of travel"
    )
    confounders = (
        Confounder(
            ("tire-locked edge waves",), "their circumferential share has kappa = 1 and their orders keep at any speed"
        ),
        Confounder(("tread pitch",), "it is in the contact as well", "0.9 at the same order"),
        Confounder(("torsional ripple",), "it is all around the tire", "0.6 at the same order"),
        Confounder(("contact edge scatter", "shear flexibility"), "they act at the edges themselves", "0.2"),
    )
    start_values = (_START_TRAVELLING,)
    form_of = _EDGE_WAVES
    scan = _EDGE_SCAN
    stage = Stage.BELT

    def reason_against(self, parameters: FloatArray, std: FloatArray) -> Reason | None:
        """Reject a pitch that may be 0 (such waves are stationary), and packets that end within one wave."""
        pitch, error = float(parameters[_PITCH]), float(std[_PITCH])
        if pitch > _DETERMINED_SIGMAS * error:
            return _fades_within_a_wave(parameters, std)
        return Reason(Code.STANDING_WAVES, pitch=pitch, pitch_std=error)

    def contribution(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the packets; nothing without amplitude, whatever the orders."""
        if not parameters[_AMPLITUDES].any():
            return block.zeros()
        packets, shares, _ = _packets(block, parameters)
        waves = np.stack([(amplitude * packet.curve).real for amplitude, packet in packets])
        return _curvature_signal(block, waves.sum(axis=0), shares @ waves)

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the derivatives by amplitudes, shapes and pitch."""
        packets, shares, chains = _packets(block, parameters)
        rows = np.zeros((len(parameters), len(block.theta_rad)))
        along = np.zeros_like(rows)
        for (amplitude, packet), share, places, chain in zip(packets, shares, _OWN, chains, strict=True):
            wave = amplitude * packet.curve
            own = [packet.curve.real, packet.curve.imag, *((by * wave).real for by in packet.shape_by)]
            rows[places] = own
            along[places] = share * rows[places]
            # Parameters that change the order and the share that a sensor sees.
            by_order = (packet.order_by * wave).real
            for place, order_by, share_by in chain:
                rows[place] += order_by * by_order
                along[place] += (order_by * share) * by_order + share_by * wave.real
        return _curvature_signal(block, rows, along)


_TRAVELLING: Final = TravellingEdgeWaves()


class TireLockedEdgeWaves(SignalEffect):
    """Decaying packets from the leading and the trailing edge that are part of the belt's steady shape."""

    name = "tire-locked edge waves"
    rank = 180
    summary = "The belt's steady shape ripples outside the contact, from both its edges, alike in every revolution."
    equation = (
        "R omega^2 (a cos(n d) + b sin(n d)) exp(-decay d) on either side, d = distance from the edge; orders 0 and 1 "
        "removed; circumferential: -(e/R) times its slope"
    )
    source = "empirical packets on a steady belt shape"
    parameters = _TRAVELLING.parameters[: len(_START_LOCKED)]
    axes = (CIRCUMFERENTIAL, RADIAL)
    observed_in = (
        "radial axis, outside the contact, above the ring's own orders; grows with omega^2; circumferential axis with "
        "an offset"
    )
    confounders = (
        Confounder(
            ("travelling edge waves",),
            "their circumferential share has another size and sign, and their orders change with speed",
        ),
        Confounder(("tread pitch",), "it is in the contact as well", "0.9 at the same order"),
        Confounder(("torsional ripple",), "it is all around the tire", "0.6 at the same order"),
        Confounder(("contact edge scatter", "shear flexibility"), "they act at the edges themselves", "0.2"),
    )
    start_values = (_START_LOCKED,)
    form_of = _EDGE_WAVES
    scan = _EDGE_SCAN
    stage = Stage.BELT

    def reason_against(self, parameters: FloatArray, std: FloatArray) -> Reason | None:
        """Reject packets that end within one wave."""
        return _fades_within_a_wave(parameters, std)

    def contribution(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the packets: those that travel, without a pitch."""
        return _TRAVELLING.contribution(block, np.concatenate([parameters, _NO_PITCH]))

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the derivatives by amplitudes and shapes."""
        return _TRAVELLING.derivative(block, np.concatenate([parameters, _NO_PITCH]))[: len(parameters)]


class TreadPitch(SignalEffect):
    """A wave of the pattern's order over the contact, fading beyond its edges."""

    name = "tread pitch"
    rank = 190
    summary = "The tread's blocks bend the belt in and near the contact at the order of their number, tire-locked."
    equation = "R omega^2 (a cos(N theta) + b sin(N theta)) exp(-d^2 / (2 width^2)), d = distance beyond the edges"
    source = "empirical wave with a Gaussian envelope"
    parameters = (
        _amplitude("cosine", _MAX_PITCH_AMPLITUDE, 0.05),
        _amplitude("sine", _MAX_PITCH_AMPLITUDE, 0.05),
        Parameter("order", "per revolution", 40.0, 115.0, 25.0, 1e-4, prior_mean=70.0),
        # From a block's length to half the free belt.
        Parameter("width_rad", "rad", 0.05, 1.5, 0.3, 1e-5, prior_mean=0.3),
    )
    axes = (CIRCUMFERENTIAL, RADIAL)
    observed_in = (
        "radial axis, in and near the contact, at the pattern's order: it does not average out; grows with omega^2"
    )
    confounders = (
        Confounder(
            ("travelling edge waves", "tire-locked edge waves"),
            "they are outside the contact only and have an order for each side",
            "0.9 at the same order",
        ),
        Confounder(
            ("an electrical tone or a resonance at N revolutions a second",), "another speed: it keeps its frequency"
        ),
    )
    # A wave over the contact responds to orders two off its own.
    start_values = tuple(
        (_PITCH_START_SHARE, _PITCH_START_SHARE, order, _PITCH_START_WIDTH_RAD) for order in _PITCH_START_ORDERS
    )
    scan = ((3, _PITCH_WIDTHS_RAD),)
    stage = Stage.BELT

    def contribution(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the wave."""
        if not parameters[:2].any():
            return block.zeros()
        return _curvature_signal(block, np.tensordot(parameters[:2], _pitch_waves(block, parameters)[0], 1))

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the derivatives by amplitudes, order and width."""
        cosine, sine = (float(value) for value in parameters[:2])
        waves, by_order, by_width = _pitch_waves(block, parameters)
        rows = [
            waves[0],
            waves[1],
            cosine * by_order[0] + sine * by_order[1],
            cosine * by_width[0] + sine * by_width[1],
        ]
        return _curvature_signal(block, np.stack(rows))


def _fades_within_a_wave(parameters: FloatArray, std: FloatArray) -> Reason | None:
    """Return at which edge a packet fades within one wavelength; None where none does.

    Args:
        parameters: of either form of edge waves.
        std: of them.
    """
    for edge, at in (("leading", 0), ("trailing", 4)):
        order, decay = float(parameters[at + 2]), float(parameters[at + 3])
        present = np.hypot(*parameters[at : at + 2]) > _DETERMINED_SIGMAS * np.hypot(*std[at : at + 2])
        if present and order < 2.0 * np.pi * decay:
            return Reason(Code.FADES_WITHIN_ONE_WAVE, edge=edge, waves=order / (2.0 * np.pi * decay))
    return None


Chain = list[tuple[int, float, float]]
"""Parameters that the order and the share seen by a sensor depend on: (index, d order, d kappa) for each."""


def _packets(
    block: ModelledBlock, parameters: FloatArray
) -> tuple[list[tuple[complex, Packet]], FloatArray, tuple[Chain, Chain, Chain]]:
    """Return amplitude and packet before, after and ahead; kappa (3,); and their chains of derivatives."""
    p = parameters.tolist()
    speed = block.conditions.radius_m * block.conditions.omega_radps
    free = free_belt(block)
    before, after = sensor_view(p[2], p[_PITCH], speed), sensor_view(p[6], p[_PITCH], speed)
    # On the same belt, so as fast as the packet before: its order changes with speed by the same factor.
    order = p[11]
    packets = [
        (complex(p[0], -p[1]), decaying(free, 0, p[2] * before.stretch, p[3])),
        (complex(p[4], -p[5]), decaying(free, 1, p[6] * after.stretch, p[7])),
        (complex(p[9], -p[10]), pulse(free, order * before.stretch, p[12], p[13])),
    ]
    (share_2, share_8), (stretch_2, stretch_8) = before.share_by, before.stretch_by
    chains: tuple[Chain, Chain, Chain] = (
        [(2, before.stretch + p[2] * stretch_2, share_2), (_PITCH, p[2] * stretch_8, share_8)],
        [
            (6, after.stretch + p[6] * after.stretch_by[0], after.share_by[0]),
            (_PITCH, p[6] * after.stretch_by[1], after.share_by[1]),
        ],
        [(11, before.stretch, 0.0), (2, order * stretch_2, share_2), (_PITCH, order * stretch_8, share_8)],
    )
    return packets, np.array([before.share, after.share, before.share]), chains


def _pitch_waves(block: ModelledBlock, parameters: FloatArray) -> FloatArray:
    """Return cosine and sine wave, and both differentiated by order and by width, (3, 2, FIELD_SIZE).

    In reverse the pattern is the mirror image.
    """
    order, width = float(parameters[2]), max(float(parameters[3]), _MIN_PITCH_WIDTH_RAD)
    theta = block.theta_rad
    beyond = np.maximum(np.maximum(block.leading_edge_rad - theta, theta - block.trailing_edge_rad), 0.0)
    square = np.square(beyond / width)
    envelope = np.exp(-0.5 * square)
    side = -1.0 if block.conditions.reverse else 1.0
    cosine, sine = envelope * np.cos(order * theta), side * envelope * np.sin(order * theta)
    waves = np.stack([cosine, sine])
    return np.stack([waves, np.stack([-side * theta * sine, side * theta * cosine]), waves * (square / width)])


def _curvature_signal(block: ModelledBlock, wave: FloatArray, along: FloatArray | None = None) -> FloatArray:
    """Return the contribution of a wave of the belt's curvature to the axes.

    Args:
        block: the block.
        wave: (..., FIELD_SIZE) in R omega^2.
        along: the part that changes along the belt as it does for the sensor, kappa times the wave; None for all of it.

    Returns:
        (..., 3, FIELD_SIZE), m/s^2.
    """
    scale = block.conditions.radius_m * block.conditions.omega_radps**2
    result = np.zeros((*wave.shape[:-1], 3, wave.shape[-1]))
    spectrum = np.fft.rfft(wave, axis=-1) * (scale * _CLOSED)
    result[..., RADIAL, :] = np.fft.irfft(spectrum, n=FIELD_SIZE, axis=-1)
    offset = relative_offset(block)
    if offset:
        if along is not None:
            spectrum = np.fft.rfft(along, axis=-1) * scale
        result[..., CIRCUMFERENTIAL, :] = np.fft.irfft(spectrum * (-offset * _CLOSED_SLOPE), n=FIELD_SIZE, axis=-1)
    return result


EFFECTS: Final = (_TRAVELLING, TireLockedEdgeWaves(), TreadPitch())
