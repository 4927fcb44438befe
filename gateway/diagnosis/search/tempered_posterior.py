"""Posterior over the sets of effects that a search has evaluated, where the best one leaves more than noise."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import TypeAlias

from gateway.core.reasons import Reason
from gateway.diagnosis import criteria
from gateway.diagnosis.angle.likelihood import Whitened
from gateway.diagnosis.angle.residual import ratios_by_part
from gateway.diagnosis.angle.set_evidence import Evaluated
from gateway.diagnosis.bayes.posterior import ByPart, Names, PosteriorOver, by_evidence, over
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.search.set_search import SetSearch


def doubted_sets(sets: Mapping[Names, Evaluated], data: Whitened) -> tuple[dict[Names, Evaluated], ByPart]:
    """Return sets with objections to effects that explain nothing, and the temperatures of their evidence.

    A temperature is the rms of what the best possible set leaves over that of the noise. A model known to be wrong by
    so much knows that much less (Miller and Dunson 2019, coarsened posterior). It is the ratio of rms, not of power,
    since the discrepancy widens the errors already. What is left in the wheel's plane says nothing about the lateral
    axis, and the other way round.

    Args:
        sets: of effects, with their evidence, the set without effects among them.
        data: whitened.
    """
    ratios = {names: ratios_by_part(evaluated.fit, data) for names, evaluated in sets.items()}
    result = {names: _with_objections(evaluated, ratios) for names, evaluated in sets.items()}
    possible = [evaluated for evaluated in result.values() if not evaluated.objections]
    best_possible = min(possible, key=by_evidence)
    return result, ByPart(*map(math.sqrt, ratios[best_possible.names]))


def _with_objections(evaluated: Evaluated, ratios: Mapping[Names, ByPart]) -> Evaluated:
    """Return a set that leaves more than noise with an objection to each effect that others need not.

    An effect explains nothing if the set without it leaves less of the plane or of the lateral axis, or if a set of no
    more effects without it leaves half, and no more of the other part. It then owes its evidence to the discrepancy: it
    moves the fit away from the data.
    """
    set_ratios = ratios[evaluated.names]
    if max(set_ratios) < criteria.TEMPERED:
        return evaluated
    objected = {name for name, _ in evaluated.objections}
    limits = ByPart(*(1.0 + criteria.FAR_LESS * (ratio - 1.0) for ratio in set_ratios))
    objections = []
    for name in sorted(evaluated.names - objected):
        others = evaluated.names - {name}
        lower = [ratios[others]] if others in ratios and _leaves_less(ratios[others], set_ratios, set_ratios) else []
        rivals = [ratio for names, ratio in ratios.items() if name not in names and len(names) <= len(evaluated.names)]
        lower += [ratio for ratio in rivals if _leaves_less(ratio, limits, set_ratios)]
        if lower:
            lowest_ratios = min(lower, key=sum)
            part = max(range(len(set_ratios)), key=lambda index: set_ratios[index] - lowest_ratios[index])
            reason = Reason(
                DiagnosisCode.LEAVES_MORE_THAN_WITHOUT,
                with_it=math.sqrt(set_ratios[part]),
                without=math.sqrt(lowest_ratios[part]),
            )
            objections.append((name, reason))
    return replace(evaluated, objections=(*evaluated.objections, *objections)) if objections else evaluated


def _leaves_less(other_ratios: ByPart, limits: ByPart, set_ratios: ByPart) -> bool:
    """Return whether another set is within the limit of a part above noise, and leaves no more of the others."""
    is_below = any(
        other_ratio <= limit
        for other_ratio, limit, set_ratio in zip(other_ratios, limits, set_ratios, strict=True)
        if set_ratio >= criteria.TEMPERED
    )
    factor = 1.0 + criteria.LEAVES_THE_SAME
    return is_below and all(
        other_ratio - 1.0 <= factor * (set_ratio - 1.0) + criteria.LEAVES_THE_SAME
        for other_ratio, set_ratio in zip(other_ratios, set_ratios, strict=True)
    )


Posterior: TypeAlias = PosteriorOver[Evaluated]
"""Posterior over sets of effects that are locked to the wheel angle."""


def posterior_of(search: SetSearch) -> Posterior:
    """Return the posterior over the sets that a search has found."""
    sets, temperatures = doubted_sets(search.evaluations, search.data)
    posterior = over({names: evaluated.tempered(*temperatures) for names, evaluated in sets.items()})
    possible = {
        name: tuple(evaluated.tempered(*temperatures) for evaluated in optima if not evaluated.objections)
        for name, optima in (search.optima.items() if posterior.best.names == search.best.names else ())
    }
    return replace(posterior, temperatures=temperatures, optima=possible)
