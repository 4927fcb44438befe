"""Turn and camber rate of single revolutions: what shows them, and revolutions without them."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.core.reasons import Reason
from gateway.core.types import BoolArray, ComplexArray, FloatArray
from gateway.diagnosis.data.revolution_orders import RevolutionTable
from gateway.diagnosis.effects.effect import LATERAL, ScatterEffect
from gateway.diagnosis.effects.wheel_motion import CAMBER_RATE, TURNING_WHEEL
from gateway.diagnosis.reasons import DiagnosisCode

# Revolutions that have one rate: a curve, a lane that is kept.
_CORRELATED_REVOLUTIONS: Final = 15.0
_MIN_REVOLUTIONS: Final = 30
# Slope of the lateral mean over speed times turn: 1, but for camber and bank in curves.
_SLOPE_ERROR, _SLOPE_SIGMAS = 0.3, 3.0
# A wheel that is steered turns on its path by its slip angle, which grows with the lateral acceleration: the path
# follows the wheel with the speed times slip over acceleration as time constant, s.
_PATH_LAGS_S: Final = (0.0, 0.03, 0.06, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6)
# A tire's own share of the first order by side force is known within half of it: so much of a turn looks like camber.
_CAMBER_OVER_TURN: Final = 0.5
# Suspensions, with roll of the body; wheels of motorcycles lean more, and their tires are round.
_MAX_CAMBER_RAD: Final = math.radians(12.0)


@dataclass(frozen=True, slots=True)
class WheelRate:
    """A rate of the wheel in one recording.

    Attributes:
        effect: turning wheel or camber rate.
        rms_radps: over revolutions, without the noise of single ones; std_radps: its standard error.
        log_evidence: of the rate, over that of none.
        rms_mps2: what it makes of the lateral axis.
        before_mps2: rms of what shows it in the lateral axis, about what all revolutions have: of a turn the mean, as
            side force opposes it in the first order; of a camber rate the sine of that.
        after_mps2: without the rate.
        objection: why it is no such rate; None if it may be.
        shown: whether the recording shows it, and its revolutions are without it.
    """

    effect: ScatterEffect
    rms_radps: float
    std_radps: float
    log_evidence: float
    rms_mps2: float
    before_mps2: float
    after_mps2: float
    objection: Reason | None
    shown: bool


def without_rates(
    table: RevolutionTable, radius_m: float, *, ac_coupled: bool, least_evidence: float
) -> tuple[WheelRate, ...]:
    """Return the rates of a recording; those that it shows are removed from its revolutions.

    Args:
        table: in time order; changed.
        radius_m: of the belt.
        ac_coupled: whether the lateral axis has no mean.
        least_evidence: logarithm from which a recording shows a rate.
    """
    finite = np.isfinite(table["turn_shared_radps"] + table["camber_shared_radps"])
    finite &= np.isfinite(table.orders_mps2[:, LATERAL, :2]).all(axis=1)
    if finite.sum() < _MIN_REVOLUTIONS:
        return ()
    speed = table["omega_radps"] * radius_m
    rates: list[WheelRate] = []
    for effect, name, number in ((TURNING_WHEEL, "turn", 0), (CAMBER_RATE, "camber", 1)):
        rate = np.where(finite, table[f"{name}_radps"], 0.0)
        square = max(float(np.mean(rate[finite] ** 2)) - _noise_square(rate[finite]), 1e-300)
        error = _error(*(table[f"{name}_{part}radps"][finite] for part in ("", "shared_", "scatter_")))
        # Mean and first order, c - i s.
        orders = np.zeros((len(table), 2), np.complex128)
        if effect is TURNING_WHEEL:
            evidence, objection, orders[:, 0] = _turn_evidence(table, speed * rate, finite, ac_coupled)
            orders[:, 1] = -2.0 * speed * rate
        else:
            evidence, objection = _camber_evidence(table, rate, finite, square / error**2)
            if math.sqrt(square) < _CAMBER_OVER_TURN * rates[0].rms_radps:
                objection = Reason(DiagnosisCode.CAMBER_BESIDE_TURN, turn_radps=rates[0].rms_radps)
            orders[:, 1] = 2.0j * speed * rate
        lateral = table.orders_mps2[:, LATERAL, :2].astype(np.complex128)
        size = math.sqrt(float(np.mean(np.abs(orders[:, 0]) ** 2 + 0.5 * np.abs(orders[:, 1]) ** 2)))
        is_shown = objection is None and evidence >= least_evidence
        spread, residual = (_deviation(table, values, finite, number) for values in (lateral, lateral - orders))
        rates.append(WheelRate(effect, math.sqrt(square), error, evidence, size, spread, residual, objection, is_shown))
        if is_shown:
            table.orders_mps2[:, LATERAL, :2] = lateral - orders
            for row, waveform in table.waveforms_mps2.items():
                angle = 2.0 * math.pi / waveform.shape[-1] * np.arange(waveform.shape[-1]) - math.pi
                waveform[LATERAL] -= (orders[row, 0] + orders[row, 1] * np.exp(1j * angle)).real
    return tuple(rates)


def _noise_square(rate_radps: FloatArray) -> float:
    """Return the mean square of errors that no two revolutions share, by how far each rate is from its neighbours."""
    return float(np.mean(np.square(np.diff(rate_radps, 2)))) / 6.0


def _deviation(table: RevolutionTable, orders: ComplexArray, finite: BoolArray, number: int) -> float:
    """Return the rms of mean or first sine of the lateral axis about what goes with the square of the speed."""
    square, order = np.square(table["omega_radps"][finite]), orders[finite, number]
    value = math.sqrt(0.5) * order.imag if number else order.real
    value = value - square * (float(square @ value) / float(square @ square))
    return math.sqrt(float(np.mean(np.square(value))))


def _turn_evidence(
    table: RevolutionTable, turn_mps2: FloatArray, finite: BoolArray, ac_coupled: bool
) -> tuple[float, Reason | None, FloatArray]:
    """Return the evidence of a turn by the mean of the lateral axis, and what of the mean is the path's."""
    if ac_coupled:
        return 0.0, None, turn_mps2
    mean = table.orders_mps2[finite, LATERAL, 0].real.astype(np.float64)
    mean -= mean.mean()
    base = max(float(mean @ mean), 1e-300)
    paths = [_lagged(turn_mps2, table["index"], table["period_s"], lag_s) for lag_s in _PATH_LAGS_S]
    evidences = []
    for path in paths:
        error = mean - (path[finite] - path[finite].mean())
        evidences.append(0.5 * len(mean) / _CORRELATED_REVOLUTIONS * math.log(base / max(float(error @ error), 1e-300)))
    # All lags are as likely before the data.
    evidence = float(np.logaddexp.reduce(evidences)) - math.log(len(paths))
    path_mps2 = paths[int(np.argmax(evidences))]
    path = path_mps2[finite] - path_mps2[finite].mean()
    power = max(float(path @ path), 1e-300)
    slope = float(path @ mean) / power
    std = math.sqrt(float(np.sum((mean - slope * path) ** 2)) * _CORRELATED_REVOLUTIONS / len(path) / power)
    objection = None
    if abs(slope - 1.0) > _SLOPE_ERROR + _SLOPE_SIGMAS * std:
        objection = Reason(DiagnosisCode.TURN_WITHOUT_ACCELERATION, slope=slope, std=std)
    elif not table["turn_valid"][finite].any():
        objection = Reason(DiagnosisCode.STRAIGHTS_NOT_SEEN)
    return evidence, objection, path_mps2


