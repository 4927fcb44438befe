"""Scan of local changes at every place: what each would add to the evidence of what is left, to first order.

The discrepancy of the best set competes. Were its amplitudes fitted anew, an effect that only reshapes what is left
would gain much; so one factor of all of them is profiled over instead.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Final

import numpy as np

from gateway.core.types import FloatArray
from gateway.diagnosis import criteria
from gateway.diagnosis.angle.candidate_trial import bounds
from gateway.diagnosis.angle.fit import Fit, FitFailedError, fit_model
from gateway.diagnosis.angle.likelihood import Whitened, as_real
from gateway.diagnosis.angle.set_evidence import log_evidence
from gateway.diagnosis.effects.angle_orders import ORDERS
from gateway.diagnosis.effects.local_effects import LocalChange
from gateway.diagnosis.model.baseline import NoShapeError, Shape
from gateway.diagnosis.model.closure_model import ClosureModel
from gateway.diagnosis.model.exact_baseline import coarse_core
from gateway.diagnosis.model.sensor_signal import base_signal, mounting_matrix

# Factors of the discrepancy's amplitudes.
_FACTORS: Final = (1.0, 0.1, 0.01)
# Places of the first look and the share of the usual width that they resolve; then nearer ones around the best.
_FIRST_PLACES: Final = 240
_PEAKS: Final = 2
_NEAR_RAD: Final = np.radians([-1.5, -1.2, -0.9, -0.6, -0.3, 0.0, 0.3, 0.6, 0.9, 1.2, 1.5])
_WIDTHS: Final = (0.2, 0.5, 1.0, 2.0, 4.0)
_ROWS: Final = 240
# Logarithms of the belt's mass, over the baseline model's, at which the best kinds are looked for: 3 % beside the right
# one the waves keep 0.95 of their correlation, 9 % beside it 0.6. Then nearer ones around the best.
_LOG_MASSES: Final[tuple[float, ...]] = tuple(np.arange(-0.84, 1.2, 0.06).round(2).tolist())
_NEAR_MASSES: Final = (-0.03, -0.015, 0.015, 0.03)
_KINDS_AT_MASSES: Final = 2
# Rounds of a fit, each with the belt's answer at the end of the one before, its steps, and the change of the tire's
# logarithms that is not worth another one.
_ROUNDS: Final = 3
_STEPS: Final = 8
_SETTLED: Final = 0.01
_ORDER: Final[FloatArray] = np.arange(ORDERS, dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Promise:
    """What an effect promises.

    Attributes:
        effect: the effect.
        parameters: where it promises most, (p,).
        gain: of log evidence.
    """

    effect: LocalChange
    parameters: FloatArray
    gain: float


class ProfileScan:
    """The best set's fit under several factors of its discrepancy."""

    def __init__(self, fit: Fit) -> None:
        """Take the fit, with its discrepancy."""
        self.fit = fit
        self._fits, self._levels = under_factors(fit)
        self._shapes = {index: fit.model.shape(fit.vector, index) for index in range(len(fit.model.campaign.groups))}

    def promises(self, effects: Sequence[LocalChange]) -> list[Promise]:
        """Return what each effect promises, most first."""
        promises = sorted((self._at_places(effect, 0.0) for effect in effects), key=attrgetter("gain"), reverse=True)
        top = promises[:_KINDS_AT_MASSES]
        # Beside the right mass a tenth of the gain is left.
        if top[0].gain > criteria.LOOKED_AT and (log_mass := self._log_mass([promise.effect for promise in top])):
            mass_promises = (self._at_places(promise.effect, log_mass) for promise in promises)
            promises = [max(pair, key=attrgetter("gain")) for pair in zip(promises, mass_promises, strict=True)]
        return sorted(promises, key=attrgetter("gain"), reverse=True)

    def _log_mass(self, effects: Sequence[LocalChange]) -> float:
        """Return the belt's mass at which one of some effects gains most in the fastest group, on a coarse grid."""
        groups, model = self.fit.model.campaign.groups, self.fit.model
        fastest = max(range(len(groups)), key=lambda index: groups[index].conditions.omega_radps)
        coarse = ClosureModel(model.campaign, coarse_core(), model.effects)
        shapes = {fastest: coarse.shape(self.fit.vector, fastest)}

        def gain(log_mass: float) -> float:
            return max(float(self._gains(effect, _all_places(effect), log_mass, shapes)[0].max()) for effect in effects)

        gain_of = {log_mass: gain(log_mass) for log_mass in _LOG_MASSES}
        best_log_mass = max(gain_of, key=gain_of.__getitem__)
        if best_log_mass:
            gain_of |= {best_log_mass + step: gain(best_log_mass + step) for step in _NEAR_MASSES}
        return max(gain_of, key=gain_of.__getitem__)

    def _at_places(self, effect: LocalChange, log_mass: float) -> Promise:
        """Return what a change promises at its best place and width."""
        places, width = _all_places(effect), effect.shape.width_rad
        gains, sizes = self._gains(effect, places, log_mass, self._shapes)
        candidates = list(zip(gains.tolist(), sizes.tolist(), places, strict=True))
        for peak in _peaks(gains):
            neighbours = [(places[peak][0] + step, width * factor) for factor in _WIDTHS for step in _NEAR_RAD.tolist()]
            gains, sizes = self._gains(effect, neighbours, log_mass, self._shapes)
            candidates += zip(gains.tolist(), sizes.tolist(), neighbours, strict=True)
        gain, size, (angle_rad, width) = max(candidates, key=lambda entry: entry[0])
        angle_rad = (angle_rad + math.pi) % (2.0 * math.pi) - math.pi
        return Promise(effect, np.array([size, angle_rad, width, *effect.start_values[0][3:-1], log_mass]), gain)

    def _gains(
        self, effect: LocalChange, tried: Sequence[tuple[float, float]], log_mass: float, shapes: Mapping[int, Shape]
    ) -> tuple[FloatArray, FloatArray]:
        """Return the gain of each place and width in the groups of some shapes, and the size there."""
        gains, sizes = np.empty(len(tried)), np.empty(len(tried))
        std = effect.parameters[0].prior_std
        for start in range(0, len(tried), _ROWS):
            rows = self._rows(effect, tried[start : start + _ROWS], log_mass, shapes)
            factor_results = []
            for fit, level in zip(self._fits, self._levels.tolist(), strict=True):
                score, information = self._projected(fit, rows, len(tried[start : start + _ROWS]))
                gain = 0.5 * score**2 / (information + std**-2) - 0.5 * np.log1p(std**2 * information)
                factor_results.append((level + gain, score / (information + std**-2)))
            totals = np.stack([total for total, _ in factor_results])
            best_factor = np.argmax(totals, axis=0)
            columns = np.arange(totals.shape[1])
            gains[start : start + _ROWS] = totals[best_factor, columns] - self._levels.max()
            sizes[start : start + _ROWS] = np.stack([size for _, size in factor_results])[best_factor, columns]
        return gains, sizes

    def _projected(self, fit: Fit, rows: Sequence[FloatArray | None], count: int) -> tuple[FloatArray, FloatArray]:
        """Return the score and the information of each row, what the parameters of the fit take left out."""
        cross = fit.cross(rows)
        information = fit.cross_information(rows, count)[:, 0, 0]
        weights = np.linalg.solve(fit.precision, cross[:-1])
        return cross[-1] - fit.step @ cross[:-1], np.maximum(information - (cross[:-1] * weights).sum(axis=0), 1e-300)

    def _rows(
        self, effect: LocalChange, tried: Sequence[tuple[float, float]], log_mass: float, shapes: Mapping[int, Shape]
    ) -> list[FloatArray | None]:
        """Return the readings of a unit size, (k, 3, REAL) of each group; effects of later stages are left out."""
        places = np.array([angle_rad for angle_rad, _ in tried])
        widths = np.array([width for _, width in tried])
        model = self.fit.model
        rows: list[FloatArray | None] = [None] * len(model.campaign.groups)
        for index, shape in shapes.items():
            group = model.campaign.groups[index]
            block = base_signal(model.core, shape, group.conditions)
            orders = np.empty((len(tried), 3, ORDERS), dtype=np.complex128)
            for width in np.unique(widths):
                same_width = widths == width
                orders[same_width] = effect.unit_orders(block, places[same_width], float(width), log_mass)
            if group.declared_roll_rad or group.declared_pitch_rad:
                orders = mounting_matrix(group.declared_roll_rad, group.declared_pitch_rad) @ orders
            phase_shift = np.exp(-1j * float(self.fit.vector[model.layout.centre(index)]) * _ORDER)
            rows[index] = as_real(orders * phase_shift)
        return rows


