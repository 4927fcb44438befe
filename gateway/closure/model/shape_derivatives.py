"""Cache of the derivatives of a baseline model's shape while the shape hardly changes."""

from collections.abc import Callable, Hashable
from dataclasses import astuple
from typing import Final, NamedTuple

import numpy as np

from gateway.closure.effects.ring_options import RingOptions
from gateway.closure.model.baseline import Shape
from gateway.types import FloatArray

# A derivative is valid while no parameter's logarithm changes by more, and no option by a larger share of itself.
_SAME: Final = 0.005
_KEPT: Final = 8


class _Entry(NamedTuple):
    parameters: FloatArray
    options: FloatArray
    slopes: tuple[Shape, ...]


class Tangents:
    """The last derivatives of a core, for each set of conditions that its shape depends on."""

    def __init__(self) -> None:
        """Start empty."""
        self._cache: dict[Hashable, list[_Entry]] = {}

    def at(
        self,
        key: Hashable,
        parameters: FloatArray,
        options: RingOptions,
        work_out: Callable[[], tuple[Shape, ...]],
    ) -> tuple[Shape, ...]:
        """Return the derivatives of a shape by the state's parameters, at a nearby point if one is known.

        Args:
            key: of the conditions on which the shape depends.
            parameters: of the state, (K,).
            options: with every ring effect in.
            work_out: returns the derivatives at exactly these parameters and options.
        """
        entries = self._cache.setdefault(key, [])
        chosen = np.array(astuple(options))
        for entry in entries:
            if np.abs(entry.parameters - parameters).max() <= _SAME and np.all(
                np.abs(entry.options - chosen) <= _SAME * np.maximum(np.abs(entry.options), np.abs(chosen))
            ):
                return entry.slopes
        slopes = work_out()
        entries.append(_Entry(parameters.copy(), chosen, slopes))
        del entries[:-_KEPT]
        return slopes
