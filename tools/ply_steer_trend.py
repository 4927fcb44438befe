"""Trend of ply steer with load and pressure: laws for the paper's tables, their rejection, and property files.

    python -m tools.ply_steer_trend [--measured DIRECTORY]

Eq. 18 with a flat contact has no trend. The slope of a rolling belt ahead of the contact has one, and so has a couple
on a beam under tension. Every law is judged on points left out, and tested against the plane through the logarithms.
docs/evidence/closure-ply-steer-tables.md explains the result.
"""

import argparse
import itertools
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from gateway.core.types import FloatArray
from gateway.forces.lateral_belt import LateralBelt, LateralSolution, solve_lateral_belt
from gateway.forces.ply_steer_models import TABLE_FORCE_N, Points, compare, roll_car_tire, table_points
from gateway.ring.rolling_ring import RingSolution
from gateway.simulator.truth import slopes_of
from tools.bench_ply_steer import tir_values

NOMINAL = LateralBelt()
REFERENCE_PA = 2.1e5
SHARES = (0.0, 0.5, 1.0)
"""Shares of the lateral sidewall stiffness that grow with pressure."""
BENDING_NM2 = (1.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0)
SIDEWALL_NPM2 = (1e5, 2.5e5, 5e5)


@dataclass(frozen=True, slots=True)
class Law:
    """A law, fitted in relative terms.

    Attributes:
        name: formula and what it assumes.
        constants: fitted on all points.
        left_out_rms: relative error at points left out.
        left_out_max: the largest.
    """

    name: str
    constants: FloatArray
    left_out_rms: float
    left_out_max: float


def judge(name: str, basis: FloatArray, angle_rad: FloatArray, folds: NDArray[np.int64] | None = None) -> Law:
    """Fit `basis` (m, k) or (m,) to the angles, leaving out one fold (by default one point) at a time."""
    columns = basis[:, None] if basis.ndim == 1 else basis
    rows = columns / angle_rad[:, None]
    fold = np.arange(len(angle_rad)) if folds is None else folds
    errors = np.empty_like(angle_rad)
    for excluded in np.unique(fold):
        out = fold == excluded
        constants = np.linalg.lstsq(rows[~out], np.ones(int((~out).sum())), rcond=None)[0]
        errors[out] = rows[out] @ constants - 1.0
    constants = np.linalg.lstsq(rows, np.ones(len(rows)), rcond=None)[0]
    return Law(name, constants, float(np.sqrt(np.mean(errors**2))), float(np.abs(errors).max()))


def sidewall(pressure_pa: FloatArray, stiffness_npm2: float, share: float) -> FloatArray:
    """Lateral sidewall stiffness of which a share is carried by pressure."""
    return stiffness_npm2 * (1.0 + share * (pressure_pa / REFERENCE_PA - 1.0))


def short_patch(points: Points, bending_nm2: float, share: float) -> FloatArray:
    """Turn of a short contact by a couple 2 a P, P = 1 N: a / sqrt(EI (T + 2 sqrt(ky EI)))."""
    ky = sidewall(points.pressure_pa, NOMINAL.sidewall_stiffness_npm2, share)
    result: FloatArray = points.half_length_m / np.sqrt(
        bending_nm2 * (points.tension_n + 2.0 * np.sqrt(ky * bending_nm2))
    )
    return result


def beam_answer(x_m: FloatArray, bending_nm2: float, tension_n: FloatArray, ky_npm2: FloatArray) -> FloatArray:
    """Displacement at distance x of a unit force on EI y'''' - T y'' + ky y."""
    root = np.sqrt((tension_n**2 - 4.0 * ky_npm2 * bending_nm2).astype(np.complex128))
    fast = np.sqrt((tension_n + root) / (2.0 * bending_nm2))
    slow = np.sqrt((tension_n - root) / (2.0 * bending_nm2))
    answer = (np.exp(-slow * x_m) / slow - np.exp(-fast * x_m) / fast) / (2.0 * root)
    result: FloatArray = answer.real
    return result


