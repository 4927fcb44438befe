"""Cache of the derivatives of a baseline model's shape."""

from collections.abc import Callable, Hashable
from typing import Final

from gateway.core.types import FloatArray
from gateway.diagnosis.effects.ring_options import RingOptions
from gateway.diagnosis.model.baseline import Shape

_MAX_CACHED: Final = 64


class Tangents:
    """The last derivatives of a core.

    They serve no other point, however near. A fit with derivatives of a point on its way stops half a standard error
    from its optimum, where it depends on that way.
    """

    def __init__(self) -> None:
        """Start empty."""
        self._cache: dict[Hashable, tuple[Shape, ...]] = {}

    def at(
        self, key: Hashable, parameters: FloatArray, options: RingOptions, work_out: Callable[[], tuple[Shape, ...]]
    ) -> tuple[Shape, ...]:
        """Return the derivatives of a shape by the state's parameters.

        Args:
            key: of the conditions on which the shape depends.
            parameters: of the state, (K,).
            options: with every ring effect in.
            work_out: returns the derivatives.
        """
        point = key, parameters.tobytes(), options
        slopes = self._cache.get(point)
        if slopes is None:
            slopes = self._cache[point] = work_out()
            if len(self._cache) > _MAX_CACHED:
                del self._cache[next(iter(self._cache))]
        return slopes
