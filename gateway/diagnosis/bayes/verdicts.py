"""Verdicts on the effects of a posterior: identified, undecided or rejected."""

from collections.abc import Container, Iterator
from dataclasses import dataclass
from typing import Final, Generic

from gateway.core.reasons import Reason
from gateway.diagnosis import criteria
from gateway.diagnosis.bayes.posterior import PosteriorOver, SetT, by_evidence
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.result import Verdict

# Impossible effects listed.
_MAX_LISTED: Final = 4


@dataclass(frozen=True, slots=True)
class Judgement(Generic[SetT]):
    """Verdict on one effect.

    Attributes:
        name: of the effect.
        verdict: the outcome.
        inside: best set with it.
        rivals: the others of its group, where one of them is present and none certain.
        reason: why it was rejected; None otherwise.
        possible: False for an effect whose set is better than all others, but for its impossible value.
    """

    name: str
    verdict: Verdict
    inside: SetT
    rivals: tuple[str, ...] = ()
    reason: Reason | None = None
    possible: bool = True


def judgements(posterior: PosteriorOver[SetT], causes: Container[str] | None = None) -> Iterator[Judgement[SetT]]:
    """Yield the verdict on every effect with evidence: identified, undecided, improbable, impossible.

    Args:
        posterior: over sets of effects.
        causes: names that may be rivals; None for all.
    """
    judged = set(posterior.identified())
    for name in posterior.identified():
        yield Judgement(name, Verdict.NAMED, posterior.with_effect(name))
    for group in posterior.alternatives(causes):
        judged |= set(group)
        for name in group:
            rivals = tuple(rival for rival in group if rival != name)
            yield Judgement(name, Verdict.INDISTINGUISHABLE, posterior.with_effect(name), rivals)
    for name in posterior.names:
        probability = posterior.probability([name])
        if name not in judged and probability >= criteria.LISTED:
            judged.add(name)
            reason = Reason(DiagnosisCode.PROBABILITY_TOO_LOW, probability=probability, needed=criteria.NAMED)
            yield Judgement(name, Verdict.REFUSED, posterior.with_effect(name), reason=reason)
    impossible_sets = sorted(
        (effect_set for effect_set in posterior.every.values() if effect_set.objections), key=by_evidence
    )
    listed = 0
    for effect_set in impossible_sets:
        if effect_set.log_evidence < posterior.best.log_evidence or listed >= _MAX_LISTED:
            return
        for name, reason in effect_set.objections:
            if name not in judged:
                judged.add(name)
                listed += 1
                yield Judgement(name, Verdict.REFUSED, effect_set, reason=reason, possible=False)
