"""Print how many local changes trends see and place, by their size, and false ones, on the blind rig's rings.

    python tools/bench_structure.py FOLDER [TIRES]

The rings (`tools/blind_rig`) share nothing with the gateway. Their answers to EI, tread stiffness, tread height and
mass at one place, to wear and to pressure are worked out once into FOLDER, a few minutes. Of 60 recordings each has its
own speed, load, pressure and noise; the tire wears, has splices and uneven tread of its own. At one place of 12 degrees
stiffness is lost bit by bit, or at once tread, as by a locked wheel, or a weight that was glued to the liner.
"""

import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

if __name__ == "__main__":  # started by its path
    sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from gateway.fleet.trends.structure_trend import FIRST_ORDER, LAST_ORDER, structure_changes
from gateway.fleet.trends.tire_history import MONTH_NS, TireHistory
from tools.blind_rig.ring import _ORDERS, Ring, _Chain, _derivative, _read

Array = np.ndarray[Any, Any]

KMH: Final = np.array([40.0, 55.0, 75.0, 100.0])
LOADS_N: Final = (3600.0, 4600.0)
RINGS: Final = (Ring(), Ring(bs=3.6e-3, cw=0.18, rs=3.3, ts=2.1, radius_m=0.34, pressure_pa=2.5e5))
COUNT: Final = 60
_WAVES: Final = 60
_NODES: Final = 1440
_DEPTH_M: Final = 0.004
_HALF_DEG: Final = 6.0
# Kinds of changes: sizes, unit, and whether the change comes at once.
_KINDS: Final = {
    "EI": ((0.05, 0.1, 0.2, 0.4), "", False),
    "tread stiffness": ((0.05, 0.1, 0.2, 0.4), "", False),
    "tread height": ((0.02, 0.05, 0.1, 0.2), "mm", True),
    "mass": ((5.0, 10.0, 20.0, 40.0), "g", True),
}


class Answers(NamedTuple):
    """Orders 0 to 60 over R Omega^2 by speed and load (4, 2, ...): ring, change by wear and pressure, local answers."""

    ring: Array
    worn: Array
    low: Array
    local: Array


def _orders(curve: Array, ring: Ring) -> Array:
    """Return the orders 0 to 60 of a curve from -pi on, c - i s over the radius, halved."""
    orders: Array = (np.fft.rfft(curve) / len(curve))[:61] * (-1.0) ** np.arange(61) / ring.radius_m
    return orders


def _rolling(ring: Ring, kmh: float, load_n: float) -> tuple[_Chain, Array, float, Array]:
    chain = _Chain(ring, load_n, kmh / 3.6 / ring.radius_m, _NODES)
    x, height = chain.loaded()
    return chain, x, height, _read(x, _derivative(x, 1, _ORDERS), _DEPTH_M, _ORDERS).inertia_m[0]


def _local(ring: Ring, kmh: float, load_n: float) -> Array:
    """Return the answers to what varies `count` times a turn, (4, waves, 2, 61); tread height in mm, else shares."""
    chain, x, height, base = _rolling(ring, kmh, load_n)
    tangent, (straight, push) = chain.tangent(x, height), chain.forces(x, height, 0.0 * chain.ei)
    slope, answers, tiny = _derivative(x, 1, _ORDERS), np.zeros((4, _WAVES, 2, 61), dtype=complex), 1e-3
    up = np.stack([np.zeros(_NODES), 1e-3 * ring.tread_npm2 * ring.radius_m * chain.h * (push[1] > 0.0)])
    second = np.roll(x, -1, axis=1) - 2.0 * x + np.roll(x, 1, axis=1)
    thrown = chain.centrifugal / (ring.radius_m * chain.h) * second
    for count in range(_WAVES):
        wave, solve = np.exp(1j * count * chain.theta), chain.vibrating(tangent, count)
        by_ei = straight - chain.forces(x, height, chain.ei * wave)[0]
        for kind, force in enumerate((by_ei, -push * wave, -up * wave, thrown * wave)):
            answer = solve(force)
            turned = (np.roll(answer, -1, axis=1) - np.roll(answer, 1, axis=1)) / (2.0 * chain.h)
            for part, factor in enumerate((1.0, 1j)):
                by = tiny * factor / wave
                moved = _read(x + (by * answer).real, slope + (by * turned).real, _DEPTH_M, _ORDERS).inertia_m[0]
                answers[kind, count, part] = _orders((moved - base) / tiny, ring)
    return answers


def answers_of(number: int, folder: Path) -> Answers:
    """Return the answers of a ring, from the folder where they are there."""
    path = folder / f"ring-{number}.npz"
    if not path.exists():
        ring = RINGS[number]
        worn = replace(ring, bs=0.85 * ring.bs, mass_kgpm=0.9 * ring.mass_kgpm)
        part = 0.92
        low = replace(
            ring, pressure_pa=part * ring.pressure_pa, bs=ring.bs / part,
            rs=ring.rs / math.sqrt(part), ts=ring.ts / math.sqrt(part),
        )  # fmt: skip
        steady = [
            np.array([[_orders(_rolling(kind, kmh, load)[3], kind) for load in LOADS_N] for kmh in KMH])
            for kind in (ring, worn, low)
        ]
        local = np.array([[_local(ring, kmh, load) for load in LOADS_N] for kmh in KMH])
        folder.mkdir(parents=True, exist_ok=True)
        np.savez(path, ring=steady[0], worn=steady[1] - steady[0], low=steady[2] - steady[0], local=local)
    with np.load(path) as stored:
        return Answers(*(stored[name] for name in Answers._fields))


