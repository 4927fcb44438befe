"""Laws and calibrations of the lateral axis: laminates, peak against laminate, share against slip, pulls.

    python -m tools.bench_lateral [--only laminate|laws|calibration] [--belts COUNT] [--seed SEED]

Belts are solved on the exact rolling ring with a brush tread. For the calibration their signals are sampled, disturbed,
quantised and run through the pipeline; the known slip angles are wrong by their stated errors.
"""

import argparse
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from gateway.core.errors import CalibrationError
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.results import RevolutionResult
from gateway.core.estimates.tire_data import TireData
from gateway.core.revolutions.sensor_mounting import RollCalibration
from gateway.core.revolutions.synchronous_average import RunningAverage
from gateway.core.types import FloatArray
from gateway.forces.belt_laminate import BeltLaminate, StatedPly, coupling_law
from gateway.forces.lateral_belt import LateralBelt, solve_lateral_belt
from gateway.forces.slip_angle import MEAN_NAME, SLIP_NAME, SlipAngleEstimator
from gateway.forces.slip_fit import SlipFit, SlipRunRevolutions, fit_slip_calibration
from gateway.ring.rolling_ring import RingSolution
from gateway.simulator.truth import LateralSlopes, slopes_of
from tools.generators.lateral_signals import RADIUS_M, Sensor, lateral, radial, samples, through_pipeline

LAMINATE_ANGLES_DEG = (18.0, 22.0, 26.0, 30.0)
SLIPS_DEG = (-2.0, -1.5, -1.0, -0.5, -0.25, 0.25, 0.5, 1.0, 1.5, 2.0)
FORWARD_DEG = (-1.0, -0.5, 0.0, 0.5, 1.0)
REVERSE_DEG = (0.0, 0.5)
SLIP_STD_DEG, ZERO_STD_DEG = 0.02, 0.03
REVOLUTIONS = 32


@dataclass(frozen=True)
class Case:
    """A random tire with a sensor."""

    ring: RingSolution
    belt: LateralBelt
    sensor: Sensor

    def slopes(self, slip_deg: float, *, reverse: bool = False) -> LateralSlopes:
        """Return the true slopes."""
        shape = solve_lateral_belt(self.ring, self.turned(reverse), slip_angle_rad=math.radians(slip_deg))
        return slopes_of(shape.y_m, RADIUS_M, self.ring.leading_edge_rad, self.ring.trailing_edge_rad)

    def turned(self, reverse: bool) -> LateralBelt:
        """Return the belt as it rolls: in reverse the plies shear the other way."""
        return replace(self.belt, coupling_length_m=-self.belt.coupling_length_m) if reverse else self.belt

    def revolutions(self, slip_deg: float, seed: int, *, reverse: bool = False) -> list[RevolutionResult]:
        """Return a recording's revolutions through the pipeline; axes are fixed to the tire."""
        sign = -1.0 if reverse else 1.0
        sensor = replace(self.sensor, seed=seed, yaw_rad=sign * self.sensor.yaw_rad)
        shape = lateral(self.ring, self.turned(reverse), math.radians(slip_deg))
        values = samples(self.ring, [(REVOLUTIONS, shape)], sensor)
        values[:, 0] *= sign
        return through_pipeline(values, sensor, pressure_pa=self.ring.pressure_pa)


def random_cases(count: int, seed: int) -> Iterator[Case]:
    """Yield random tires: passenger cars of different loads, pressures, belts, treads and friction."""
    rng = np.random.default_rng(seed)
    for number in range(count):
        yield Case(
            radial(rng.uniform(2500.0, 6500.0), rng.uniform(1.8e5, 3e5), 5e-3),
            LateralBelt(
                coupling_length_m=float(rng.uniform(0.8e-3, 2.5e-3) * rng.choice([-1.0, 1.0])),
                shear_stiffness_n=float(10 ** rng.uniform(5.5, 6.4)),
                bending_stiffness_nm2=float(10 ** rng.uniform(2.5, 3.6)),
                sidewall_stiffness_npm2=float(10 ** rng.uniform(5.0, 5.7)),
                tread_stiffness_npm2=float(10 ** rng.uniform(6.5, 7.1)),
                friction=float(rng.uniform(0.7, 1.2)),
                conicity_rad=math.radians(rng.uniform(-0.6, 0.6)),
            ),
            Sensor(
                noise_mg=float(10 ** rng.uniform(-0.3, 1.2)),
                roll_rad=math.radians(rng.normal(0.0, 1.0)),
                yaw_rad=math.radians(rng.normal(0.0, 1.0)),
                lateral_offset_mps2=float(rng.normal(0.0, 0.7)),
                road_mps2=float(rng.uniform(0.0, 2.0)),
                seed=1000 * seed + number,
            ),
        )