def whole_patch(points: Points, bending_nm2: float, share: float) -> FloatArray:
    """Mean slope between forces of 1 N one way and the other at the contact's two ends, whatever its length."""
    ky = sidewall(points.pressure_pa, NOMINAL.sidewall_stiffness_npm2, share)
    current = beam_answer(np.zeros_like(ky), bending_nm2, points.tension_n, ky)
    there = beam_answer(2.0 * points.half_length_m, bending_nm2, points.tension_n, ky)
    result: FloatArray = (current - there) / points.half_length_m
    return result


def string_laws(points: Points, stiffness_npm2: float, share: float) -> Iterator[tuple[str, FloatArray]]:
    """Response of a string on the sidewall to a side force; the relaxation length is sqrt(T / ky)."""
    ky = sidewall(points.pressure_pa, stiffness_npm2, share)
    x = 2.0 * points.half_length_m * np.sqrt(ky / points.tension_n)
    yield "slope at the edge, even force", (1.0 - np.exp(-x)) / np.sqrt(ky * points.tension_n)
    yield "slope at the leading edge, force grows rearward", (1.0 - (1.0 + x) * np.exp(-x)) / ky
    yield "even force, total as the relaxation length", 1.0 - np.exp(-x)
    yield "shift of the contact over a fixed length, even force", (1.0 - np.exp(-0.5 * x)) / ky


def derived_laws(points: Points, angle_rad: FloatArray) -> list[Law]:
    """Return every law of a beam or string with a finite contact, best first."""
    laws = []
    for bending, share in itertools.product(BENDING_NM2, SHARES):
        what = f"EI {bending:g} N m^2, {100 * share:.0f} % of ky from pressure"
        laws.append(judge(f"couple on a short contact, {what}", short_patch(points, bending, share), angle_rad))
        laws.append(judge(f"couple on the whole contact, {what}", whole_patch(points, bending, share), angle_rad))
    for stiffness, share in itertools.product(SIDEWALL_NPM2, SHARES):
        for name, value in string_laws(points, stiffness, share):
            laws.append(judge(f"string, {name}, ky {stiffness:g}, {100 * share:.0f} %", value, angle_rad))
    ones = np.ones_like(angle_rad)
    for name, x in groups(points):
        laws.append(judge(f"c0 + c1 {name}", np.stack([ones, x], axis=1), angle_rad))
    return sorted(laws, key=lambda law: law.left_out_rms)


def groups(points: Points) -> Iterator[tuple[str, FloatArray]]:
    """Variables of which the angle may be a function."""
    yield "a / sqrt(p)", points.half_length_m / np.sqrt(points.pressure_pa)
    yield "a / p", points.half_length_m / points.pressure_pa
    yield "Q / p", points.load_n / points.pressure_pa
    yield "a", points.half_length_m
    yield "Q / sqrt(p)", points.load_n / np.sqrt(points.pressure_pa)


@dataclass(frozen=True, slots=True)
class BeltAnswer:
    """A lateral belt with the nominal coupling length at the six points.

    Attributes:
        belt: at the reference pressure.
        share: of the lateral sidewall stiffness that pressure carries.
        slopes_rad: (6, 3) peak, first half, adhesion line.
        ahead_rad: (6,) steepest slope of the free belt ahead of the contact, of the opposite sign.
        side_force_n: (6,) at zero slip.
        cornering_npdeg: side force per slip angle at 400 kg and 2.1 bar.
    """

    belt: LateralBelt
    share: float
    slopes_rad: FloatArray
    ahead_rad: FloatArray
    side_force_n: FloatArray
    cornering_npdeg: float

    @property
    def name(self) -> str:
        """Values in which the belts differ."""
        belt = self.belt
        stiffness = f"EI {belt.bending_stiffness_nm2:g}, Ks {belt.shear_stiffness_n:g}"
        return f"{stiffness}, cy {belt.tread_stiffness_npm2:g}, {100 * self.share:.0f} %"


AHEAD_RAD = 0.8
"""Search for the slope ahead of the leading edge, as the estimator's."""
_SLIP_RAD = math.radians(0.2)


def slope_ahead(ring: RingSolution, shape: LateralSolution) -> float:
    """Return the steepest slope ahead of the contact against the sign of the line through the contact."""
    theta, leading = ring.theta_rad, ring.leading_edge_rad
    inside = (theta >= leading) & (theta <= ring.trailing_edge_rad)
    sign = np.sign(np.polyfit(theta[inside], shape.y_m[inside], 1)[0])
    ahead = (theta > leading - AHEAD_RAD) & (theta < leading)
    return float(-(sign * shape.slope_rad[ahead]).min())