def under_factors(fit: Fit) -> tuple[list[Fit], FloatArray]:
    """Return a fit under several factors of its discrepancy, 1 first, and the log evidence of each."""
    if fit.applied is None:
        raise ValueError("a scan needs the discrepancy of its fit")
    discrepancy, amplitudes = fit.applied.discrepancy, fit.applied.amplitudes
    floor = (criteria.LEAST_SHARE * discrepancy.reference_mps2) ** 2
    fits = [
        fit if factor == 1.0 else fit.under(discrepancy.applied(np.maximum(factor * amplitudes, floor)))
        for factor in _FACTORS
    ]
    return fits, np.array([log_evidence(scaled_fit.moved(scaled_fit.step)) for scaled_fit in fits])


def fitted_with(promise: Promise, fit: Fit, data: Whitened, rival: Fit | None = None) -> Fit | None:
    """Return the fit of a model with an effect that promises much, None where it fails.

    Without the discrepancy, which stood for the effect and would let the fit end beside it.

    Args:
        promise: of the effect, by a scan of the fit.
        fit: of the model without it.
        data: whitened.
        rival: with another effect; a fit that leaves far more than it is not worked out.
    """
    max_excess = math.inf if rival is None else (rival.misfit - data.size) / criteria.FAR_LESS
    parameters = np.clip(promise.parameters, *bounds(promise.effect))
    tire, fitted = fit.vector[fit.model.layout.states], fit
    try:
        for _ in range(_ROUNDS):
            effect = promise.effect.held()
            model = ClosureModel(fit.model.campaign, fit.model.core, (*fit.model.effects, effect))
            start = fitted.model.layout.moved(fitted.vector, model.layout)
            if fitted is fit:
                start[model.layout.effect(effect.name)] = parameters
            fitted = fit_model(model, data, start, most_steps=_STEPS)
            tire_step, tire = fitted.vector[model.layout.states] - tire, fitted.vector[model.layout.states]
            if float(np.abs(tire_step).max()) < _SETTLED or fitted.misfit - data.size > max_excess:
                break
    except (FitFailedError, NoShapeError, np.linalg.LinAlgError):
        return None
    return fitted


def _all_places(effect: LocalChange) -> list[tuple[float, float]]:
    """Return places all around, each with the usual width."""
    places = np.linspace(-math.pi, math.pi, _FIRST_PLACES, endpoint=False)
    return [(angle_rad, effect.shape.width_rad) for angle_rad in places.tolist()]


def _peaks(gains: FloatArray) -> list[int]:
    """Return the highest peaks of a periodic curve."""
    peaks = np.flatnonzero((gains >= np.roll(gains, 1)) & (gains > np.roll(gains, -1)))
    return sorted(peaks.tolist(), key=lambda index: -gains[index])[:_PEAKS]
