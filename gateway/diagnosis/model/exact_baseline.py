"""The geometrically exact ring as a baseline model, corrected for the error of its grid."""

import math
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from typing import Final, NamedTuple

import numpy as np

from gateway.core.ring_quantities import RING_NUMBERS
from gateway.core.types import FloatArray
from gateway.diagnosis.effects.effect import FIELD_SIZE, BaselineModel, GroupConditions
from gateway.diagnosis.effects.ring_options import RingOptions
from gateway.diagnosis.model.baseline import Shape, moved, slopes, stepped
from gateway.diagnosis.model.run_out_shape import LoadedShape, load_steps, out_of_round
from gateway.diagnosis.model.shape_derivatives import Tangents
from gateway.ring.reference_tire import TABLE_3_LOAD_N, TABLE_3_LOAD_NUMBER, TABLE_3_NUMBERS, TABLE_3_RADIUS_M
from gateway.ring.rolling_ring import (
    RingNotConvergedError,
    RingParameters,
    RingSolution,
    RingTangent,
    at_depth,
    loaded_belt,
    solve_rolling_ring,
)
from gateway.ring.rolling_ring.sensor_waveform import SensorWaveform

# Table 3's tire; its stiffnesses over its load are the start of a fit at any load.
_NOMINAL_TREAD_NPM2: Final = 7e7
_MASS_KGPM: Final = 3.5
# Without damping and rotary inertia the shape is the same at every speed.
_ANY_OMEGA_RADPS: Final = 56.0

# Grids, and the nodes that the bending layer sqrt(EI / (p0 b R)) at the contact's edges needs. On 480 nodes what is
# left of the grid's error at the edges passes for contact edges that scatter by 3 mrad.
_GRIDS: Final = (960, 1440)
# Scans use a coarse grid and states rounded to this share, so that one shape serves many fits.
_COARSE: Final = (480,)
_ROUNDING_STEP: Final = 0.1
_MAX_CACHED_COARSE: Final = 4096
# Derivatives are those of run-out rounded to this.
_RUNOUT_STEP_M: Final = 1e-4
_NODES_PER_LAYER: Final = 8.0
# The solver's error falls with the square of the step, but for a part that depends on where contact edges lie between
# the nodes. It is measured on a grid three times as fine: that leaves 5e-6 of the signal. One twice as fine leaves
# 1e-5, and up to 3e-5, which at 100 km/h passes for an anti-alias filter.
_REFINEMENT: Final = 3
_EXTRAPOLATION: Final = 9.0 / 8.0
_MAX_CACHED: Final = 512
# Half a megabyte each.
_MAX_CACHED_TANGENTS: Final = 48
_DEFAULT_OPTIONS: Final = RingOptions()


class _Key(NamedTuple):
    parameters: bytes
    options: RingOptions
    load_n: float
    pressure_pa: float
    radius_m: float
    omega_radps: float
    nodes: int


class _StartKey(NamedTuple):
    load_n: float
    pressure_pa: float
    omega_radps: float
    nodes: int
    with_shear: bool
    driven: bool


@dataclass(frozen=True, slots=True)
class _Solved:
    shape: Shape
    ring: RingSolution


