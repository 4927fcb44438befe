"""Causes of the blind rig: effects of the catalogue in forms of its own, and inventions that no catalogue lists."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, lfilter, sosfilt

from blind_rig.ring import Ring

Array = NDArray[Any]

RATE_HZ: Final = 9600.0
ALONG, LATERAL, RADIAL = range(3)


@dataclass(frozen=True)
class Drive:
    """What happens while a recording is made.

    Attributes:
        time_s: (n,).
        angle_rad: (n,) of the sensor from the contact's centre.
        omega_radps: (n,).
        shape: from angles to the three axes' specific force at those angles, with this moment's speed.
    """

    time_s: Array
    angle_rad: Array
    omega_radps: Array
    shape: Callable[[Array], Array]


Turn = Callable[[Array], Array]
"""From the axle's angle (n,) to that of the sensor."""

Chain = Callable[[Drive, Array], Array]
"""From what happens and the axes (3, n) to what the sensor gives."""


@dataclass(frozen=True)
class Case:
    """A case.

    Attributes:
        name: of the case.
        right: names that are right, each a choice of names that say the same.
        also: names that are not false.
        ring: the tire.
        depth_m: of the sensor below the neutral layer.
        stated_mm: depth as stated; None where it is left to the import.
        turn: motion of the sensor against a steady turn.
        chain: of the sensor.
        size: effect, parameter and true value that is compared.
        elements: whether finite elements roll the ring, in place of the rig's chain.
        stiffer: share by which the belt is stiffer in bending, by the angle from the sensor; None where it is alike.
    """

    name: str
    right: tuple[tuple[str, ...], ...] = ()
    also: tuple[str, ...] = ()
    ring: Ring = field(default_factory=Ring)
    depth_m: float = 0.004
    stated_mm: float | None = 4.0
    turn: Turn | None = None
    chain: Chain | None = None
    size: tuple[str, str, float] | None = None
    elements: bool = False
    stiffer: Callable[[Array], Array] | None = None


def _patch(share: float, place_deg: float, half_deg: float, angle: Array) -> Array:
    """Return a trapezium: a joint has its full height over its middle and ends steeply."""
    from_it = np.degrees(np.mod(angle + math.pi, 2.0 * math.pi) - math.pi) - place_deg
    result: Array = share * np.clip(1.5 * (1.0 - np.abs(from_it) / half_deg), 0.0, 1.0)
    return result


def _below_zero(share: float, axis: int, _: Drive, f: Array) -> Array:
    f = f.copy()
    f[axis] = np.where(f[axis] < 0.0, (1.0 + share) * f[axis], f[axis])
    return f


def _gain(share: float, axis: int, _: Drive, f: Array) -> Array:
    f = f.copy()
    f[axis] *= 1.0 + share
    return f


def _late(delay_s: float, axis: int, drive: Drive, _: Array) -> Array:
    f = drive.shape(drive.angle_rad)
    f[axis] = drive.shape(drive.angle_rad - drive.omega_radps * delay_s)[axis]
    return f


def _turned(roll_deg: float, pitch_deg: float, _: Drive, f: Array) -> Array:
    cr, sr = math.cos(math.radians(roll_deg)), math.sin(math.radians(roll_deg))
    cp, sp = math.cos(math.radians(pitch_deg)), math.sin(math.radians(pitch_deg))
    roll = np.array([[1.0, 0.0, 0.0], [0.0, cr, sr], [0.0, -sr, cr]])
    pitch = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    return pitch @ roll @ f


def _lowpass(hz: float, order: int, _: Drive, f: Array) -> Array:
    sos = butter(order, hz, fs=RATE_HZ, output="sos")
    return sosfilt(sos, f - f[:, :1], axis=1) + f[:, :1]


def _clip(limit_mps2: float, _: Drive, f: Array) -> Array:
    f = f.copy()
    f[RADIAL] = np.minimum(f[RADIAL], limit_mps2)
    return f


def _shaken(mm: float, phase: float, drive: Drive, f: Array) -> Array:
    # The axle goes up and down once a turn, as omega squared; the sensor turns in it.
    up = 1e-3 * mm * drive.omega_radps**2 * np.cos(drive.angle_rad + phase)
    f = f.copy()
    f[RADIAL] += up * np.cos(drive.angle_rad)
    f[ALONG] += up * np.sin(drive.angle_rad)
    return f


def _cardan(bend_deg: float, angle: Array) -> Array:
    # A joint at an angle: its output runs ahead and behind twice a turn, with harmonics.
    c = math.cos(math.radians(bend_deg))
    return angle + np.arctan2((1.0 / c - 1.0) * np.tan(angle), 1.0 + np.tan(angle) ** 2 / c)


def _wobble(share: float, order: int, phase: float, angle: Array) -> Array:
    return angle + share / order * np.sin(order * angle + phase)


def _apart(gap_m: float, radius_m: float, drive: Drive, f: Array) -> Array:
    f = f.copy()
    f[ALONG] = drive.shape(drive.angle_rad + gap_m / radius_m)[ALONG]
    return f


def _loaded_gain(per_mps2: float, _: Drive, f: Array) -> Array:
    f = f.copy()
    f[ALONG] *= 1.0 - per_mps2 * f[RADIAL]
    return f


def _stiffer_above(share: float, hz: float, _: Drive, f: Array) -> Array:
    # A viscoelastic bond: one relaxation, stiffer for what is fast.
    pole = math.exp(-2.0 * math.pi * hz / RATE_HZ)
    f = f.copy()
    slow, _zi = lfilter([1.0 - pole], [1.0, -pole], f[RADIAL], zi=[pole * f[RADIAL, 0]])
    f[RADIAL] += share * (f[RADIAL] - slow)
    return f


