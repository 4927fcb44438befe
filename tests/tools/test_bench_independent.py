"""Campaigns of the independent tire, and the orders of its edge waves."""

import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

from bench_independent import campaign_of, read, wave_table
from independent_tire.tires import TIRES

from gateway.closure.effects.belt_dispersion import BlockTread, belt_wave
from gateway.closure.effects.effect import CIRCUMFERENTIAL, LATERAL, RADIAL

BELT = next(belt for belt in TIRES if belt.blocks)


def write_orders(folder: Path, orders: tuple[float, float]) -> None:
    """Write a tire that is round but for a wave on either side of its contact."""
    theta = -math.pi + 2.0 * math.pi / 2048 * np.arange(2048)
    shape = np.zeros((6, 2, 2048))
    shape[0] = BELT.radius_m
    for order, edge, ahead in zip(orders, (-0.2, 0.2), (True, False), strict=True):
        there = theta < edge if ahead else theta > edge
        shape[0] += there * 0.01 * np.cos(order * (theta - edge))
    names = ("name", "radius_m", "pressure_pa", "tension_width_m", "bending_nm2", "mass_kgpm", "speed_mps", "blocks")
    about = {name: getattr(BELT, name) for name in (*names, "sidewall_damping_nspm2", "bending_damping_nm2s")}
    about |= {"load_n": 4000.0, "edges_rad": [-0.2, 0.2], "numbers": [3e-3, 0.2, 3.0, 2.5]}
    np.savez(folder / f"{BELT.name}.npz", description=json.dumps(about), shape_0=shape, shape_4=shape)


def test_wave_table_reads_the_orders(tmp_path: Path) -> None:
    mass = BELT.mass_kgpm
    tension = BELT.pressure_pa * BELT.tension_width_m * BELT.radius_m / mass
    tread = BlockTread(BELT.blocks, BELT.bending_nm2 / mass, tension, 0.0, 0.0)
    orders = tuple(belt_wave(tread, side, BELT.omega_radps, BELT.radius_m).order for side in (0, 1))
    write_orders(tmp_path, (orders[0], orders[1]))
    for row in wave_table(tmp_path).rows:
        assert float(row[2]) == pytest.approx(float(row[3]), abs=0.5)


def test_campaign_has_the_tires_orders(tmp_path: Path) -> None:
    write_orders(tmp_path, (80.0, 55.0))
    tire = read(tmp_path / f"{BELT.name}.npz", 4)
    (group,) = campaign_of([tire], 4, 1e-6, 1).groups
    orders = group.blocks[0].orders_mps2
    assert orders[RADIAL, 0].real == pytest.approx(tire.signal_mps2[RADIAL].mean(), rel=1e-6)
    assert np.isnan(orders[LATERAL]).all()
    assert np.abs(orders[CIRCUMFERENTIAL]).max() < 1e-4
    assert group.declared_offset_m == 4e-3


def test_missing_tire_is_reported(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="is missing: make it with"):
        read(tmp_path / "none.npz", 4)
