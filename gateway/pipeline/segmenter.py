"""Incremental segmentation of one wheel's radial axis into contacts.

Every decision is taken at a sample number fixed in advance, on the samples before it and no others. Whatever the chunks
in which samples arrive, live or from a dump, the same samples give the same contacts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.pipeline.results import WheelState
from gateway.signal.resample import MARGIN_SAMPLES
from gateway.signal.segmentation import (
    INTERVAL_RATIO,
    Contact,
    box_offsets,
    dip_score,
    find_contacts,
    refine_contact,
)

FloatArray = NDArray[np.float64]
# read(first, end) -> nominally inward radial acceleration of the samples first to end (exclusive), m/s^2
Read = Callable[[int, int], FloatArray]
# missing(first, end) -> how many of these samples were lost and filled
Missing = Callable[[int, int], int]

SEARCH_STEP_S: Final = 0.125
SEARCH_WINDOW_S: Final = 3.0
# A wheel that shows no contact for this long, and no signal either, stands still.
STANDSTILL_S: Final = 2.0
STANDSTILL_STD_MPS2: Final = 2.5
# A dip is the next contact when it has this share of the depth that its period asks for.
_ACCEPT_SHARE: Final = 0.45
# A contact lost on the link is predicted; two in a row at most, then the wheel is searched for anew.
_MAX_PREDICTED: Final = 2
# After so many contacts, and then every so many, an unprejudiced search looks whether these are the contacts at all.
_FIRST_CHECK: Final = 4
_CHECK_EVERY: Final = 32
_CHECK_PERIODS: Final = 3.6
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


class Segmenter:
    """Finds the contacts of one wheel, speed and sensor direction unknown at first."""

    def __init__(self, rate_hz: float, origin: int) -> None:
        """Start searching at sample number `origin`."""
        self._rate_hz = rate_hz
        self._step = max(1, round(SEARCH_STEP_S * rate_hz))
        self.sign = 1
        self.state = WheelState.SEARCHING
        self._begin_search(origin)
        self._paired_until = float(origin)

    def _begin_search(self, origin: int) -> None:
        self._origin = origin
        self._searched_from = origin
        self._contact: Contact | None = None
        self._periods: tuple[float, ...] = ()
        self._predicted = 0
        self.next_index = origin + self._step

    @property
    def oldest_needed(self) -> int:
        """Samples before this one are not looked at again."""
        if self._contact is None:
            return max(self._origin, self.next_index - round(SEARCH_WINDOW_S * self._rate_hz))
        back = max(_CHECK_PERIODS * self._periods[-1], 3.0 * self._contact.duration)
        return int(self._contact.centre - min(back, SEARCH_WINDOW_S * self._rate_hz)) - 2

    def advance(self, read: Read, missing: Missing, head: int) -> list[ContactPair]:
        """Take every decision that is due with samples up to `head`; returns completed revolutions."""
        pairs: list[ContactPair] = []
        while self.next_index <= head:
            pairs += self._search(read) if self._contact is None else self._track(read, missing)
        return pairs

    def finish(self, read: Read, missing: Missing, head: int) -> list[ContactPair]:
        """No more samples will come: decide with what is there."""
        pairs = self.advance(read, missing, head)
        for _ in range(4):
            if self.next_index <= head:
                break
            self.next_index = head
            pairs += self._search(read) if self._contact is None else self._track(read, missing)
            pairs += self.advance(read, missing, head)
        return pairs

    def _search(self, read: Read) -> list[ContactPair]:
        end = self.next_index
        first = max(self._origin, end - round(SEARCH_WINDOW_S * self._rate_hz))
        searched_s = (end - self._searched_from) / self._rate_hz
        self.next_index = end + (self._step if searched_s < SEARCH_WINDOW_S else 2 * self._step)
        radial = read(first, end)
        coarse, sign = find_contacts(radial, self._rate_hz)
        if not coarse:
            if searched_s >= STANDSTILL_S:
                self.state = WheelState.STANDSTILL if self._is_still(radial) else WheelState.SEARCHING
            return []
        signed = radial * sign
        refined = [refine_contact(signed, at, width) for at, _, width in coarse]
        while refined and refined[0] is None:
            refined.pop(0)
        contacts: list[Contact] = []
        for contact in refined:
            if contact is None:
                break
            contacts.append(replace(contact, centre=contact.centre + first))
        if len(contacts) < 3:
            return []
        self.sign = sign
        self.state = WheelState.ROLLING
        intervals = [following.centre - start.centre for start, following in pairwise(contacts)]
        ratios = [intervals[0] / intervals[1], *(before / after for before, after in pairwise(intervals))]
        neighbours = zip(pairwise(contacts), ratios, strict=True)
        self._jitter2 = float(np.mean([_edge_jitter2(*pair, ratio) for pair, ratio in neighbours]))
        pairs: list[ContactPair] = []
        previous: float | None = None
        for start, following in pairwise(contacts):
            if start.centre > self._paired_until - 0.5 * start.duration:
                pairs.append(ContactPair(start, following, self._period_std(start, following), previous, end))
            previous = following.centre - start.centre
        self._contact = contacts[-1]
        self._periods = (intervals[-2], intervals[-1])
        self._depth_period2 = self._contact.depth_mps2 * self._periods[-1] ** 2
        self._duty = self._contact.duration / self._periods[-1]
        self._predicted = 0
        self._until_check = _FIRST_CHECK
        self._paired_until = self._contact.centre
        self._plan_next()
        return pairs

    def _is_still(self, radial: FloatArray) -> bool:
        box = max(1, round(0.05 * self._rate_hz))
        n = len(radial) // box * box
        return n >= 4 * box and float(radial[:n].reshape(-1, box).mean(axis=1).std()) < STANDSTILL_STD_MPS2

    def _expected_period(self) -> float:
        """Period of the next revolution at constant angular acceleration."""
        last = self._periods[-1]
        if len(self._periods) < 2:
            return last
        before = self._periods[-2]
        speed, gain = 1.0 / last, 2.0 * (1.0 / last - 1.0 / before) / (last + before)
        period = last
        for _ in range(3):
            period = 1.0 / max(speed + 0.5 * gain * (last + period), speed / INTERVAL_RATIO)
        return float(np.clip(period, last / INTERVAL_RATIO, last * INTERVAL_RATIO))

    def _plan_next(self) -> None:
        assert self._contact is not None
        self._period = self._expected_period()
        self._width = max(3.0, self._duty * self._period)
        outer = box_offsets(self._width)[2]
        beyond = max(0.25 * self._width + outer + 1, MARGIN_SAMPLES + 2)
        self.next_index = int(np.ceil(self._contact.centre + self._period + beyond))

    def _track(self, read: Read, missing: Missing) -> list[ContactPair]:
        last = self._contact
        assert last is not None
        end = self.next_index
        outer = box_offsets(self._width)[2]
        first = max(int(last.centre + 0.5 * self._period) - outer, int(last.centre))
        radial = read(min(first, end), end) * self.sign
        score, offset = dip_score(np.concatenate(([0.0], np.cumsum(radial))), self._width)
        if len(score):
            at = np.arange(first + offset, first + offset + len(score))
            expected = self._depth_period2 / (at - last.centre) ** 2
            accepted = np.flatnonzero(score >= _ACCEPT_SHARE * expected)
            if len(accepted):
                begin = int(accepted[0])
                best = begin + int(np.argmax(score[begin : begin + round(2 * self._width) + 1]))
                if best + 0.3 * self._width >= len(score) and end < last.centre + INTERVAL_RATIO * self._period:
                    self.next_index = end + max(1, round(0.5 * self._width))
                    return []
                found = refine_contact(radial, float(offset + best), self._width)
                if found is not None:
                    pairs = self._accept(replace(found, centre=found.centre + first))
                    self._check(read, end)
                    return pairs
        if end < last.centre + INTERVAL_RATIO * self._period + outer:
            self.next_index = end + max(1, round(0.15 * self._period))
            return []
        return self._coast(last, missing)

    def _coast(self, last: Contact, missing: Missing) -> list[ContactPair]:
        """The contact did not come: predict it when its samples were lost, else search anew."""
        centre = last.centre + self._period
        reach = 0.75 * self._width
        lost = missing(int(centre - reach), int(centre + reach) + 1)
        if lost >= 0.2 * self._width and self._predicted < _MAX_PREDICTED:
            self._predicted += 1
            return self._accept(Contact(centre, self._width, last.depth_mps2, 0.1 * self._width, predicted=True))
        self._lose(int(last.centre - 2.0 * last.duration))
        return []

    def _lose(self, resume: int) -> None:
        """Search anew from sample `resume` on, decisions going on where they stand."""
        self.state = WheelState.SEARCHING
        now = self.next_index
        self._begin_search(max(resume, 0))
        self._searched_from = now
        self.next_index = now + self._step

    def _check(self, read: Read, end: int) -> None:
        """Give up contacts that an unprejudiced search over the last revolutions places elsewhere."""
        self._until_check -= 1
        contact = self._contact
        assert contact is not None
        span = round(_CHECK_PERIODS * self._periods[-1])
        if self._until_check > 0 or span > SEARCH_WINDOW_S * self._rate_hz:
            return
        self._until_check = _CHECK_EVERY
        first = max(int(contact.centre) - span, self._origin)
        found, sign = find_contacts(read(first, end), self._rate_hz)
        if found and (
            sign != self.sign or all(abs(first + at - contact.centre) > contact.duration for at, _, _ in found)
        ):
            self._lose(first)

    def _period_std(self, start: Contact, end: Contact) -> float:
        return float(np.hypot(start.centre_std, end.centre_std).clip(min=self._jitter2**0.5))

    def _accept(self, contact: Contact) -> list[ContactPair]:
        last = self._contact
        assert last is not None
        period = contact.centre - last.centre
        if not contact.predicted:
            self._predicted = 0
            weight = _DEPTH_WEIGHT
            if not last.predicted:
                jitter2 = _edge_jitter2(last, contact, self._periods[-1] / period)
                self._jitter2 += _JITTER_WEIGHT * (jitter2 - self._jitter2)
            self._depth_period2 += weight * (contact.depth_mps2 * period**2 - self._depth_period2)
            self._duty += weight * (contact.duration / period - self._duty)
        pair = ContactPair(last, contact, self._period_std(last, contact), self._periods[-1], self.next_index)
        self._periods = (self._periods[-1], period)
        self._contact = contact
        self._paired_until = contact.centre
        self._plan_next()
        return [pair]


def _edge_jitter2(start: Contact, end: Contact, speed_ratio: float) -> float:
    """Square of the error of the period, in samples, that the change of the contact's length betrays.

    The period between leading edges and that between trailing edges differ by the change of the duration; their mean,
    which is the period between centres, errs by half of it. What the duration owes to the speed is no jitter.

    Args:
        start: contact at the start of the period.
        end: contact at its end.
        speed_ratio: speed at the end over speed at the start.
    """
    return (0.5 * (end.duration * speed_ratio - start.duration)) ** 2
