"""Comparison of the axes' timing between the wheels of one vehicle, whose hubs and sensors are of one kind.

The relations of a wheel's axes show a lag that explains half of what they leave without it. Noise and the road hide a
smaller lag. What a wheel has beyond the mean of the others, by four standard errors of the difference and by more than
a sample, twice in succession, is a lag of this wheel: a lag by the simplifications of the relations is common to all
wheels, and a lag by samples lost from an average passes. It also follows the driving, by 0.5 ms from one renewal to the
next: the others' is taken for the time of the wheel's, between those before and behind it.

Errors of lags are those of what the relation leaves. On simulated roads, differences have 1.15 of them as the standard
deviation, with 2.8 as the largest of 112.
"""

import bisect
import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Final, NamedTuple, TypeAlias

from gateway.core.constants import AXIS_NAMES
from gateway.core.estimates.results import Alarm, RevolutionResult
from gateway.core.quantity import Basis
from gateway.core.quantity_catalogue import quantity_of
from gateway.core.reasons import Reason
from gateway.core.revolutions.axis_relations import Lag
from gateway.core.trust.qualification import provisional
from gateway.core.trust.reasons import TrustCode

ALARM: Final = "axis lag"
"""Name of the alarm of a wheel with an axis that is late as only this wheel's is."""

# Standard errors by which a wheel differs from the others. Each renewal of each axis of each wheel is a test.
_ONSET_ERRORS: Final = 4.0
# Those within which a wheel that differed agrees again.
_RELEASE_ERRORS: Final = 2.0
# Share of the time between two renewals by which the first one of another wheel may be later than that of a wheel.
_FIRST_DELAY_SHARE: Final = 0.25
# What rests on the axes, in the order of `AxisRelations.lags`.
_AXIS_BASES: Final = (Basis.ALONG, Basis.AXES)
_NO_LAGS: Final = (None, None)
# Changes of a wheel's lags that are remembered: they are renewed every 64 revolutions.
_HISTORY_LENGTH: Final = 64


class _Lags(NamedTuple):
    """Lags of a wheel's axes, and the time between two samples."""

    axes: tuple[Lag | None, Lag | None]
    sample_s: float


_LateReasons: TypeAlias = tuple[Reason | None, Reason | None]
_NO_REASONS: Final[_LateReasons] = (None, None)


@dataclass(slots=True)
class _Wheel:
    """A wheel.

    Attributes:
        changes: its latest lags, each with the end of the first revolution that has them, ns.
        known_ns: time up to which it is judged.
        late: why each of its axes is late as only this wheel's is, None where it is not.
    """

    changes: deque[tuple[int, _Lags]] = field(default_factory=lambda: deque(maxlen=_HISTORY_LENGTH))
    known_ns: float = -math.inf
    late: _LateReasons = _NO_REASONS

    def until(self, time_ns: float) -> list[tuple[int, _Lags]]:
        """Return the changes of the lags as known at a time."""
        return [change for change in self.changes if change[0] <= time_ns]


class AxisLags:
    """Compares the lags of all wheels; what is known at a time does not depend on the order of the results."""

    def __init__(self) -> None:
        """Start without a wheel."""
        self._wheels: dict[str, _Wheel] = {}
        # Ends of the revolutions with which lags of any wheel change, ns, in order.
        self._changes_ns: list[int] = []

    def compare(self, result: RevolutionResult) -> None:
        """Compare the lags of a wheel's next revolution."""
        changes = self._wheels.setdefault(result.position, _Wheel()).changes
        if result.axis_lags != (changes[-1][1].axes if changes else _NO_LAGS):
            changes.append((result.host_ns, _Lags(result.axis_lags, 1.0 / result.revolution.rate_hz)))
            bisect.insort(self._changes_ns, result.host_ns)
            del self._changes_ns[: -_HISTORY_LENGTH * len(self._wheels)]

    def take(self, result: RevolutionResult, known_ns: float) -> tuple[RevolutionResult, bool]:
        """Take a result that was compared.

        Args:
            result: of any wheel, in order for each.
            known_ns: time up to which the results of all wheels have come.

        Returns:
            The result, of which estimates that rest on an axis that is late are provisional, and whether alarms of its
            wheel begin or end.
        """
        wheel = self._wheels[result.position]
        previous = wheel.late
        if known_ns > wheel.known_ns:
            first = bisect.bisect_right(self._changes_ns, wheel.known_ns)
            for time_ns in self._changes_ns[first : bisect.bisect_right(self._changes_ns, known_ns)]:
                wheel.late = self._late_reasons(result.position, time_ns)
            wheel.known_ns = known_ns
        is_changed = any(previous) is not any(wheel.late)
        if not any(wheel.late):
            return result, is_changed
        estimates = result.estimates
        for basis, reason in zip(_AXIS_BASES, wheel.late, strict=True):
            if reason is not None:
                estimates = tuple(
                    [
                        provisional(estimate, reason) if basis in quantity_of(estimate.name).powers else estimate
                        for estimate in estimates
                    ]
                )
        return replace(result, estimates=estimates), is_changed

    def alarms(self) -> Iterator[Alarm]:
        """Yield an alarm for each wheel with an axis that is late as only this wheel's is."""
        for position, wheel in self._wheels.items():
            for reason in [reason for reason in wheel.late if reason is not None][:1]:
                yield Alarm(position, ALARM, reason)

    def _late_reasons(self, position: str, time_ns: int) -> _LateReasons:
        """Return why each axis of a wheel is late as only this wheel's is, as known at a time."""
        wheel = self._wheels[position]
        histories = [peer.until(time_ns) for name, peer in self._wheels.items() if name != position]
        peers = [changes for changes in histories if changes]
        history = wheel.until(time_ns)
        if history and any(changes[-1][0] < history[-1][0] for changes in peers):
            history.pop()  # others are yet to come to this time, or have none any more
        circumferential, lateral = (
            _reason(axis, history[-2:], peers, is_late=reason is not None) for axis, reason in enumerate(wheel.late)
        )
        return circumferential, lateral


