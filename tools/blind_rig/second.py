"""The second set of blind cases, by someone who has not read the diagnosis: rig, inventions, and finite elements."""

import math
from collections.abc import Callable
from functools import partial
from typing import Final

import numpy as np
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.signal import butter, lfilter, sosfilt

from blind_rig.cases import (
    ALONG,
    RADIAL,
    RATE_HZ,
    Array,
    Case,
    Chain,
    Drive,
    _apart,
    _below_zero,
    _clip,
    _gain,
    _late,
    _lowpass,
    _patch,
    _shaken,
    _turned,
    _wobble,
)
from blind_rig.ring import Ring


def _each(change: Callable[[Drive, Array], Array], axis: int) -> Chain:
    """Return a chain that changes one axis: `change` gives its samples."""

    def chain(drive: Drive, f: Array) -> Array:
        f = f.copy()
        f[axis] = change(drive, f[axis])
        return f

    return chain


def _also(*chains: Chain) -> Chain:
    def chain(drive: Drive, f: Array) -> Array:
        for one in chains:
            f = one(drive, f)
        return f

    return chain


def _plus(what: Callable[[Drive], Array], axis: int) -> Chain:
    return _each(lambda drive, a: a + what(drive), axis)


def _highpass(hz: float) -> Chain:
    sos = butter(1, hz, "highpass", fs=RATE_HZ, output="sos")
    return lambda _, f: sosfilt(sos, f - f.mean(axis=1, keepdims=True), axis=1)


def _tone(mps2: float, hz: float) -> Chain:
    return _plus(lambda drive: mps2 * np.sin(2.0 * math.pi * hz * drive.time_s), RADIAL)


def _locked(mps2: float, order: float, omega_power: float = 0.0) -> Callable[[Drive], Array]:
    return lambda drive: mps2 * (drive.omega_radps / 60.0) ** omega_power * np.sin(order * drive.angle_rad + 0.4)


def _long_sensor(length_m: float, radius_m: float) -> Chain:
    def chain(drive: Drive, _: Array) -> Array:
        places = np.linspace(-0.5, 0.5, 9) * length_m / radius_m
        mean: Array = np.mean([drive.shape(drive.angle_rad + shift_rad) for shift_rad in places], axis=0)
        return mean

    return chain


def _resonant(hz: float, q: float, axis: int) -> Chain:
    w = 2.0 * math.pi * hz / RATE_HZ
    alpha = math.sin(w) / (2.0 * q)
    gain = 0.5 * (1.0 - math.cos(w))
    b, a = [gain, 2.0 * gain, gain], [1.0 + alpha, -2.0 * math.cos(w), 1.0 - alpha]
    return _each(lambda _, x: lfilter(b, a, x - x[0]) + x[0], axis)


def _clock(ppm: float, drive: Drive, _: Array) -> Array:
    shape: Array = drive.shape(drive.angle_rad * (1.0 + 1e-6 * ppm))
    return shape


def _creeping(metres: float, radius_m: float, drive: Drive, _: Array) -> Array:
    shape: Array = drive.shape(drive.angle_rad + metres / radius_m * drive.time_s / drive.time_s[-1])
    return shape


def _puddle(mps2: float, drive: Drive) -> Array:
    # Water in the tire lies on the sensor while it is below, each turn another amount.
    from_it = np.mod(drive.angle_rad + math.pi, 2.0 * math.pi) - math.pi
    turn = np.floor((drive.angle_rad + math.pi) / (2.0 * math.pi)).astype(int)
    amount = np.random.default_rng(5).uniform(0.3, 1.7, int(turn.max() - turn.min()) + 1)[turn - turn.min()]
    return mps2 * amount * np.exp(-0.5 * (from_it / 0.3) ** 2)


def _tail(share: float, over_mps2: float, a: Array) -> Array:
    keep = math.exp(-1.0 / (0.015 * RATE_HZ))
    over = np.sign(a - a.mean()) * np.maximum(np.abs(a - a.mean()) - over_mps2, 0.0)
    tail: Array = a - share * lfilter([1.0 - keep], [1.0, -keep], over)
    return tail


_DEEP: Final = {"depth_m": 0.006, "stated_mm": 6.0}
_HUB: Final = ("imbalance and hub motion",)
_SECOND_RING: Final = Ring(bs=4.0e-3, cw=0.17, rs=3.6, ts=3.1, radius_m=0.37, pressure_pa=3.4e5, mass_kgpm=5.0)
_ELEMENTS: Final = {"elements": True}

