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
    stays, begins, drift, begun = model.change
    values, rows, noises = measured
    shares = np.array(switched)[:, np.newaxis]
    predicted, other = means * stays, means[::-1] * begins
    spread = covariances * stays[:, :, np.newaxis] * stays[:, np.newaxis]
    others = covariances[::-1] * begins[:, :, np.newaxis] * begins[:, np.newaxis] + _diagonals(begun)
    apart = other - predicted
    between = (shares * (1.0 - shares))[:, np.newaxis] * apart[:, :, np.newaxis] * apart[:, np.newaxis]
    spread += shares[:, np.newaxis] * (others - spread) + between + _diagonals(drift)
    predicted += shares * apart
    innovations = values - predicted @ rows.T
    across = spread @ rows.T
    sums = rows @ across + np.diag(noises)
    inverses = np.linalg.inv(sums)
    weighted = (inverses @ innovations[:, :, np.newaxis])[:, :, 0]
    first, second = (np.sum(weighted * innovations, axis=1) + np.linalg.slogdet(sums)[1]).tolist()
    gains = across @ inverses
    if model.fixed >= 0:
        gains[0, model.fixed] = 0.0
    predicted += (gains @ innovations[:, :, np.newaxis])[:, :, 0]
    lost = gains @ across.transpose(0, 2, 1)
    spread += gains @ sums @ gains.transpose(0, 2, 1) - lost - lost.transpose(0, 2, 1)
    # The variance of the free state in closed form: added before, it would take the digits of all others.
    by_free = rows[:, -1]
    along = inverses[1] @ by_free
    unmeasured = -gains[1] @ by_free
    unmeasured[-1] += 1.0
    free = model.free_variance / (1.0 + model.free_variance * float(by_free @ along))
    predicted[1] += free * float(along @ innovations[1]) * unmeasured
    spread[1] += free * np.multiply.outer(unmeasured, unmeasured)
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