@lru_cache(maxsize=64)
def _cornering_npdeg(ring: RingSolution, belt: LateralBelt) -> float:
    ends = [solve_lateral_belt(ring, belt, slip_angle_rad=slip).side_force_n for slip in (0.0, _SLIP_RAD)]
    return (ends[1] - ends[0]) / math.degrees(_SLIP_RAD)


def belt_answers(points: Points) -> list[BeltAnswer]:
    """Return the answers of 36 belts, over stiffnesses far beyond any tire's."""
    rings: list[RingSolution] = [roll_car_tire(q, p) for q, p in zip(points.load_n, points.pressure_pa, strict=True)]
    answers = []
    for bending, shear, stiffness, tread, share in itertools.product(
        (10.0, 100.0, 1e3), (3e4, 1.6e6), (2.5e5,), (1e6, 8e6, 3e7), (0.0, 1.0)
    ):
        slopes, ahead, forces = [], [], []
        nominal = LateralBelt(
            shear_stiffness_n=shear,
            bending_stiffness_nm2=bending,
            sidewall_stiffness_npm2=stiffness,
            tread_stiffness_npm2=tread,
        )
        for ring in rings:
            ky = float(sidewall(np.array(ring.pressure_pa), stiffness, share))
            shape = solve_lateral_belt(ring, replace(nominal, sidewall_stiffness_npm2=ky))
            slopes.append(np.abs(slopes_of(shape.y_m, points.radius_m, ring.leading_edge_rad, ring.trailing_edge_rad)))
            ahead.append(slope_ahead(ring, shape))
            forces.append(abs(shape.side_force_n))
        cornering = _cornering_npdeg(rings[1], nominal)
        answers.append(BeltAnswer(nominal, share, np.array(slopes), np.array(ahead), np.array(forces), cornering))
    return answers


def belt_laws(answers: list[BeltAnswer], angle_rad: FloatArray) -> list[Law]:
    """Return the slopes inside the contact as laws, with one coupling length, best first."""
    laws = []
    for answer in answers:
        for name, value in zip(("peak", "first half", "adhesion line"), answer.slopes_rad.T, strict=True):
            laws.append(judge(f"{name}, {answer.name}", value, angle_rad))
    return sorted(laws, key=lambda law: law.left_out_rms)


def ahead_laws(answers: list[BeltAnswer], angle_rad: FloatArray) -> list[Law]:
    """Return the slope ahead of the contact as laws, with one coupling length, in the order of the answers."""
    return [judge(f"slope ahead, {answer.name}", answer.ahead_rad, angle_rad) for answer in answers]


@dataclass(frozen=True, slots=True)
class Plane:
    """log angle = c + m log Q + n log p: over this range every smooth law is close to such a plane.

    Attributes:
        exponents: m and n.
        half_widths: of their 95 % intervals.
        squares: sum of the squared residuals.
        scatter: relative standard deviation of one point.
        scatter_range: its 95 % interval.
    """

    exponents: FloatArray
    half_widths: FloatArray
    squares: float
    scatter: float
    scatter_range: tuple[float, float]


_FREE = 3  # six points less three constants


def plane(points: Points, angle_rad: FloatArray) -> Plane:
    """Fit the plane to the logarithms of six angles."""
    rows = np.stack([np.ones(len(angle_rad)), np.log(points.load_n), np.log(points.pressure_pa)], axis=1)
    result = np.linalg.lstsq(rows, np.log(angle_rad), rcond=None)[0]
    squares = float(np.sum(np.square(np.log(angle_rad) - rows @ result)))
    covariance = squares / _FREE * np.linalg.inv(rows.T @ rows)
    scatter = math.sqrt(squares / _FREE)
    low, high = (scatter * math.sqrt(_FREE / stats.chi2.ppf(q, _FREE)) for q in (0.975, 0.025))
    return Plane(
        result[1:], stats.t.ppf(0.975, _FREE) * np.sqrt(np.diag(covariance)[1:]), squares, scatter, (low, high)
    )


