"""Usability of a sensor on a tire, and the errors that it will have: simulated drives through the gateway's estimators.

The drives go through the same pipeline as a recording, so the efficiency of the estimators, aliasing, band, steps and
clipping are in the result. Nothing is predicted by a formula that the drives could contradict.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from firmware_protocol.messages import Environment
from firmware_protocol.wire import MAX_RATE_HZ, MIN_RATE_HZ
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.estimates.estimator import Status
from gateway.core.estimates.results import RevolutionResult
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.core.reasons import Code, Reason, codes_of
from gateway.core.ring_quantities import RING_NUMBERS
from gateway.core.trust.sensor_limits import coarse_steps, high_corner, narrow_band
from gateway.core.wheels.timebase import HostClock
from gateway.core.wheels.wheel_pipeline import WheelPipeline
from gateway.planner.accelerometer import Accelerometer
from gateway.planner.cramer_rao import cramer_rao, order_variance, relative_bounds, waveform_sensitivity
from gateway.planner.link_load import BLOCK_SAMPLES
from gateway.planner.reasons import PlannerCode
from gateway.simulator.disturbances import REFERENCE_MPS
from gateway.simulator.hub import hello_of
from gateway.simulator.scenario import vehicle_toml
from gateway.simulator.scenario_model import Scenario, Wheel
from gateway.simulator.scenario_tables import Motion
from gateway.simulator.sensor import FULL_SCALE_COUNTS, REFERENCE_DEGC
from gateway.simulator.simulated_wheel import WheelSimulator
from gateway.simulator.time_series import constant
from gateway.simulator.truth import WheelTruth
from gateway.simulator.wheel_plan import WheelPlan, wheel_plans

AFTER: Final = (1, 10, 100)
"""Revolutions after which the errors are given."""
ESTIMATORS: Final = ("kinematic", "weak-form", "wear", "load")
# The pipeline needs the contacts before and after a revolution, and its first ones may be left out.
_SPARE_REVOLUTIONS: Final = 6
# Of a drive, given to the pipeline at once.
_PART_S: Final = 4.0
# An analog part is sampled so that its band lies within 0.4 of the rate.
_SAMPLES_PER_BAND: Final = 2.5
# Share of the rate up to which the simulator's low-pass is exact.
_LARGEST_BAND: Final = 0.45
# Of the ring that the bound is made of; its relative error is then below a percent.
_BOUND_NODES: Final = 960
_BOUND_ORDERS: Final = 150


@dataclass(frozen=True, slots=True)
class PlannedError:
    """Errors of one quantity after some revolutions.

    Attributes:
        quantity: name in the catalogue.
        revolutions: averaged.
        scatter: standard deviation over wheels, in the quantity's unit.
        stays: mean error over wheels, which no averaging removes.
        stays_std: standard error of this mean.
        bound: Cramer-Rao bound of the scatter: what the waveform holds, with the radius, and load or width, known; the
            waveform leaves tread stiffness and contact centre open. NaN for a quantity without one.
        stated: median of the standard errors that the estimator itself states.
        truth: true value.
        wheels: that gave an estimate.
        valid_share: of the wheels, that called it valid.
    """

    quantity: str
    revolutions: int
    scatter: float
    stays: float
    stays_std: float
    bound: float
    stated: float
    truth: float
    wheels: int
    valid_share: float


@dataclass(frozen=True, slots=True)
class SensorPlan:
    """What a sensor does on a tire at one speed.

    Attributes:
        sensor: the sensor.
        speed_mps: of the wheel.
        rate_hz: at which it is sampled; NaN when unknown.
        peak_mps2: largest radial acceleration.
        contact_samples: in one passage of the contact.
        usable: whether its revolutions can be used at all.
        reasons: why it cannot be used, or what to doubt.
        errors: of every quantity; empty when it cannot be used.
    """

    sensor: Accelerometer
    speed_mps: float
    rate_hz: float
    peak_mps2: float
    contact_samples: float
    usable: bool
    reasons: tuple[Reason, ...]
    errors: tuple[PlannedError, ...]


def sampling_rate_hz(sensor: Accelerometer) -> float:
    """Return the rate at which the hub samples the sensor, NaN when neither rate nor band is known."""
    if sensor.rate_hz is not None:
        return min(sensor.rate_hz, MAX_RATE_HZ)
    if sensor.bandwidth_hz is None:
        return math.nan
    return min(max(_SAMPLES_PER_BAND * sensor.bandwidth_hz, MIN_RATE_HZ), MAX_RATE_HZ)


@dataclass(frozen=True, slots=True)
class TireAtSpeed:
    """What any sensor meets on a tire at one speed.

    Attributes:
        peak_mps2: largest radial acceleration, with gravity.
        contact_s: duration of one passage of the contact.
        truths: true value of each quantity that is planned.
    """

    peak_mps2: float
    contact_s: float
    truths: Mapping[str, float]


def tire_at(scenario: Scenario, speed_mps: float) -> TireAtSpeed:
    """Return what a sensor meets on the first wheel of a scenario at a speed."""
    (plan,) = wheel_plans(_steady(scenario, speed_mps))
    load_n, pressure_pa, omega_radps = plan.load_n.at(0.0), plan.pressure_pa.at(0.0), speed_mps / plan.radius_m
    table = plan.table()
    shape = table.waveform(load_n, pressure_pa, omega_radps)[:, 0]
    leading_rad, trailing_rad = table.edges_rad(load_n, pressure_pa, omega_radps)
    return TireAtSpeed(
        peak_mps2=float(np.abs(shape).max()) * omega_radps**2 + STANDARD_GRAVITY_MPS2,
        contact_s=(trailing_rad - leading_rad) / omega_radps,
        truths=_truths(WheelTruth(plan, 0.0), scenario.wheels()[0].tire.wear_mm),
    )


def plan_sensor(
    scenario: Scenario, sensor: Accelerometer, speed_mps: float, *, wheels: int, seed: int = 0
) -> SensorPlan:
    """Return what a sensor does on the first wheel of a scenario at one speed.

    Args:
        scenario: gives the tire, load, pressure and disturbances; its sensor and motion are replaced.
        sensor: its data.
        speed_mps: of the wheel.
        wheels: simulated drives; scatter is known to 1 / sqrt(2 wheels) of itself.
        seed: of the random numbers.
    """
    rate_hz = sampling_rate_hz(sensor)
    planned = _with_sensor(scenario, sensor, speed_mps, rate_hz)
    (plan,) = wheel_plans(planned)
    omega_radps = speed_mps / plan.radius_m
    tire = tire_at(planned, speed_mps)
    refusals = tuple(_refusals(sensor, rate_hz, tire.peak_mps2))
    errors: tuple[PlannedError, ...] = ()
    doubts = tuple(_doubts(sensor, rate_hz, omega_radps))
    if not refusals:
        drives = _drives(plan, _setup(planned, sensor), omega_radps, wheels, seed)
        complete = [drive for drive in drives if len(drive) >= AFTER[-1]]
        if len(complete) < wheels:
            doubts += (Reason(PlannerCode.PLAN_FEW_REVOLUTIONS, share=100.0 * (1.0 - len(complete) / wheels)),)
        if len(complete) > 1:
            named = set(codes_of(doubts))
            doubts += tuple(_contested(complete, tire.truths, named))
            bounds = _bounds(planned.wheels()[0], sensor, plan, omega_radps, tire.truths)
            errors = tuple(_errors(complete, tire.truths, bounds))
    return SensorPlan(
        sensor=sensor,
        speed_mps=speed_mps,
        rate_hz=rate_hz,
        peak_mps2=tire.peak_mps2,
        contact_samples=tire.contact_s * rate_hz,
        usable=bool(errors),
        reasons=(*refusals, *doubts),
        errors=errors,
    )


def driven(
    scenario: Scenario,
    sensor: Accelerometer,
    speed_mps: float,
    *,
    wheels: int,
    seed: int = 0,
    revolutions: int = AFTER[-1],
    statements: Callable[[WheelSetup], WheelSetup] = lambda setup: setup,
) -> tuple[WheelSetup, list[list[RevolutionResult]]]:
    """Return the setup and the first revolutions of drives as `plan_sensor` makes them, with other `statements`."""
    planned = _with_sensor(scenario, sensor, speed_mps, sampling_rate_hz(sensor))
    (plan,) = wheel_plans(planned)
    setup = statements(_setup(planned, sensor))
    return setup, _drives(plan, setup, speed_mps / plan.radius_m, wheels, seed, revolutions)


def _steady(scenario: Scenario, speed_mps: float) -> Scenario:
    """Return the scenario with its first wheel alone, at the speed."""
    first = scenario.wheels()[0]
    motion = Motion(speed_kmh=constant(3.6 * speed_mps), direction=first.motion.direction)
    # The simulated rubber does not soften, while the estimators take it that the real one does.
    cool = constant(REFERENCE_DEGC)
    wheel = first.model_copy(update={"motion": motion, "temperature_degc": cool})
    return scenario.model_copy(update={"wheel": (wheel,)})


def _with_sensor(scenario: Scenario, sensor: Accelerometer, speed_mps: float, rate_hz: float) -> Scenario:
    """Return the scenario with its first wheel alone, with the sensor, at the speed."""
    steady = _steady(scenario, speed_mps)
    (first,) = steady.wheels()
    sampled_hz = rate_hz if MIN_RATE_HZ <= rate_hz <= MAX_RATE_HZ else MIN_RATE_HZ
    band = sensor.bandwidth_hz
    data_sheet = first.sensor.model_copy(
        update={
            "rate_hz": sampled_hz,
            "rate_error_ppm": 1e4 * sensor.rate_error_percent or first.sensor.rate_error_ppm,
            "axes": ("radial",),
            "range_g": sensor.range_g,
            "noise_mg_rthz": (sensor.noise_mg_rthz or 0.0,) * 3,
            "bandwidth_hz": band if band is not None and band <= _LARGEST_BAND * sampled_hz else None,
            "resolution_mg": sensor.resolution_mg,
            "coupling": "dc" if sensor.highpass_hz is None else "ac",
            "highpass_hz": sensor.highpass_hz or first.sensor.highpass_hz,
            "zero_g_offset_g": (sensor.zero_g_offset_g,) * 3,
            "gain_error_percent": (sensor.gain_error_percent,) * 3,
            "cross_axis_percent": sensor.cross_axis_percent,
        }
    )
    return steady.model_copy(update={"wheel": (first.model_copy(update={"sensor": data_sheet}),)})


def _refusals(sensor: Accelerometer, rate_hz: float, peak_mps2: float) -> Iterator[Reason]:
    """Yield why no revolution can be used."""
    peak_g = peak_mps2 / STANDARD_GRAVITY_MPS2
    if peak_g > sensor.range_g:
        yield Reason(PlannerCode.PLAN_RANGE, peak_g=peak_g, range_g=sensor.range_g)
    if sensor.survival_g is not None and peak_g > sensor.survival_g:
        yield Reason(PlannerCode.PLAN_SURVIVAL, peak_g=peak_g, survival_g=sensor.survival_g)
    if missing := sensor.missing():
        yield Reason(PlannerCode.PLAN_MISSING, values=" and no ".join(missing))
    if rate_hz < MIN_RATE_HZ:
        yield Reason(PlannerCode.PLAN_RATE, rate_hz=rate_hz, least_hz=MIN_RATE_HZ)


def _doubts(sensor: Accelerometer, rate_hz: float, omega_radps: float) -> Iterator[Reason]:
    """Yield what biases the numbers, or what the errors do not count."""
    wheel_hz = omega_radps / (2.0 * math.pi)
    noise = None
    if sensor.noise_mg_rthz is not None and sensor.resolution_mg is not None:
        band_hz = min(sensor.bandwidth_hz or math.inf, 0.5 * rate_hz)
        unit = 1e-3 * STANDARD_GRAVITY_MPS2
        noise = coarse_steps(unit * sensor.resolution_mg, unit * sensor.noise_mg_rthz * math.sqrt(band_hz))
    doubts = (narrow_band(sensor.bandwidth_hz, wheel_hz), high_corner(sensor.highpass_hz, wheel_hz), noise)
    yield from (doubt for doubt in doubts if doubt is not None)


def _setup(scenario: Scenario, sensor: Accelerometer) -> WheelSetup:
    """Return what the vehicle file of the first wheel states, with band, gain and zero of the sensor's data sheet."""
    (setup,) = parse_vehicle(vehicle_toml(scenario), "the plan").wheel_setups()
    sensor_setup = setup.sensor
    claims = replace(
        sensor_setup,
        bandwidth_hz=sensor.bandwidth_hz,
        gain_std=max(sensor_setup.gain_std, 0.01 * abs(sensor.gain_error_percent)),
        zero_g_std_mps2=max(sensor_setup.zero_g_std_mps2, abs(sensor.zero_g_offset_g) * STANDARD_GRAVITY_MPS2),
    )
    return replace(setup, sensor=claims)


