"""The blind rig's own ring and judgement."""

import math
from dataclasses import replace

import numpy as np
import pytest
from blind_rig.__main__ import judged
from blind_rig.cases import CASES
from blind_rig.ring import NODES, Ring, rolled

from gateway.ring.rolling_ring import RingParameters, solve_rolling_ring


def test_ring_agrees_with_the_gateways() -> None:
    ring, load_n, omega = Ring(), 4500.0, 60.0
    other = RingParameters.from_numbers(
        ring.bs, ring.cw, ring.rs, ring.ts, radius_m=ring.radius_m, pressure_pa=ring.pressure_pa,
        mass_kgpm=ring.mass_kgpm, extension_stiffness_n=ring.extension_n, tread_stiffness_npm2=ring.tread_npm2,
    )  # fmt: skip
    expected = solve_rolling_ring(other, load_n, ring.pressure_pa, omega, nodes=NODES, sensor_offset_m=0.004).sensor
    wave = rolled(ring, load_n, omega, 0.004).inertia_m
    assert wave[0].mean() == pytest.approx(expected.radial_m.mean(), rel=1e-3)
    assert np.abs(wave[0] - expected.radial_m).max() < 0.03 * ring.radius_m
    assert np.sqrt(np.mean((wave[0] - expected.radial_m) ** 2)) < 2e-3 * ring.radius_m


def test_wrong_and_missing_names_are_counted() -> None:
    case = next(case for case in CASES if case.name == "turned sensor")
    named = [{"name": name, "verdict": "named"} for name in ("roll tilt", "gain")]
    said = judged(case, {"effects": named, "laws": []})
    assert said["false"] == ["gain"]
    assert said["missing"] == ["pitch tilt"]
    assert not judged(replace(case, right=()), {"effects": [], "laws": []})["missing"]
    assert math.isfinite(case.depth_m)
