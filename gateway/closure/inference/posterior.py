"""Posterior over sets of effects: the one place that decides which effects are identified."""

import math
from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final, Generic, Protocol, TypeAlias, TypeVar

import numpy as np

from gateway.closure.inference import criteria
from gateway.closure.inference.likelihood import Whitened
from gateway.closure.inference.residual import ByPart, ratios_by_part
from gateway.closure.inference.set_evidence import Evaluated
from gateway.closure.inference.set_search import Names, SetSearch
from gateway.reasons import Code, Reason

# Weight below which a set changes no number.
_NEGLIGIBLE: Final = 1e-4


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
    result = {names: _explaining(evaluated, ratios) for names, evaluated in sets.items()}
    possible = [evaluated for evaluated in result.values() if not evaluated.objections]
    best = min(possible, key=lambda evaluated: (-evaluated.log_evidence, sorted(evaluated.names)))
    return result, ByPart(*map(math.sqrt, ratios[best.names]))


def _explaining(evaluated: Evaluated, ratios: Mapping[Names, ByPart]) -> Evaluated:
    """Return a set that leaves more than noise with an objection to each effect that others need not.

    An effect explains nothing if the set without it leaves less of the plane or of the lateral axis, or if a set of no
    more effects without it leaves half, and no more of the other part. It then owes its evidence to the discrepancy: it
    moves the fit away from the data.
    """
    set_ratios = ratios[evaluated.names]
    if max(set_ratios) < criteria.TEMPERED:
        return evaluated
    objected = {name for name, _ in evaluated.objections}
    half = ByPart(*(1.0 + criteria.FAR_LESS * (each - 1.0) for each in set_ratios))
    more = []
    for name in sorted(evaluated.names - objected):
        bare = evaluated.names - {name}
        better = [ratios[bare]] if bare in ratios and _leaves_less(ratios[bare], set_ratios, set_ratios) else []
        others = [ratio for names, ratio in ratios.items() if name not in names and len(names) <= len(evaluated.names)]
        better += [each for each in others if _leaves_less(each, half, set_ratios)]
        if better:
            least = min(better, key=sum)
            part = max(range(len(set_ratios)), key=lambda index: set_ratios[index] - least[index])
            reason = Reason(
                Code.LEAVES_MORE_THAN_WITHOUT, with_it=math.sqrt(set_ratios[part]), without=math.sqrt(least[part])
            )
            more.append((name, reason))
    return replace(evaluated, objections=(*evaluated.objections, *more)) if more else evaluated


def _leaves_less(other: ByPart, limits: ByPart, set_ratios: ByPart) -> bool:
    """Return whether another set is within the limit of a part above noise, and leaves no more of the others."""
    below = any(
        other_ratio <= limit
        for other_ratio, limit, set_ratio in zip(other, limits, set_ratios, strict=True)
        if set_ratio >= criteria.TEMPERED
    )
    share = 1.0 + criteria.LEAVES_THE_SAME
    return below and all(
        other_ratio - 1.0 <= share * (set_ratio - 1.0) + criteria.LEAVES_THE_SAME
        for other_ratio, set_ratio in zip(other, set_ratios, strict=True)
    )


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
            weighted += [(effect_set, total * share * each) for effect_set, each in zip(others, odds, strict=True)]
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
        named = frozenset(self.identified())
        # An effect that lacks little has rivals that are rare.
        least = 1.0 - criteria.NAMED
        remaining = [
            name
            for name in self.names
            if name not in named and (causes is None or name in causes) and self.probability([name]) >= least
        ]
        groups: list[tuple[str, ...]] = []
        while remaining and self.probability([remaining[0]]) >= criteria.LISTED:
            group = [remaining.pop(0)]
            while self.probability(group) < criteria.NAMED and remaining:
                most = max(remaining, key=lambda name: (self.probability([*group, name]), name))
                if self.probability([*group, most]) - self.probability(group) < least / 2.0:
                    break
                group.append(most)
                remaining.remove(most)
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


Posterior: TypeAlias = PosteriorOver[Evaluated]
"""Posterior over sets of effects that are locked to the wheel angle."""


def counted(effect_set: Weighed) -> Names:
    """Return the effects of a set but the impossible ones."""
    return effect_set.names - {name for name, _ in effect_set.objections}


def posterior_of(search: SetSearch) -> Posterior:
    """Return the posterior over the sets that a search has found."""
    sets, temperatures = doubted_sets(search.evaluations, search.data)
    posterior = over({names: evaluated.tempered(*temperatures) for names, evaluated in sets.items()})
    possible = {
        name: tuple(evaluated.tempered(*temperatures) for evaluated in each if not evaluated.objections)
        for name, each in (search.optima.items() if posterior.best.names == search.best.names else ())
    }
    return replace(posterior, temperatures=temperatures, optima=possible)


def over(every: Mapping[Names, SetT]) -> PosteriorOver[SetT]:
    """Return the posterior over sets of effects, the set without any among them."""
    ordered = sorted(every.values(), key=lambda effect_set: (-effect_set.log_evidence, sorted(effect_set.names)))
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
    every: Mapping[Names, Weighed], masses: Mapping[Names, float], possible: Mapping[Names, float], wanted: Names
) -> float:
    """Return the smaller probability of those over all sets and over the possible ones."""
    in_all = sum(mass for names, mass in masses.items() if counted(every[names]) & wanted)
    in_possible = sum(mass for names, mass in possible.items() if names & wanted)
    return min(1.0, in_all, in_possible)
