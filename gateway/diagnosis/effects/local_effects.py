"""Changes of belt, tread or rim at one place of the wheel, and wheel orders: what the rolling ring answers.

The answer is that of the exact ring to every pattern that passes the road a whole number of times a turn, to first
order in the change, inertia and losses included.
"""

from __future__ import annotations

import math
from copy import copy
from functools import lru_cache
from itertools import product
from typing import Final, NamedTuple, Self

import numpy as np

from gateway.core.types import ComplexArray, FloatArray
from gateway.diagnosis.effects.angle_orders import ORDERS, orders_field
from gateway.diagnosis.effects.belt_geometry import relative_offset
from gateway.diagnosis.effects.effect import (
    CIRCUMFERENTIAL,
    RADIAL,
    Confounder,
    ModelledBlock,
    Parameter,
    SignalEffect,
    Stage,
)
from gateway.ring.rolling_ring import PATTERNS, Change, LoadedBelt, Slope, local_response

_PLANE_AXES: Final = [RADIAL, CIRCUMFERENTIAL]
_COUNTS: Final[FloatArray] = np.arange(PATTERNS, dtype=np.float64)
_FOURIER_WEIGHTS: Final = np.where(_COUNTS > 0.0, 1.0, 0.5) / math.pi
_DEG: Final = 180.0 / math.pi
# Speeds that differ by less than half a percent share an answer: those within a recording differ by some permille.
LOG_SPEED_STEPS: Final = 100.0
_OFFSET_STEP_M: Final = 5e-4
# Of the Gauss-Hermite quadrature over a window's spectrum; the narrowest window that the patterns resolve; a tread that
# bears next to nothing.
_ABSCISSAS, _QUADRATURE = np.polynomial.hermite.hermgauss(24)
_QUADRATURE /= math.sqrt(math.pi)
_NARROWEST_RAD: Final = 1.0 / PATTERNS
_MIN_STIFFENING: Final = -0.95
# Damping times of belt and tread at which answers are worked out, a factor of 5 apart, and how far beyond. What the
# sidewall's damping adds is that at the usual one: it acts on waves that the rubber's hardly reaches.
_USUAL_LOSS_S: Final = 1.5e-5
_LOSS_STEP: Final = math.log(5.0)
_LOSSES_S: Final = (_USUAL_LOSS_S * math.exp(-_LOSS_STEP), _USUAL_LOSS_S, _USUAL_LOSS_S * math.exp(_LOSS_STEP))
_MAX_LOSS_STEPS: Final = 1.3
# At some hundred hertz steel cords lose a hundredth, rubber a tenth to a half; ln of the loss over the usual one.
_LOSS: Final = Parameter("log_loss", "", -2.0, 2.0, 0.8, 1e-4)
# The lowest waves are near resonance: a sidewall that loses a sixth less answers by 12 % more, and the steady shape
# does not show that loss. Tires have 2 to 8 % of the critical damping; ln of it over the usual 4 %.
_SIDEWALL_LOSS: Final = Parameter("log_sidewall_loss", "", -0.7, 0.7, 0.4, 1e-4)
# The waves that a change sends along the belt go by its mass, which the steady shape does not show: a car tire's belt
# and tread have 2.5 to 8 kg/m, a truck tire's twice that; ln of it over the baseline model's.
_MASS: Final = Parameter("log_mass", "", -0.9, 1.3, 0.5, 1e-5, shared_std=0.02)
# Between masses this far apart a cubic by answers and their slopes is right to a percent, at resonance.
_MASS_STEP: Final = 0.04
# Excess kurtosis of the window: -2 of two edges, -1.2 of a box, -0.6 of ramp, triangle and raised cosine, 0 of a normal
# one. It decides how a size follows from waves that are not much longer than the window.
_USUAL_KURTOSIS: Final = -0.6
_KURTOSIS: Final = Parameter("window_kurtosis", "", -2.0, 1.0, 0.5, 1e-4, prior_mean=_USUAL_KURTOSIS)
# With fewer nodes answers are off by 2 to 4 %.
_LEAST_NODES: Final = 480
# The first order in the change: so much differ answers to a weight and to a tenth of it. The grid leaves below 1 %.
_EQUATION_SHARE: Final = 0.05
# Share of the usual window by which places of a rig of another equation differ, at 45 to 95 km/h.
_PLACE_SHARE: Final = 0.05


