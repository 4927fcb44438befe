"""The blind rig's own ring and judgement."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from blind_rig.__main__ import CASES, judged
from blind_rig.cases import Drive, _patch
from blind_rig.elements import rolled_by_elements
from blind_rig.ring import NODES, Ring, rolled

from gateway.ring.rolling_ring import PATTERNS, Change, RingParameters, loaded_belt, local_response, solve_rolling_ring


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


def test_finite_elements_agree_with_the_chain() -> None:
    chain, elements = (roll(Ring(), 4500.0, 60.0, 0.004) for roll in (rolled, rolled_by_elements))
    assert np.sqrt(np.mean((chain.inertia_m - elements.inertia_m) ** 2)) < 1e-4 * Ring().radius_m
    assert np.abs(chain.gravity_mps2 - elements.gravity_mps2).max() < 1e-3


def test_splice_reads_as_the_gateways_ring_answers() -> None:
    """The steady chain, disturbed once a turn at every place; two solvers of their own, the losses alike."""
    ring, load_n, omega, depth_m = Ring(), 4500.0, 60.0, 0.004
    read = rolled(ring, load_n, omega, depth_m, partial(_patch, 0.25, 3.0, 2.0)).inertia_m
    read -= rolled(ring, load_n, omega, depth_m).inertia_m
    other = RingParameters.from_numbers(
        ring.bs, ring.cw, ring.rs, ring.ts, radius_m=ring.radius_m, pressure_pa=ring.pressure_pa,
        mass_kgpm=ring.mass_kgpm, extension_stiffness_n=ring.extension_n, tread_stiffness_npm2=ring.tread_npm2,
    )  # fmt: skip
    belt = loaded_belt(solve_rolling_ring(other, load_n, ring.pressure_pa, omega, nodes=1440, sensor_offset_m=depth_m))
    count, angle = np.arange(PATTERNS), np.linspace(-math.pi, math.pi, NODES + 1)
    window = np.trapezoid(_patch(0.25, 3.0, 2.0, angle) * np.exp(-1j * np.outer(count, angle)), angle)
    window *= np.where(count > 0, 1.0, 0.5) / math.pi
    response = np.asarray(local_response(belt, omega, 2e-5, depth_m, (Change.BENDING,))[0, 0])
    turned = response * np.exp(-1j * np.outer(count, angle[:-1:2]))[:, None]
    expected = np.tensordot(window, turned, 1).real
    assert np.corrcoef(read[:, ::2].ravel(), expected.ravel())[0, 1] > 0.98
    assert read.std() == pytest.approx(expected.std(), rel=0.2)


def test_sixty_cases_change_the_signal() -> None:
    """Each chain gives something else than the shape, and its own name counts once."""
    assert len({case.name for case in CASES}) == len(CASES) >= 60
    time_s = np.arange(9600) / 9600.0
    angle = 60.0 * time_s

    def shape(angles: np.ndarray) -> np.ndarray:
        return np.stack([80.0 * np.sin(angles), 3.0 * np.cos(angles), 1200.0 + 800.0 * np.cos(9.0 * angles)])

    drive = Drive(time_s, angle, np.full(9600, 60.0), shape)
    for case in CASES:
        if case.chain:
            changed = case.chain(drive, shape(angle))
            assert np.isfinite(changed).all()
            assert np.abs(changed - shape(angle)).max() > 0.01, case.name


def test_wrong_and_missing_names_are_counted() -> None:
    case = next(case for case in CASES if case.name == "turned sensor")
    named = [{"name": name, "verdict": "named"} for name in ("roll tilt", "gain")]
    said = judged(case, {"effects": named, "laws": []})
    assert said["false"] == ["gain"]
    assert said["missing"] == ["pitch tilt"]
    assert not judged(replace(case, right=()), {"effects": [], "laws": []})["missing"]
    assert math.isfinite(case.depth_m)
