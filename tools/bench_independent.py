"""Closure of the independent tire: what the diagnosis names on a belt of finite elements, and its numbers.

Each tire of tools/independent_tire, or several of one tire at other speeds joined by a comma, is diagnosed from the
exact ring: 100 revolutions in five blocks with white noise. Load, pressure, radius and the depth of the sensor are
stated exactly, so what is found is what the belt has and the ring has not.

Run: python tools/bench_independent.py --rolled DIR [--tire NAME[,NAME]] [--depth-mm 4] [--noise 0.5] [--waves]
"""

import argparse
import json
import math
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from accuracy.tables import Table

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.types import FloatArray
from gateway.diagnosis.closed_loop import diagnose
from gateway.diagnosis.data.campaign_data import Block, Campaign, Group
from gateway.diagnosis.data.revolution_orders import waveform_orders
from gateway.diagnosis.effects.angle_orders import ORDERS
from gateway.diagnosis.effects.belt_dispersion import BlockTread, belt_wave
from gateway.diagnosis.effects.effect import CIRCUMFERENTIAL, RADIAL, GroupConditions
from gateway.diagnosis.result import Diagnosis, Finding, Verdict

_NUMBERS = ("Bs", "Cw", "Rs", "Ts")
_MOST_VALUES = 6
_BLOCKS, _REVOLUTIONS = 5, 20
# Distance from the contact's edges within which the belt is not free.
_FROM_EDGE_RAD = 0.2
_SINGLE = ("car-45", "car-65", "car-120", "van-40", "van-80", "drum-65", "blocks-45", "blocks-60", "blocks-75")
_TIRES = (*_SINGLE, "blocks-45,blocks-60,blocks-75")
# Loads nearer than this, relative, are one state of the tire.
_SAME_LOAD = 0.02


@dataclass(frozen=True, slots=True)
class Rolled:
    """A kept tire.

    Attributes:
        about: its description.
        signal_mps2: (3, angles) mean of its revolutions, the lateral axis NaN.
    """

    about: dict[str, Any]
    signal_mps2: FloatArray

    @property
    def omega_radps(self) -> float:
        """Angular speed."""
        return float(self.about["speed_mps"] / self.about["radius_m"])


def read(path: Path, depth_mm: int) -> Rolled:
    """Return a kept tire as a sensor at a depth reads it.

    Raises:
        SystemExit: the file is missing.
    """
    if not path.is_file():
        sys.exit(f"{path} is missing: make it with python -m independent_tire --cache {path.parent} --tire {path.stem}")
    with np.load(path) as archive:
        about = json.loads(str(archive["description"]))
        radial, along, up_radial, up_along = archive[f"shape_{depth_mm}"].mean(axis=1)[:4]
    square = (about["speed_mps"] / about["radius_m"]) ** 2
    signal = np.full((3, len(radial)), np.nan)
    signal[RADIAL] = square * radial + STANDARD_GRAVITY_MPS2 * up_radial
    signal[CIRCUMFERENTIAL] = square * along + STANDARD_GRAVITY_MPS2 * up_along
    return Rolled(about, signal)


def campaign_of(tires: Sequence[Rolled], depth_mm: int, noise_mps2: float, seed: int) -> Campaign:
    """Return a campaign with one recording for each tire; `noise_mps2` is that of an order of one revolution."""
    rng = np.random.default_rng(seed)
    variance = np.full((3, ORDERS), noise_mps2**2)
    variance[1] = np.nan
    groups: list[Group] = []
    for index, tire in enumerate(tires):
        about, truth = tire.about, waveform_orders(tire.signal_mps2)
        current = GroupConditions(
            omega_radps=tire.omega_radps,
            omega_dot_radps2=0.0,
            radius_m=about["radius_m"],
            load_n=about["load_n"],
            pressure_pa=about["pressure_pa"],
            temperature_degc=25.0,
            reference_degc=25.0,
            rate_hz=9600.0,
            time_s=60.0 * index,
        )
        blocks = []
        for _ in range(_BLOCKS):
            real, imaginary = rng.normal(0.0, noise_mps2 / math.sqrt(_REVOLUTIONS), (2, 3, ORDERS))
            imaginary[:, 0] = 0.0
            blocks.append(Block(_REVOLUTIONS, current, truth + real + 1j * imaginary))
        leading, trailing = about["edges_rad"]
        states = len({group.state for group in groups})
        alike = (
            group.state for group in groups if abs(math.log(group.conditions.load_n / current.load_n)) < _SAME_LOAD
        )
        groups.append(
            Group(
                about["name"],
                index,
                next(alike, states),
                current,
                tuple(blocks),
                variance,
                0.5 * (trailing - leading),
                declared_offset_m=1e-3 * depth_mm,
            )
        )
    states = len({group.state for group in groups})
    return Campaign("FL", tuple(group.label for group in groups), tuple(groups), states, {})


