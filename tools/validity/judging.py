"""Judgement of estimates by the truth: pulls, validity, and whether the data could determine the quantity at all."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.kinematic import CENTRE_STD_RAD
from gateway.core.estimates.registry import in_order
from gateway.core.estimates.results import RevolutionResult
from gateway.core.quantity_catalogue import CATALOGUE
from gateway.core.ring_quantities import RING_NUMBERS, RING_RATIOS
from gateway.core.types import FloatArray
from gateway.planner.cramer_rao import DEFAULT_PARAMETERS, cramer_rao, order_variance, waveform_sensitivity
from gateway.simulator.tire_model import TireModel
from validity.cases import Case
from validity.runs import Run, Store
from validity.statements import Statement
from validity.tires import REFERENCE_DEGC, ZERO_G_STD_MPS2

# Estimators whose quantities are judged, all of them of which the truth is there; the numbers are those of the first
# that runs.
_OWNED: Final = (
    "kinematic", "distance", "self-calibration", "wear", "load", "longitudinal-force", "ply-steer", "turning", "grade",
)  # fmt: skip
NUMBER_ESTIMATORS: Final = ("weak-form", "ring-modal", "ring-paper", "forward")
# Their models are off by more than the data's errors, as they say: not valid is right where they do not know.
REFERENCES: Final = ("ring-modal", "ring-paper")
# The contact's half angle follows from its edges.
OWNERS: Final = {quantity.name: owner for owner in _OWNED for quantity in CATALOGUE[owner]} | {
    "half_angle_rad": "kinematic"
}
QUANTITIES: Final = (*OWNERS, *RING_NUMBERS, *RING_RATIOS)
BEYOND: Final = 3.5
# The hub's microseconds have 32 bit.
_TICKS_WRAP_S: Final = 2.0**32 * 1e-6
# The first revolutions have no neighbours to be compared with.
_FIRST: Final = 3
# A number counts as one that the data determine when the smallest possible error is this share of it.
_DETERMINABLE: Final = 1.0 / 9.0
# Slope of the first half per radian of roll, 0.13 to 0.15 on random tires: a zero of the lateral axis looks like a roll
# of zero / (R Omega^2) at one speed.
_SLOPE_PER_ROLL: Final = 0.14
# Not settled by one run at one speed, whatever the estimator; nor is conicity there to be found.
_NOT_EXPECTED: Final = frozenset({"gain", "zero_g_offset_mps2", "conicity_slope_rad"})
_LATERAL_ORDERS: Final = 20
_CLOCKED_PPM: Final = 200.0
_OF_ONE_CONTACT: Final = (
    "leading_edge_rad", "trailing_edge_rad", "half_angle_rad", "contact_length_m", "contact_fraction",
    "pressure_number", "load_n", "load_by_angle_n", "load_by_width_n",
)  # fmt: skip
_OF_LATERAL_SIGN: Final = (
    "roll_tilt_rad", "sensor_roll_rad", "lateral_offset_mps2", "ply_steer_peak_rad", "ply_steer_first_half_rad",
    "ply_steer_adhesion_line_rad", "ply_steer_contact_line_rad", "conicity_slope_rad", "turn_rate_radps",
    "curve_radius_m", "camber_rate_radps", "lateral_acceleration_mps2",
)  # fmt: skip
# Places within a revolution at which a rate is looked at, and by what it may change in one that has one rate.
_WITHIN, _SAME_RADPS = 9, 0.02
_PULL_LIMIT: Final = 9999.0


@dataclass(frozen=True, slots=True)
class Judged:
    """One estimate beside the truth.

    Attributes:
        case: name of the case.
        table: that the case belongs to.
        size: of the misstatement.
        tire: number of the tire.
        kind: class of the vehicle, or name of the independent tire.
        revolution: number of the revolution in its run.
        last: whether it is the last of its run, where averages have settled.
        estimator: that made it.
        quantity: name.
        value: estimate.
        std: its standard error.
        scatter: the part of it that differs between revolutions.
        truth: true value.
        status: as printed.
        determinable: whether the data could determine it.
        reasons: codes of the reasons.
    """

    case: str
    table: str
    size: float
    tire: int
    kind: str
    revolution: int
    last: bool
    estimator: str
    quantity: str
    value: float
    std: float
    scatter: float
    truth: float
    status: str
    determinable: bool
    reasons: tuple[str, ...]

    @property
    def valid(self) -> bool:
        """Whether it was called valid."""
        return self.status == Status.VALID

    @property
    def pull(self) -> float:
        """Error in standard errors, at most 9999."""
        error = self.value - self.truth
        if not math.isfinite(error):
            return math.nan
        if not self.std > 0.0:
            return math.copysign(_PULL_LIMIT, error) if error else 0.0
        return max(-_PULL_LIMIT, min(_PULL_LIMIT, error / self.std))

    @property
    def falsely_valid(self) -> bool:
        """Whether it was called valid and is not true within its errors."""
        return self.is_false(BEYOND)

    def is_false(self, errors: float) -> bool:
        """Return whether it was called valid and is more than so many of its errors from the truth."""
        return self.valid and not abs(self.pull) <= errors


def judge(
    run: Run, statement: Statement, results: Sequence[RevolutionResult], case: Case, size: float, tire: int,
    estimators: Sequence[str],
) -> Iterator[Judged]:  # fmt: skip
    """Yield the judged estimates of every revolution but the first; a run without results yields invalid ones.

    A quantity is judged where its truth is there.
    """
    running = in_order(name for name in estimators if name not in statement.left_out)
    able = determinable(run)
    if statement.calibration is None:
        able["load_by_angle_n"] = False
    first = next((name for name in running if name in NUMBER_ESTIMATORS), "")
    expected = [(OWNERS[name], name) for name in OWNERS if OWNERS[name] in running]
    expected += [
        (estimator, name)
        for estimator in running
        if estimator in NUMBER_ESTIMATORS
        for name in (*RING_NUMBERS, *RING_RATIOS)
    ]
    distance = _Distance(run, statement, results)
    for index in range(_FIRST, max(len(results), _FIRST + 1)):
        result = results[index] if index < len(results) else None
        estimates = {} if result is None else _by_owner(result, first)
        truth = dict.fromkeys(QUANTITIES, math.nan) if result is None else truths(run, statement, result)
        if result is not None:
            truth["distance_m"] = distance.to_end_of(result)
        for estimator, name in expected:
            if name not in truth or (result is not None and math.isnan(truth[name])):
                continue
            estimate = estimates.get((estimator, name)) or Estimate.invalid(name)
            yield Judged(
                case.name, case.kind, size, tire, run.world.kind, index, index >= len(results) - 1, estimator, name,
                estimate.value, estimate.std, estimate.scatter_std, truth[name], str(estimate.status),
                able.get(name, True) and estimator not in REFERENCES,
                tuple(str(reason.code.name) for reason in estimate.reasons),
            )  # fmt: skip


class _Distance:
    """True distance from the first contact centre to the end of a revolution."""

    def __init__(self, run: Run, statement: Statement, results: Sequence[RevolutionResult]) -> None:
        self._run, self._statement = run, statement
        self._first = _turn_of(run, statement, results[0]) if results else 0

    def to_end_of(self, result: RevolutionResult) -> float:
        turns = _turn_of(self._run, self._statement, result) + 1 - self._first
        return 2.0 * math.pi * self._run.world.radius_m * turns


def _true_s(run: Run, statement: Statement, result: RevolutionResult) -> float:
    """Return the true time at which a revolution begins; the program's runs with the hub's clock."""
    hub = run.truth.plan.hub
    since_s = float(np.mod(result.revolution.start_s * statement.rate_factor - hub.uptime_s + 1.0, _TICKS_WRAP_S)) - 1.0
    return float(statement.true_time_s(since_s / (statement.rate_factor * (1.0 + 1e-6 * hub.clock_ppm))))


def _turn_of(run: Run, statement: Statement, result: RevolutionResult) -> int:
    """Return the number of the true turn that a revolution is."""
    begin_s = _true_s(run, statement, result)
    return min(int(np.argmin(np.abs(run.bottoms_s - begin_s))), len(run.bottoms_s) - 2)


def _by_owner(result: RevolutionResult, first: str) -> dict[tuple[str, str], Estimate]:
    """Return the estimates by estimator and quantity; the contact's half angle is added to the edges."""
    results: dict[tuple[str, str], Estimate] = {}
    for estimate in result.estimates:
        owner, _, name = estimate.name.rpartition(":")
        if not owner:
            owner = first if name in (*RING_NUMBERS, *RING_RATIOS) else OWNERS.get(name, "")
        results[owner, name] = estimate._replace(name=name)
    leading, trailing = results.get(("kinematic", "leading_edge_rad")), results.get(("kinematic", "trailing_edge_rad"))
    if leading is not None and trailing is not None:
        # The definition of both edges may be wrong in the same direction, as for the contact length.
        results["kinematic", "half_angle_rad"] = results["kinematic", "contact_length_m"]._replace(
            name="half_angle_rad",
            value=0.5 * (trailing.value - leading.value),
            std=0.5 * (_beyond_centre(trailing.std) + _beyond_centre(leading.std)),
        )
    return results


