"""Table 3 of the ring paper on the exact ring: what its four numbers imply for the contact, and what they leave open.

    python -m tools.table_3

docs/evidence/ring-paper-figures.md explains the result.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq, least_squares

from gateway.core.types import FloatArray
from gateway.forces.lateral_belt import ring_tension
from gateway.ring.reference_tire import TABLE_3_NUMBERS
from gateway.ring.ring_series import Kinematics, RoadForce, signal_orders
from gateway.ring.rolling_ring import RingNumbers, RingParameters, RingSolution, solve_rolling_ring
from tools.bench_ring_paper import BASE, OMEGA, RADIUS_M, ratio_with_truth_given

LOAD_N, PRESSURE_PA = 5000.0, 2.1e5
NODES = 1440


@dataclass(frozen=True, slots=True)
class Contact:
    """Contact quantities of a solution.

    Attributes:
        half_angle_rad: of the contact.
        length_m: of the belt in contact.
        deflection_m: of the tire.
        mean_pressure_npm: load over contact length.
        peak_over_mean: of the contact pressure.
        centre_over_mean: pressure at the middle.
        tension_loss: share of p0 b R that the belt lacks, mean over the inner half of the contact.
        overshoot: largest radial signal over its mean.
    """

    half_angle_rad: float
    length_m: float
    deflection_m: float
    mean_pressure_npm: float
    peak_over_mean: float
    centre_over_mean: float
    tension_loss: float
    overshoot: float


def contact(solution: RingSolution) -> Contact:
    """Return the contact quantities of a solution."""
    ring, half = solution.ring, solution.half_angle_rad
    length = 2.0 * ring.radius_m * half
    mean = solution.load_n / length
    middle = np.abs(solution.theta_rad - solution.contact_centre_rad)
    tension = ring_tension(solution)[middle < 0.5 * half].mean()
    return Contact(
        half_angle_rad=half,
        length_m=length,
        deflection_m=solution.deflection_m,
        mean_pressure_npm=mean,
        peak_over_mean=float(solution.contact_pressure_npm.max()) / mean,
        centre_over_mean=float(solution.contact_pressure_npm[middle.argmin()]) / mean,
        tension_loss=1.0 - float(tension) / (solution.pressure_pa * ring.tension_width_m * ring.radius_m),
        overshoot=float(solution.sensor.radial_m.max()) / ring.radius_m,
    )


def solve(ring: RingParameters = BASE, load_n: float = LOAD_N, pressure_pa: float = PRESSURE_PA) -> RingSolution:
    """Roll a ring at 65 km/h, the paper's load and pressure unless stated."""
    return solve_rolling_ring(ring, load_n, pressure_pa, OMEGA, nodes=NODES)


def wave_change(solution: RingSolution, base: RingSolution) -> float:
    """Return the rms change of the radial waveform over the rms of the base's, both over their radius."""
    reference = base.sensor.radial_m / base.ring.radius_m
    other = solution.sensor.radial_m / solution.ring.radius_m
    return float(np.std(other - reference) / np.std(reference))


def open_changes() -> dict[str, RingSolution]:
    """Return solutions with Table 3's numbers that differ in the quantities the numbers leave open."""
    return {
        "tread kt / 3": solve(replace(BASE, tread_stiffness_npm2=BASE.tread_stiffness_npm2 / 3.0)),
        "tread kt x 3": solve(replace(BASE, tread_stiffness_npm2=BASE.tread_stiffness_npm2 * 3.0)),
        "EA 1 MN": solve(replace(BASE, extension_stiffness_n=1e6)),
        "EA 50 MN": solve(replace(BASE, extension_stiffness_n=5e7)),
        "shear length 6 mm (GA 200 kN)": solve(replace(BASE, shear_stiffness_n=2e5)),
        "belt mass x 2": solve(replace(BASE, mass_kgpm=2.0 * BASE.mass_kgpm)),
        "load + 10 %": solve(load_n=1.1 * LOAD_N),
        "load - 10 %": solve(load_n=0.9 * LOAD_N),
    }


def scaled(factor: float) -> RingSolution:
    """Return the ring with load and every stiffness (numbers, tread, EA, centrifugal tension) times `factor`."""
    ring = RingParameters.from_numbers(
        *(factor * number for number in TABLE_3_NUMBERS),
        radius_m=RADIUS_M,
        pressure_pa=PRESSURE_PA,
        tread_stiffness_npm2=factor * BASE.tread_stiffness_npm2,
        extension_stiffness_n=factor * BASE.extension_stiffness_n,
        mass_kgpm=factor * BASE.mass_kgpm,
    )
    return solve(ring, factor * LOAD_N)


def sensitivities(step: float = 0.02) -> dict[str, float]:
    """Return d ln(half angle) / d ln of the numbers, tread stiffness and load."""
    fields = {
        "Bs": "bending_stiffness_nm2",
        "Cw": "tension_width_m",
        "Rs": "radial_stiffness_npm2",
        "Ts": "tangential_stiffness_npm2",
        "kt": "tread_stiffness_npm2",
    }
    results = {}
    for name, field in fields.items():
        ends = [solve(replace(BASE, **{field: getattr(BASE, field) * (1.0 + sign * step)})) for sign in (-1.0, 1.0)]
        results[name] = math.log(ends[1].half_angle_rad / ends[0].half_angle_rad) / math.log(
            (1.0 + step) / (1.0 - step)
        )
    low, high = solve(load_n=LOAD_N * (1.0 - step)), solve(load_n=LOAD_N * (1.0 + step))
    results["load"] = math.log(high.half_angle_rad / low.half_angle_rad) / math.log((1.0 + step) / (1.0 - step))
    return results


