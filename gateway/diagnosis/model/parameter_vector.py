"""Layout of the parameter vector: states of the tire, contact centres, the sensor, effects."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gateway.core.types import FloatArray
from gateway.diagnosis.effects.effect import Effect
from gateway.diagnosis.model.baseline import Core

# The contact's centre as the pipeline found it may lie this far from the road normal, one standard deviation.
_CENTRE_STD_RAD = 0.05


class Layout:
    """Indices in the parameter vector."""

    def __init__(
        self, core_size: int, states: int, groups: int, effects: Sequence[Effect], sensor: Sequence[Effect] = ()
    ) -> None:
        """Lay out the states' parameters, a centre a group, those of the sensor in every set, then the effects'."""
        self._core_size = core_size
        self._state_count = states
        self._groups = groups
        self._effects: dict[str, slice] = {}
        position = states * core_size + groups
        self._without_effects = position + sum(len(effect.parameters) for effect in sensor)
        for effect in (*sensor, *effects):
            self._effects[effect.name] = slice(position, position + len(effect.parameters))
            position += len(effect.parameters)
        self.size = position

    def state(self, state: int) -> slice:
        """Return the places of a state's parameters."""
        return slice(state * self._core_size, (state + 1) * self._core_size)

    @property
    def states(self) -> slice:
        """Places of all states' parameters."""
        return slice(0, self._state_count * self._core_size)

    def centre(self, group: int) -> int:
        """Return the place of a group's contact centre, rad."""
        return self._state_count * self._core_size + group

    def effect(self, name: str) -> slice:
        """Return the places of an effect's parameters."""
        return self._effects[name]

    @property
    def without_effects(self) -> int:
        """Number of parameters before the first effect's."""
        return self._without_effects

    @property
    def sensor(self) -> slice:
        """Places of the sensor's parameters that every set has."""
        return slice(self._state_count * self._core_size + self._groups, self._without_effects)

    def priors(self, core: Core, effects: Sequence[Effect]) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation of every parameter before the data are used, (size,) each."""
        mean, std = np.zeros(self.size), np.full(self.size, _CENTRE_STD_RAD)
        for state in range(self._state_count):
            mean[self.state(state)], std[self.state(state)] = core.prior_mean, core.prior_std
        for effect in effects:
            where = self.effect(effect.name)
            mean[where] = [parameter.prior_mean for parameter in effect.parameters]
            std[where] = [parameter.prior_std for parameter in effect.parameters]
        return mean, std

    def hold_whole(self, effects: Sequence[Effect], near: FloatArray, mean: FloatArray, std: FloatArray) -> None:
        """Set the priors of whole numbers, in place, so that a fit from the vector `near` keeps them."""
        for effect in effects:
            first = self.effect(effect.name).start
            for index, parameter in enumerate(effect.parameters, first):
                if parameter.whole:
                    mean[index], std[index] = near[index], parameter.step

    def moved(self, vector: FloatArray, other: Layout) -> FloatArray:
        """Return a vector of this layout in another one; missing parameters are 0."""
        result = np.zeros(other.size)
        common_size = min(self.without_effects, other.without_effects)
        result[:common_size] = vector[:common_size]
        for name, where in self._effects.items():
            if name in other._effects:
                result[other.effect(name)] = vector[where]
        return result
