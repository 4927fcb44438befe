"""Doubts about sets of effects that leave more than noise: every model of the data is then known to be wrong."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from gateway.closure.inference import criteria
from gateway.closure.inference.likelihood import Whitened
from gateway.closure.inference.residual import ByPart, ratios_by_part
from gateway.closure.inference.set_evidence import Evaluated
from gateway.closure.inference.set_search import Names
from gateway.reasons import Code, Reason


def doubted_sets(found: Mapping[Names, Evaluated], data: Whitened) -> tuple[dict[Names, Evaluated], ByPart]:
    """Return sets with objections to effects that explain nothing, and the temperatures of their evidence.

    A temperature is the rms of what the best possible set leaves over that of the noise. A model known to be wrong by
    so much knows that much less (Miller and Dunson 2019, coarsened posterior). It is the ratio of rms, not of power,
    since the discrepancy widens the errors already. What is left in the wheel's plane says nothing about the lateral
    axis, and the other way round.

    Args:
        found: sets with their evidence, the set without effects among them.
        data: whitened.
    """
    ratios = {names: ratios_by_part(one.fit, data) for names, one in found.items()}
    result = {names: _explaining(one, ratios) for names, one in found.items()}
    possible = [one for one in result.values() if not one.objections]
    best = min(possible, key=lambda one: (-one.log_evidence, sorted(one.names)))
    return result, ByPart(*map(math.sqrt, ratios[best.names]))


def _explaining(one: Evaluated, ratios: Mapping[Names, ByPart]) -> Evaluated:
    """Return a set that leaves more than noise with an objection to each effect that others need not.

    An effect explains nothing if the set without it leaves less of the plane or of the lateral axis, or if a set of no
    more effects without it leaves half, and no more of the other part. It then owes its evidence to the discrepancy: it
    moves the fit away from the data.
    """
    own = ratios[one.names]
    if max(own) < criteria.TEMPERED:
        return one
    known = {name for name, _ in one.objections}
    half = ByPart(*(1.0 + criteria.FAR_LESS * (each - 1.0) for each in own))
    more = []
    for name in sorted(one.names - known):
        bare = one.names - {name}
        better = [ratios[bare]] if bare in ratios and _leaves_less(ratios[bare], own, own) else []
        others = [ratio for names, ratio in ratios.items() if name not in names and len(names) <= len(one.names)]
        better += [each for each in others if _leaves_less(each, half, own)]
        if better:
            least = min(better, key=sum)
            part = max(range(len(own)), key=lambda at: own[at] - least[at])
            reason = Reason(Code.LEAVES_MORE_THAN_WITHOUT, with_it=math.sqrt(own[part]), without=math.sqrt(least[part]))
            more.append((name, reason))
    return replace(one, objections=(*one.objections, *more)) if more else one


def _leaves_less(other: ByPart, limits: ByPart, own: ByPart) -> bool:
    """Return whether another set is within the limit of a part above noise, and leaves no more of the others."""
    below = any(
        left <= limit for left, limit, here in zip(other, limits, own, strict=True) if here >= criteria.TEMPERED
    )
    share = 1.0 + criteria.LEAVES_THE_SAME
    return below and all(
        left - 1.0 <= share * (here - 1.0) + criteria.LEAVES_THE_SAME for left, here in zip(other, own, strict=True)
    )
