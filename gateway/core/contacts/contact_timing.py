"""Contact times refined against the running average of a wheel's revolutions.

The segmenter finds contacts by two level crossings, without knowledge of the tire. Once there is an average, each
contact is matched with it, using the same samples. The time of a contact is a weighted mean of those of its edges. The
weights minimise its variance, which has two parts. One is the jitter of each edge: on a real tire the leading edge
jitters several times as much as the trailing one. The other is the speed at the contact, which is extrapolated from the
revolutions before it: its error shifts the two edges by amounts proportional to their angles, in opposite directions.

The average changes while it is built up. The shift of each new template against the one before it is measured and
compensated, so that all contacts are timed at the same point of the belt.

The template is renewed before revolutions of fixed numbers only. The contacts in between are matched with the same one,
one at a time or many at once. Each is matched twice: first at the speed of the contacts as segmented, then at that of
the first match and of those of the two contacts before it.
"""

import math
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np

from gateway.core.contacts.contact_template import (
    ContactSamples,
    ContactTemplate,
    contact_template,
    template_shift,
)
from gateway.core.contacts.contact_tracking import is_bridged, lost_crossings
from gateway.core.contacts.segmentation import Contact
from gateway.core.contacts.segmenter import ContactPair
from gateway.core.revolutions.angle_resampling import MARGIN_SAMPLES, Phase, fit_phase
from gateway.core.revolutions.synchronous_average import AngleAverage
from gateway.core.types import FloatArray

# gaps(first, end) -> first and last (exclusive) sample of the gaps that reach into the samples first to end (exclusive)
Gaps = Callable[[int, int], list[tuple[int, int]]]

# The timed point moves to the template's centre in steps of at most this many standard errors of the time. A sudden
# correction would appear as a step of the speed.
_ANCHOR_STEP: Final = 0.2
# The template is extracted again after this many revolutions, earlier when their number has grown by this share.
_TEMPLATE_INTERVAL: Final = 32
_TEMPLATE_GROWTH: Final = 0.5
# Least number of samples around a contact.
_LEAST_SAMPLES: Final = 16
# Updates from which the estimate of the edges' jitter is used, and least weight of an update of a running mean.
_MIN_JITTER_UPDATES: Final = 8
_LEAST_WEIGHT: Final = 0.05
# Standard errors of the distance between the edges from which its change is not of what is known of either.
_UNEXPECTED_STDS: Final = 3.0
# Revolutions in the average from which its scatter is known. Before, it contains only the sensor's noise.
_SCATTER_KNOWN: Final = 3
# Error of either edge per change of the half angle against the template's: its shape is that at another load.
_OTHER_LOAD_SHARE: Final = 0.2
# Angle by which the point of the belt that level crossings find may differ from the refined one.
_CROSSING_STD_RAD: Final = 1e-3
# Relative error of the speed at a contact before it is measured, counted as one value.
_RATE_ERROR_PRIOR: Final = 1e-3
# Change of either edge from one contact to the next before it is measured, counted as one value: that of a load that
# changes by a tenth of itself.
_EDGE_CHANGE_PRIOR_RAD: Final = 0.01
MOST_UNSEEN: Final = 16
"""Contacts in a row whose edges may be those of an earlier contact: about two seconds of driving."""
# Of these, so many for which chance steps from one contact to the next tell how far the edges move, about a second. A
# change that lasts longer is one of the drive, and goes on at its pace.
_UNSEEN_BY_CHANCE: Final = 8
# Shift of a contact, rad, per relative error of its speed, that remains with weights for which the shifts of both edges
# cancel: quadratic phase, Euler acceleration and change of the centripetal acceleration across the contact.
_RATE_SHIFT_RAD: Final = 0.02


