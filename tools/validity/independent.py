"""Runs of the independent tire: a belt of finite elements, made by tools/independent_tire."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.interpolate import CubicSpline

from gateway.simulator.tire_table import COLUMNS, LATERAL, TABLE_ANGLES, WaveformTable
from gateway.simulator.wheel_plan import WheelPlan
from gateway.types import FloatArray
from validity.runs import Run, record_wheel
from validity.tires import World, draw_world

_DEEPEST_MM: Final = 12.0
# Orders that are kept, and those that are not, over the number of elements.
_MESH: Final = (0.7, 0.95)
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
        with np.load(path) as kept:
            about = json.loads(str(kept["description"]))
            means = (kept[f"shape_{depth:g}"].mean(axis=1) for depth in (0.0, _DEEPEST_MM))
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


def record_rolled(tire: RolledTire, world: World, seed: tuple[int, ...]) -> Run:
    """Return a run of a kept tire; its lateral axis is silent."""

    def waveforms(plan: WheelPlan, _: World) -> RolledTable:
        share = 1e3 * plan.tire.sensor_offset_m / _DEEPEST_MM
        parts = tire.shallow + share * (tire.deep - tire.shallow)
        coarse = np.linspace(-math.pi, math.pi, parts.shape[1] + 1)
        curve = CubicSpline(coarse, np.concatenate([parts, parts[:, :1]], axis=1), axis=1, bc_type="periodic")
        wave: WaveformTable = np.zeros((TABLE_ANGLES + 1, COLUMNS), np.float32)
        wave[:, :LATERAL] = curve(np.linspace(-math.pi, math.pi, TABLE_ANGLES + 1)).T
        leading, trailing = tire.about["edges_rad"]
        return RolledTable(wave, (leading, trailing))

    return record_wheel(world, world.plan(), waveforms, seed, lateral=False)
