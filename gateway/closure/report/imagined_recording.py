"""A recording that was not made: what a fitted set of effects predicts for it, given those that were."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Self

import numpy as np

from gateway.closure.angle.axis_covariance import Scatter
from gateway.closure.angle.discrepancy import Applied, Discrepancy
from gateway.closure.angle.fit import Fit
from gateway.closure.angle.likelihood import REAL, as_real, whiten
from gateway.closure.data.campaign_data import Block, Campaign, Group
from gateway.closure.effects.effect import GroupConditions
from gateway.closure.model.baseline import Core
from gateway.closure.model.closure_model import ClosureModel
from gateway.closure.model.tire_state import shift
from gateway.types import BoolArray, FloatArray, IntArray

# Share of an axis's orders that hold nothing but the sensor's own noise.
_QUIETEST: Final = 0.1
_AXES: Final = 3


def reference_group(campaign: Campaign) -> Group:
    """Return the group with the most revolutions: another recording is imagined like it."""
    return max(campaign.groups, key=lambda group: sum(block.count for block in group.blocks))


def with_recording(campaign: Campaign, target: GroupConditions, revolutions: int) -> Campaign:
    """Return a campaign with one more group: another recording by the sensor of the reference.

    Its scatter is the reference's at another speed. Its orders are the reference's, to be replaced by predicted ones.
    """
    reference = reference_group(campaign)
    states = [group.state for group in campaign.groups if _alike(group.conditions, target)]
    ratio = target.omega_radps / reference.conditions.omega_radps
    errors = reference.edge_errors_mps2
    group = replace(
        reference,
        label="imagined",
        conditions=target,
        blocks=(Block(revolutions, target, reference.blocks[0].orders_mps2),),
        state=states[0] if states else campaign.states,
        variance=_scatter(reference, ratio),
        edge_errors_mps2=None if errors is None else ratio**2 * errors,
    )
    return replace(campaign, groups=(*campaign.groups, group), states=campaign.states + (not states))


def carried(model: ClosureModel, larger: ClosureModel, vector: FloatArray) -> FloatArray:
    """Return parameters in a campaign with one more group: its contact's centre at 0, a new state the same tire's."""
    result = np.zeros(larger.layout.size)
    result[_places(model, larger)] = vector
    group = larger.campaign.groups[-1]
    if larger.campaign.states > model.campaign.states:
        reference = reference_group(model.campaign)
        change = shift(model.core.names, group.conditions, reference.conditions)
        result[larger.layout.state(group.state)] = model.tire(vector, model.campaign.groups.index(reference)) + change
    return result


def _places(model: ClosureModel, larger: ClosureModel) -> IntArray:
    """Return the places of a campaign's parameters among those of the campaign with one more group."""
    places = [np.arange(larger.layout.size)[larger.layout.state(state)] for state in range(model.campaign.states)]
    places.append(np.array([larger.layout.centre(index) for index in range(len(model.campaign.groups))]))
    places.append(np.arange(larger.layout.size)[larger.layout.sensor])
    places += [np.arange(larger.layout.size)[larger.layout.effect(effect.name)] for effect in model.effects]
    return np.concatenate(places)


