"""Tracking of a rolling wheel's contacts, and the checks that contacts of one wheel pass."""

import math
from collections import deque
from collections.abc import Callable
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from gateway.core.compiled import core
from gateway.core.contacts.contact_trains import (
    INTERVAL_RATIO,
    LONGEST_PERIOD_S,
    SKIPPED_DEPTH_SHARE,
    TURN_RATIO,
    WheelProperties,
    least_level,
    turn_of,
)
from gateway.core.contacts.dips import box_offsets, dip_score
from gateway.core.contacts.segmentation import Contact, cumulative, refine_contact
from gateway.core.revolutions.angle_resampling import MARGIN_SAMPLES
from gateway.core.types import FloatArray

# read(first, end) -> nominally inward radial acceleration of the samples first to end (exclusive), m/s^2
Read = Callable[[int, int], FloatArray]
# missing(first, end) -> how many of these samples were lost and filled
Missing = Callable[[int, int], int]

# A dip can be the next contact when its depth is at least this share of that expected for its period, less gravity.
_ACCEPT_SHARE: Final = 0.45
_ACCEPT_GRAVITY_MPS2: Final = 4.0
# Largest number of consecutive contacts that may go unobserved, and how closely the contact after them must then agree:
# ratio of the turn (above and below _SLOW_MPS2), of the period and of the depth.
_MAX_UNSEEN: Final = 2
_UNSEEN_TURN_RATIO: Final = (1.25, 1.12)
_UNSEEN_PERIOD_RATIO: Final = 1.3
_UNSEEN_DEPTH_RATIO: Final = 2.0
# Below this depth, at 10 to 15 km/h, a wheel may have stopped or reversed instead.
_UNSEEN_DEPTH_MPS2: Final = 25.0
# Standard deviations in the cost of a candidate: logarithms of depth, turn and size; time in periods, to which the
# change of acceleration, m/s^2, over the depth is added up to a limit.
_DEPTH_LOG_STD: Final = 0.3
_TURN_LOG_STD: Final = 0.12
_SIZE_LOG_STD: Final = 0.2
_TIME_STD: Final = 0.02
_ACCELERATION_CHANGE_MPS2: Final = 5.0
_MAX_ADDED_TIME_STD: Final = 0.5
# Cost of each unobserved contact.
_UNSEEN_COST: Final = 4.0
_MAX_CANDIDATES: Final = 6
# Range of periods, over the expected one, that is searched at each stretch of the expected duration.
_STRETCH_BAND: Final = (0.8, 1.25)
_ANY_BAND: Final = (-math.inf, math.inf)
# Largest ratio of the expected period to the last: a braking wheel may stop, or accelerate again.
_MAX_PERIOD_GROWTH: Final = 1.45
# Depth of contacts below which a wheel is slow enough to stop or reverse within a revolution.
_SLOW_MPS2: Final = 250.0
# Samples behind a contact before which it is not searched: share of its duration within which the maximum of its score
# must have score on either side; distance of its edges from the centre over its duration; and what its timing needs
# beyond the edges, in turns and samples.
_SCORE_SHARE: Final = 0.3
_EDGE_SHARE: Final = 0.6
_EDGE_MARGIN_TURNS: Final = 0.056
_EDGE_MARGIN_SAMPLES: Final = 6.0
# A contact whose duration deviates by this share from the expected one has a disturbed edge.
_DISTURBED_SHARE: Final = 0.15
# Weights of an update of the tracked properties, which follow pressure and load, and of the jitter.
_PROPERTY_WEIGHT: Final = 0.3
_JITTER_WEIGHT: Final = 0.1
# A dip whose size deviates by a larger ratio, or that is shallower, is rejected.
_SIZE_RATIO: Final = 1.6
_MIN_DEPTH_MPS2: Final = 6.0
# Share of the samples beside a level crossing that may be lost, one at least: a line between the others then places it
# within this many of the steps that it spans.
_BRIDGED_SHARE: Final = 0.25
_BRIDGED_STD: Final = 0.2
# Number of recent contacts kept for comparison with a search.
_RECENT_CONTACTS: Final = 6
# The properties of a wheel are used after this many contacts of at least this depth (20 km/h or more).
_KNOWN_CONTACTS: Final = 8
_KNOWN_DEPTH_MPS2: Final = 60.0
# Largest ratio of size and turn between neighbours in a run of located contacts.
_RUN_SIZE_RATIO: Final = 1.5
_RUN_TURN_RATIO: Final = 1.25
# While a wheel rolls, the signal between two contacts exceeds that in contact everywhere by this share of the depth,
# since its speed may change, less gravity, which changes by 2 g between contact and top.
_ROLLING_SHARE: Final = 0.55
_ROLLING_GRAVITY_MPS2: Final = 20.0
# Squared turn of two revolutions on the smallest belt, 0.2 m, from which on a contact may have been skipped, and the
# part of the period in which that lies: halfway, or after one and two thirds.
_SKIPPING_TURN2_M: Final = 4.0 * 0.2
_SKIPPED_RANGE: Final = (0.3, 0.7)
# A period that is longer than the last one by this ratio is examined.
_LONGER_RATIO: Final = 1.4


