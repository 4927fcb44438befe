"""Posterior over sets of effects: the one place that decides which effects are identified."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gateway.closure.inference import criteria
from gateway.closure.inference.fit import Fit
from gateway.closure.inference.likelihood import Whitened
from gateway.closure.inference.residual import group_residuals
from gateway.closure.inference.set_evidence import Evaluated
from gateway.closure.inference.set_search import Names, SetSearch
from gateway.reasons import Code, Reason

# Weight below which a set changes no number.
_NEGLIGIBLE: Final = 1e-4


@dataclass(frozen=True)
class Posterior:
    """Sets of effects with their probabilities.

    An effect with impossible values stands for something that the catalogue lacks: its set keeps its probability, and
    counts for the other effects in it, but not for that one.

    Attributes:
        every: all sets with an evidence.
        masses: probability of each; they add up to 1.
        sets: possible sets whose effects are all supported (`criteria.REPORTED`), most probable first.
        weights: probability of each among these; they add up to 1.
        temperature: by which the evidence of the data was divided, since the best set leaves more than noise.
    """

    every: Mapping[Names, Evaluated]
    masses: Mapping[Names, float]
    sets: tuple[Evaluated, ...]
    weights: tuple[float, ...]
    temperature: float = 1.0

    @property
    def best(self) -> Evaluated:
        """The most probable possible set."""
        return self.sets[0]

    @property
    def baseline(self) -> Evaluated:
        """The set without effects."""
        return self.every[frozenset()]

    def probability(self, names: Iterable[str]) -> float:
        """Return the probability that at least one of these effects is present."""
        return _probability(self.every, self.masses, frozenset(names))

    def log_odds(self, name: str) -> float:
        """Return the logarithm of the odds that an effect is present, from the best sets with and without it."""
        with_it = [_tempered(one, self.temperature) for one in self.every.values() if name in counted(one)]
        without = [_tempered(one, self.temperature) for one in self.every.values() if name not in counted(one)]
        return max(with_it) - max(without) if with_it and without else math.nan

    @property
    def names(self) -> tuple[str, ...]:
        """Effects of any possible set, most probable first."""
        found = {name for one in self.every.values() for name in counted(one)}
        return tuple(sorted(found, key=lambda name: (-self.probability([name]), name)))

    @property
    def considered(self) -> tuple[tuple[Evaluated, float], ...]:
        """Sets that matter to the numbers, with weights that add up to 1."""
        kept = [(one, weight) for one, weight in zip(self.sets, self.weights, strict=True) if weight > _NEGLIGIBLE]
        total = sum(weight for _, weight in kept)
        return tuple((one, weight / total) for one, weight in kept)

    def identified(self) -> tuple[str, ...]:
        """Return the effects whose probability reaches `criteria.NAMED`, most probable first."""
        return tuple(name for name in self.names if self.probability([name]) >= criteria.NAMED)

    def alternatives(self) -> tuple[tuple[str, ...], ...]:
        """Return the smallest groups of effects of which one is present, while no single one is certain."""
        named = frozenset(self.identified())
        # An effect that lacks little has rivals that are rare.
        least = 1.0 - criteria.NAMED
        left = [name for name in self.names if name not in named and self.probability([name]) >= least]
        groups: list[tuple[str, ...]] = []
        while left and self.probability([left[0]]) >= criteria.REPORTED:
            group = [left.pop(0)]
            while self.probability(group) < criteria.NAMED and left:
                most = max(left, key=lambda name: (self.probability([*group, name]), name))
                if self.probability([*group, most]) - self.probability(group) < least / 2.0:
                    break
                group.append(most)
                left.remove(most)
            if len(group) > 1 and self.probability(group) >= criteria.NAMED:
                groups.append(tuple(group))
        return tuple(groups)

    def with_effect(self, name: str) -> Evaluated:
        """Return the best set with an effect, a possible one if there is any."""
        inside = [one for one in self.every.values() if name in one.names]
        return max(inside, key=lambda one: (name in counted(one), not one.objections, one.log_evidence))

    def without(self, name: str) -> Evaluated:
        """Return the best set without an effect."""
        return max((one for one in self.every.values() if name not in one.names), key=lambda one: one.log_evidence)


def counted(one: Evaluated) -> Names:
    """Return the effects of a set but the impossible ones."""
    return one.names - {name for name, _ in one.objections}


def posterior_of(search: SetSearch) -> Posterior:
    """Return the posterior over the sets that a search has found."""
    ratios = {names: residual_ratio(one.fit, search.data) for names, one in search.found.items()}
    found = {names: _explaining(one, ratios) for names, one in search.found.items()}
    possible = [one for one in found.values() if not one.objections]
    best = min(possible, key=lambda one: (-one.log_evidence, sorted(one.names)))
    return over(found, math.sqrt(ratios[best.names]))


def _explaining(one: Evaluated, ratios: Mapping[Names, float]) -> Evaluated:
    """Return a set that leaves more than noise with an objection to each effect without which less is left.

    Such an effect owes its evidence to the discrepancy: it moves the fit away from the data.
    """
    own = ratios[one.names]
    if own < criteria.TEMPERED:
        return one
    known = {name for name, _ in one.objections}
    more = [
        (name, Reason(Code.LEAVES_MORE_THAN_WITHOUT, with_it=math.sqrt(own), without=math.sqrt(ratios[rest])))
        for name in sorted(one.names - known)
        if (rest := one.names - {name}) in ratios and ratios[rest] <= own
    ]
    return replace(one, objections=(*one.objections, *more)) if more else one


def residual_ratio(fit: Fit, data: Whitened) -> float:
    """Return the mean square of what a fit leaves over that of the noise of the groups' means, at least 1."""
    excess = noise = 0.0
    for residual in group_residuals(fit, data):
        excess += float(np.square(residual.rms_mps2()).sum())
        noise += float(residual.variance.sum())
    return 1.0 + excess / noise if noise > 0.0 else 1.0