class ExactCore:
    """The geometrically exact ring: Bs, Cw, Rs, Ts and the tread's stiffness are a state's parameters."""

    model = BaselineModel.EXACT
    names: tuple[str, ...] = (*RING_NUMBERS, "tread_stiffness_npm2")
    gravity = True
    drift = True
    mean = True
    equation_share = 0.0

    def __init__(self, grids: tuple[int, ...] = _GRIDS, *, anchored: bool = False) -> None:
        """Start with an empty cache of solutions.

        Args:
            grids: numbers of nodes of the grids.
            anchored: every solution starts from that of the same ring without options, so that it does not depend on
                what was solved before, not even by rounding; otherwise from the last one, which is faster.
        """
        self._grids = grids
        self._anchored = anchored
        self.prior_mean: FloatArray = np.zeros(5)
        self.prior_std: FloatArray = np.array([2.0, 1.5, 1.5, 1.5, 1.0])
        self.steps: FloatArray = np.full(5, 1e-3)
        self._cache: OrderedDict[_Key, _Solved] = OrderedDict()
        self._starts: dict[_StartKey, RingSolution] = {}
        # By the share as well by which a load differs from that of the group.
        self._tangent_of: dict[tuple[_StartKey, float], RingTangent] = {}
        self._corrections: dict[tuple[float, float, float], tuple[FloatArray, float, float]] = {}
        self._nodes: dict[tuple[float, float, float], int] = {}
        self._tangents = Tangents()

    def shape(
        self,
        parameters: FloatArray,
        conditions: GroupConditions,
        options: RingOptions,
        half_angle_rad: float,  # noqa: ARG002 - the interface's; the exact ring finds its contact itself
    ) -> Shape:
        """Return the shape, minus the grid's error last measured by `refine`."""
        coarse = self._on_grid(parameters, conditions, options, self._grid(conditions))
        correction = self._corrections.get(_operating_point(conditions))
        if correction is None:
            return coarse
        fields = [field + part for field, part in zip(coarse.waveform, correction[0], strict=True)]
        return Shape(
            SensorWaveform(*fields),
            coarse.leading_edge_rad + correction[1],
            coarse.trailing_edge_rad + correction[2],
            coarse.belt,
        )

    def _on_grid(self, parameters: FloatArray, conditions: GroupConditions, options: RingOptions, nodes: int) -> Shape:
        """Return the shape as a grid gives it."""
        if not (options.runout_cosine_m or options.runout_sine_m):
            return self._solve(parameters, conditions, options, nodes).shape
        round_options = _without_run_out(options)
        heights = options.runout_cosine_m, options.runout_sine_m
        # A softer ring has the same shape as one loaded more by the same factor.
        solved = [
            self._solve(parameters - math.log1p(step), conditions, round_options, nodes, step)
            for step in load_steps(*heights)
        ]
        loaded = [LoadedShape(solution.shape, solution.ring.axle_height_m) for solution in solved]
        return out_of_round(loaded, conditions.radius_m, *heights)

    def tangent(
        self,
        parameters: FloatArray,
        conditions: GroupConditions,
        options: RingOptions,
        half_angle_rad: float,  # noqa: ARG002 - as above
    ) -> tuple[Shape, ...]:
        """Return the derivatives of the shape by the state's parameters."""
        # So little run-out changes derivatives by 0.5 %.
        cosine_m, sine_m = (
            _RUNOUT_STEP_M * round(value / _RUNOUT_STEP_M) for value in (options.runout_cosine_m, options.runout_sine_m)
        )
        options = replace(options, runout_cosine_m=cosine_m, runout_sine_m=sine_m)
        load, pressure, _ = _operating_point(conditions)
        key = load, pressure, _speed_radps(conditions, options), self._grid(conditions)
        return self._tangents.at(key, parameters, options, lambda: self._slopes(parameters, conditions, options))

    def beside(
        self,
        parameters: FloatArray,
        conditions: GroupConditions,
        options: RingOptions,
        others: Sequence[RingOptions],
        half_angle_rad: float,
    ) -> list[Shape]:
        """Return the shapes under options that differ little from others, to first order in the difference.

        The tangent stiffness of the one ring serves all: a shape of its own takes three to five factorisations.
        """
        if not all(_is_first_order(options, option) for option in others):
            return [self.shape(parameters, conditions, option, half_angle_rad) for option in others]
        shape = self.shape(parameters, conditions, options, half_angle_rad)
        solved = self._solve(parameters, conditions, options, self._grid(conditions))
        tangent = RingTangent(solved.ring, drum_radius_m=options.drum_radius_m)
        shapes: dict[int, Shape] = {}
        # A ring may be read at several depths.
        for depth_m in {option.sensor_offset_m for option in others}:
            numbers = [number for number, option in enumerate(others) if option.sensor_offset_m == depth_m]
            solutions = tangent.nearby(
                [ring_parameters(parameters, conditions, others[number]) for number in numbers],
                sensor_offset_m=depth_m,
                drum_radii_m=[others[number].drum_radius_m for number in numbers],
            )
            for number, solution in zip(numbers, solutions, strict=True):
                neighbour = _on_field(solution, others[number])
                shapes[number] = replace(moved(shape, moved(neighbour, solved.shape, -1.0), 1.0), belt=neighbour.belt)
        return [shapes[number] for number in range(len(others))]

    def changes(
        self,
        parameters: FloatArray,
        conditions: GroupConditions,
        before: RingOptions,
        after: RingOptions,
        beside: Sequence[RingOptions],
        half_angle_rad: float,  # noqa: ARG002 - as above
    ) -> list[Shape]:
        """Return the approximate changes of the shape by other options: on a coarse grid, at a nearby state."""
        state = tuple((np.round(parameters / _ROUNDING_STEP) * _ROUNDING_STEP).tolist())
        base = _coarse_shape(state, conditions, before)
        changed = _coarse_shape(state, conditions, after), *_coarse_beside(state, conditions, after, tuple(beside))
        # The belts of the coarse grid are not that of the shape which is to change, and may differ in their unknowns.
        return [moved(replace(shape, belt=None), base, -1.0) for shape in changed]

    def _slopes(self, parameters: FloatArray, conditions: GroupConditions, options: RingOptions) -> tuple[Shape, ...]:
        """Return the derivatives of a tire's shape by the state's parameters."""
        points = [parameters, *stepped(parameters, self.steps)]
        heights_m = options.runout_cosine_m, options.runout_sine_m
        if not any(heights_m):
            base, *shapes = (_on_field(solution, options) for solution in self._nearby(points, conditions, options))
            return slopes(base, shapes, self.steps)
        circular = _without_run_out(options)
        by_load = [
            [
                LoadedShape(_on_field(solution, circular), solution.axle_height_m)
                for solution in self._nearby([point - math.log1p(step) for point in points], conditions, circular, step)
            ]
            for step in load_steps(*heights_m)
        ]
        base, *shapes = (out_of_round(loaded, conditions.radius_m, *heights_m) for loaded in zip(*by_load, strict=True))
        return slopes(base, shapes, self.steps)

    def _nearby(
        self,
        parameters: Sequence[FloatArray],
        conditions: GroupConditions,
        options: RingOptions,
        load_step: float = 0.0,
    ) -> list[RingSolution]:
        """Return the solution with the first parameters, and those near it, to first order in the difference."""
        torques_nm = None
        if options.traction:
            free_rolling = self._nearby(parameters, conditions, replace(options, traction=0.0), load_step)
            traction_nm = options.traction * conditions.load_n * conditions.radius_m
            torques_nm = [solution.axle_torque_nm + traction_nm for solution in free_rolling[1:]]
        nodes = self._grid(conditions)
        first, *others = parameters
        solution = self._solve(first, conditions, options, nodes, load_step).ring
        torque_nm = self._torque_nm(first, conditions, options, nodes)
        tangent = RingTangent(solution, drum_radius_m=options.drum_radius_m, axle_torque_nm=torque_nm)
        self._tangent_of[_start_key(conditions, options, nodes), load_step] = tangent
        if len(self._tangent_of) > _MAX_CACHED_TANGENTS:
            del self._tangent_of[next(iter(self._tangent_of))]
        nearby = tangent.nearby(
            [ring_parameters(point, conditions, options) for point in others],
            sensor_offset_m=options.sensor_offset_m,
            axle_torques_nm=torques_nm,
        )
        return [solution, *nearby]

    def refine(self, parameters: FloatArray, conditions: GroupConditions, options: RingOptions) -> None:
        """Measure the grid's error at these parameters; `shape` subtracts it from now on, for these conditions."""
        layer_rad = math.sqrt(
            TABLE_3_NUMBERS[0] / TABLE_3_NUMBERS[1] * math.exp(float(parameters[0]) - float(parameters[1]))
        )
        min_nodes = _NODES_PER_LAYER * 2.0 * math.pi / layer_rad
        nodes = next((nodes for nodes in self._grids if nodes >= min_nodes), self._grids[-1])
        # The grid never becomes coarser: a fit that alternates between grids does not converge.
        nodes = self._nodes[_operating_point(conditions)] = max(nodes, self._grid(conditions))
        coarse, fine = (self._on_grid(parameters, conditions, options, grid) for grid in (nodes, _REFINEMENT * nodes))
        change = np.array(fine.waveform) - np.array(coarse.waveform)
        self._corrections[_operating_point(conditions)] = (
            _EXTRAPOLATION * change,
            _EXTRAPOLATION * (fine.leading_edge_rad - coarse.leading_edge_rad),
            _EXTRAPOLATION * (fine.trailing_edge_rad - coarse.trailing_edge_rad),
        )

    def _grid(self, conditions: GroupConditions) -> int:
        return self._nodes.get(_operating_point(conditions), self._grids[0])

    def numbers(self, parameters: FloatArray, conditions: GroupConditions) -> Mapping[str, float]:
        """Return Bs, Cw, Rs, Ts and the tread's stiffness at the load and pressure of `conditions`."""
        ring = ring_parameters(parameters, conditions, RingOptions())
        numbers = ring.numbers(conditions.pressure_pa)
        return {**numbers._asdict(), "tread_stiffness_npm2": ring.tread_stiffness_npm2}

    def solution(self, parameters: FloatArray, conditions: GroupConditions, options: RingOptions) -> RingSolution:
        """Return the solved ring behind a shape, including the grid's error."""
        return self._solve(parameters, conditions, options, self._grid(conditions)).ring

    def _solve(
        self,
        parameters: FloatArray,
        conditions: GroupConditions,
        options: RingOptions,
        nodes: int,
        load_step: float = 0.0,
    ) -> _Solved:
        omega = _speed_radps(conditions, options)
        key = _Key(
            parameters.tobytes(), options, conditions.load_n, conditions.pressure_pa, conditions.radius_m, omega, nodes
        )
        cached = self._cache.get(key)
        if cached is not None:
            self._cache.move_to_end(key)
            return cached
        if options.sensor_offset_m:
            neutral = self._solve(parameters, conditions, replace(options, sensor_offset_m=0.0), nodes, load_step)
            return self._store(key, at_depth(neutral.ring, options.sensor_offset_m), options)
        ring = ring_parameters(parameters, conditions, options)
        start_key = _start_key(conditions, options, nodes)
        start = self._anchor(parameters, conditions, options, nodes) if self._anchored else self._starts.get(start_key)
        solution = solve_rolling_ring(
            ring,
            conditions.load_n,
            conditions.pressure_pa,
            omega,
            nodes=nodes,
            drum_radius_m=options.drum_radius_m,
            axle_torque_nm=self._torque_nm(parameters, conditions, options, nodes),
            start=start,
            near=None if self._anchored else self._tangent_of.get((start_key, load_step)),
        )
        self._starts[start_key] = solution
        return self._store(key, solution, options)

    def _store(self, key: _Key, solution: RingSolution, options: RingOptions) -> _Solved:
        solved = self._cache[key] = _Solved(_on_field(solution, options), solution)
        if len(self._cache) > _MAX_CACHED:
            self._cache.popitem(last=False)
        return solved

    def _anchor(
        self, parameters: FloatArray, conditions: GroupConditions, options: RingOptions, nodes: int
    ) -> RingSolution | None:
        """Return the solution of the ring without options, None for that ring itself or where it has none."""
        if options == _DEFAULT_OPTIONS:
            return None
        try:
            return self._solve(parameters, conditions, _DEFAULT_OPTIONS, nodes).ring
        except RingNotConvergedError:
            return None

    def _torque_nm(
        self, parameters: FloatArray, conditions: GroupConditions, options: RingOptions, nodes: int
    ) -> float | None:
        """Return the axle's torque: that of the losses plus traction; None for free rolling."""
        if not options.traction:
            return None
        free_torque_nm = self._solve(parameters, conditions, replace(options, traction=0.0), nodes).ring.axle_torque_nm
        return free_torque_nm + options.traction * conditions.load_n * conditions.radius_m


