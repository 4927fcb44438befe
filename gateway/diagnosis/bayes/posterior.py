"""Posterior over sets of effects: the one place that decides which effects are identified."""

import math
from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Final, Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from gateway.core.reasons import Reason
from gateway.diagnosis import criteria

Names = frozenset[str]

# Weight below which a set changes no number.
_NEGLIGIBLE: Final = 1e-4


class ByPart(NamedTuple):
    """A figure of the wheel's plane and of the lateral axis."""

    plane: float = 1.0
    lateral: float = 1.0


class Weighed(Protocol):
    """A set of effects with its evidence, whatever part of the signal it is of."""

    @property
    def names(self) -> Names:
        """Names of its effects."""
        ...

    @property
    def log_evidence(self) -> float:
        """Log evidence of the data, prior odds included, up to a constant of the data."""
        ...

    @property
    def objections(self) -> tuple[tuple[str, Reason], ...]:
        """The effects whose values are impossible, with the reason."""
        ...


SetT = TypeVar("SetT", bound=Weighed)


@dataclass(frozen=True)
class PosteriorOver(Generic[SetT]):
    """Sets of effects with their probabilities.

    An effect with impossible values stands for something that the catalogue lacks: its set keeps its probability, and
    counts for the other effects in it, but not for that one. Nor do these rest on impossible sets alone: their
    probability among the possible sets must be as high.

    Attributes:
        every: all sets with an evidence.
        masses: probability of each; they add up to 1.
        possible: probability of each without impossible values among these sets; they add up to 1.
        sets: possible sets whose effects are all supported (`criteria.SUPPORTED`), most probable first.
        weights: probability of each among these; they add up to 1.
        temperatures: by which the evidence of plane and lateral axis was divided, since the best set leaves more than
            noise.
        optima: other optima of the best set, by the effect whose shape is another.
    """

    every: Mapping[Names, SetT]
    masses: Mapping[Names, float]
    possible: Mapping[Names, float]
    sets: tuple[SetT, ...]
    weights: tuple[float, ...]
    temperatures: ByPart = field(default_factory=ByPart)
    optima: Mapping[str, tuple[SetT, ...]] = field(default_factory=dict)

    @property
    def best(self) -> SetT:
        """The most probable possible set."""
        return self.sets[0]

    @property
    def baseline(self) -> SetT:
        """The set without effects."""
        return self.every[frozenset()]

    @property
    def impossible(self) -> SetT | None:
        """The most probable of all sets if its values are impossible: what it stands for moves the numbers too."""
        names = max(self.masses, key=lambda names: (self.masses[names], sorted(names)))
        return self.every[names] if self.every[names].objections else None

    def probability(self, names: Iterable[str]) -> float:
        """Return the probability that at least one of these effects is present."""
        return _probability(self.every, self.masses, self.possible, frozenset(names))

    def log_odds(self, name: str) -> float:
        """Return the logarithm of the odds that an effect is present, from the best sets with and without it."""
        with_it = [effect_set.log_evidence for effect_set in self.every.values() if name in counted(effect_set)]
        without = [effect_set.log_evidence for effect_set in self.every.values() if name not in counted(effect_set)]
        return max(with_it) - max(without) if with_it and without else math.nan

    @property
    def names(self) -> tuple[str, ...]:
        """Effects of any possible set, most probable first."""
        names = {name for effect_set in self.every.values() for name in counted(effect_set)}
        return tuple(sorted(names, key=lambda name: (-self.probability([name]), name)))

    @property
    def considered(self) -> tuple[tuple[SetT, float], ...]:
        """Sets that matter to the numbers, with weights that add up to 1; sets with other optima share theirs.

        The odds of an effect's optima are those in the best set.
        """
        weighted = list(zip(self.sets, self.weights, strict=True))
        for name, others in self.optima.items():
            odds = [math.exp(effect_set.log_evidence - self.best.log_evidence) for effect_set in others]
            total = sum(weight for effect_set, weight in weighted if name in effect_set.names)
            share = 1.0 / (1.0 + sum(odds))
            weighted = [
                (effect_set, weight * share if name in effect_set.names else weight) for effect_set, weight in weighted
            ]
            weighted += [(effect_set, total * share * ratio) for effect_set, ratio in zip(others, odds, strict=True)]
        weighted = [(effect_set, weight) for effect_set, weight in weighted if weight > _NEGLIGIBLE]
        total = sum(weight for _, weight in weighted)
        return tuple((effect_set, weight / total) for effect_set, weight in weighted)

    def identified(self) -> tuple[str, ...]:
        """Return the effects whose probability reaches `criteria.NAMED`, most probable first."""
        return tuple(name for name in self.names if self.probability([name]) >= criteria.NAMED)

    def alternatives(self, causes: Container[str] | None = None) -> tuple[tuple[str, ...], ...]:
        """Return the smallest groups of effects of which one is present, while no single one is certain.

        Args:
            causes: names that may be in a group; None for all.
        """
        identified = frozenset(self.identified())
        # An effect that lacks little has rivals that are rare.
        threshold = 1.0 - criteria.NAMED
        remaining = [
            name
            for name in self.names
            if name not in identified and (causes is None or name in causes) and self.probability([name]) >= threshold
        ]
        groups: list[tuple[str, ...]] = []
        while remaining and self.probability([remaining[0]]) >= criteria.LISTED:
            group = [remaining.pop(0)]
            while self.probability(group) < criteria.NAMED and remaining:
                candidate = max(remaining, key=lambda name: (self.probability([*group, name]), name))
                if self.probability([*group, candidate]) - self.probability(group) < threshold / 2.0:
                    break
                group.append(candidate)
                remaining.remove(candidate)
            if len(group) > 1 and self.probability(group) >= criteria.NAMED:
                groups.append(tuple(group))
        return tuple(groups)

    def with_effect(self, name: str) -> SetT:
        """Return the best set with an effect, a possible one if there is any."""
        inside = [effect_set for effect_set in self.every.values() if name in effect_set.names]
        return max(
            inside,
            key=lambda effect_set: (name in counted(effect_set), not effect_set.objections, effect_set.log_evidence),
        )

    def without(self, name: str) -> SetT:
        """Return the best set without an effect."""
        return max(
            (effect_set for effect_set in self.every.values() if name not in effect_set.names),
            key=lambda effect_set: effect_set.log_evidence,
        )


