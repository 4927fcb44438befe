"""Laws of one place: a local change of belt, tread or rim, and what the rolling ring answers, inertia included."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from gateway.closure.data.campaign_data import ORDERS
from gateway.closure.effects.belt_geometry import relative_offset
from gateway.closure.effects.effect import (
    CIRCUMFERENTIAL,
    RADIAL,
    GroupConditions,
    ModelledBlock,
    Parameter,
    Stage,
)
from gateway.closure.laws.law import Law
from gateway.closure.model.sensor_signal import orders_field
from gateway.physics.rolling_ring import PATTERNS, Change, LoadedBelt, local_response
from gateway.types import ComplexArray, FloatArray

_PLANE: Final = [RADIAL, CIRCUMFERENTIAL]
_COUNTS: Final[FloatArray] = np.arange(PATTERNS, dtype=np.float64)
_SHARES: Final = np.where(_COUNTS > 0.0, 1.0, 0.5) / math.pi
_DEG: Final = 180.0 / math.pi
# Speeds that differ by less than half a percent share a response.
_PER_SPEED: Final = 100.0
# Damping times of belt and tread at which responses are worked out, a factor of 3.2 apart, and how far beyond.
_USUAL_LOSS_S: Final = 3e-5
_LOSS_STEP: Final = 0.5 * math.log(10.0)
_LOSSES_S: Final = tuple(_USUAL_LOSS_S * math.exp(step * _LOSS_STEP) for step in (-1.0, 0.0, 1.0))
_BEYOND: Final = 1.3
# Rubber loses a tenth to a half at some hundred hertz; ln of the loss over the usual one.
_LOSS: Final = Parameter("log_loss", "", -1.5, 1.5, 0.6, 1e-4)


class LocalShape(NamedTuple):
    """How a kind of local change is told, and how large it may be.

    Attributes:
        change: the kind.
        title: of the law.
        quantity: name of its size, unit included.
        unit: of the size.
        prior_std: of the size.
        most: of the size.
        factor: from SI to `display_unit`.
        display_unit: of the size in tables.
        width_rad: usual standard deviation of its window.
        widest_rad: largest one.
        summary: reading in words.
        equation: in plain text.
    """

    change: Change
    title: str
    quantity: str
    unit: str
    prior_std: float
    most: float
    factor: float
    display_unit: str
    width_rad: float
    widest_rad: float
    summary: str
    equation: str


_ANSWER: Final = "; the exact ring's linear answer at every multiple of the wheel's frequency, inertia and losses in"
SHAPES: Final = (
    LocalShape(
        Change.BENDING, "local bending stiffness", "stiffening_rad", "rad", 0.03, 0.6, _DEG, "deg of EI", 0.03, 0.3,
        "The belt is stiffer (or softer) in bending at one place, as at a splice.",
        "EI (1 + A W(phi - phi0)), A the share times its width" + _ANSWER,
    ),
    LocalShape(
        Change.KINK, "local kink", "kink_rad", "rad", 0.003, 0.1, _DEG, "deg", 0.03, 0.3,
        "The belt at rest has a kink at one place, beyond its circle.",
        "moment EI (kappa - (1 + A W(phi - phi0)) / R), A the angle of the kink" + _ANSWER,
    ),
    LocalShape(
        Change.MASS, "local mass", "mass_rad", "rad", 0.03, 0.6, _DEG, "deg of rho A", 0.03, 0.3,
        "The belt is heavier (or lighter) at one place, as under a repair or a balance weight.",
        "rho A (1 + A W(phi - phi0)), A the share times its width" + _ANSWER,
    ),
    LocalShape(
        Change.SIDEWALL, "local sidewall stiffness", "stiffening_rad", "rad", 0.03, 0.6, _DEG, "deg of kw and kv", 0.08,
        0.5,
        "The sidewall is stiffer (or softer) at one place, as at the end of a ply.",
        "kw, kv (1 + A W(phi - phi0)), A the share times its width" + _ANSWER,
    ),
    LocalShape(
        Change.TREAD, "local tread height", "height_mrad", "m rad", 2e-5, 5e-4, 1e3 * _DEG, "mm deg", 0.03, 0.3,
        "The tread is higher (or worn) at one place: a nail, a patch, a flat spot.",
        "penetration + A W(phi - phi0), A the height times its width" + _ANSWER,
    ),
    LocalShape(
        Change.RIM, "bent rim", "height_mrad", "m rad", 5e-5, 2e-3, 1e3 * _DEG, "mm deg", 0.25, 0.8,
        "The axle moves as one place of the rim passes the road: the rim is bent there.",
        "axle height + A W(theta + phi0), A the height times its width" + _ANSWER,
    ),
)  # fmt: skip


class Response(NamedTuple):
    """Orders of the readings of all patterns over omega^2, m.

    Of an amplitude a, order n is a ahead_n + conj(a) behind_n. Each (PATTERNS, 2 * ORDERS), radial, then
    circumferential.
    """

    ahead: ComplexArray
    behind: ComplexArray


class Responses:
    """Responses of belts, each of the first one that was seen under its conditions.

    A fit that moves the tire's parameters by some percent moves the response by as much of itself; kept, it does not
    jump as the contact's edges pass nodes. `renew` has it worked out again. A scan needs all kinds, which share a
    factorisation; a fit needs one.
    """

    def __init__(self) -> None:
        """Start empty, for a scan."""
        self._cache: dict[tuple[float, ...], dict[Change, Response]] = {}
        self._wanted = tuple(Change)

    def renew(self, change: Change) -> None:
        """Forget all responses, for a fit of one kind."""
        self._cache.clear()
        self._wanted = (change,)

    def at(
        self, belt: LoadedBelt, conditions: GroupConditions, offset_m: float, loss_s: float, change: Change
    ) -> Response:
        """Return the response of a belt to a kind of change, or of the first belt under these conditions.

        Args:
            belt: rolling steadily.
            conditions: its speed, load and pressure.
            offset_m: sensor below the neutral layer.
            loss_s: damping time of belt and tread.
            change: the kind.
        """
        # Speeds within a recording differ by some permille.
        log_speed = round(_PER_SPEED * math.log(conditions.omega_radps))
        key = log_speed, conditions.load_n, conditions.pressure_pa, float(len(belt.state)), loss_s
        responses = self._cache.setdefault(key, {})
        if change not in responses:
            wanted = self._wanted if change in self._wanted else (change,)
            omega = math.exp(log_speed / _PER_SPEED)
            answers = local_response(belt, omega, loss_s, offset_m, wanted)
            responses |= {kind: _orders(answer) for kind, answer in zip(wanted, answers, strict=True)}
        return responses[change]


class _OnBelt(Law):
    """A law whose reading is made of the responses of the belt to patterns; its last parameter is the loss."""

    axes = (CIRCUMFERENTIAL, RADIAL)
    stage = Stage.BELT
    # The grid leaves 4 %, the first order in the change and losses that are not those of the belt as much again.
    equation_share = 0.08
    source = "linearised exact ring (gateway.physics.rolling_ring.local_changes)"
    scaling = (
        "grows with omega^2, but for waves that the belt's own speed of bending shapes; load and pressure act through "
        "the contact"
    )

    def __init__(self, change: Change, responses: Responses) -> None:
        self._change = change
        self._responses = responses

    def renew(self) -> None:
        """Work out the responses again, at the belts that are seen next."""
        self._responses.renew(self._change)

    def orders(self, block: ModelledBlock, amplitudes: ComplexArray, weights: FloatArray) -> ComplexArray:
        """Return the readings of patterns of some amplitudes, m/s^2.

        Args:
            block: with the belt; one without reads nothing.
            amplitudes: (k, PATTERNS).
            weights: (losses,) of the responses.

        Returns:
            (k, 3, ORDERS).
        """
        result = np.zeros((len(amplitudes), 3, ORDERS), dtype=np.complex128)
        if block.belt is None:
            return result
        conditions = block.conditions
        offset_m = relative_offset(block) * conditions.radius_m
        if conditions.reverse:
            # The pattern is the mirror image.
            amplitudes = amplitudes.conj()
        read = np.zeros((len(amplitudes), 2 * ORDERS), dtype=np.complex128)
        for weight, loss_s in zip(weights.tolist(), _LOSSES_S, strict=True):
            if weight:
                ahead, behind = self._responses.at(block.belt, conditions, offset_m, loss_s, self._change)
                read += weight * (amplitudes @ ahead + amplitudes.conj() @ behind)
        read *= conditions.omega_radps**2
        result[:, _PLANE] = read.reshape(-1, 2, ORDERS)
        return result

    def _fields(self, block: ModelledBlock, amplitudes: ComplexArray, weights: FloatArray) -> FloatArray:
        return orders_field(self.orders(block, amplitudes, weights))


class LocalLaw(_OnBelt):
    """A change of one kind, with the window of a normal distribution."""

    def __init__(self, shape: LocalShape, responses: Responses) -> None:
        """Take the kind and the responses that the laws of a search share."""
        super().__init__(shape.change, responses)
        self.shape = shape
        self.name = f"law: {shape.title}"
        self.title = shape.title
        self.summary = shape.summary
        self.equation = shape.equation
        most, std = shape.most, shape.prior_std
        self.parameters = (
            Parameter(
                shape.quantity, shape.unit, -most, most, std, 1e-3 * std,
                factor=shape.factor, display_unit=shape.display_unit,
            ),
            Parameter("place_rad", "rad", -3.7, 3.7, 2.5, 1e-6, factor=_DEG, display_unit="deg"),
            # The standard deviation of the window.
            Parameter(
                "width_rad", "rad", -0.02, shape.widest_rad, shape.widest_rad, 1e-6,
                prior_mean=shape.width_rad, factor=_DEG, display_unit="deg",
            ),
            _LOSS,
        )  # fmt: skip
        self.start_values = ((std, 1.0, shape.width_rad, 0.0),)

    def unit_orders(self, block: ModelledBlock, places_rad: FloatArray, width_rad: float) -> ComplexArray:
        """Return the reading of a unit size at every place (k,) at the usual loss, (k, 3, ORDERS)."""
        amplitudes = _window(width_rad) * np.exp(-1j * np.outer(places_rad, _COUNTS))
        return self.orders(block, amplitudes, _between(0.0)[0])

    def contribution(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the size times the reading of a unit."""
        size, angle_rad, width, loss = (float(value) for value in parameters)
        if not size:
            return block.zeros()
        amplitude = size * _window(width) * np.exp(-1j * angle_rad * _COUNTS)
        result: FloatArray = self._fields(block, amplitude[None], _between(loss)[0])[0]
        return result

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the derivatives by size, place, width and loss."""
        size, angle_rad, width, loss = (float(value) for value in parameters)
        unit = _window(width) * np.exp(-1j * angle_rad * _COUNTS)
        by = np.stack([unit, -1j * size * _COUNTS * unit, -size * width * np.square(_COUNTS) * unit])
        weights, by_loss = _between(loss)
        return np.concatenate([self._fields(block, by, weights), self._fields(block, size * unit[None], by_loss)])


class AxleOrder(_OnBelt):
    """Height of the axle that goes k times up and down in a turn: run-out of rim or tire of order k."""

    sizes = 2

    def __init__(self, order: int, responses: Responses) -> None:
        """Take the order and the responses that the laws of a search share."""
        super().__init__(Change.RIM, responses)
        self.order = order
        self.name = f"law: axle height of order {order}"
        self.title = f"axle height of order {order}"
        self.summary = f"The axle goes up and down {order} times a turn: rim or tire is out of round by that order."
        self.equation = f"axle height + C cos({order} theta) + S sin({order} theta); the exact ring's linear answer"
        self.parameters = (
            *(
                Parameter(name, "m", -3e-3, 3e-3, 2e-4, 1e-7, factor=1e3, display_unit="mm")
                for name in ("cosine_m", "sine_m")
            ),
            _LOSS,
        )
        self.start_values = ((2e-4, 2e-4, 0.0),)

    def contribution(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the sizes times their readings."""
        if not parameters[:2].any():
            return block.zeros()
        whole, weights = self._amplitudes(parameters)[:1], _between(float(parameters[2]))[0]
        result: FloatArray = self._fields(block, whole, weights)[0]
        return result

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the derivatives by cosine, sine and loss."""
        whole, cosine, sine = self._amplitudes(parameters)
        weights, by_loss = _between(float(parameters[2]))
        return np.concatenate(
            [self._fields(block, np.stack([cosine, sine]), weights), self._fields(block, whole[None], by_loss)]
        )

    def _amplitudes(self, parameters: FloatArray) -> ComplexArray:
        """Return the amplitudes of the whole, of a cosine of 1 m and of a sine of 1 m, (3, PATTERNS)."""
        result = np.zeros((3, PATTERNS), dtype=np.complex128)
        # A pattern of amplitude a moves the axle by Re(a exp(-i k theta)).
        result[:, self.order] = complex(parameters[0], parameters[1]), 1.0, 1j
        return result


def _window(width_rad: float) -> FloatArray:
    """Return the amplitudes of the patterns of a normal window of unit area, (PATTERNS,)."""
    result: FloatArray = _SHARES * np.exp(-0.5 * np.square(width_rad * _COUNTS))
    return result


def _between(log_loss: float) -> tuple[FloatArray, FloatArray]:
    """Return the weights of the responses at a loss and their derivatives, (losses,) each: a parabola in its logarithm.

    Args:
        log_loss: logarithm of the loss over the usual one.
    """
    x = min(max(log_loss / _LOSS_STEP, -_BEYOND), _BEYOND)
    weights = np.array([0.5 * x * (x - 1.0), 1.0 - x * x, 0.5 * x * (x + 1.0)])
    slopes = np.array([x - 0.5, -2.0 * x, x + 0.5]) / _LOSS_STEP
    return weights, slopes * (abs(log_loss) < _BEYOND * _LOSS_STEP)


def _orders(response: ComplexArray) -> Response:
    """Return a response (PATTERNS, 2, N), turned by exp(-i N theta), as its orders ahead and behind."""
    nodes = response.shape[-1]
    spectrum = np.fft.fft(response, axis=-1) / nodes
    spectrum[..., 1::2] *= -1.0
    parts: list[ComplexArray] = []
    for sign in (1, -1):
        places = (sign * np.arange(ORDERS) + np.arange(PATTERNS)[:, None]) % nodes
        part = np.take_along_axis(spectrum, places[:, None, :], axis=-1)
        part[..., 0] *= 0.5
        parts.append(np.ascontiguousarray(part.reshape(PATTERNS, -1)))
    return Response(parts[0], np.conj(parts[1]))
