"""The figures of docs/evidence/closure-ply-steer-tables.md."""

from pathlib import Path

import numpy as np
import pytest

from gateway.forces.ply_steer_models import compare, table_points
from tools.ply_steer_trend import (
    LEAST_CORNERING_NPDEG,
    PROPERTY_LOADS_N,
    BeltAnswer,
    ahead_laws,
    beam_answer,
    belt_answers,
    belt_laws,
    conicity_exponents,
    derived_laws,
    exponent,
    exponents_of,
    judge,
    plane,
    possible_force_factors,
    property_files,
    property_laws,
    rejection,
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
        current, there = (beam_answer(np.array([x]), bending, tension, ky) for x in (0.0, 2.0 * arm))
        slope = (current - there) / arm
        expected = arm / np.sqrt(bending * (tension + 2.0 * np.sqrt(ky * bending)))
        assert slope == pytest.approx(expected, rel=0.01)
    limit = POINTS.half_length_m / np.sqrt(1e-6 * POINTS.tension_n)
    assert short_patch(POINTS, 1e-6, 0.5) == pytest.approx(limit, rel=1e-3)


def test_the_beams_answer_solves_its_equation() -> None:
    k = np.linspace(0.0, 3000.0, 600001)
    for x in (0.0, 0.1):
        integral = np.trapezoid(np.cos(k * x) / (50.0 * k**4 + 4e3 * k**2 + 2.5e5), k) / np.pi
        result = beam_answer(np.array([x]), 50.0, np.array([4e3]), np.array([2.5e5]))
        assert result == pytest.approx(integral, rel=1e-4)


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


@pytest.fixture(scope="module")
def answers() -> list[BeltAnswer]:
    return belt_answers(POINTS)


def test_slopes_inside_the_contact_have_no_trend(answers: list[BeltAnswer]) -> None:
    laws = belt_laws(answers, ANGLE)
    assert len(laws) == 108
    assert laws[0].left_out_rms == pytest.approx(0.150, abs=2e-3)
    through = plane(POINTS, ANGLE)
    values = [column for answer in answers for column in answer.slopes_rad.T]
    assert max(rejection(value, ANGLE, through) for value in values) == pytest.approx(0.006, abs=1e-3)


def test_slope_ahead_of_the_contact_has_the_tables_trend(answers: list[BeltAnswer]) -> None:
    through = plane(POINTS, ANGLE)
    tests = [rejection(answer.ahead_rad, ANGLE, through) for answer in answers]
    assert (len(tests), sum(value > 0.05 for value in tests)) == (36, 21)
    listed = {
        (answer.belt.bending_stiffness_nm2, answer.belt.tread_stiffness_npm2): (answer, law.left_out_rms)
        for answer, law in zip(answers, ahead_laws(answers, ANGLE), strict=True)
        if answer.belt.shear_stiffness_n == 1.6e6 and answer.share == 1.0
    }
    table = {
        (100.0, 1e6): (0.056, 0.97, -0.73, 1.35),
        (100.0, 8e6): (0.051, 0.63, -0.65, 1.32),
        (1e3, 1e6): (0.065, 0.97, -0.62, 1.29),
        (1e3, 8e6): (0.072, 1.11, -0.82, 1.40),
    }
    for key, (left_out, of_load, of_pressure, factor) in table.items():
        answer, result = listed[key]
        assert result == pytest.approx(left_out, abs=6e-4)
        assert exponents_of(answer.ahead_rad, POINTS) == pytest.approx([of_load, of_pressure], abs=6e-3)
        assert answer.ahead_rad[0] / answer.ahead_rad[3] == pytest.approx(factor, abs=6e-3)


def test_no_belt_of_a_tires_stiffness_has_the_measured_force(answers: list[BeltAnswer]) -> None:
    factors = possible_force_factors(answers, ANGLE, plane(POINTS, ANGLE))
    assert len(factors) == 7
    assert min(factors) == pytest.approx(2.4, abs=0.05)
    assert LEAST_CORNERING_NPDEG == 500.0


def test_six_points_reject_few_laws() -> None:
    through = plane(POINTS, ANGLE)
    assert through.exponents == pytest.approx([0.74, -0.90], abs=6e-3)
    assert through.half_widths == pytest.approx([0.29, 0.34], abs=6e-3)
    assert through.scatter == pytest.approx(0.033, abs=5e-4)
    assert through.scatter_range == pytest.approx((0.019, 0.124), abs=6e-4)
    tests = {law.name: rejection(law.fitted_rad, ANGLE, through) for law in compare(POINTS, ANGLE)}
    accepted = {
        "K a / sqrt(p)": 0.972,
        "K a / sqrt(T (1 + p / 2.1 bar) / 2)": 0.256,
        "K Q / p": 0.132,
        "K a / p": 0.051,
    }
    for name, probability in accepted.items():
        assert tests[name] == pytest.approx(probability, abs=1e-3)
    assert tests["K / R (Eq. 18, flat contact)"] == pytest.approx(0.003, abs=6e-4)
    nominal = rejection(short_patch(POINTS, 1000.0, 0.5), ANGLE, through)
    assert nominal == pytest.approx(0.095, abs=1e-3)


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
    results = {law.name: law.left_out_rms for law in property_laws(files)}
    assert list(results) == ["K a / sqrt(p)", "K Q / p", "K a", "K a / p", "c0 + c1 a^2 / p", "K (Eq. 18)"]
    assert list(results.values()) == pytest.approx([0.13, 0.20, 0.25, 0.34, 0.42, 0.50], abs=6e-3)
    of_conicity = {12e3: (-0.79, -1.14, -2.22), 17e3: (-0.57, -0.77, -1.21), 22e3: (-0.41, -0.53, -0.77)}
    for load, exponents in of_conicity.items():
        assert conicity_exponents(files, load) == pytest.approx(exponents, abs=6e-3)