class ContactPair(NamedTuple):
    """Two neighbouring contacts: one completed revolution.

    Attributes:
        start: the contact that begins it.
        end: the contact that ends it.
        period_std: standard error of the period in samples. On a real road the two edges of a contact jitter
            separately, so the jitter of the centre follows from that of the duration.
        previous_period: samples of the revolution before, None when it was not observed.
        decided_at: number of samples available at the decision; only samples before this may be used for the pair.
    """

    start: Contact
    end: Contact
    period_std: float
    previous_period: float | None
    decided_at: int


def size(contact: Contact) -> float:
    """Return duration times the square root of the depth, which is the same for all contacts of a wheel."""
    return contact.duration * math.sqrt(contact.depth_mps2)


def consistent(run: list[Contact], contact: Contact) -> bool:
    """Return whether a located contact may follow a run of contacts of the same wheel."""
    last = run[-1]
    if not 1.0 / _RUN_SIZE_RATIO < size(contact) / size(last) < _RUN_SIZE_RATIO:
        return False
    if len(run) < 2:
        return True
    before = turn_of(run[-2].depth_mps2, last.depth_mps2, last.centre - run[-2].centre)
    after = turn_of(last.depth_mps2, contact.depth_mps2, contact.centre - last.centre)
    return 1.0 / _RUN_TURN_RATIO < after / before < _RUN_TURN_RATIO


def kept_rolling(radial_mps2: FloatArray, first: int, last: Contact, contact: Contact, turns: int) -> bool:
    """Return whether a slow wheel kept rolling from one contact to another without stopping or reversing.

    Args:
        radial_mps2: radial axis, positive inward, from within the one contact to within the other.
        first: number of its first sample.
        last: the earlier contact.
        contact: the later one.
        turns: revolutions between them.
    """
    start, end = round(last.centre) - first, round(contact.centre) - first
    margin = round(0.2 * contact.duration)
    floor = 0.5 * (
        float(radial_mps2[: 2 * start + 1].mean()) + float(radial_mps2[end - margin : end + margin + 1].mean())
    )
    shallower = min(last.depth_mps2, contact.depth_mps2)
    if float(radial_mps2[start:end].mean()) - floor < float(least_level(shallower)):
        return False
    least_rise_mps2 = _ROLLING_SHARE * shallower - _ROLLING_GRAVITY_MPS2
    period = (end - start) / turns
    edges = [round(start + (number + share) * period) for number in range(turns) for share in (0.2, 0.4, 0.6, 0.8)]
    parts = [radial_mps2[lo:hi] for index, (lo, hi) in enumerate(pairwise(edges)) if index % 4 < 3]
    # Medians, so that an impact does not count as a stop.
    return all(float(np.median(part)) - floor >= least_rise_mps2 for part in parts)