class TimedContact(NamedTuple):
    """A contact in running sample numbers.

    Attributes:
        segmented: centre as the segmenter found it; identifies the contact.
        centre: refined centre.
        centre_std: standard error.
        leading_rad: leading edge from `centre`; NaN when not refined.
        trailing_rad: trailing edge.
        leading_std_rad: standard error, including the uncertainty of the edge's definition.
        trailing_std_rad: likewise.
        is_seen: False where the samples that were lost show one of its edges; its edges are those of an earlier one,
            with the error of their change since then, or NaN.
    """

    segmented: float
    centre: float
    centre_std: float
    leading_rad: float = math.nan
    trailing_rad: float = math.nan
    leading_std_rad: float = math.nan
    trailing_std_rad: float = math.nan
    is_seen: bool = True


class TimedPair(NamedTuple):
    """One revolution between two refined contacts; its trailing edge is that of `start`, its leading one of `end`."""

    start: TimedContact
    end: TimedContact
    previous_period: float | None
    period_std: float


# Ratio of the periods of two revolutions that no braking makes.
_LARGEST_RATIO: Final = 1.4


class _RunningMean:
    """Running mean of one or more values; a plain mean at first, then exponentially weighted."""

    def __init__(self, start: tuple[float, ...], count: int = 0) -> None:
        """Start at `start`, counted as `count` additions."""
        self.values = start
        self.count = count

    def add(self, *values: float) -> None:
        """Add one of each."""
        self.count += 1
        weight = max(1.0 / self.count, _LEAST_WEIGHT)
        self.values = tuple([mean + weight * (value - mean) for mean, value in zip(self.values, values, strict=True)])


class _Weights(NamedTuple):
    """Combination of the two edges in the first match: weight of the trailing one, angle apart, points of the belt."""

    share: float
    apart_rad: float
    leading_point_rad: float
    trailing_point_rad: float


class _Match(NamedTuple):
    """One contact's match.

    Attributes:
        guess: sample position of the template's angle 0 that the shifts are relative to.
        rate: rad/sample at the contact.
        shift_rad: of the leading and the trailing edge.
        residual: rms residual in the two halves, over the square of the angular speed.
        covariances_rad2: (2, 2, 2) covariance of the shifts from the scatter in either half.
    """

    guess: float
    rate: float
    shift_rad: tuple[float, float]
    residual: tuple[float, float]
    covariances_rad2: FloatArray


class _Window(NamedTuple):
    """Samples around a contact.

    Attributes:
        number: of the revolution that it ends.
        first: sample position of the first.
        passage: of the template over them, with positions from the first.
        samples: (n,) them.
        gaps: (first, end) of those that are missing.
    """

    number: int
    first: int
    passage: Phase
    samples: FloatArray
    gaps: list[tuple[int, int]]


