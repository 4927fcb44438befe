"""Cache of the derivatives of a baseline model's shape while the shape hardly changes."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import astuple
from typing import Final, NamedTuple

import numpy as np

from gateway.closure.effects.effect import GroupConditions
from gateway.closure.model.baseline import Core, Shape, differences
from gateway.closure.model.ring_options import RingOptions
from gateway.types import FloatArray

# A derivative is valid while no parameter's logarithm changes by more, and no option by a larger share of itself.
_SAME: Final = 0.005
_KEPT: Final = 8


class _Known(NamedTuple):
    parameters: FloatArray
    options: FloatArray
    slopes: tuple[Shape, ...]


class Tangents:
    """The last derivatives of a core, for each set of conditions that its shape depends on."""

    def __init__(self) -> None:
        """Start empty."""
        self._kept: dict[Hashable, list[_Known]] = {}

    def at(
        self,
        core: Core,
        place: Hashable,
        parameters: FloatArray,
        conditions: GroupConditions,
        options: RingOptions,
        half_angle_rad: float,
    ) -> tuple[Shape, ...]:
        """Return the derivatives of `core.shape` by the state's parameters, at a nearby point if one is known.

        Args:
            core: the baseline model.
            place: key of the conditions on which the shape depends.
            parameters: of the state, (K,).
            conditions: of the group.
            options: with every ring effect in.
            half_angle_rad: of the contact as measured.
        """
        kept = self._kept.setdefault(place, [])
        chosen = np.array(astuple(options))
        for known in kept:
            if np.abs(known.parameters - parameters).max() <= _SAME and np.all(
                np.abs(known.options - chosen) <= _SAME * np.maximum(np.abs(known.options), np.abs(chosen))
            ):
                return known.slopes
        slopes = differences(core, parameters, conditions, options, half_angle_rad)
        kept.append(_Known(parameters.copy(), chosen, slopes))
        del kept[:-_KEPT]
        return slopes
