"""Laws of one place: a local change of belt, tread or rim, and what the rolling ring answers, inertia included."""

from __future__ import annotations

import math
from collections import OrderedDict
from typing import Final, NamedTuple

import numpy as np

from gateway.closure.effects.belt_geometry import relative_offset
from gateway.closure.effects.effect import (
    CIRCUMFERENTIAL,
    FIELD_SIZE,
    RADIAL,
    GroupConditions,
    ModelledBlock,
    Parameter,
    Stage,
)
from gateway.closure.laws.law import Law
from gateway.physics.rolling_ring import PATTERNS, Change, LoadedBelt, local_response
from gateway.types import ComplexArray, FloatArray

_PLANE: Final = [RADIAL, CIRCUMFERENTIAL]
_COUNTS: Final[FloatArray] = np.arange(PATTERNS, dtype=np.float64)
_SHARES: Final = np.where(_COUNTS > 0.0, 1.0, 0.5) / math.pi
_DEG: Final = 180.0 / math.pi
# Belts that differ by less, as a share of the radius, answer alike to some percent.
_SAME: Final = 1e-4
_KEPT: Final = 24


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


class Responses:
    """Responses of the last belts, on the model's grid: belts that hardly differ share one."""

    def __init__(self) -> None:
        """Start empty."""
        self._kept: OrderedDict[tuple[float, ...], tuple[FloatArray, ComplexArray]] = OrderedDict()

    def at(self, belt: LoadedBelt, conditions: GroupConditions, offset_m: float) -> ComplexArray:
        """Return the readings of all patterns of every kind, exp(-i N theta) included, m/s^2.

        Args:
            belt: rolling steadily.
            conditions: its speed, load and pressure.
            offset_m: sensor below the neutral layer.

        Returns:
            (kinds, PATTERNS, 2, FIELD_SIZE), radial and circumferential.
        """
        key = (
            round(math.log(conditions.omega_radps), 3),
            conditions.load_n,
            conditions.pressure_pa,
            round(offset_m, 4),
            float(len(belt.state)),
        )
        known = self._kept.get(key)
        if known is not None and np.abs(known[0] - belt.state).max() < _SAME * belt.law.radius_m:
            self._kept.move_to_end(key)
            return known[1]
        response = _on_field(local_response(belt, conditions.omega_radps, offset_m))
        response *= conditions.omega_radps**2
        self._kept[key] = belt.state.copy(), response
        self._kept.move_to_end(key)
        while len(self._kept) > _KEPT:
            self._kept.popitem(last=False)
        return response