def skips_contact(last: Contact, contact: Contact, rate_hz: float, read: Read, sign: int) -> bool:
    """Return whether the signal between two contacts has another one, so that they are not neighbours.

    Args:
        last: the earlier contact, in running sample numbers.
        contact: the later one.
        rate_hz: sampling rate.
        read: returns the radial axis; between the two, no sample was lost.
        sign: makes it positive inward.
    """
    shallower, period = min(last.depth_mps2, contact.depth_mps2), contact.centre - last.centre
    turn = turn_of(last.depth_mps2, contact.depth_mps2, period / rate_hz)
    if shallower < _UNSEEN_DEPTH_MPS2 or turn * turn < _SKIPPING_TURN2_M:
        return False
    width = max(3.0, 0.5 * (last.duration + contact.duration))
    reach = box_offsets(width)[2]
    first, end = (round(last.centre + share * period) for share in _SKIPPED_RANGE)
    radial = sign * read(first - reach, end + reach)
    prefix = cumulative(radial)
    score, outer = dip_score(prefix, width)
    if not len(score) or score.max() < SKIPPED_DEPTH_SHARE * shallower:
        return False
    # An impact is as deep, but seldom as long.
    skipped = refine_contact(radial, outer + int(score.argmax()), width, prefix=prefix)
    return skipped is not None and _ratio(size(skipped), size(last)) < _RUN_SIZE_RATIO


def lost_crossings(contact: Contact, missing: Missing, expected: float = 0.0) -> tuple[int, int]:
    """Return the samples that were lost at the leading and at the trailing level crossing of a contact.

    Args:
        contact: in running sample numbers.
        missing: returns the number of lost samples.
        expected: duration in samples; 0 for that of the contact.
    """
    half, reach = 0.5 * contact.duration, _crossing_reach(expected or contact.duration)
    if not missing(math.floor(contact.centre - half - reach), math.ceil(contact.centre + half + reach) + 1):
        return 0, 0
    leading, trailing = (
        missing(math.floor(crossing - reach), math.ceil(crossing + reach) + 1)
        for crossing in (contact.centre - half, contact.centre + half)
    )
    return leading, trailing


def _crossing_reach(duration: float) -> float:
    """Return how many samples on either side place a level crossing of a contact of a duration in samples."""
    return max(2.0, 0.1 * duration)


def is_bridged(lost: int, duration: float) -> bool:
    """Return whether so few samples were lost at a level crossing that a line through their gap places it."""
    return lost <= max(1.0, _BRIDGED_SHARE * _crossing_reach(duration))


def restore_lost_edge(contact: Contact, expected: float, missing: Missing) -> Contact | None:
    """Reconstruct a contact with one lost edge from the other edge; None when both edges were lost on the link.

    Args:
        contact: in running sample numbers.
        expected: expected duration in samples.
        missing: returns the number of lost samples.
    """
    lost = lost_crossings(contact, missing, expected)
    if not any(lost):
        return contact
    leading, trailing = (is_bridged(count, expected) for count in lost)
    if leading and trailing:
        stds = (_BRIDGED_STD * (count + 1) for count in lost if count)
        return contact._replace(centre_std=math.hypot(contact.centre_std, *(0.5 * std for std in stds)))
    if not (leading or trailing):
        return None
    edge = contact.centre + (0.5 if trailing else -0.5) * contact.duration
    centre = edge - (0.5 if trailing else -0.5) * expected
    return contact._replace(centre=centre, duration=expected, centre_std=max(contact.centre_std, 0.05 * expected))


