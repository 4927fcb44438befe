"""Other optima of a set of effects: an effect of another shape, far from the best one, that fits nearly as well.

Laplace's approximation knows one optimum. Where the data leave several, as with the number of blocks of a tread against
the stiffness of its belt, each has the weight of its own evidence, and the distance between them is an error.
"""

import numpy as np

from gateway.core.types import FloatArray
from gateway.diagnosis import criteria
from gateway.diagnosis.angle.candidate_trial import followed_trials, shapes_of, start_of
from gateway.diagnosis.angle.fit import Fit, FitFailedError, fit_model
from gateway.diagnosis.angle.set_evidence import Evaluated, evaluate, settled
from gateway.diagnosis.model.baseline import NoShapeError
from gateway.diagnosis.model.closure_model import AngleEffect


def other_optima(
    best: Evaluated, bare: Fit, effect: AngleEffect, groups: tuple[int, ...], *, at_rest: bool = False
) -> list[Evaluated]:
    """Return the other optima of a set of nearly its evidence, or of a higher one, best first.

    Args:
        best: the set, with a discrepancy.
        bare: fit of the set without the effect, under the same discrepancy.
        effect: whose shape is varied; one with a single start has none.
        groups: indices of the groups in which it is tried.
        at_rest: whether they must rest, as on a flat ridge.
    """
    applied = best.fit.applied
    conditions = tuple(group.conditions for group in best.fit.model.campaign.groups)
    if applied is None or len(effect.starts(conditions)) < 2:
        return []
    try:
        trials = followed_trials(bare, effect, shapes_of(bare, groups))
    except (NoShapeError, np.linalg.LinAlgError):
        return []
    optima, tried = [best], 0
    where = best.fit.model.layout.effect(effect.name)
    tolerance = criteria.SIGMAS_LISTED * np.sqrt(np.diagonal(best.fit.covariance)[where])

    def is_new(parameters: FloatArray) -> bool:
        return all(bool(np.any(np.abs(parameters - optimum.fit.vector[where]) > tolerance)) for optimum in optima)

    threshold = max((trial.promise for trial in trials), default=0.0) - criteria.WORTH_WORK
    for trial in trials:
        if trial.promise < threshold or tried == criteria.OPTIMA_TRIED:
            break
        # The trial's model has its effects in another order.
        start = trial.model.layout.moved(start_of(trial), best.fit.model.layout)
        if not is_new(start[where]):
            continue
        tried += 1
        min_evidence = best.log_evidence - criteria.WORTH_WORK
        try:
            fit = fit_model(best.fit.model, best.fit.data, start, applied=applied, most_steps=criteria.OPTIMUM_STEPS)
            candidate = evaluate(fit, best.fit.data, applied.discrepancy, applied, min_evidence)
            if at_rest and candidate.log_evidence > best.log_evidence - criteria.WORTH_WORK:
                candidate = settled(candidate, best.fit.data)
        except (FitFailedError, np.linalg.LinAlgError):
            continue
        if candidate.log_evidence > best.log_evidence - criteria.WITHIN and is_new(candidate.fit.vector[where]):
            optima.append(candidate)
    return sorted(optima[1:], key=lambda optimum: -optimum.log_evidence)
