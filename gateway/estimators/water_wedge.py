"""Estimator of the motion of the leading contact edge against the trailing one, as by a wedge of water.

Water that the tread does not clear lifts the front of the contact, so that the leading edge moves toward the trailing
one, which stays; Niskanen and Tuononen (Vehicle System Dynamics 52 (sup1), 2014, 287-298) have seen such deformations
of the contact with accelerometers on the inner liner. A smaller load moves both edges alike, toward each other. To tell
them apart, the middle of the contact is compared with a rotation of steady acceleration over the contacts before. Only
a change is seen, and no drive in water has verified this estimator: that no edge moves is no sign of a dry road. On an
exact ring the pressure of water that carried 3 to 22 % of the load moved the belt's edge by at most 5 mrad.
"""

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
# Contacts over which a wedge is followed before it becomes the new reference.
_HELD: Final = 12
# Predictions whose scatter is the error of the next.
_SCATTER: Final = 32
_LEAST_SCATTER: Final = 16
# The place of an edge changes with its shape by about this, whatever the noise.
_LEAST_STD_RAD: Final = 1.5e-3
# Share by which the shape of an edge, whose place it is read from, may change a shift of it.
_SHIFT_STD: Final = 0.08
# Share of a length change by which the trailing edge may move while the leading edge's is called a wedge.
_TRAILING_SHARE: Final = 1.0 / 3.0


class _Contact(NamedTuple):
    """Half angle of one contact, and hub time of the middle between its edges."""

    half_rad: float
    middle_s: float


class WaterWedgeEstimator:
    """Shifts of both contact edges against the contacts before, and their difference."""

    name = "water-wedge"

    def __init__(self) -> None:
        """Start empty."""
        self._weights = _prediction_weights()
        self.reset()

    def reset(self) -> None:
        """Forget the contacts."""
        self._clear()
        self._shifts: list[tuple[float, float, float]] = []

    def _clear(self) -> None:
        self._clear_reference()
        self._leading_rad = math.nan
        self._next = -1

    def _clear_reference(self, *contacts: _Contact) -> None:
        self._contacts = list(contacts)
        self._held = 0

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
            self.reset()
            return _invalid(not_used(revolution.faults))
        if not revolution.trailing_edge_rad > revolution.leading_edge_rad:
            self._clear()
            return _invalid(Reason(Code.NO_CONTACT_EDGES))
        if revolution.index != self._next:
            self._clear()
        self._next = revolution.index + 1
        # The revolution begins with the second half of a contact, whose first half the one before has measured.
        leading, trailing = self._leading_rad, revolution.trailing_edge_rad
        self._leading_rad = revolution.leading_edge_rad
        # The revolution's own zero follows the template of the average, which a change of load shifts for a while.
        middle_s = revolution.start_s + 0.5 * (leading + trailing) / revolution.omega_radps
        contact = _Contact(0.5 * (trailing - leading), middle_s)
        if math.isnan(leading):
            return _invalid(Reason(Code.NEEDS_REVOLUTIONS, needed=float(_WINDOW), count=0.0))
        if len(self._contacts) < _WINDOW:
            self._contacts.append(contact)
            count = float(len(self._contacts))
            return _invalid(Reason(Code.NEEDS_REVOLUTIONS, needed=float(_WINDOW), count=count))
        return self._shifts_of(contact, revolution.omega_radps)

    def _shifts_of(self, contact: _Contact, omega_radps: float) -> tuple[Estimate, ...]:
        """Return the estimates of a contact from those before it."""
        before = np.array(self._contacts)
        # Relative to the last contact, so that hours of hub time lose no digits.
        since = before[:, 1] - before[-1, 1]
        late = omega_radps * (contact.middle_s - float(before[-1, 1]) - float(self._weights[self._held] @ since))
        shorter = float(before[:, 0].mean()) - contact.half_rad
        leading, trailing, wedge = shorter + late, shorter - late, 2.0 * late
        scatter = self._scatter()
        # A wedge belongs neither to the contacts nor to the scatter that the next contact is compared with; what lasts
        # longer than the prediction reaches becomes the new reference.
        if scatter is not None and abs(wedge) > DETERMINED * scatter[2] and self._held < _HELD:
            self._held += 1
        elif self._held:
            self._clear_reference(contact)
        else:
            self._contacts = [*self._contacts[1:], contact]
            self._shifts = [*self._shifts[1 - _SCATTER :], (leading, trailing, wedge)]
        if scatter is None:
            needed, count = float(_WINDOW + _LEAST_SCATTER), float(_WINDOW + len(self._shifts))
            return _invalid(Reason(Code.NEEDS_REVOLUTIONS, needed=needed, count=count))
        leading_std, trailing_std, wedge_std = scatter
        notes = [Reason(Code.WEDGE_HARDLY_SHOWN)]
        if (
            wedge > DETERMINED * wedge_std
            and leading > DETERMINED * leading_std
            and abs(trailing) < max(_TRAILING_SHARE * leading, DETERMINED * trailing_std)
        ):
            notes.insert(0, Reason(Code.LIKE_A_WATER_WEDGE, shift_rad=leading))
        shifts = ((leading, leading_std), (trailing, trailing_std), (wedge, wedge_std))
        return tuple(
            Estimate(name, value, math.hypot(std, _SHIFT_STD * value), Status.PROVISIONAL, tuple(notes))
            for name, (value, std) in zip(NAMES, shifts, strict=True)
        )

    def _scatter(self) -> tuple[float, float, float] | None:
        """Return the standard errors of the three shifts, from those so far; None before there are enough."""
        if len(self._shifts) < _LEAST_SCATTER:
            return None
        # A prediction that reaches further is less certain.
        first, reach = (math.sqrt(1.0 + float(self._weights[held] @ self._weights[held])) for held in (0, self._held))
        scatters = np.sqrt(np.square(self._shifts).mean(axis=0)) * (reach / first)
        leading, trailing, wedge = np.maximum(scatters, _LEAST_STD_RAD).tolist()
        return leading, trailing, wedge


def _invalid(reason: Reason) -> tuple[Estimate, ...]:
    return tuple(Estimate.invalid(name, reason) for name in NAMES)


def _prediction_weights() -> FloatArray:
    """Return (held + 1, window) weights of the times of past contacts in that of a later one, the next one first."""
    numbers = np.arange(-_WINDOW, 0, dtype=np.float64)
    inverse = np.linalg.pinv(np.vander(numbers, _DEGREE + 1, increasing=True))
    later = np.vander(np.arange(_HELD + 1, dtype=np.float64), _DEGREE + 1, increasing=True)
    weights: FloatArray = later @ inverse
    return weights