class LocalShape(NamedTuple):
    """How a kind of local change is told, and how large it may be.

    Attributes:
        change: the kind.
        name: of the effect.
        rank: place in the catalogue.
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
    name: str
    rank: int
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
# A splice overlaps plies over 20 to 60 mm and may double EI there: 0.2 rad. A repair or a weight of 20 to 100 g on 5
# kg/m: 0.01 to 0.06 rad. A ply's end changes the sidewall by a quarter over 80 mm: 0.06 rad. A nail's head stands proud
# by 1 to 3 mm over 10 mm: 3e-5 to 1e-4 m rad. A rim bent by 1 mm over 150 mm: 5e-4 m rad.
_SHAPES: Final = (
    LocalShape(
        Change.BENDING, "local bending stiffness", 166, "stiffening_rad", "rad", 0.03, 0.6, _DEG, "deg of EI", 0.03,
        0.3,
        "The belt is stiffer (or softer) in bending at one place, as at a splice.",
        "EI (1 + A W(phi - phi0)), A the share times its width" + _ANSWER,
    ),
    LocalShape(
        Change.MASS, "local mass", 167, "mass_rad", "rad", 0.03, 0.6, _DEG, "deg of rho A", 0.03, 0.3,
        "The belt is heavier (or lighter) at one place, as under a repair or a balance weight.",
        "rho A (1 + A W(phi - phi0)), A the share times its width" + _ANSWER,
    ),
    LocalShape(
        Change.SIDEWALL, "local sidewall stiffness", 168, "stiffening_rad", "rad", 0.03, 0.6, _DEG, "deg of kw and kv",
        0.08, 0.5,
        "The sidewall is stiffer (or softer) at one place, as at the end of a ply.",
        "kw, kv (1 + A W(phi - phi0)), A the share times its width" + _ANSWER,
    ),
    LocalShape(
        Change.TREAD, "local tread height", 169, "height_mrad", "m rad", 2e-5, 5e-4, 1e3 * _DEG, "mm deg", 0.03, 0.3,
        "The tread is higher (or worn) at one place: a nail, a patch, a flat spot.",
        "penetration + A W(phi - phi0), A the height times its width" + _ANSWER,
    ),
    LocalShape(
        Change.RIM, "bent rim", 164, "height_mrad", "m rad", 5e-5, 2e-3, 1e3 * _DEG, "mm deg", 0.25, 0.8,
        "The axle moves as one place of the rim passes the road: the rim is bent there.",
        "axle height + A W(theta + phi0), A the height times its width" + _ANSWER,
    ),
)  # fmt: skip
_KINK: Final = LocalShape(
    Change.KINK, "local kink", 158, "kink_rad", "rad", 0.003, 0.1, _DEG, "deg", 0.03, 0.3,
    "The belt at rest has a kink at one place, beyond its circle.",
    "moment EI (kappa - (1 + A W(phi - phi0)) / R), A the angle of the kink" + _ANSWER,
)  # fmt: skip
# A block that is torn off bears nothing over 30 mm: 0.1 rad; chunks and patches of other rubber less.
_TREAD_STIFFNESS: Final = LocalShape(
    Change.TREAD_STIFFNESS, "local tread stiffness", 157, "stiffening_rad", "rad", 0.03, 0.6, _DEG, "deg of kt", 0.03,
    0.3,
    "The tread is stiffer (or softer) at one place: a torn block, a repair of other rubber.",
    "kt (1 + A W(phi - phi0)), A the share times its width" + _ANSWER,
)  # fmt: skip
_KINDS: Final = tuple(shape.change for shape in (*_SHAPES, _KINK, _TREAD_STIFFNESS))


class _BeltResponse(SignalEffect):
    """An effect whose reading is made of the belt's answers to patterns."""

    axes = (CIRCUMFERENTIAL, RADIAL)
    needs_exact = True
    jumps = True
    stage = Stage.BELT
    source = "linearised exact ring (gateway.ring.rolling_ring.local_changes)"
    scaling = (
        "grows with omega^2, but for waves that the belt's own speed of bending shapes; load and pressure act through "
        "the contact"
    )


