"""Campaigns of an exact ring with something planted in its signal; nothing in them comes from the closure's own model.

The ring is solved with numbers, a belt and a grid of its own; speed, gravity, orders and noise are written out here.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.types import ComplexArray, FloatArray
from gateway.diagnosis.angle.discrepancy import Discrepancy
from gateway.diagnosis.angle.fit import Fit, fit_model, linearised
from gateway.diagnosis.angle.likelihood import Whitened, whiten
from gateway.diagnosis.angle.set_evidence import Evaluated, evaluate
from gateway.diagnosis.data.campaign_data import Block, Campaign, Group
from gateway.diagnosis.data.revolution_orders import waveform_orders
from gateway.diagnosis.effects.angle_orders import ORDERS
from gateway.diagnosis.effects.catalogue import catalogue
from gateway.diagnosis.effects.effect import (
    CIRCUMFERENTIAL,
    LATERAL,
    RADIAL,
    BaselineModel,
    GroupConditions,
    ModelledBlock,
    Parameter,
    SignalEffect,
    Stage,
)
from gateway.diagnosis.model.baseline_registry import angle_effects, make_core
from gateway.diagnosis.model.closure_model import AngleEffect, ClosureModel
from gateway.diagnosis.search.set_search import SetSearch, baseline_fit
from gateway.diagnosis.search.tempered_posterior import Posterior, posterior_of
from gateway.ring.rolling_ring import RingParameters, RingSolution, solve_rolling_ring

Plant = Callable[[FloatArray, FloatArray, GroupConditions], FloatArray]

RADIUS_M, PRESSURE_PA, LOAD_N, G = 0.31, 2.2e5, 4500.0, STANDARD_GRAVITY_MPS2
NODES, BLOCKS, REVOLUTIONS = 1440, 5, 20
PLANE = (CIRCUMFERENTIAL, RADIAL)
ALL_AXES = (CIRCUMFERENTIAL, LATERAL, RADIAL)


def conditions(speed_kmh: float = 60.0, **others: float | bool) -> GroupConditions:
    """Return the declared properties of a group."""
    plain = GroupConditions(speed_kmh / 3.6 / RADIUS_M, 0.0, RADIUS_M, LOAD_N, PRESSURE_PA, 25.0, 25.0, 9600.0, 0.0)
    return replace(plain, **others)


WARM = (conditions(temperature_degc=45.0), conditions(temperature_degc=47.5))
COLD_AND_WARM = (conditions(temperature_degc=25.0), conditions(temperature_degc=47.5))
ONE_SPEED = (conditions(60.0),)
TWO_SPEEDS = (conditions(60.0), conditions(30.0))
THREE_SPEEDS = (*TWO_SPEEDS, conditions(45.0))


@lru_cache(maxsize=8)
def ring(load_n: float = LOAD_N, radius_m: float = RADIUS_M, rs: float = 2.6) -> RingSolution:
    """Return a tire whose numbers differ from the closure's initial ones."""
    tire = RingParameters.from_numbers(
        2.6e-3, 0.21, rs, 2.2, radius_m=radius_m, pressure_pa=PRESSURE_PA, tread_stiffness_npm2=6e7
    )
    return solve_rolling_ring(tire, load_n, PRESSURE_PA, 55.0, nodes=NODES)


def signal_of(group_conditions: GroupConditions, radius_m: float = RADIUS_M) -> FloatArray:
    """Return the sensor signal over the ring's angles, (3, NODES); the lateral axis is zero."""
    wave, square = ring(group_conditions.load_n, radius_m).sensor, group_conditions.omega_radps**2
    signal = np.zeros((3, NODES))
    signal[RADIAL] = square * wave.radial_m + G * wave.gravity_radial
    signal[CIRCUMFERENTIAL] = square * wave.circumferential_m + G * wave.gravity_circumferential
    return signal


