"""The next recording of a diagnosis: what it is expected to decide, and the errors of the numbers after it.

Each set of effects that the recordings leave possible predicts the waveform of a further one, with the errors of its
parameters, the sensor's scatter and what it leaves unexplained (`gateway.closure.report.imagined_recording`). A
waveform is drawn from each in turn, and Bayes' theorem weighs the sets by it: the mean over the draws is what the
recording is expected to do. Lindley (1956), On a measure of the information provided by an experiment.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from gateway.closure import criteria
from gateway.closure.angle.fit import Fit
from gateway.closure.angle.number_estimates import values_and_gradients
from gateway.closure.effects.effect import GroupConditions
from gateway.closure.model.baseline import NoShapeError
from gateway.closure.report.imagined_recording import ImaginedRecording, reference_group
from gateway.closure.result import Fitted
from gateway.closure.search.tempered_posterior import Posterior
from gateway.planning.wants import Want
from gateway.types import BoolArray, FloatArray

DURATIONS_S: Final = (10.0, 30.0, 60.0, 120.0, 300.0)
"""Durations that are tried, from below."""
# Waveforms drawn from each set. A probability of 0.9 is then known to 0.04.
_DRAWS: Final = 64
# Most sets but rivals, and the least weight of one: each takes a solution of the ring for every recording.
_MOST_SETS: Final = 5
_LEAST_WEIGHT: Final = 1e-4
# Expected share of the draws that must be decided.
_DECIDED_SHARE: Final = 0.9
_SPEEDS: Final = (0.5, 0.75, 1.0, 1.5)
_LOADS: Final = (0.7, 1.3)
_PRESSURES: Final = (0.8, 1.2)


@dataclass(frozen=True, slots=True)
class NextRecording:
    """A further recording at a steady speed.

    Attributes:
        speed_mps: of the wheel.
        load_n: vertical load.
        pressure_pa: inflation pressure.
        is_reversed: whether the tire rolls the other way round than in most revolutions so far.
        duration_s: the least of `DURATIONS_S` that suffices, or the longest.
        revolutions: in that time.
        suffices: whether it decides what is open and brings the wanted errors.
        decided: probability that every effect that is open is named or excluded after it.
        log_odds: expected gain of the true set's log evidence over that of the best other one; NaN for a single set.
        errors: expected standard error of each number of the tire after it.
    """

    speed_mps: float
    load_n: float
    pressure_pa: float
    is_reversed: bool
    duration_s: float
    revolutions: int
    suffices: bool
    decided: float
    log_odds: float
    errors: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class RecordingPlan:
    """Recordings that may come next, best first.

    Attributes:
        open_effects: probability of each effect that is neither named nor excluded.
        sets: number of sets of effects that are compared.
        errors: present standard error of each number, at the load and pressure of most revolutions.
        values: of the same.
        wants: largest errors that are wanted.
        recordings: those that suffice first, the shortest of them first.
    """

    open_effects: Mapping[str, float]
    sets: int
    errors: Mapping[str, float]
    values: Mapping[str, float]
    wants: tuple[Want, ...]
    recordings: tuple[NextRecording, ...]


class _Set(NamedTuple):
    """One set of effects.

    Attributes:
        fit: with its discrepancy.
        weight: probability among the sets.
        names: of its effects.
        numbers: with their derivatives by the fit's parameters.
        counts: whether it is among the sets that the numbers of the diagnosis are the mean of.
    """

    fit: Fit
    weight: float
    names: frozenset[str]
    numbers: Mapping[str, tuple[float, FloatArray]]
    counts: bool


class _Outcome(NamedTuple):
    """What a recording is expected to do; as in `NextRecording`, errors by the sets alone."""

    decided: float
    log_odds: float
    errors: Mapping[str, float]


def plan_recordings(
    posterior: Posterior,
    estimates: Mapping[str, Fitted],
    *,
    wants: Sequence[Want] = (),
    speeds_mps: Sequence[float] = (),
    seed: int = 0,
    on_progress: Callable[[float, str], None] = lambda _share, _text: None,
) -> RecordingPlan:
    """Return what further recordings would decide, and the errors after them.

    Args:
        posterior: of the diagnosis.
        estimates: its numbers. The part of their errors that no set explains stays after any recording.
        wants: largest errors.
        speeds_mps: at which a recording can be made; empty for half to one and a half times the present speed.
        seed: of the draws.
        on_progress: called with the share done, 0 to 1, and the present step.
    """
    sets = _sets_of(posterior)
    campaign = sets[0].fit.model.campaign
    probabilities = {
        name: sum(each.weight for each in sets if name in each.names)
        for name in sorted(frozenset().union(*(s.names for s in sets)))
    }
    open_effects = {name: p for name, p in probabilities.items() if _is_open(p)}
    errors_now = _mixture_errors(sets, [each.fit.covariance for each in sets], np.array([[s.weight for s in sets]]))
    stays = {
        name: math.sqrt(max(estimates[name].std ** 2 - error**2, 0.0)) if name in estimates else 0.0
        for name, error in errors_now.items()
    }
    reference = reference_group(campaign).conditions
    temperature = max(posterior.temperatures)
    recordings: list[NextRecording] = []
    candidates = list(_candidates(reference, speeds_mps))
    for number, target in enumerate(candidates):
        on_progress(number / len(candidates), "planning the next recording")
        turns_per_s = target.omega_radps / (2.0 * math.pi)
        try:
            imagined = [ImaginedRecording.of(each.fit, target, round(DURATIONS_S[-1] * turns_per_s)) for each in sets]
            recording = None
            for duration_s in DURATIONS_S:
                revolutions = max(1, round(duration_s * turns_per_s))
                outcome = _outcome(sets, imagined, revolutions, open_effects, temperature, seed)
                errors = {name: math.hypot(error, stays[name]) for name, error in outcome.errors.items()}
                suffices = outcome.decided >= _DECIDED_SHARE and all(
                    errors[want.quantity] <= want.error for want in wants
                )
                recording = NextRecording(
                    target.omega_radps * target.radius_m,
                    target.load_n,
                    target.pressure_pa,
                    target.reverse != reference.reverse,
                    duration_s,
                    revolutions,
                    suffices and bool(wants or open_effects),
                    outcome.decided,
                    outcome.log_odds,
                    errors,
                )
                if suffices:
                    break
        except (NoShapeError, np.linalg.LinAlgError):
            continue
        if recording is not None:
            recordings.append(recording)
    first = sets[0].numbers
    return RecordingPlan(
        open_effects,
        len(sets),
        {name: math.hypot(error, stays[name]) for name, error in errors_now.items()},
        {name: estimates[name].value if name in estimates else first[name][0] for name in first},
        tuple(wants),
        tuple(sorted(recordings, key=lambda recording: _rank(recording, wants))),
    )


def _sets_of(posterior: Posterior) -> list[_Set]:
    """Return the most probable sets, and the best one with each effect that is a rival of others."""
    weights = {evaluated.names: posterior.possible.get(evaluated.names, 0.0) for evaluated, _ in posterior.considered}
    chosen = sorted(weights, key=lambda names: (-weights[names], sorted(names)))[:_MOST_SETS]
    rivals = [posterior.with_effect(name) for group in posterior.alternatives() for name in group]
    chosen += [rival.names for rival in rivals if not rival.objections]
    total = sum(posterior.possible[names] for names in dict.fromkeys(chosen))
    return [
        _Set(fit, posterior.possible[names] / total, names, values_and_gradients(fit), names in weights)
        for names in dict.fromkeys(chosen)
        if (fit := posterior.every[names].fit) and posterior.possible[names] > _LEAST_WEIGHT * total
    ]


def _candidates(reference: GroupConditions, speeds_mps: Sequence[float]) -> Iterator[GroupConditions]:
    """Yield each speed at the reference's load and pressure, then other states and the other direction at its speed."""
    speeds = [speed / reference.radius_m for speed in speeds_mps] or [
        ratio * reference.omega_radps for ratio in _SPEEDS
    ]
    for omega_radps in speeds:
        yield replace(reference, omega_radps=omega_radps, omega_dot_radps2=0.0)
    nearest = min(speeds, key=lambda omega_radps: abs(omega_radps - reference.omega_radps))
    target = replace(reference, omega_radps=nearest, omega_dot_radps2=0.0)
    yield replace(target, reverse=not target.reverse)
    for ratio in _LOADS:
        yield replace(target, load_n=ratio * target.load_n)
    for ratio in _PRESSURES:
        yield replace(target, pressure_pa=ratio * target.pressure_pa)


