"""Waves on the belt: travelling and tire-locked edge waves, and the tread pitch in the contact."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Final, NamedTuple, Self

import numpy as np

from gateway.core.reasons import Reason
from gateway.core.types import ComplexArray, FloatArray
from gateway.diagnosis.effects.belt_dispersion import BeltWave, BlockTread, belt_wave
from gateway.diagnosis.effects.belt_geometry import SLOPE_ORDERS, relative_offset
from gateway.diagnosis.effects.effect import (
    CIRCUMFERENTIAL,
    FIELD_SIZE,
    RADIAL,
    Confounder,
    GroupConditions,
    ModelledBlock,
    Parameter,
    SignalEffect,
    Stage,
)
from gateway.diagnosis.effects.wave_packets import Running, free_belt, pulse, pulse_by, spectrum_of
from gateway.diagnosis.reasons import DiagnosisCode

_EDGE_WAVES: Final = "edge waves"
# A short packet responds to orders two or three off its own, so that a scan of every sixth finds any. Behind the
# contact they are below the tread's own order.
_ORDERS_BEFORE: Final = tuple(float(order) for order in range(20, 105, 6))
_ORDERS_AFTER: Final = _ORDERS_BEFORE[:10]
_DECAYS: Final = (5.0, 1.4, 0.7)
# After, before, and after again now that the packet before is known; then both decays.
_EDGE_SCAN: Final = ((6, _ORDERS_AFTER), (2, _ORDERS_BEFORE), (6, _ORDERS_AFTER), (3, _DECAYS), (7, _DECAYS))
_START_LOCKED: Final = (0.3, 0.3, 40.0, 2.5, 0.3, 0.3, 40.0, 2.5)
# A linear fit sees derivatives by shape through these amplitudes: with small ones its step would be too large.
_START_AHEAD: Final = (0.3, 0.3, 30.0, 0.25, 0.09)
# Numbers of blocks, and bending over mass per length: they set the middle of both orders and their distance.
_START_BLOCKS: Final = tuple(float(count) for count in range(42, 111, 3))
_START_BENDING: Final = (4.0, 1.3, 0.4)
# Losses, the bending's and the sidewall's, of waves that fade within one radian to all around.
_SCAN_BENDING_LOSS: Final = (1e-5, 1e-4, 4e-4)
_SCAN_SIDEWALL_LOSS: Final = (10.0, 150.0)
_ORDER: Final = np.arange(FIELD_SIZE // 2 + 1)
# Orders that the curvature of a closed belt has, and their slope.
_CURVATURE_FACTOR: Final = np.where(_ORDER > 1, 1.0, 0.0)
_SLOPE_FACTOR: Final = np.where((_ORDER > 1) & (_ORDER <= SLOPE_ORDERS), 1j * _ORDER, 0.0)
# Places of the amplitudes of travelling waves, and of what their orders and decays follow from.
_AMPLITUDE_INDICES: Final = [0, 1, 2, 3, 4, 5, 11, 12]
_TREAD_INDICES: Final = range(6, 11)
# Places of the amplitudes of the packet ahead, and of its shape.
_AHEAD_FIRST: Final = 11
_AHEAD_INDICES: Final = range(13, 16)
# Place of the amplitudes, edge and multiple of the number of blocks of each wave.
_WAVES: Final = ((0, 0, 1), (2, 1, 1), (4, 1, 2))
# Speed at which the sizes of travelling waves are stated.
_REFERENCE_MPS: Final = 20.0
# Standard errors from 0 at which an amplitude is determined.
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


def _amplitude(name: str, limit: float, prior_std: float) -> Parameter:
    return Parameter(name, "", -limit, limit, prior_std, 1e-6, factor=100.0, display_unit=_PERCENT_OF_R_OMEGA2)


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


@dataclass(frozen=True, slots=True)
class _Packet:
    """A packet on the belt, as Fourier coefficients of orders m and -m, (2, FIELD_SIZE // 2 + 1).

    Attributes:
        first: index of its first amplitude among the parameters.
        amplitude: cosine minus i sine.
        curves: of unit amplitude, and its part that changes along the belt as it does for the sensor, (2, 2, ...).
        behind: places of the parameters behind them.
        slopes: returns the derivatives of both by these, which a contribution does not need.
    """

    first: int
    amplitude: complex
    curves: ComplexArray
    behind: range
    slopes: Callable[[], tuple[ComplexArray, ComplexArray]]


class _State(NamedTuple):
    """What a contribution depends on of a block.

    Attributes:
        leading_edge_rad: of the contact.
        trailing_edge_rad: of the contact.
        conditions: of the block.
        offset: e / R.
    """

    leading_edge_rad: float
    trailing_edge_rad: float
    conditions: GroupConditions
    offset: float

    @classmethod
    def of(cls, block: ModelledBlock) -> Self:
        """Return the state of a block."""
        return cls(block.leading_edge_rad, block.trailing_edge_rad, block.conditions, relative_offset(block))


class TravellingEdgeWaves(SignalEffect):
    """Waves that the tread's blocks send along the belt from both edges, and a separate packet ahead of the contact.

    Orders, decays and near fields at every speed follow from the number of blocks and the belt's own dispersion
    (`gateway.diagnosis.effects.belt_dispersion`). At one speed this is two orders, two decays and the share along the
    belt in other numbers; at several speeds it is over-determined.

    The passing of blocks is no pure tone. Its second harmonic sends a wave of 2N on the same belt, with an amplitude of
    its own. Ahead of the contact its order is above those that are compared.
    """

    name = "travelling edge waves"
    rank = 170
    summary = "The tread's blocks send waves along the belt from both edges of the contact, alike in every revolution."
    equation = (
        "R omega^2 (v / 20 m/s)^growth times Re[(a - i b) (exp(i n d) + rho exp(i n' d))] on either side, d = distance "
        "from the edge, n = N - k before and its conjugate after for N blocks and k waves round the belt, "
        "rho A (n omega)^2 = EI (k / R)^4 + T (k / R)^2 + kw with losses; near field n' = N - k', k' the root that "
        "ends within a wave, rho = -(k / k') (n' / n)^2 (slope held at the edge); the same with 2N after; and times "
        "(a cos(n x) + b sin(n x)) exp(-x^2 / (2 width^2)) ahead, x = d - place; orders 0 and 1 removed; "
        "circumferential: -(e/R) kappa times its slope, kappa = 1 - N / n of every part (ahead as before)"
    )
    source = "inextensible ring under pressure and rotation, excited N and 2N times a turn where its slope is held"
    parameters = (
        _amplitude("before_cosine", _MAX_EDGE_AMPLITUDE, 0.2),
        _amplitude("before_sine", _MAX_EDGE_AMPLITUDE, 0.2),
        _amplitude("after_cosine", _MAX_EDGE_AMPLITUDE, 0.2),
        _amplitude("after_sine", _MAX_EDGE_AMPLITUDE, 0.2),
        # A harmonic is smaller than what it belongs to.
        _amplitude("second_cosine", _MAX_EDGE_AMPLITUDE, 0.1),
        _amplitude("second_sine", _MAX_EDGE_AMPLITUDE, 0.1),
        # Passenger car tires have 50 to 80 pitches, truck and winter patterns from 40, fine ones up to 110.
        Parameter("blocks", "per revolution", 36.0, 120.0, 25.0, 1e-4, prior_mean=70.0),
        # A car tire's belt: 7 N m^2 and 4 kN over 3 to 8 kg/m. Tires of one class differ by a factor of two either way.
        Parameter("bending_over_mass_m4ps2", "m^4/s^2", 0.05, 12.0, 1.5, 1e-4, prior_mean=1.5),
        Parameter("tension_over_mass_m2ps2", "m^2/s^2", 200.0, 5000.0, 600.0, 1e-1, prior_mean=1200.0),
        # A sidewall of 0.3 ms damping time has 50 /s. Up to the ends of both ranges a packet is longer than two waves.
        Parameter("sidewall_loss_ps", "1/s", 0.0, 1500.0, 150.0, 1e-3, prior_mean=50.0),
        # A belt of EI / (rho A) = 1.5 m^4/s^2 with a loss factor of 0.1 at 600 Hz has 4e-5; rubber of 0.5 2e-4.
        Parameter("bending_loss_m4ps", "m^4/s", 0.0, 3e-3, 3e-4, 1e-9, prior_mean=1e-4),
        *_packet("ahead"),
        Parameter("ahead_place_rad", "rad", 0.0, 1.0, 0.2, 1e-5, prior_mean=0.25),
        # From a wave at the highest orders to the free belt's near half.
        Parameter("ahead_width_rad", "rad", 0.02, 0.4, 0.05, 1e-5, prior_mean=0.09),
        # 0 where blocks move the belt by their height, -1 where they push it by their share of the load.
        Parameter("growth", "", -3.0, 3.0, 0.8, 1e-4, prior_mean=-0.5),
    )
    axes = (CIRCUMFERENTIAL, RADIAL)
    observed_in = (
        "radial axis, outside the contact, above the ring's own orders; orders and decays change with speed as the "
        "belt's dispersion says; the circumferential axis of an offset sensor gives kappa, hence N, at one speed"
    )
    confounders = (
        Confounder(
            ("tire-locked edge waves",), "their circumferential share has kappa = 1 and their orders keep at any speed"
        ),
        Confounder(("tread pitch",), "it is in the contact as well", "0.9 at the same order"),
        Confounder(("torsional ripple",), "it is all around the tire", "0.6 at the same order"),
        Confounder(("contact edge scatter", "shear flexibility"), "they act at the edges themselves", "0.2"),
    )
    start_values = tuple(
        (0.3, 0.3, 0.3, 0.3, 0.0, 0.0, blocks, bending, 1200.0, 50.0, 1e-4, *_START_AHEAD, -0.5)
        for bending in _START_BENDING
        for blocks in _START_BLOCKS
    )
    form_of = _EDGE_WAVES
    scan = ((10, _SCAN_BENDING_LOSS), (9, _SCAN_SIDEWALL_LOSS))
    stage = Stage.BELT

    def contribution(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the packets; nothing without amplitude, whatever the orders."""
        if not parameters[_AMPLITUDE_INDICES].any():
            return block.zeros()
        return self._contribution(_State.of(block), tuple(parameters.tolist()))

    @lru_cache(maxsize=64)  # noqa: B019 - the catalogue's effects live as long as the program
    def _contribution(self, state: _State, parameters: tuple[float, ...]) -> FloatArray:
        """Return the packets; a scan asks for those of a set with every candidate."""
        packets = self._packets(state, parameters)
        result: FloatArray = self._size(state, parameters)[0] * _travelling_signal(state, packets)
        result.setflags(write=False)
        return result

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the derivatives by amplitudes, tread, belt, the packet ahead and the growth."""
        state = _State.of(block)
        packets = self._packets(state, tuple(parameters.tolist()))
        rows = np.zeros((len(parameters), 2, len(_ORDER)), complex)
        for packet in packets:
            rows[packet.first : packet.first + 2] += spectrum_of(np.stack([packet.curves, -1j * packet.curves]))
            slopes = spectrum_of(packet.amplitude * np.stack(packet.slopes(), axis=1))
            rows[packet.behind.start : packet.behind.stop] += slopes
        size, logarithm = self._size(state, parameters.tolist())
        result = _wave_signal(state, rows[:, 0], rows[:, 1])
        result[-1] = logarithm * _travelling_signal(state, packets)
        return size * result

    @staticmethod
    def _size(state: _State, parameters: Sequence[float]) -> tuple[float, float]:
        """Return the size over that at the reference speed, beyond omega^2, and its derivative's logarithm."""
        conditions = state.conditions
        relative = conditions.omega_radps * conditions.radius_m / _REFERENCE_MPS
        return relative ** parameters[-1], math.log(relative)

    @lru_cache(maxsize=4)  # noqa: B019 - as above
    def _packets(self, state: _State, p: tuple[float, ...]) -> list[_Packet]:
        """Return the packets before, after, that of the second harmonic, and the one ahead."""
        conditions = state.conditions
        tread = BlockTread(*p[_TREAD_INDICES.start : _TREAD_INDICES.stop])
        packets = []
        for first, side, harmonic in _WAVES:
            harmonic_tread = replace(tread, blocks=harmonic * tread.blocks)
            wave = belt_wave(harmonic_tread, side, conditions.omega_radps, conditions.radius_m)
            waves = Running.of(state, side, wave.orders)
            parts = np.stack([wave.sizes, wave.sizes * wave.shares])
            curves = (parts @ waves.curves.reshape(len(waves.curves), -1)).reshape(2, 2, -1)
            slopes_of = partial(_slopes, wave, waves, harmonic)
            packets.append(_Packet(first, _amplitude_at(p, first), curves, _TREAD_INDICES, slopes_of))
            if first == 0:
                leading_wave = wave
        # On the same belt, so its share along the belt is that of the wave before.
        shape = p[_AHEAD_INDICES.start : _AHEAD_INDICES.stop]
        curve, share = pulse(state, *shape), leading_wave.shares[0]
        indices = range(_TREAD_INDICES.start, _AHEAD_INDICES.stop)

        def slopes() -> tuple[ComplexArray, ComplexArray]:
            pulse_slopes, share_by = pulse_by(curve, shape[0], shape[-1]), leading_wave.shares_by[0]
            curve_by = np.zeros((len(indices), *curve.shape), complex)
            along_by = np.zeros_like(curve_by)
            curve_by[-3:], along_by[-3:] = pulse_slopes, share * pulse_slopes
            along_by[: len(share_by)] = share_by[:, None, None] * curve
            return curve_by, along_by

        curves = np.stack([curve, share * curve])
        packets.append(_Packet(_AHEAD_FIRST, _amplitude_at(p, _AHEAD_FIRST), curves, indices, slopes))
        return packets


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
    parameters = (*_packet("before"), _decay("before"), *_packet("after"), _decay("after"))
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
        for edge, first in (("leading", 0), ("trailing", 4)):
            amplitudes = slice(first, first + 2)
            order, decay = parameters[first + 2 : first + 4].tolist()
            is_present = np.hypot(*parameters[amplitudes]) > _DETERMINED_SIGMAS * np.hypot(*std[amplitudes])
            if is_present and order < 2.0 * np.pi * decay:
                return Reason(DiagnosisCode.FADES_WITHIN_ONE_WAVE, edge=edge, waves=order / (2.0 * np.pi * decay))
        return None

    def contribution(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the packets; nothing without amplitude, whatever the orders."""
        if not parameters[[0, 1, 4, 5]].any():
            return block.zeros()
        waves = self._waves(block, parameters)
        return _wave_signal(_State.of(block), np.fft.rfft(waves[:, 0].real.sum(axis=0)))

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the derivatives by amplitudes and shapes."""
        rows = self._waves(block, parameters)[:, 1:].real.reshape(len(parameters), FIELD_SIZE)
        return _wave_signal(_State.of(block), np.fft.rfft(rows))

    def _waves(self, block: ModelledBlock, parameters: FloatArray) -> ComplexArray:
        """Return either packet and its derivatives by its four parameters, as complex curves (2, 5, FIELD_SIZE)."""
        p, belt = parameters.tolist(), free_belt(block)
        curves = []
        for side, first in enumerate((0, 4)):
            curve = belt.packet(side, p[first + 2], p[first + 3])
            wave, distance = _amplitude_at(p, first) * curve, belt.distance_rad[side]
            curves.append(np.stack([wave, curve, -1j * curve, 1j * distance * wave, -distance * wave]))
        return np.stack(curves)


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
        wave = np.tensordot(parameters[:2], _pitch_waves(block, parameters)[0], 1)
        return _wave_signal(_State.of(block), np.fft.rfft(wave))

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
        return _wave_signal(_State.of(block), np.fft.rfft(np.stack(rows)))


def _slopes(wave: BeltWave, waves: Running, harmonic: int) -> tuple[ComplexArray, ComplexArray]:
    """Return the derivatives of a wave and of its part along the belt by the fields of `BlockTread`.

    Args:
        wave: of `harmonic` times the tread's blocks.
        waves: its parts on the free belt.
        harmonic: multiple of the number of blocks.
    """
    curves, curves_by = waves.curves, waves.by_order()
    sizes_by, order_slopes = wave.sizes_by, wave.sizes[:, None] * wave.orders_by
    wave_by = np.tensordot(sizes_by.T, curves, 1) + np.tensordot(order_slopes.T, curves_by, 1)
    along_by = np.tensordot((sizes_by * wave.shares[:, None]).T, curves, 1)
    along_by += np.tensordot((wave.sizes[:, None] * wave.shares_by).T, curves, 1)
    along_by += np.tensordot((order_slopes * wave.shares[:, None]).T, curves_by, 1)
    for rows in (wave_by, along_by):
        rows[0] *= harmonic
    return wave_by, along_by


def _amplitude_at(parameters: Sequence[float], first: int) -> complex:
    """Return cosine minus i sine."""
    return complex(parameters[first], -parameters[first + 1])


def _travelling_signal(state: _State, packets: list[_Packet]) -> FloatArray:
    """Return the contribution of packets, (3, FIELD_SIZE)."""
    curves = np.sum([packet.amplitude * packet.curves for packet in packets], axis=0)
    return _wave_signal(state, *spectrum_of(curves))


def _pitch_waves(block: ModelledBlock, parameters: FloatArray) -> FloatArray:
    """Return cosine and sine wave, and both differentiated by order and by width, (3, 2, FIELD_SIZE).

    In reverse the pattern is the mirror image.
    """
    order, width = float(parameters[2]), max(float(parameters[3]), _MIN_PITCH_WIDTH_RAD)
    theta = block.theta_rad
    distance_rad = np.maximum(np.maximum(block.leading_edge_rad - theta, theta - block.trailing_edge_rad), 0.0)
    square = np.square(distance_rad / width)
    envelope = np.exp(-0.5 * square)
    side = -1.0 if block.conditions.reverse else 1.0
    cosine, sine = envelope * np.cos(order * theta), side * envelope * np.sin(order * theta)
    waves = np.stack([cosine, sine])
    return np.stack([waves, np.stack([-side * theta * sine, side * theta * cosine]), waves * (square / width)])


def _wave_signal(state: _State, wave: ComplexArray, along: ComplexArray | None = None) -> FloatArray:
    """Return the contribution of a wave of the belt's curvature to the axes.

    Args:
        state: of the block.
        wave: its spectrum on the model's grid in R omega^2, (..., FIELD_SIZE // 2 + 1).
        along: that of the part that changes along the belt as it does for the sensor, kappa times the wave; None where
            all of it does.

    Returns:
        (..., 3, FIELD_SIZE), m/s^2.
    """
    scale = state.conditions.radius_m * state.conditions.omega_radps**2
    result = np.zeros((*wave.shape[:-1], 3, FIELD_SIZE))
    # Without amplitude, the derivatives by all but the amplitudes are zero.
    for axis, spectrum, factor in (
        (RADIAL, wave, scale * _CURVATURE_FACTOR),
        (CIRCUMFERENTIAL, wave if along is None else along, -state.offset * scale * _SLOPE_FACTOR),
    ):
        is_nonzero = spectrum.any(axis=-1) & bool(factor.any())
        result[is_nonzero, axis] = np.fft.irfft(spectrum[is_nonzero] * factor, n=FIELD_SIZE, axis=-1)
    return result


EFFECTS: Final = (TravellingEdgeWaves(), TireLockedEdgeWaves(), TreadPitch())