def nothing(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
    return signal


def turned(axis: int, angle_rad: float) -> Plant:
    """Return a sensor turned so that the radial axis leaks into another one."""

    def plant(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
        read = signal.copy()
        read[axis] = math.cos(angle_rad) * signal[axis] + math.sin(angle_rad) * signal[RADIAL]
        read[RADIAL] = math.cos(angle_rad) * signal[RADIAL] - math.sin(angle_rad) * signal[axis]
        return read

    return plant


def wave(axes: int | Sequence[int], of: Callable[[FloatArray], FloatArray]) -> Plant:
    """Return a wave over the angle on one axis or several, the same at every speed."""

    def plant(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
        read = signal.copy()
        read[np.atleast_1d(axes)] += of(theta)
        return read

    return plant


def gain(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
    return signal * np.array([[1.0], [1.0], [1.01]])


def drift(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
    """A gain that is correct at 25 degC and varies with temperature."""
    return signal * np.array([[1.0], [1.0], [1.0 + 5e-4 * (group_conditions.temperature_degc - 25.0)]])


def fast_clock(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
    """A wheel that turns faster than its timing says."""
    return signal_of(replace(group_conditions, omega_radps=1.008 * group_conditions.omega_radps))


def larger_belt(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
    return signal_of(group_conditions, 1.016 * RADIUS_M)


def campaign_of(
    groups: Sequence[GroupConditions],
    plant: Plant = nothing,
    *,
    noise_mps2: float = 1.0,
    axes: Sequence[int] = PLANE,
    clock_error: tuple[float, float] = (math.nan, math.nan),
    seed: int = 1,
) -> Campaign:
    """Return a campaign of five blocks for each of the conditions.

    Args:
        groups: conditions, each a recording.
        plant: makes what is read of the signal (3, NODES), the angles and the conditions.
        noise_mps2: standard deviation of one real coefficient of one revolution.
        axes: that the sensor has.
        clock_error: as measured beside the waveforms.
        seed: of the noise.
    """
    rng = np.random.default_rng(seed)
    states = sorted({(item.load_n, item.pressure_pa) for item in groups})
    absent = [axis for axis in range(3) if axis not in axes]
    variance = np.full((3, ORDERS), noise_mps2**2, dtype=np.float64)
    variance[absent] = math.nan
    made = []
    for index, item in enumerate(groups):
        solved = ring(item.load_n)
        truth = waveform_orders(plant(signal_of(item), solved.theta_rad, item))
        blocks = []
        for _ in range(BLOCKS):
            real, imaginary = rng.normal(0.0, noise_mps2 / math.sqrt(REVOLUTIONS), (2, 3, ORDERS))
            imaginary[:, 0] = 0.0
            orders = truth + real + 1j * imaginary
            orders[absent] = complex(math.nan, math.nan)
            blocks.append(Block(REVOLUTIONS, item, orders))
        half_angle = 0.5 * (solved.trailing_edge_rad - solved.leading_edge_rad)
        state = states.index((item.load_n, item.pressure_pa))
        made.append(Group(f"run {index + 1}", index, state, item, tuple(blocks), variance, half_angle))
    return Campaign("W", tuple(group.label for group in made), tuple(made), len(states), {}, clock_error)


def with_blocks(campaign: Campaign, change: Callable[[int, ComplexArray], ComplexArray]) -> Campaign:
    """Return the campaign with the data of its blocks changed.

    Args:
        campaign: the campaign.
        change: changed orders from the block's number and its orders.
    """
    groups = []
    for group in campaign.groups:
        blocks = [replace(b, orders_mps2=change(k, b.orders_mps2)) for k, b in enumerate(group.blocks)]
        groups.append(replace(group, blocks=tuple(blocks)))
    return replace(campaign, groups=tuple(groups))


def with_lateral_means(campaign: Campaign, means_mps2: Sequence[float]) -> Campaign:
    """Return the campaign with only a mean for each block on the lateral axis, without noise."""
    only_mean = (np.arange(3) == LATERAL)[:, None] * (np.arange(ORDERS) == 0)
    lateral = np.repeat((np.arange(3) == LATERAL)[:, None], ORDERS, axis=1)
    return with_blocks(campaign, lambda k, orders: np.where(lateral, means_mps2[k] * only_mean, orders))


def among(*names: str) -> dict[str, AngleEffect]:
    """Return effects of the catalogue."""
    every = angle_effects(catalogue())
    return {name: every[name] for name in names}


def fitted(campaign: Campaign, *effects: AngleEffect) -> tuple[Fit, Whitened]:
    """Return the exact ring with effects, fitted, and the data."""
    core = make_core(BaselineModel.EXACT)
    data = whiten(campaign, core)
    model = ClosureModel(campaign, core, effects)
    start, _ = model.priors()
    for effect in effects:
        start[model.layout.effect(effect.name)] = effect.starts(tuple(g.conditions for g in campaign.groups))[0]
    return fit_model(model, data, start, from_afar=True), data


def started(campaign: Campaign) -> tuple[Fit, Whitened]:
    """Return the exact ring, linearised at its nominal numbers, and the data."""
    core = make_core(BaselineModel.EXACT)
    data = whiten(campaign, core)
    model = ClosureModel(campaign, core)
    return linearised(model, data, model.priors()[0]), data


def evaluated(campaign: Campaign, *effects: AngleEffect) -> tuple[Evaluated, Whitened]:
    """Return the exact ring with effects and its evidence, and the data."""
    fit, data = fitted(campaign, *effects)
    return evaluate(fit, data, Discrepancy(campaign, data), None), data


def searched(
    campaign: Campaign,
    effects: Mapping[str, AngleEffect],
    model: BaselineModel = BaselineModel.EXACT,
    expired: Callable[[], bool] = lambda: False,
) -> tuple[Posterior, SetSearch]:
    """Return the posterior over sets of these effects, and the finished search."""
    core = make_core(model)
    data = whiten(campaign, core)
    search = SetSearch(campaign, core, data, effects, Discrepancy(campaign, data), expired)
    search.run(baseline_fit(campaign, core, data))
    return posterior_of(search), search


class Sideways(SignalEffect):
    """A test effect: an offset on the lateral axis that may depend on the conditions."""

    equation = "lateral += size_mps2 * (factor of the conditions)"
    source = "these tests"
    observed_in = "lateral axis"
    confounders = ()
    axes = (LATERAL,)
    start_values = ((1.0,),)
    stage = Stage.ELEMENT
    linear = True

    def __init__(
        self,
        name: str,
        goes_with: Callable[[GroupConditions], float] = lambda _: 1.0,
        *,
        bent: float = 0.0,
        high: float = 300.0,
        prior_stds: tuple[float, ...] = (50.0,),
    ) -> None:
        """Take a name and the dependence of the size on the conditions.

        Args:
            name: of the effect.
            goes_with: the factor under given conditions.
            bent: angle by which its curve, a constant, is turned towards another one of the same size.
            high: largest plausible size.
            prior_stds: prior standard deviations of the size, the widest first.
        """
        self.name = name
        self.summary = name
        first, *others = prior_stds
        self.parameters = (Parameter("size_mps2", "m/s^2", -high, high, first, 1e-3, other_stds=tuple(others)),)
        self.goes_with = goes_with
        self._bent = bent

    def contribution(self, group_conditions: ModelledBlock, parameters: FloatArray) -> FloatArray:
        return float(parameters[0]) * self.derivative(group_conditions, parameters)[0]

    def derivative(self, group_conditions: ModelledBlock, parameters: FloatArray) -> FloatArray:
        row = np.zeros((1, *group_conditions.signal_mps2.shape))
        # Chi-square counts a constant c as c^2, a wave of order 9 as its amplitude squared.
        curve = math.cos(self._bent) + math.sin(self._bent) * np.cos(9.0 * group_conditions.theta_rad)
        row[0, LATERAL] = self.goes_with(group_conditions.conditions) * curve
        return row


def sideways(size_mps2: float, goes_with: Callable[[GroupConditions], float] = lambda _: 1.0) -> Plant:
    """Return a constant on the lateral axis that depends on the conditions."""

    def plant(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
        read = signal.copy()
        read[LATERAL] += size_mps2 * goes_with(group_conditions)
        return read

    return plant


class WavePacket(Sideways):
    """A wave at a place near 1 rad, whose start value is a period off: a fit from there ends a period off."""

    linear = False
    start_values = ((3.0, 1.0 + math.tau / 9.0),)

    def __init__(self, *places_rad: float) -> None:
        """Take places to start from instead."""
        super().__init__("wave packet")
        self.parameters = (*self.parameters, Parameter("place_rad", "rad", 0.0, 3.0, 0.3, 1e-4, prior_mean=1.0))
        self.start_values = tuple((3.0, position) for position in places_rad) or self.start_values

    def contribution(self, group_conditions: ModelledBlock, parameters: FloatArray) -> FloatArray:
        change = group_conditions.zeros()
        change[LATERAL] = float(parameters[0]) * self.packet(group_conditions.theta_rad - float(parameters[1]))[0]
        return change

    def derivative(self, group_conditions: ModelledBlock, parameters: FloatArray) -> FloatArray:
        rows = np.zeros((2, *group_conditions.signal_mps2.shape))
        packet, slope = self.packet(group_conditions.theta_rad - float(parameters[1]))
        rows[:, LATERAL] = packet, -float(parameters[0]) * slope
        return rows

    @staticmethod
    def packet(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return a packet of order 9 two radians long, and its slope."""
        hull, wave = np.exp(-0.5 * x**2), np.cos(9.0 * x)
        return hull * wave, hull * (-x * wave - 9.0 * np.sin(9.0 * x))
