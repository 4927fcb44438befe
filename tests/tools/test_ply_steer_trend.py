"""The figures of docs/evidence/closure-ply-steer-tables.md."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gateway.estimators.ply_steer_models import compare, table_points
from tools.ply_steer_trend import (
    PROPERTY_LOADS_N,
    beam_answer,
    belt_laws,
    derived_laws,
    exponent,
    judge,
    property_files,
    property_laws,
    short_patch,
    whole_patch,
)

MEASURED = Path(__file__).parents[2] / ".." / "shared" / "measured" / "tir"
POINTS, ANGLE = table_points()


def test_before_and_after() -> None:
    tried = {law.name: law for law in compare(POINTS, ANGLE)}
    assert len(tried) == 14
    before = tried["K / R (Eq. 18, flat contact)"]
    assert (before.left_out_rms, before.left_out_max) == pytest.approx((0.180, 0.246), abs=5e-4)
    limit = tried["K a / sqrt(p)"]
    assert (limit.left_out_rms, limit.left_out_max) == pytest.approx((0.029, 0.052), abs=5e-4)
    nominal = judge("", short_patch(POINTS, 1000.0, 0.5), ANGLE)
    assert (nominal.left_out_rms, nominal.left_out_max) == pytest.approx((0.060, 0.114), abs=5e-4)
    local = [law.left_out_rms for name, law in tried.items() if "Eq. 18" in name]
    assert len(local) == 3
    assert min(local) > 0.15


@pytest.mark.parametrize(
    ("bending_nm2", "errors", "ends", "couple_nm"),
    [
        (1.0, (0.034, 0.032, 0.031), 0.185, 0.6),
        (10.0, (0.046, 0.040, 0.035), 0.132, 2.2),
        (100.0, (0.063, 0.052, 0.042), 0.087, 9.7),
        (1000.0, (0.075, 0.060, 0.046), 0.073, 49.0),
    ],
)
def test_table_by_bending_stiffness(
    bending_nm2: float, errors: tuple[float, ...], ends: float, couple_nm: float
) -> None:
    laws = [judge("", short_patch(POINTS, bending_nm2, share), ANGLE) for share in (0.0, 0.5, 1.0)]
    assert [law.left_out_rms for law in laws] == pytest.approx(errors, abs=6e-4)
    assert judge("", whole_patch(POINTS, bending_nm2, 0.5), ANGLE).left_out_rms == pytest.approx(ends, abs=6e-4)
    assert 2.0 * POINTS.half_length_m[1] * laws[1].constants[0] == pytest.approx(couple_nm, rel=0.05)


def test_short_contact_is_limit_of_beam() -> None:
    """The formula against the beam's own answer to two forces close together, and against its limits."""
    tension, ky = np.array([4e3]), np.array([2.5e5])
    for bending in (3.0, 1e3):
        arm = 1e-4
        here, there = (beam_answer(np.array([x]), bending, tension, ky) for x in (0.0, 2.0 * arm))
        slope = (here - there) / arm
        expected = arm / np.sqrt(bending * (tension + 2.0 * np.sqrt(ky * bending)))
        assert slope == pytest.approx(expected, rel=0.01)
    limit = POINTS.half_length_m / np.sqrt(1e-6 * POINTS.tension_n)
    assert short_patch(POINTS, 1e-6, 0.5) == pytest.approx(limit, rel=1e-3)


def test_the_beams_answer_solves_its_equation() -> None:
    k = np.linspace(0.0, 3000.0, 600001)
    for x in (0.0, 0.1):
        integral = np.trapezoid(np.cos(k * x) / (50.0 * k**4 + 4e3 * k**2 + 2.5e5), k) / np.pi
        found = beam_answer(np.array([x]), 50.0, np.array([4e3]), np.array([2.5e5]))
        assert found == pytest.approx(integral, rel=1e-4)


def test_candidate_laws() -> None:
    derived = derived_laws(POINTS, ANGLE)
    assert len(derived) == 83
    named = {law.name: law for law in derived}
    line = named["c0 + c1 a / sqrt(p)"]
    assert abs(line.constants[0]) < 2e-5
    couples = [law for law in derived if law.name.startswith("couple")]
    stiff = [law.left_out_rms for law in couples if any(f"EI {ei:g} " in law.name for ei in (100, 300, 1000, 3000))]
    assert len(stiff) == 24
    assert max(stiff) < 0.101
    strings = [law for law in derived if law.name.startswith("string")]
    assert strings[0].left_out_rms == pytest.approx(0.039, abs=6e-4)
    assert "fixed length" in strings[0].name
    assert whole_patch(POINTS, 1000.0, 0.5) == pytest.approx(short_patch(POINTS, 1000.0, 0.5), rel=0.3)


def test_coupling_inside_belt_has_no_trend() -> None:
    laws = belt_laws(POINTS, ANGLE)
    assert len(laws) == 108
    assert laws[0].left_out_rms == pytest.approx(0.150, abs=2e-3)


def test_property_files_of_another_tire() -> None:
    if not MEASURED.is_dir():
        pytest.skip("the tire property files are not part of the repository")
    files = property_files(MEASURED)
    pressures = np.array([file.pressure_pa for file in files])
    assert pressures == pytest.approx([2.7e5, 4.14e5, 4.8e5, 6.5e5])
    assert max(file.values["FZMIN"] for file in files) < PROPERTY_LOADS_N[0]
    assert min(file.values["FZMAX"] for file in files) > PROPERTY_LOADS_N[-1]
    table = {
        12e3: ((0.188, 0.135, 0.112, 0.068), -1.14, -1.70),
        17e3: ((0.199, 0.163, 0.144, 0.100), -0.77, -1.26),
        22e3: ((0.212, 0.190, 0.176, 0.130), -0.53, -0.92),
    }
    for load, (degrees, of_angle, of_force) in table.items():
        angles = np.array([file.angle_at_zero(load) for file in files])
        assert np.degrees(angles) == pytest.approx(degrees, abs=6e-4)
        assert exponent(angles, pressures) == pytest.approx(of_angle, abs=6e-3)
        forces = np.array([file.force_at_zero(load) for file in files])
        assert exponent(forces, pressures) == pytest.approx(of_force, abs=6e-3)
        said = np.array([file.half_length_m(load) for file in files]) / np.sqrt(pressures)
        assert exponent(said, pressures) == pytest.approx(-0.92, abs=6e-3)
    found = {law.name: law.left_out_rms for law in property_laws(files)}
    assert list(found) == ["K a / sqrt(p)", "K Q / p", "K a", "K a / p", "c0 + c1 a^2 / p", "K (Eq. 18)"]
    assert list(found.values()) == pytest.approx([0.13, 0.20, 0.25, 0.34, 0.42, 0.50], abs=6e-3)
