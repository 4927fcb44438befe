"""Runs of the independent tire: a belt of finite elements, made by tools/independent_tire."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from accuracy.tables import Table
from scipy.interpolate import CubicSpline

from gateway.core.types import FloatArray
from gateway.ring.rolling_ring import (
    RingParameters,
    RingSolution,
    TreadBlocks,
    block_response,
    loaded_belt,
    solve_rolling_ring,
)
from gateway.simulator.tire_table import COLUMNS, LATERAL, TABLE_ANGLES, WaveformTable
from gateway.simulator.wheel_plan import WheelPlan
from validity.runs import Run, record_wheel
from validity.tires import World, draw_world

_DEEPEST_MM: Final = 12.0
# Orders that are kept, and those that are not, over the number of elements.
_MESH: Final = (0.7, 0.95)
# Orders that are compared with the ring's.
_COMPARED: Final = 80
_RATES_HZ: Final = (4800.0, 6400.0, 9600.0)


@dataclass(frozen=True, slots=True)
class RolledTire:
    """A kept tire.

    Attributes:
        about: its parameters, load, edges and numbers.
        shallow: (6, angles) parts of the signal of a sensor on the middle line, mean of the revolutions.
        deep: likewise 12 mm below it; the signal is linear in the depth.
    """

    about: dict[str, Any]
    shallow: FloatArray
    deep: FloatArray

    def table(self, sensor_offset_m: float) -> RolledTable:
        """Return the waveforms of a sensor at a depth."""
        parts = self.shallow + 1e3 * sensor_offset_m / _DEEPEST_MM * (self.deep - self.shallow)
        coarse = np.linspace(-math.pi, math.pi, parts.shape[1] + 1)
        curve = CubicSpline(coarse, np.concatenate([parts, parts[:, :1]], axis=1), axis=1, bc_type="periodic")
        wave: WaveformTable = np.zeros((TABLE_ANGLES + 1, COLUMNS), np.float32)
        wave[:, :LATERAL] = curve(np.linspace(-math.pi, math.pi, TABLE_ANGLES + 1)).T
        leading, trailing = self.about["edges_rad"]
        return RolledTable(wave, (leading, trailing))


@dataclass(frozen=True, slots=True)
class RolledTable:
    """Waveforms of a kept tire under its own conditions, in place of a `TireTable`."""

    wave: WaveformTable
    edges: tuple[float, float]
    depends_on_speed: bool = False

    def edges_rad(self, *_: float) -> tuple[float, float]:
        """Return the edges of the contact."""
        return self.edges

    def waveform(self, *_: float) -> WaveformTable:
        """Return the waveform."""
        return self.wave.copy()


def rolled_tires(folder: Path) -> list[RolledTire]:
    """Return the kept tires of a folder, by name.

    Raises:
        FileNotFoundError: there are none.
    """
    paths = sorted(folder.glob("*.npz"))
    if not paths:
        raise FileNotFoundError(f"no tires in {folder}: make them with python -m independent_tire --cache {folder}")
    tires = []
    for path in paths:
        with np.load(path) as archive:
            about = json.loads(str(archive["description"]))
            means = (archive[f"shape_{depth:g}"].mean(axis=1) for depth in (0.0, _DEEPEST_MM))
            shallow, deep = (_without_mesh(mean, about["elements"]) for mean in means)
            tires.append(RolledTire(about, shallow, deep))
    return tires


def _without_mesh(parts: FloatArray, elements: int) -> FloatArray:
    """Return periodic curves (k, n) without the orders from the number of elements on, which are the mesh's."""
    spectrum = np.fft.rfft(parts, axis=1)
    share = np.arange(spectrum.shape[1]) / elements
    fade = np.clip((share - _MESH[0]) / (_MESH[1] - _MESH[0]), 0.0, 1.0)
    smooth: FloatArray = np.fft.irfft(spectrum * 0.5 * (1.0 + np.cos(math.pi * fade)), n=parts.shape[1], axis=1)
    return smooth


def rolled_world(tire: RolledTire, seed: int, index: int) -> World:
    """Return a kept tire with a sensor drawn from a seed."""
    about, drawn = tire.about, draw_world(seed, index)
    rng = np.random.default_rng([seed, index, 2])
    bs, cw, rs, ts = about["numbers"]
    return World(
        kind=about["name"],
        radius_m=about["radius_m"],
        numbers=(bs, cw, rs, ts),
        reference_pa=about["pressure_pa"],
        pressure_pa=about["pressure_pa"],
        load_n=about["load_n"],
        speed_kmh=3.6 * about["speed_mps"],
        rate_hz=float(rng.choice(_RATES_HZ)),
        noise_mg_rthz=drawn.noise_mg_rthz,
        offset_m=drawn.offset_m,
        gain_std_percent=drawn.gain_std_percent,
        gain_error=drawn.gain_error,
        zero_g_mps2=drawn.zero_g_mps2,
        tilt_deg=drawn.tilt_deg,
        tread_mpa=1e-6 * about["tread_npm2"],
        extension_mn=1e-6 * about["extension_n"],
        thickness_mm=drawn.thickness_mm,
        cord_angle_deg=0.0,
        ply_separation_mm=drawn.ply_separation_mm,
        lateral=drawn.lateral,
    )