def _lagged(turn_mps2: FloatArray, index: FloatArray, period_s: FloatArray, lag_s: float) -> FloatArray:
    """Return the lateral acceleration of a path that follows a turn with a time constant."""
    if not lag_s:
        return turn_mps2
    steps_s = np.diff(index, prepend=index[:1]) * period_s
    path, latest = np.empty_like(turn_mps2), float(turn_mps2[0])
    for row, decay in enumerate(np.exp(-steps_s / lag_s).tolist()):
        latest += (1.0 - decay) * (float(turn_mps2[row]) - latest)
        path[row] = latest
    return path


def _error(rate_radps: FloatArray, shared_radps: FloatArray, scatter_radps: FloatArray) -> float:
    """Return the error of a root mean square; what revolutions share does not become smaller by their number."""
    weights = np.square(rate_radps) + 1e-300
    shared, scatter = (
        math.sqrt(float(np.average(np.square(x), weights=weights))) for x in (shared_radps, scatter_radps)
    )
    return math.hypot(shared, scatter * math.sqrt(min(_CORRELATED_REVOLUTIONS / len(rate_radps), 1.0)))


def _camber_evidence(
    table: RevolutionTable, rate: FloatArray, finite: BoolArray, ratio: float
) -> tuple[float, Reason | None]:
    """Return the evidence of a camber rate by the square of its size over its error; camber stays within bounds."""
    evidence = 0.5 * (ratio - 1.0 - math.log(ratio)) if ratio > 1.0 else 0.0
    largest = float(np.ptp(np.cumsum(rate * table["period_s"])[finite]))
    too_large = Reason(DiagnosisCode.CAMBER_TOO_LARGE, camber_rad=largest) if largest > _MAX_CAMBER_RAD else None
    return evidence, too_large