def _summits_by_numpy(
    prefix: FloatArray,
    width: float,
    score_offset: float,
    depth_period2: float,
    period: float,
    least_ratio: float,
    largest_ratio: float,
) -> list[tuple[int, float]]:
    """Return the places that may be the next contact, one or more revolutions later, and their scores.

    Of those nearer to each other than half a width, the highest.

    Args:
        prefix: cumulative sum of the radial axis.
        width: of a contact, in samples.
        score_offset: samples from the last contact to the first score.
        depth_period2: depth of a contact times the square of the period.
        period: expected one, in samples.
        least_ratio: least ratio of a period to the expected one.
        largest_ratio: largest ratio.
    """
    score, _ = dip_score(prefix, width)
    # Quick preselection by the least depth that could be accepted anywhere.
    farthest = (score_offset + len(score)) / (_MAX_UNSEEN + 1.0)
    least_depth = depth_period2 / max(farthest, 1.5 * period) ** 2
    places = (score >= (_ACCEPT_SHARE - 0.2) * least_depth).nonzero()[0]
    if not len(places):
        return []
    depth, elapsed = score[places], places + score_offset
    turns = np.minimum(np.maximum(np.rint(elapsed / period), 1.0), _MAX_UNSEEN + 1.0)
    expected = depth_period2 * np.square(turns / elapsed)
    is_plausible = depth >= _ACCEPT_SHARE * expected - np.minimum(_ACCEPT_GRAVITY_MPS2, 0.2 * expected)
    ratio = elapsed / (turns * period)
    is_plausible &= (ratio > least_ratio) & (ratio < largest_ratio)
    places, depth = places[is_plausible], depth[is_plausible]
    if not len(places):
        return []
    edges = [0, *(np.flatnonzero(np.diff(places) > max(1, round(0.5 * width))) + 1).tolist(), len(places)]
    tops = [lo + int(depth[lo:hi].argmax()) for lo, hi in pairwise(edges)]
    return [(places.item(top), depth.item(top)) for top in tops]


summits = _summits_by_numpy if core is None else core.summits


def _ratio(value: float, reference: float) -> float:
    """Return the ratio of the larger of two positive numbers to the smaller."""
    return value / reference if value > reference else reference / value


def edge_jitter2(start: Contact, end: Contact, speed_ratio: float) -> float:
    """Return the squared error of the period, in samples, that follows from the change of the contact's duration.

    The period between leading edges and that between trailing edges differ by the change of the duration. The error of
    their mean, the period between centres, is half of it. The change due to speed is no jitter and is subtracted.

    Args:
        start: contact at the start of the period.
        end: contact at its end.
        speed_ratio: speed at the end over speed at the start.
    """
    return (0.5 * (end.duration * speed_ratio - start.duration)) ** 2