def rejection(values: FloatArray, angle_rad: FloatArray, of: Plane) -> float:
    """Return the probability that scatter alone makes a law of one constant fit as badly as it does, by an F test."""
    off = np.log(np.abs(values) / angle_rad)
    squares = float(np.sum(np.square(off - off.mean())))
    extra = 2
    return float(stats.f.sf((squares - of.squares) / extra / (of.squares / _FREE), extra, _FREE))


def exponents_of(values: FloatArray, points: Points) -> FloatArray:
    """Return the exponents of load and pressure, (2,)."""
    return plane(points, np.abs(values)).exponents


@dataclass(frozen=True, slots=True)
class PropertyFile:
    """A tire property file (MF-Tyre 5.0): side force and stiffness at small slip angles.

    Attributes:
        pressure_pa: that it was measured at.
        values: of its parameters by name.
    """

    pressure_pa: float
    values: dict[str, float]

    def stiffness_npm(self) -> float:
        """Return the vertical stiffness."""
        return self.values["VERTICAL_STIFFNESS"]

    def cornering_stiffness(self, load_n: float) -> float:
        """Return d Fy / d alpha at zero, N per rad."""
        nominal = self.values["FNOMIN"]
        return self.values["PKY1"] * nominal * math.sin(2.0 * math.atan(load_n / (self.values["PKY2"] * nominal)))

    def force_at_zero(self, load_n: float) -> float:
        """Return Fy at zero slip and camber, the formula's straight part: K Shy + Svy (PHY1, PHY2, PVY1, PVY2)."""
        v, df = self.values, load_n / self.values["FNOMIN"] - 1.0
        shift = v["PHY1"] + v["PHY2"] * df
        return self.cornering_stiffness(load_n) * shift + load_n * (v["PVY1"] + v["PVY2"] * df)

    def angle_at_zero(self, load_n: float) -> float:
        """Return the slip angle equivalent to the force at zero slip, positive, rad."""
        return self.force_at_zero(load_n) / self.cornering_stiffness(load_n)

    def half_length_m(self, load_n: float) -> float:
        """Return sqrt(2 R d), the half chord of a rigid circle; a belt's is a fixed share of it."""
        return math.sqrt(2.0 * self.values["UNLOADED_RADIUS"] * load_n / self.stiffness_npm())


def property_files(directory: Path) -> list[PropertyFile]:
    """Return the files of a directory by pressure; the file states it in bar."""
    results = []
    for path in directory.glob("*.tir"):
        values = tir_values(path)
        results.append(PropertyFile(values["INFLATION_PRESSURE"] * 1e5, values))
    return sorted(results, key=lambda file: file.pressure_pa)


PROPERTY_LOADS_N = (12e3, 17e3, 22e3)
"""Loads that all four files were measured at (the highest FZMIN is 11951, the lowest FZMAX 23809 N)."""


def property_laws(files: list[PropertyFile]) -> list[Law]:
    """Return laws for the equivalent angle over pressures and loads, one file left out at a time; best first."""
    cases = [(i, file, load) for i, file in enumerate(files) for load in PROPERTY_LOADS_N]
    angle = np.array([file.angle_at_zero(load) for _, file, load in cases])
    folds = np.array([i for i, _, _ in cases])
    a = np.array([file.half_length_m(load) for _, file, load in cases])
    p = np.array([file.pressure_pa for _, file, _ in cases])
    q = np.array([load for _, _, load in cases])
    bases = {
        "K (Eq. 18)": np.ones_like(a),
        "K a": a,
        "K a / sqrt(p)": a / np.sqrt(p),
        "K a / p": a / p,
        "K Q / p": q / p,
        "c0 + c1 a^2 / p": np.stack([np.ones_like(a), a**2 / p], axis=1),
    }
    return sorted((judge(name, basis, angle, folds) for name, basis in bases.items()), key=lambda law: law.left_out_rms)


CONICITY_DEG = (-0.05, 0.0, 0.05)
"""Conicity assumed in the files' angles; they are of one direction of rolling, so it is not known."""


def conicity_exponents(files: list[PropertyFile], load_n: float) -> FloatArray:
    """Return the exponents of pressure of the ply steer that is left after each conicity, the same at all pressures."""
    pressures = np.array([file.pressure_pa for file in files])
    angles = np.array([file.angle_at_zero(load_n) for file in files])
    return np.array([exponent(angles - math.radians(cone), pressures) for cone in CONICITY_DEG])