def by_evidence(effect_set: Weighed) -> tuple[float, list[str]]:
    """Return the key that sorts sets by evidence, the highest first, and by name where it is equal."""
    return -effect_set.log_evidence, sorted(effect_set.names)


def counted(effect_set: Weighed) -> Names:
    """Return the effects of a set but the impossible ones."""
    return effect_set.names - {name for name, _ in effect_set.objections}


def over(every: Mapping[Names, SetT]) -> PosteriorOver[SetT]:
    """Return the posterior over sets of effects, the set without any among them."""
    ordered = sorted(every.values(), key=by_evidence)
    stand_in = math.log(criteria.STAND_IN_ODDS)
    mass_of = _shares(
        {
            effect_set.names: effect_set.log_evidence + (stand_in if effect_set.objections else 0.0)
            for effect_set in ordered
        }
    )
    possible = _shares(
        {effect_set.names: effect_set.log_evidence for effect_set in ordered if not effect_set.objections}
    )
    supported = [
        effect_set
        for effect_set in ordered
        if not effect_set.objections
        and all(
            _probability(every, mass_of, possible, frozenset([name])) >= criteria.SUPPORTED for name in effect_set.names
        )
    ]
    weights = _shares({effect_set.names: effect_set.log_evidence for effect_set in supported})
    return PosteriorOver(dict(every), mass_of, possible, tuple(supported), tuple(weights.values()))


def _shares(logs: Mapping[Names, float]) -> dict[Names, float]:
    """Return the shares of sets in their sum, from logarithms."""
    shares = np.exp(np.array(list(logs.values())) - max(logs.values()))
    return dict(zip(logs, (shares / shares.sum()).tolist(), strict=True))


def _probability(
    sets: Mapping[Names, Weighed], masses: Mapping[Names, float], possible: Mapping[Names, float], queried: Names
) -> float:
    """Return the smaller probability of those over all sets and over the possible ones."""
    in_all = sum(mass for names, mass in masses.items() if counted(sets[names]) & queried)
    in_possible = sum(mass for names, mass in possible.items() if names & queried)
    return min(1.0, in_all, in_possible)
