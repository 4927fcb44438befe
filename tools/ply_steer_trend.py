"""The trend of ply steer with load and pressure: what explains it, from the paper's tables and from property files.

    python -m tools.ply_steer_trend [--measured DIRECTORY]

Eq. 18 with a flat contact has no trend. Here a finite contact is put on a beam under tension on the sidewall, beside
the laws of `ply_steer_models`, and every law is judged on points left out.
docs/evidence/closure-ply-steer-tables.md explains the result.
"""

from __future__ import annotations

import argparse
import itertools
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gateway.estimators.ply_steer_models import TABLE_FORCE_N, Points, compare, roll_car_tire, table_points
from gateway.physics.lateral_belt import LateralBelt, solve_lateral_belt
from gateway.physics.rolling_ring import RingSolution
from gateway.simulator.truth import slopes_of
from gateway.types import FloatArray
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
    for left in np.unique(fold):
        out = fold == left
        constants = np.linalg.lstsq(rows[~out], np.ones(int((~out).sum())), rcond=None)[0]
        errors[out] = rows[out] @ constants - 1.0
    constants = np.linalg.lstsq(rows, np.ones(len(rows)), rcond=None)[0]
    return Law(name, constants, float(np.sqrt(np.mean(errors**2))), float(np.abs(errors).max()))


def sidewall(pressure_pa: FloatArray, stiffness_npm2: float, share: float) -> FloatArray:
    """Lateral sidewall stiffness of which a share is carried by pressure."""
    return stiffness_npm2 * (1.0 + share * (pressure_pa / REFERENCE_PA - 1.0))


def short_patch(at: Points, bending_nm2: float, share: float) -> FloatArray:
    """Turn of a short contact by a couple 2 a P, P = 1 N: a / sqrt(EI (T + 2 sqrt(ky EI)))."""
    ky = sidewall(at.pressure_pa, NOMINAL.sidewall_stiffness_npm2, share)
    result: FloatArray = at.half_length_m / np.sqrt(bending_nm2 * (at.tension_n + 2.0 * np.sqrt(ky * bending_nm2)))
    return result


def beam_answer(x_m: FloatArray, bending_nm2: float, tension_n: FloatArray, ky_npm2: FloatArray) -> FloatArray:
    """Displacement at distance x of a unit force on EI y'''' - T y'' + ky y."""
    root = np.sqrt((tension_n**2 - 4.0 * ky_npm2 * bending_nm2).astype(np.complex128))
    fast = np.sqrt((tension_n + root) / (2.0 * bending_nm2))
    slow = np.sqrt((tension_n - root) / (2.0 * bending_nm2))
    answer = (np.exp(-slow * x_m) / slow - np.exp(-fast * x_m) / fast) / (2.0 * root)
    result: FloatArray = answer.real
    return result


def whole_patch(at: Points, bending_nm2: float, share: float) -> FloatArray:
    """Mean slope between forces of 1 N one way and the other at the contact's two ends, whatever its length."""
    ky = sidewall(at.pressure_pa, NOMINAL.sidewall_stiffness_npm2, share)
    here = beam_answer(np.zeros_like(ky), bending_nm2, at.tension_n, ky)
    there = beam_answer(2.0 * at.half_length_m, bending_nm2, at.tension_n, ky)
    result: FloatArray = (here - there) / at.half_length_m
    return result


def string_laws(at: Points, stiffness_npm2: float, share: float) -> Iterator[tuple[str, FloatArray]]:
    """Response of a string on the sidewall to a side force; the relaxation length is sqrt(T / ky)."""
    ky = sidewall(at.pressure_pa, stiffness_npm2, share)
    x = 2.0 * at.half_length_m * np.sqrt(ky / at.tension_n)
    yield "slope at the edge, even force", (1.0 - np.exp(-x)) / np.sqrt(ky * at.tension_n)
    yield "slope at the leading edge, force grows rearward", (1.0 - (1.0 + x) * np.exp(-x)) / ky
    yield "even force, total as the relaxation length", 1.0 - np.exp(-x)
    yield "shift of the contact over a fixed length, even force", (1.0 - np.exp(-0.5 * x)) / ky