def print_conicity_bounds(files: list[PropertyFile]) -> None:
    """Print the exponents of pressure of ply steer alone for conicities that the files do not exclude."""
    print(f"  exponent of p of ply steer alone, with a conicity of {', '.join(f'{c:+.2f}' for c in CONICITY_DEG)} deg")
    for load in PROPERTY_LOADS_N:
        print(f"  {load:6.0f} N  " + " ".join(f"{value:6.2f}" for value in conicity_exponents(files, load)))


def exponent(values: FloatArray, pressures: FloatArray) -> float:
    """Return the slope of log values over log pressures."""
    return float(np.polyfit(np.log(pressures), np.log(np.abs(values)), 1)[0])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--measured", type=Path, help="directory with tir/*.tir")
    arguments = parser.parse_args()
    points, angle = table_points()
    tried = compare(points, angle)
    derived = derived_laws(points, angle)
    answers = belt_answers(points)
    belts = belt_laws(answers, angle)
    print(f"Tables I and II, six points; {len(tried)} + {len(derived)} + {len(belts)} laws tried; left out rms, max %")
    for title, laws in (
        ("of ply_steer_models", tried),
        ("beam or string with a contact", derived),
        ("belts, inside the contact", belts),
    ):
        print(f"\n{title}")
        for law in laws[:12]:
            print(
                f"  {law.name:78s}{100 * law.left_out_rms:6.1f}{100 * law.left_out_max:6.1f}  "
                + " ".join(f"{c:.4g}" for c in law.constants)
            )
    print("\ncouple on a short contact, by bending stiffness (rows) and share of ky from pressure (columns)")
    for bending in BENDING_NM2:
        laws = [judge("", short_patch(points, bending, share), angle) for share in SHARES]
        print(
            f"  {bending:6g}"
            + "".join(f"{100 * law.left_out_rms:8.1f}" for law in laws)
            + f"   P {laws[1].constants[0]:.0f} N, couple at 400 kg, 2.1 bar {_couple(points, laws[1]):.1f} N m"
        )
    print_rejections(points, angle, answers)
    print_ahead(points, angle, answers)
    if arguments.measured is not None:
        print_property_files(property_files(arguments.measured / "tir"))


LISTED_BELTS = ((100.0, 1e6), (100.0, 8e6), (1000.0, 1e6), (1000.0, 8e6))
"""Bending and tread stiffness of the belts that are listed one by one."""


def print_rejections(points: Points, angle: FloatArray, answers: list[BeltAnswer]) -> None:
    """Print the plane and the laws of one constant that it rejects."""
    result = plane(points, angle)
    low, high = result.scatter_range
    print(
        f"\nplane: Q^{result.exponents[0]:.2f} ± {result.half_widths[0]:.2f}, p^{result.exponents[1]:.2f} ± "
        f"{result.half_widths[1]:.2f} (95 %); scatter of a point {100 * result.scatter:.1f} %, {100 * low:.1f} % to "
        f"{100 * high:.1f} %"
    )
    ones = [law for law in compare(points, angle) if len(law.constants) == 1]
    tests = {law.name: rejection(law.fitted_rad, angle, result) for law in ones}
    beam = short_patch(points, NOMINAL.bending_stiffness_nm2, 0.5)
    tests["couple on the nominal belt"] = rejection(beam, angle, result)
    inside = [rejection(column, angle, result) for answer in answers for column in answer.slopes_rad.T]
    ahead = [rejection(answer.ahead_rad, angle, result) for answer in answers]
    print("probability of the fit of laws with one constant")
    for name, value in sorted(tests.items(), key=lambda item: -item[1]):
        print(f"  {name:40s}{value:7.3f}")
    for name, values in (("belts, inside the contact", inside), ("belts, slope ahead of the contact", ahead)):
        possible = sum(value > 0.05 for value in values)
        print(f"  {name:40s}{min(values):7.3f} to {max(values):.3f}, {possible} of {len(values)} above 0.05")


def print_ahead(points: Points, angle: FloatArray, answers: list[BeltAnswer]) -> None:
    """Print the slope ahead of the contact of the listed belts, and their side force at the measured angle."""
    result = plane(points, angle)
    every = np.array([exponents_of(answer.ahead_rad, points) for answer in answers])
    (low_q, low_p), (high_q, high_p) = every.min(axis=0), every.max(axis=0)
    print(f"\nslope ahead of the contact, {len(answers)} belts: ", end="")
    print(f"Q^{low_q:.2f} to {high_q:.2f}, p^{low_p:.2f} to {high_p:.2f}")
    print("    EI      cy  left out %  probability      Q      p  1.8 / 2.7 bar   g mm  N/deg  force N, 300/400/500 kg")
    for answer, law in zip(answers, ahead_laws(answers, angle), strict=True):
        belt = answer.belt
        if (belt.bending_stiffness_nm2, belt.tread_stiffness_npm2) not in LISTED_BELTS:
            continue
        if belt.shear_stiffness_n != NOMINAL.shear_stiffness_n or answer.share != 1.0:
            continue
        q, p = exponents_of(answer.ahead_rad, points)
        scale = float(law.constants[0])
        forces = " ".join(f"{scale * answer.side_force_n[i]:5.0f}" for i in (4, 1, 5))
        print(
            f"{belt.bending_stiffness_nm2:6g} {belt.tread_stiffness_npm2:7g} {100 * law.left_out_rms:11.1f} "
            f"{rejection(answer.ahead_rad, angle, result):12.3f} {q:6.2f} {p:6.2f} "
            f"{answer.ahead_rad[0] / answer.ahead_rad[3]:14.2f} {1e3 * scale * belt.coupling_length_m:6.2f} "
            f"{answer.cornering_npdeg:6.0f}  {forces}"
        )
    print(f"  measured: 1.8 / 2.7 bar {angle[0] / angle[3]:.2f}, side force {TABLE_FORCE_N} N")
    factors = possible_force_factors(answers, angle, result)
    print(
        f"  {len(factors)} belts of more than {LEAST_CORNERING_NPDEG:.0f} N/deg and probability above 0.05: force "
        f"{min(factors):.1f} to {max(factors):.1f} times the measured one"
    )


LEAST_CORNERING_NPDEG = 500.0
"""A car tire has a sixth to a quarter of its load per degree, 650 to 1000 N at 400 kg; this is well below."""


def possible_force_factors(answers: list[BeltAnswer], angle_rad: FloatArray, of: Plane) -> list[float]:
    """Return side force over the measured one, mean of the three loads, of belts as stiff as a tire's that fit."""
    factors = []
    for answer in answers:
        if answer.cornering_npdeg > LEAST_CORNERING_NPDEG and rejection(answer.ahead_rad, angle_rad, of) > 0.05:
            scale = float(judge("", answer.ahead_rad, angle_rad).constants[0])
            factors.append(float(np.mean(scale * answer.side_force_n[[4, 1, 5]] / np.array(TABLE_FORCE_N))))
    return factors


def _couple(points: Points, law: Law) -> float:
    return 2.0 * float(points.half_length_m[1]) * float(law.constants[0])


def print_property_files(files: list[PropertyFile]) -> None:
    pressures = np.array([file.pressure_pa for file in files])
    bars = ", ".join(f"{p:.2f}" for p in pressures / 1e5)
    print(f"\nProperty files at {bars} bar: angle, deg; force, N; exponents of p of angle, force, and K a / sqrt(p)")
    for load in (10e3, *PROPERTY_LOADS_N, 30e3):
        angles = np.array([file.angle_at_zero(load) for file in files])
        forces = np.array([file.force_at_zero(load) for file in files])
        law = np.array([file.half_length_m(load) for file in files]) / np.sqrt(pressures)
        print(
            f"  {load:6.0f} N  "
            + " ".join(f"{v:.3f}" for v in np.degrees(angles))
            + "   "
            + " ".join(f"{v:5.0f}" for v in forces)
            + f"   {exponent(angles, pressures):.2f} {exponent(forces, pressures):.2f} {exponent(law, pressures):.2f}"
        )
    print_conicity_bounds(files)
    for law_ in property_laws(files):
        print(f"  {law_.name:20s} left out: rms {100 * law_.left_out_rms:.0f} %, max {100 * law_.left_out_max:.0f} %")


if __name__ == "__main__":
    sys.exit(main())