def _beyond_centre(edge_std_rad: float) -> float:
    """Return the error of an edge without that of the contact's centre, which the half angle does not have."""
    return math.sqrt(max(0.0, edge_std_rad**2 - CENTRE_STD_RAD**2))


def truths(run: Run, statement: Statement, result: RevolutionResult) -> dict[str, float]:
    """Return the true value of every judged quantity in one revolution."""
    world, truth = run.world, run.truth
    begin_s = _true_s(run, statement, result)
    bottoms = run.bottoms_s
    turn = _turn_of(run, statement, result)
    middle_s = 0.5 * float(bottoms[turn] + bottoms[turn + 1])
    leading, trailing = truth.contact_edges_rad(middle_s)
    half = 0.5 * (trailing - leading)
    # The program's angle 0 is the contact centre as it times it, not the lowest point.
    centre = result.revolution.omega_radps * (begin_s - float(bottoms[turn])) / statement.rate_factor
    numbers = truth.numbers(middle_s)
    slopes = run.slopes(turn + 1)
    turns_hz = 1.0 / float(bottoms[turn + 1] - bottoms[turn])
    load_n, pressure_pa = truth.load_n(middle_s), truth.pressure_pa(middle_s)
    # The tilt of a sensor is that of its sensitive axes, which its cross-axis error turns as well.
    turned_rad = 0.01 * truth.plan.sensor.cross_axis_percent
    roll_rad, pitch_rad = (math.radians(tilt) + turned_rad for tilt in world.tilt_deg[:2])
    gain, zero_mps2 = _axis_errors(run, statement, middle_s, 2)
    true_values = {
        "speed_mps": 2.0 * math.pi * world.radius_m * turns_hz,
        "angular_speed_radps": 2.0 * math.pi * turns_hz,
        "rotation_rpm": 60.0 * turns_hz,
        "leading_edge_rad": leading - centre,
        "trailing_edge_rad": trailing - centre,
        "half_angle_rad": half,
        "contact_length_m": 2.0 * half * world.radius_m,
        "contact_fraction": half / math.pi,
        "gain": gain,
        "zero_g_offset_mps2": zero_mps2,
        "sensor_offset_m": world.offset_m,
        "wear_mm": world.wear_mm,
        "roll_tilt_rad": roll_rad,
        "pitch_tilt_rad": pitch_rad,
        "wear_number": 1e-3 * world.wear_mm / world.radius_m,
        "wear_drift_mm": 0.0,
        "load_n": load_n,
        "load_by_angle_n": load_n,
        "load_by_width_n": load_n,
        "pressure_number": load_n / (2.0 * pressure_pa * half * world.radius_m**2),
        **_forces(run, load_n, pressure_pa),
        **_turns(run, np.linspace(bottoms[turn], bottoms[turn + 1], _WITHIN)),
        "sensor_roll_rad": roll_rad,
        "lateral_offset_mps2": _axis_errors(run, statement, middle_s, 1)[1],
        "ply_steer_peak_rad": slopes.peak_rad,
        "ply_steer_first_half_rad": slopes.first_half_rad,
        "ply_steer_adhesion_line_rad": slopes.adhesion_line_rad,
        "ply_steer_contact_line_rad": slopes.contact_line_rad,
        "conicity_slope_rad": slopes.conicity_rad,
        **{name: getattr(numbers, name) for name in RING_NUMBERS},
        **{name: getattr(numbers, name[:2]) / numbers.Cw for name in RING_RATIOS},
    }
    # A tilt and a slope are told in the axis that the file names, and of the lateral one no more than its size is.
    for turned in (size for name, size in statement.spoils if name == "left-handed"):
        for name in _OF_LATERAL_SIGN if turned > 1.0 else ("pitch_tilt_rad",):
            true_values[name] *= -1.0
    if "glue-lifts" in dict(statement.spoils):
        # The sensor has another pitch in the contact than elsewhere.
        true_values["pitch_tilt_rad"] = math.nan
    if abs(truth.plan.sensor.rate_error_ppm) > _CLOCKED_PPM:
        # Samples between two stamps of the hub are taken for later or earlier, so its centre is not known.
        true_values |= dict.fromkeys(("leading_edge_rad", "trailing_edge_rad"), math.nan)
    road = truth.plan.road
    loads = [truth.load_n(float(time_s)) for time_s in (bottoms[turn], bottoms[turn + 1])]
    if road.profile or road.leading_jitter_mm or road.trailing_jitter_mm or abs(loads[1] - loads[0]) > 0.01 * load_n:
        # The contact of a revolution is another one at its begin and its end, and each differs from the mean.
        true_values |= dict.fromkeys(_OF_ONE_CONTACT, math.nan)
    return true_values


