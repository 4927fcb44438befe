"""Incremental segmentation of one wheel's radial axis into contacts.

Every decision is made at a sample number fixed in advance and uses only the samples before it. The contacts therefore
do not depend on the chunks in which samples arrive, live or from a dump.
"""

import math
from itertools import pairwise
from typing import Final

from gateway.core.contacts.contact_tracking import ContactPair as ContactPair
from gateway.core.contacts.contact_tracking import (
    ContactTrack,
    Missing,
    Read,
    consistent,
    restore_lost_edge,
    skips_contact,
)
from gateway.core.contacts.contact_trains import LONGEST_PERIOD_S, WheelProperties
from gateway.core.contacts.segmentation import Contact, cumulative, find_contacts, is_still, refine_contact
from gateway.core.estimates.results import WheelState
from gateway.core.types import FloatArray

SEARCH_STEP_S: Final = 0.125
SEARCH_WINDOW_S: Final = 3.0
# Samples older than this are never read: more than the longest periods with unobserved contacts in between.
LOOK_BACK_S: Final = 3.4 * LONGEST_PERIOD_S
# A wheel stands still when it shows no contact for this long and its signal hardly varies.
STANDSTILL_S: Final = 2.0
# A search uses the known properties of the wheel for this long.
_TRUST_KNOWN_S: Final = 6.0
# After this number of contacts an independent search over the last periods checks them, and then at intervals that
# double from the second number to the third.
_FIRST_CHECK_CONTACTS: Final = 4
_CHECK_INTERVAL_CONTACTS: Final = (48, 192)
_CHECK_PERIODS: Final = 3.6