def _start_key(conditions: GroupConditions, options: RingOptions, nodes: int) -> _StartKey:
    omega = _speed_radps(conditions, options)
    with_shear, driven = bool(options.shear_length_m), bool(options.traction)
    return _StartKey(conditions.load_n, conditions.pressure_pa, omega, nodes, with_shear, driven)


def _speed_radps(conditions: GroupConditions, options: RingOptions) -> float:
    return conditions.omega_radps if options.depends_on_speed else _ANY_OMEGA_RADPS


def _without_run_out(options: RingOptions) -> RingOptions:
    return replace(options, runout_cosine_m=0.0, runout_sine_m=0.0)


@cache
def coarse_core() -> ExactCore:
    """Return the core of a coarse grid that all scans of a process share; its result depends on its arguments alone."""
    return ExactCore(_COARSE, anchored=True)


@lru_cache(maxsize=_MAX_CACHED_COARSE)
def _coarse_shape(parameters: tuple[float, ...], conditions: GroupConditions, options: RingOptions) -> Shape:
    return coarse_core().shape(np.array(parameters), conditions, options, 0.0)


@lru_cache(maxsize=_MAX_CACHED_COARSE)
def _coarse_beside(
    parameters: tuple[float, ...], conditions: GroupConditions, options: RingOptions, others: tuple[RingOptions, ...]
) -> tuple[Shape, ...]:
    return tuple(coarse_core().beside(np.array(parameters), conditions, options, others, 0.0))


