"""Search of the sets of effects with the highest evidence.

Proposals come from chains without a discrepancy, which add the effect of the largest gain each time. All sets on the
chains, and those near them, get their evidence with a discrepancy. From the best set, every effect is removed, added or
exchanged in turn until no set is better; likewise from its rivals, which lack one of its effects. The discrepancy is
then concentrated at orders, bands of orders or places while the evidence calls for it, and the best set fitted from
other shapes of its effects. Sets are visited in an order that depends on evidence and name alone.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gateway.core.worker_pool import Workers
from gateway.diagnosis import criteria
from gateway.diagnosis.angle.candidate_trial import Trial, refit, start_of
from gateway.diagnosis.angle.discrepancy import Applied, Discrepancy
from gateway.diagnosis.angle.fit import Fit, FitFailedError, fit_model, linearised
from gateway.diagnosis.angle.likelihood import Whitened
from gateway.diagnosis.angle.residual import ratios_by_part, residual_ratio
from gateway.diagnosis.angle.set_evidence import (
    Evaluated,
    evaluate,
    log_evidence,
    log_odds,
    log_prior_odds,
    names_of,
    settled,
)
from gateway.diagnosis.bayes.posterior import Names, by_evidence
from gateway.diagnosis.data.campaign_data import Campaign
from gateway.diagnosis.data.condition_groups import far_apart, has_other_conditions, most_informative
from gateway.diagnosis.effects.catalogue import corrections
from gateway.diagnosis.effects.local_effects import LocalChange
from gateway.diagnosis.model.baseline import Core, NoShapeError
from gateway.diagnosis.model.closure_model import AngleEffect, ClosureModel
from gateway.diagnosis.search.candidate_scan import Helpers, Scan
from gateway.diagnosis.search.discrepancy_concentration import Evident, most_evident
from gateway.diagnosis.search.other_optima import other_optima
from gateway.diagnosis.search.profile_scan import ProfileScan, fitted_with
from gateway.diagnosis.search.rival_effects import is_taken, rivals_of


@dataclass
class SetSearch:
    """Sets of effects evaluated on one campaign.

    Attributes:
        campaign: conditions.
        core: baseline model.
        data: whitened.
        effects: candidates by name.
        discrepancy: of the campaign.
        expired: True when the time that the search may take is over.
        on_step: called with the number of effects of the set that is being worked on.
        helpers: processes that share the trials; the result does not depend on their number.
        evaluations: sets with their evidence.
        optima: other optima of the best set, by the effect whose shape is another.
        rejected: sets without an evidence, since a fit failed.
        complete: False when the search ended because its time was over.
        promises: for every set of a chain, the gain of log evidence that each effect promised without a discrepancy.
    """

    campaign: Campaign
    core: Core
    data: Whitened
    effects: Mapping[str, AngleEffect]
    discrepancy: Discrepancy
    expired: Callable[[], bool] = lambda: False
    on_step: Callable[[int], None] = lambda _: None
    helpers: Helpers = field(default_factory=lambda: Helpers(Workers()))
    evaluations: dict[Names, Evaluated] = field(default_factory=dict)
    optima: dict[str, tuple[Evaluated, ...]] = field(default_factory=dict)
    rejected: set[Names] = field(default_factory=set)
    complete: bool = True
    promises: dict[Names, dict[str, float]] = field(default_factory=dict)
    _scanned: tuple[int, ...] = ()
    _begun: list[Scan] = field(default_factory=list)
    _scanned_places: set[Names] = field(default_factory=set)
    _at_rest: dict[Names, Evaluated] = field(default_factory=dict)

    def __post_init__(self) -> None:
        # What the equations of the baseline model lack. Each alone is biased and promises little.
        self._corrections = corrections(self.core.model)
        self.helpers.begin(self.campaign, self.core, self.data, self.effects, self.discrepancy)

    def run(self, start: Fit) -> Evaluated:
        """Search from the baseline model's fit; return the best set."""
        groups = self.campaign.groups
        self._scanned = tuple(
            far_apart(
                most_informative(
                    np.array([group.recording for group in groups]),
                    np.array([group.state for group in groups]),
                    np.array([group.conditions.omega_radps for group in groups]),
                    np.array([group.revolutions for group in groups], dtype=np.float64),
                    criteria.SCANNED_GROUPS,
                ),
                [group.conditions for group in groups],
                criteria.MOST_SCANNED,
            ).tolist()
        )
        if not self._corrections:
            self._start_scan(start, self.effects)
        self._evaluate(start, None)
        corrected = self._corrected(start)
        self._chains(corrected)
        expected = self._with_expected(corrected) if self._expected_in_question() else None
        if expected is not None:
            self._chains(expected)
        self._climb()
        while not self._stop() and (self._try_local() or self._concentrate() or self._converge() or self._try_optima()):
            self._climb()
        return self.best

    def _converge_set(self, names: Names) -> None:
        """Let a set rest where much is left; near the noise all sets do."""
        evaluated = self.evaluations[names]
        if self._at_rest.get(names) is evaluated or self._at_noise(evaluated.fit):
            return
        converged = self._at_rest[names] = self.evaluations[names] = settled(evaluated, self.data)
        if converged is not self.best and converged.fit.applied is not None:
            converged.fit.applied.release()

    def _converge_best(self) -> None:
        """Let the best set rest, and the one that is then the best, until it stays so.

        A set that is taken for the best before it rests leads the search where the rounding of the machine decides.
        """
        while not self._stop():
            best = self.best
            self._converge_set(best.names)
            if self.best.names == best.names:
                return

    def _converge(self) -> bool:
        """Let the sets that matter rest; return whether another one is then the best."""
        best = self.best
        threshold = best.log_evidence + math.log(criteria.SUPPORTED)
        for names in sorted(self.evaluations, key=lambda names: (-self.evaluations[names].log_evidence, sorted(names))):
            if self._stop():
                break
            if self.evaluations[names].log_evidence >= threshold or not names:
                self._converge_set(names)
        self._converge_best()
        return self.best.names != best.names

    def _climb(self) -> None:
        """Evaluate the neighbours of the best set until it is the best of them; likewise of its rivals."""
        done: list[Evaluated] = []
        expanded: list[Evaluated] = []
        while not self._stop():
            self._converge_best()
            leader = next(
                (evaluated for evaluated in self._leaders() if not any(evaluated is climbed for climbed in done)), None
            )
            if leader is not None:
                worth = self._is_worth_climbing(leader, done)
                done.append(leader)
                if worth and not self._refit_from_priors(leader):
                    self._neighbours(leader)
                continue
            rival = next(
                (evaluated for evaluated in self._rivals() if not any(evaluated is parent for parent in expanded)), None
            )
            if rival is None:
                return
            expanded.append(rival)
            if len(rival.names) < criteria.MOST_EFFECTS:
                threshold = self.best.log_evidence - criteria.WITHIN
                self._try_additions(rival.fit, rival, self._additions(rival.fit, threshold), threshold)

    def _is_worth_climbing(self, leader: Evaluated, done: Sequence[Evaluated]) -> bool:
        """Return whether the neighbours of a set are worth the work after those of others.

        Where much is left, evidence counts little, and sets that differ by `criteria.WORTH_CLIMBING` are as probable.
        """
        ratios = ratios_by_part(self.best.fit, self.data)
        expected = frozenset(effect.name for effect in self._expected)
        if max(ratios) < criteria.TEMPERED**2 or leader.names & expected not in {
            evaluated.names & expected for evaluated in done
        }:
            return True
        plane, lateral = map(math.sqrt, ratios)
        highest = max(evaluated.tempered(plane, lateral).log_evidence for evaluated in done)
        return leader.tempered(plane, lateral).log_evidence > highest + criteria.WORTH_CLIMBING

    def _rivals(self) -> Iterator[Evaluated]:
        """Yield the best set without each effect of the best one.

        With one more effect it may explain the same: two effects may do together what a flexible one does alone.
        """
        threshold = self.best.log_evidence - criteria.WORTH_GROWTH
        for name in sorted(self.best.names):
            without = [evaluated for names, evaluated in self.evaluations.items() if name not in names]
            if without and (rival := min(without, key=by_evidence)).log_evidence > threshold:
                yield rival

    def _leaders(self) -> Iterator[Evaluated]:
        """Yield the best set, its rivals, and the best ones with and without the effects that are to be expected.

        An effect that takes the place of an expected one and of another beside it would otherwise never be compared
        with both.
        """
        yield self.best
        threshold = self.best.log_evidence - criteria.WORTH_WORK
        yield from (evaluated for evaluated in self._rivals() if evaluated.log_evidence > threshold)
        expected = frozenset(effect.name for effect in self._expected)
        if not expected:
            return
        for included in (expected, frozenset[str]()):
            matching = [evaluated for names, evaluated in self.evaluations.items() if names & expected == included]
            if matching and (leader := min(matching, key=by_evidence)).log_evidence > threshold:
                yield leader

    def _concentrate(self) -> bool:
        """Concentrate the discrepancy at one more place if the best set calls for it, or one that is better with it.

        All sets get their evidence anew: an effect may have stood for what happens there.
        """
        call = self.called_for()
        if call is None:
            return False
        caller, evident = call
        applied = caller.fit.applied
        assert applied is not None
        previous, previous_discrepancy = self.evaluations, self.discrepancy
        concentrated = previous_discrepancy.concentrated(evident.concentration)
        try:
            initial = concentrated.applied(np.concatenate([applied.amplitudes, evident.amplitudes[:, :, None]], axis=2))
        except np.linalg.LinAlgError:
            return False
        self.evaluations, self.discrepancy = {}, concentrated
        for evaluated in sorted(previous.values(), key=by_evidence):
            # Even without time left, the best set and the empty one are needed.
            if not (self.evaluations and evaluated.names and self._stop()):
                self._evaluate(evaluated.fit, self.best.fit.applied if self.evaluations else initial)
        if frozenset() not in self.evaluations:
            self.evaluations, self.discrepancy = previous, previous_discrepancy
            return False
        return True

    def _try_local(self) -> bool:
        """Try changes at one place of the wheel beside the best set; return whether a set with one is better.

        A chain would have to try every place of each.
        """
        best = self.best
        changes = [
            effect
            for effect in self.effects.values()
            if isinstance(effect, LocalChange) and not is_taken(effect, best.fit.model.effects)
        ]
        applied = best.fit.applied
        if best.names in self._scanned_places or not changes or applied is None:
            return False
        groups = self.campaign.groups
        testable = any(has_other_conditions(groups, group.recording) for group in groups)
        # Without recordings of other conditions nothing tells it from what resembles it; a law may be a clue there.
        if not testable or len(best.names) >= criteria.MOST_EFFECTS:
            return False
        self._scanned_places.add(best.names)
        if residual_ratio(best.fit, self.data) - 1.0 < criteria.WORTH_A_SCAN:
            return False
        self.on_step(len(best.names) + 1)
        try:
            promises = ProfileScan(best.fit).promises(changes)
        except (NoShapeError, np.linalg.LinAlgError):
            return False
        rival: Fit | None = None
        for promise in promises[: criteria.REFITTED]:
            if promise.gain < max(criteria.LOOKED_AT, criteria.PROMISE_SHARE * promises[0].gain) or self._stop():
                break
            if (fit := fitted_with(promise, best.fit, self.data, rival)) is not None:
                rival = fit if rival is None or fit.misfit < rival.misfit else rival
                self._evaluate(fit, self.discrepancy.applied(criteria.SMALLER_DISCREPANCY * applied.amplitudes))
        return self.best is not best

    def _try_optima(self) -> bool:
        """Look for other optima of the best set; return whether one is better, which is then the set's own."""
        best, self.optima = self.best, {}
        is_flat = not self._at_noise(best.fit)
        for effect in sorted(best.fit.model.effects, key=lambda effect: effect.name):
            self.on_step(len(best.names))
            reduced = None if self._stop() else self._reduced(best, effect)
            optima = [] if reduced is None else other_optima(best, reduced, effect, self._scanned, at_rest=is_flat)
            if optima and optima[0].log_evidence > best.log_evidence:
                # Those found so far are of the worse one.
                self.evaluations[best.names], self.optima = optima[0], {}
                return True
            self.optima[effect.name] = tuple(optima)
        return False

    def called_for(self) -> tuple[Evaluated, Evident] | None:
        """Return the concentration that the evidence asks for, and the set that asks for it.

        Where much is left, one with which the best set can do without one of its effects comes first. An effect that is
        there is needed beside it as well.
        """
        best = self.best
        if len(self.discrepancy.concentrations) >= criteria.MOST_CONCENTRATED:
            return None
        if not self._at_noise(best.fit):
            smaller = [
                self.evaluations[names] for name in best.names if (names := best.names - {name}) in self.evaluations
            ]
            calls = [(evaluated, evident) for evaluated in smaller if (evident := self._evident(evaluated)) is not None]
            worth = {
                evaluated.names: evaluated.log_evidence + evident.gain + evident.log_odds
                for evaluated, evident in calls
            }
            most_urgent = max(calls, key=lambda pair: (worth[pair[0].names], sorted(pair[0].names)), default=None)
            if most_urgent is not None and worth[most_urgent[0].names] > best.log_evidence:
                return most_urgent
        evident = self._evident(best)
        return None if evident is None else (best, evident)

    def _evident(self, evaluated: Evaluated) -> Evident | None:
        return None if evaluated.fit.applied is None else most_evident(evaluated.fit, self.data)

    @property
    def best(self) -> Evaluated:
        """The set of the highest evidence, impossible ones included; of two alike, the one first by name."""
        return min(self.evaluations.values(), key=by_evidence)

    @property
    def untried(self) -> tuple[str, ...]:
        """Effects that were tried beside no set, or all places of which were not."""
        tried = {name for promised in self.promises.values() for name in promised}
        tried |= {name for names in self.evaluations for name in names}
        placed = bool(self._scanned_places)
        return tuple(
            name
            for name, effect in self.effects.items()
            if name not in tried and not (placed and isinstance(effect, LocalChange))
        )

    def untried_rivals(self, name: str) -> tuple[str, ...]:
        """Return the effects that may take the place of one of the best set and were not tried there."""
        best = self.best
        without = [evaluated.log_evidence for names, evaluated in self.evaluations.items() if name not in names]
        worth = best.log_evidence - max(without, default=-math.inf)
        remaining, tried = best.names - {name}, self.evaluations.keys() | self.rejected
        # Those beside it may do without it.
        beside: tuple[str, ...] = () if remaining in tried else tuple(sorted(remaining))
        return beside + tuple(
            rival
            for rival in rivals_of(name, worth, self.effects, list(self.promises.values()))
            if rival not in best.names
            and not isinstance(self.effects[rival], LocalChange)
            and remaining | {rival} not in tried
        )

    @property
    def _expected(self) -> tuple[AngleEffect, ...]:
        conditions = tuple(group.conditions for group in self.campaign.groups)
        return tuple(effect for effect in self.effects.values() if effect.expected(conditions))

    def _stop(self) -> bool:
        if self.expired():
            self.complete = False
        return not self.complete

    def _at_noise(self, fit: Fit) -> bool:
        return fit.misfit < criteria.AT_NOISE * self.data.size

    def _evaluate(self, fit: Fit, initial: Applied | None) -> Evaluated | None:
        names = names_of(fit)
        if names in self.rejected:
            return None
        if names not in self.evaluations:
            self.on_step(len(names))
            previous_best = self.best if self.evaluations else None
            try:
                min_evidence = -math.inf if previous_best is None else previous_best.log_evidence - criteria.WORTH_WORK
                self.evaluations[names] = evaluate(fit, self.data, self.discrepancy, initial, min_evidence)
            except (FitFailedError, np.linalg.LinAlgError):
                self.rejected.add(names)
                return None
            # Others are seldom needed, and a hundred sets would take gigabytes.
            for evaluated in (previous_best, self.evaluations[names]):
                if evaluated is not None and evaluated is not self.best and evaluated.fit.applied is not None:
                    evaluated.fit.applied.release()
        return self.evaluations[names]

    def _evaluate_anew(self, fit: Fit, initial: Applied | None) -> None:
        """Evaluate a set, also a known one, and keep the better optimum.

        From a worse one, the effect that the set lacks would get the credit for leading out of it.
        """
        names = names_of(fit)
        previous = self.evaluations.get(names)
        self.evaluations.pop(names, None)
        evaluated = self._evaluate(fit, initial)
        if previous is not None and (evaluated is None or evaluated.log_evidence < previous.log_evidence):
            self.evaluations[names] = previous
            self.rejected.discard(names)

    def _corrected(self, start: Fit) -> Fit:
        """Return the fit with all corrections of the baseline model if it is the better one."""
        effects = tuple(self.effects[name] for name in self._corrections if name in self.effects)
        if not effects:
            return start
        self.on_step(len(effects))
        model = ClosureModel(self.campaign, self.core, effects)
        vector, _ = model.priors()
        for effect in effects:
            vector[model.layout.effect(effect.name)] = effect.start_values[0]
        try:
            fit = fit_model(model, self.data, vector, from_afar=True)
        except FitFailedError:
            return start
        evaluated = self._evaluate(fit, None)
        return (
            fit
            if evaluated is not None and evaluated.log_evidence > self.evaluations[frozenset()].log_evidence
            else start
        )

    def _expected_in_question(self) -> bool:
        """Return whether an effect that is to be expected is missing in the best set, or in one nearly as good."""
        expected = frozenset(effect.name for effect in self._expected)
        threshold = self.best.log_evidence - criteria.WORTH_WORK
        return any(
            entry.log_evidence > threshold and not expected <= entry.names for entry in self.evaluations.values()
        )

    def _with_expected(self, start: Fit) -> Fit | None:
        """Return the fit with all effects that are to be expected; None without any."""
        effects = tuple(effect for effect in self._expected if not is_taken(effect, start.model.effects))
        if not effects or self._stop():
            return None
        conditions = tuple(group.conditions for group in self.campaign.groups)
        self.on_step(len(effects))
        model = ClosureModel(self.campaign, self.core, (*start.model.effects, *effects))
        vector = start.model.layout.moved(start.vector, model.layout)
        for effect in effects:
            vector[model.layout.effect(effect.name)] = effect.starts(conditions)[0]
        try:
            fit = fit_model(model, self.data, vector, from_afar=True)
        except FitFailedError:
            return None
        self._evaluate(fit, None)
        return fit

    def _chains(self, start: Fit) -> None:
        """Add the best effects one after the other, without a discrepancy; from the best first ones."""
        if self._stop():
            return
        chain_starts: set[Names] = set()
        candidates = self._fitted(start)
        for branch in candidates[: criteria.BRANCHES]:
            if self._at_noise(self.best.fit):
                break
            self._chain(branch, chain_starts)
        for candidate in candidates:
            if self._stop():
                return
            self._evaluate_extension(candidate)

    def _chain(self, fit: Fit, extended_sets: set[Names]) -> None:
        """Add the best effects to a set one after the other until none is left, or no more evidence comes of it.

        Args:
            fit: of the first set.
            extended_sets: sets from which a chain went on; those of this one are added.
        """
        highest, stalled = -math.inf, 0
        while not self._stop() and names_of(fit) not in extended_sets:
            extended_sets.add(names_of(fit))
            is_full = len(fit.model.effects) >= criteria.MOST_EFFECTS
            if not is_full:
                self._start_scan(fit, self.effects)
            is_better = self._evaluate_extension(fit)
            evaluated = self.evaluations.get(names_of(fit))
            stalled = 0 if evaluated is not None and evaluated.log_evidence > highest else stalled + 1
            highest = highest if evaluated is None else max(highest, evaluated.log_evidence)
            near_best = highest > self.best.log_evidence - criteria.WORTH_WORK
            if is_full or stalled >= (criteria.STALLED if near_best else 1) or (self._at_noise(fit) and not is_better):
                return
            candidates = self._fitted(fit)
            for runner_up in candidates[1:]:
                self._evaluate_extension(runner_up)
            if not candidates:
                return
            fit = candidates[0]

    def _evaluate_extension(self, fit: Fit) -> bool:
        """Evaluate a set of a chain; return whether it is better than the one that it extends."""
        names = names_of(fit)
        smaller = [candidate for effect_names, candidate in self.evaluations.items() if effect_names < names]
        parent = max(smaller, key=lambda candidate: (len(candidate.names), sorted(candidate.names)))
        evaluated = self._evaluate(fit, parent.fit.applied)
        return evaluated is not None and evaluated.log_evidence > parent.log_evidence

    def _fitted(self, fit: Fit) -> list[Fit]:
        """Return fits of a set with one more effect, by gain without a discrepancy; none without a gain."""
        self.on_step(len(fit.model.effects) + 1)
        trials = self._scan(fit, self.effects)
        self.promises[names_of(fit)] = {trial.effect.name: trial.promise for trial in trials}
        excess = max(0.0, fit.misfit - self.data.size)
        fits: list[tuple[float, Fit]] = []
        highest_promise = trials[0].promise if trials else 0.0
        for trial in trials[: criteria.REFITTED]:
            if trial.promise < criteria.LOOKED_AT or trial.promise < criteria.PROMISE_SHARE * highest_promise:
                break
            if self._stop():
                break
            try:
                refitted = refit(trial, self.data)
            except FitFailedError:
                continue
            decrease = fit.misfit - refitted.misfit
            if decrease > criteria.EXPLAINED_SHARE * excess and decrease > 2.0 * criteria.LOOKED_AT:
                fits.append((refitted.misfit, refitted))
            if self._at_noise(refitted):
                break
        fits.sort(key=lambda entry: entry[0])
        return [refitted for _, refitted in fits]

    def _scan(self, fit: Fit, candidates: Iterable[str]) -> list[Trial]:
        """Return trials of all effects that a set can take, by promise."""
        scan = self._start_scan(fit, candidates)
        self._begun.remove(scan)
        return scan.trials(self.expired)

    def _start_scan(self, fit: Fit, candidates: Iterable[str]) -> Scan:
        """Begin a scan in other processes, which is then made while this one does something else."""
        effects = [
            self.effects[name]
            for name in sorted(candidates)
            if not isinstance(self.effects[name], LocalChange) and not is_taken(self.effects[name], fit.model.effects)
        ]
        for scan in self._begun:
            if scan.is_of(fit, effects):
                return scan
        scan = self.helpers.scan(fit, effects, self._scanned)
        self._begun.append(scan)
        return scan

    def _neighbours(self, best: Evaluated) -> None:
        """Evaluate the sets that differ from one by a removal, an addition or an exchange of one effect."""
        limit = self.best.log_evidence - criteria.WITHIN
        reduced_fits = [fit for effect in best.fit.model.effects if (fit := self._reduced(best, effect)) is not None]
        worths = [best.log_evidence - self._score(fit) for fit in reduced_fits]
        expected = frozenset(effect.name for effect in self._expected)
        has_room = len(best.names) < criteria.MOST_EFFECTS
        additions = self._additions(best.fit, limit)
        if has_room and not self._stop() and min(worths, default=math.inf) > criteria.LOOKED_AT:
            self._start_scan(best.fit, additions)
        for index in np.argsort(worths, kind="stable").tolist():
            if self._stop():
                return
            self._evaluate_anew(reduced_fits[index], best.fit.applied)
            keeps_expected = names_of(reduced_fits[index]) & expected == best.names & expected
            if keeps_expected and self._score(reduced_fits[index]) > best.log_evidence:
                # From there on: the other neighbours of a set that can do with less are not worth the work.
                return
        for fit, worth in zip(reduced_fits, worths, strict=True):
            (effect,) = best.names - names_of(fit)
            self._start_scan(fit, rivals_of(effect, worth, self.effects, list(self.promises.values())))
        for fit, worth in zip(reduced_fits, worths, strict=True):
            if self._stop():
                return
            (effect,) = best.names - names_of(fit)
            self._try_additions(fit, best, rivals_of(effect, worth, self.effects, list(self.promises.values())), limit)
        if has_room and not self._stop():
            self._try_additions(best.fit, best, additions, limit)
            self._regrow(best)

    def _refit_from_priors(self, best: Evaluated) -> bool:
        """Fit a set anew from the usual shapes of its effects; return whether that is the better optimum.

        A shape far from the usual one may have stood for an effect that the set lacked when it was first fitted.
        """
        model = best.fit.model
        has_refitted = False
        for effect in model.effects:
            vector, where = best.fit.vector.copy(), model.layout.effect(effect.name)
            prior_mean = np.array([parameter.prior_mean for parameter in effect.parameters])
            prior_std = np.array([parameter.prior_std for parameter in effect.parameters])
            is_integer = np.array([parameter.whole for parameter in effect.parameters])
            is_far = (prior_mean != 0.0) & ~is_integer & (np.abs(vector[where] - prior_mean) > prior_std)
            if not is_far.any():
                continue
            if self._stop():
                return has_refitted
            vector[where] = np.where(is_far, prior_mean, vector[where])
            try:
                fit = linearised(model, self.data, vector, applied=best.fit.applied)
            except (NoShapeError, np.linalg.LinAlgError):
                continue
            if _linear_score(fit) > self.evaluations[best.names].log_evidence:
                self._evaluate_anew(fit, best.fit.applied)
                has_refitted = True
        return has_refitted and self.evaluations[best.names] is not best

    def _score(self, fit: Fit) -> float:
        """Return the log evidence of a set, by its linearisation where it was not worked out."""
        evaluated = self.evaluations.get(names_of(fit))
        return _linear_score(fit) if evaluated is None else evaluated.log_evidence

    def _reduced(self, best: Evaluated, effect: AngleEffect) -> Fit | None:
        """Return the fit of a set without one of its effects, the other parameters as they are."""
        others = tuple(other for other in best.fit.model.effects if other.name != effect.name)
        model = ClosureModel(self.campaign, self.core, others)
        try:
            vector = best.fit.model.layout.moved(best.fit.vector, model.layout)
            return linearised(model, self.data, vector, applied=best.fit.applied)
        except (NoShapeError, np.linalg.LinAlgError):
            return None

    def _try_additions(self, fit: Fit, best: Evaluated, candidates: Iterable[str], threshold: float) -> None:
        """Evaluate a set, a neighbour of `best`, with each effect that promises an evidence of `threshold` at least."""
        score = self._score(fit)
        for trial in self._scan(fit, candidates)[: criteria.RIVALS]:
            if self._stop():
                return
            names = names_of(fit) | {trial.effect.name}
            if names in self.evaluations or names in self.rejected or len(names) > criteria.MOST_EFFECTS:
                continue
            odds = log_prior_odds(trial.model) - log_prior_odds(fit.model)
            if score + trial.promise + odds < threshold:
                break
            self._evaluate_trial(trial, best)

    def _additions(self, fit: Fit, threshold: float) -> list[str]:
        """Return the effects with which a set may have an evidence of `threshold`.

        At noise, an effect promises no more with a discrepancy than it did without one.
        """
        promised = self.promises.get(names_of(fit))
        if promised is None or not self._at_noise(fit):
            return list(self.effects)
        conditions = tuple(group.conditions for group in self.campaign.groups)
        min_gain = threshold - criteria.LOOKED_AT - self._score(fit)
        return [
            name
            for name, effect in self.effects.items()
            if promised.get(name, -math.inf) + log_odds(effect, conditions) > min_gain
        ]

    def _regrow(self, best: Evaluated) -> None:
        """Evaluate the best set with each effect that promises much under a smaller discrepancy."""
        if best.fit.applied is None or self._at_noise(best.fit):
            return
        smaller = criteria.SMALLER_DISCREPANCY * best.fit.applied.amplitudes
        fit = best.fit.under(self.discrepancy.applied(smaller))
        for trial in self._scan(fit, self.effects)[: criteria.REFITTED]:
            names = names_of(fit) | {trial.effect.name}
            if self._stop() or trial.promise < criteria.LOOKED_AT:
                return
            if names not in self.evaluations and names not in self.rejected:
                self._evaluate_trial(trial, best)

    def _evaluate_trial(self, trial: Trial, best: Evaluated) -> None:
        """Evaluate the set of a trial, from the discrepancy of the best set."""
        try:
            fit = linearised(trial.model, self.data, start_of(trial), applied=best.fit.applied)
        except (NoShapeError, np.linalg.LinAlgError):
            self.rejected.add(frozenset(effect.name for effect in trial.model.effects))
            return
        self._evaluate(fit, best.fit.applied)


def baseline_fit(campaign: Campaign, core: Core, data: Whitened) -> Fit:
    """Return the fit of the baseline model alone.

    Raises:
        FitFailedError: it has no equilibrium near its start.
    """
    return fit_model(ClosureModel(campaign, core), data, from_afar=True)


def _linear_score(fit: Fit) -> float:
    return log_evidence(fit.moved(fit.step))
