"""Undeclared effects: every effect of the catalogue that the simulator can make, at three sizes."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, Final

import numpy as np

from closure_rig.bench import SAMPLE_RATE_HZ, Bench
from closure_rig.bent import Bend
from gateway.core.constants import STANDARD_GRAVITY_MPS2

Tables = Mapping[str, Mapping[str, Any]]
"""Changes to a scenario: table -> key -> value; "wheel" is the wheel's table, "stated" the declared values."""

SIZES: Final = ("small", "middle", "large")


@dataclass(frozen=True, slots=True)
class Drawing:
    """Inputs from which a cause is made.

    Attributes:
        size: in the cause's unit.
        rng: random numbers of the case.
        bench: tire, sensor and runs.
    """

    size: float
    rng: np.random.Generator
    bench: Bench

    def sign(self) -> float:
        """Return -1 or 1."""
        return float(self.rng.choice([-1.0, 1.0]))

    def between(self, low: float, high: float) -> float:
        """Return a number in a range."""
        return float(self.rng.uniform(low, high))

    def phase_deg(self) -> float:
        """Return any angle."""
        return self.between(-180.0, 180.0)


class Locked(Enum):
    """Part of the signal that shows an effect: the mean revolution, the spectrum of the rest, or single contacts."""

    MEAN = "mean"
    SPECTRUM = "spectrum"
    EDGES = "edges"


@dataclass(frozen=True, slots=True)
class Cause:
    """A physical effect that a scenario can contain.

    Attributes:
        name: in the catalogue.
        unit: of the sizes.
        sizes: about the detection limit of the campaign, three times that, and a typical large value.
        tables: changes to the scenario for a size.
        mirrored: (table, key) of phases that change sign when the tire rolls backwards.
        per_load: (table, key) of what is in proportion to each run's load; their values are for 1 N.
        bend: nonlinearity of the sensor, which no scenario has; None when the tables are enough.
        locked: part of the signal that shows it.
        lowest: smallest size that is of interest; None for any.
        highest: largest size that a scenario allows or the catalogue calls possible; None for any.
    """

    name: str
    unit: str
    sizes: tuple[float, float, float]
    tables: Callable[[Drawing], Tables]
    mirrored: tuple[tuple[str, str], ...] = ()
    per_load: tuple[tuple[str, str], ...] = ()
    bend: Callable[[Drawing], Bend] | None = None
    locked: Locked = Locked.MEAN
    lowest: float | None = None
    highest: float | None = None


def _nothing(_: Drawing) -> Tables:
    return {}


def _offset(drawn: Drawing) -> Tables:
    sign = drawn.sign() if drawn.bench.offset_mm > drawn.size else 1.0
    return {
        "sensor": {"offset_mm": drawn.bench.offset_mm + sign * drawn.size},
        "stated": {"offset_mm": drawn.bench.offset_mm},
    }


def _tilt(key: str) -> Callable[[Drawing], Tables]:
    def tables(drawn: Drawing) -> Tables:
        return {"sensor": {key: drawn.sign() * drawn.size}, "stated": {key: 0.0}}

    return tables


def _yaw(drawn: Drawing) -> Tables:
    return {"sensor": {"yaw_deg": drawn.sign() * drawn.size}}


def _gain(drawn: Drawing) -> Tables:
    return {"sensor": {"gain_error_percent": [0.0, 0.0, drawn.sign() * drawn.size]}}


def _circumferential_gain(drawn: Drawing) -> Tables:
    return {"sensor": {"gain_error_percent": [drawn.sign() * drawn.size, 0.0, 0.0]}}


def _gain_temperature(drawn: Drawing) -> Tables:
    return {"sensor": {"gain_drift_percent_per_k": [0.0, 0.0, drawn.sign() * drawn.size]}}


def _zero_g(drawn: Drawing) -> Tables:
    first, second = drawn.rng.uniform(-drawn.size, drawn.size, 2).tolist()
    return {"sensor": {"zero_g_offset_g": [first, second, drawn.sign() * drawn.size]}}


def _ac(drawn: Drawing) -> Tables:
    return {"sensor": {"coupling": "ac", "highpass_hz": drawn.size, "coupling_declared": False}}


def _low_pass(drawn: Drawing) -> Tables:
    return {"sensor": {"bandwidth_hz": drawn.size}}


def _clock(drawn: Drawing) -> Tables:
    return {"hub": {"clock_ppm": drawn.sign() * drawn.size}}