class ContactTimer:
    """Refines the contacts of one wheel. Deterministic; the times do not depend on how many are refined at once."""

    def __init__(self) -> None:
        """Start without contacts or jitter."""
        self.reset()

    def reset(self) -> None:
        """Forget contacts and jitter, as after a gap in the samples."""
        self._last: TimedContact | None = None
        self._previous_period: float | None = None
        # Times of the last contact's first match, and of the one before it; as segmented where there is none.
        self._first_match: tuple[float, float | None] = (math.nan, None)
        self._rates: tuple[float, ...] = ()
        # Relative variance of the speed extrapolated to a contact.
        self._rate_error2 = _RunningMean((_RATE_ERROR_PRIOR**2,), 1)
        # Latest contact whose edges were seen, contacts since then, and squared change of either edge between two.
        self._last_measured: TimedContact | None = None
        self._unseen_count = 0
        self._edge_change2 = _RunningMean((_EDGE_CHANGE_PRIOR_RAD**2,) * 2, 1)
        self._times: tuple[tuple[float, float], ...] = ()
        self._jitter = _RunningMean((0.0, 0.0, 0.0))
        self._forget_distance()
        self._noise_share = _RunningMean((1.0, 1.0))
        self._template: ContactTemplate | None = None
        self._until_renewal = 0
        self._average_count = 0
        # Mean square of the average's scatter over the fourth power of its angular speed.
        self._scatter2 = 0.0
        # Angles from the template's angle 0 to the points of the belt at which the two edges are timed; None before the
        # first template. Mean angle between the times of the two, and the weight of the later one.
        self._points: tuple[float, float] | None = None
        self._mean_distance_rad = _RunningMean((0.0,))
        self._trailing_share = 0.5
        self._weights = _Weights(0.5, 0.0, 0.0, 0.0)

    def _forget_distance(self) -> None:
        # Angle between the times of both edges at the last contact, NaN before it, and its variance by its changes.
        self._distance_rad = math.nan
        self._distance2 = _RunningMean((0.0,))

    @property
    def until_renewal(self) -> int:
        """Number of revolutions that can be timed until the template is renewed; 0 when that is due."""
        return self._until_renewal

    def renew(self, average: AngleAverage | None, samples: float) -> None:
        """Extract the template again; due when `until_renewal` is 0.

        Args:
            average: running average of all revolutions so far, None when there is none.
            samples: length of a revolution in samples.
        """
        if average is None:
            self._until_renewal = 1
            return
        count = average.count
        self._until_renewal = min(max(int(_TEMPLATE_GROWTH * count), 1), _TEMPLATE_INTERVAL)
        self._average_count = count
        omega2 = average.omega_radps**2
        self._scatter2 = float(np.square(average.scatter_mps2).mean()) / omega2**2
        latest = contact_template(
            average.radial_mps2,
            average.omega_radps,
            samples,
            np.square(average.orders_std_mps2) * average.effective_count,
            average.scatter_mps2,
        )
        if latest is None:
            self._points = None
        elif self._points is not None and self._template is not None:
            leading, trailing = template_shift(self._template, average.radial_mps2, average.omega_radps).tolist()
            self._points = self._points[0] + leading, self._points[1] + trailing
        else:
            self._points = latest.middle_rad, latest.middle_rad
            self._mean_distance_rad = _RunningMean((0.0,))
            self._forget_distance()
        self._template = latest
        if self._points is not None:
            self._weights = _Weights(self._trailing_share, self._mean_distance_rad.values[0], *self._points)

    def time(
        self,
        pairs: Sequence[ContactPair],
        rates_hz: Sequence[float],
        read: Callable[[int, int], FloatArray],
        gaps: Gaps,
    ) -> list[TimedPair]:
        """Refine the contacts of consecutive revolutions.

        Args:
            pairs: contacts as segmented, at most `until_renewal`.
            rates_hz: sampling rate at each.
            read: returns the radial axis, positive inward, of samples first to end (exclusive).
            gaps: returns those of these samples that were lost.
        """
        self._until_renewal -= len(pairs)
        matches, damaged = self._matches(pairs, rates_hz, read, gaps)
        return [self._timed_pair(*revolution, gaps) for revolution in zip(pairs, matches, damaged, strict=True)]

    def _timed_pair(self, pair: ContactPair, match: _Match | None, is_damaged: bool, gaps: Gaps) -> TimedPair:
        start, previous = self._last, self._previous_period
        if start is None or start.segmented != pair.start.centre:
            self._times = ()
            start = TimedContact(pair.start.centre, pair.start.centre, pair.start.centre_std)
            if _lacks_an_edge(pair.start, gaps):
                start = self._with_earlier_edges(start, pair)
            previous = pair.previous_period
        if match is None:
            self._times = ()
            end = TimedContact(pair.end.centre, pair.end.centre, pair.end.centre_std)
            if is_damaged:
                end = self._with_earlier_edges(end, pair)
        else:
            end = self._timed(pair.end.centre, match)
            if self._average_count < _SCATTER_KNOWN:
                point_std = 0.5 * _CROSSING_STD_RAD / match.rate
                coarse_std = math.hypot(pair.end.centre_std, point_std)
                end = end._replace(centre_std=max(end.centre_std, coarse_std))
        if end.is_seen:
            self._update_edge_change(end)
        refined = (start.is_seen and math.isfinite(start.trailing_rad)) + (
            end.is_seen and math.isfinite(end.leading_rad)
        )
        period_std = math.hypot(start.centre_std, end.centre_std)
        if refined < 2:
            # The segmenter's standard error, which includes jitter, applies to contacts that were not refined.
            period_std = max(period_std, pair.period_std)
        if refined == 1:
            crossing_std = _CROSSING_STD_RAD * (end.centre - start.centre) / (2.0 * math.pi)
            period_std = math.hypot(period_std, crossing_std)
        self._last, self._previous_period = end, end.centre - start.centre
        self._update_rate_error(self._previous_period)
        return TimedPair(start, end, previous, period_std)

    def _matches(
        self,
        pairs: Sequence[ContactPair],
        rates_hz: Sequence[float],
        read: Callable[[int, int], FloatArray],
        gaps: Gaps,
    ) -> tuple[list[_Match | None], list[bool]]:
        """Match the later contacts of the revolutions with the template, twice; return also which lack samples."""
        matches: list[_Match | None] = [None] * len(pairs)
        template = self._template
        windows, damaged = self._windows(pairs, read, gaps)
        times = [pair.end.centre for pair in pairs]
        if template is None or not windows:
            self._follow(pairs, times)
            return matches, damaged
        passages = [window.passage for window in windows]
        contact_samples = ContactSamples(
            template, [window.samples for window in windows], passages, [window.gaps for window in windows]
        )
        window_rates_hz = [rates_hz[window.number] for window in windows]
        first_match = contact_samples.match(passages, window_rates_hz)
        share, distance_rad, *points = self._weights
        guesses: dict[int, float] = {}
        for (index, first, passage, *_), (leading, trailing), fits in zip(
            windows, first_match.shift_rad.tolist(), first_match.fits.tolist(), strict=True
        ):
            if fits:
                guesses[index] = passage.start + first + 0.5 * (leading + trailing) / passage.rate
                leading, trailing = leading + points[0], trailing + points[1]
                centre = leading + share * (trailing - leading - distance_rad) + 0.5 * distance_rad
                times[index] = passage.start + first + centre / passage.rate
        revolutions = self._follow(pairs, times)
        passages = [
            _shifted(_passage(*revolutions[index], zero_at=guesses[index]), -first) if index in guesses else passage
            for index, first, passage, *_ in windows
        ]
        match = contact_samples.match(passages, window_rates_hz)
        limit = contact_samples.largest_shift_rad
        good = (first_match.fits & match.fits).tolist()
        for (index, first, *_), passage, fits, shift, residual, covariances in zip(
            windows,
            passages,
            good,
            match.shift_rad.tolist(),
            match.residual.tolist(),
            match.covariances_rad2,
            strict=True,
        ):
            guess = passage.start + first
            offset_rad = (guess - pairs[index].end.centre) * passage.rate
            if fits and max(abs(offset_rad + shift[0]), abs(offset_rad + shift[1])) < limit:
                matches[index] = _Match(guess, passage.rate, tuple(shift), tuple(residual), covariances)
        return matches, damaged

    def _windows(
        self, pairs: Sequence[ContactPair], read: Callable[[int, int], FloatArray], gaps: Gaps
    ) -> tuple[list[_Window], list[bool]]:
        """Return the samples around the later contacts, and which of these lack samples."""
        template = self._template
        if template is None:
            return [], [pair.end.predicted or _lacks_an_edge(pair.end, gaps) for pair in pairs]
        damaged = [pair.end.predicted for pair in pairs]
        windows: list[_Window] = []
        begins_rad, ends_rad = template.whole.angles_rad[[0, -1]].tolist()
        for index, pair in enumerate(pairs):
            if pair.end.predicted:
                continue
            start, guess = pair.start.centre, pair.end.centre
            passage = _passage(start, guess, pair.previous_period)
            first = max(math.floor(guess + begins_rad / passage.rate) - MARGIN_SAMPLES, math.ceil(start))
            last = min(math.ceil(guess + ends_rad / passage.rate) + MARGIN_SAMPLES, pair.decided_at)
            lost = gaps(first, last)
            damaged[index] = bool(lost)
            if last - first >= _LEAST_SAMPLES:
                in_window = [(low - first, end - first) for low, end in lost]
                windows.append(_Window(index, first, _shifted(passage, -first), read(first, last), in_window))
        return windows, damaged

    def _follow(self, pairs: Sequence[ContactPair], times: Sequence[float]) -> list[tuple[float, float, float | None]]:
        """Return start, end and period before of each revolution by the times of the first match of their ends."""
        revolutions: list[tuple[float, float, float | None]] = []
        last_centre = self._last.segmented if self._last is not None else math.nan
        start, previous = self._first_match
        for pair, end in zip(pairs, times, strict=True):
            if last_centre != pair.start.centre:
                start, previous = pair.start.centre, pair.previous_period
            revolutions.append((start, end, previous))
            last_centre, start, previous = pair.end.centre, end, end - start
        self._first_match = start, previous
        return revolutions

    def _timed(self, segmented: float, match: _Match) -> TimedContact:
        """Combine the two edges with the weights of least variance."""
        template, points = self._template, self._points
        assert template is not None
        assert points is not None
        edges = template.edges
        sample = 1.0 / match.rate
        edge_times = match.guess + match.shift_rad[0] * sample, match.guess + match.shift_rad[1] * sample
        leading, trailing = edge_times[0] + points[0] * sample, edge_times[1] + points[1] * sample
        by_jitter2 = self._distance_jitter2
        self._update_jitter(leading, trailing)
        distance_rad = (trailing - leading) * match.rate
        self._mean_distance_rad.add(distance_rad)
        mean_distance = self._mean_distance_rad.values[0] * sample
        # The scatter of the average includes the jitter of the edges; the residual of the match does not.
        if self._scatter2 > 0.0:
            self._noise_share.add(match.residual[0] ** 2 / self._scatter2, match.residual[1] ** 2 / self._scatter2)
        n00, n01, n11 = self._noise(match)
        distance2 = max(n00 - 2.0 * n01 + n11, by_jitter2)
        leading_edge, trailing_edge = edges.leading_rad * sample, edges.trailing_rad * sample
        rate_error2, common2 = self._rate_error2.values[0], (_RATE_SHIFT_RAD * sample) ** 2
        s00, s01, s11 = (
            rate_error2 * (leading_edge * leading_edge + common2),
            rate_error2 * (leading_edge * trailing_edge + common2),
            rate_error2 * (trailing_edge * trailing_edge + common2),
        )
        v00, v01, v11 = n00, n01, n11
        if self._jitter.count >= _MIN_JITTER_UPDATES:
            # The common part of both edges is due to speed and is no error. Each edge has at least its noise.
            j00, j01, j11 = self._jitter.values
            v01 = min(n01, j01)
            v00 = v01 + max(n00 - n01, j00 - j01 - (s00 - s01))
            v11 = v01 + max(n11 - n01, j11 - j01 - (s11 - s01))
        v00, v01, v11 = v00 + s00, v01 + s01, v11 + s11
        n00, n01, n11 = n00 + s00, n01 + s01, n11 + s11
        total = v00 + v11 - 2.0 * v01
        share = (v00 - v01) / total if total > 0.0 and math.isfinite(total) else 0.5
        leading_weight, mixed_weight, trailing_weight = (1.0 - share) ** 2, 2.0 * share * (1.0 - share), share**2
        centre_std = math.sqrt(
            max(
                leading_weight * n00 + mixed_weight * n01 + trailing_weight * n11,
                leading_weight * v00 + mixed_weight * v01 + trailing_weight * v11,
            )
        )
        # A change of the weights must not move the timed point: only the distance's deviation from its mean counts.
        centre = leading + share * (trailing - leading - mean_distance) + 0.5 * mean_distance
        step = template.middle_rad - 0.5 * (points[0] + points[1])
        limit = _ANCHOR_STEP * centre_std * match.rate
        step = min(max(step, -limit), limit)
        self._points = points[0] + step, points[1] + step
        self._trailing_share = share
        distance2 += rate_error2 * (trailing_edge - leading_edge) ** 2
        unexpected = self._unexpected_variance(distance_rad, distance2 * match.rate**2) * sample**2
        # Either edge may have it.
        centre_std = math.hypot(centre_std, math.sqrt(0.5 * (leading_weight + trailing_weight) * unexpected))
        other_load = _OTHER_LOAD_SHARE * 0.5 * (edge_times[1] - edge_times[0]) * match.rate
        leading_std = math.hypot(math.sqrt(n00) * match.rate, other_load)
        trailing_std = math.hypot(math.sqrt(n11) * match.rate, other_load)
        return TimedContact(
            segmented=segmented,
            centre=centre,
            centre_std=centre_std,
            leading_rad=edges.leading_rad + (edge_times[0] - centre) * match.rate,
            trailing_rad=edges.trailing_rad + (edge_times[1] - centre) * match.rate,
            leading_std_rad=math.hypot(edges.leading_std_rad, leading_std),
            trailing_std_rad=math.hypot(edges.trailing_std_rad, trailing_std),
        )

    def _update_edge_change(self, contact: TimedContact) -> None:
        """Take a contact that was seen; its edges are NaN where it was not refined."""
        last = self._last_measured
        self._last_measured = contact if math.isfinite(contact.leading_rad) else None
        if last is not None and self._last_measured is not None and not self._unseen_count:
            changes = contact.leading_rad - last.leading_rad, contact.trailing_rad - last.trailing_rad
            self._edge_change2.add(changes[0] ** 2, changes[1] ** 2)
        self._unseen_count = 0

    def _with_earlier_edges(self, contact: TimedContact, pair: ContactPair) -> TimedContact:
        """Return a contact that was not seen, with the edges of the latest that was seen.

        They may have moved since then, and are off by the error of the centre that they are counted from.
        """
        self._unseen_count += 1
        contact = contact._replace(is_seen=False)
        reference = self._last_measured
        if reference is None or self._unseen_count > MOST_UNSEEN:
            return contact
        centre_rad = contact.centre_std * 2.0 * math.pi / (pair.end.centre - pair.start.centre)
        steps2 = self._unseen_count * max(self._unseen_count / _UNSEEN_BY_CHANCE, 1.0)
        leading_rad, trailing_rad = (math.sqrt(steps2 * change2) for change2 in self._edge_change2.values)
        return contact._replace(
            leading_rad=reference.leading_rad,
            trailing_rad=reference.trailing_rad,
            leading_std_rad=math.hypot(reference.leading_std_rad, leading_rad, centre_rad),
            trailing_std_rad=math.hypot(reference.trailing_std_rad, trailing_rad, centre_rad),
        )

    def _noise(self, match: _Match) -> tuple[float, float, float]:
        """Return the covariance of the edges' times from noise, samples^2: leading, both, trailing."""
        (in_leading, in_trailing), sample2 = self._noise_share.values, match.rate**-2.0
        ((a00, a01), (_, a11)), ((b00, b01), (_, b11)) = match.covariances_rad2.tolist()
        return (
            (in_leading * a00 + in_trailing * b00) * sample2,
            (in_leading * a01 + in_trailing * b01) * sample2,
            (in_leading * a11 + in_trailing * b11) * sample2,
        )

    def _update_rate_error(self, period: float) -> None:
        """Estimate the error of the speed at a contact, extrapolated from two revolutions at constant acceleration.

        The speed at the contact between two revolutions is about the mean of theirs. The extrapolation from the two
        revolutions before the contact differs from it by half of the second difference of three mean speeds.
        """
        if self._rates and not _is_next(1.0 / self._rates[-1], period):
            self._rates = ()
        self._rates = (*self._rates[-2:], 1.0 / period)
        if len(self._rates) == 3:
            first_rate, middle_rate, last_rate = self._rates
            self._rate_error2.add((0.5 * (last_rate - 2.0 * middle_rate + first_rate) / middle_rate) ** 2)

    @property
    def _distance_jitter2(self) -> float:
        """Variance of the distance between the edges by jitter, samples^2; 0 before it is known."""
        if self._jitter.count < _MIN_JITTER_UPDATES:
            return 0.0
        j00, j01, j11 = self._jitter.values
        return j00 - 2.0 * j01 + j11

    def _unexpected_variance(self, distance_rad: float, variance_rad2: float) -> float:
        """Return the variance of the distance between the edges of a contact by its change, rad^2; 0 where expected.

        A speed that changes within a revolution, as at the onset of braking, moves both edges, but not alike. So does
        jitter, which is not known at first: until then, the mean of the changes counts.

        Args:
            distance_rad: between the times of both edges.
            variance_rad2: that noise, or the jitter of the contacts before, and the usual error of the speed leave it.
        """
        change2 = 0.5 * (distance_rad - self._distance_rad) ** 2
        self._distance_rad = distance_rad
        if math.isnan(change2):
            return 0.0
        if self._jitter.count < _MIN_JITTER_UPDATES:
            self._distance2.add(change2)
            change2 = max(change2, self._distance2.values[0])
        return change2 if change2 > _UNEXPECTED_STDS**2 * variance_rad2 else 0.0

    def _update_jitter(self, leading: float, trailing: float) -> None:
        """Estimate the jitter of each edge from the second differences of its times.

        Changes of speed are common to both edges, jitter is not. With the mean products of second differences over 6,
        the variance of the leading edge is leading times leading minus leading times trailing; likewise for trailing.
        """
        if len(self._times) >= 2:
            (previous, _), (last, _) = self._times[-2:]
            if not _is_next(last - previous, leading - last):
                self._times = self._times[-1:]
        self._times = (*self._times[-2:], (leading, trailing))
        if len(self._times) == 3:
            (first, first_end), (middle, middle_end), _ = self._times
            leading_step, trailing_step = first - 2.0 * middle + leading, first_end - 2.0 * middle_end + trailing
            self._jitter.add(
                leading_step * leading_step / 6.0,
                leading_step * trailing_step / 6.0,
                trailing_step * trailing_step / 6.0,
            )


