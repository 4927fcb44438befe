"""Pairs of contacts, what contacts of one wheel have in common, and what is left of one that lost an edge."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np

from gateway.signal.contact_trains import least_level, turn
from gateway.signal.segmentation import Contact
from gateway.types import FloatArray

# missing(first, end) -> how many of these samples were lost and filled
Missing = Callable[[int, int], int]

# How much size and turn of neighbours in a run may differ.
_RUN_SIZE_RATIO: Final = 1.5
_RUN_TURN_RATIO: Final = 1.25
# By how much, for a contact's depth, the signal anywhere between two contacts exceeds that in them: the wheel's speed
# may change, and gravity takes two g between the contact and the top.
_EVERYWHERE_SHARE: Final = 0.55
_EVERYWHERE_GRAVITY_MPS2: Final = 20.0


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


def size(contact: Contact) -> float:
    """Return duration times the square root of the depth, the same for all contacts of a wheel at any speed."""
    return contact.duration * math.sqrt(contact.depth_mps2)


def consistent(run: list[Contact], contact: Contact) -> bool:
    """Whether a contact may follow a run of contacts of the same wheel, now that they are placed exactly."""
    last = run[-1]
    if not 1.0 / _RUN_SIZE_RATIO < size(contact) / size(last) < _RUN_SIZE_RATIO:
        return False
    if len(run) < 2:
        return True
    before = float(turn(run[-2].depth_mps2, last.depth_mps2, last.centre - run[-2].centre))
    after = float(turn(last.depth_mps2, contact.depth_mps2, contact.centre - last.centre))
    return 1.0 / _RUN_TURN_RATIO < after / before < _RUN_TURN_RATIO


def kept_rolling(radial_mps2: FloatArray, first: int, last: Contact, found: Contact, turns: int) -> bool:
    """Tell whether a slow wheel kept rolling from one contact to another, neither stopping nor turning back.

    Args:
        radial_mps2: radial axis, positive inward, from within the one contact to within the other.
        first: number of its first sample.
        last: the earlier contact.
        found: the later one.
        turns: revolutions between them.
    """
    start, end = round(last.centre) - first, round(found.centre) - first
    inside = round(0.2 * found.duration)
    floor = 0.5 * (
        float(radial_mps2[: 2 * start + 1].mean()) + float(radial_mps2[end - inside : end + inside + 1].mean())
    )
    shallower = min(last.depth_mps2, found.depth_mps2)
    if float(radial_mps2[start:end].mean()) - floor < float(least_level(shallower)):
        return False
    least = _EVERYWHERE_SHARE * shallower - _EVERYWHERE_GRAVITY_MPS2
    one = (end - start) / turns
    edges = [round(start + (number + share) * one) for number in range(turns) for share in (0.2, 0.4, 0.6, 0.8)]
    parts = [radial_mps2[lo:hi] for place, (lo, hi) in enumerate(pairwise(edges)) if place % 4 < 3]
    # An impact is no stop: medians.
    return all(float(np.median(part)) - floor >= least for part in parts)


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