def _reason(
    axis: int, history: list[tuple[int, _Lags]], peers: list[list[tuple[int, _Lags]]], *, is_late: bool
) -> Reason | None:
    """Return the reason where an axis is later than those of the other wheels, which agree with each other."""
    if len(history) < 2:
        return None
    (previous_ns, previous), (end_ns, lags) = history
    lag, mean = lags.axes[axis], _mean([_interpolated(end_ns, axis, changes) for changes in peers])
    if lag is None or mean is None:
        return None
    excess_s = lag.late_s - mean.late_s
    if not _differ(lag, mean, _RELEASE_ERRORS if is_late else _ONSET_ERRORS) or abs(excess_s) <= lags.sample_s:
        return None
    if not is_late:
        lag_before, mean_before = (
            previous.axes[axis],
            _mean([_interpolated(previous_ns, axis, changes) for changes in peers]),
        )
        if lag_before is None or mean_before is None or not _differ(lag_before, mean_before, _ONSET_ERRORS):
            return None
        if (lag_before.late_s - mean_before.late_s) * excess_s <= 0.0:
            return None
    std_s = math.hypot(lag.std_s, mean.std_s)
    return Reason(TrustCode.AXIS_LATER_THAN_OTHERS, axis=AXIS_NAMES[axis], late_s=excess_s, std_s=std_s)


def _interpolated(time_ns: int, axis: int, changes: list[tuple[int, _Lags]]) -> Lag | None:
    """Return the lag of a wheel at a time between two of its changes, with the error by what lies between them."""
    known_lags = [(end_ns, lag) for end_ns, lags in changes if (lag := lags.axes[axis]) is not None]
    index = max(bisect.bisect_left(known_lags, time_ns, key=lambda change: change[0]), 1)
    if index >= len(known_lags):
        return None
    (before_ns, before), (after_ns, after) = known_lags[index - 1 : index + 1]
    # Below 0 for the first lag of a wheel that came a little later.
    share = (time_ns - before_ns) / (after_ns - before_ns)
    if share < -_FIRST_DELAY_SHARE:
        return None
    step_s = after.late_s - before.late_s
    nearer = before if share < 0.5 else after
    std_s = math.hypot(nearer.std_s, min(abs(share), 1.0 - share) * step_s)
    return Lag(before.late_s + share * step_s, std_s)


def _mean(lags: list[Lag | None]) -> Lag | None:
    """Return the mean of the lags of other wheels; None without any, or where they do not agree."""
    peers = [lag for lag in lags if lag is not None]
    # The odd one may be among them.
    if not peers or any(_differ(first, second, _ONSET_ERRORS) for first, second in combinations(peers, 2)):
        return None
    count = len(peers)
    return Lag(math.fsum(lag.late_s for lag in peers) / count, math.hypot(*(lag.std_s for lag in peers)) / count)


def _differ(first: Lag, second: Lag, errors: float) -> bool:
    return abs(first.late_s - second.late_s) > errors * math.hypot(first.std_s, second.std_s)
