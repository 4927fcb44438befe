"""Prediction of a baseline model with a set of effects for every block of a campaign, with derivatives."""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Final

import numpy as np

from gateway.core.types import ComplexArray, FloatArray, IntArray
from gateway.diagnosis.data.campaign_data import Campaign, Group
from gateway.diagnosis.data.side_information import witnesses
from gateway.diagnosis.effects.angle_orders import ORDERS, field_orders
from gateway.diagnosis.effects.effect import GroupConditions, ModelledBlock, RingEffect, SignalEffect, Stage
from gateway.diagnosis.effects.local_effects import LOG_SPEED_STEPS
from gateway.diagnosis.effects.mounting import MEASURED_DEPTH
from gateway.diagnosis.effects.ring_options import RingOptions
from gateway.diagnosis.model.baseline import Core, NoShapeError, Shape, moved
from gateway.diagnosis.model.parameter_vector import Layout
from gateway.diagnosis.model.sensor_signal import base_signal, mounting_matrix, with_signal
from gateway.diagnosis.model.tire_state import half_angles_rad, references, shift, slopes
from gateway.ring.rolling_ring import RingNotConvergedError

AngleEffect = RingEffect | SignalEffect

_ORDER: Final[FloatArray] = np.arange(ORDERS, dtype=np.float64)
# Share of the signal by which the stages behind a derivative are tried.
_RESPONSE_STEP_SHARE: Final = 1e-4
# Steps of speed (relative) and of its change by which a group's answer to them is taken. Local effects change in steps
# of speed: a smaller one would see nothing of them, or a whole step.
_SPEED_STEP: Final = math.expm1(1.0 / LOG_SPEED_STEPS)
_DRIFT_STEP_RADPS2: Final = 0.01
# Step of the logarithm of load or pressure, and the difference within a group that is neglected.
_STATE_STEP: Final = 1e-3
_NEGLIGIBLE_CHANGE: Final = 1e-5
# Standard deviation of a parameter that a fit keeps, in its steps.
_HELD_STEPS: Final = 1e-3