def _is_open(probability: float) -> bool:
    return 1.0 - criteria.NAMED < probability < criteria.NAMED


def _outcome(
    sets: Sequence[_Set],
    imagined: Sequence[ImaginedRecording],
    revolutions: int,
    open_effects: Mapping[str, float],
    temperature: float,
    seed: int,
) -> _Outcome:
    """Return what a recording of so many revolutions is expected to do."""
    now = np.log([each.weight for each in sets])
    covariances = [each.covariance_after(revolutions) for each in imagined]
    if len(sets) == 1:
        return _Outcome(1.0, math.nan, _mixture_errors(sets, covariances, np.ones((1, 1))))
    factors = [cho_factor(each.spread(revolutions), lower=True) for each in imagined]
    determinants = [2.0 * float(np.log(np.diagonal(factor)).sum()) for factor, _ in factors]
    normal = np.random.default_rng(seed).standard_normal((len(imagined[0].mean_mps2), _DRAWS))
    weights: list[FloatArray] = []
    gains: list[FloatArray] = []
    for true, (lower, _) in zip(imagined, factors, strict=True):
        waveforms = true.mean_mps2[:, None] + np.tril(lower) @ normal
        logs = np.empty((len(sets), _DRAWS))
        for index, (other, factor) in enumerate(zip(imagined, factors, strict=True)):
            away = waveforms - other.mean_mps2[:, None]
            logs[index] = -0.5 * (np.einsum("md,md->d", away, cho_solve(factor, away)) + determinants[index])
        # Where much is left unexplained, evidence counts for less: as in the diagnosis.
        logs /= temperature
        number = len(weights)
        gains.append(logs[number] - np.delete(logs, number, axis=0).max(axis=0))
        after = logs + now[:, None]
        after = np.exp(after - after.max(axis=0))
        weights.append(after / after.sum(axis=0))
    shares = np.exp(now)
    decided = [
        np.mean(np.all([_decided(sets, name, each) for name in open_effects], axis=0)) if open_effects else 1.0
        for each in weights
    ]
    # Draws of a set count as often as it is true.
    counted = [(share, each) for share, each, of in zip(shares, weights, sets, strict=True) if of.counts]
    variances = [np.square(list(_mixture_errors(sets, covariances, each.T).values())) for _, each in counted]
    errors = np.sqrt(np.average(variances, axis=0, weights=[share for share, _ in counted]))
    return _Outcome(
        float(shares @ decided),
        float(shares @ np.mean(gains, axis=1)),
        dict(zip(sets[0].numbers, errors.tolist(), strict=True)),
    )