class ContactTrack:
    """The latest contacts of a wheel and the prediction of the next one. Deterministic.

    Attributes:
        contact: the latest.
        recent: the latest ones.
        periods: the two latest, in samples.
        next_index: number of samples at which the next contact is searched.
        skips_contacts: whether contacts were seen between those of the track, which then is lost.
    """

    def __init__(self, contacts: list[Contact], rate_hz: float, sign: int) -> None:
        """Start from a run of at least three contacts."""
        self._rate_hz = rate_hz
        self._sign = sign
        periods = [end.centre - start.centre for start, end in pairwise(contacts)]
        ratios = [periods[0] / periods[1], *(a / b for a, b in pairwise(periods))]
        self._jitter2 = float(
            np.mean([edge_jitter2(*revolution) for revolution in zip(contacts[:-1], contacts[1:], ratios, strict=True)])
        )
        self.contact = contacts[-1]
        self.recent = deque(contacts, maxlen=_RECENT_CONTACTS)
        self.periods = (periods[-2], periods[-1])
        self._depth_period2 = self.contact.depth_mps2 * self.periods[-1] ** 2
        self._turn = float(np.median([self._turn_of(*pair) for pair in pairwise(contacts)]))
        self._size = float(np.median([size(contact) for contact in contacts]))
        self._followed_count = 0
        self.skips_contacts = False
        # Whether the signal of a revolution since the last loss had no further contact.
        self._is_single = False
        self._duty = float(np.median([c.duration / p for c, p in zip(contacts[1:], periods, strict=True)]))
        self._plan()

    def _turn_of(self, start: Contact, end: Contact, turns: int = 1) -> float:
        period_s = (end.centre - start.centre) / turns / self._rate_hz
        return turn_of(start.depth_mps2, end.depth_mps2, period_s)

    @property
    def properties(self) -> WheelProperties | None:
        """Properties of the wheel, None until they are certain."""
        if self._followed_count < _KNOWN_CONTACTS:
            return None
        return WheelProperties(self._sign, self._turn, self._size / self._rate_hz)

    def _plan(self) -> None:
        """Set when to search for the next contact."""
        self._period = self._expected_period()
        self._width = max(3.0, self._duty * self._period)
        self._time_std = _TIME_STD + min(
            _MAX_ADDED_TIME_STD, 2.0 * math.pi * _ACCELERATION_CHANGE_MPS2 / max(self.contact.depth_mps2, 1.0)
        )
        # Least number of samples to the next contact, and the sample from which on it is searched.
        self._nearest = min(0.5 * self._period, self.periods[-1] / INTERVAL_RATIO)
        outer = box_offsets(self._width)[2]
        centre = int(self.contact.centre)
        self._first = max(int(self.contact.centre + self._nearest) - outer, centre)
        # Far enough that the dip's score has its maximum in view, and that the contact's timing sees both of its edges.
        edge_span = _EDGE_SHARE * self._width + _EDGE_MARGIN_TURNS * self._period + _EDGE_MARGIN_SAMPLES
        margin = max(_SCORE_SHARE * self._width + outer + 2, edge_span, MARGIN_SAMPLES + 2)
        self.next_index = math.ceil(self.contact.centre + self._period + margin)
        longest_period = LONGEST_PERIOD_S * self._rate_hz
        wait = min(INTERVAL_RATIO * self._period, longest_period)
        if self.contact.depth_mps2 > _UNSEEN_DEPTH_MPS2:
            wait = max(wait, min((_MAX_UNSEEN + 1.4) * self._period, 2.0 * longest_period))
        self._give_up_at = math.ceil(self.contact.centre + wait + margin)

    def _expected_period(self) -> float:
        """Return the period of the next revolution at constant angular acceleration."""
        previous, last = self.periods
        speed, gain = 1.0 / last, 2.0 * (1.0 / last - 1.0 / previous) / (last + previous)
        period = last
        for _ in range(3):
            period = 1.0 / max(speed + 0.5 * gain * (last + period), speed / INTERVAL_RATIO)
        longest_period = min(last * _MAX_PERIOD_GROWTH, LONGEST_PERIOD_S * self._rate_hz)
        return min(max(period, last / INTERVAL_RATIO), longest_period)

    def step(self, read: Read, missing: Missing) -> list[ContactPair] | None:
        """Search the next contact in the samples before `next_index`; None when the wheel is lost."""
        end = self.next_index
        first = min(self._first, end)
        radial = read(first, end)
        if self._sign < 0:
            radial = -radial
        prefix = cumulative(radial)
        candidates, waiting = self._candidates(prefix, first)
        if waiting and end < self._give_up_at:
            self.next_index = end + max(1, round(0.5 * self._width))
            return []
        fitting: list[tuple[float, int, Contact, int]] = []
        for index, (centre, width) in enumerate(candidates):
            contact = refine_contact(radial, centre, width, prefix=prefix, first=first)
            if contact is not None:
                contact = restore_lost_edge(contact, width, missing)
            turns = self._turns_to(contact, read) if contact is not None else 0
            if contact is not None and turns:
                fitting.append((self._misfit(contact, turns) if len(candidates) > 1 else 0.0, index, contact, turns))
        if fitting:
            contact, turns = min(fitting)[2:]
            self.skips_contacts = self._skips_contact(contact, turns, read, missing)
            return None if self.skips_contacts else self._accept(contact, turns)
        if end < self._give_up_at:
            self.next_index = end + max(1, round(0.15 * self._period))
            return []
        return None

    def _candidates(self, prefix: FloatArray, first: int) -> tuple[list[tuple[int, float]], bool]:
        """Return dips that may be the next contact, one or more revolutions later, likeliest first, with their widths.

        Args:
            prefix: cumulative sum of the signal from sample `first` on.
            first: its first sample.

        Returns:
            (sample, width) of the dips, and whether the likeliest is so near the end that more samples may move it.
        """
        # The period of a slow wheel that accelerates or brakes is uncertain, and so is the width of its dips.
        stretches = [1.0]
        if self.contact.depth_mps2 < _SLOW_MPS2:
            lowest = math.floor(2.0 * math.log2(self._nearest / self._period))
            stretches = [2.0 ** (half / 2.0) for half in range(lowest, 3)]
        ranked: list[tuple[float, int, float, bool]] = []
        for stretch in stretches:
            width = max(3.0, stretch * self._width)
            outer = box_offsets(width)[2]
            # Samples from the last contact to the first score.
            score_offset = first + outer - self.contact.centre
            band = _STRETCH_BAND if len(stretches) > 1 else _ANY_BAND
            band = band[0] * stretch, band[1] * stretch
            for top, score in summits(prefix, width, score_offset, self._depth_period2, self._period, *band):
                centre = score_offset + top
                turns = min(max(round(centre / self._period), 1), _MAX_UNSEEN + 1)
                depth_misfit = math.log(score * (centre / turns) ** 2 / self._depth_period2) / _DEPTH_LOG_STD
                time_misfit = (centre / (turns * self._period) - 1.0) / self._time_std
                cost = depth_misfit**2 + time_misfit**2 + _UNSEEN_COST * (turns - 1.0)
                is_near_end = top + _SCORE_SHARE * width >= len(prefix) - 1 - 2 * outer
                ranked.append((cost, first + outer + top, width, is_near_end))
        ranked.sort()
        return [(centre, width) for _, centre, width, _ in ranked[:_MAX_CANDIDATES]], bool(ranked) and ranked[0][3]

    def _turns_to(self, contact: Contact, read: Read) -> int:
        """Return the number of revolutions from the last contact to this one; 0 when it is not one of this wheel's."""
        last = self.contact
        period = contact.centre - last.centre
        if not 1.0 / _SIZE_RATIO < size(contact) / self._size < _SIZE_RATIO or contact.depth_mps2 < _MIN_DEPTH_MPS2:
            return 0
        period_turns = self._turn_of(last, contact) / self._turn
        period_ratio = min(_ratio(period, self._period), _ratio(period, self.periods[-1]))
        turns = 1
        if not (1.0 / TURN_RATIO < period_turns < TURN_RATIO and period_ratio < INTERVAL_RATIO):
            limit = _UNSEEN_TURN_RATIO[last.depth_mps2 < _SLOW_MPS2]
            for turns in range(2, _MAX_UNSEEN + 2 if self._may_go_unseen(contact) else 2):
                period_ratio = _ratio(period / turns, self._period)
                if 1.0 / limit < period_turns / turns < limit and period_ratio < _UNSEEN_PERIOD_RATIO:
                    break
            else:
                return 0
        return turns if self._rolled_through(last, contact, turns, read) else 0

    def _skips_contact(self, contact: Contact, turns: int, read: Read, missing: Missing) -> bool:
        """Return whether a revolution without loss has a contact inside.

        The first since the start and since the last loss is examined, and one that is much longer than the one before.
        """
        last = self.contact
        if turns > 1 or missing(math.ceil(last.centre), math.floor(contact.centre)):
            self._is_single = False
        elif not self._is_single or contact.centre - last.centre > _LONGER_RATIO * self.periods[-1]:
            self._is_single = not skips_contact(last, contact, self._rate_hz, read, self._sign)
            return not self._is_single
        return False

    def _misfit(self, contact: Contact, turns: int) -> float:
        """Return the cost of a contact `turns` revolutions later: deviations from the prediction, less its strength."""
        time_deviation = (contact.centre - self.contact.centre) / turns / self._period - 1.0
        return (
            (math.log(self._turn_of(self.contact, contact, turns) / self._turn) / _TURN_LOG_STD) ** 2
            + (math.log(size(contact) / self._size) / _SIZE_LOG_STD) ** 2
            + (0.5 * time_deviation / self._time_std) ** 2
            + _UNSEEN_COST * (turns - 1)
            - math.log(contact.depth_mps2 * math.sqrt(contact.duration))
        )

    def _may_go_unseen(self, contact: Contact) -> bool:
        """Return whether the wheel rolls so steadily that unobserved contacts can be interpolated."""
        shallower, deeper = sorted((self.contact.depth_mps2, contact.depth_mps2))
        return shallower > _UNSEEN_DEPTH_MPS2 and deeper < _UNSEEN_DEPTH_RATIO * shallower

    def _rolled_through(self, last: Contact, contact: Contact, turns: int, read: Read) -> bool:
        """Return whether the wheel kept rolling between two contacts; the signal is checked only where it is slow."""
        if min(last.depth_mps2, contact.depth_mps2) > _SLOW_MPS2:
            return True
        first = round(last.centre - 0.35 * last.duration)
        radial = read(first, round(contact.centre + 0.2 * contact.duration) + 1) * self._sign
        return kept_rolling(radial, first, last, contact, turns)

    def _accept(self, contact: Contact, turns: int) -> list[ContactPair]:
        last, decided_at = self.contact, self.next_index
        period = (contact.centre - last.centre) / turns
        expected = self._duty * period
        excess = abs(contact.duration - expected)
        if excess > _DISTURBED_SHARE * expected and excess**2 > 36.0 * self._jitter2:
            contact = contact._replace(centre_std=max(contact.centre_std, 0.5 * excess))
        elif turns == 1:
            jitter2 = edge_jitter2(last, contact, self.periods[-1] / period)
            self._jitter2 += _JITTER_WEIGHT * (jitter2 - self._jitter2)
        pairs: list[ContactPair] = []
        start, previous = last, self.periods[-1]
        for end in (*self._interpolated_contacts(contact, turns), contact) if turns > 1 else (contact,):
            pairs.append(ContactPair(start, end, self.period_std(start, end), previous, decided_at))
            previous = end.centre - start.centre
            start = end
        if contact.centre_std < 0.1 * expected:
            self._depth_period2 += _PROPERTY_WEIGHT * (contact.depth_mps2 * period**2 - self._depth_period2)
            self._turn += _PROPERTY_WEIGHT * (self._turn_of(last, contact, turns) - self._turn)
            self._duty += _PROPERTY_WEIGHT * (contact.duration / period - self._duty)
            self._size += _PROPERTY_WEIGHT * (size(contact) - self._size)
            self._followed_count += contact.depth_mps2 > _KNOWN_DEPTH_MPS2
        self.periods = (self.periods[-1] if turns == 1 else period, previous)
        self.contact = contact
        self.recent.append(contact)
        self._plan()
        return pairs

    def _interpolated_contacts(self, contact: Contact, turns: int) -> list[Contact]:
        """Return the unobserved contacts, interpolated at constant angular acceleration since the revolution before."""
        last, previous_period = self.contact, self.periods[-1]
        elapsed = contact.centre - last.centre
        bend = (turns / elapsed - 1.0 / previous_period) / (elapsed + previous_period)
        slope = 1.0 / previous_period + bend * previous_period
        contacts: list[Contact] = []
        for number in range(1, turns):
            # number = slope x + bend x^2, without cancellation
            root = math.sqrt(max(slope**2 + 4.0 * bend * number, 0.0))
            uniform_centre = last.centre + elapsed * number / turns
            centre = min(last.centre + 2.0 * number / max(slope + root, 1e-12), uniform_centre + 0.2 * elapsed)
            depth = 0.5 * (last.depth_mps2 + contact.depth_mps2)
            # The acceleration may have begun or ended between the two contacts.
            centre_std = math.hypot(0.1 * self._width, centre - uniform_centre)
            contacts.append(Contact(centre, self._width, depth, centre_std, predicted=True))
        return contacts

    def period_std(self, start: Contact, end: Contact) -> float:
        """Return the standard error of the time between two contacts, in samples."""
        return max(math.hypot(start.centre_std, end.centre_std), math.sqrt(self._jitter2))