def _clip(drawn: Drawing) -> Tables:
    return {
        "defect": {"clip_g": drawn.size * drawn.bench.highest_baseline_mps2 / STANDARD_GRAVITY_MPS2, "axes": ["radial"]}
    }


def _tire(key: str, *, signed: bool = False) -> Callable[[Drawing], Tables]:
    def tables(drawn: Drawing) -> Tables:
        return {"tire": {key: drawn.sign() * drawn.size if signed else drawn.size}}

    return tables


def _traction(drawn: Drawing) -> Tables:
    # As on a slope: the torque is proportional to the load.
    return {"tire": {"axle_torque_nm": drawn.sign() * 0.01 * drawn.size * 1e-3 * drawn.bench.radius_mm}}


def _drum(drawn: Drawing) -> Tables:
    return {"tire": {"drum_radius_mm": 1e3 * drawn.size}}


def _edge_waves(drawn: Drawing) -> Tables:
    orders = {"order_before": drawn.between(25.0, 40.0), "order_after": drawn.between(38.0, 60.0)}
    shape = {"decay_rad": drawn.between(0.6, 1.2), "phase_deg": drawn.phase_deg()}
    return {"edge_waves": {"amplitude_percent": drawn.size, **orders, **shape}}


def _pitch(drawn: Drawing) -> Tables:
    shape = {"reach_rad": drawn.between(0.15, 0.5), "phase_deg": drawn.phase_deg()}
    return {"tread_pitch": {"amplitude_percent": drawn.size, "blocks": float(drawn.rng.integers(55, 86)), **shape}}


def _ripple(drawn: Drawing) -> Tables:
    order = float(drawn.rng.choice([2, 3, 4, 6, 8, 12]))
    return {"vibration": {"ripple_percent": drawn.size, "ripple_order": order, "ripple_deg": drawn.phase_deg()}}


def _imbalance(drawn: Drawing) -> Tables:
    return {"vibration": {"imbalance_mps2": drawn.size, "imbalance_deg": drawn.phase_deg()}}


def _runout(drawn: Drawing) -> Tables:
    return {"tire": {"runout_mm": drawn.size, "runout_deg": drawn.phase_deg()}}


def _road(drawn: Drawing) -> Tables:
    return {"road": {"rms_mps2": drawn.size, "bandwidth_hz": drawn.between(250.0, 800.0)}}


def _hub(drawn: Drawing) -> Tables:
    return {"vibration": {"hub_rms_mps2": drawn.size, "hub_hz": drawn.between(9.5, 14.0)}}


def _cavity(drawn: Drawing) -> Tables:
    width = drawn.between(4.0, 10.0)
    hz = drawn.between(195.0, 245.0)
    return {"vibration": {"cavity_rms_mps2": drawn.size, "cavity_hz": hz, "cavity_bandwidth_hz": width}}


def _ply_steer(drawn: Drawing) -> Tables:
    return {"tire": {"cord_angle_deg": drawn.sign() * drawn.between(20.0, 30.0), "ply_separation_mm": drawn.size}}


def _slip(drawn: Drawing) -> Tables:
    return {"wheel": {"slip_angle_deg": drawn.sign() * drawn.size}}


def _bend(drawn: Drawing) -> Bend:
    at_mps2, share = 2000.0, 0.01 * drawn.sign() * drawn.size
    if drawn.rng.random() < 0.5:
        return Bend(share / at_mps2, 0.0)
    return Bend(0.0, share / at_mps2**2)


def _camber(drawn: Drawing) -> Tables:
    return {"wheel": {"camber_deg": drawn.sign() * drawn.size}}


def _scatter(drawn: Drawing) -> Tables:
    return {"road": {"leading_jitter_mm": drawn.size, "trailing_jitter_mm": drawn.size * drawn.between(0.1, 0.6)}}


def _loose(drawn: Drawing) -> Tables:
    return {"defect": {"loose_hz": drawn.size, "loose_q": drawn.between(8.0, 20.0)}}


def _radius(drawn: Drawing) -> Tables:
    return {"stated": {"radius_mm": drawn.bench.radius_mm / (1.0 + 0.01 * drawn.sign() * drawn.size)}}


