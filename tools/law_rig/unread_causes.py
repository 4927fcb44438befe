"""Causes of the rig whose author had not read the library of laws: from tires, rims and sensors alone.

Other forms of its kinds, kinds that such a library may have, and causes outside of it.
"""

import math
from collections.abc import Callable
from typing import Final

import numpy as np

from gateway.core.types import FloatArray
from gateway.diagnosis.effects.angle_orders import THETA
from gateway.diagnosis.effects.effect import CIRCUMFERENTIAL, FIELD_SIZE, RADIAL, GroupConditions
from gateway.ring.rolling_ring.force_balance import ring_grid
from law_rig.causes import BeltCause, ChainCause, Fault, arch, area
from law_rig.rolling_in_time import NODES, LocalChange

_STEP_RAD: Final = 2.0 * math.pi / FIELD_SIZE
_ORDER: Final = np.arange(FIELD_SIZE // 2 + 1)
_ALONG: Final = "circumferential axis"
_REFERENCE_RADPS: Final = 50.0
_REFERENCE_LOAD_N: Final = 4500.0


def unread_belt_causes() -> tuple[BeltCause, ...]:
    """Return changes of the belt that are simulated."""
    theta = ring_grid(NODES).theta_rad
    glue = 0.35 * arch(0.1)
    # A ply's end tapers to one side only.
    taper = 0.3 * np.where((theta >= 0.0) & (theta < 0.25), 1.0 - theta / 0.25, 0.0)
    # Rubber that a locked wheel ground away: a chord's depth below the tread's circle.
    flat = -5e-5 * np.clip(1.0 - (theta / 0.07) ** 2, 0.0, None)
    # A block torn off to a third of its height bears little; its flanks are sharp.
    block = np.where(np.abs(theta) <= 0.05, -0.35, 0.0)
    dent_m, dent_rad = -1.5e-4, 0.45
    dent = LocalChange(axle_m=_dent(dent_m, dent_rad))
    oval_m, lobe_m = 1.3e-4, 1.0e-4
    return (
        BeltCause("weight, glue", "law: local mass", area(glue), LocalChange(mass=glue)),
        BeltCause("ply end, one-sided", "law: local sidewall stiffness", area(taper), LocalChange(sidewall=taper)),
        BeltCause("flat spot", "law: local tread height", area(flat), LocalChange(tread_m=flat)),
        BeltCause("torn block", "law: local tread stiffness", area(block), LocalChange(tread_stiffness=block)),
        BeltCause("dent, raised cosine", "law: bent rim", dent_m * dent_rad, dent),
        BeltCause(
            "pressed oval",
            "law: axle height of order 2",
            oval_m,
            LocalChange(axle_m=lambda angle: oval_m * (np.cos(2.0 * angle) + 0.1 * np.cos(4.0 * angle))),
        ),
        BeltCause(
            "three-jaw chuck",
            "law: axle height of order 3",
            lobe_m,
            LocalChange(axle_m=lambda angle: lobe_m * np.cos(3.0 * angle)),
        ),
    )  # fmt: skip


def _dent(height_m: float, half_rad: float) -> Callable[[FloatArray], FloatArray]:
    """Return the height of an axle on a rim with a dent of a raised cosine."""

    def axle_m(angle_rad: FloatArray) -> FloatArray:
        from_it = np.mod(angle_rad + math.pi, 2.0 * math.pi) - math.pi
        shape = 0.5 * (1.0 + np.cos(math.pi * from_it / half_rad))
        return np.where(np.abs(from_it) < half_rad, height_m * shape, 0.0)

    return axle_m


def unread_chain_causes(rng: np.random.Generator) -> tuple[ChainCause, ...]:
    """Return one error of each kind of the sensor chain with drawn sizes."""
    sign = rng.choice([-1.0, 1.0], 6)
    late_s, lag_mps2, share = rng.uniform(30e-6, 150e-6), rng.uniform(1.5, 7.0), sign[0] * rng.uniform(0.02, 0.08)
    knee, soft_mps2 = rng.uniform(0.5, 2.5), rng.uniform(1.0, 6.0)
    cross, back, pole_hz = (
        sign[1] * rng.uniform(0.03, 0.12),
        sign[2] * rng.uniform(0.003, 0.015),
        rng.uniform(800.0, 2000.0),
    )
    square_spmps2, length_m = sign[3] * rng.uniform(5e-5, 4e-4), rng.uniform(0.012, 0.025)
    cube = sign[4] * rng.uniform(5e-7, 3e-6)

    def all_pass(signal: FloatArray, conditions: GroupConditions) -> FloatArray:
        # Of the first order, as of a compensating stage: late by its delay at low frequencies, less above.
        s = 0.5j * _ORDER * conditions.omega_radps * late_s
        return _filtered(signal, CIRCUMFERENTIAL, (1.0 - s) / (1.0 + s))

    def bouc_wen(signal: FloatArray, _: GroupConditions) -> FloatArray:
        # A friction state z between -1 and 1 that follows the input's steps; two turns to forget the start.
        result, axis = signal.copy(), _finer(signal[CIRCUMFERENTIAL], 4)
        state, states = 0.0, np.empty(len(axis))
        steps = np.diff(axis, prepend=axis[-1])
        for number in range(2 * len(axis)):
            step = steps[number % len(axis)] / (knee * lag_mps2)
            # dz = dx (1 - sign(dx) z), integrated over the step.
            end = math.copysign(1.0, step)
            state = end + (state - end) * math.exp(-abs(step))
            states[number % len(axis)] = state
        result[CIRCUMFERENTIAL] -= lag_mps2 * states[::4]
        return result

    def lopsided(signal: FloatArray, _: GroupConditions) -> FloatArray:
        # The gain goes over from one side to the other as a hyperbolic tangent.
        result, axis = signal.copy(), signal[CIRCUMFERENTIAL]
        result[CIRCUMFERENTIAL] += 0.5 * share * axis * (1.0 - np.tanh(axis / soft_mps2))
        return result

    def capacitive(signal: FloatArray, conditions: GroupConditions) -> FloatArray:
        # Between two leads, through the input's pole.
        return _leaked(signal, CIRCUMFERENTIAL, RADIAL, cross, pole_hz, conditions)

    def feedback(signal: FloatArray, conditions: GroupConditions) -> FloatArray:
        return _leaked(signal, RADIAL, CIRCUMFERENTIAL, back, pole_hz, conditions)

    def gap(signal: FloatArray, _: GroupConditions) -> FloatArray:
        # One plate's capacity: the reciprocal of a gap that the reading closes.
        result, axis = signal.copy(), signal[CIRCUMFERENTIAL]
        result[CIRCUMFERENTIAL] = axis / (1.0 - square_spmps2 * axis)
        return result

    def feet(signal: FloatArray, conditions: GroupConditions) -> FloatArray:
        # A board on three feet, the middle one bearing half: the second moment of a uniform mean of its length.
        reach_rad = length_m / math.sqrt(6.0) / conditions.radius_m
        transfer = 0.5 + 0.5 * np.cos(_ORDER * reach_rad)
        return np.asarray(np.fft.irfft(np.fft.rfft(signal) * transfer, n=FIELD_SIZE))

    def hardening(signal: FloatArray, _: GroupConditions) -> FloatArray:
        # Clamped springs of the proof mass: the root of y - cube y^3 = a, by Newton.
        result, axis = signal.copy(), signal[CIRCUMFERENTIAL]
        root = axis.copy()
        for _step in range(8):
            root -= (root - cube * root**3 - axis) / (1.0 - 3.0 * cube * root**2)
        result[CIRCUMFERENTIAL] = root
        return result

    return (
        ChainCause("all-pass", f"law: delay of the {_ALONG}", late_s, all_pass),
        ChainCause("Bouc-Wen", f"law: hysteresis of the {_ALONG}", lag_mps2, bouc_wen),
        ChainCause("lopsided gain", f"law: gain below zero of the {_ALONG}", share, lopsided),
        ChainCause("capacitive leak", "law: circumferential in the radial axis", cross, capacitive),
        ChainCause("leak back", "law: radial in the circumferential axis", back, feedback),
        ChainCause("closing gap", f"law: square of the {_ALONG}", square_spmps2, gap),
        ChainCause("three feet", "law: mean over a length", length_m, feet),
        ChainCause("hardening spring", f"law: cube of the {_ALONG}", cube, hardening),
    )


def unread_outside_causes(rng: np.random.Generator) -> tuple[tuple[str, Fault], ...]:
    """Return causes that a library of local changes and sensor errors would not have."""
    size_mps2, hz, place_rad = rng.uniform(2.0, 12.0), rng.uniform(250.0, 800.0), rng.uniform(-2.5, 2.5)
    cavity_hz, zero = rng.uniform(190.0, 235.0), rng.uniform(0.005, 0.03)
    code_mps2 = rng.uniform(4.0, 16.0)

    def chatter(signal: FloatArray, conditions: GroupConditions) -> FloatArray:
        # Rubber that sticks and slips as it leaves the contact: saw teeth in time, more of them under more load.
        result = signal.copy()
        after_s = (THETA - _exit(signal)) / conditions.omega_radps
        teeth = np.mod(after_s * hz, 1.0) - 0.5
        size = size_mps2 * (conditions.load_n / _REFERENCE_LOAD_N) ** 2
        result[CIRCUMFERENTIAL] += np.where(after_s > 0.0, 4.0 * size * teeth * np.exp(-np.abs(after_s) / 0.004), 0.0)
        return result

    def cable(signal: FloatArray, conditions: GroupConditions) -> FloatArray:
        # A lead thrown about once a turn: a chirp that slackens, far stronger under load.
        result = signal.copy()
        after_rad = np.mod(THETA - place_rad, 2.0 * math.pi)
        size = size_mps2 * (conditions.load_n / _REFERENCE_LOAD_N) ** 3 * conditions.omega_radps / _REFERENCE_RADPS
        whip = np.sin(14.0 * np.sqrt(after_rad)) * after_rad * np.exp(-after_rad / 0.25) / 0.1
        result[RADIAL] += size * whip
        result[CIRCUMFERENTIAL] -= 0.6 * size * whip
        return result

    def warmed_zero(signal: FloatArray, conditions: GroupConditions) -> FloatArray:
        # The contact warms the cell: its zero rises there and cools off, in time, at no rate of the tire's.
        result = signal.copy()
        heat = np.where(np.abs(THETA) < _exit(signal), 1.0, 0.0)
        cooling = 1.0 / (1.0 + 1j * _ORDER * conditions.omega_radps * 0.006)
        result[CIRCUMFERENTIAL] += 40.0 * size_mps2 * zero * np.fft.irfft(np.fft.rfft(heat) * cooling, n=FIELD_SIZE)
        return result

    def cavity(signal: FloatArray, conditions: GroupConditions) -> FloatArray:
        # Air that rings round the torus at one frequency, struck at each contact.
        result = signal.copy()
        after_s = np.mod(THETA + _exit(signal), 2.0 * math.pi) / conditions.omega_radps
        result[RADIAL] += 0.3 * size_mps2 * np.exp(-after_s / 0.03) * np.sin(2.0 * math.pi * cavity_hz * after_s)
        return result

    def codes(signal: FloatArray, _: GroupConditions) -> FloatArray:
        # A converter that misses codes: steps that noise blurs a little.
        result, axis = signal.copy(), signal[RADIAL]
        ripple = np.sin(2.0 * math.pi * axis / code_mps2) - 0.4 * np.sin(4.0 * math.pi * axis / code_mps2)
        result[RADIAL] += 0.25 * code_mps2 * ripple
        return result

    return (
        ("chatter", chatter),
        ("cable", cable),
        ("warmed zero", warmed_zero),
        ("cavity", cavity),
        ("missing codes", codes),
    )


def _exit(signal: FloatArray) -> float:
    """Return the angle at which a sensor leaves the contact: where its radial axis rises most."""
    slope = np.where((THETA > 0.05) & (THETA < 0.6), np.gradient(signal[RADIAL]), -math.inf)
    return float(THETA[int(np.argmax(slope))])


def _finer(axis: FloatArray, times: int) -> FloatArray:
    return np.fft.irfft(np.fft.rfft(axis), n=times * len(axis)) * times


def _filtered(signal: FloatArray, axis: int, transfer: FloatArray) -> FloatArray:
    result = signal.copy()
    result[axis] = np.fft.irfft(np.fft.rfft(signal[axis]) * transfer, n=FIELD_SIZE)
    return result


def _leaked(
    signal: FloatArray, source: int, sink: int, share: float, pole_hz: float, conditions: GroupConditions
) -> FloatArray:
    """Return a signal of which one axis leaks into another through a pole."""
    transfer = share / (1.0 + 1j * _ORDER * conditions.omega_radps / (2.0 * math.pi * pole_hz))
    result = signal.copy()
    result[sink] += np.fft.irfft(np.fft.rfft(signal[source]) * transfer, n=FIELD_SIZE)
    return result
