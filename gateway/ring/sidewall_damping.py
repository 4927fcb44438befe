"""Sidewall damping of a rolling tire, from the phases of the signal's orders.

Damping makes the shape of the belt asymmetric about the contact centre. In the linear ring (ring paper, Eq. 11 with
c_v = c_w = c) it turns the stiffness D_n of order n into D_n + i n d (n^2 + 1), d = c omega / p0, so that the order
lags by the phase atan(t_n d), t_n = n (n^2 + 1) / D_n. A contact pressure that is not symmetric, as from a tread with
damping, shifts the orders by n x instead. The two grow differently with the order, so a fit of

    s_n / c_n = n x + t_n d

separates them. The order of the ring without damping, under the same contact pressure, is (c_n - i s_n)(1 + i t_n d);
its even part c_n + t_n d s_n is what a balance without damping describes.

Damping of the belt's bending, with a moment of Bs (1 + r d/dtheta) times the change of curvature, makes order n lag by
b_n r, b_n = Bs n^3 (n^2 - 1)^2 / D_n. Phases hardly tell it from the other two: a fit of all three finds 0.4 to 0.6
of r on belts of finite elements, and some r where a tread with damping, or a force, shifts the contact pressure. So it
is not corrected for, but a standard error.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.core.types import ComplexArray, FloatArray
from gateway.ring.belt_shape import MAX_ORDER
from gateway.ring.ring_series import stiffness_terms
from gateway.ring.small_systems import upper_factor

# Orders of the fit: above them edge waves and the shape of the contact pressure decide the phases.
_FIRST: Final = 2
_LAST: Final = 15
_ORDERS: Final[FloatArray] = np.arange(MAX_ORDER + 1, dtype=np.float64)
_STIFFNESS_TERMS: Final[FloatArray] = stiffness_terms(_ORDERS)
_CUBIC: Final[FloatArray] = _ORDERS * (np.square(_ORDERS) + 1.0)
_BENDING: Final[FloatArray] = _ORDERS * _STIFFNESS_TERMS[:, 0]
# Share of a column that the ones before do not contain, below which it is one of them.
_SINGULAR: Final = 1e-13
# Standard error of r: a multiple of what the fit finds, and what contact pressures alone make it find.
_BENDING_SHARE: Final = 3.0
_BENDING_STD: Final = 0.005


@dataclass(frozen=True, slots=True)
class SidewallDamping:
    """Damping of the sidewall and its effect on the even orders.

    Attributes:
        damping: d = c omega / p0 over the load number Q / (p0 R^2); at least 0. On a loaded belt it is 1.1 to 1.3
            times the true one.
        shift_rad: x, shift of the contact pressure behind the contact centre.
        change: (MAX_ORDER + 1,) change of the cosine orders that takes the fitted damping away; the damping's sign is
            kept here, so that a fit below 0, which is not damping, still shows its size.
        by_bending: (MAX_ORDER + 1,) change that takes one standard error of the bending's damping away.
    """

    damping: float
    shift_rad: float
    change: FloatArray
    by_bending: FloatArray

    @property
    def correction(self) -> FloatArray:
        """The change, 0 where the fit gave a damping below 0."""
        return self.change if self.damping > 0.0 else np.zeros_like(self.change)


def sidewall_damping(orders: ComplexArray, numbers: FloatArray, max_order: int) -> SidewallDamping | None:
    """Fit the damping to the orders of a waveform about its contact centre.

    Args:
        orders: (MAX_ORDER + 1,) c - i s.
        numbers: (4,) Bs, Cw, Rs, Ts over the load number.
        max_order: highest order that the sampling carries.

    Returns:
        The damping; None where orders or numbers describe no ring.
    """
    last = min(_LAST, max_order)
    with np.errstate(divide="ignore", invalid="ignore"):
        stiffness = _STIFFNESS_TERMS @ numbers
        lag = _CUBIC / stiffness
        bending_lag = _BENDING * (float(numbers[0]) / stiffness)
    lag[:_FIRST] = bending_lag[:_FIRST] = 0.0
    fitted = slice(_FIRST, last + 1)
    cosine, sine = orders.real, -orders.imag
    columns = np.stack([_ORDERS[fitted], lag[fitted], bending_lag[fitted]], axis=1) * cosine[fitted, np.newaxis]
    if not (np.isfinite(columns).all() and np.isfinite(sine[fitted]).all()):
        return None
    # One factorisation, the right-hand side as last column, serves the fit without and with damping of the bending.
    upper = upper_factor(np.column_stack([columns, sine[fitted]]))
    largest = np.abs(upper).max(axis=0).tolist()
    first, second, third, *_ = upper.tolist()
    if not abs(second[1]) > _SINGULAR * max(largest[:2]):
        return None
    damping = second[3] / second[1]
    shift_rad = (first[3] - first[1] * damping) / first[0]
    change = damping * lag * sine
    bending = third[3] / third[2] if abs(third[2]) > _SINGULAR * largest[2] else 0.0
    by_bending = math.hypot(_BENDING_SHARE * bending, _BENDING_STD) * bending_lag * sine
    return SidewallDamping(max(damping, 0.0), shift_rad, change, by_bending)
