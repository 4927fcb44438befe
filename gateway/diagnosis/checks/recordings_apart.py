"""Recordings of one state of the tire whose numbers, each found alone, contradict each other.

Where much is left unexplained, recordings may be of different tires, loads or pressures under the same statement. Each
alone is then described well, and their numbers differ by more than the unexplained part of either.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

from gateway.core.ring_quantities import RING_NUMBERS
from gateway.diagnosis import criteria
from gateway.diagnosis.angle.discrepancy import Discrepancy
from gateway.diagnosis.angle.fit import Fit, FitFailedError
from gateway.diagnosis.angle.likelihood import whiten
from gateway.diagnosis.angle.number_estimates import contradict, estimates_of
from gateway.diagnosis.angle.set_evidence import evaluate
from gateway.diagnosis.data.campaign_data import Campaign
from gateway.diagnosis.model.baseline import Core
from gateway.diagnosis.result import Fitted
from gateway.diagnosis.search.set_search import baseline_fit


@dataclass(frozen=True, slots=True)
class Apart:
    """Two recordings of one state whose numbers contradict each other.

    Attributes:
        state: of the tire.
        low: number in the one in which it is smaller.
        high: in the other.
        low_recording: index in the campaign.
        high_recording: likewise.
    """

    state: int
    low: Fitted
    high: Fitted
    low_recording: int
    high_recording: int


def recordings_apart(campaign: Campaign, core: Core) -> list[Apart]:
    """Return, for each state with recordings that contradict each other, those farthest apart.

    Each is fitted without effects; its errors contain what that leaves unexplained.
    """
    farthest = []
    for state in sorted({group.state for group in campaign.groups}):
        recordings = sorted({group.recording for group in campaign.groups if group.state == state})
        if len(recordings) < 2:
            continue
        numbers = {number: _single_numbers(campaign, core, state, number) for number in recordings}
        pairs = [conflict for pair in combinations(recordings, 2) for conflict in _conflicts(state, pair, numbers)]
        if pairs:
            farthest.append(max(pairs, key=lambda pair: (_errors(pair), pair.low_recording, pair.high_recording)))
    return farthest


def _single_numbers(campaign: Campaign, core: Core, state: int, recording: int) -> dict[str, Fitted]:
    """Return the numbers of one recording in one state, none where it cannot be fitted."""
    groups = tuple(
        replace(group, state=0) for group in campaign.groups if group.state == state and group.recording == recording
    )
    part = replace(campaign, groups=groups, states=1)
    data = whiten(part, core)
    try:
        fit: Fit = evaluate(baseline_fit(part, core, data), data, Discrepancy(part, data), None).fit
    except FitFailedError:
        return {}
    return {name: estimate for name, estimate in estimates_of([(fit, 1.0)])[0].items() if name in RING_NUMBERS}


def _conflicts(state: int, pair: Sequence[int], numbers: dict[int, dict[str, Fitted]]) -> Iterator[Apart]:
    """Yield the numbers by which two recordings contradict each other."""
    first, second = pair
    for name in numbers[first].keys() & numbers[second].keys():
        first_number, second_number = numbers[first][name], numbers[second][name]
        if not (first_number.value > 0.0 and second_number.value > 0.0 and contradict(first_number, second_number)):
            continue
        if abs(math.log(first_number.value / second_number.value)) > criteria.NUMBERS_APART:
            low, high = (first, second) if first_number.value < second_number.value else (second, first)
            yield Apart(state, numbers[low][name], numbers[high][name], low, high)


def _errors(pair: Apart) -> float:
    return (pair.high.value - pair.low.value) / math.hypot(pair.high.std, pair.low.std)
