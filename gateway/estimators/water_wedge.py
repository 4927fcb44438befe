"""Estimator of the motion of the leading contact edge against the trailing one, as by a wedge of water.

Water that the tread does not clear lifts the front of the contact, so that the leading edge moves toward the trailing
one, which stays (Matilainen and Tuononen, Mechanical Systems and Signal Processing 52-53 (2015) 548-559, saw contacts
shorten so on wet roads). A smaller load moves both edges alike, toward each other. The middle of the contact tells them
apart: it arrives later by half the difference of what the edges have moved. Its time is compared with that of a
rotation of steady acceleration over the revolutions before. Only a change is seen, and no drive in water has verified
this estimator.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from gateway.estimators.determination import DETERMINED
from gateway.estimators.estimator import AngleAverage, Estimate, Revolution, Status, TireConditions, not_used
from gateway.reasons import Code, Reason
from gateway.types import FloatArray

NAMES: Final = ("leading_edge_shift_rad", "trailing_edge_shift_rad", "water_wedge_rad")

# Contacts from which the next one is predicted, and degree of the polynomial in their numbers.
_WINDOW: Final = 16
_DEGREE: Final = 2
# Predictions whose scatter is the error of the next.
_SCATTER: Final = 32
_LEAST_SCATTER: Final = 8
# Share of a length change by which the trailing edge may move while the leading edge's is called a wedge.
_TRAILING_SHARE: Final = 1.0 / 3.0


class _Contact(NamedTuple):
    """Half angle of one contact, and hub time of its centre."""

    half_rad: float
    centre_s: float


class WaterWedgeEstimator:
    """Shifts of both contact edges against the contacts before, and their difference."""

    def __init__(self) -> None:
        """Start empty."""
        self._weights = _prediction_weights()
        self.reset()

    @property
    def name(self) -> str:
        """Name in the registry."""
        return "water-wedge"

    def reset(self) -> None:
        """Forget the contacts."""
        self._clear()
        self._shifts: list[tuple[float, float]] = []

    def _clear(self) -> None:
        self._contacts: list[_Contact] = []
        self._leading_rad = math.nan
        self._next = -1

    def update(
        self,
        revolution: Revolution,
        average: AngleAverage,  # noqa: ARG002 - part of the interface
        conditions: TireConditions,  # noqa: ARG002 - part of the interface
    ) -> tuple[Estimate, ...]:
        """Return the shifts of both edges into the contact, and water_wedge_rad, leading less trailing.

        All are of the contact in which this revolution begins, and never more than provisional. Never raises on values.
        """
        if revolution.faults:
            self._clear()
            return _invalid(not_used(revolution.faults))
        if not revolution.trailing_edge_rad > revolution.leading_edge_rad:
            self._clear()
            return _invalid(Reason(Code.NO_CONTACT_EDGES))
        if revolution.index != self._next:
            self._clear()
        self._next = revolution.index + 1
        # The revolution begins with the second half of a contact, whose first half the one before has measured.
        half = 0.5 * (revolution.trailing_edge_rad - self._leading_rad)
        self._leading_rad = revolution.leading_edge_rad
        if not half > 0.0:
            return _invalid(Reason(Code.NEEDS_REVOLUTIONS, needed=float(_WINDOW), count=0.0))
        made = self._shifts_of(_Contact(half, revolution.start_s), revolution.omega_radps)
        self._contacts = [*self._contacts[1 - _WINDOW :], _Contact(half, revolution.start_s)]
        return made

    def _shifts_of(self, contact: _Contact, omega_radps: float) -> tuple[Estimate, ...]:
        """Return the estimates of a contact from those before it."""
        if len(self._contacts) < _WINDOW:
            return _invalid(Reason(Code.NEEDS_REVOLUTIONS, needed=float(_WINDOW), count=float(len(self._contacts))))
        before = self._contacts
        # Relative to the last contact, so that hours of hub time lose no digits.
        since = np.array([one.centre_s - before[-1].centre_s for one in before])
        late = omega_radps * (contact.centre_s - before[-1].centre_s - float(self._weights @ since))
        shorter = float(np.mean([one.half_rad for one in before])) - contact.half_rad
        scatter = self._scatter()
        # A wedge is not part of the scatter that it is compared with.
        if scatter is None or abs(late) < DETERMINED * scatter[0]:
            self._shifts = [*self._shifts[1 - _SCATTER :], (late, shorter)]
        if scatter is None:
            needed, count = float(_WINDOW + _LEAST_SCATTER), float(_WINDOW + len(self._shifts))
            return _invalid(Reason(Code.NEEDS_REVOLUTIONS, needed=needed, count=count))
        late_std, shorter_std = scatter
        edge_std = math.hypot(late_std, shorter_std)
        leading, trailing, wedge = shorter + late, shorter - late, 2.0 * late
        notes = [Reason(Code.NOT_VERIFIED_BY_MEASUREMENT)]
        is_wedge = wedge > DETERMINED * 2.0 * late_std and leading > DETERMINED * edge_std
        if is_wedge and abs(trailing) < max(_TRAILING_SHARE * leading, DETERMINED * edge_std):
            notes.insert(0, Reason(Code.LIKE_A_WATER_WEDGE, shift_rad=leading))
        return tuple(
            Estimate(name, value, std, Status.PROVISIONAL, tuple(notes))
            for name, value, std in zip(
                NAMES, (leading, trailing, wedge), (edge_std, edge_std, 2.0 * late_std), strict=True
            )
        )

    def _scatter(self) -> tuple[float, float] | None:
        """Return the root mean squares of lateness and shortening so far; None before there are enough."""
        if len(self._shifts) < _LEAST_SCATTER:
            return None
        late, shorter = np.sqrt(np.square(self._shifts).mean(axis=0)).tolist()
        return late, shorter


def _invalid(reason: Reason) -> tuple[Estimate, ...]:
    return tuple(Estimate.invalid(name, reason) for name in NAMES)


def _prediction_weights() -> FloatArray:
    """Return (window,) weights of the times of past contacts in the time of the next: a polynomial's extrapolation."""
    numbers = np.arange(-_WINDOW, 0, dtype=np.float64)
    powers = np.vander(numbers, _DEGREE + 1, increasing=True)
    weights: FloatArray = np.linalg.pinv(powers)[0]
    return weights
