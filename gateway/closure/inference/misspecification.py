"""Doubts about sets of effects that leave more than noise: every model of the data is then known to be wrong."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from gateway.closure.inference import criteria
from gateway.closure.inference.likelihood import Whitened
from gateway.closure.inference.residual import residual_ratio
from gateway.closure.inference.set_evidence import Evaluated
from gateway.closure.inference.set_search import Names
from gateway.reasons import Code, Reason


def doubted_sets(found: Mapping[Names, Evaluated], data: Whitened) -> tuple[dict[Names, Evaluated], float]:
    """Return sets with objections to effects that explain nothing, and the temperature of their evidence.

    The temperature is the rms of what the best possible set leaves over that of the noise. A model known to be wrong by
    so much knows that much less (Miller and Dunson 2019, coarsened posterior). It is the ratio of rms, not of power,
    since the discrepancy widens the errors already.

    Args:
        found: sets with their evidence, the set without effects among them.
        data: whitened.
    """
    ratios = {names: residual_ratio(one.fit, data) for names, one in found.items()}
    result = {names: _explaining(one, ratios) for names, one in found.items()}
    possible = [one for one in result.values() if not one.objections]
    best = min(possible, key=lambda one: (-one.log_evidence, sorted(one.names)))
    return result, math.sqrt(ratios[best.names])


def _explaining(one: Evaluated, ratios: Mapping[Names, float]) -> Evaluated:
    """Return a set that leaves more than noise with an objection to each effect that others need not.

    An effect explains nothing if the set without it leaves less, or if a set of no more effects without it leaves half.
    It then owes its evidence to the discrepancy: it moves the fit away from the data.
    """
    own = ratios[one.names]
    if own < criteria.TEMPERED:
        return one
    known = {name for name, _ in one.objections}
    half = 1.0 + criteria.FAR_LESS * (own - 1.0)
    more = []
    for name in sorted(one.names - known):
        rest = ratios.get(one.names - {name}, math.inf)
        others = [ratio for names, ratio in ratios.items() if name not in names and len(names) <= len(one.names)]
        least = min(others, default=math.inf)
        if rest <= own or least <= half:
            without = math.sqrt(min(rest, least))
            reason = Reason(Code.LEAVES_MORE_THAN_WITHOUT, with_it=math.sqrt(own), without=without)
            more.append((name, reason))
    return replace(one, objections=(*one.objections, *more)) if more else one