def _axis_errors(run: Run, statement: Statement, time_s: float, axis: int) -> tuple[float, float]:
    """Return what an axis reads over what it should, by sensor and statement, and its reading of no acceleration."""
    world, sensor = run.world, run.truth.plan.sensor
    warmer_k = run.truth.plan.temperature_degc.at(time_s) - REFERENCE_DEGC
    gain = 1.0 + world.gain_error[axis] + 0.01 * sensor.gain_drift_percent_per_k[axis] * warmer_k
    zero_mps2 = world.zero_g_mps2[axis]
    zero_mps2 += 1e-3 * STANDARD_GRAVITY_MPS2 * sensor.zero_g_drift_mg_per_k[axis] * warmer_k
    factor = statement.unit_factor
    for name, size, told_axis in statement.told:
        if told_axis == axis and name == "hello:scale_mps2":
            factor *= 1.0 + 0.01 * size
        elif told_axis == axis and name == "hello:offset_counts":
            zero_mps2 -= size
    return gain * factor, zero_mps2 * factor


def _turns(run: Run, time_s: FloatArray) -> dict[str, float]:
    """Return how a wheel turns during a revolution, (n,) times, and the grade of the road under it."""
    path, speed_mps = run.truth.plan.path, 2.0 * math.pi * run.world.radius_m / float(np.ptp(time_s))
    direction = -1.0 if path.reverse else 1.0
    turn, camber = (
        float(rates.mean()) if np.ptp(rates) < _SAME_RADPS else math.nan
        for rates in (
            direction * np.asarray(path.yaw_radps.at_times(time_s)) + path.slip_rad.rates_at(time_s),
            path.camber_rad.rates_at(time_s),
        )
    )
    return {
        "turn_rate_radps": turn,
        "curve_radius_m": speed_mps / turn if turn else math.inf,
        "camber_rate_radps": camber,
        "lateral_acceleration_mps2": speed_mps * turn,
        "road_grade_rad": direction * float(np.mean(path.grade_rad.at_times(time_s))),
    }