def _is_first_order(options: RingOptions, other: RingOptions) -> bool:
    """Return whether a ring under other options follows to first order from one that is solved.

    Traction is balanced by a torque that depends on the losses; run-out is made of several loads; losses make a shape
    depend on speed. Shear and extension are inverses of stiffnesses, in which forces are not linear.
    """
    special = (options.traction, other.traction, options.runout_cosine_m, options.runout_sine_m)
    return (
        not any((*special, other.runout_cosine_m, other.runout_sine_m))
        and options.shear_length_m == other.shear_length_m
        and options.extension_stiffness_n == other.extension_stiffness_n
        and options.depends_on_speed == other.depends_on_speed
    )


def ring_parameters(parameters: FloatArray, conditions: GroupConditions, options: RingOptions) -> RingParameters:
    """Return the ring of a state's parameters in SI units, at its load and pressure.

    Stiffnesses start in proportion to the load, so that the same parameters give the same shape at any load.
    """
    radius, pressure = conditions.radius_m, conditions.pressure_pa
    load_number = conditions.load_n / (pressure * radius**2)
    factor = np.exp(parameters)
    numbers = np.array(TABLE_3_NUMBERS) * factor[:4] * (load_number / TABLE_3_LOAD_NUMBER)
    tread = _NOMINAL_TREAD_NPM2 * float(factor[4]) * (conditions.load_n / radius**2)
    tread /= TABLE_3_LOAD_N / TABLE_3_RADIUS_M**2
    bending = float(numbers[0]) * radius**4 * pressure
    shear = bending / options.shear_length_m**2 if options.shear_length_m else math.inf
    return RingParameters.from_numbers(
        *(float(number) for number in numbers),
        radius_m=radius,
        pressure_pa=pressure,
        mass_kgpm=_MASS_KGPM,
        extension_stiffness_n=options.extension_stiffness_n,
        tread_stiffness_npm2=tread,
        foundation_damping_nspm2=options.damping_time_s * float(numbers[2]) * pressure,
        tread_damping_nspm2=options.tread_damping_time_s * tread,
        sidewall_stiffening_pm=options.stiffening_pm,
        shear_stiffness_n=shear,
        rotary_inertia_kgm=options.rotary_inertia_kgm,
        bending_damping_nm2s=options.bending_damping_time_s * bending,
    )


def _operating_point(conditions: GroupConditions) -> tuple[float, float, float]:
    return conditions.load_n, conditions.pressure_pa, conditions.omega_radps


def _on_field(solution: RingSolution, options: RingOptions) -> Shape:
    """Return a solution on the model's angle grid, by trigonometric interpolation."""
    node_values = np.array(solution.sensor)
    nodes = node_values.shape[1]
    spectrum = np.fft.rfft(node_values, axis=1)
    resampled = np.zeros((len(node_values), FIELD_SIZE // 2 + 1), dtype=np.complex128)
    count = min(nodes, FIELD_SIZE) // 2
    resampled[:, :count] = spectrum[:, :count]
    fields = np.fft.irfft(resampled, n=FIELD_SIZE, axis=1) * (FIELD_SIZE / nodes)
    belt = loaded_belt(solution, options.drum_radius_m)
    return Shape(SensorWaveform(*fields), solution.leading_edge_rad, solution.trailing_edge_rad, belt)
