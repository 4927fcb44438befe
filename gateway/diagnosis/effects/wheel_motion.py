"""Motion of the wheel: gravity, angular acceleration, torsional ripple, turn and camber rate."""

from typing import Final, NamedTuple

import numpy as np

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.types import FloatArray
from gateway.diagnosis.effects.belt_geometry import (
    closed_shape,
    from_mid_revolution,
    gravity_projections,
    slopes,
    spin_projections,
)
from gateway.diagnosis.effects.effect import (
    CIRCUMFERENTIAL,
    EXACT_ONLY,
    LATERAL,
    RADIAL,
    Confounder,
    LinearSignalEffect,
    ModelledBlock,
    Parameter,
    ScatterEffect,
    SignalEffect,
    Stage,
)

# Cardan joints (2), tripods (3), tire non-uniformity and brake judder (1 to 3), wheel bolts (5), motor cogging and
# gears (6, 12, 24, ..); slots of a direct drive up to 48. Every order is tried: none is found from its neighbour.
_MAX_RIPPLE_ORDER: Final = 48
_RIPPLE_START_SHARE: Final = 2e-3
# Ripple of a rolling wheel is some 0.1 %, brake judder reaches 1 %; more would be felt as shaking.
_MAX_RIPPLE: Final = 0.03


class Gravity(LinearSignalEffect):
    """Specific force of a sensor that turns with the belt in the earth's field."""

    name = "gravity"
    rank = 140
    summary = "The sensor's axes turn in the earth's field, with the belt's own angle, not the wheel's."
    equation = "radial g cos(psi), circumferential g sin(psi); psi = integral of kappa R dtheta from the contact"
    source = "specific force in the belt's frame; Eq. 27 of the ring paper leaves it out"
    parameters = (
        # It is 9.80665 m/s^2 within 0.3 % anywhere on earth; the rest of the range is for the sensor's gain and the
        # error of the model's psi.
        Parameter("gravity_share", "", 0.8, 1.2, 0.01, 1e-3, prior_mean=1.0, display_unit="of known size"),
    )
    axes = (CIRCUMFERENTIAL, RADIAL)
    observed_in = "order 1 and the orders that the contact makes of it, radial and circumferential; constant over speed"
    confounders = (
        Confounder(
            ("any error of order 1 at one speed", "belt kinematics (n^2-1)"),
            "gravity is the same at every speed and large on the circumferential axis",
        ),
        Confounder(("imbalance and hub motion",), "it makes orders 0 and 2"),
    )
    start_values = ((1.0,),)
    already_in = EXACT_ONLY
    stage = Stage.BELT

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return g times its projections."""
        row = block.zeros()
        row[[CIRCUMFERENTIAL, RADIAL]] = STANDARD_GRAVITY_MPS2 * gravity_projections(block)
        return row[np.newaxis]


class AngularAcceleration(LinearSignalEffect):
    """Wheel that speeds up or slows down steadily through a revolution.

    It needs R omega^2 although a model may lack its mean.
    """

    name = "speed drift"
    title = "angular acceleration"
    rank = 150
    summary = "The wheel's speed changes within the revolution: a sawtooth on omega^2, and the reaction to the change."
    equation = "domega/dt (2 theta' s / omega^2 + spin), theta' = angle rolled since mid revolution"
    source = "kinematics of a wheel at constant angular acceleration; Eq. 27 of the ring paper leaves it out"
    parameters = (
        # The acceleration is measured by the periods, to a few percent where it is large enough to be visible.
        Parameter("share", "", 0.8, 1.2, 0.01, 1e-3, prior_mean=1.0, display_unit="of known size"),
    )
    axes = (CIRCUMFERENTIAL, RADIAL)
    observed_in = "sine orders falling with 1/n, in proportion to the measured acceleration; the sign turns in braking"
    confounders = (
        Confounder(
            ("structural damping", "tread damping (shifted pressure)", "contact asymmetry"),
            "they make sine orders too, but without the jump at the contact, and at constant speed",
        ),
        Confounder(("AC coupling",), "it tilts the revolution likewise, whatever the acceleration"),
    )
    start_values = ((1.0,),)
    already_in = EXACT_ONLY
    stage = Stage.BELT

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return domega/dt (2 theta' shape + spin)."""
        row = block.zeros()
        if block.conditions.omega_dot_radps2:
            double_angle_rad = 2.0 * from_mid_revolution(block.theta_rad)
            circumferential, radial = spin_projections(block)
            row[CIRCUMFERENTIAL] = double_angle_rad * block.shape.circumferential_m + circumferential
            row[RADIAL] = double_angle_rad * closed_shape(block) + radial
            row *= block.conditions.omega_dot_radps2
        return row[np.newaxis]


