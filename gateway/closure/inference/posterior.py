"""Posterior over sets of effects: the one place that decides which effects are identified."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.closure.inference import criteria
from gateway.closure.inference.set_evidence import Evaluated
from gateway.closure.inference.set_search import Names, SetSearch

# Weight below which a set changes no number.
_NEGLIGIBLE: Final = 1e-4


@dataclass(frozen=True)
class Posterior:
    """Sets of effects with their probabilities.

    Attributes:
        sets: possible sets, most probable first.
        weights: probability of each; they add up to 1.
        baseline: the set without effects.
        every: all sets with an evidence, impossible ones included.
    """

    sets: tuple[Evaluated, ...]
    weights: tuple[float, ...]
    baseline: Evaluated
    every: Mapping[Names, Evaluated]

    @property
    def best(self) -> Evaluated:
        """The most probable set."""
        return self.sets[0]

    def probability(self, names: Iterable[str]) -> float:
        """Return the probability that at least one of these effects is present."""
        wanted = frozenset(names)
        return min(1.0, sum(weight for one, weight in self._weighted() if one.names & wanted))

    def log_odds(self, name: str) -> float:
        """Return the logarithm of the odds that an effect is present, from the best sets with and without it."""
        with_it = [one.score for one in self.sets if name in one.names]
        without = [one.score for one in self.every.values() if name not in one.names]
        if not with_it or not without or not math.isfinite(max(without)):
            return math.nan
        return max(with_it) - max(without)

    @property
    def names(self) -> tuple[str, ...]:
        """Effects of any possible set, most probable first."""
        found = {name for one in self.sets for name in one.names}
        return tuple(sorted(found, key=lambda name: (-self.probability([name]), name)))

    @property
    def considered(self) -> tuple[tuple[Evaluated, float], ...]:
        """Sets that matter to the numbers, with weights that add up to 1."""
        kept = [(one, weight) for one, weight in self._weighted() if weight > _NEGLIGIBLE]
        total = sum(weight for _, weight in kept)
        return tuple((one, weight / total) for one, weight in kept)

    def identified(self) -> tuple[str, ...]:
        """Return the effects whose probability reaches `criteria.NAMED`, most probable first."""
        return tuple(name for name in self.names if self.probability([name]) >= criteria.NAMED)

    def alternatives(self) -> tuple[tuple[str, ...], ...]:
        """Return the smallest groups of effects of which one is present, while no single one is certain."""
        named = frozenset(self.identified())
        left = [name for name in self.names if name not in named and self.probability([name]) >= criteria.REPORTED]
        groups: list[tuple[str, ...]] = []
        while left:
            group = [left.pop(0)]
            while self.probability(group) < criteria.NAMED and left:
                most = max(left, key=lambda name: (self.probability([*group, name]), name))
                if self.probability([*group, most]) - self.probability(group) < criteria.REPORTED / 2.0:
                    break
                group.append(most)
                left.remove(most)
            if len(group) > 1 and self.probability(group) >= criteria.NAMED:
                groups.append(tuple(group))
        return tuple(groups)

    def without(self, name: str) -> Evaluated:
        """Return the best set without an effect."""
        return max((one for one in self.every.values() if name not in one.names), key=lambda one: one.score)

    def _weighted(self) -> zip[tuple[Evaluated, float]]:
        return zip(self.sets, self.weights, strict=True)


def posterior_of(search: SetSearch) -> Posterior:
    """Return the posterior over the sets that a search has found."""
    possible = sorted(
        (one for one in search.found.values() if one.objection is None),
        key=lambda one: (-one.log_evidence, sorted(one.names)),
    )
    scores = np.array([one.log_evidence for one in possible])
    weights = np.exp(scores - scores.max())
    weights /= weights.sum()
    return Posterior(tuple(possible), tuple(weights.tolist()), search.found[frozenset()], dict(search.found))
