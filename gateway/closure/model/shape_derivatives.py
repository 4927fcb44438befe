"""Cache of the derivatives of a baseline model's shape."""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Final

from gateway.closure.effects.ring_options import RingOptions
from gateway.closure.model.baseline import Shape
from gateway.types import FloatArray

_KEPT: Final = 64


class Tangents:
    """The last derivatives of a core.

    They serve no other point, however near. A fit with derivatives of a point on its way stops half a standard error
    from its optimum, where it depends on that way.
    """

    def __init__(self) -> None:
        """Start empty."""
        self._cache: OrderedDict[Hashable, tuple[Shape, ...]] = OrderedDict()

    def at(
        self,
        key: Hashable,
        parameters: FloatArray,
        options: RingOptions,
        work_out: Callable[[], tuple[Shape, ...]],
    ) -> tuple[Shape, ...]:
        """Return the derivatives of a shape by the state's parameters.

        Args:
            key: of the conditions on which the shape depends.
            parameters: of the state, (K,).
            options: with every ring effect in.
            work_out: returns the derivatives.
        """
        place = key, parameters.tobytes(), options
        slopes = self._cache.get(place)
        if slopes is None:
            slopes = self._cache[place] = work_out()
            if len(self._cache) > _KEPT:
                self._cache.popitem(last=False)
        return slopes
