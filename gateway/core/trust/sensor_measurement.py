"""What the signal of a sensor says of the sensor itself, after each revolution of a self-calibration."""

import math
from typing import Final, NamedTuple, Self

from gateway.core.estimates.estimator import Estimate
from gateway.core.estimates.sensor_claims import Tilt
from gateway.core.reasons import Reason
from gateway.core.revolutions.axis_relations import AxisRelations
from gateway.core.revolutions.sensor_mounting import MOUNTING_SIZE
from gateway.core.trust.refuted_sums import Equations
from gateway.core.types import FloatArray

# Share of gravity below which an axis is not along the belt, and the standard errors by which it must be: a yaw of 45
# deg leaves 0.7.
_MIN_GRAVITY_SHARE: Final = 0.5
_CERTAIN_ERRORS: Final = 3.0
# Places in the running sums: equations of the mounting, of the means, of gravity, then normal matrix and right-hand
# side of G, z, G' and a, and what a relative error of the steady value adds to the right-hand side.
MOUNTING: Final = slice(0, MOUNTING_SIZE)
MEAN: Final = slice(MOUNTING_SIZE, MOUNTING_SIZE + 5)
GRAVITY: Final = slice(MOUNTING_SIZE + 5, MOUNTING_SIZE + 10)
MATRIX: Final = slice(MOUNTING_SIZE + 10, MOUNTING_SIZE + 26)
RIGHT: Final = slice(MOUNTING_SIZE + 26, MOUNTING_SIZE + 30)
STEADY: Final = slice(MOUNTING_SIZE + 30, MOUNTING_SIZE + 34)
SUMS: Final = MOUNTING_SIZE + 34


class Measurement(NamedTuple):
    """A measured value and its standard error."""

    value: float
    std: float


class AlongGravity(NamedTuple):
    """Gravity that the circumferential axis shows.

    Attributes:
        share: of g; negative for an axis that points against the rolling direction.
        std: its standard error.
    """

    share: float
    std: float

    @classmethod
    def of_squares(cls, ahead: float, back: float, without: float, count: float) -> Self | None:
        """Return it by the squares of `count` equations that gravity ahead, gravity back and none leave.

        They are a parabola in the share of gravity.
        """
        curvature = 0.5 * (ahead + back) - without
        if not curvature > 0.0:
            return None
        share = (back - ahead) / (4.0 * curvature)
        residual = max(without - curvature * share**2, 0.0)
        return cls(share, math.sqrt(residual / max(count, 1.0) / curvature))

    @property
    def is_absent(self) -> bool:
        """Whether the axis cannot be the one along the belt."""
        return abs(self.share) + _CERTAIN_ERRORS * self.std < _MIN_GRAVITY_SHARE


class Measured(NamedTuple):
    """Quantities of the sensor that its own signal gives, for comparison with what is stated.

    Attributes:
        revolutions: used so far.
        ac_coupled: whether the sensor passes no steady value.
        rate_hz: sampling rate in use.
        steady_mps2: latest mean of the radial axis that a perfect sensor would read on a belt of the stated radius.
        mean_square: mean square of kappa R.
        by_mean: of the relative error of the steady value and of the zero-g offset in m/s^2, from the means of the
            revolutions.
        by_gravity: of the relative error of the gain, and of belt stretch as order 1 of R Omega^2, from gravity in
            order 1.
        contact_gain: gain of an AC-coupled sensor and its standard error, from the depth of the contact; None without.
        offset_m: sensor below the neutral layer and its standard error; None without a circumferential axis.
        along_gravity: gravity that the circumferential axis shows; None where nothing tells.
        hub_mps2: order 2 of the circumferential axis that the belt does not explain; 0 without that axis.
        relations: of the axes with each other.
        roll_by_mean_rad: of the averaged axes; NaN without a lateral axis.
        tilt: how the sensor sits askew.
    """

    revolutions: int
    ac_coupled: bool
    rate_hz: float
    steady_mps2: float
    mean_square: float
    by_mean: Equations
    by_gravity: Equations
    contact_gain: tuple[float, float] | None
    offset_m: tuple[float, float] | None
    along_gravity: AlongGravity | None = None
    hub_mps2: float = 0.0
    relations: AxisRelations = AxisRelations()
    roll_by_mean_rad: float = math.nan
    tilt: Tilt = Tilt()


class CalibrationStep(NamedTuple):
    """State of a self-calibration after one revolution.

    Attributes:
        refused: why it was not used; None when it was.
        revolutions: used so far.
        sums: (SUMS,) running sums.
        pitch: None without a circumferential axis.
        offset: likewise.
        warm: temperature above that of the first revolution, K.
        floor: gain of an AC-coupled sensor from the contact; None before the first.
        measured: for the evidence; None before the first revolution.
        against: whether the circumferential axis points against the rolling direction.
        has_along: whether there is a circumferential axis that moves.
    """

    refused: Reason | None
    revolutions: int
    sums: FloatArray
    pitch: Measurement | None
    offset: Measurement | None
    warm: float
    floor: Estimate | None
    measured: Measured | None
    against: bool = False
    has_along: bool = False
