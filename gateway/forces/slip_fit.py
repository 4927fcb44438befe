"""Slip calibration of a tire from runs at known slip angles, rolling forward and in reverse.

The slope of run i in the first half of the contact is

    slope_i = d_i P + C + s a_i (1 - k |a_i|) + (what runs share) + noise,    a_i = alpha_i + d_i m,

with d = 1 forward and -1 in reverse, ply steer P, conicity C, belt share s, saturation k, and the misalignment m of the
zero of the slip angles. Rolling in reverse turns over the plies' shear, and the slip of a misaligned wheel; a cone
stays the same. So m looks like ply steer in all runs. What runs share are errors of the sensor's roll and yaw and of
the contact edges' definition. m, k and the shared errors have priors.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from scipy.special import gammaincc

from gateway.core.errors import CalibrationError
from gateway.core.estimates.estimator import Revolution, TireConditions
from gateway.core.revolutions.contact_edges import EDGE_MODEL_STD_RAD
from gateway.core.revolutions.sensor_mounting import MOUNTING_STD_RAD, RollCalibration
from gateway.core.types import FloatArray
from gateway.forces.known_runs import check_pressure
from gateway.forces.lateral_deformation import ORDERS, chord_row
from gateway.forces.lateral_shape import has_lateral, lateral_record
from gateway.forces.slip_calibration import LAW_STD, SlipCalibration

MIN_REVOLUTIONS: Final = 20
SATURATION_PRAD: Final = 3.3
"""Relative loss of the belt's share per rad of slip on the belts of tools/bench_lateral.py, 1.3 to 9.9. To first order
the brush model gives C / (3 mu Q), C the cornering stiffness."""
SATURATION_STD_PRAD: Final = 3.0
LARGEST_SLIP_RAD: Final = math.radians(2.0)
"""Beyond it the further terms of the brush model count."""
HALF_ANGLE_SPREAD: Final = 0.1
"""Relative difference of half angles that one belt share may cover."""
# A share of fewer standard errors is not determined.
_SIGNIFICANT: Final = 5.0
# Chi-squares of smaller probability are contradictions.
_MIN_PROBABILITY: Final = 1e-3
_ITERATIONS: Final = 12
# Groups of neighbouring revolutions whose means show slow changes within a run.
_GROUPS: Final = 8


@dataclass(frozen=True, slots=True)
class SlipRun:
    """Lateral measurement of one run at a constant, known slip angle.

    Attributes:
        name: shown to the user.
        slip_rad: known slip angle, positive pulls the tire to the left.
        slip_std_rad: one standard error, independent of the other runs'.
        is_reverse: whether it rolls in reverse.
        slope_rad: mean first-half slope.
        noise_std_rad: its standard error by what differs from run to run.
        shared_std_rad: (4,) its change by one standard error of roll, yaw, leading and trailing edge, which all runs of
            a sensor share.
        scale_std: relative standard error of the lateral axis's gain over the belt radius.
        half_angle_rad: mean contact half angle.
        pressure_pa: mean pressure, None when not known.
        revolutions: number averaged.
    """

    name: str
    slip_rad: float
    slip_std_rad: float
    is_reverse: bool
    slope_rad: float
    noise_std_rad: float
    shared_std_rad: tuple[float, float, float, float]
    scale_std: float
    half_angle_rad: float
    pressure_pa: float | None
    revolutions: int


class _Record(NamedTuple):
    lateral_m: FloatArray
    radial_m: FloatArray
    along_m: FloatArray
    edges_rad: tuple[float, float]


class SlipRunRevolutions:
    """Revolutions of one run, in a form that needs 2 kB each."""

    def __init__(self, roll: RollCalibration) -> None:
        """Start empty; `roll` is shared by the runs of one sensor, which has the same roll tilt in all of them."""
        self._roll = roll
        self._records: list[_Record] = []
        self._pressures: list[float] = []
        self._conditions: TireConditions | None = None
        self.offered = 0
        self.has_lateral = False
        self.is_ac_coupled = False

    @property
    def count(self) -> int:
        """Number of revolutions that can be used."""
        return len(self._records)

    def add(self, revolution: Revolution, conditions: TireConditions) -> bool:
        """Add a revolution; one with faults is only counted. Return whether it is used."""
        self.offered += 1
        if not has_lateral(revolution):
            return False
        self.has_lateral = True
        means = revolution.axes_mps2.mean(axis=1)
        if revolution.faults or not np.isfinite(means[1:]).all() or revolution.order_max < ORDERS.stop - 1:
            return False
        if revolution.ac_coupled:
            self.is_ac_coupled = True
        else:
            self._roll.update(float(means[1]), float(means[2]))
        record = lateral_record(revolution, 0.0)
        edges = (revolution.leading_edge_rad, revolution.trailing_edge_rad)
        self._records.append(_Record(record.lateral_m, record.radial_m, record.along_m, edges))
        self._conditions = conditions
        if conditions.pressure_pa is not None:
            self._pressures.append(conditions.pressure_pa)
        return True

    def run(self, name: str, slip_rad: float, slip_std_rad: float, *, is_reverse: bool) -> SlipRun:
        """Return the measurement, with the roll tilt as calibrated by all runs so far; needs a usable revolution."""
        conditions = self._conditions
        assert conditions is not None
        radius = conditions.radius_m
        leading, trailing = np.mean([record.edges_rad for record in self._records], axis=0).tolist()

        def row(first: float, last: float) -> FloatArray:
            return chord_row(first, 0.5 * (first + last), radius)

        tilt = self._roll.roll_rad
        lateral, radial, circumferential = (np.stack([record[part] for record in self._records]) for part in range(3))
        level = math.cos(tilt) * lateral - math.sin(tilt) * radial
        slopes = level @ row(leading, trailing)
        mean_m = level.mean(axis=0)
        slope = float(slopes.mean())
        edge = EDGE_MODEL_STD_RAD
        return SlipRun(
            name=name,
            slip_rad=slip_rad,
            slip_std_rad=slip_std_rad,
            is_reverse=is_reverse,
            slope_rad=slope,
            noise_std_rad=_std_of_mean(slopes),
            shared_std_rad=(
                float(row(leading, trailing) @ radial.mean(axis=0)) * self._roll.roll_std_rad,
                float(row(leading, trailing) @ circumferential.mean(axis=0)) * MOUNTING_STD_RAD,
                float(row(leading + edge, trailing) @ mean_m) - slope,
                float(row(leading, trailing + edge) @ mean_m) - slope,
            ),
            scale_std=math.hypot(conditions.lateral_gain_std, conditions.radius_std_m / radius),
            half_angle_rad=0.5 * (trailing - leading),
            pressure_pa=float(np.mean(self._pressures)) if self._pressures else None,
            revolutions=len(slopes),
        )


def _std_of_mean(values: FloatArray) -> float:
    """Return the standard error of a mean, from single values or from groups of neighbours, whichever is larger."""
    single = float(values.std(ddof=1)) / math.sqrt(len(values))
    means = np.array([group.mean() for group in np.array_split(values, _GROUPS)])
    return max(single, float(means.std(ddof=1)) / math.sqrt(_GROUPS))


@dataclass(frozen=True, slots=True)
class SlipFit:
    """A slip calibration and how well it describes its runs.

    Attributes:
        calibration: the law.
        residual_rad: (n,) measured less fitted slope.
        pulls: (n,) residuals over the standard errors of their runs.
        left_out: (n,) the same with the law fitted to the other runs; NaN where these do not determine it.
        chi_square: of runs and priors.
        degrees_of_freedom: runs less free parameters.
        probability: of a larger chi-square by chance; NaN without degrees of freedom.
    """

    calibration: SlipCalibration
    residual_rad: FloatArray
    pulls: FloatArray
    left_out: FloatArray
    chi_square: float
    degrees_of_freedom: int
    probability: float


# Parameters of the fit: ply steer, conicity, share, saturation, misalignment, then the four shared errors.
_PLY, _CONE, _SHARE, _BEND, _MISALIGNED, _FIRST_SHARED = range(6)
_COUNT: Final = _FIRST_SHARED + 4


class _Solution(NamedTuple):
    parameters: FloatArray
    covariance: FloatArray
    residual_rad: FloatArray
    std_rad: FloatArray
    chi_square: float


def fit_slip_calibration(runs: Sequence[SlipRun], zero_std_rad: float) -> SlipFit:
    """Fit the law to runs of one sensor on one tire.

    Args:
        runs: at least one forward.
        zero_std_rad: standard error of the zero that all slip angles are counted from.

    Raises:
        CalibrationError: the runs do not determine the law, or contradict each other.
    """
    _check(runs)
    solution = _solve(runs, zero_std_rad)
    share, share_std = solution.parameters[_SHARE], math.sqrt(solution.covariance[_SHARE, _SHARE])
    slips = np.degrees([run.slip_rad for run in runs])
    if not abs(share) > _SIGNIFICANT * share_std:
        raise CalibrationError(
            f"the belt's share is not determined: {share:.3f} ± {share_std:.3f} from slip angles of {slips.min():.2f} "
            f"to {slips.max():.2f} deg",
            "Add runs at other slip angles, such as -1, 0 and 1 deg, or longer runs.",
        )
    if share < 0.0:
        raise CalibrationError(
            f"the belt's share is negative: {share:.3f} ± {share_std:.3f}",
            "Slip angles are positive where they pull the tire to the left, and the lateral axis points to the left. "
            "Turn over the sign of slip_deg, or of the axis.",
        )
    if share > 1.0:
        raise CalibrationError(
            f"the belt's share is above 1: {share:.3f} ± {share_std:.3f}",
            "Check the scale of the lateral axis and the unit of slip_deg.",
        )
    has_reverse = len({run.is_reverse for run in runs}) == 2
    freedom = len(runs) - (3 if has_reverse else 2)
    probability = _probability(solution.chi_square, freedom)
    pulls = solution.residual_rad / solution.std_rad
    others = [[*runs[:index], *runs[index + 1 :]] for index in range(len(runs))]
    if probability < _MIN_PROBABILITY:
        fitting = [
            run.name
            for run, peers in zip(runs, others, strict=True)
            if _probability(_solve(peers, zero_std_rad).chi_square, freedom - 1) >= _MIN_PROBABILITY
        ]
        hint = f"the others agree without {' or without '.join(fitting)}" if fitting else "more than one run is off"
        if freedom == 1:
            hint = "another run would show which one is off"
        raise CalibrationError(
            f"the runs contradict each other: chi-square {solution.chi_square:.1f}, degrees of freedom {freedom}; "
            f"{hint}",
            "Check slip_deg, its sign, and direction. If slip angles are less accurate than stated, increase "
            "slip_std_deg.",
        )
    left_out = np.full(len(runs), math.nan)
    for index, (run, peers) in enumerate(zip(runs, others, strict=True)):
        if len({peer.slip_rad for peer in peers}) > 1 and len({peer.is_reverse for peer in peers}) == 1 + has_reverse:
            left_out[index] = _prediction_pull(run, _solve(peers, zero_std_rad))
    return SlipFit(
        _calibration(runs, solution, has_reverse=has_reverse),
        solution.residual_rad,
        pulls,
        left_out,
        solution.chi_square,
        freedom,
        probability,
    )


def _probability(chi_square: float, freedom: int) -> float:
    """Return the probability of a larger chi-square by chance, NaN without degrees of freedom."""
    return float(gammaincc(0.5 * freedom, 0.5 * chi_square)) if freedom > 0 else math.nan


def _check(runs: Sequence[SlipRun]) -> None:
    if not any(not run.is_reverse for run in runs):
        raise CalibrationError(
            "no run rolls forward, so the zero of forward rolling is not determined",
            "Add runs that roll forward. Reverse runs only separate ply steer from conicity.",
        )
    for run in runs:
        check_pressure(run.name, run.pressure_pa)
    large = [run for run in runs if abs(run.slip_rad) > LARGEST_SLIP_RAD]
    if large:
        raise CalibrationError(
            f"{large[0].name}: {math.degrees(large[0].slip_rad):.2f} deg is too much slip: the tread slides, and the "
            "belt's share is no longer constant",
            f"Use runs of at most {math.degrees(LARGEST_SLIP_RAD):.0f} deg either way.",
        )
    angles = np.array([run.half_angle_rad for run in runs])
    if np.ptp(angles) > HALF_ANGLE_SPREAD * angles.mean():
        low, high = np.degrees([angles.min(), angles.max()])
        raise CalibrationError(
            f"the contact half angles differ too much, {low:.2f} to {high:.2f} deg: belt share and ply steer change "
            "with load and pressure",
            "Calibrate with runs at one load and one pressure.",
        )


def _law(parameters: FloatArray, runs: Sequence[SlipRun]) -> tuple[FloatArray, FloatArray]:
    """Return the slopes of the law, (n,), and their derivatives by the parameters, (n, 9)."""
    direction = np.array([-1.0 if run.is_reverse else 1.0 for run in runs])
    slip = np.array([run.slip_rad for run in runs]) + direction * parameters[_MISALIGNED]
    share, bend = parameters[_SHARE], parameters[_BEND]
    rows = np.empty((len(runs), _COUNT))
    rows[:, _PLY] = direction
    rows[:, _CONE] = 1.0
    rows[:, _SHARE] = slip * (1.0 - bend * np.abs(slip))
    rows[:, _BEND] = -share * slip * np.abs(slip)
    rows[:, _MISALIGNED] = share * (1.0 - 2.0 * bend * np.abs(slip)) * direction
    rows[:, _FIRST_SHARED:] = [run.shared_std_rad for run in runs]
    linear = [_PLY, _CONE, _SHARE, *range(_FIRST_SHARED, _COUNT)]
    return rows[:, linear] @ parameters[linear], rows


def _solve(runs: Sequence[SlipRun], zero_std_rad: float) -> _Solution:
    """Return the least squares solution, by Gauss-Newton with errors in the slip angles."""
    measured = np.array([run.slope_rad for run in runs])
    slip_std = np.array([run.slip_std_rad for run in runs])
    noise = np.array([run.noise_std_rad for run in runs])
    # In one direction of rolling only the sum of ply steer and conicity is determined: conicity is then kept at 0.
    has_reverse = len({run.is_reverse for run in runs}) == 2
    prior = np.zeros(_COUNT)
    prior_std = np.full(_COUNT, math.inf)
    prior[_BEND], prior_std[_BEND] = SATURATION_PRAD, SATURATION_STD_PRAD
    prior_std[_MISALIGNED] = max(zero_std_rad, 1e-9)
    prior_std[_FIRST_SHARED:] = 1.0
    free = [index for index in range(_COUNT) if has_reverse or index != _CONE]
    weight = np.diag(prior_std[free] ** -2.0)
    parameters = prior.copy()
    for _ in range(_ITERATIONS):
        fitted, rows = _law(parameters, runs)
        by_slip = parameters[_SHARE] * (1.0 - 2.0 * parameters[_BEND] * np.abs([run.slip_rad for run in runs]))
        law = LAW_STD * parameters[_SHARE] * np.array([run.slip_rad for run in runs])
        std = np.sqrt(noise**2 + (by_slip * slip_std) ** 2 + law**2)
        scaled = rows[:, free] / std[:, None]
        normal = scaled.T @ scaled + weight
        # A tiny share of the diagonal keeps parameters that nothing determines finite; their errors stay large.
        normal += np.diag(1e-12 * np.diag(normal))
        right = scaled.T @ ((measured - fitted) / std) - weight @ (parameters[free] - prior[free])
        parameters[free] += np.linalg.solve(normal, right)
        parameters[_BEND] = max(parameters[_BEND], 0.0)
    fitted, rows = _law(parameters, runs)
    covariance = np.zeros((_COUNT, _COUNT))
    covariance[np.ix_(free, free)] = np.linalg.inv(normal)
    residual = measured - fitted
    deviation = (parameters - prior)[free]
    chi_square = float(np.sum(np.square(residual / std)) + deviation @ weight @ deviation)
    return _Solution(parameters, covariance, residual, std, chi_square)


def _prediction_pull(run: SlipRun, others: _Solution) -> float:
    """Return the error of a law at a run it was not fitted to, over the standard error of both."""
    fitted, rows = _law(others.parameters, [run])
    by_slip = float(rows[0, _MISALIGNED]) * run.slip_std_rad
    law = LAW_STD * float(others.parameters[_SHARE]) * run.slip_rad
    variance = float(rows[0] @ others.covariance @ rows[0]) + run.noise_std_rad**2 + by_slip**2 + law**2
    return (run.slope_rad - float(fitted[0])) / math.sqrt(variance)


def _calibration(runs: Sequence[SlipRun], solution: _Solution, *, has_reverse: bool) -> SlipCalibration:
    parameters, covariance = solution.parameters, solution.covariance
    # The errors of the zero include misalignment and what the runs share: later measurements have other ones.
    total = np.zeros(_COUNT)
    total[[_PLY, _CONE]] = 1.0
    # One sensor and one tire: what a run says best about them holds in all.
    scale = min(run.scale_std for run in runs)
    zero = float(total @ parameters)
    zero_variance = float(total @ covariance @ total)
    share_std, bend_std = (math.sqrt(covariance[index, index]) for index in (_SHARE, _BEND))
    zero_share = float(total @ covariance[:, _SHARE]) / (math.sqrt(zero_variance) * share_std)
    slips = [run.slip_rad for run in runs]
    angles = [run.half_angle_rad for run in runs]
    pressures = [run.pressure_pa for run in runs if run.pressure_pa is not None]
    law = SlipCalibration(
        belt_share=float(parameters[_SHARE]),
        belt_share_std=share_std,
        zero_rad=zero,
        zero_std_rad=math.sqrt(zero_variance),
        saturation_prad=float(parameters[_BEND]),
        saturation_std_prad=bend_std,
        zero_share_correlation=zero_share,
        share_saturation_correlation=float(covariance[_SHARE, _BEND]) / (share_std * bend_std),
        slip_range_rad=(min(slips), max(slips)),
        half_angle_range_rad=(min(angles), max(angles)),
        pressure_range_pa=(min(pressures, default=0.0), max(pressures, default=math.inf)),
    )
    if not has_reverse:
        return law
    ply, cone = float(parameters[_PLY]), float(parameters[_CONE])
    return replace(
        law,
        ply_steer_rad=ply,
        ply_steer_std_rad=math.hypot(math.sqrt(covariance[_PLY, _PLY]), scale * ply),
        conicity_rad=cone,
        conicity_std_rad=math.hypot(math.sqrt(covariance[_CONE, _CONE]), scale * cone),
    )
