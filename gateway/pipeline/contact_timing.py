"""Contact times refined against the running average of a wheel's revolutions.

The segmenter finds contacts by two level crossings, without knowledge of the tire. Once there is an average, each
contact is matched with it, using the same samples. The time of a contact is a weighted mean of those of its edges. The
weights follow the jitter of each edge: on a real tire the leading edge jitters several times as much as the trailing
one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.pipeline.segmenter import ContactPair
from gateway.signal.angle_resampling import GRID_SIZE, MARGIN_SAMPLES, Phase, fit_phase
from gateway.signal.contact_template import ContactMatch, ContactTemplate, contact_template, match_contact
from gateway.signal.synchronous_average import AngleAverage
from gateway.types import FloatArray

# Share of the distance between the template's centre and angle 0 that is corrected per revolution. A sudden correction
# would appear as a step of the speed.
_ANCHOR_SHARE: Final = 0.5
# The template is extracted again after this many revolutions, or when their number has grown by this ratio.
_TEMPLATE_INTERVAL: Final = 8
_TEMPLATE_GROWTH: Final = 1.25
# Updates from which the estimate of the edges' jitter is used, and least weight of an update.
_MIN_JITTER_UPDATES: Final = 8
_JITTER_WEIGHT: Final = 0.05


@dataclass(frozen=True, slots=True)
class TimedContact:
    """A contact in running sample numbers.

    Attributes:
        found: centre as the segmenter found it; identifies the contact.
        centre: refined centre.
        centre_std: standard error.
        leading_rad: leading edge from `centre`; NaN when not refined.
        trailing_rad: trailing edge.
        leading_std_rad: standard error, including the uncertainty of the edge's definition.
        trailing_std_rad: likewise.
    """

    found: float
    centre: float
    centre_std: float
    leading_rad: float = math.nan
    trailing_rad: float = math.nan
    leading_std_rad: float = math.nan
    trailing_std_rad: float = math.nan


@dataclass(frozen=True, slots=True)
class TimedPair:
    """One revolution between two refined contacts; its trailing edge is that of `start`, its leading one of `end`."""

    start: TimedContact
    end: TimedContact
    previous_period: float | None
    period_std: float


class ContactTimer:
    """Refines the contacts of one wheel, revolution by revolution. Deterministic."""

    def __init__(self) -> None:
        """Start without contacts or jitter."""
        self.reset()

    def reset(self) -> None:
        """Forget contacts and jitter, as after a gap in the samples."""
        self._last: TimedContact | None = None
        self._previous_period: float | None = None
        self._times: list[tuple[float, float]] = []
        self._jitter = np.zeros(3)
        self._jitters = 0
        self._noise_share = np.ones(2)
        self._shares = 0
        self._template: ContactTemplate | None = None
        self._template_count = 0

    def time(
        self,
        pair: ContactPair,
        average: AngleAverage | None,
        read: Callable[[int, int], FloatArray],
        missing: Callable[[int, int], int],
        rate_hz: float,
    ) -> TimedPair:
        """Refine a revolution's contacts.

        Args:
            pair: contacts as segmented.
            average: running average of the revolutions before it, None when there is none.
            read: returns the radial axis, positive inward, of samples first to end (exclusive).
            missing: returns how many of these samples were lost.
            rate_hz: sampling rate.
        """
        start, previous = self._last, self._previous_period
        if start is None or start.found != pair.start.centre:
            self._times.clear()
            start = TimedContact(pair.start.centre, pair.start.centre, pair.start.centre_std)
            previous = pair.previous_period
        end = self._refine(pair, start.centre, previous, average, read, missing, rate_hz)
        refined = math.isfinite(end.leading_rad) and math.isfinite(start.trailing_rad)
        # The segmenter's standard error, which includes jitter, applies to contacts that were not refined.
        period_std = math.hypot(start.centre_std, end.centre_std) if refined else pair.period_std
        self._last, self._previous_period = end, end.centre - start.centre
        return TimedPair(start, end, previous, period_std)

    def _refine(
        self,
        pair: ContactPair,
        start: float,
        previous: float | None,
        average: AngleAverage | None,
        read: Callable[[int, int], FloatArray],
        missing: Callable[[int, int], int],
        rate_hz: float,
    ) -> TimedContact:
        guess = pair.end.centre
        coarse = TimedContact(guess, guess, pair.end.centre_std)
        if average is None or pair.end.predicted:
            self._times.clear()
            return coarse
        phase = fit_phase(start, guess, start - previous if previous is not None else None)
        template = self._template_of(average, phase.samples)
        rate = phase.rate + phase.acceleration * phase.samples
        match = None
        if template is not None:
            before, after = (rate**-1.0 * float(template.angles_rad[at]) for at in (0, -1))
            first = max(math.floor(guess + before) - MARGIN_SAMPLES, math.ceil(start))
            last = min(math.ceil(guess + after) + MARGIN_SAMPLES, pair.decided_at)
            if last > first and not missing(first, last):
                passage = Phase(guess - first, guess - first + phase.samples, rate, phase.acceleration)
                variance = np.square(average.orders_std_mps2) * average.effective_count
                match = match_contact(template, read(first, last), passage, rate_hz, variance, GRID_SIZE)
        if match is None or template is None:
            self._times.clear()
            return coarse
        return self._timed(guess, first, match, template, float(np.square(average.scatter_mps2).mean()))

    def _template_of(self, average: AngleAverage, samples: float) -> ContactTemplate | None:
        """Return the template, extracted again when the average has changed enough."""
        grown = average.count >= _TEMPLATE_GROWTH * self._template_count
        if self._template is None or grown or average.count - self._template_count >= _TEMPLATE_INTERVAL:
            self._template = contact_template(average.radial_mps2, average.omega_radps, samples)
            self._template_count = average.count
        return self._template

    def _timed(
        self, found: float, first: int, match: ContactMatch, template: ContactTemplate, scatter2: float
    ) -> TimedContact:
        """Combine the two edges, each weighted by its stability."""
        leading, trailing = match.leading + first, match.trailing + first
        self._update_jitter(leading, trailing)
        # The scatter of the average includes the jitter of the edges; the residual of the match does not.
        if scatter2 > 0.0:
            self._shares += 1
            weight = max(1.0 / self._shares, _JITTER_WEIGHT)
            change = np.square(match.residual_mps2) / scatter2 - self._noise_share
            self._noise_share = self._noise_share + weight * change
        covariance = np.tensordot(self._noise_share, match.covariances, 1)
        variance = covariance
        if self._jitters >= _MIN_JITTER_UPDATES:
            # The common part of both edges is due to speed and is no error. Each edge has at least its noise.
            common = min(float(covariance[0, 1]), self._jitter[1])
            own = np.maximum(np.diag(covariance) - covariance[0, 1], self._jitter[[0, 2]] - self._jitter[1])
            variance = common + np.diag(own)
        total = float(variance.trace() - 2.0 * variance[0, 1])
        share = float(variance[0, 0] - variance[0, 1]) / total if total > 0.0 and math.isfinite(total) else 0.5
        weights = np.array([1.0 - share, share])
        centre_var = max(float(weights @ covariance @ weights), float(weights @ variance @ weights))
        edges = template.edges
        centre = leading + share * (trailing - leading) + _ANCHOR_SHARE * template.middle_rad / match.rate
        return TimedContact(
            found=found,
            centre=centre,
            centre_std=math.sqrt(centre_var),
            leading_rad=edges.leading_rad + (leading - centre) * match.rate,
            trailing_rad=edges.trailing_rad + (trailing - centre) * match.rate,
            leading_std_rad=math.hypot(edges.leading_std_rad, math.sqrt(covariance[0, 0]) * match.rate),
            trailing_std_rad=math.hypot(edges.trailing_std_rad, math.sqrt(covariance[1, 1]) * match.rate),
        )

    def _update_jitter(self, leading: float, trailing: float) -> None:
        """Estimate the jitter of each edge from the second differences of its times.

        Changes of speed are common to both edges, jitter is not. With the mean products of second differences over 6,
        the variance of the leading edge is leading times leading minus leading times trailing; likewise for trailing.
        """
        self._times = [*self._times[-2:], (leading, trailing)]
        if len(self._times) < 3:
            return
        one, other = (a - 2.0 * b + c for a, b, c in zip(*self._times, strict=True))
        self._jitters += 1
        weight = max(1.0 / self._jitters, _JITTER_WEIGHT)
        products = np.array([one * one, one * other, other * other]) / 6.0
        self._jitter = self._jitter + weight * (products - self._jitter)