def _rocking(rad_per_mps2: float, _: Drive, f: Array) -> Array:
    # A tall sensor on soft glue leans back under its own circumferential force.
    lean = rad_per_mps2 * f[ALONG]
    return np.stack([f[ALONG] + lean * f[RADIAL], f[LATERAL], f[RADIAL] - lean * f[ALONG]])


def _slew(mps3: float, _: Drive, f: Array) -> Array:
    f = f.copy()
    step, value = mps3 / RATE_HZ, float(f[RADIAL, 0])
    source = f[RADIAL].copy()
    for i, wanted in enumerate(source.tolist()):
        value += min(max(wanted - value, -step), step)
        f[RADIAL, i] = value
    return f


def _strained(per_curvature: float, drive: Drive, f: Array) -> Array:
    # The substrate bends with the belt and strains the die: an added signal that does not grow with speed.
    f = f.copy()
    f[ALONG] += per_curvature * (drive.shape(drive.angle_rad)[RADIAL] / drive.omega_radps**2)
    return f


def _sagging(share: float, drive: Drive, f: Array) -> Array:
    # The battery's voltage falls as the contact heats the cell: all gains fall with the time.
    return f * (1.0 - share * drive.time_s / drive.time_s[-1])


def _dead_band(half_mps2: float, _: Drive, f: Array) -> Array:
    f = f.copy()
    a = f[ALONG]
    f[ALONG] = np.sign(a) * np.maximum(np.abs(a) - half_mps2, 0.0)
    return f


def _pitch_once(rad: float, at: float, drive: Drive, f: Array) -> Array:
    # A flap of the liner lifts the sensor's front edge while it is behind the contact.
    from_it = np.mod(drive.angle_rad - at + math.pi, 2.0 * math.pi) - math.pi
    lean = rad * np.clip(1.0 - np.abs(from_it) / 0.35, 0.0, 1.0) ** 2
    return np.stack([f[ALONG] + lean * f[RADIAL], f[LATERAL], f[RADIAL] - lean * f[ALONG]])


_PLAIN: Final = Ring()

CASES: Final[tuple[Case, ...]] = (
    Case("nothing"),
    Case("depth left to the import", also=("mounting offset",), stated_mm=None),
    Case(
        "offset", (("mounting offset",),), depth_m=0.0065, stated_mm=3.0, size=("mounting offset", "offset_m", 3.5e-3)
    ),
    Case(
        "gain below zero, depth measured",
        (("gain below zero",),),
        ("mounting offset",),
        depth_m=0.007,
        stated_mm=None,
        chain=partial(_below_zero, -0.05, ALONG),
    ),
    Case(
        "gain below zero, depth stated",
        (("gain below zero",),),
        depth_m=0.007,
        stated_mm=7.0,
        chain=partial(_below_zero, 0.04, ALONG),
    ),
    Case("sidewall dashpot", (("structural damping",),), ring=Ring(sidewall_damping_nspm2=160.0)),
    Case("drum", (("drum curvature",),), ring=Ring(drum_pm=0.9), size=("drum curvature", "curvature_pm", 0.9)),
    Case(
        "filter of two poles", (("anti-alias filter",),), ("circumferential delay",), chain=partial(_lowpass, 700.0, 2)
    ),
    Case(
        "late axis",
        (("circumferential delay",),),
        depth_m=0.006,
        stated_mm=6.0,
        chain=partial(_late, 110e-6, ALONG),
        size=("circumferential delay", "delay_s", 110e-6),
    ),
    Case("turned sensor", (("roll tilt",), ("pitch tilt",)), chain=partial(_turned, 1.7, -0.9)),
    Case("stiff axle wobbles", (("torsional ripple",),), turn=partial(_wobble, 0.005, 3, 0.7)),
    Case("clipped", (("clipping",),), chain=partial(_clip, 1500.0)),
    Case(
        "shaken axle", (("imbalance and hub motion",),), ("run-out",), chain=partial(_shaken, 0.02, 0.8), stated_mm=None
    ),
    Case("soft belt", (("belt extension",),), ring=Ring(extension_n=5e6)),
    Case(
        "strong axis",
        (("circumferential gain", "gain"),),
        depth_m=0.006,
        stated_mm=6.0,
        chain=partial(_gain, 0.03, ALONG),
    ),
    # Inventions.
    Case(
        "chips apart",
        (("circumferential shift",),),
        ("mounting offset",),
        depth_m=0.006,
        stated_mm=None,
        chain=partial(_apart, 0.005, _PLAIN.radius_m),
    ),
    Case(
        "gain by the radial load",
        (("circumferential gain by the radial axis",),),
        ("mounting offset",),
        depth_m=0.007,
        stated_mm=None,
        chain=partial(_loaded_gain, 5e-5),
    ),
    Case("potting", chain=partial(_stiffer_above, 0.05, 30.0)),
    Case("cardan joint", (), ("torsional ripple",), turn=partial(_cardan, 6.0)),
    Case(
        "tall sensor",
        also=("circumferential gain by the radial axis",),
        depth_m=0.006,
        stated_mm=6.0,
        chain=partial(_rocking, 2e-4),
    ),
    Case("slew limit", chain=partial(_slew, 4e5)),
    Case("strained die", chain=partial(_strained, 60.0), depth_m=0.005, stated_mm=5.0),
    Case("sagging supply", (), ("gain",), chain=partial(_sagging, 0.01)),
    Case("dead band", depth_m=0.006, stated_mm=6.0, chain=partial(_dead_band, 6.0)),
    Case("lifted flap", chain=partial(_pitch_once, 0.03, 0.9)),
)
