"""Following the contacts of a rolling wheel from one to the next."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.signal.dips import box_offsets, dip_score
from gateway.signal.resample import MARGIN_SAMPLES
from gateway.signal.segmentation import Contact, refine_contact
from gateway.signal.trains import INTERVAL_RATIO, LONGEST_PERIOD_S, TURN_RATIO, least_level, turn

FloatArray = NDArray[np.float64]
# read(first, end) -> nominally inward radial acceleration of the samples first to end (exclusive), m/s^2
Read = Callable[[int, int], FloatArray]
# missing(first, end) -> how many of these samples were lost and filled
Missing = Callable[[int, int], int]

# A dip is the next contact when it has this share of the depth that its period asks for.
_ACCEPT_SHARE: Final = 0.45
# Contacts in a row that may go unseen, their samples lost or hit by an impact, when the next one is where it must be.
_MAX_UNSEEN: Final = 2
_UNSEEN_TURN_RATIO: Final = 1.25
_UNSEEN_PERIOD_RATIO: Final = 1.3
# How far depth (in its logarithm) and time (in periods, and by how much the acceleration may change, m/s^2) stray.
_DEPTH_SPREAD: Final = 0.3
_TIME_SPREAD: Final = 0.02
_JERK_MPS2: Final = 5.0
# Shallower contacts than this are passed at speeds at which a wheel can stop or turn back within a revolution.
_SLOW_MPS2: Final = 250.0
# A contact that lasts this much longer or shorter than it should had an edge spoilt.
_SPOILT_SHARE: Final = 0.15
# Depth times period squared follows pressure and load slowly.
_DEPTH_WEIGHT: Final = 0.3
_JITTER_WEIGHT: Final = 0.1


@dataclass(frozen=True, slots=True)
class ContactPair:
    """Two neighbouring contacts: one completed revolution.

    Attributes:
        start: the contact that begins it.
        end: the contact that ends it.
        period_std: standard error of the period in samples; a contact's two edges jitter separately on a real road, and
            how much their distance varies tells how much the centre does.
        previous_period: samples of the revolution before, None when it was not seen.
        decided_at: samples before this number were there when it was decided, and no others may be used for it.
    """

    start: Contact
    end: Contact
    period_std: float
    previous_period: float | None
    decided_at: int


class ContactTrack:
    """The latest contacts of a wheel, and where the next one is to come. Deterministic."""

    def __init__(self, contacts: list[Contact], rate_hz: float, sign: int) -> None:
        """Take up a run of at least three contacts."""
        self._rate_hz = rate_hz
        self._sign = sign
        periods = [after.centre - before.centre for before, after in pairwise(contacts)]
        ratios = [periods[0] / periods[1], *(a / b for a, b in pairwise(periods))]
        self._jitter2 = float(
            np.mean([edge_jitter2(*three) for three in zip(contacts[:-1], contacts[1:], ratios, strict=True)])
        )
        self.contact = contacts[-1]
        self.periods = (periods[-2], periods[-1])
        self._depth_period2 = self.contact.depth_mps2 * self.periods[-1] ** 2
        self._turn = float(np.median([self._turn_of(*pair) for pair in pairwise(contacts)]))
        self._duty = float(np.median([c.duration / p for c, p in zip(contacts[1:], periods, strict=True)]))
        self._plan()

    def _turn_of(self, start: Contact, end: Contact, turns: int = 1) -> float:
        period_s = (end.centre - start.centre) / turns / self._rate_hz
        return float(turn(start.depth_mps2, end.depth_mps2, period_s))

    def _plan(self) -> None:
        """Set when to look for the next contact."""
        self._period = self._expected_period()
        self._width = max(3.0, self._duty * self._period)
        outer = box_offsets(self._width)[2]
        beyond = max(0.25 * self._width + outer + 1, MARGIN_SAMPLES + 2)
        self.next_index = math.ceil(self.contact.centre + self._period + beyond)
        most_s = min((_MAX_UNSEEN + 1.4) * self._period, (_MAX_UNSEEN + 0.4) * LONGEST_PERIOD_S * self._rate_hz)
        self._give_up_at = math.ceil(self.contact.centre + max(most_s, INTERVAL_RATIO * self._period) + beyond)

    def _expected_period(self) -> float:
        """Period of the next revolution at constant angular acceleration."""
        before, last = self.periods
        speed, gain = 1.0 / last, 2.0 * (1.0 / last - 1.0 / before) / (last + before)
        period = last
        for _ in range(3):
            period = 1.0 / max(speed + 0.5 * gain * (last + period), speed / INTERVAL_RATIO)
        return float(np.clip(period, last / INTERVAL_RATIO, last * INTERVAL_RATIO))

    def step(self, read: Read, missing: Missing) -> list[ContactPair] | None:
        """Look for the next contact in the samples before `next_index`; None when the wheel is lost."""
        last, end = self.contact, self.next_index
        outer = box_offsets(self._width)[2]
        first = min(max(int(last.centre + 0.5 * self._period) - outer, int(last.centre)), end)
        radial = read(first, end) * self._sign
        score, offset = dip_score(np.concatenate(([0.0], np.cumsum(radial))), self._width)
        best = self._best(score, first + offset) if len(score) else -1
        if best >= 0 and best + 0.3 * self._width >= len(score) and end < self._give_up_at:
            self.next_index = end + max(1, round(0.5 * self._width))
            return []
        if best >= 0:
            found = refine_contact(radial, float(offset + best), self._width)
            if found is not None:
                mended = mend(replace(found, centre=found.centre + first), self._width, missing)
                turns = self._turns_to(mended, read) if mended is not None else 0
                if mended is not None and turns:
                    return self._accept(mended, turns)
        if end < self._give_up_at:
            self.next_index = end + max(1, round(0.15 * self._period))
            return []
        return None

    def _best(self, score: FloatArray, first: int) -> int:
        """Place of the dip that the next contact most likely is, one or more revolutions on; -1 when there is none."""
        radius = max(1, round(0.5 * self._width))
        period = np.arange(first, first + len(score)) - self.contact.centre
        turns = np.clip(np.rint(period / self._period), 1.0, _MAX_UNSEEN + 1.0)
        # Two thirds of two periods may as well be one long one, when the wheel brakes hard.
        expected = self._depth_period2 * (turns / period) ** 2
        good = np.flatnonzero(score >= _ACCEPT_SHARE * expected)
        if not len(good):
            return -1
        groups = np.split(good, np.flatnonzero(np.diff(good) > radius) + 1)
        tops = np.array([group[int(np.argmax(score[group]))] for group in groups])
        spread = _TIME_SPREAD + min(0.25, 2.0 * math.pi * _JERK_MPS2 / max(self.contact.depth_mps2, 1.0))
        depth_off = np.log(score[tops] / expected[tops]) / _DEPTH_SPREAD
        time_off = (period[tops] / self._period - turns[tops]) / (spread * turns[tops])
        return int(tops[int(np.argmin(depth_off**2 + time_off**2 + 4.0 * (turns[tops] - 1.0)))])

    def _turns_to(self, found: Contact, read: Read) -> int:
        """How many revolutions lie between the last contact and this one; 0 when it is none of this wheel's."""
        last = self.contact
        period = found.centre - last.centre
        for turns in range(1, _MAX_UNSEEN + 2):
            one = period / turns
            limit = TURN_RATIO if turns == 1 else _UNSEEN_TURN_RATIO
            stretch = INTERVAL_RATIO if turns == 1 else _UNSEEN_PERIOD_RATIO
            own = self._turn_of(last, found, turns) / self._turn
            if 1.0 / limit < own < limit and 1.0 / stretch < one / self._period < stretch:
                return turns if self._rolled_through(last, found, read) else 0
        return 0

    def _rolled_through(self, last: Contact, found: Contact, read: Read) -> bool:
        """Whether the wheel kept rolling between two contacts."""
        shallower = min(last.depth_mps2, found.depth_mps2)
        if shallower > _SLOW_MPS2:
            return True
        first, end = round(last.centre), round(found.centre)
        radial = read(first - round(0.35 * last.duration), end + round(0.2 * found.duration)) * self._sign
        start = round(0.35 * last.duration)
        floor = 0.5 * (
            float(radial[: 2 * start + 1].mean()) + float(radial[-2 * round(0.2 * found.duration) - 1 :].mean())
        )
        level = float(radial[start : start + end - first].mean()) - floor
        return level >= float(least_level(shallower))

    def _accept(self, found: Contact, turns: int) -> list[ContactPair]:
        last, decided_at = self.contact, self.next_index
        period = (found.centre - last.centre) / turns
        expected = self._duty * period
        excess = abs(found.duration - expected)
        if excess > _SPOILT_SHARE * expected and excess**2 > 36.0 * self._jitter2:
            found = replace(found, centre_std=max(found.centre_std, 0.5 * excess))
        elif turns == 1:
            jitter2 = edge_jitter2(last, found, self.periods[-1] / period)
            self._jitter2 += _JITTER_WEIGHT * (jitter2 - self._jitter2)
        pairs: list[ContactPair] = []
        start, previous = last, self.periods[-1]
        for end in (*self._unseen(found, turns), found):
            pairs.append(ContactPair(start, end, self.period_std(start, end), previous, decided_at))
            previous = end.centre - start.centre
            start = end
        if found.centre_std < 0.1 * expected:
            self._depth_period2 += _DEPTH_WEIGHT * (found.depth_mps2 * period**2 - self._depth_period2)
            self._turn += _DEPTH_WEIGHT * (self._turn_of(last, found, turns) - self._turn)
            self._duty += _DEPTH_WEIGHT * (found.duration / period - self._duty)
        self.periods = (self.periods[-1] if turns == 1 else period, previous)
        self.contact = found
        self._plan()
        return pairs

    def _unseen(self, found: Contact, turns: int) -> list[Contact]:
        """Contacts between the last and the found one, at constant angular acceleration since the revolution before."""
        last, before = self.contact, self.periods[-1]
        whole = found.centre - last.centre
        bend = (turns / whole - 1.0 / before) / (whole + before)
        slope = 1.0 / before + bend * before
        contacts: list[Contact] = []
        for number in range(1, turns):
            # number = slope x + bend x^2, without cancellation
            root = math.sqrt(max(slope**2 + 4.0 * bend * number, 0.0))
            at = last.centre + min(2.0 * number / max(slope + root, 1e-12), whole * (number / turns + 0.2))
            depth = 0.5 * (last.depth_mps2 + found.depth_mps2)
            contacts.append(Contact(at, self._width, depth, 0.1 * self._width, predicted=True))
        return contacts

    def period_std(self, start: Contact, end: Contact) -> float:
        """Return the standard error of the time between two contacts, in samples."""
        return float(np.hypot(start.centre_std, end.centre_std).clip(min=self._jitter2**0.5))