def _drives(
    plan: WheelPlan, setup: WheelSetup, omega_radps: float, wheels: int, seed: int, revolutions: int = AFTER[-1]
) -> list[list[RevolutionResult]]:
    """Return the revolutions of independent drives, which differ in noise and in the sensor's angle at the start."""
    seconds = (revolutions + _SPARE_REVOLUTIONS) * 2.0 * math.pi / omega_radps
    generators = np.random.default_rng(seed).spawn(wheels)
    return [_drive(WheelSimulator(plan, rng), setup, seconds) for rng in generators]


def _drive(wheel: WheelSimulator, setup: WheelSetup, seconds: float) -> list[RevolutionResult]:
    pipeline, host, rate_hz = WheelPipeline(setup, ESTIMATORS), HostClock(), wheel.plan.sensor.rate_hz
    # Stamps are those of the hub, which show the error of the sensor's clock.
    true_hz = rate_hz * (1.0 + 1e-6 * wheel.plan.sensor.rate_error_ppm)
    pipeline.hello(hello_of(wheel))
    reading = Environment(wheel.plan.pressure_pa.at(0.0), wheel.plan.temperature_degc.at(0.0), None)
    counts = wheel.advance(seconds).counts
    results: list[RevolutionResult] = []
    # Results do not depend on it: parts of a second would be worked on in smaller blocks of revolutions.
    part_samples = max(1, round(_PART_S * rate_hz) // BLOCK_SAMPLES) * BLOCK_SAMPLES
    for first in range(0, len(counts) // BLOCK_SAMPLES * BLOCK_SAMPLES, part_samples):
        part = counts[first : first + part_samples]
        part = part[: len(part) // BLOCK_SAMPLES * BLOCK_SAMPLES]
        ticks = [round((first + start) * 1e6 / true_hz) for start in range(0, len(part), BLOCK_SAMPLES)]
        pipeline.environment(ticks[0], reading)
        results += pipeline.samples(first, ticks, wheel.chain.axes, part, host)
    return results + pipeline.finish(host)


def _contested(
    drives: Sequence[Sequence[RevolutionResult]], planned: Mapping[str, float], named: set[Code]
) -> Iterator[Reason]:
    """Yield why most drives end with estimates that are not valid, one reason of each code, beside what is `named`."""
    reason_counts: Counter[Code] = Counter()
    first: dict[Code, Reason] = {}
    for drive in drives:
        drive_reasons = {
            reason.code: reason
            for estimate in drive[AFTER[-1] - 1].estimates
            if estimate.name in planned and estimate.status is not Status.VALID
            if not named.intersection(codes_of(estimate.reasons))
            for reason in estimate.reasons
        }
        reason_counts.update(drive_reasons.keys())
        first = drive_reasons | first
    yield from (first[code] for code, count in reason_counts.items() if 2 * count > len(drives))


def _truths(truth: WheelTruth, wear_mm: float) -> dict[str, float]:
    """Return the true value of each quantity that is planned."""
    numbers = truth.numbers(0.0)
    leading_rad, trailing_rad = truth.contact_edges_rad(0.0)
    values = {
        "speed_mps": truth.speed_mps(0.0),
        "contact_length_m": (trailing_rad - leading_rad) * truth.plan.radius_m,
        "load_by_width_n": truth.load_n(0.0),
        "wear_mm": wear_mm,
    }
    values |= {name: getattr(numbers, name) for name in RING_NUMBERS}
    return values | {f"{name}/Cw": values[name] / values["Cw"] for name in RING_NUMBERS if name != "Cw"}


def _bounds(
    wheel: Wheel, sensor: Accelerometer, plan: WheelPlan, omega_radps: float, truths: Mapping[str, float]
) -> dict[str, float]:
    """Return the Cramer-Rao bounds of one revolution, each in its quantity's unit.

    A sensor's band and AC corner filter its noise with the signal, so they take nothing from the bound.
    """
    load_n, pressure_pa, rate_hz = plan.load_n.at(0.0), plan.pressure_pa.at(0.0), plan.sensor.rate_hz
    sensitivity = waveform_sensitivity(
        plan.tire.ring_at(pressure_pa),
        load_n,
        pressure_pa,
        omega_radps,
        nodes=_BOUND_NODES,
        sensor_offset_m=plan.tire.sensor_offset_m,
    )
    step_g = max(1e-3 * (sensor.resolution_mg or 0.0), sensor.range_g / FULL_SCALE_COUNTS)
    # Steps have the variance step^2 / 12 over half the rate.
    density_g_rthz = math.hypot(1e-3 * (sensor.noise_mg_rthz or 0.0), step_g / math.sqrt(6.0 * rate_hz))
    variance = order_variance(
        sensitivity.period_s,
        density_g_rthz * STANDARD_GRAVITY_MPS2,
        road_rms_mps2=plan.road.rms_mps2 * omega_radps * plan.radius_m / REFERENCE_MPS,
        road_bandwidth_hz=plan.road.bandwidth_hz,
        max_order=min(_BOUND_ORDERS, math.floor(0.5 * rate_hz * sensitivity.period_s)),
    )
    relative = relative_bounds(sensitivity, cramer_rao(sensitivity, variance))
    scales = {**truths, "wear_mm": wheel.tire.ring_thickness_mm - wheel.tire.wear_mm}
    return {name: share * abs(scales[name]) for name, share in relative.items() if name in scales}


def _errors(
    drives: Sequence[Sequence[RevolutionResult]], truths: Mapping[str, float], bounds: Mapping[str, float]
) -> Iterator[PlannedError]:
    for name, truth in truths.items():
        for count in AFTER:
            estimates = [estimate for drive in drives if (estimate := _estimate(drive, name, count)) is not None]
            if len(estimates) < 2:
                continue
            values = np.array([value for value, _, _ in estimates])
            scatter = float(values.std(ddof=1))
            yield PlannedError(
                quantity=name,
                revolutions=count,
                scatter=scatter,
                stays=float(values.mean()) - truth,
                stays_std=scatter / math.sqrt(len(values)),
                # The mean speed rests on the first and the last contact alone: N revolutions divide its error by N.
                bound=bounds.get(name, math.nan) / (count if name == "speed_mps" else math.sqrt(count)),
                stated=float(np.median([std for _, std, _ in estimates])),
                truth=truth,
                wheels=len(values),
                valid_share=sum(valid for _, _, valid in estimates) / len(estimates),
            )


def _estimate(drive: Sequence[RevolutionResult], name: str, count: int) -> tuple[float, float, bool] | None:
    """Return value, stated standard error and validity after some revolutions; None for no finite value.

    The speed is of one revolution each: after several it is their mean, and what is stated remains that of one.
    """
    result = next(item for item in drive[count - 1].estimates if item.name == name)
    value = result.value
    if name == "speed_mps":
        value = float(np.mean([item.value for row in drive[:count] for item in row.estimates if item.name == name]))
    return (value, result.std, result.status is Status.VALID) if math.isfinite(value) else None