class ClosureModel:
    """A baseline model and a set of effects on a campaign.

    Attributes:
        campaign: the data's conditions.
        core: the baseline model.
        effects: in the model: ring effects, then signal effects in the order in which they are applied.
        layout: layout of the parameter vector.
    """

    def __init__(
        self,
        campaign: Campaign,
        core: Core,
        effects: Sequence[AngleEffect] = (),
        *,
        held: Mapping[str, FloatArray] | None = None,
    ) -> None:
        """Assemble the model; effects keep their order within a stage.

        Args:
            campaign: the data's conditions.
            core: the baseline model.
            effects: in the model.
            held: by effect the values of parameters that a fit keeps.
        """
        self.campaign = campaign
        self._held_values = dict(held or {})
        self.core = core
        ring = tuple(effect for effect in effects if not isinstance(effect, SignalEffect))
        self._signal = tuple(
            sorted((effect for effect in effects if isinstance(effect, SignalEffect)), key=lambda effect: effect.stage)
        )
        self.effects: tuple[AngleEffect, ...] = (*ring, *self._signal)
        measured = any(group.conditions.offset_measured for group in campaign.groups)
        self._sensor = (MEASURED_DEPTH,) if measured else ()
        self._ring = (*self._sensor, *ring)
        self._witnesses = witnesses(campaign)
        self.layout = Layout(len(core.names), campaign.states, len(campaign.groups), self.effects, self._sensor)
        reference_of = references(campaign)
        self._shifts = [shift(core.names, group.conditions, reference_of[group.state]) for group in campaign.groups]
        self._half_angles_rad = half_angles_rad(campaign)

    def priors(self, near: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation of every parameter before the waveforms are used, (P,) each.

        Args:
            near: vector that a fit starts from, whose whole numbers it keeps; None for the catalogue's own priors.
        """
        mean, std = self.layout.priors(self.core, (*self._sensor, *self.effects))
        if near is not None:
            self.layout.hold_whole(self.effects, near, mean, std)
        for witness in self._witnesses:
            if any(effect.name == witness.effect for effect in self.effects):
                where = self.layout.effect(witness.effect)
                mean[where], std[where] = witness.value, witness.std
        for effect in self.effects:
            if effect.name in self._held_values:
                where = self.layout.effect(effect.name)
                mean[where] = self._held_values[effect.name]
                std[where] = [_HELD_STEPS * parameter.step for parameter in effect.parameters]
        return mean, std

    def prior_precision(self, near: FloatArray | None = None) -> FloatArray:
        """Return the inverse of the parameters' covariance before the waveforms are used, (P, P).

        It is diagonal but for parameters that effects share: each is the common one plus a difference of its own.

        Args:
            near: as in `priors`.
        """
        _, std = self.priors(near)
        precision = np.diag(std**-2.0)
        correlated: dict[str, list[tuple[int, float]]] = {}
        for effect in self.effects:
            first = self.layout.effect(effect.name).start
            for index, parameter in enumerate(effect.parameters, first):
                if parameter.shared_std is not None:
                    correlated.setdefault(parameter.name, []).append((index, parameter.shared_std))
        for entries in correlated.values():
            if len(entries) > 1:
                places, shared_stds = [index for index, _ in entries], [std for _, std in entries]
                covariance = np.outer(std[places], std[places]) + np.diag(np.square(shared_stds))
                precision[np.ix_(places, places)] = np.linalg.inv(covariance)
        return precision

    def witness_deviance(self) -> float:
        """Return -2 ln of the probability of the side information before the waveforms are seen, up to a constant."""
        total = 0.0
        for witness in self._witnesses:
            variance = witness.std**2
            for effect in self.effects:
                if effect.name == witness.effect:
                    variance += effect.parameters[0].prior_std ** 2
            total += witness.value**2 / variance + math.log(variance)
        return total

    def log_choices(self) -> float:
        """Return the logarithm of the number of values that the effects' whole numbers can take."""
        whole_numbers = (parameter for effect in self.effects for parameter in effect.parameters if parameter.whole)
        return sum(math.log(math.floor(parameter.high) - math.ceil(parameter.low) + 1) for parameter in whole_numbers)

    def tire(self, vector: FloatArray, index: int) -> FloatArray:
        """Return the parameters of the tire's state, (K,), as they are at the load and pressure of one group."""
        state: FloatArray = vector[self.layout.state(self.campaign.groups[index].state)] + self._shifts[index]
        return state

    def shape(self, vector: FloatArray, index: int) -> Shape:
        """Return the belt's shape of one group."""
        group, tire = self.campaign.groups[index], self.tire(vector, index)
        with _raising_no_shape():
            return self.core.shape(tire, group.conditions, self.options(vector, index), self._half_angles_rad[index])

    def _shapes_near(
        self, vector: FloatArray, points: Sequence[FloatArray], index: int, name: str, without: Shape
    ) -> list[Shape]:
        """Return the belt's shapes of one group, with approximate changes by an effect to the shape without it.

        Args:
            vector: of parameters.
            points: others that differ little from it in the effect's parameters.
            index: of the group.
            name: of the effect.
            without: shape without it.
        """
        effect = next((effect for effect in self._ring if effect.name == name), None)
        if effect is None:
            return [without] * (len(points) + 1)
        group, tire, where = self.campaign.groups[index], self.tire(vector, index), self.layout.effect(name)
        with _raising_no_shape():
            base = self.options(vector, index, without=name).rounded()
            changed, *nearby = (effect.options(base, point[where], group.conditions) for point in (vector, *points))
            changes = self.core.changes(tire, group.conditions, base, changed, nearby, self._half_angles_rad[index])
        return [moved(without, change, 1.0) for change in changes]

    def options(self, vector: FloatArray, index: int, without: str = "") -> RingOptions:
        """Return the ring options of one group with every effect but one."""
        group = self.campaign.groups[index]
        options = RingOptions(sensor_offset_m=group.declared_offset_m)
        for effect in self._ring:
            if effect.name == without:
                continue
            options = effect.options(options, vector[self.layout.effect(effect.name)], group.conditions)
        return options

    def refine(self, vector: FloatArray) -> None:
        """Measure the error of the core's grid at these parameters, where it has one."""
        for index, group in enumerate(self.campaign.groups):
            with _raising_no_shape():
                self.core.refine(self.tire(vector, index), group.conditions, self.options(vector, index))

    def predict(self, vector: FloatArray) -> list[ComplexArray]:
        """Return the orders of every block, a (blocks, 3, ORDERS) array for each group.

        Raises:
            NoShapeError: no equilibrium, or a stiffness out of range.
        """
        return [self.predict_group(vector, index) for index in range(len(self.campaign.groups))]

    def predict_mean(self, vector: FloatArray, index: int) -> ComplexArray:
        """Return the orders of one group at its mean conditions, (3, ORDERS)."""
        return self._orders(vector, index, self.shape(vector, index), self.campaign.groups[index].conditions)

    def predict_group(self, vector: FloatArray, index: int) -> ComplexArray:
        """Return the orders of every block of one group, (blocks, 3, ORDERS)."""
        group = self.campaign.groups[index]
        # Blocks of a group differ by little: what the group reads, and how that answers speed and its change.
        conditions = group.conditions
        neighbours = [conditions]
        if len(group.blocks) > 1:
            neighbours += [
                replace(conditions, omega_radps=conditions.omega_radps * (1.0 + _SPEED_STEP)),
                replace(conditions, omega_dot_radps2=conditions.omega_dot_radps2 + _DRIFT_STEP_RADPS2),
            ]
        shape = self.shape(vector, index)
        orders = np.stack([self._orders(vector, index, shape, condition) for condition in neighbours])
        if len(neighbours) == 1:
            return orders
        by_square = (orders[1] - orders[0]) / (neighbours[1].omega_radps ** 2 - conditions.omega_radps**2)
        by_drift = (orders[2] - orders[0]) / _DRIFT_STEP_RADPS2
        square, drift = _speed_deviations(group)
        result: ComplexArray = orders[0] + square * by_square + drift * by_drift
        for slope, deviations in zip(slopes(self.core.names), _state_deviations(group), strict=True):
            if np.abs(deviations).max() > _NEGLIGIBLE_CHANGE:
                shape_at_step = shape
                for tangent, slope_value in zip(self._tangents(vector, index), slope.tolist(), strict=True):
                    shape_at_step = moved(shape_at_step, tangent, _STATE_STEP * slope_value)
                derivative = (self._orders(vector, index, shape_at_step, conditions) - orders[0]) / _STATE_STEP
                result = result + deviations * derivative
        return result

    def _tangents(self, vector: FloatArray, index: int) -> tuple[Shape, ...]:
        """Return the derivatives of one group's shape by the tire's parameters."""
        conditions = self.campaign.groups[index].conditions
        with _raising_no_shape():
            options = self.options(vector, index)
            return self.core.tangent(self.tire(vector, index), conditions, options, self._half_angles_rad[index])

    def _orders(self, vector: FloatArray, index: int, shape: Shape, conditions: GroupConditions) -> ComplexArray:
        block = base_signal(self.core, shape, conditions)
        block, _ = self._chain(vector, block, _declared(self.campaign.groups[index]))
        return field_orders(block.signal_mps2) * self._order_phases(vector, index)

    def group_derivatives(
        self, vector: FloatArray, index: int, only: str | None = None, without: Shape | None = None
    ) -> tuple[IntArray, ComplexArray, ComplexArray]:
        """Return a group's prediction and derivatives at its mean conditions: nearly the same in every block.

        Args:
            vector: of parameters.
            index: of the group.
            only: an effect whose parameters alone are wanted, and roughly, to see whether it is worth a fit; None for
                all that matter to the group.
            without: the belt's shape without that effect. With it the result depends on the arguments alone, not on
                what the baseline model solved before.

        Returns:
            the places (k,) of the vector, the group's orders (3, ORDERS), and their derivatives (k, 3, ORDERS).
        """
        group, layout = self.campaign.groups[index], self.layout
        ring = [effect for effect in self._ring if only in (None, effect.name)]
        points: dict[int, FloatArray] = {}
        for effect in ring:
            for position, parameter in enumerate(effect.parameters, layout.effect(effect.name).start):
                points[position] = vector.copy()
                points[position][position] += parameter.step
        # First: the shapes beside it follow fast from the tangent stiffness.
        tangents = self._tangents(vector, index) if only is None else ()
        if only is None or without is None:
            shape, *shapes = (self.shape(point, index) for point in (vector, *points.values()))
        else:
            shape, *shapes = self._shapes_near(vector, list(points.values()), index, only, without)
        core_signal = base_signal(self.core, shape, group.conditions)
        final_block, stage_inputs = self._chain(vector, core_signal, _declared(group))
        phase = self._order_phases(vector, index)
        base: ComplexArray = field_orders(final_block.signal_mps2) * phase
        places: list[int] = []
        rows: list[ComplexArray] = []

        def add(position: int, step: float, shape_there: Shape, point: FloatArray) -> None:
            places.append(position)
            rows.append((self._orders(point, index, shape_there, group.conditions) - base) / step)

        if only is None:
            where = layout.state(group.state)
            for position, step, tangent in zip(range(where.start, where.stop), self.core.steps, tangents, strict=True):
                add(position, float(step), moved(shape, tangent, float(step)), vector)
            places.append(layout.centre(index))
            rows.append(-1j * _ORDER * base)
        for (position, stepped_vector), shape_there in zip(points.items(), shapes, strict=True):
            add(position, float(stepped_vector[position] - vector[position]), shape_there, stepped_vector)
        names = [effect.name for effect in self._signal if only in (None, effect.name)]
        if names:
            rows.extend(field_orders(self._signal_rows(vector, stage_inputs, _declared(group), names)) * phase)
            for name in names:
                where = layout.effect(name)
                places.extend(range(where.start, where.stop))
        return np.array(places, dtype=np.intp), base, np.stack(rows)

    def _signal_rows(
        self,
        vector: FloatArray,
        stage_inputs: Sequence[tuple[ModelledBlock, FloatArray]],
        mount: FloatArray | None,
        names: Sequence[str],
    ) -> FloatArray:
        """Return the derivatives by the wanted effects' parameters, through the stages behind them, (k, 3, n)."""
        rows = []
        for number, effect in enumerate(self._signal):
            if effect.name not in names:
                continue
            for row in effect.derivative(stage_inputs[number][0], vector[self.layout.effect(effect.name)]):
                change = row
                if mount is not None and effect.stage < Stage.MOUNTING:
                    # Between here and the mounting the belt's own directions hold; effects there hardly answer.
                    change = mount @ change
                for later in range(number + 1, len(self._signal)):
                    change = change + self._response(vector, *stage_inputs[later], self._signal[later], change)
                rows.append(change)
        return np.stack(rows)

    def _response(
        self, vector: FloatArray, block: ModelledBlock, added: FloatArray, effect: SignalEffect, change: FloatArray
    ) -> FloatArray:
        """Return the response of an effect's contribution, `added`, to a change of the signal before it."""
        size = float(np.abs(change).max())
        if not size > 0.0:
            return np.zeros_like(change)
        scale = _RESPONSE_STEP_SHARE * max(float(np.abs(block.signal_mps2).max()), 1.0) / size
        parameters = vector[self.layout.effect(effect.name)]
        nudged_block = with_signal(block, block.signal_mps2 + scale * change)
        result: FloatArray = (effect.contribution(nudged_block, parameters) - added) / scale
        return result

    def _chain(
        self, vector: FloatArray, block: ModelledBlock, mount: FloatArray | None
    ) -> tuple[ModelledBlock, list[tuple[ModelledBlock, FloatArray]]]:
        """Return the signal with all effects, and the input and contribution of each."""
        stages = []
        for effect in self._signal:
            if mount is not None and effect.stage >= Stage.MOUNTING:
                block, mount = with_signal(block, mount @ block.signal_mps2), None
            added = effect.contribution(block, vector[self.layout.effect(effect.name)])
            stages.append((block, added))
            block = with_signal(block, block.signal_mps2 + added)
        if mount is not None:
            block = with_signal(block, mount @ block.signal_mps2)
        return block, stages

    def _order_phases(self, vector: FloatArray, index: int) -> ComplexArray:
        """Return the turn of each order: the waveform is that of theta - centre."""
        phase: ComplexArray = np.exp(-1j * vector[self.layout.centre(index)] * _ORDER)
        return phase


@contextmanager
def _raising_no_shape() -> Iterator[None]:
    """Convert every failure to solve the ring to one exception, so that no other error is mistaken for it."""
    try:
        yield
    except (RingNotConvergedError, ValueError) as error:
        raise NoShapeError(str(error)) from error


def _speed_deviations(group: Group) -> tuple[FloatArray, FloatArray]:
    """Return the deviations of the blocks' omega^2 and domega/dt from the group's, (blocks, 1, 1) each."""
    reference = group.conditions
    square = np.array([block.conditions.omega_radps**2 - reference.omega_radps**2 for block in group.blocks])
    drift = np.array([block.conditions.omega_dot_radps2 - reference.omega_dot_radps2 for block in group.blocks])
    return square[:, None, None], drift[:, None, None]


def _state_deviations(group: Group) -> tuple[FloatArray, FloatArray]:
    """Return the deviations of the blocks' ln load and ln pressure from the group's, (blocks, 1, 1) each."""
    reference = group.conditions
    loads = np.array([math.log(block.conditions.load_n / reference.load_n) for block in group.blocks])
    pressures = np.array([math.log(block.conditions.pressure_pa / reference.pressure_pa) for block in group.blocks])
    return loads[:, None, None], pressures[:, None, None]


def _declared(group: Group) -> FloatArray | None:
    """Return the mounting as configured, None where the axes are the belt's."""
    if not (group.declared_roll_rad or group.declared_pitch_rad):
        return None
    return mounting_matrix(group.declared_roll_rad, group.declared_pitch_rad)