def mend(contact: Contact, expected: float, missing: Missing) -> Contact | None:
    """Take a contact of whose edges one was lost on the link from the other edge; None when both were lost.

    Args:
        contact: in running sample numbers.
        expected: its duration as it should be, in samples.
        missing: tells lost samples.
    """
    half = 0.5 * contact.duration
    reach = max(2.0, 0.1 * expected)
    lost = [
        missing(math.floor(edge - reach), math.ceil(edge + reach) + 1) > 0
        for edge in (contact.centre - half, contact.centre + half)
    ]
    if not any(lost):
        return contact
    if all(lost):
        return None
    edge = contact.centre + (half if lost[0] else -half)
    centre = edge - (0.5 if lost[0] else -0.5) * expected
    return replace(contact, centre=centre, duration=expected, centre_std=max(contact.centre_std, 0.05 * expected))


def edge_jitter2(start: Contact, end: Contact, speed_ratio: float) -> float:
    """Square of the error of the period, in samples, that the change of the contact's length betrays.

    The period between leading edges and that between trailing edges differ by the change of the duration; their mean,
    which is the period between centres, errs by half of it. What the duration owes to the speed is no jitter.

    Args:
        start: contact at the start of the period.
        end: contact at its end.
        speed_ratio: speed at the end over speed at the start.
    """
    return (0.5 * (end.duration * speed_ratio - start.duration)) ** 2
