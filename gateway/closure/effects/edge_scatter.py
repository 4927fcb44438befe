"""Contact edge scatter: edges that come a little early or late each time are smeared by averaging."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.closure.effects.base import (
    CIRCUMFERENTIAL,
    FIELD_SIZE,
    LATERAL,
    NOWHERE,
    RADIAL,
    Conditions,
    Here,
    Parameter,
    Stage,
)

FloatArray = NDArray[np.float64]

_ORDER: Final[FloatArray] = np.arange(FIELD_SIZE // 2 + 1, dtype=np.float64)
# A measured leading edge scatters by 1.9 mm on a drum, a trailing one by 0.5; 8 mm on 0.32 m are 25 mrad.
_LARGEST_RAD2: Final = 6e-4
# Below zero edges would be sharper than each is. Half a mrad of 0.16 mm is what the ring's own edges are good to.
_SMALLEST_RAD2: Final = -1e-6
_START_RAD2: Final = 3e-5
_MRAD2: Final = 1e6
# The two edges' shares change over within this part of the half contact about its middle, where the signal is flat.
_CHANGE: Final = 0.5


def _variance(side: str) -> Parameter:
    return Parameter(
        f"{side}_rad2", "rad^2", _SMALLEST_RAD2, _LARGEST_RAD2, 2e-4, 1e-9, factor=_MRAD2, display_unit="mrad^2"
    )


class EdgeScatter:
    """Mean over revolutions whose edges are normally scattered, each edge by its own variance."""

    name = "contact edge scatter"
    summary = (
        "The contact's edges (or their detection) move from revolution to revolution, so that averaging smears them."
    )
    equation = "orders about either edge fall by exp(-n^2 sigma^2 / 2), sigma^2 of its own for each"
    parameters = (_variance("leading"), _variance("trailing"))
    seen_by = "High orders of all axes at the edges, alike at every speed in order; the scatter of revolutions there."
    confused_with = (
        "A low-pass filter (0.99 alike at one speed, 0.9 at 40 and 100 km/h), which falls in Hz and delays; tread "
        "damping, where the edges differ (0.8); shear flexibility (0.6), which widens each single revolution's edges "
        "too: the scatter of revolutions there decides."
    )
    already_in = NOWHERE
    stage = Stage.BELT
    axes = (CIRCUMFERENTIAL, LATERAL, RADIAL)
    linear = False

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return one start."""
        return ((_START_RAD2, _START_RAD2),)

    def contribution(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return the smeared signal less the signal, each edge's on its own side."""
        falls = np.expm1(-0.5 * np.outer(parameters, np.square(_ORDER)))
        smeared = _filtered(here, falls)
        result: FloatArray = np.einsum("pk,pak->ak", _sides(here), smeared)
        return result

    def derivative(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return the derivatives by both variances."""
        square = -0.5 * np.square(_ORDER)
        result: FloatArray = _sides(here)[:, np.newaxis] * _filtered(
            here, square * np.exp(np.outer(parameters, square))
        )
        return result


def _filtered(here: Here, gains: FloatArray) -> FloatArray:
    """Return the signal with its orders weighted, (2, 3, FIELD_SIZE), by gains (2, orders)."""
    spectrum = np.fft.rfft(here.signal_mps2, axis=-1)
    result: FloatArray = np.fft.irfft(gains[:, np.newaxis] * spectrum, n=FIELD_SIZE, axis=-1)
    return result


def _sides(here: Here) -> FloatArray:
    """Return the shares of leading and trailing edge, (2, FIELD_SIZE)."""
    middle = 0.5 * (here.leading_edge_rad + here.trailing_edge_rad)
    half = 0.5 * (here.trailing_edge_rad - here.leading_edge_rad)
    place = np.clip((here.theta_rad - middle) / (_CHANGE * half), -1.0, 1.0)
    trailing = 0.5 * (1.0 + np.sin(0.5 * np.pi * place))
    return np.stack([1.0 - trailing, trailing])


EFFECT = EdgeScatter()