def laminates() -> None:
    """Print the coupling of two steel plies over their angle."""
    print("two steel plies of 1.2 mm, 22 % cords, rubber of 6 MPa, angles to 1 deg")
    print("angle deg      B16 N   A66 N/m  B16 / A66 mm         free strip mm  2 phi_z deg at 310 mm")
    for angle in LAMINATE_ANGLES_DEG:
        law = coupling_law(crossed_belt(angle))
        slope = law.slope(0.31)
        print(
            f"{angle:9.0f} {law.b16_n.value:10.0f} {law.a66_npm.value:9.3g} {1e3 * law.length_m.value:8.2f} "
            f"± {1e3 * law.length_m.std:.2f} {1e3 * law.released_length_m.value:21.2f} "
            f"{math.degrees(slope.value):14.3f} ± {math.degrees(slope.std):.3f}"
        )


def crossed_belt(angle_deg: float) -> BeltLaminate:
    """Return two steel plies with usual tolerances, the inner one at the angle, the outer one at its opposite."""
    plies = tuple(
        StatedPly(math.radians(angle), 1.2e-3, 200e9, 0.22, math.radians(1.0), 0.05e-3, 20e9, 0.02)
        for angle in (angle_deg, -angle_deg)
    )
    return BeltLaminate(plies, 6e6, 1.2e6)


def laws(count: int, seed: int) -> None:
    """Print the peak over the laminate's angle, and the saturation law of the belt's share."""
    ratios, bends, errors = [], [], []
    slips = np.radians(SLIPS_DEG)
    for case in random_cases(count, seed):
        zero = case.slopes(0.0)
        cone = replace(case.belt, conicity_rad=0.0)
        peak = replace(case, belt=cone).slopes(0.0).peak_rad
        ratios.append(peak / (case.belt.coupling_length_m / RADIUS_M))
        change = np.array([case.slopes(slip).first_half_rad for slip in SLIPS_DEG]) - zero.first_half_rad
        rows = np.stack([slips, slips * np.abs(slips)], axis=1)
        share, bent = np.linalg.lstsq(rows / np.abs(slips)[:, None], change / np.abs(slips), rcond=None)[0]
        bends.append(-bent / share)
        errors.append((rows @ np.array([share, bent]) - change) / (share * np.abs(slips)))
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    print(f"{count} random belts")
    print(f"peak over g / R: mean {np.mean(ratios):.3f}, std {np.std(ratios, ddof=1):.3f}, "
          f"{np.min(ratios):.3f} to {np.max(ratios):.3f}")  # fmt: skip
    print(f"saturation, 1/rad: mean {np.mean(bends):.2f}, std {np.std(bends, ddof=1):.2f}, "
          f"{np.min(bends):.2f} to {np.max(bends):.2f}")  # fmt: skip
    print("error of the law over belt share times slip, %: slip, rms, largest")
    for slip, value, large in zip(SLIPS_DEG, rms, np.abs(errors).max(axis=0), strict=True):
        print(f"  {slip:+5.2f} {100 * value:6.2f} {100 * large:6.2f}")


def calibrated(case: Case, rng: np.random.Generator) -> SlipFit:
    """Return the calibration of a case from runs whose slip angles are known with errors."""
    roll = RollCalibration(horizon_revolutions=1e9)
    zero = rng.normal(0.0, ZERO_STD_DEG)
    parts = []
    for number, (slip, reverse) in enumerate([(s, False) for s in FORWARD_DEG] + [(s, True) for s in REVERSE_DEG]):
        true = slip + (-zero if reverse else zero) + rng.normal(0.0, SLIP_STD_DEG)
        revolutions = SlipRunRevolutions(roll)
        for result in case.revolutions(true, case.sensor.seed * 100 + number, reverse=reverse)[3:]:
            revolutions.add(result.revolution, result.conditions)
        parts.append((revolutions, slip, reverse))
    runs = [
        revolutions.run(f"{slip:+.1f}", math.radians(slip), math.radians(SLIP_STD_DEG), is_reverse=reverse)
        for revolutions, slip, reverse in parts
    ]
    return fit_slip_calibration(runs, math.radians(ZERO_STD_DEG))


