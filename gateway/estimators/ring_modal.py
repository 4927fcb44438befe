"""The ring paper's ring with what its estimator leaves out put in: kinematics, vertical force, pressure shape, weights.

Against `ring-paper`: n^2 - 1 for n^2, orders from 2 up, the road's push vertical, the contact's edges and pressure
shape fitted with priors, each order weighted with its error. It follows the waveform of the exact ring ten times
closer, and its Bs is right within some percent; but it stays a linear ring, whose Cw, Rs and Ts are those of a belt
that does not lose tension in the contact (docs/estimators.md).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from gateway.estimators.base import AngleAverage, Conditions, Estimate, Revolution
from gateway.estimators.determination import (
    FittedNumbers,
    all_invalid,
    doubt_about,
    load_number,
    number_estimates,
    unusable,
)
from gateway.estimators.order_errors import band_mean, relative_std
from gateway.estimators.ring_modal_fit import ModalFit, fit_modal
from gateway.reasons import Code, Reason
from gateway.signal.order_spectrum import ORDER_COUNT
from gateway.types import FloatArray

FIRST_ORDER: Final = 2
_UNKNOWN_EDGE_STD_RAD: Final = 0.01
# Share of the signal left over from which the ring is no description of it.
WORST_LEFT_OVER: Final = 0.5
_MODEL_NOTE: Final = Reason(Code.LINEAR_RING_TENSION)


class RingModalEstimator:
    """Bs, Cw, Rs, Ts and their ratios to Cw from the running average's orders 2 to 60."""

    def __init__(self) -> None:
        """Start cold."""
        self.reset()

    @property
    def name(self) -> str:
        """Name in the registry."""
        return "ring-modal"

    def reset(self) -> None:
        """Forget the warm start."""
        self._warm: FloatArray | None = None

    def update(self, revolution: Revolution, average: AngleAverage, conditions: Conditions) -> tuple[Estimate, ...]:
        """Return Bs, Cw, Rs, Ts, then Bs/Cw, Rs/Cw, Ts/Cw.

        Without load or pressure the four are invalid and the ratios stand. Provisional until the average has settled,
        on a revolution with faults, and where the data do not determine a number. Never raises on values.
        """
        reason = unusable(average, conditions)
        if reason:
            return self._cold(reason)
        mean = float(average.orders_mps2[0].real)
        if not mean > 0.0:
            return self._cold(Reason(Code.NO_STEADY_VALUE))
        carried = int(np.flatnonzero(np.isfinite(average.orders_mps2))[-1])
        relative = average.orders_mps2 / mean
        std = relative_std(average.orders_std_mps2, mean, np.abs(np.nan_to_num(relative)), carried)
        used = slice(FIRST_ORDER, carried + 1)
        edge_std = 0.5 * (average.leading_edge_std_rad + average.trailing_edge_std_rad)
        fit = fit_modal(
            np.arange(FIRST_ORDER, carried + 1, dtype=np.float64),
            relative[used],
            std[used],
            edges_rad=(average.leading_edge_rad, average.trailing_edge_rad),
            edge_std_rad=edge_std if np.isfinite(edge_std) and edge_std > 0.0 else _UNKNOWN_EDGE_STD_RAD,
            start=self._warm,
        )
        if fit is None:
            return self._cold(Reason(Code.ORDERS_UNUSABLE))
        if fit.left_over > WORST_LEFT_OVER:
            return self._cold(Reason(Code.RING_DOES_NOT_FIT, residual=fit.left_over, limit=WORST_LEFT_OVER))
        self._warm = fit.parameters
        number = load_number(conditions)
        fitted = FittedNumbers(
            fit.numbers * number, fit.free, _noise(fit, std[used]) * number**2, _model(fit) * number**2
        )
        return number_estimates(fitted, conditions, doubt_about(revolution, average), (_MODEL_NOTE,))

    def _cold(self, reason: Reason) -> tuple[Estimate, ...]:
        self._warm = None
        return all_invalid(reason)


def _noise(fit: ModalFit, std: FloatArray) -> FloatArray:
    """Covariance of the orders' errors."""
    moved = fit.response * std
    covariance: FloatArray = (moved @ moved.conj().T).real
    return covariance


def _model(fit: ModalFit) -> FloatArray:
    """Covariance of the residual added back with its phases drawn anew order by order, sizes band by band."""
    power = np.zeros(ORDER_COUNT)
    power[FIRST_ORDER : FIRST_ORDER + len(fit.residual)] = 0.5 * np.square(np.abs(fit.residual))
    drawn = np.sqrt(band_mean(power)[FIRST_ORDER : FIRST_ORDER + len(fit.residual)])
    moved = fit.response * drawn
    covariance: FloatArray = (moved @ moved.conj().T).real
    return covariance