class _Modulation(NamedTuple):
    """Cosine and sine of one order, (2, FIELD_SIZE) each: change of speed, warp of the angle, rate of change."""

    speed: FloatArray
    warp: FloatArray
    rate: FloatArray


class TorsionalRipple(SignalEffect):
    """Angular speed omega (1 + C cos(k phi) + S sin(k phi)), phi the angle that time gives at a steady speed.

    The pipeline's angle is phi: it runs evenly between two contact centres. The sensor's true angle is ahead by
    (C sin(k phi) + S (1 - cos(k phi))) / k, which is 0 at both. The tire rolls without slip, so the axle surges along.
    """

    name = "torsional ripple"
    rank = 250
    summary = "The wheel's angular speed varies periodically, a whole number of times a revolution."
    equation = (
        "(1 + u)^2 s(theta + w) - s + du/dt omega spin, u = C cos(k theta) + S sin(k theta), "
        "w = (C sin(k theta) + S (1 - cos(k theta))) / k"
    )
    source = "kinematics of rolling without slip at a varying speed"
    parameters = (
        Parameter("cosine", "", -_MAX_RIPPLE, _MAX_RIPPLE, 0.02, 1e-6, factor=100.0, display_unit="%"),
        Parameter("sine", "", -_MAX_RIPPLE, _MAX_RIPPLE, 0.02, 1e-6, factor=100.0, display_unit="%"),
        # Only whole orders repeat in every revolution.
        Parameter("order", "per revolution", 1.0, _MAX_RIPPLE_ORDER, 40.0, 1e-4, prior_mean=4.0, whole=True),
    )
    axes = (CIRCUMFERENTIAL, LATERAL, RADIAL)
    observed_in = (
        "all three axes, all around: 2 u s, contact edges warped by w, circumferential reaction; grows with omega^2"
    )
    confounders = (
        Confounder(
            ("imbalance and hub motion",), "orders 1 and 2 on the radial axis alone: the circumferential axis", "0.9"
        ),
        Confounder(("AC coupling",), similarity="0.8 on the radial axis, 0.6 with the circumferential axis"),
        Confounder(("belt extension",), "orders 1 and 2 on the radial axis alone: the circumferential axis", "0.8"),
        Confounder(("contact asymmetry",), similarity="0.6 with the circumferential axis"),
        Confounder(("run-out",), similarity="0.7 at order 1"),
        Confounder(
            ("torsional ripple of a neighbouring order",),
            "from order 4 on nothing else is alike; an axle that keeps its speed (a slipping tread) lacks the surge",
            "0.5",
        ),
    )
    start_values = tuple(
        (_RIPPLE_START_SHARE, _RIPPLE_START_SHARE, float(order)) for order in range(1, _MAX_RIPPLE_ORDER + 1)
    )
    stage = Stage.BELT

    def contribution(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the signal with ripple less the signal without; a Taylor series in the warp."""
        if not parameters[:2].any():
            return block.zeros()
        speed, warp, rate = (parameters[:2] @ part for part in _modulation(block, float(parameters[2])))
        inertial, steady, spin = _parts(block)
        result: FloatArray = np.square(1.0 + speed) * _at_warped_angle(inertial, warp) - inertial[0]
        result += _at_warped_angle(steady, warp) - steady[0]
        result += (block.conditions.omega_radps**2 * rate) * _at_warped_angle(spin, warp)
        return result

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the derivatives by both shares; the order is a whole number, which has none."""
        modulation = _modulation(block, float(parameters[2]))
        speed, warp, rate = (parameters[:2] @ part for part in modulation)
        inertial, steady, spin = _parts(block)
        square = block.conditions.omega_radps**2
        by_speed = 2.0 * (1.0 + speed) * _at_warped_angle(inertial, warp)
        by_warp = np.square(1.0 + speed) * _at_warped_angle(inertial[1:], warp) + _at_warped_angle(steady[1:], warp)
        by_warp += square * rate * _at_warped_angle(spin[1:], warp)
        by_rate = square * _at_warped_angle(spin, warp)
        rows = np.zeros((3, *block.signal_mps2.shape))
        rows[:2] = modulation.speed[:, np.newaxis] * by_speed
        rows[:2] += modulation.warp[:, np.newaxis] * by_warp
        rows[:2] += modulation.rate[:, np.newaxis] * by_rate
        return rows


def _modulation(block: ModelledBlock, fitted_order: float) -> _Modulation:
    """Return the modulation of the nearest whole order, 1 at least."""
    order = max(1, round(fitted_order))
    phase = order * block.theta_rad
    cosine, sine = np.cos(phase), np.sin(phase)
    return _Modulation(
        np.stack([cosine, sine]), np.stack([sine, 1.0 - cosine]) / order, np.stack([-order * sine, order * cosine])
    )


def _parts(block: ModelledBlock) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what goes with omega^2, what is constant and the reaction to spin, each (4, 3, FIELD_SIZE) with slopes."""
    steady, spin = block.zeros(), block.zeros()
    steady[RADIAL] = STANDARD_GRAVITY_MPS2 * block.shape.gravity_radial
    steady[CIRCUMFERENTIAL] = STANDARD_GRAVITY_MPS2 * block.shape.gravity_circumferential
    spin[CIRCUMFERENTIAL], spin[RADIAL] = spin_projections(block)
    curves = np.stack([block.signal_mps2 - steady, steady, spin])
    with_slopes = np.concatenate([curves[np.newaxis], slopes(curves, 3)])
    return with_slopes[:, 0], with_slopes[:, 1], with_slopes[:, 2]


def _at_warped_angle(curve: FloatArray, warp: FloatArray) -> FloatArray:
    """Return a curve with its slopes, (k, 3, FIELD_SIZE), at theta + warp."""
    result: FloatArray = curve[-1]
    for degree in range(len(curve) - 2, -1, -1):
        result = curve[degree] + (warp / (degree + 1)) * result
    return result


class WheelMotion(ScatterEffect):
    """Rate at which the wheel turns about an axis of the road; root mean square over revolutions."""

    source = "Eq. 5 of the ply steer paper with the rate that it drops"
    axes = (LATERAL,)

    def __init__(
        self,
        name: str,
        rank: int,
        parameter: Parameter,
        texts: tuple[str, str, str],
        confounders: tuple[Confounder, ...],
    ) -> None:
        """Declare one; `texts` are summary, equation and what is observed."""
        self.name, self.rank, self.parameters, self.confounders = name, rank, (parameter,), confounders
        self.summary, self.equation, self.observed_in = texts


TURNING_WHEEL: Final = WheelMotion(
    "turning wheel",
    410,
    # 1 g at 20 km/h.
    Parameter("turn_rate_radps", "rad/s", 0.0, 1.8, 0.2, 1e-4, varies=True),
    (
        "The wheel turns about the vertical: the belt passes the hub while the sensor's axes turn with it.",
        "lateral -2 V turn cos(theta) + V turn; removed from each revolution by its own turn",
        "single revolutions: first order of the lateral axis, with half of it and the other sign in its mean",
    ),
    (
        Confounder(("roll tilt", "ply steer"), "they are the same in all revolutions, and turns are not"),
        Confounder(("a side force that changes",), "it changes the orders above too, and not the mean"),
    ),
)
CAMBER_RATE: Final = WheelMotion(
    "camber rate",
    411,
    # 6 deg in 0.2 s.
    Parameter("camber_rate_radps", "rad/s", 0.0, 0.5, 0.05, 1e-4, varies=True),
    (
        "The wheel's camber changes, by the suspension, by steering or by the road: as a turn about the road.",
        "lateral -2 V rate sin(theta); removed from each revolution by its own rate",
        "single revolutions: first order of the lateral axis, beside that of a turn",
    ),
    (
        Confounder(("yaw tilt",), "its gravity is the same in all revolutions"),
        Confounder(("a side force that changes",), "it changes the orders above too"),
    ),
)
EFFECTS: Final = (Gravity(), AngularAcceleration(), TorsionalRipple(), TURNING_WHEEL, CAMBER_RATE)