def _forces(run: Run, load_n: float, pressure_pa: float) -> dict[str, float]:
    """Return the forces of a wheel at one speed; NaN where the truth is not known."""
    plan = run.truth.plan
    tire = plan.tire
    plain = plan.load_n.is_constant and plan.pressure_pa.is_constant and plan.slip_angle_rad.is_constant
    names = ("longitudinal_force_n", "axle_torque_nm", "longitudinal_ratio", "rolling_resistance")
    if not (plain and _at_one_speed(run)):
        return dict.fromkeys(names, math.nan)
    if not tire.depends_on_speed and tire.axle_torque_nm is None:
        return dict.fromkeys(names, 0.0)
    if type(tire) is not TireModel:
        return dict.fromkeys(names, math.nan)
    omega = run.truth.omega_radps(0.0)
    solved = Store.get(("forces", tire, load_n, pressure_pa, omega), lambda: _solved(tire, load_n, pressure_pa, omega))
    return dict(zip(names, solved, strict=True))


@lru_cache(maxsize=4)
def _solved(tire: TireModel, load_n: float, pressure_pa: float, omega_radps: float) -> tuple[float, ...]:
    ring = tire.solve(load_n, pressure_pa, omega_radps)
    force_n = ring.longitudinal_force_n
    return force_n, ring.axle_torque_nm, force_n / load_n, ring.rolling_resistance