def derived_laws(at: Points, angle_rad: FloatArray) -> list[Law]:
    """Return every law of a beam or string with a finite contact, best first."""
    laws = []
    for bending, share in itertools.product(BENDING_NM2, SHARES):
        what = f"EI {bending:g} N m^2, {share:.0%} of ky from pressure"
        laws.append(judge(f"couple on a short contact, {what}", short_patch(at, bending, share), angle_rad))
        laws.append(judge(f"couple on the whole contact, {what}", whole_patch(at, bending, share), angle_rad))
    for stiffness, share in itertools.product(SIDEWALL_NPM2, SHARES):
        for name, value in string_laws(at, stiffness, share):
            laws.append(judge(f"string, {name}, ky {stiffness:g}, {share:.0%}", value, angle_rad))
    one = np.ones_like(angle_rad)
    for name, x in groups(at):
        laws.append(judge(f"c0 + c1 {name}", np.stack([one, x], axis=1), angle_rad))
    return sorted(laws, key=lambda law: law.left_out_rms)


def groups(at: Points) -> Iterator[tuple[str, FloatArray]]:
    """Variables of which the angle may be a function."""
    yield "a / sqrt(p)", at.half_length_m / np.sqrt(at.pressure_pa)
    yield "a / p", at.half_length_m / at.pressure_pa
    yield "Q / p", at.load_n / at.pressure_pa
    yield "a", at.half_length_m
    yield "Q / sqrt(p)", at.load_n / np.sqrt(at.pressure_pa)


def belt_laws(at: Points, angle_rad: FloatArray) -> list[Law]:
    """The lateral belt with one coupling length, over stiffnesses far beyond any tire's: 36 belts, three slopes."""
    rings: list[RingSolution] = [roll_car_tire(q, p) for q, p in zip(at.load_n, at.pressure_pa, strict=True)]
    laws = []
    for bending, shear, stiffness, tread, share in itertools.product(
        (10.0, 100.0, 1e3), (3e4, 1.6e6), (2.5e5,), (1e6, 8e6, 3e7), (0.0, 1.0)
    ):
        slopes = []
        for ring in rings:
            belt = LateralBelt(
                shear_stiffness_n=shear,
                bending_stiffness_nm2=bending,
                sidewall_stiffness_npm2=float(sidewall(np.array(ring.pressure_pa), stiffness, share)),
                tread_stiffness_npm2=tread,
            )
            y = solve_lateral_belt(ring, belt).y_m
            slopes.append(np.abs(slopes_of(y, at.radius_m, ring.leading_edge_rad, ring.trailing_edge_rad)))
        for name, value in zip(("peak", "first half", "adhesion line"), np.array(slopes).T, strict=True):
            what = f"EI {bending:g}, Ks {shear:g}, cy {tread:g}, {share:.0%}"
            laws.append(judge(f"{name}, {what}", value, angle_rad))
    return sorted(laws, key=lambda law: law.left_out_rms)


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
    found = []
    for path in directory.glob("*.tir"):
        values = tir_values(path)
        found.append(PropertyFile(values["INFLATION_PRESSURE"] * 1e5, values))
    return sorted(found, key=lambda file: file.pressure_pa)


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
    belts = belt_laws(points, angle)
    print(f"Tables I and II, six points; {len(tried)} + {len(derived)} + {len(belts)} laws tried; left out rms, max %")
    for title, laws in (("of ply_steer_models", tried), ("beam or string with a contact", derived), ("belts", belts)):
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
    print(f"\nmeasured side force {TABLE_FORCE_N} N")
    if arguments.measured is not None:
        print_property_files(property_files(arguments.measured / "tir"))


def _couple(at: Points, law: Law) -> float:
    return 2.0 * float(at.half_length_m[1]) * float(law.constants[0])


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
    for law_ in property_laws(files):
        print(f"  {law_.name:20s} left out: rms {100 * law_.left_out_rms:.0f} %, max {100 * law_.left_out_max:.0f} %")


if __name__ == "__main__":
    sys.exit(main())