def _decided(sets: Sequence[_Set], name: str, weights: FloatArray) -> BoolArray:
    """Return in which draws (n,) an effect is named or excluded by the weights (sets, n)."""
    probability = sum((weights[index] for index, each in enumerate(sets) if name in each.names), np.zeros(1))
    return (probability <= 1.0 - criteria.NAMED) | (probability >= criteria.NAMED)


def _mixture_errors(sets: Sequence[_Set], covariances: Sequence[FloatArray], weights: FloatArray) -> dict[str, float]:
    """Return the root mean square over draws of each number's standard error over the sets.

    Args:
        sets: of effects.
        covariances: (p, p) of each set's parameters.
        weights: (draws, sets) of the sets.
    """
    errors = {}
    weights = weights * np.array([each.counts for each in sets])
    weights = weights / np.maximum(weights.sum(axis=1, keepdims=True), 1e-300)
    for name in sets[0].numbers:
        values = np.array([each.numbers[name][0] for each in sets])
        variances = np.array(
            [
                gradient @ covariance @ gradient
                for (_, gradient), covariance in zip((each.numbers[name] for each in sets), covariances, strict=True)
            ]
        )
        means = weights @ values
        errors[name] = math.sqrt(float(np.mean(weights @ (variances + values**2) - means**2)))
    return errors


def _rank(recording: NextRecording, wants: Sequence[Want]) -> tuple[bool, float, float, float]:
    """Return the order of recordings: sufficient and short, then decisive, then near the wanted errors."""
    worst = max((recording.errors[want.quantity] / want.error for want in wants), default=0.0)
    return not recording.suffices, recording.duration_s, -round(recording.decided, 2), worst
