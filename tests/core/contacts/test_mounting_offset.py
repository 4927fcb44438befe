"""Mounting offset and pitch tilt from the circumferential axis of the exact ring."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gateway.core.revolutions.sensor_mounting import belt_kinematics, mounting_rows, relative_curvature
from gateway.ring.rolling_ring import solve_rolling_ring
from tests.testkit.exact_ring import BASE_RING, PRESSURE_PA, RADIUS_M, omega_at, on_grid

OMEGA = omega_at(65.0)


def measured(offset_m: float, pitch_deg: float, load_n: float = 5000.0, ring=BASE_RING, omega_dot: float = 0.0):
    ring = solve_rolling_ring(ring, load_n, PRESSURE_PA, OMEGA, nodes=720, sensor_offset_m=offset_m)
    radial, along = ring.sensor.specific_force(OMEGA, omega_dot)
    pitch = math.radians(pitch_deg)
    return (
        on_grid(math.cos(pitch) * along + math.sin(pitch) * radial),
        on_grid(math.cos(pitch) * radial - math.sin(pitch) * along),
        on_grid(OMEGA**2 * ring.sensor.radial_m),
    )


def solved(offset_m: float, pitch_deg: float, shift: float = 0.0, **others) -> tuple[float, float, float]:
    along, radial, clean = measured(offset_m, pitch_deg, **others)
    result = np.zeros(3)
    for _ in range(4):
        belt = belt_kinematics(clean, result[0] / RADIUS_M, 0.0)
        acceleration = others.get("omega_dot", 0.0)
        spectra = np.fft.rfft(np.stack([along + shift, radial]))[np.newaxis, :, :61] * (2.0 / len(along))
        omega, omega_dot, order_max = np.array([OMEGA]), np.array([acceleration]), np.array([60])
        result = mounting_rows(spectra, belt, omega, omega_dot, RADIUS_M, order_max).solve()[0][0]
    return float(result[0]), math.degrees(math.atan(result[1])), float(result[2])


@pytest.mark.parametrize("offset_m", [0.0, 0.005, 0.010, -0.003])
@pytest.mark.parametrize("pitch_deg", [0.0, 3.0])
def test_offset_and_pitch_are_recovered(offset_m: float, pitch_deg: float) -> None:
    offset, pitch, zero = solved(offset_m, pitch_deg)
    assert offset == pytest.approx(offset_m, abs=3e-5)
    assert pitch == pytest.approx(pitch_deg, abs=0.005)
    assert abs(zero) < 0.05


@pytest.mark.parametrize(
    "others",
    [
        {"load_n": 2000.0},
        {"load_n": 8000.0},
        {"omega_dot": 9.0},
        {"shift": 5.0},
        {"ring": replace(BASE_RING, tread_damping_nspm2=5e4, foundation_damping_nspm2=200.0)},
    ],
)
def test_other_properties_do_not_bias_mounting(others: dict[str, object]) -> None:
    offset, pitch, zero = solved(0.005, 1.0, **others)
    assert offset == pytest.approx(0.005, abs=5e-5)
    assert pitch == pytest.approx(1.0, abs=0.01)
    assert zero == pytest.approx(others.get("shift", 0.0), abs=0.1)


def test_curvature_closes_belt_at_any_offset() -> None:
    _, _, clean = measured(0.0, 0.0)
    _, _, below = measured(0.008, 0.0)
    np.testing.assert_allclose(relative_curvature(below, 0.008 / RADIUS_M), relative_curvature(clean, 0.0), atol=3e-3)


def test_closure_determines_order_1() -> None:
    _, _, clean = measured(0.0, 0.0)
    theta = -math.pi + 2.0 * math.pi / 1024 * np.arange(1024)
    plain = belt_kinematics(clean, 0.0, 0.0)
    disturbed = belt_kinematics(clean + 3.0 * np.cos(theta), 0.0, 0.0)
    assert disturbed.signal_order_1 == pytest.approx(plain.signal_order_1, abs=3e-5)
    expected = 2.0 * float((clean * np.cos(theta)).mean()) / float(clean.mean())
    assert plain.signal_order_1 == pytest.approx(expected, abs=3e-4)  # they differ by belt stretch