@dataclass(frozen=True)
class ImaginedRecording:
    """Prediction of one set of effects for a recording, all of it Gaussian about the set's fit.

    Attributes:
        mean_mps2: (m,) real coefficients of the mean waveform.
        derivatives: (m, P) by the parameters, with what the discrepancy follows of them.
        unexplained: (m, m) covariance of the discrepancy, given the recordings that were made.
        covariance: (P, P) of the parameters, given the same.
        places: (p,) of the fit's own parameters among them.
    """

    mean_mps2: FloatArray
    derivatives: FloatArray
    unexplained: FloatArray
    covariance: FloatArray
    places: IntArray
    _group: Group
    _core: Core

    @classmethod
    def of(cls, fit: Fit, target: GroupConditions, most_revolutions: int) -> Self:
        """Return the prediction of a fit with its discrepancy.

        Args:
            fit: at its optimum.
            target: conditions of the recording.
            most_revolutions: that it may have.

        Raises:
            NoShapeError: the ring has no solution there.
            LinAlgError: the covariance cannot be inverted.
        """
        if fit.applied is None:
            raise ValueError("a recording is imagined with the discrepancy of its set")
        larger = with_recording(fit.model.campaign, target, most_revolutions)
        model = ClosureModel(larger, fit.model.core, fit.model.effects)
        vector = carried(fit.model, model, fit.vector)
        model.refine(vector)
        last = len(larger.groups) - 1
        places, predicted, rows = model.group_derivatives(vector, last)
        # NaN stays where the sensor has no axis or no order.
        reference_orders = larger.groups[last].blocks[0].orders_mps2
        orders = np.where(np.isfinite(reference_orders), predicted, reference_orders)
        group = replace(larger.groups[last], blocks=(Block(most_revolutions, target, orders),))
        larger = replace(larger, groups=(*larger.groups[:last], group))
        data = whiten(larger, fit.model.core)
        chosen = _chosen(data.used[last])
        positions = _places(fit.model, model)
        applied = _applied(
            fit, fit.applied, larger, Discrepancy(larger, data, concentrations=fit.applied.discrepancy.concentrations)
        )
        precision = model.prior_precision(vector)
        precision[np.ix_(positions, positions)] = fit.precision
        derivatives = np.zeros((model.layout.size, _AXES, REAL))
        derivatives[places] = as_real(rows)
        units = np.repeat(np.eye(REAL)[:, None], _AXES, axis=1)
        cross = applied.weighted([None] * last + [units])
        mean, spread = as_real(predicted), []
        for axis in range(_AXES):
            used = chosen[axis]
            inverse = np.asarray(np.linalg.inv(cross[last][used, axis][:, used]), dtype=np.float64)
            # What the recordings left, as the discrepancy carries it over; the parameters would change what is left.
            seen = [weighted[used, axis] for weighted in cross[:last]]
            remaining = sum(weighted @ residual[axis] for weighted, residual in zip(seen, fit.residual, strict=True))
            follows = sum(weighted @ of[:, axis].T for weighted, of in zip(seen, fit.rows, strict=True))
            mean[axis, used] -= inverse @ remaining
            derivatives[positions[:, None], axis, used] += (inverse @ follows).T
            spread.append(inverse)
        prediction = cls(
            np.concatenate([mean[axis, used] for axis, used in enumerate(chosen)]),
            np.concatenate([derivatives[:, axis, used].T for axis, used in enumerate(chosen)]),
            np.zeros((0, 0)),
            np.asarray(np.linalg.inv(precision), dtype=np.float64),
            positions,
            group,
            fit.model.core,
        )
        return replace(prediction, unexplained=_block_diagonal(spread) - prediction.scatter(most_revolutions))

    def scatter(self, revolutions: int) -> FloatArray:
        """Return the covariance of the mean of so many revolutions about their expectation, (m, m)."""
        block = self._group.blocks[0]
        alone = Campaign("", ("",), (replace(self._group, blocks=(replace(block, count=revolutions),)),), 1, {})
        (factors,) = whiten(alone, self._core).factors
        return _block_diagonal([Scatter.of(factor).covariance for factor in factors])

    def spread(self, revolutions: int) -> FloatArray:
        """Return the covariance of the measured coefficients as they can be foretold, (m, m)."""
        by_parameters = self.derivatives @ self.covariance @ self.derivatives.T
        result: FloatArray = self.unexplained + self.scatter(revolutions) + by_parameters
        return result

    def covariance_after(self, revolutions: int) -> FloatArray:
        """Return the covariance of the fit's own parameters once the recording is made, (p, p)."""
        gain = self.derivatives @ self.covariance
        after = self.covariance - gain.T @ np.linalg.solve(self.spread(revolutions), gain)
        result: FloatArray = after[np.ix_(self.places, self.places)]
        return result


def _applied(fit: Fit, applied: Applied, larger: Campaign, discrepancy: Discrepancy) -> Applied:
    """Return the discrepancy of a fit in the campaign with one more group, of the same size in those that there were.

    How much of it keeps its size from speed to speed is unknown where there was one speed only: half of it, then.
    """
    campaign = fit.model.campaign
    reference = reference_group(campaign).state
    before = {
        (state, axis): (number, groups.parts) for number, (state, axis, groups) in applied.discrepancy.enumerate()
    }
    amplitudes = np.zeros(discrepancy.shape)
    for number, (state, axis, groups) in discrepancy.enumerate():
        of = state if (state, axis) in before else reference
        old, parts = before[of, axis]
        ratio = (_mean_square(larger, state) / _mean_square(campaign, of)) ** 2
        first, constant = applied.amplitudes[old]
        if groups.parts == parts:
            amplitudes[number] = ratio * first, constant
        elif groups.parts > parts:
            amplitudes[number] = 0.5 * ratio * first, 0.5 * first
        else:
            amplitudes[number] = ratio * first + constant, constant
    return discrepancy.applied(amplitudes)


def _mean_square(campaign: Campaign, state: int) -> float:
    return float(np.mean([group.conditions.omega_radps**2 for group in campaign.groups if group.state == state]))


def _chosen(used: BoolArray) -> list[IntArray]:
    """Return the places of the real coefficients of each axis that are compared."""
    return [np.flatnonzero(row) for row in np.concatenate([used, used[:, 1:]], axis=1)]


def _block_diagonal(blocks: Sequence[FloatArray]) -> FloatArray:
    ends = np.cumsum([0, *map(len, blocks)])
    result = np.zeros((ends[-1], ends[-1]))
    for first, last, block in zip(ends, ends[1:], blocks, strict=False):
        result[first:last, first:last] = block
    return result


def _alike(first: GroupConditions, second: GroupConditions) -> bool:
    return (first.load_n, first.pressure_pa) == (second.load_n, second.pressure_pa)


def _scatter(group: Group, ratio: float) -> FloatArray:
    """Return the scatter of a recording at another speed, (3, ORDERS).

    The sensor's own is white in time, so a revolution's goes with omega; the rest is the ring's, and goes with omega^4.
    """
    variance = np.where(group.variance > 0.0, group.variance, np.nan)
    quiet = np.isfinite(variance).any(axis=1)
    sensor_variance = np.zeros((_AXES, 1))
    sensor_variance[quiet] = np.nanquantile(variance[quiet], _QUIETEST, axis=1)[:, None]
    result: FloatArray = (
        np.minimum(variance, sensor_variance) * ratio + np.maximum(variance - sensor_variance, 0.0) * ratio**4
    )
    return result
