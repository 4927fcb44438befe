"""Scan of effects at every place: what each would add to the evidence of what is left, to first order.

The discrepancy of the best set competes. Were its amplitudes fitted anew, an effect that only reshapes what is left
would gain much; so one factor of all of them is profiled over instead.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.core.types import FloatArray
from gateway.diagnosis import criteria
from gateway.diagnosis.angle.candidate_trial import bounds
from gateway.diagnosis.angle.fit import Fit, FitFailedError, fit_model
from gateway.diagnosis.angle.likelihood import Whitened, as_real
from gateway.diagnosis.angle.set_evidence import log_evidence
from gateway.diagnosis.effects.angle_orders import ORDERS
from gateway.diagnosis.effects.effect import SignalEffect
from gateway.diagnosis.effects.local_effects import LocalChange
from gateway.diagnosis.model.baseline import NoShapeError
from gateway.diagnosis.model.closure_model import ClosureModel
from gateway.diagnosis.model.sensor_signal import base_signal, mounting_matrix

# Factors of the discrepancy's amplitudes.
_FACTORS: Final = (1.0, 0.1, 0.01)
# Places of the first look and the share of the usual width that they resolve; then nearer ones around the best.
_FIRST_PLACES: Final = 240
_PEAKS: Final = 2
_NEAR_RAD: Final = np.radians([-1.5, -1.2, -0.9, -0.6, -0.3, 0.0, 0.3, 0.6, 0.9, 1.2, 1.5])
_WIDTHS: Final = (0.2, 0.5, 1.0, 2.0, 4.0)
_ROWS: Final = 240
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

    effect: SignalEffect
    parameters: FloatArray
    gain: float


class ProfileScan:
    """The best set's fit under several factors of its discrepancy."""

    def __init__(self, fit: Fit) -> None:
        """Take the fit, with its discrepancy."""
        if fit.applied is None:
            raise ValueError("a scan needs the discrepancy of its fit")
        self.fit = fit
        discrepancy, amplitudes = fit.applied.discrepancy, fit.applied.amplitudes
        least = (criteria.LEAST_SHARE * discrepancy.reference_mps2) ** 2
        self._fits = [
            fit if factor == 1.0 else fit.under(discrepancy.applied(np.maximum(factor * amplitudes, least)))
            for factor in _FACTORS
        ]
        self._levels = np.array([log_evidence(scaled_fit.moved(scaled_fit.step)) for scaled_fit in self._fits])
        self._shapes = [fit.model.shape(fit.vector, index) for index in range(len(fit.model.campaign.groups))]

    def promises(self, effects: Sequence[SignalEffect]) -> list[Promise]:
        """Return what each effect promises, most first; those of axes without data promise nothing."""
        promises = [promise for effect in effects for promise in self._of(effect)]
        return sorted(promises, key=lambda each: -each.gain)

    def _of(self, effect: SignalEffect) -> Iterator[Promise]:
        if not isinstance(effect, LocalChange):
            start = np.array(effect.start_values[0])
            yield from self._other(effect, start)
            return
        width = effect.shape.width_rad
        first = np.linspace(-math.pi, math.pi, _FIRST_PLACES, endpoint=False)
        tried = [(angle_rad, width) for angle_rad in first.tolist()]
        gains, sizes = self._gains(effect, tried)
        best = list(zip(gains.tolist(), sizes.tolist(), tried, strict=True))
        for peak in _peaks(gains):
            near = [(first[peak] + step, width * factor) for factor in _WIDTHS for step in _NEAR_RAD.tolist()]
            gains, sizes = self._gains(effect, near)
            best += zip(gains.tolist(), sizes.tolist(), near, strict=True)
        gain, size, (angle_rad, width) = max(best, key=lambda entry: entry[0])
        angle_rad = (angle_rad + math.pi) % (2.0 * math.pi) - math.pi
        yield Promise(effect, np.array([size, angle_rad, width, *effect.start_values[0][3:]]), gain)

    def _other(self, effect: SignalEffect, start: FloatArray) -> Iterator[Promise]:
        """Yield the promise of an effect without a place: each parameter of a linear one has its own size."""
        model = ClosureModel(self.fit.model.campaign, self.fit.model.core, (*self.fit.model.effects, effect))
        vector = self.fit.model.layout.moved(self.fit.vector, model.layout)
        where = model.layout.effect(effect.name)
        starts = np.diag(start)[start != 0.0]
        groups = range(len(model.campaign.groups))
        without = [model.predict_mean(vector, index) for index in groups]
        rows = []
        for index in groups:
            group_rows = []
            for unit_start in starts:
                vector[where] = unit_start
                group_rows.append(as_real(model.predict_mean(vector, index) - without[index]))
            rows.append(np.stack(group_rows))
        if not any(row.any() for row in rows):
            return
        stds = np.array(
            [
                parameter.prior_std / abs(start_value)
                for parameter, start_value in zip(effect.parameters, start, strict=True)
                if start_value
            ]
        )
        gain, sizes = self._gain_of_all(rows, stds)
        yield Promise(effect, sizes @ starts, gain)

    def _gains(self, effect: LocalChange, tried: Sequence[tuple[float, float]]) -> tuple[FloatArray, FloatArray]:
        """Return the gain of each place and width, and the size there."""
        gains, sizes = np.empty(len(tried)), np.empty(len(tried))
        std = effect.parameters[0].prior_std
        for begin in range(0, len(tried), _ROWS):
            rows = self._rows(effect, tried[begin : begin + _ROWS])
            over = []
            for fit, level in zip(self._fits, self._levels.tolist(), strict=True):
                score, information = self._projected(fit, rows)
                gain = 0.5 * score**2 / (information + std**-2) - 0.5 * np.log1p(std**2 * information)
                over.append((level + gain, score / (information + std**-2)))
            totals = np.stack([total for total, _ in over])
            which = np.argmax(totals, axis=0)
            columns = np.arange(totals.shape[1])
            gains[begin : begin + _ROWS] = totals[which, columns] - self._levels.max()
            sizes[begin : begin + _ROWS] = np.stack([size for _, size in over])[which, columns]
        return gains, sizes

    def _projected(self, fit: Fit, rows: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Return the score and the information of each row, what the parameters of the fit take left out."""
        cross = fit.cross(rows)
        information = fit.cross_information(rows, len(rows[0]))[:, 0, 0]
        taken = np.linalg.solve(fit.precision, cross[:-1])
        return cross[-1] - fit.step @ cross[:-1], np.maximum(information - (cross[:-1] * taken).sum(axis=0), 1e-300)

    def _gain_of_all(self, rows: Sequence[FloatArray], stds: FloatArray) -> tuple[float, FloatArray]:
        """Return the gain of rows that go together, and their sizes."""
        best = (-math.inf, np.zeros(len(stds)))
        for fit, level in zip(self._fits, self._levels.tolist(), strict=True):
            cross = fit.cross(rows)
            information = fit.cross_information(rows, 1)[0] - cross[:-1].T @ np.linalg.solve(fit.precision, cross[:-1])
            precision = information + np.diag(stds**-2.0)
            score = cross[-1] - fit.step @ cross[:-1]
            sizes = np.linalg.solve(precision, score)
            gain = 0.5 * float(score @ sizes) - 0.5 * float(np.linalg.slogdet(precision * np.square(stds))[1])
            if level + gain > best[0]:
                best = level + gain, sizes
        return best[0] - float(self._levels.max()), best[1]

    def _rows(self, effect: LocalChange, tried: Sequence[tuple[float, float]]) -> list[FloatArray]:
        """Return the readings of a unit size, (k, 3, REAL) of each group; effects of later stages are left out."""
        places = np.array([angle_rad for angle_rad, _ in tried])
        widths = np.array([width for _, width in tried])
        rows = []
        model = self.fit.model
        for index, (group, shape) in enumerate(zip(model.campaign.groups, self._shapes, strict=True)):
            block = base_signal(model.core, shape, group.conditions)
            orders = np.empty((len(tried), 3, ORDERS), dtype=np.complex128)
            for width in np.unique(widths):
                same_width = widths == width
                orders[same_width] = effect.unit_orders(block, places[same_width], float(width))
            if group.declared_roll_rad or group.declared_pitch_rad:
                orders = mounting_matrix(group.declared_roll_rad, group.declared_pitch_rad) @ orders
            turn = np.exp(-1j * float(self.fit.vector[model.layout.centre(index)]) * _ORDER)
            rows.append(as_real(orders * turn))
        return rows


def fitted_with(promise: Promise, fit: Fit, data: Whitened) -> Fit | None:
    """Return the fit of a model with an effect that promises much, None where it fails.

    Without the discrepancy, which stood for the effect and would let the fit end beside it.

    Args:
        promise: of the effect, by a scan of the fit.
        fit: of the model without it.
        data: whitened.
    """
    parameters = np.clip(promise.parameters, *bounds(promise.effect))
    tire, fitted = fit.vector[fit.model.layout.states], fit
    try:
        for _ in range(_ROUNDS):
            effect = promise.effect.held() if isinstance(promise.effect, LocalChange) else promise.effect
            model = ClosureModel(fit.model.campaign, fit.model.core, (*fit.model.effects, effect))
            start = fitted.model.layout.moved(fitted.vector, model.layout)
            if fitted is fit:
                start[model.layout.effect(effect.name)] = parameters
            fitted = fit_model(model, data, start, most_steps=_STEPS)
            moved, tire = fitted.vector[model.layout.states] - tire, fitted.vector[model.layout.states]
            if float(np.abs(moved).max()) < _SETTLED:
                break
    except (FitFailedError, NoShapeError, np.linalg.LinAlgError):
        return None
    return fitted


def _peaks(gains: FloatArray) -> list[int]:
    """Return the highest peaks of a periodic curve."""
    peaks = np.flatnonzero((gains >= np.roll(gains, 1)) & (gains > np.roll(gains, -1)))
    return sorted(peaks.tolist(), key=lambda index: -gains[index])[:_PEAKS]
