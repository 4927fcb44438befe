"""One step of two Kalman filters between which a system switches, by the compiled core or numpy."""

from typing import Final, NamedTuple

import numpy as np

from gateway.core.compiled import core
from gateway.core.types import FloatArray

# States and measured values that the compiled core takes, as in gateway/core/compiled/core.c.
MOST_STATES: Final = 16
MOST_MEASURED: Final = 4


class SwitchingModel(NamedTuple):
    """How the n states of both filters change from one step to the next.

    Attributes:
        change: (4, 2, n) by filter: the share of a state that stays where the filter goes on, and where the system has
            just switched to it; the variance added to every state, and to one that begins by a switch.
        free_variance: added to the last state of the second filter once its likelihood is known, so that the state
            follows the measured values alone.
        fixed: index of a state that measured values do not change in the first filter, though what they are known by
            depends on it; -1 for none.
    """

    change: FloatArray
    free_variance: float
    fixed: int = -1


def _stepped_by_numpy(
    model: SwitchingModel,
    switched: tuple[float, float],
    measured: tuple[FloatArray, FloatArray, FloatArray],
    means: FloatArray,
    covariances: FloatArray,
) -> float:
    """Predict and update both filters in place; return the logarithm of their likelihoods' ratio, second over first.

    Args:
        model: of both filters.
        switched: probabilities that the other filter was that of the step before, in each.
        measured: values (m,), their rows (m, n) and variances (m,).
        means: (2, n).
        covariances: (2, n, n).
    """
    stays, enters, drift, entry_noise = model.change
    values, rows, noises = measured
    shares = np.array(switched)[:, np.newaxis]
    predicted, entry_means = means * stays, means[::-1] * enters
    spread = covariances * stays[:, :, np.newaxis] * stays[:, np.newaxis]
    entry_spread = covariances[::-1] * enters[:, :, np.newaxis] * enters[:, np.newaxis] + _diagonals(entry_noise)
    difference = entry_means - predicted
    mixture = (shares * (1.0 - shares))[:, np.newaxis] * difference[:, :, np.newaxis] * difference[:, np.newaxis]
    spread += shares[:, np.newaxis] * (entry_spread - spread) + mixture + _diagonals(drift)
    predicted += shares * difference
    innovations = values - predicted @ rows.T
    cross_covariance = spread @ rows.T
    sums = rows @ cross_covariance + np.diag(noises)
    inverses = np.linalg.inv(sums)
    weighted = (inverses @ innovations[:, :, np.newaxis])[:, :, 0]
    first, second = (np.sum(weighted * innovations, axis=1) + np.linalg.slogdet(sums)[1]).tolist()
    gains = cross_covariance @ inverses
    if model.fixed >= 0:
        gains[0, model.fixed] = 0.0
    predicted += (gains @ innovations[:, :, np.newaxis])[:, :, 0]
    reduction = gains @ cross_covariance.transpose(0, 2, 1)
    spread += gains @ sums @ gains.transpose(0, 2, 1) - reduction - reduction.transpose(0, 2, 1)
    # The variance of the free state in closed form: added before, it would take the digits of all others.
    by_free = rows[:, -1]
    weighted_row = inverses[1] @ by_free
    unmeasured = -gains[1] @ by_free
    unmeasured[-1] += 1.0
    free_gain = model.free_variance / (1.0 + model.free_variance * float(by_free @ weighted_row))
    predicted[1] += free_gain * float(weighted_row @ innovations[1]) * unmeasured
    spread[1] += free_gain * np.multiply.outer(unmeasured, unmeasured)
    means[:] = predicted
    # Rounding would grow otherwise.
    covariances[:] = 0.5 * (spread + spread.transpose(0, 2, 1))
    return 0.5 * float(first - second)


def _diagonals(values: FloatArray) -> FloatArray:
    return values[:, :, np.newaxis] * np.eye(values.shape[1])


def _stepped_by_core(
    model: SwitchingModel,
    switched: tuple[float, float],
    measured: tuple[FloatArray, FloatArray, FloatArray],
    means: FloatArray,
    covariances: FloatArray,
) -> float:
    """As `_stepped_by_numpy`, of C-contiguous arrays."""
    assert core is not None
    exponent: float = core.switching_step(
        model.change, model.free_variance, model.fixed, *switched, *measured, means, covariances
    )
    return exponent


stepped = _stepped_by_numpy if core is None else _stepped_by_core