def _piece(answers: Answers, kind: int, place_rad: float, half_rad: float, share: float) -> Array:
    """Return the answer to a trapezium of a share over a place, (4, 2, 61)."""
    theta = np.linspace(-np.pi, np.pi, 4096, endpoint=False)
    away = np.abs(np.mod(theta - place_rad + np.pi, 2.0 * np.pi) - np.pi)
    window = share * np.clip(1.5 * (1.0 - away / half_rad), 0.0, 1.0)
    waves = np.mean(window * np.exp(-1j * np.outer(np.arange(_WAVES), theta)), axis=1)
    waves[1:] *= 2.0
    parts = answers.local[:, :, kind]
    whole: Array = np.tensordot(parts[:, :, :, 0], waves.real, (2, 0)) + np.tensordot(
        parts[:, :, :, 1], waves.imag, (2, 0)
    )
    return whole


def tire(
    answers: Answers, seed: int, kind: int = 0, share: float = 0.0, noise: float = 3e-3, *, is_sudden: bool = False
) -> tuple[TireHistory, float]:
    """Return sixty recordings of a tire and the place, rad, where `share` of a kind is lost, bit by bit or at once."""
    rng = np.random.default_rng([67, seed])
    time = np.sort(rng.uniform(0.0, 1.0, COUNT))
    kmh = np.clip(rng.uniform(52, 80) + rng.normal(0, 9, COUNT) + rng.normal(0, 6) * time, 42, 98)
    heavy = np.clip(rng.normal(0.5, 0.2, COUNT), 0.0, 1.0)
    wear = rng.uniform(0.2, 1.0) * time + 0.3 * rng.uniform() * np.sin(6.28 * time + rng.uniform(0, 6))
    low = rng.normal(0.3, 0.3, COUNT) + rng.uniform(0.0, 0.6) * time
    fixed = answers.ring.copy()
    for number in range(6):
        place, half = rng.uniform(-np.pi, np.pi), math.radians(rng.uniform(3, 10))
        fixed = fixed + _piece(answers, number % 2, place, half, rng.normal(0.0, 0.2))
    place_rad = rng.uniform(-np.pi, np.pi)
    grown = _piece(answers, kind, place_rad, math.radians(_HALF_DEG), -share)
    course = (time > rng.uniform(0.3, 0.8)).astype(np.float64) if is_sudden else time
    by_speed = [np.prod([(kmh - b) / (a - b) for b in KMH if b != a], axis=0) for a in KMH]
    weights = np.stack(by_speed, axis=1)[:, :, None] * np.stack([1.0 - heavy, heavy], axis=1)[:, None, :]
    orders = sum(
        amount[:, None] * np.tensordot(weights, of, ((1, 2), (0, 1)))
        for amount, of in ((np.ones(COUNT), fixed), (wear, answers.worn), (low, answers.low), (course, grown))
    )[:, FIRST_ORDER : LAST_ORDER + 1]
    each = noise / math.sqrt(2.0 * orders.shape[1]) * np.exp(rng.normal(0.0, 0.2, COUNT))[:, None]
    orders = orders + each / math.sqrt(2.0) * (rng.normal(size=orders.shape) + 1j * rng.normal(size=orders.shape))
    names = tuple(f"r{number:02d}" for number in range(COUNT))
    columns = {
        "average_orders": 2.0 * np.stack([orders.real, -orders.imag], axis=2).reshape(COUNT, -1),
        "speed_mean_mps": (kmh + rng.normal(0.0, 0.1, COUNT)) / 3.6,
        "contact_length_m": 0.12 + 0.022 * (heavy - 0.5) + 0.013 * low + rng.normal(0.0, 1e-3, COUNT),
        "pressure_pa": 2.2e5 * (1.0 - 0.08 * low) + rng.normal(0.0, 500.0, COUNT),
    }
    times_ns = np.round(4.0 * MONTH_NS * time).astype(np.int64)
    history = TireHistory("car", "FL", "0000a001", names, names, times_ns, 3000.0 * time, True, columns, {})
    return history, place_rad % (2.0 * math.pi)


def main(folder: Path, tires: int) -> None:
    """Print the curve."""
    rings = [answers_of(number, folder) for number in range(len(RINGS))]
    false = sum(structure_changes([tire(rings[seed % 2], seed)[0]])[0] is not None for seed in range(3 * tires))
    print(f"healthy tires with a finding: {false} of {3 * tires}", flush=True)
    for kind, (name, (sizes, unit, is_sudden)) in enumerate(_KINDS.items()):
        for size in sizes:
            seen, within = 0, []
            for seed in range(tires):
                ring = RINGS[seed % 2]
                # The trapezium of a place holds two thirds of its width.
                place_kg = ring.mass_kgpm * ring.radius_m * math.radians(4.0 / 3.0 * _HALF_DEG)
                share = 1e-3 * size / place_kg if unit == "g" else size
                made, ahead_rad = tire(rings[seed % 2], 1000 + seed, kind, share, is_sudden=is_sudden)
                change = structure_changes([made])[0]
                seen += change is not None
                if change is not None and change.ahead_rad is not None:
                    within.append(change.ahead_rad[0] < ahead_rad < change.ahead_rad[1])
            lost = f"{size:g} {unit}" if unit else f"{100 * size:.0f} %"
            print(f"{name} -{lost}: {seen} of {tires}; place of {len(within)}, right {sum(within)}", flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "build/structure"), int(sys.argv[2]) if len(sys.argv) > 2 else 40)