def record_rolled(tire: RolledTire, world: World, seed: Sequence[int]) -> Run:
    """Return a run of a kept tire; its lateral axis is silent."""

    def waveforms(plan: WheelPlan, _: World) -> RolledTable:
        return tire.table(plan.tire.sensor_offset_m)

    return record_wheel(world, world.plan(), waveforms, seed, lateral=False)


def agreement_table(folder: Path) -> Table:
    """Return how far the kept tires agree with the exact ring of the same parameters, load and road.

    The ring has no friction; where the tire has, they differ for that reason too. Tread blocks make it vibrate.
    """
    rows = []
    for tire in rolled_tires(folder):
        about, omega = tire.about, tire.about["speed_mps"] / tire.about["radius_m"]
        ring = RingParameters.from_numbers(
            *about["numbers"],
            radius_m=about["radius_m"],
            pressure_pa=about["pressure_pa"],
            mass_kgpm=about["mass_kgpm"],
            extension_stiffness_n=about["extension_n"],
            tread_stiffness_npm2=about["tread_npm2"],
            foundation_damping_nspm2=about["sidewall_damping_nspm2"],
            tread_damping_nspm2=about["tread_damping_nspm2"],
            bending_damping_nm2s=about["bending_damping_nm2s"],
        )
        drum_m = about.get("drum_radius_m", math.inf)
        solved = solve_rolling_ring(
            ring, about["load_n"], about["pressure_pa"], omega, nodes=tire.shallow.shape[1], drum_radius_m=drum_m
        )
        missed_m = tire.shallow[0] - solved.sensor.radial_m
        without, rms = (omega**2 * _rms_m(item) for item in (missed_m, missed_m - _vibration_m(about, solved, drum_m)))
        special = [
            f"{about['bending_damping_nm2s']:g} N m^2 s bending damping" * bool(about["bending_damping_nm2s"]),
            f"{1e-3 * about['tread_damping_nspm2']:g} kN s/m^2 tread damping" * bool(about["tread_damping_nspm2"]),
            f"friction {about['friction']:g}" * bool(about["friction"]),
            f"drum {drum_m:g} m" * math.isfinite(drum_m),
            f"{about['blocks']} blocks of {100.0 * about['block_share']:g} %" * bool(about["blocks"]),
        ]
        rows.append(
            (
                about["name"],
                ", ".join(filter(None, special)),
                f"{about['load_n']:.0f}",
                " ".join(f"{edge:+.4f}" for edge in about["edges_rad"]),
                f"{solved.leading_edge_rad:+.4f} {solved.trailing_edge_rad:+.4f}",
                f"{1e3 * about['sinking_m']:.2f}",
                f"{1e3 * solved.deflection_m:.2f}",
                f"{rms:.2f} of {omega**2 * float(solved.sensor.radial_m.std()):.0f}",
                f"{without:.2f}" if about["blocks"] else "",
            )
        )
    heads = (
        "tire",
        "with",
        "load, N",
        "edges, rad",
        "ring's",
        "deflection, mm",
        "ring's",
        "difference, m/s^2",
        "without blocks",
    )
    return Table("Agreement with the exact ring", f"difference: rms of orders 1 to {_COMPARED}", heads, tuple(rows))


def _rms_m(curve: FloatArray) -> float:
    """Return the rms of the compared orders of a curve (n,)."""
    orders = np.fft.rfft(curve)[1 : _COMPARED + 1]
    return math.sqrt(0.5 * float(np.sum(np.abs(orders) ** 2))) * 2.0 / len(curve)


def _vibration_m(about: dict[str, Any], solved: RingSolution, drum_radius_m: float) -> FloatArray:
    """Return what the blocks of a kept tire add to the radial shape of the ring, (N,); its sensor is on a block."""
    if not about["blocks"]:
        return np.zeros(len(solved.theta_rad))
    bending_s = about["bending_damping_nm2s"] / about["bending_nm2"]
    tread_s = about["tread_damping_nspm2"] / about["tread_npm2"]
    blocks = TreadBlocks(about["blocks"], about["mass_kgpm"], bending_s, tread_s)
    reading = block_response(loaded_belt(solved, drum_radius_m), blocks, solved.omega_radps).signal[0]
    seen: FloatArray = (about["block_share"] * reading * np.exp(-1j * about["blocks"] * solved.theta_rad)).real
    return seen