def flat_angle(kinematics: Kinematics) -> float:
    """Return the half angle at which Eq. 27 with Table 3's numbers reads 0 in the middle of the contact, rad.

    It reads more than the centripetal R Omega^2 outside, and the sum of its orders must take all of that away.
    """

    def residual(half_angle_rad: float) -> float:
        orders = signal_orders(
            np.arange(1.0, 400.0),
            TABLE_3_NUMBERS,
            load_n=LOAD_N,
            pressure_pa=PRESSURE_PA,
            radius_m=RADIUS_M,
            half_angle_rad=half_angle_rad,
            kinematics=kinematics,
            road=RoadForce.VERTICAL if kinematics is Kinematics.CORRECTED else RoadForce.RADIAL,
        )
        return RADIUS_M + float(orders.sum())

    return float(brentq(residual, 0.05, 0.5))


@dataclass(frozen=True, slots=True)
class Reading:
    """A tire whose numbers the paper's estimator reads as near to Table 3 as can be.

    Attributes:
        tread_npm2: its tread.
        numbers: true ones.
        read_over_printed: what the estimator makes of them, over Table 3.
        residual: of the estimator's fit.
        contact: of that tire.
    """

    tread_npm2: float
    numbers: RingNumbers
    read_over_printed: FloatArray
    residual: float
    contact: Contact


def tire_that_reads_table_3(tread_npm2: float, nodes: int = 720) -> Reading:
    """Search the exact ring whose waveform Eq. 28 reads as Table 3, its load and contact angle given."""
    printed = np.array(TABLE_3_NUMBERS)

    def tire(logs: FloatArray, grid: int) -> RingSolution:
        ring = RingParameters.from_numbers(
            *(np.exp(logs) * printed), radius_m=RADIUS_M, pressure_pa=PRESSURE_PA, tread_stiffness_npm2=tread_npm2
        )
        return solve_rolling_ring(ring, LOAD_N, PRESSURE_PA, OMEGA, nodes=grid)

    def misread(logs: FloatArray) -> FloatArray:
        ratio, _ = ratio_with_truth_given(tire(logs, nodes))
        return np.log(np.maximum(ratio * np.exp(logs), 1e-4))

    best = least_squares(misread, np.log([1.25, 1.5, 0.95, 0.5]), bounds=(-4.0, 2.5), diff_step=1e-3, max_nfev=60)
    solution = tire(best.x, NODES)
    ratio, residual = ratio_with_truth_given(solution)
    return Reading(tread_npm2, solution.numbers, ratio * np.exp(best.x), residual, contact(solution))


def _row(name: str, patch: Contact, change: float | None = None) -> str:
    moved = "" if change is None else f"{100 * change:8.1f}"
    return (
        f"{name:32s}{patch.half_angle_rad:8.4f}{1e3 * patch.length_m:8.1f}{1e3 * patch.deflection_m:8.2f}"
        f"{patch.peak_over_mean:8.2f}{patch.centre_over_mean:8.2f}{100 * patch.tension_loss:8.1f}"
        f"{patch.overshoot:8.3f}{moved}"
    )


def main() -> None:
    base = solve()
    ring = base.ring
    print(f"Table 3 at R {RADIUS_M} m and {PRESSURE_PA / 1e5} bar: EI {ring.bending_stiffness_nm2:.2f} N m^2,")
    print(
        f"b {1e3 * ring.tension_width_m:.1f} mm, tension {PRESSURE_PA * ring.tension_width_m * RADIUS_M:.0f} N, "
        f"kw {ring.radial_stiffness_npm2 / 1e3:.0f}, kv {ring.tangential_stiffness_npm2 / 1e3:.0f} kN/m^2"
    )
    print(f"\n{'':32s}    half  length    sunk    peak  centre tension    over    wave")
    print(f"{'':32s}     rad      mm      mm  / mean  / mean  loss %   shoot       %")
    print(_row(f"Table 3, {LOAD_N:.0f} N", contact(base)))
    for name, solution in open_changes().items():
        print(_row(name, contact(solution), wave_change(solution, base)))
    print(_row("load and all stiffnesses x 1.2", contact(scaled(1.2)), wave_change(scaled(1.2), base)))
    print("\nd ln(half angle) / d ln: " + ", ".join(f"{name} {value:+.2f}" for name, value in sensitivities().items()))
    for kinematics in Kinematics:
        print(f"Eq. 27 is flat in the contact's middle at {flat_angle(kinematics):.3f} rad ({kinematics.value})")
    ratio, residual = ratio_with_truth_given(base)
    print(f"\nThe paper's estimator on this ring, over Table 3: {np.round(ratio, 2)}, residual {100 * residual:.1f} %")
    print("Tires that it reads as Table 3 (numbers over Table 3; what it reads over Table 3; residual %; contact)")
    for tread in (1.5e7, 3e7, 7e7, 1.4e8):
        result = tire_that_reads_table_3(tread)
        numbers = np.round(np.array(result.numbers) / np.array(TABLE_3_NUMBERS), 2)
        print(f"kt {tread:.1e}  {numbers}  {np.round(result.read_over_printed, 2)}  {100 * result.residual:.0f}")
        print(_row("", result.contact))


if __name__ == "__main__":
    main()
