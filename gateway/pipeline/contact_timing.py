"""Contact times refined against the running average of a wheel's revolutions.

The segmenter finds contacts by two level crossings, without knowledge of the tire. Once there is an average, each
contact is matched with it, using the same samples. The time of a contact is a weighted mean of those of its edges. The
weights minimise its variance, which has two parts. One is the jitter of each edge: on a real tire the leading edge
jitters several times as much as the trailing one. The other is the speed at the contact, which is extrapolated from the
revolutions before it: its error shifts the two edges by amounts proportional to their angles, in opposite directions.

The average changes while it is built up. The shift of each new template against the one before it is measured and
compensated, so that all contacts are timed at the same point of the belt.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gateway.pipeline.segmenter import ContactPair
from gateway.signal.angle_resampling import GRID_SIZE, MARGIN_SAMPLES, Phase, fit_phase
from gateway.signal.contact_template import (
    ContactMatch,
    ContactTemplate,
    contact_template,
    match_contact,
    template_shift,
)
from gateway.signal.synchronous_average import AngleAverage
from gateway.types import FloatArray

# The timed point moves to the template's centre in steps of at most this many standard errors of the time. A sudden
# correction would appear as a step of the speed.
_ANCHOR_STEP: Final = 0.2
# The template is extracted again after this many revolutions, or when their number has grown by this ratio.
_TEMPLATE_INTERVAL: Final = 8
_TEMPLATE_GROWTH: Final = 1.25
# Updates from which the estimate of the edges' jitter is used, and least weight of an update of a running mean.
_MIN_JITTER_UPDATES: Final = 8
_LEAST_WEIGHT: Final = 0.05
# Revolutions in the average from which its scatter is known. Before, it contains only the sensor's noise.
_SCATTER_KNOWN: Final = 3
# Error of either edge per change of the half angle against the template's: its shape is that at another load.
_OTHER_LOAD_SHARE: Final = 0.2
# Angle by which the point of the belt that level crossings find may differ from the refined one.
_CROSSING_STD_RAD: Final = 1e-3
# Relative error of the speed at a contact before it is measured, counted as one value.
_RATE_ERROR_PRIOR: Final = 1e-3
# Shift of a contact, rad, per relative error of its speed, that remains with weights for which the shifts of both edges
# cancel: quadratic phase, Euler acceleration and change of the centripetal acceleration across the contact.
_RATE_SHIFT_RAD: Final = 0.02


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


class _RunningMean:
    """Running mean of a scalar or an array; a plain mean at first, then exponentially weighted."""

    def __init__(self, start: float | FloatArray = 0.0, count: int = 0) -> None:
        """Start at `start`, counted as `count` values."""
        self.value: float | FloatArray = start
        self.count = count

    def add(self, value: float | FloatArray) -> None:
        """Add a value."""
        self.count += 1
        self.value = self.value + max(1.0 / self.count, _LEAST_WEIGHT) * (value - self.value)


class ContactTimer:
    """Refines the contacts of one wheel, revolution by revolution. Deterministic."""

    def __init__(self) -> None:
        """Start without contacts or jitter."""
        self.reset()

    def reset(self) -> None:
        """Forget contacts and jitter, as after a gap in the samples."""
        self._last: TimedContact | None = None
        self._previous_period: float | None = None
        self._rates: list[float] = []
        # Relative variance of the speed extrapolated to a contact.
        self._rate_error2 = _RunningMean(_RATE_ERROR_PRIOR**2, 1)
        self._times: list[tuple[float, float]] = []
        self._jitter = _RunningMean(np.zeros(3))
        self._noise_share = _RunningMean(np.ones(2))
        self._template: ContactTemplate | None = None
        self._template_count = 0
        # Angles from the template's angle 0 to the points of the belt at which the two edges are timed; None before the
        # first match. Mean angle between the times of the two.
        self._points: FloatArray | None = None
        self._apart_rad = _RunningMean()

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
        refined = math.isfinite(start.trailing_rad), math.isfinite(end.leading_rad)
        period_std = math.hypot(start.centre_std, end.centre_std)
        if not all(refined):
            # The segmenter's standard error, which includes jitter, applies to contacts that were not refined.
            period_std = max(period_std, pair.period_std)
        if any(refined) and not all(refined):
            crossing_std = _CROSSING_STD_RAD * (end.centre - start.centre) / (2.0 * math.pi)
            period_std = math.hypot(period_std, crossing_std)
        self._last, self._previous_period = end, end.centre - start.centre
        self._update_rate_error(self._previous_period)
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
        timed = self._timed(guess, first, match, template, float(np.square(average.scatter_mps2).mean()))
        if average.count < _SCATTER_KNOWN:
            point_std = 0.5 * _CROSSING_STD_RAD / rate
            return replace(timed, centre_std=max(timed.centre_std, math.hypot(coarse.centre_std, point_std)))
        return timed

    def _template_of(self, average: AngleAverage, samples: float) -> ContactTemplate | None:
        """Return the template, extracted again when the average has changed enough."""
        grown = average.count >= _TEMPLATE_GROWTH * self._template_count
        if self._template is None or grown or average.count - self._template_count >= _TEMPLATE_INTERVAL:
            latest = contact_template(average.radial_mps2, average.omega_radps, samples, average.scatter_mps2)
            if self._points is not None and self._template is not None and latest is not None:
                self._points = self._points + template_shift(self._template, average.radial_mps2, average.omega_radps)
            else:
                self._points = None
            self._template = latest
            self._template_count = average.count
        return self._template

    def _timed(
        self, found: float, first: int, match: ContactMatch, template: ContactTemplate, scatter2: float
    ) -> TimedContact:
        """Combine the two edges with the weights of least variance."""
        if self._points is None:
            self._points = np.full(2, template.middle_rad)
            self._apart_rad = _RunningMean()
        edges = template.edges
        seen = np.array([match.leading, match.trailing]) + first
        leading, trailing = (seen + self._points / match.rate).tolist()
        self._update_jitter(leading, trailing)
        self._apart_rad.add((trailing - leading) * match.rate)
        apart = float(self._apart_rad.value) / match.rate
        # The scatter of the average includes the jitter of the edges; the residual of the match does not.
        if scatter2 > 0.0:
            self._noise_share.add(np.square(match.residual_mps2) / scatter2)
        noise = np.tensordot(self._noise_share.value, match.covariances, 1)
        angles = np.array([edges.leading_rad, edges.trailing_rad]) / match.rate
        rate_error2 = float(self._rate_error2.value)
        stretch = rate_error2 * (np.outer(angles, angles) + (_RATE_SHIFT_RAD / match.rate) ** 2)
        variance = noise
        if self._jitter.count >= _MIN_JITTER_UPDATES:
            # The common part of both edges is due to speed and is no error. Each edge has at least its noise.
            jitter = np.asarray(self._jitter.value)
            common = min(float(noise[0, 1]), jitter[1])
            own = jitter[[0, 2]] - jitter[1] - (np.diag(stretch) - stretch[0, 1])
            variance = common + np.diag(np.maximum(np.diag(noise) - noise[0, 1], own))
        variance = variance + stretch
        total = float(variance.trace() - 2.0 * variance[0, 1])
        share = float(variance[0, 0] - variance[0, 1]) / total if total > 0.0 and math.isfinite(total) else 0.5
        weights = np.array([1.0 - share, share])
        centre_std = math.sqrt(max(float(weights @ (noise + stretch) @ weights), float(weights @ variance @ weights)))
        # A change of the weights must not move the timed point: only the distance's deviation from its mean counts.
        centre = leading + share * (trailing - leading - apart) + 0.5 * apart
        step = template.middle_rad - float(self._points.mean())
        limit = _ANCHOR_STEP * centre_std * match.rate
        self._points = self._points + min(max(step, -limit), limit)
        other_load = _OTHER_LOAD_SHARE * 0.5 * float(seen[1] - seen[0]) * match.rate
        edge_stds = np.hypot(np.sqrt(np.diag(noise + stretch)) * match.rate, other_load)
        return TimedContact(
            found=found,
            centre=centre,
            centre_std=centre_std,
            leading_rad=edges.leading_rad + (float(seen[0]) - centre) * match.rate,
            trailing_rad=edges.trailing_rad + (float(seen[1]) - centre) * match.rate,
            leading_std_rad=math.hypot(edges.leading_std_rad, float(edge_stds[0])),
            trailing_std_rad=math.hypot(edges.trailing_std_rad, float(edge_stds[1])),
        )

    def _update_rate_error(self, period: float) -> None:
        """Estimate the error of the speed at a contact, extrapolated from two revolutions at constant acceleration.

        The speed at the contact between two revolutions is about the mean of theirs. The extrapolation from the two
        revolutions before the contact differs from it by half of the second difference of three mean speeds.
        """
        self._rates = [*self._rates[-2:], 1.0 / period]
        if len(self._rates) == 3:
            before, last, now = self._rates
            self._rate_error2.add((0.5 * (now - 2.0 * last + before) / last) ** 2)

    def _update_jitter(self, leading: float, trailing: float) -> None:
        """Estimate the jitter of each edge from the second differences of its times.

        Changes of speed are common to both edges, jitter is not. With the mean products of second differences over 6,
        the variance of the leading edge is leading times leading minus leading times trailing; likewise for trailing.
        """
        self._times = [*self._times[-2:], (leading, trailing)]
        if len(self._times) == 3:
            one, other = (a - 2.0 * b + c for a, b, c in zip(*self._times, strict=True))
            self._jitter.add(np.array([one * one, one * other, other * other]) / 6.0)
