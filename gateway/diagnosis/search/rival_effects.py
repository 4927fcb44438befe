"""Effects that may take the place of each other in a set."""

import math
from collections.abc import Iterable, Mapping, Sequence

from gateway.diagnosis import criteria
from gateway.diagnosis.model.closure_model import AngleEffect


def is_taken(effect: AngleEffect, taken: Sequence[AngleEffect]) -> bool:
    """Return whether an effect, or another form of it, is among those taken."""
    if any(effect.name == candidate.name for candidate in taken):
        return True
    return bool(effect.form_of) and any(candidate.form_of == effect.form_of for candidate in taken)


def rivals_of(effect: str, worth: float, effects: Iterable[str], promises: Sequence[Mapping[str, float]]) -> list[str]:
    """Return the effects that promised a large part of what another did to some set, or that were never tried.

    Args:
        effect: that they may take the place of.
        worth: log evidence that it adds to its set. It may be far less than it promised: others explain some by now.
        effects: all names.
        promises: for every set of a chain, the gain of log evidence that each effect promised without a discrepancy.
    """
    tried = {name for promised in promises for name in promised}
    share, margin = criteria.RIVAL_SHARE, criteria.LOOKED_AT
    # Where it promised next to nothing itself, so did all others.
    promising = [gains for gains in promises if share * gains.get(effect, 0.0) > margin] or promises
    return [
        name
        for name in effects
        if name not in tried
        or any(gains.get(name, -math.inf) > share * min(gains.get(effect, 0.0), worth) - margin for gains in promising)
    ]
