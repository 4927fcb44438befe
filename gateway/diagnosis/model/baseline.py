"""Interface of the baseline models: the shape of the belt from the parameters of a tire's state."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from gateway.core.types import FloatArray
from gateway.diagnosis.effects.effect import BaselineModel, GroupConditions
from gateway.diagnosis.effects.ring_options import RingOptions
from gateway.ring.rolling_ring import LoadedBelt
from gateway.ring.rolling_ring.sensor_waveform import SensorWaveform


class NoShapeError(Exception):
    """No equilibrium at these parameters, or a stiffness out of range."""


@dataclass(frozen=True, slots=True)
class Shape:
    """A belt's shape on the angle grid of FIELD_SIZE points.

    Attributes:
        waveform: acceleration over omega^2, gravity and spin; (FIELD_SIZE,) each. A model without gravity has zeros.
        leading_edge_rad: of the contact, negative.
        trailing_edge_rad: positive.
        belt: of which it is, for what vibrates on it; None for a model without one.
    """

    waveform: SensorWaveform
    leading_edge_rad: float
    trailing_edge_rad: float
    belt: LoadedBelt | None = None


class Core(Protocol):
    """A baseline model.

    Attributes:
        model: which one.
        names: of the parameters of one state; the first four are ln of Bs, Cw, Rs, Ts over their starting values.
        prior_mean: (K,) before the data are seen.
        prior_std: (K,).
        steps: (K,) small changes for derivatives.
        gravity: whether gravity is in the model.
        drift: whether the change of speed within a revolution is.
        mean: whether it predicts order 0 of the radial axis.
        equation_share: error of its equations as a share of each order.
    """

    model: BaselineModel
    names: tuple[str, ...]
    prior_mean: FloatArray
    prior_std: FloatArray
    steps: FloatArray
    gravity: bool
    drift: bool
    mean: bool
    equation_share: float

    def shape(
        self, parameters: FloatArray, conditions: GroupConditions, options: RingOptions, half_angle_rad: float
    ) -> Shape:
        """Return the shape of a state's parameters (K,).

        Args:
            parameters: of the state.
            conditions: of the group; load and pressure set the scale, omega matters where the options depend on it.
            options: with every ring effect in.
            half_angle_rad: of the contact as measured; the exact ring does not need it.

        Raises:
            RingNotConvergedError: no equilibrium.
            ValueError: a stiffness out of range.
        """
        ...

    def tangent(
        self, parameters: FloatArray, conditions: GroupConditions, options: RingOptions, half_angle_rad: float
    ) -> tuple[Shape, ...]:
        """Return the derivatives of the shape by the state's K parameters."""
        ...

    def changes(
        self,
        parameters: FloatArray,
        conditions: GroupConditions,
        before: RingOptions,
        after: RingOptions,
        beside: Sequence[RingOptions],
        half_angle_rad: float,
    ) -> list[Shape]:
        """Return the approximate change of the shape by another option, to decide whether to fit it.

        The changes by options that differ little from `after` follow it.
        """
        ...

    def refine(self, parameters: FloatArray, conditions: GroupConditions, options: RingOptions) -> None:
        """Measure the error of the grid at these parameters; `shape` then subtracts it. No action if exact."""
        ...

    def numbers(self, parameters: FloatArray, conditions: GroupConditions) -> Mapping[str, float]:
        """Return Bs, Cw, Rs, Ts and the other physical parameters at the load and pressure of `conditions`."""
        ...


def moved(shape: Shape, tangent: Shape, step: float) -> Shape:
    """Return a shape moved by a step along a tangent; one without a belt leaves that of the shape."""
    belt = shape.belt
    if belt is not None and tangent.belt is not None:
        belt = belt.moved(tangent.belt, step)
    return Shape(
        SensorWaveform(*(field + step * slope for field, slope in zip(shape.waveform, tangent.waveform, strict=True))),
        shape.leading_edge_rad + step * tangent.leading_edge_rad,
        shape.trailing_edge_rad + step * tangent.trailing_edge_rad,
        belt,
    )


def differences(
    core: Core, parameters: FloatArray, conditions: GroupConditions, options: RingOptions, half_angle_rad: float
) -> tuple[Shape, ...]:
    """Return the derivatives of a core's shape by the state's parameters, by one-sided differences."""
    base = core.shape(parameters, conditions, options, half_angle_rad)
    shapes = [core.shape(point, conditions, options, half_angle_rad) for point in stepped(parameters, core.steps)]
    return slopes(base, shapes, core.steps)


def stepped(parameters: FloatArray, steps: FloatArray) -> list[FloatArray]:
    """Return parameters (K,) with each in turn larger by its step (K,)."""
    return list(parameters + np.diag(steps))


def slopes(base: Shape, shapes: Sequence[Shape], steps: FloatArray) -> tuple[Shape, ...]:
    """Return the differences of shapes from another over their steps (K,)."""
    derivatives = []
    for shape, step in zip(shapes, steps.tolist(), strict=True):
        change = moved(shape, base, -1.0)
        derivatives.append(
            Shape(
                SensorWaveform(*(field / step for field in change.waveform)),
                change.leading_edge_rad / step,
                change.trailing_edge_rad / step,
                None if change.belt is None else change.belt.scaled(1.0 / step),
            )
        )
    return tuple(derivatives)