class Segmenter:
    """Finds the contacts of one wheel, speed and sensor direction unknown at first.

    Attributes:
        sign: +1 or -1, makes the radial axis positive inward.
        state: of the wheel.
        next_index: number of samples at which the next decision is due.
        oldest_needed: number of the oldest sample that may still be read.
    """

    def __init__(self, rate_hz: float, origin: int) -> None:
        """Start searching at sample number `origin`."""
        self._rate_hz = rate_hz
        self._step = max(1, round(SEARCH_STEP_S * rate_hz))
        self.sign = 1
        self.state = WheelState.SEARCHING
        self._track: ContactTrack | None = None
        self._origin = self._searched_from = origin
        self._search_at = origin + self._step
        self._paired_until = float(origin)
        self._until_check = _FIRST_CHECK_CONTACTS
        self._check_interval = _CHECK_INTERVAL_CONTACTS[0]
        # Whether loss hid contacts since the last check of a stretch without loss.
        self._is_uncertain = False
        self._properties: WheelProperties | None = None
        self._schedule_decision()

    def _schedule_decision(self) -> None:
        """Set when the next decision is due, and which samples it needs."""
        window = round(SEARCH_WINDOW_S * self._rate_hz)
        if self._track is None:
            self.next_index = self._search_at
            self.oldest_needed = max(self._origin, self._search_at - window)
            return
        self.next_index = self._track.next_index
        last = self._track.contact
        look_back = max(_CHECK_PERIODS * self._track.periods[-1], 3.0 * last.duration)
        self.oldest_needed = max(self._origin, int(last.centre - min(look_back, window)) - 2)

    def advance(self, read: Read, missing: Missing, head: int) -> list[ContactPair]:
        """Make every decision that is due with samples up to `head`; return the completed revolutions."""
        pairs: list[ContactPair] = []
        while self.next_index <= head:
            pairs += self._decide(read, missing)
            self._schedule_decision()
        return pairs

    def finish(self, read: Read, missing: Missing, head: int) -> list[ContactPair]:
        """Make the remaining decisions with the samples available, when no more will come."""
        pairs = self.advance(read, missing, head)
        for _ in range(4):
            if self.next_index <= head:
                break
            if self._track is not None:
                self._track.next_index = head
            else:
                self._search_at = head
            pairs += self._decide(read, missing)
            self._schedule_decision()
            pairs += self.advance(read, missing, head)
        return pairs

    def _decide(self, read: Read, missing: Missing) -> list[ContactPair]:
        if self._track is None:
            return self._search(read, missing)
        end, last = self._track.next_index, self._track.contact
        pairs = self._track.step(read, missing)
        if pairs is None:
            self._lose(int(last.centre - 2.0 * last.duration), end)
            return []
        if pairs:
            self._paired_until = self._track.contact.centre
            self._is_uncertain |= len(pairs) > 1
            self._check(read, missing, end)
        return pairs

    def _search(self, read: Read, missing: Missing) -> list[ContactPair]:
        end = self._search_at
        first = max(self._origin, end - round(SEARCH_WINDOW_S * self._rate_hz))
        searched_s = (end - self._searched_from) / self._rate_hz
        self._search_at = end + (self._step if searched_s < SEARCH_WINDOW_S else 2 * self._step)
        radial = read(first, end)
        # The known properties may be wrong, so they are dropped after a time.
        prior = self._properties if searched_s < _TRUST_KNOWN_S else None
        coarse, sign = find_contacts(radial, self._rate_hz, prior)
        contacts = self._latest_placed(coarse, radial * sign, first, missing)
        if self._skips_any(contacts, sign, read, missing):
            self._origin = int(contacts[-1].centre - 2.0 * contacts[-1].duration)
            return []
        if len(contacts) < 3:
            if not coarse and searched_s >= STANDSTILL_S:
                self.state = WheelState.STANDSTILL if is_still(radial, self._rate_hz) else WheelState.SEARCHING
            return []
        self.sign = sign
        self.state = WheelState.ROLLING
        track = self._track = ContactTrack(contacts, self._rate_hz, sign)
        self._until_check, self._check_interval = _FIRST_CHECK_CONTACTS, _CHECK_INTERVAL_CONTACTS[0]
        self._is_uncertain = missing(math.floor(contacts[0].centre), math.ceil(track.contact.centre)) > 0
        pairs: list[ContactPair] = []
        previous: float | None = None
        for start, following in pairwise(contacts):
            if start.centre > self._paired_until - 0.5 * start.duration:
                pairs.append(ContactPair(start, following, track.period_std(start, following), previous, end))
            previous = following.centre - start.centre
        self._paired_until = track.contact.centre
        return pairs

    def _latest_placed(
        self, coarse: list[tuple[float, float, float]], radial: FloatArray, first: int, missing: Missing
    ) -> list[Contact]:
        """Return the latest run of at least three consistent contacts, located exactly; empty when there is none."""
        runs: list[list[Contact]] = [[]]
        prefix = cumulative(radial) if coarse else None
        for centre, _, width in coarse:
            contact = refine_contact(radial, first + centre, width, prefix=prefix, first=first)
            if contact is not None:
                contact = restore_lost_edge(contact, contact.duration, missing)
            if contact is None:
                runs.append([])
            elif not runs[-1] or consistent(runs[-1], contact):
                runs[-1].append(contact)
            else:
                runs.append([contact])
        return next((run for run in reversed(runs) if len(run) >= 3), [])

    def _skips_any(self, contacts: list[Contact], sign: int, read: Read, missing: Missing) -> bool:
        """Return whether the signal of a pair of contacts without loss shows another one between them."""
        return any(
            not missing(math.ceil(last.centre), math.floor(contact.centre))
            and skips_contact(last, contact, self._rate_hz, read, sign)
            for last, contact in pairwise(contacts)
        )

    def _lose(self, resume: int, decided_at: int) -> None:
        """Search again from sample `resume` on; decisions continue from `decided_at`."""
        self.state = WheelState.SEARCHING
        if self._track is not None:
            skips = self._track.skips_contacts
            self._properties = None if skips else self._track.properties or self._properties
        self._track = None
        self._origin = max(resume, self._origin)
        self._searched_from = decided_at
        self._search_at = decided_at + self._step

    def _check(self, read: Read, missing: Missing, end: int) -> None:
        """Drop the track if an independent search over the last revolutions finds its contacts elsewhere.

        It is made at intervals, and where loss hid contacts as soon as these revolutions lost nothing.
        """
        track = self._track
        assert track is not None
        self._until_check -= 1
        span = round(_CHECK_PERIODS * track.periods[-1])
        contact = track.contact
        first = max(int(contact.centre) - span, self._origin)
        has_recovered = self._is_uncertain and not missing(first, end)
        if not (self._until_check <= 0 or has_recovered) or span > SEARCH_WINDOW_S * self._rate_hz:
            return
        if has_recovered:
            self._is_uncertain = False
        else:
            self._until_check = self._check_interval
            self._check_interval = min(2 * self._check_interval, _CHECK_INTERVAL_CONTACTS[1])
        contacts, sign = find_contacts(read(first, end), self._rate_hz)
        matches = [
            abs(first + centre - tracked.centre) <= 0.75 * tracked.duration
            for centre, _, _ in contacts
            for tracked in track.recent
        ]
        if contacts and (sign != self.sign or not any(matches)):
            self._lose(first, end)
            self._properties = None