class LocalLaw(Law):
    """A change of one kind, with the window of a normal distribution."""

    axes = (CIRCUMFERENTIAL, RADIAL)
    stage = Stage.BELT
    scaling = (
        "grows with omega^2, but for waves that the belt's own speed of bending shapes; load and pressure act through "
        "the contact"
    )

    def __init__(self, shape: LocalShape, responses: Responses) -> None:
        """Take the kind and the responses that the laws of a search share."""
        self.shape = shape
        self._row = tuple(Change).index(shape.change)
        self._responses = responses
        self.name = f"law: {shape.title}"
        self.title = shape.title
        self.summary = shape.summary
        self.equation = shape.equation
        self.source = "linearised exact ring (gateway.physics.rolling_ring.local_changes)"
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
        )  # fmt: skip
        self.start_values = ((std, 1.0, shape.width_rad),)

    def curves(self, block: ModelledBlock, places_rad: FloatArray, width_rad: float) -> FloatArray:
        """Return the reading of a unit size at every place (k,), (k, 3, FIELD_SIZE)."""
        result = np.zeros((len(places_rad), 3, FIELD_SIZE))
        response = self._response(block)
        if response is not None:
            sign = -1.0 if block.conditions.reverse else 1.0
            amplitudes = _window(width_rad) * np.exp(-1j * sign * np.outer(places_rad, _COUNTS))
            result[:, _PLANE] = (amplitudes @ response.reshape(PATTERNS, -1)).real.reshape(-1, 2, FIELD_SIZE)
        return result

    def contribution(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the size times the reading of a unit."""
        size, place, width = (float(value) for value in parameters)
        if not size:
            return block.zeros()
        result: FloatArray = size * self.curves(block, np.array([place]), width)[0]
        return result

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the derivatives by size, place and width."""
        rows = np.zeros((3, *block.signal_mps2.shape))
        response = self._response(block)
        if response is not None:
            size, place, width = (float(value) for value in parameters)
            sign = -1.0 if block.conditions.reverse else 1.0
            unit = _window(width) * np.exp(-1j * sign * place * _COUNTS)
            by = np.stack([unit, -1j * sign * size * _COUNTS * unit, -size * width * np.square(_COUNTS) * unit])
            rows[:, _PLANE] = (by @ response.reshape(PATTERNS, -1)).real.reshape(3, 2, FIELD_SIZE)
        return rows

    def _response(self, block: ModelledBlock) -> ComplexArray | None:
        if block.belt is None:
            return None
        offset_m = relative_offset(block) * block.conditions.radius_m
        response: ComplexArray = self._responses.at(block.belt, block.conditions, offset_m)[self._row]
        return response


class AxleOrder(Law):
    """Height of the axle that goes k times up and down in a turn: run-out of rim or tire of order k."""

    axes = (CIRCUMFERENTIAL, RADIAL)
    stage = Stage.BELT
    linear = True
    scaling = LocalLaw.scaling

    def __init__(self, order: int, responses: Responses) -> None:
        """Take the order and the responses that the laws of a search share."""
        self.order = order
        self._responses = responses
        self.name = f"law: axle height of order {order}"
        self.title = f"axle height of order {order}"
        self.summary = f"The axle goes up and down {order} times a turn: rim or tire is out of round by that order."
        self.equation = f"axle height + C cos({order} theta) + S sin({order} theta); the exact ring's linear answer"
        self.source = "linearised exact ring (gateway.physics.rolling_ring.local_changes)"
        self.parameters = tuple(
            Parameter(name, "m", -3e-3, 3e-3, 2e-4, 1e-7, factor=1e3, display_unit="mm") for name in ("cosine_m", "sine_m")
        )
        self.start_values = ((2e-4, 2e-4),)

    def contribution(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the sizes times their readings."""
        result: FloatArray = np.tensordot(parameters, self.derivative(block, parameters), 1)
        return result

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:  # noqa: ARG002 - linear
        """Return the readings of a cosine and a sine of 1 m."""
        rows = np.zeros((2, *block.signal_mps2.shape))
        if block.belt is not None:
            offset_m = relative_offset(block) * block.conditions.radius_m
            response = self._responses.at(block.belt, block.conditions, offset_m)[-1, self.order]
            side = -1j if block.conditions.reverse else 1j
            rows[:, _PLANE] = np.stack([response, side * response]).real
        return rows


def _window(width_rad: float) -> FloatArray:
    """Return the amplitudes of the patterns of a normal window of unit area, (PATTERNS,)."""
    result: FloatArray = _SHARES * np.exp(-0.5 * np.square(width_rad * _COUNTS))
    return result


def _on_field(response: ComplexArray) -> ComplexArray:
    """Return responses (..., PATTERNS, 2, N) on the model's grid, turned by exp(-i N theta)."""
    spectrum = np.fft.fft(response, axis=-1)
    nodes, half = response.shape[-1], min(response.shape[-1], FIELD_SIZE) // 2
    result = np.zeros((*response.shape[:-1], FIELD_SIZE), dtype=np.complex128)
    result[..., :half] = spectrum[..., :half]
    result[..., 1 - half :] = spectrum[..., 1 - half :]
    result = np.fft.ifft(result, axis=-1) * (FIELD_SIZE / nodes)
    theta = -math.pi + 2.0 * math.pi / FIELD_SIZE * np.arange(FIELD_SIZE)
    result *= np.exp(-1j * np.outer(_COUNTS, theta))[:, None]
    return result