def _at_one_speed(run: Run) -> bool:
    speeds = run.truth.plan.motion.at(np.linspace(0.0, run.world.seconds, 20)).speed_mps
    return float(np.ptp(speeds)) == 0.0 and not run.truth.plan.vibration.ripple_percent


def determinable(run: Run) -> dict[str, bool]:
    """Return whether the data of a run can determine a quantity; True for what is not named.

    The smallest possible error is the Cramer-Rao bound of all revolutions together, tread stiffness unknown; for the
    slope in the first half of the contact, that by the zero of the lateral axis.
    """
    world = run.world
    able = dict.fromkeys(_NOT_EXPECTED, False)
    tire, omega = run.truth.plan.tire, world.omega_radps
    conditions = (tire.ring_at(world.pressure_pa), world.load_n, world.pressure_pa, omega)
    sensitivity = Store.get(
        ("bound", *conditions),
        lambda: waveform_sensitivity(*conditions, parameters=DEFAULT_PARAMETERS, nodes=960),
    )
    highest = math.floor(0.4 * world.rate_hz * sensitivity.period_s)
    variance = order_variance(
        sensitivity.period_s,
        world.noise_mg_rthz * 1e-3 * STANDARD_GRAVITY_MPS2,
        road_rms_mps2=world.road_mps2 * world.speed_kmh / 65.0,
        max_order=min(150, highest),
    )
    bound = cramer_rao(sensitivity, variance / world.revolutions)
    able |= {name: bound.std(name) <= _DETERMINABLE for name in RING_NUMBERS}
    able |= {name: bound.ratio_std(name[:2], "Cw") <= _DETERMINABLE for name in RING_RATIOS}
    # The peak of a slope takes twenty orders.
    able |= {name: highest >= _LATERAL_ORDERS for name in OWNERS if name.startswith("ply_steer")}
    if run.lateral:
        by_zero = _SLOPE_PER_ROLL * ZERO_G_STD_MPS2 / (world.radius_m * omega**2)
        able["ply_steer_first_half_rad"] &= by_zero <= _DETERMINABLE * abs(run.slopes().first_half_rad)
    able["load_by_width_n"] = able["Cw"]
    able["wear_mm"] = able["Bs"]
    return able