def row_of(tires: Sequence[Rolled], result: Diagnosis) -> tuple[str, ...]:
    """Return the row of one diagnosis."""
    truth = dict(zip(_NUMBERS, tires[0].about["numbers"], strict=True))
    numbers = []
    for name in _NUMBERS:
        value = result.estimates_after[name]
        text = f"{100.0 * (value.value / truth[name] - 1.0):+.1f} ± {100.0 * value.std / truth[name]:.1f}"
        numbers.append(text if result.determined.get(name, False) else f"({text})")
    named = [_with_values(finding) for finding in result.findings if finding.verdict is Verdict.NAMED]
    opened = [finding.name for finding in result.findings if finding.verdict is Verdict.INDISTINGUISHABLE]
    held = result.held_out
    return (
        " ".join(tire.about["name"] for tire in tires),
        "; ".join(named) or "nothing",
        ", ".join(opened),
        *numbers,
        f"{held.rms_before_mps2:.2f}",
        f"{held.rms_after_mps2:.2f}",
        f"{result.noise_floor_mps2:.2f}",
    )


def _with_values(finding: Finding) -> str:
    """Return the name of an effect with its values, or their number if they are many."""
    if len(finding.parameters) > _MOST_VALUES:
        return f"{finding.name} ({len(finding.parameters)} parameters)"
    values = ", ".join(f"{name} {fitted.value:.4g} ± {fitted.std:.2g}" for name, fitted in finding.parameters.items())
    return f"{finding.name} {values}"


def wave_table(folder: Path) -> Table:
    """Return the orders of the edge waves of every tire with blocks, and those of the effect's dispersion.

    The measured order is the peak of the radial signal on the free belt under a Hann window. The other one follows from
    the tire's parameters; nothing is fitted.
    """
    rows = []
    for path in sorted(folder.glob("*.npz")):
        tire = read(path, 0)
        about = tire.about
        blocks, mass = about.get("blocks", 0), about["mass_kgpm"]
        if not blocks:
            continue
        tension = about["pressure_pa"] * about["tension_width_m"] * about["radius_m"] / mass
        losses = about["sidewall_damping_nspm2"] / mass, about["bending_damping_nm2s"] / mass
        tread = BlockTread(blocks, about["bending_nm2"] / mass, tension, *losses)
        radial = tire.signal_mps2[RADIAL]
        theta = -math.pi + 2.0 * math.pi / len(radial) * np.arange(len(radial))
        leading, trailing = about["edges_rad"]
        along = np.mod(theta - trailing, 2.0 * math.pi)
        free = (along > _FROM_EDGE_RAD) & (along < 2.0 * math.pi - (trailing - leading) - _FROM_EDGE_RAD)
        window = np.hanning(int(free.sum()))[np.argsort(np.argsort(along[free]))]
        for side, name, sign in ((0, "ahead", 1.0), (1, "behind", -1.0)):
            orders = blocks + sign * np.arange(5.0, 30.0, 0.05)
            # The window's own shape and the ring's smooth part are far below these orders.
            size = np.abs(np.exp(-1j * np.outer(orders, along[free])) @ (window * radial[free]))
            wave = belt_wave(tread, side, tire.omega_radps, about["radius_m"])
            rows.append(
                (
                    about["name"],
                    name,
                    f"{orders[int(size.argmax())]:.1f}",
                    f"{wave.order:.1f}",
                    f"{2.0 / window.sum() * size.max():.1f}",
                )
            )
    heads = ("tire", "wave", "order", "by dispersion", "size, m/s^2")
    return Table("Edge waves of the independent tire", "nothing is fitted", heads, tuple(rows))


def main(arguments: Sequence[str] | None = None) -> None:
    """Diagnose the tires and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rolled", type=Path, required=True, help="folder that tools/independent_tire wrote")
    parser.add_argument("--tire", action="append", help="this tire, or tires joined by a comma, instead of all")
    parser.add_argument("--depth-mm", type=int, default=4, choices=(0, 2, 4, 6, 8, 12), help="of the sensor, stated")
    parser.add_argument("--noise", type=float, default=0.5, help="of an order of one revolution, m/s^2")
    parser.add_argument("--seed", type=int, default=1, help="of the noise")
    parser.add_argument("--markdown", action="store_true", help="table to paste into docs")
    parser.add_argument("--waves", action="store_true", help="compare the orders of edge waves instead")
    options = parser.parse_args(arguments)
    if options.waves:
        print(wave_table(options.rolled).text(markdown=options.markdown))
        return
    rows = []
    for joined in options.tire or _TIRES:
        tires = [read(options.rolled / f"{name}.npz", options.depth_mm) for name in joined.split(",")]
        begun = time.process_time()
        diagnosis = diagnose(campaign_of(tires, options.depth_mm, options.noise, options.seed))
        print(f"{joined}: {time.process_time() - begun:.0f} s", file=sys.stderr, flush=True)
        rows.append(row_of(tires, diagnosis))
    heads = ("tire", "named", "indistinguishable", "Bs, %", "Cw, %", "Rs, %", "Ts, %", "before", "after", "floor")
    note = "errors and stated standard errors; in brackets what is not determined; held-out rms in m/s^2"
    print(Table("Closure of the independent tire", note, heads, tuple(rows)).text(markdown=options.markdown))


if __name__ == "__main__":
    main()