def used(case: Case, fit: SlipFit, slip_deg: float) -> dict[str, Estimate]:
    """Return the last estimates of `slip-angle` at a constant slip angle, with the calibration."""
    estimator, average = SlipAngleEstimator(), RunningAverage()
    last: dict[str, Estimate] = {}
    for result in case.revolutions(slip_deg, case.sensor.seed * 100 + 99)[3:]:
        revolution = result.revolution
        latest = average.update(
            revolution.radial_mps2,
            revolution.orders_mps2,
            revolution.omega_radps,
            edges_rad=(revolution.leading_edge_rad, revolution.trailing_edge_rad),
            edges_std_rad=(revolution.leading_edge_std_rad, revolution.trailing_edge_std_rad),
            noise_mps2=revolution.noise_mps2,
        )
        conditions = replace(result.conditions, tire=TireData(added=(fit.calibration,)))
        last = {e.name: e for e in estimator.update(revolution, latest, conditions)}
    return last


def calibration(count: int, seed: int) -> None:
    """Print values, errors and pulls of the calibration and of the slip angles that it gives."""
    rng = np.random.default_rng(seed + 1)
    pulls: dict[str, list[float]] = {}
    sizes: dict[str, list[float]] = {}
    probabilities, refused, invalid = [], 0, 0

    def add(name: str, value: float, true: float, std: float, unit: float) -> None:
        pulls.setdefault(name, []).append((value - true) / std)
        sizes.setdefault(name, []).append(std * unit)

    for case in random_cases(count, seed):
        slip = float(rng.uniform(-1.0, 1.0))
        try:
            fit = calibrated(case, rng)
        except CalibrationError as error:
            refused += 1
            print(f"refused: {error}")
            continue
        law = fit.calibration
        probabilities.append(fit.probability)
        ahead, back = case.slopes(0.0).first_half_rad, case.slopes(0.0, reverse=True).first_half_rad
        share = (case.slopes(0.1).first_half_rad - case.slopes(-0.1).first_half_rad) / math.radians(0.2)
        degree = math.degrees(1.0)
        add("belt share", law.belt_share, share, law.belt_share_std, 1.0)
        add("zero, deg", law.zero_rad, ahead, law.zero_std_rad, degree)
        assert law.ply_steer_rad is not None
        assert law.conicity_rad is not None
        add("ply steer, deg", law.ply_steer_rad, 0.5 * (ahead - back), law.ply_steer_std_rad, degree)
        add("conicity, deg", law.conicity_rad, 0.5 * (ahead + back), law.conicity_std_rad, degree)
        result = used(case, fit, slip)
        for name in (SLIP_NAME, MEAN_NAME):
            estimate = result[name]
            if estimate.status is Status.VALID:
                add(name, estimate.value, math.radians(slip), estimate.std, degree)
            else:
                invalid += 1
    print(f"{count} random tires, {refused} refused, {invalid} slip angles not valid; probability of chi-square below "
          f"0.05: {np.mean(np.array(probabilities) < 0.05):.2f}")  # fmt: skip
    print(f"{'':22s} median error  pull rms  largest")
    for name, values in pulls.items():
        print(f"{name:22s} {np.median(sizes[name]):12.4f} {_rms(values):9.2f} {np.abs(values).max():8.1f}")


def _rms(values: list[float]) -> float:
    squares: FloatArray = np.square(values)
    return math.sqrt(float(squares.mean()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=("laminate", "laws", "calibration"))
    parser.add_argument("--belts", type=int, default=40)
    parser.add_argument("--seed", type=int, default=2)
    arguments = parser.parse_args()
    if arguments.only in (None, "laminate"):
        laminates()
    if arguments.only in (None, "laws"):
        laws(arguments.belts, arguments.seed)
    if arguments.only in (None, "calibration"):
        calibration(arguments.belts, arguments.seed)


if __name__ == "__main__":
    sys.exit(main())