CAUSES: Final[tuple[Cause, ...]] = (
    Cause("mounting offset", "mm", (0.012, 0.036, 3.0), _offset),
    Cause("roll tilt", "deg", (0.003, 0.01, 1.0), _tilt("roll_deg")),
    Cause("pitch tilt", "deg", (0.003, 0.01, 1.0), _tilt("pitch_deg")),
    # With the sensor on the neutral layer only gravity shows it.
    Cause("yaw tilt", "deg", (0.4, 1.2, 5.0), _yaw),
    Cause("gain", "%", (0.01, 0.03, 2.0), _gain),
    Cause("gain-temperature drift", "%/K", (0.0005, 0.0015, 0.03), _gain_temperature),
    Cause("sensor nonlinearity", "% at 2000 m/s^2", (0.02, 0.06, 1.0), _nothing, bend=_bend, highest=2.99),
    Cause("zero-g offset", "g", (0.006, 0.02, 1.0), _zero_g),
    # Any corner loses the mean, which is a hundred times the detection limit.
    Cause("AC coupling", "Hz", (0.05, 0.2, 1.0), _ac, lowest=0.05),
    # Beside its delay, which is the contact centre's, it goes with the cube of what is listed.
    Cause("anti-alias filter", "Hz", (1800.0, 1250.0, 600.0), _low_pass, lowest=0.45 * SAMPLE_RATE_HZ),
    Cause("sample clock error", "ppm", (40.0, 120.0, 1000.0), _clock, highest=999.0),
    Cause("clipping", "R Omega^2 of the fastest run", (1.36, 1.28, 1.1), _clip),
    Cause("structural damping", "N s/m^2", (1.5, 4.5, 100.0), _tire("foundation_damping_nspm2")),
    Cause("tread damping (shifted pressure)", "N s/m^2", (180.0, 540.0, 20_000.0), _tire("tread_damping_nspm2")),
    Cause("bending damping", "N m^2 s", (2e-5, 6e-5, 2e-3), _tire("bending_damping_nm2s")),
    Cause("contact asymmetry", "% traction", (0.1, 0.3, 10.0), _traction, per_load=(("tire", "axle_torque_nm"),)),
    Cause("belt extension", "MN (EA)", (20.0, 6.7, 3.0), _tire("extension_stiffness_mn")),
    Cause("shear flexibility", "kN (GA)", (9000.0, 3000.0, 150.0), _tire("shear_stiffness_kn")),
    Cause("rotary inertia", "kg m", (4e-5, 1.2e-4, 6e-4), _tire("rotary_inertia_kgm")),
    Cause("sidewall stiffening", "1/m", (1.2, 3.6, 9.0), _tire("sidewall_stiffening_pm")),
    Cause("drum curvature", "m", (700.0, 230.0, 1.7), _drum),
    Cause("tire-locked edge waves", "% of R Omega^2", (0.015, 0.045, 5.0), _edge_waves),
    Cause("tread pitch", "% of R Omega^2", (0.02, 0.06, 3.0), _pitch),
    Cause("torsional ripple", "%", (0.002, 0.006, 0.5), _ripple),
    Cause("imbalance and hub motion", "m/s^2", (0.08, 0.24, 3.0), _imbalance, (("vibration", "imbalance_deg"),)),
    Cause("run-out", "mm", (0.025, 0.075, 1.5), _runout, (("tire", "runout_deg"),), highest=2.99),
    Cause("road vibration", "m/s^2", (0.1, 0.3, 5.0), _road, locked=Locked.SPECTRUM),
    Cause("hub vibration", "m/s^2", (0.18, 0.54, 2.0), _hub, locked=Locked.SPECTRUM),
    Cause("cavity resonance", "m/s^2", (0.07, 0.2, 5.0), _cavity, locked=Locked.SPECTRUM),
    Cause("ply steer", "mm (ply separation)", (0.008, 0.024, 1.2), _ply_steer),
    Cause("conicity", "deg", (0.01, 0.03, 0.6), _tire("conicity_deg", signed=True)),
    Cause("carcass compliance", "deg (slip angle)", (0.008, 0.024, 0.3), _slip),
    Cause("camber", "deg", (0.35, 1.0, 4.0), _camber, highest=6.0),
    # Visible in single revolutions, not in their mean; at 15 mg/rtHz three times the size is needed.
    Cause("contact edge scatter", "mm", (0.05, 0.15, 2.5), _scatter, locked=Locked.EDGES),
    Cause("mounting resonance", "Hz", (2400.0, 1600.0, 800.0), _loose, lowest=0.45 * SAMPLE_RATE_HZ),
    Cause("rolling radius", "%", (0.01, 0.03, 2.0), _radius),
    # With the sensor on the neutral layer only gravity shows it; some millimetres below, a hundredth of that is seen.
    Cause("circumferential gain", "%", (0.8, 2.4, 5.0), _circumferential_gain),
)


def cause(name: str) -> Cause:
    """Return a cause by its name."""
    return next(entry for entry in CAUSES if entry.name == name)
