"""From radial waveforms to the four numbers by the weak form, with noise and model error: what live and batch share."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.estimators.determination import FittedNumbers
from gateway.estimators.order_errors import QUARTER_TURN, by_band, relative_std
from gateway.estimators.weak_form_rows import ROWS, motion_begin
from gateway.estimators.weak_form_solve import FREEDOM, WeakFormSolution, solve_balance_alike
from gateway.physics.belt_shape import MAX_ORDER, curvature_orders, even_orders
from gateway.types import BoolArray, FloatArray

# What a belt of EA = 5 MN moves the numbers by, relative: at every load and wear alike (docs/estimators.md). Nobody
# tells how extensible a belt is, so this is one standard error.
EXTENSION_ERRORS: Final[FloatArray] = np.array([-0.0005, -0.0012, 0.0022, -0.025])

_BLOCK: Final = 32


@dataclass(frozen=True, slots=True)
class WaveformFits:
    """The four numbers of b waveforms at load number Q / (p0 R^2) = 1; all scale with it.

    Attributes:
        values: (b, 4) Bs, Cw, Rs, Ts; NaN where a waveform describes no belt.
        free: (b, 4) False where a number is held at 0.
        noise: (b, 4, 4) covariance of the errors stated for the orders.
        model: (b, 4, 4) covariance of model error.
        deflection: (b,) of the belt in the contact, over R; does not scale with the load number.
        misfit: (b,) chi-square of the balance over its degrees of freedom.
    """

    values: FloatArray
    free: BoolArray
    noise: FloatArray
    model: FloatArray
    deflection: FloatArray
    misfit: FloatArray

    def numbers(self, index: int, load_number: float) -> FittedNumbers:
        """Return one waveform's numbers at a load number."""
        square = load_number**2
        return FittedNumbers(
            self.values[index] * load_number,
            self.free[index],
            self.noise[index] * square,
            self.model[index] * square,
        )

    def load_n(self, width_m: float, pressure_pa: float, radius_m: float) -> tuple[FloatArray, FloatArray]:
        """Return the load that a known belt-tension width asks for, and its standard error, (b,) each, N.

        Cw is width over radius, and in proportion to the load the rows give it: no other number needs to be known.
        """
        cw = np.where(self.free[:, 1], self.values[:, 1], math.nan)
        load = width_m / radius_m / cw * pressure_pa * radius_m**2
        return load, load * np.sqrt(self.noise[:, 1, 1] + self.model[:, 1, 1]) / cw


def curvature_of(
    radial_mps2: FloatArray, centre_rad: FloatArray | float, offset: float, max_order: int = MAX_ORDER
) -> tuple[FloatArray, FloatArray]:
    """Return the cosine orders of kappa R about the contact's centre, (b, MAX_ORDER + 1), and the signal's means, (b,).

    Args:
        radial_mps2: (b, n) radial waveforms on the angle grid, gravity removed, steady value included.
        centre_rad: (b,) middle of the contact.
        offset: sensor offset below the neutral layer, over the belt radius.
        max_order: highest order that the sampling carries.
    """
    orders = even_orders(radial_mps2, centre_rad, max_order)
    return curvature_orders(orders, offset), orders[:, 0]


def fits_of(solution: WeakFormSolution, order_std: FloatArray) -> WaveformFits:
    """Return the numbers of a solution with their covariances.

    Noise: the orders' standard errors through the response of the numbers. Model error: the least correction of the
    orders that lets the balance hold, band by band with its phase drawn anew, through the same response; less what
    noise alone would leave. A band keeps its envelope: waves that run out of the contact stay where bending feels them.
    And the belt's extension, which the balance leaves out.

    Args:
        solution: of b waveforms.
        order_std: (b or 1, ORDER_COUNT) standard errors of the relative signal's orders.
    """
    response = solution.response[:, :4]
    weighted = response * order_std[:, np.newaxis, :]
    noise = weighted @ weighted.transpose(0, 2, 1)
    # The fit has taken UNKNOWNS of the rows' freedom out of the residual.
    excess = np.maximum(1.0 - 1.0 / np.maximum(solution.misfit, 1.0), 0.0) * (ROWS + 1) / FREEDOM
    waves = by_band(solution.correction)
    moved = np.concatenate([waves, waves @ QUARTER_TURN], axis=1) @ response.transpose(0, 2, 1)
    model = 0.5 * excess[:, np.newaxis, np.newaxis] * (moved.transpose(0, 2, 1) @ moved)
    extension = solution.unknowns[:, :4] * EXTENSION_ERRORS
    model += extension[:, :, np.newaxis] * extension[:, np.newaxis, :]
    return WaveformFits(
        values=solution.unknowns[:, :4],
        free=solution.free[:, :4],
        noise=np.broadcast_to(noise, model.shape),
        model=model,
        deflection=solution.unknowns[:, 5],
        misfit=solution.misfit,
    )


def fit_waveforms(
    radial_mps2: FloatArray,
    order_std_mps2: FloatArray,
    centre_rad: FloatArray,
    half_angle_rad: FloatArray,
    *,
    offset: float = 0.0,
    max_order: int = MAX_ORDER,
) -> WaveformFits:
    """Fit many waveforms of one tire, such as averages along a recording.

    Waveforms of nearly the same contact angle share the weights of their mean, which costs a quarter of fitting each by
    itself and does not move the numbers beyond second order.

    Args:
        radial_mps2: (b, n) waveforms on the angle grid, gravity removed, steady value included.
        order_std_mps2: (ORDER_COUNT,) standard error of each order of one waveform.
        centre_rad: (b,) middle of the contact.
        half_angle_rad: (b,) half of the contact angle.
        offset: sensor offset below the neutral layer, over the belt radius.
        max_order: highest order that the sampling carries.
    """
    count = len(radial_mps2)
    fits = WaveformFits(
        values=np.full((count, 4), math.nan),
        free=np.zeros((count, 4), dtype=np.bool_),
        noise=np.full((count, 4, 4), math.nan),
        model=np.full((count, 4, 4), math.nan),
        deflection=np.full(count, math.nan),
        misfit=np.full(count, math.nan),
    )
    orders, means = curvature_of(radial_mps2, centre_rad, offset, max_order)
    usable = np.isfinite(orders).all(axis=1) & (half_angle_rad > 0.0) & (half_angle_rad < 0.5 * math.pi)
    begins = np.array([motion_begin(angle) if good else -1 for angle, good in zip(half_angle_rad, usable, strict=True)])
    for begin in np.unique(begins[usable]):
        alike = np.flatnonzero(begins == begin)
        for first in range(0, len(alike), _BLOCK):
            block = alike[first : first + _BLOCK]
            std = relative_std(order_std_mps2, float(means[block].mean()), orders[block].mean(axis=0), max_order)
            try:
                found = fits_of(solve_balance_alike(orders[block], int(begin), std), std[np.newaxis])
            except np.linalg.LinAlgError:
                continue
            for field in ("values", "free", "noise", "model", "deflection", "misfit"):
                getattr(fits, field)[block] = getattr(found, field)
    return fits