def _lacks_an_edge(contact: Contact, gaps: Gaps) -> bool:
    """Return whether a level crossing by which a contact was segmented was lost."""

    def missing(first: int, end: int) -> int:
        return sum(min(end, high) - max(first, low) for low, high in gaps(first, end))

    lost = lost_crossings(contact, missing)
    return contact.predicted or not all(is_bridged(count, contact.duration) for count in lost)


def _is_next(previous_period: float, period: float) -> bool:
    """Return whether a period may be that of the next revolution; else contacts were not seen in one of the two."""
    return previous_period < _LARGEST_RATIO * period and period < _LARGEST_RATIO * previous_period


def _passage(start: float, end: float, previous_period: float | None, *, zero_at: float | None = None) -> Phase:
    """Return the phase around the later contact of a revolution, angle 0 at `zero_at`, or else at that contact."""
    phase = fit_phase(start, end, start - previous_period if previous_period is not None else None)
    zero, samples = end if zero_at is None else zero_at, end - start
    return Phase(zero, zero + samples, phase.rate + phase.acceleration * samples, phase.acceleration)


def _shifted(phase: Phase, samples: float) -> Phase:
    """Return a phase in other sample numbers."""
    return Phase(phase.start + samples, phase.end + samples, phase.rate, phase.acceleration)