SECOND: Final[tuple[Case, ...]] = (
    Case("another tire, nothing", ring=_SECOND_RING),
    Case("small drum", (("drum curvature",),), ring=Ring(drum_pm=1.6), size=("drum curvature", "curvature_pm", 1.6)),
    Case("weak dashpot", (("structural damping",),), ring=Ring(sidewall_damping_nspm2=60.0)),
    Case("stiff steel belt", (("belt extension",),), ring=Ring(extension_n=1.2e7)),
    Case("roll alone", (("roll tilt",),), chain=partial(_turned, 3.0, 0.0)),
    Case("pitch alone", (("pitch tilt",),), chain=partial(_turned, 0.0, 2.0)),
    Case("weak axis", (("circumferential gain",),), chain=partial(_gain, -0.06, ALONG), **_DEEP),
    Case("early axis", (("circumferential delay",),), chain=partial(_late, -60e-6, ALONG), **_DEEP),
    Case("clipped low", (("clipping",),), chain=partial(_clip, 1100.0)),
    Case("lowpass of one pole", (("anti-alias filter",),), ("circumferential delay",),
         chain=partial(_lowpass, 1500.0, 1)),
    Case("gain below zero, deep", (("gain below zero",),), ("mounting offset",), depth_m=0.008, stated_mm=None,
         chain=partial(_below_zero, 0.06, ALONG)),
    Case("coupled by a capacitor", (("AC coupling",),), chain=_highpass(0.8)),
    Case("long sensor", (("sensor length",),), ("mounting offset",), chain=_long_sensor(0.03, 0.315)),
    Case("loose sensor", (("mounting resonance",),), ("anti-alias filter",), chain=_resonant(900.0, 6.0, RADIAL)),
    Case("coarse clock", (("sample clock error",),), chain=partial(_clock, 1500.0)),
    Case("wobble of order 2", (("torsional ripple",),), turn=partial(_wobble, 0.004, 2, 1.9)),
    Case("shaken more", ((*_HUB, "run-out"),), ("run-out", *_HUB), chain=partial(_shaken, 0.15, 2.0)),
    Case("chips apart the other way", (("circumferential shift",),), ("mounting offset",),
         chain=partial(_apart, -0.004, 0.315), **_DEEP),
    Case("two at once", (("circumferential gain",), ("drum curvature",)), ring=Ring(drum_pm=0.7),
         chain=partial(_gain, 0.04, ALONG), **_DEEP),
    Case("square of the along axis", (("square of the circumferential axis",),),
         chain=_each(lambda _, a: a + 2e-4 * a**2, ALONG), **_DEEP),
    Case("splice by the sensor", (("local bending stiffness",),),
         stiffer=partial(_patch, 0.25, 3.0, 2.0)),
    Case("splice under the sensor", (("local bending stiffness",),),
         stiffer=partial(_patch, -0.2, 0.0, 1.6)),
    # Inventions.
    Case("mains", chain=_tone(6.0, 50.0)),
    Case("motor at 37.4 turns", chain=_plus(_locked(8.0, 37.4), RADIAL)),
    Case("gear at 9 turns", also=("torsional ripple", *_HUB), chain=_plus(_locked(6.0, 9.0, 2.0), ALONG)),
    Case("water in the tire", chain=_plus(partial(_puddle, 25.0), RADIAL)),
    Case("amplifier's tail", chain=_each(lambda _, a: _tail(0.15, 150.0, a), RADIAL)),
    Case("median of five", also=("anti-alias filter",), chain=lambda _, f: median_filter(f, (1, 5))),
    Case("boxcar of seven", also=("anti-alias filter", "sensor length"),
         chain=lambda _, f: uniform_filter1d(f, 7, axis=1)),
    Case("creeping along the liner", also=("sample clock error",), chain=partial(_creeping, 0.02, 0.315)),
    Case("magnetic belt", also=_HUB, chain=_also(_plus(_locked(3.0, 1.0), ALONG), _plus(_locked(2.0, 2.0), ALONG))),
    Case("coarse steps", chain=lambda _, f: np.round(f / 25.0) * 25.0),
    Case("every tenth sample stuck", chain=lambda _, f: np.where(np.arange(f.shape[1]) % 10 == 9, np.roll(f, 1, 1), f)),
    # Finite elements in place of the chain.
    Case("elements, nothing", **_ELEMENTS),
    Case("elements, offset", (("mounting offset",),), depth_m=0.006, stated_mm=3.0, **_ELEMENTS),
    Case("elements, dashpot", (("structural damping",),), ring=Ring(sidewall_damping_nspm2=120.0), **_ELEMENTS),
    Case("elements, late axis", (("circumferential delay",),), chain=partial(_late, 90e-6, ALONG), **_DEEP,
         **_ELEMENTS),
    Case("elements, water", chain=_plus(partial(_puddle, 20.0), RADIAL), **_ELEMENTS),
)  # fmt: skip