def over(every: Mapping[Names, Evaluated], temperature: float = 1.0) -> Posterior:
    """Return the posterior over sets of effects, the set without any among them.

    Args:
        every: sets with their evidence.
        temperature: by which the evidence of the data is divided, prior odds excepted: rms of what the best set leaves
            over that of the noise. A model known to be wrong by so much knows that much less (Miller and Dunson 2019,
            coarsened posterior). It is the ratio of rms, not of power, since the discrepancy widens the errors already.
    """
    ordered = sorted(every.values(), key=lambda one: (-one.log_evidence, sorted(one.names)))
    stand_in = math.log(criteria.STAND_IN_ODDS)
    of_set = {one.names: _tempered(one, temperature) for one in ordered}
    scores = np.array([of_set[one.names] + (stand_in if one.objections else 0.0) for one in ordered])
    masses = np.exp(scores - scores.max())
    masses /= masses.sum()
    mass_of = {one.names: float(mass) for one, mass in zip(ordered, masses.tolist(), strict=True)}
    supported = [
        one
        for one in ordered
        if not one.objections
        and all(_probability(every, mass_of, frozenset([name])) >= criteria.REPORTED for name in one.names)
    ]
    own = np.array([of_set[one.names] for one in supported])
    weights = np.exp(own - own.max())
    weights /= weights.sum()
    return Posterior(dict(every), mass_of, tuple(supported), tuple(weights.tolist()), temperature)


def _tempered(one: Evaluated, temperature: float) -> float:
    """Return the log evidence of a set, that of the data divided by the temperature."""
    odds = len(one.names) * math.log(criteria.PRIOR_ODDS)
    return odds + (one.log_evidence - odds) / temperature


def _probability(every: Mapping[Names, Evaluated], masses: Mapping[Names, float], wanted: Names) -> float:
    return min(1.0, sum(mass for names, mass in masses.items() if counted(every[names]) & wanted))