class LocalChange(_BeltResponse):
    """A change of one kind over a window, of which two moments matter and a third may; a scan finds its place."""

    # Its place, width and kind are chosen among hundreds.
    needs_other_conditions = True
    observed_in = (
        "radial and circumferential axis, all orders, while the place passes the contact, and the waves that it sends "
        "along the belt"
    )

    _answers: dict[tuple[float, ...], tuple[Answer, ...]] | None = None

    def __init__(self, shape: LocalShape, confounders: tuple[Confounder, ...] = ()) -> None:
        """Take the kind, and what it is confused with."""
        self.shape = shape
        self.name, self.rank = shape.name, shape.rank
        self.summary, self.equation, self.confounders = shape.summary, shape.equation, confounders
        limit, std = shape.most, shape.prior_std
        self.parameters = (
            Parameter(
                shape.quantity, shape.unit, -limit, limit, std, 1e-3 * std,
                factor=shape.factor, display_unit=shape.display_unit, equation_share=_EQUATION_SHARE,
            ),
            Parameter(
                "place_rad", "rad", -3.7, 3.7, 2.5, 1e-6,
                factor=_DEG, display_unit="deg", equation_std=_PLACE_SHARE * shape.width_rad,
            ),
            # The standard deviation of the window; it acts by its square.
            Parameter(
                "width_rad", "rad", -0.02, shape.widest_rad, shape.widest_rad, 1e-6,
                prior_mean=shape.width_rad, factor=_DEG, display_unit="deg",
            ),
            _LOSS,
            _SIDEWALL_LOSS,
            _KURTOSIS,
            _MASS,
        )  # fmt: skip
        self.start_values = ((std, 1.0, shape.width_rad, 0.0, 0.0, _USUAL_KURTOSIS, 0.0),)

    def held(self) -> Self:
        """Return the effect for one fit, with the answer of the first belt that it meets under a group's conditions.

        A fit that moves the tire's parameters by some percent moves the answer by as much of itself. Held, it does not
        jump as the contact's edges pass nodes, and is worked out once.
        """
        effect = copy(self)
        effect._answers = {}
        return effect

    def unit_orders(
        self, block: ModelledBlock, places_rad: FloatArray, width_rad: float, log_mass: float
    ) -> ComplexArray:
        """Return the reading of a small unit at every place (k,), usual losses and form, (k, 3, ORDERS), m/s^2."""
        amplitudes = _window(width_rad, _USUAL_KURTOSIS)[0] * np.exp(-1j * np.outer(places_rad, _COUNTS))
        return self._orders(block, amplitudes, _loss_weights(0.0)[0], None, (_Weights(log_mass, 1.0, 0.0),))

    def contribution(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the size times the reading of a unit."""
        size, angle_rad, width, loss, sidewall_loss, kurtosis, mass = (float(value) for value in parameters)
        if not size:
            return block.zeros()
        unit = _window(width, kurtosis)[0] * np.exp(-1j * angle_rad * _COUNTS)
        amplitude = self.amplitude(block, size, width)[0]
        weights = _loss_weights(loss)[0], _damping_weights(sidewall_loss)[0], _mass_weights(mass)[0]
        orders = self._orders(block, amplitude * unit[None], *weights)
        result: FloatArray = orders_field(orders)[0]
        return result

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the derivatives by size, place, width, losses, form and mass."""
        size, angle_rad, width, loss, sidewall_loss, kurtosis, mass = (float(value) for value in parameters)
        window_terms = _window(width, kurtosis) * np.exp(-1j * angle_rad * _COUNTS)
        unit, unit_by_width, unit_by_kurtosis = window_terms
        amplitude, by_size, by_width = self.amplitude(block, size, width)
        by_place = -1j * amplitude * _COUNTS * unit
        terms = (by_size * unit, by_place, by_width * unit + amplitude * unit_by_width, amplitude * unit_by_kurtosis)
        (losses, by_loss), (damping, by_damping) = _loss_weights(loss), _damping_weights(sidewall_loss)
        masses, by_mass = _mass_weights(mass)
        zeros = np.zeros_like(damping)
        rows = self._orders(block, np.stack(terms), losses, damping, masses)
        weights = (by_loss, zeros, masses), (np.zeros_like(losses), by_damping, masses), (losses, damping, by_mass)
        *loss_rows, mass_row = (self._orders(block, amplitude * unit[None], *weight_set) for weight_set in weights)
        return orders_field(np.concatenate([rows[:3], *loss_rows, rows[3:], mass_row]))

    def amplitude(self, block: ModelledBlock, size: float, width_rad: float) -> tuple[float, float, float]:
        """Return the amplitude of the linear answer that a size has, and its derivatives by size and width."""
        return size, 1.0, 0.0

    def _orders(
        self,
        block: ModelledBlock,
        amplitudes: ComplexArray,
        loss_weights: FloatArray,
        damping_weights: FloatArray | None,
        mass_weights: tuple[_Weights, ...],
    ) -> ComplexArray:
        """Return the readings of patterns of some amplitudes, m/s^2.

        Args:
            block: with the belt; one without reads nothing.
            amplitudes: (k, PATTERNS).
            loss_weights: weights of the answers at each loss.
            damping_weights: weights (2,) of what the sidewall's damping adds to that at the usual loss; None in a scan,
                which needs all kinds of change and only the first of each answer's terms.
            mass_weights: weights of the answers at masses of the belt.

        Returns:
            (k, 3, ORDERS).
        """
        result = np.zeros((len(amplitudes), 3, ORDERS), dtype=np.complex128)
        if block.belt is None:
            return result
        conditions = block.conditions
        if conditions.reverse:
            # The pattern is the mirror image.
            amplitudes = amplitudes.conj()
        reading = np.zeros((len(amplitudes), 2 * ORDERS), dtype=np.complex128)
        for (weight, loss_s), (log_mass, value, slope) in product(
            zip(loss_weights.tolist(), _LOSSES_S, strict=True), mass_weights
        ):
            damping = [] if damping_weights is None or loss_s != _USUAL_LOSS_S else (value * damping_weights).tolist()
            factors = (weight * value, *damping, weight * slope)
            if any(factors):
                answers = self._answer(block, block.belt, loss_s, log_mass, scanned=damping_weights is None)
                for factor, (ahead, behind) in zip(factors, answers, strict=False):
                    if factor:
                        reading += factor * (amplitudes @ ahead + amplitudes.conj() @ behind)
        reading *= conditions.omega_radps**2
        result[:, _PLANE_AXES] = reading.reshape(-1, 2, ORDERS)
        return result

    def _answer(
        self, block: ModelledBlock, belt: LoadedBelt, loss_s: float, log_mass: float, *, scanned: bool
    ) -> tuple[Answer, ...]:
        conditions, change = block.conditions, self.shape.change
        log_speed = round(LOG_SPEED_STEPS * math.log(conditions.omega_radps))
        # The time tells the group: another one of equal conditions may have another contact, radius or sensor depth.
        key = log_speed, log_mass, conditions.load_n, conditions.pressure_pa, loss_s, conditions.time_s
        if self._answers is not None and not scanned and key in self._answers:
            return self._answers[key]
        answer = _answers(
            belt,
            math.exp(log_speed / LOG_SPEED_STEPS),
            relative_offset(block) * conditions.radius_m,
            loss_s,
            _KINDS if scanned else (change,),
            log_mass,
            scanned,
        )[change]
        if self._answers is not None and not scanned:
            self._answers[key] = answer
        return answer


class LocalTreadStiffness(LocalChange):
    """A finite change of the tread's stiffness: a softer block is pressed further, by what the belt gives way.

    Under a push of the wave number q the belt gives way by 1 / (kw + T q^2 + EI q^4), beside the tread's 1 / kt. So the
    share s of a window acts as s / (1 + g s), g the mean of kt / (kt + kw + T q^2 + EI q^4) over the window's spectrum.
    """

    def amplitude(self, block: ModelledBlock, size: float, width_rad: float) -> tuple[float, float, float]:
        """Return the amplitude of the linear answer that a size has, and its derivatives by size and width."""
        if block.belt is None:
            return super().amplitude(block, size, width_rad)
        law, width = block.belt.law, math.hypot(width_rad, _NARROWEST_RAD)
        square = np.square(_ABSCISSAS / (width * law.radius_m))
        tension_n = law.pressure_pa * law.tension_width_m * law.radius_m
        stiffness_ratios = np.stack([np.ones_like(square), square, np.square(square)]) / law.tread_npm2
        stiffness_ratios *= np.array([law.radial_npm2, tension_n, law.bending_nm2])[:, None]
        share_of_tread = 1.0 / (1.0 + stiffness_ratios.sum(axis=0))
        tread = float(_QUADRATURE @ share_of_tread)
        tread_by_width = float(_QUADRATURE @ (np.square(share_of_tread) * ([0.0, 2.0, 4.0] @ stiffness_ratios))) / width
        # Mean over the window, as its spectrum weights it: of a box its own share.
        share = size / (2.0 * math.sqrt(math.pi) * width)
        if share < _MIN_STIFFENING:
            return size / (1.0 + tread * _MIN_STIFFENING), 1.0 / (1.0 + tread * _MIN_STIFFENING), 0.0
        factor = 1.0 / (1.0 + tread * share)
        by_width = -size * factor**2 * share * (tread_by_width - tread / width) * width_rad / width
        return size * factor, factor**2, by_width


# Share of a height by which it is off where the belt's mass, here that of the baseline model, is a third more or less:
# at 90 km/h, where the order is nearer to the ring's own resonance the higher it is.
_BY_MASS: Final = {2: 0.1, 3: 0.35, 4: 0.6}


class WheelOrder(_BeltResponse):
    """Height that goes k times up and down in a turn: of the tire on the road, or of the axle."""

    sizes = 2
    linear = True
    observed_in = "radial axis, the shape away from the contact and its edges: the load on the contact varies k times"

    def __init__(self, name: str, rank: int, order: int, change: Change, confounders: tuple[Confounder, ...]) -> None:
        """Take name, place in the catalogue, order, kind and what it is confused with."""
        self.name, self.rank, self.order, self.change, self.confounders = name, rank, order, change, confounders
        if change is Change.RUN_OUT:
            self.summary = f"The tire's radius varies {order} times a revolution; the axle keeps its height."
            self.equation = (
                f"the ring pressed to the road by x cos({order} theta) + y sin({order} theta), its linear answer; "
                "the sensor's own radius R + x"
            )
        else:
            self.summary = f"The axle goes up and down {order} times a turn: rim or tire is out of round by that order."
            self.equation = f"axle height + x cos({order} theta) + y sin({order} theta); the exact ring's linear answer"
        # As the first harmonic: 0.3 mm is usual, an oval rim or a flat spot from parking gives 3 mm.
        self.parameters = tuple(
            Parameter(
                f"{part}_m", "m", -3e-3, 3e-3, 2e-4, 1e-6, factor=1e3, display_unit="mm", equation_share=_BY_MASS[order]
            )
            for part in ("cosine", "sine")
        )
        self.start_values = ((2e-4, 2e-4),)

    def contribution(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the heights times their readings."""
        if not parameters.any():
            return block.zeros()
        result: FloatArray = np.tensordot(parameters, self.derivative(block, parameters), 1)
        return result

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the derivatives by cosine and sine."""
        rows = np.zeros((2, *block.signal_mps2.shape))
        if block.belt is None:
            return rows
        conditions, square = block.conditions, block.conditions.omega_radps**2
        offset_m = _OFFSET_STEP_M * round(relative_offset(block) * conditions.radius_m / _OFFSET_STEP_M)
        ahead, behind = _of_order(block.belt, conditions.omega_radps, offset_m, self.change, self.order)
        # A pattern of amplitude a is a height of Re(a exp(-i k theta)).
        for row, amplitude in zip(rows, (1.0, -1j if conditions.reverse else 1j), strict=True):
            orders = square * (amplitude * ahead + np.conj(amplitude) * behind)
            row[_PLANE_AXES] = orders_field(orders.reshape(2, ORDERS))
        if self.change is Change.RUN_OUT:
            rows[0, RADIAL] += square / conditions.radius_m * block.shape.radial_m
        return rows


class _Weights(NamedTuple):
    """Weights of an answer at a mass, and of its slope by the mass's logarithm."""

    log_mass: float
    value: float
    slope: float


class Answer(NamedTuple):
    """Orders of the readings of patterns over omega^2, m.

    Of an amplitude a, order n is a ahead_n + conj(a) behind_n. Each (patterns, 2 * ORDERS), radial, then
    circumferential.
    """

    ahead: ComplexArray
    behind: ComplexArray


@lru_cache(maxsize=12)
def _answers(
    belt: LoadedBelt,
    omega_radps: float,
    offset_m: float,
    loss_s: float,
    kinds: tuple[Change, ...],
    log_mass: float,
    scanned: bool,
) -> dict[Change, tuple[Answer, ...]]:
    """Return the answers of a belt to kinds of change, which share a factorisation; all terms but in a scan."""
    slopes = Slope.NONE if scanned else Slope.MASS
    if not scanned and loss_s == _USUAL_LOSS_S:
        slopes |= Slope.DAMPING
    answers = local_response(_coarser(belt), omega_radps, loss_s, offset_m, kinds, slopes=slopes, log_mass=log_mass)
    return {
        kind: tuple(_orders(term[number], range(PATTERNS)) for term in answers) for number, kind in enumerate(kinds)
    }


@lru_cache(maxsize=16)
def _coarser(belt: LoadedBelt) -> LoadedBelt:
    """Return a belt of half of the nodes, which answers as the whole one to 1 %."""
    return belt.coarser() if len(belt.state) >= 2 * _LEAST_NODES else belt


@lru_cache(maxsize=64)
def _of_order(belt: LoadedBelt, omega_radps: float, offset_m: float, change: Change, order: int) -> Answer:
    answer = local_response(belt, omega_radps, _USUAL_LOSS_S, offset_m, (change,), (order,))[0, 0]
    return Answer(*(part[0] for part in _orders(answer, (order,))))


def _window(width_rad: float, kurtosis: float) -> FloatArray:
    """Return the patterns' amplitudes of a window of unit area, and their derivatives by width and form, (3, PATTERNS).

    Edgeworth's series to the fourth cumulant: with x = N width, exp(-x^2 / 2) (1 + kurtosis x^4 / 24).

    Args:
        width_rad: standard deviation of the window.
        kurtosis: excess of it, 0 of a normal window.
    """
    x, bounded = width_rad * _COUNTS, min(max(kurtosis, _KURTOSIS.low), _KURTOSIS.high)
    normal, fourth = _FOURIER_WEIGHTS * np.exp(-0.5 * np.square(x)), x**4 / 24.0
    by_x = bounded * x**3 / 6.0 - x * (1.0 + bounded * fourth)
    by_kurtosis = normal * fourth * (bounded == kurtosis)
    return np.stack([normal * (1.0 + bounded * fourth), normal * _COUNTS * by_x, by_kurtosis])


def _loss_weights(log_loss: float) -> tuple[FloatArray, FloatArray]:
    """Return the weights of the answers at a loss and their derivatives, (losses,) each: a parabola in its logarithm.

    Args:
        log_loss: logarithm of the loss over the usual one.
    """
    x = min(max(log_loss / _LOSS_STEP, -_MAX_LOSS_STEPS), _MAX_LOSS_STEPS)
    weights = np.array([0.5 * x * (x - 1.0), 1.0 - x * x, 0.5 * x * (x + 1.0)])
    slopes = np.array([x - 0.5, -2.0 * x, x + 0.5]) / _LOSS_STEP
    return weights, slopes * (abs(log_loss) < _MAX_LOSS_STEPS * _LOSS_STEP)


def _mass_weights(log_mass: float) -> tuple[tuple[_Weights, _Weights], tuple[_Weights, _Weights]]:
    """Return the weights of the answers at the next masses, and the derivatives of these weights: a cubic."""
    step = math.floor(log_mass / _MASS_STEP)
    t = log_mass / _MASS_STEP - step
    below, above = _MASS_STEP * step, _MASS_STEP * (step + 1)
    value, slope = t * t * (3.0 - 2.0 * t), 6.0 * t * (1.0 - t) / _MASS_STEP
    weights = (
        _Weights(below, 1.0 - value, _MASS_STEP * t * (1.0 - t) ** 2),
        _Weights(above, value, _MASS_STEP * t * t * (t - 1.0)),
    )
    return weights, (_Weights(below, -slope, (1.0 - t) * (1.0 - 3.0 * t)), _Weights(above, slope, t * (3.0 * t - 2.0)))


def _damping_weights(log_sidewall_loss: float) -> tuple[FloatArray, FloatArray]:
    """Return the weights of what the sidewall's damping adds to a response, and their derivatives, (2,) each.

    Args:
        log_sidewall_loss: logarithm of the damping over the usual one.
    """
    inverse = math.exp(-log_sidewall_loss)
    z = inverse - 1.0
    return np.array([z, z * z]), -inverse * np.array([1.0, 2.0 * z])


def _orders(response: ComplexArray, counts: range | tuple[int, ...]) -> Answer:
    """Return a response (k, 2, N) of patterns, turned by exp(-i N theta), as its orders ahead and behind."""
    nodes = response.shape[-1]
    spectrum = np.fft.fft(response, axis=-1) / nodes
    spectrum[..., 1::2] *= -1.0
    parts: list[ComplexArray] = []
    for sign in (1, -1):
        places = (sign * np.arange(ORDERS) + np.array(counts)[:, None]) % nodes
        part = np.take_along_axis(spectrum, places[:, None, :], axis=-1)
        part[..., 0] *= 0.5
        parts.append(np.ascontiguousarray(part.reshape(len(counts), -1)))
    return Answer(parts[0], np.conj(parts[1]))


def _other_kinds(name: str) -> tuple[Confounder, ...]:
    names = tuple(shape.name for shape in _SHAPES if shape.name != name)
    return (Confounder(names, "the waves beside the contact, two speeds and two loads"),)


LOCAL_KINK: Final = LocalChange(_KINK, _other_kinds(_KINK.name))
LOCAL_TREAD_STIFFNESS: Final = LocalTreadStiffness(_TREAD_STIFFNESS, _other_kinds(_TREAD_STIFFNESS.name))
LOCAL_CHANGES: Final = tuple(LocalChange(shape, _other_kinds(shape.name)) for shape in _SHAPES)
RUN_OUT_OF_ORDER_2: Final = WheelOrder(
    "run-out of order 2",
    163,
    2,
    Change.RUN_OUT,
    (
        Confounder(("torsional ripple",), "the circumferential axis, all around"),
        Confounder(("imbalance and hub motion",), "it grows with the hub's acceleration: two speeds"),
        Confounder(("gain", "rolling radius"), "of the part at the sensor: a second sensor a quarter of a turn away"),
    ),
)
AXLE_ORDERS: Final = tuple(
    WheelOrder(
        f"axle height of order {order}",
        rank,
        order,
        Change.RIM,
        (Confounder(("torsional ripple",), "the circumferential axis, all around"),),
    )
    for order, rank in ((2, 161), (3, 162), (4, 159))
)
EFFECTS: Final = (*LOCAL_CHANGES, LOCAL_KINK, LOCAL_TREAD_STIFFNESS, RUN_OUT_OF_ORDER_2, *AXLE_ORDERS)
