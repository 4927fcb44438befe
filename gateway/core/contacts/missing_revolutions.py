"""Reasons why the samples of a wheel give no revolution, from its radial axis.

Outside the contact a radial sensor reads R Omega^2, in the contact about zero, and over a whole revolution R Omega^2 on
average, since the belt closes after one turn (curvature law s = V^2 kappa). Mean, depth of the dips and time between
them must therefore agree.
"""

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.contacts.contact_tracking import Read
from gateway.core.contacts.contact_trains import LONGEST_PERIOD_S
from gateway.core.contacts.reasons import ContactCode
from gateway.core.contacts.segmentation import is_still
from gateway.core.reasons import Code, Reason
from gateway.core.types import FloatArray

# A stretch without a revolution is examined when it is this long, and again at this interval.
WINDOW_S: Final = 4.0
INTERVAL_S: Final = 2.0
# The same reason in this number of examinations in a row is reported while the samples come.
_CONFIRMATIONS: Final = 2
# Three contacts make a wheel known, with some signal before and after them.
_PERIODS_NEEDED: Final = 3.2
# The rotation is searched in at most this rate; the contact of a car at 250 km/h then spans five samples.
_SEARCH_RATE_HZ: Final = 2400.0
# Autocorrelation below which the main lobe ends, and above which a period is one; the first peak of nearly the height
# of the highest is the period, later ones its multiples.
_LOBE_END: Final = 0.2
_LEAST_CORRELATION: Final = 0.35
_PEAK_SHARE: Final = 0.85
# Below this mean, dips cannot be separated from gravity, which changes the radial axis by 2 g and gives it at most this
# standard deviation, with noise.
_SLOW_MPS2: Final = 12.0
_GRAVITY_STD_MPS2: Final = 20.0
# Largest standard deviation of an AC-coupled axis at rest.
_REST_STD_MPS2: Final = 5.0
# Above this mean a DC-coupled wheel rolls, whatever else the signal looks like.
_ROLLING_MPS2: Final = 30.0
# A contact reduces the signal to less than this share of the mean.
_CONTACT_SHARE: Final = 0.5
# The lowest values of a signal, smoothed over this share of a period, less than the shortest contact.
_LOW_QUANTILE: Final = 0.01
_SMOOTHED_SHARE: Final = 1.0 / 60.0
# Share of samples at the end of the sensor's range.
_SATURATED_SHARE: Final = 0.2
# Largest natural logarithm of the ratio between the mean and R Omega^2 in the unit assumed: radius and rate are stated
# with errors of some percent.
_UNIT_TOLERANCE: Final = 0.16
# The mean may differ from R Omega^2 by this ratio before the stated rate is doubted.
_RATE_TOLERANCE: Final = 2.2
# A rate is hardly mistaken by more, such as that before decimation; then the scale is wrong.
_MISTAKEN_RATE: Final = 11.0
# Below this share of R Omega^2, dips of an AC-coupled sensor come from gravity.
_AC_CONTACT_SHARE: Final = 0.05

_QUIET: Final = frozenset((ContactCode.WHEEL_STANDS, ContactCode.WHEEL_TOO_SLOW, ContactCode.SAMPLES_TOO_SHORT))
"""Reasons that are no fault of sensor or configuration."""


@dataclass(frozen=True, slots=True)
class RadialSignal:
    """A stretch of a radial axis.

    Attributes:
        radial_mps2: (n,) samples, nominally positive inward.
        rate_hz: sampling rate.
        radius_m: belt radius as configured.
        is_dc: whether the sensor passes the steady value.
        saturated_share: share of samples at the end of the sensor's range.
    """

    radial_mps2: FloatArray
    rate_hz: float
    radius_m: float
    is_dc: bool = True
    saturated_share: float = 0.0


def rotation_period_s(radial_mps2: FloatArray, rate_hz: float) -> float | None:
    """Return the time after which a signal repeats, by its autocorrelation; None when it does not.

    Args:
        radial_mps2: (n,) at least two periods.
        rate_hz: sampling rate.
    """
    step = max(1, int(rate_hz // _SEARCH_RATE_HZ))
    n = len(radial_mps2) // step
    if n < 16:
        return None
    signal = radial_mps2[: n * step].reshape(n, step).mean(axis=1)
    signal = signal - signal.mean()
    size = 1 << (2 * n).bit_length()
    power: FloatArray = np.fft.irfft(np.square(np.abs(np.fft.rfft(signal, size))), size)[: n // 2]
    if not power[0] > 0.0:
        return None
    correlation = power / power[0] * (n / (n - np.arange(len(power))))
    low_indices = np.flatnonzero(correlation < _LOBE_END)
    if not len(low_indices):
        return None
    start = int(low_indices[0])
    highest = float(correlation[start:].max())
    if highest < _LEAST_CORRELATION:
        return None
    first = start + int(np.argmax(correlation[start:] >= _PEAK_SHARE * highest))
    # Up to the top of that peak.
    while first + 1 < len(correlation) and correlation[first + 1] > correlation[first]:
        first += 1
    return first * step / rate_hz


def why_no_revolution(signal: RadialSignal, longest_s: float, *, interrupted: bool = False) -> tuple[Reason, ...]:
    """Return the likeliest reasons why a stretch without a revolution has none, the main one first; never empty.

    Args:
        signal: the stretch.
        longest_s: length of the longest stretch of samples without a gap.
        interrupted: whether samples were lost on the link between such stretches.
    """
    if signal.saturated_share >= _SATURATED_SHARE:
        highest = float(np.abs(signal.radial_mps2).max())
        return (Reason(ContactCode.RADIAL_AT_RANGE_END, share=signal.saturated_share, level_mps2=highest),)
    raw_mean = float(signal.radial_mps2.mean()) if len(signal.radial_mps2) else 0.0
    mean = abs(raw_mean) if signal.is_dc else 0.0
    inward = signal.radial_mps2 if raw_mean >= 0.0 or not signal.is_dc else -signal.radial_mps2
    period_s = rotation_period_s(inward, signal.rate_hz)
    outward = (
        (Reason(ContactCode.RADIAL_OUTWARD, mean_mps2=raw_mean),) if signal.is_dc and raw_mean < -_ROLLING_MPS2 else ()
    )
    depth = mean - _lowest_mps2(inward, signal.rate_hz, period_s) if len(inward) else 0.0
    reason = None
    if period_s is not None:
        reason = _unit(signal, mean, depth, period_s)
    if reason is None:
        reason = _motion(signal, mean, period_s) or _length(signal, mean, period_s, longest_s, interrupted=interrupted)
    is_rolling = mean > (_ROLLING_MPS2 if period_s is None else _SLOW_MPS2)
    if reason is None and is_rolling and depth < _CONTACT_SHARE * mean:
        reason = Reason(ContactCode.NO_CONTACT_SEEN, mean_mps2=mean, lowest_mps2=mean - depth)
    if reason is None and period_s is not None:
        reason = _rate(signal, mean, depth, period_s)
    if reason is None:
        reason = Reason(ContactCode.CONTACTS_NOT_ALIKE, mean_mps2=raw_mean, std_mps2=float(signal.radial_mps2.std()))
    return (reason, *outward)


def _lowest_mps2(inward: FloatArray, rate_hz: float, period_s: float | None) -> float:
    """Return the lowest level of a signal, without noise and gravity where the period is known."""
    if period_s is None:
        return float(np.quantile(inward, _LOW_QUANTILE))
    box = max(1, round(_SMOOTHED_SHARE * period_s * rate_hz))
    smooth = inward[: len(inward) // box * box].reshape(-1, box).mean(axis=1)
    angle = np.arange(len(smooth)) * (2.0 * np.pi * box / (period_s * rate_hz))
    # Gravity turns once per revolution: the first order.
    order = np.stack((np.ones_like(angle), np.cos(angle), np.sin(angle)), axis=1)
    fitted = np.linalg.lstsq(order, smooth, rcond=None)[0]
    return float(np.quantile(smooth - order[:, 1:] @ fitted[1:], _LOW_QUANTILE))


def _centripetal_mps2(signal: RadialSignal, period_s: float) -> float:
    return signal.radius_m * (2.0 * math.pi / period_s) ** 2


def _unit(signal: RadialSignal, mean: float, depth: float, period_s: float) -> Reason | None:
    """Return a reason when mean or depth is R Omega^2 in another unit."""
    level = mean if signal.is_dc else depth
    if depth < _CONTACT_SHARE * level:
        return None
    return mistaken_unit(level, _centripetal_mps2(signal, period_s), signal.rate_hz)


def mistaken_unit(level_mps2: float, expected_mps2: float, rate_hz: float) -> Reason | None:
    """Return a reason when a level is R Omega^2 in another unit.

    Args:
        level_mps2: in the unit assumed.
        expected_mps2: R Omega^2 by the rotation.
        rate_hz: sampling rate.
    """
    ratio = level_mps2 / expected_mps2
    for code, factor in (
        (ContactCode.RADIAL_IS_IN_G, 1.0 / STANDARD_GRAVITY_MPS2),
        (ContactCode.RADIAL_IS_IN_MPS2, STANDARD_GRAVITY_MPS2),
    ):
        if ratio > 0.0 and abs(math.log(ratio / factor)) < _UNIT_TOLERANCE:
            fitting_hz = rate_hz * math.sqrt(ratio)
            return Reason(code, level_mps2=level_mps2, expected_mps2=expected_mps2, ratio=ratio, fitting_hz=fitting_hz)
    return None


def _motion(signal: RadialSignal, mean: float, period_s: float | None) -> Reason | None:
    """Return a reason when the wheel stands or hardly rolls."""
    radial = signal.radial_mps2
    std = float(radial.std()) if len(radial) else 0.0
    # A steady value is no rest: a wheel that rolls fast without a contact varies little.
    is_at_rest = mean <= _SLOW_MPS2 if signal.is_dc else period_s is None or std < _REST_STD_MPS2
    if is_at_rest and is_still(radial, signal.rate_hz):
        return Reason(ContactCode.WHEEL_STANDS, mean_mps2=float(radial.mean()), std_mps2=std)
    limit_mps = math.sqrt(_SLOW_MPS2 * signal.radius_m)
    if (
        signal.is_dc
        and mean <= _SLOW_MPS2
        and std <= _GRAVITY_STD_MPS2
        and (period_s is None or period_s > 0.5 * LONGEST_PERIOD_S)
    ):
        return Reason(ContactCode.WHEEL_TOO_SLOW, speed_mps=math.sqrt(mean * signal.radius_m), limit_mps=limit_mps)
    if period_s is not None and period_s > LONGEST_PERIOD_S:
        speed_mps = 2.0 * math.pi * signal.radius_m / period_s
        return Reason(ContactCode.WHEEL_TOO_SLOW, speed_mps=speed_mps, limit_mps=limit_mps)
    return None


def _length(
    signal: RadialSignal, mean: float, period_s: float | None, longest_s: float, *, interrupted: bool
) -> Reason | None:
    """Return a reason when there are fewer samples than three revolutions take."""
    if period_s is None and mean > 0.0:
        period_s = 2.0 * math.pi * math.sqrt(signal.radius_m / mean)
    needed_s = _PERIODS_NEEDED * min(period_s if period_s is not None else math.inf, LONGEST_PERIOD_S)
    if longest_s >= needed_s:
        return None
    code = ContactCode.SAMPLES_INTERRUPTED if interrupted else ContactCode.SAMPLES_TOO_SHORT
    return Reason(code, duration_s=longest_s, needed_s=needed_s)


def _rate(signal: RadialSignal, mean: float, depth: float, period_s: float) -> Reason | None:
    """Return a reason when the rotation fits the mean at another sampling rate or scale only."""
    level = mean if signal.is_dc else depth
    expected = _centripetal_mps2(signal, period_s)
    if not signal.is_dc and level < _AC_CONTACT_SHARE * expected:
        return Reason(ContactCode.NO_CONTACT_IN_AC_SIGNAL, depth_mps2=depth, expected_mps2=expected)
    ratio = level / expected
    if level < _ROLLING_MPS2 or 1.0 / _RATE_TOLERANCE < ratio < _RATE_TOLERANCE:
        return None
    if not 1.0 / _MISTAKEN_RATE < math.sqrt(ratio) < _MISTAKEN_RATE:
        return Reason(ContactCode.RADIAL_SCALE_DOES_NOT_FIT, level_mps2=level, expected_mps2=expected, ratio=ratio)
    fitting_hz = signal.rate_hz * math.sqrt(ratio)
    return Reason(
        ContactCode.RATE_DOES_NOT_FIT,
        level_mps2=level,
        expected_mps2=expected,
        ratio=ratio,
        rate_hz=signal.rate_hz,
        fitting_hz=fitting_hz,
    )


class RadialSamples(NamedTuple):
    """Samples of the radial axis, by ranges of their numbers, the end exclusive.

    Attributes:
        read: radial axis of a range.
        saturated_share: share of a range at the end of the sensor's range.
        longest_measured: length of the longest stretch of a range without a lost sample.
    """

    read: Read
    saturated_share: Callable[[int, int], float]
    longest_measured: Callable[[int, int], int]


class MissingRevolutions:
    """Watch over one wheel's samples for revolutions that do not come.

    Nothing is computed while revolutions come. A stretch without one is examined every INTERVAL_S, at sample numbers
    that do not depend on the chunks in which samples arrive.
    """

    def __init__(self, radius_m: float) -> None:
        """Set the belt radius; `begin` starts."""
        self._radius_m = radius_m
        self._rate_hz = 0.0
        self._is_dc = True
        self._stretch_start = self._waiting_from = self._next_examination = self._head = 0
        self._stretches = 0
        self._earlier_s = self._longest_s = self._waited_s = 0.0
        self._has_revolution = False
        self._causes: Counter[Code] = Counter()
        self._latest: dict[Code, tuple[Reason, ...]] = {}
        self._repeated: tuple[Code | None, int] = (None, 0)

    def begin(self, head: int, rate_hz: float, *, is_dc: bool) -> None:
        """Start a stretch of samples without a gap at running number `head`."""
        self._end_stretch()
        self._rate_hz, self._is_dc = rate_hz, is_dc
        self._stretch_start = self._head = head
        self._stretches += 1
        self._schedule(head)

    def _end_stretch(self) -> None:
        if self._rate_hz:
            length_s = (self._head - self._stretch_start) / self._rate_hz
            self._earlier_s += length_s
            self._longest_s = max(self._longest_s, length_s)

    def _schedule(self, start: int) -> None:
        self._waiting_from = start
        self._next_examination = start + round(WINDOW_S * self._rate_hz)
        self._waited_s = 0.0
        self._repeated = (None, 0)

    def came(self, end: float) -> None:
        """Take a completed revolution that ended at sample `end`."""
        self._has_revolution = True
        self._schedule(max(self._stretch_start, int(end)))

    def samples(self, head: int, samples: RadialSamples) -> None:
        """Examine the stretches that are due with samples up to `head`.

        Args:
            head: number of samples available.
            samples: these, by ranges.
        """
        self._head = head
        while self._next_examination <= head:
            self._examine(self._next_examination, samples)
            self._next_examination += round(INTERVAL_S * self._rate_hz)

    def finish(self, head: int, samples: RadialSamples) -> None:
        """Examine the last stretch, however short, when no more samples will come."""
        self._head = head
        if not self._has_revolution and not self._causes:
            self._examine(head, samples)

    def _examine(self, end: int, samples: RadialSamples) -> None:
        first = max(self._waiting_from, end - round(WINDOW_S * self._rate_hz))
        saturated = samples.saturated_share(first, end)
        signal = RadialSignal(samples.read(first, end), self._rate_hz, self._radius_m, self._is_dc, saturated)
        longest_run = samples.longest_measured(first, end)
        is_unbroken = longest_run == end - first
        longest_s = max(self._longest_s, (end - self._stretch_start if is_unbroken else longest_run) / self._rate_hz)
        reasons = why_no_revolution(signal, longest_s, interrupted=self._stretches > 1 or not is_unbroken)
        self._waited_s = (end - self._waiting_from) / self._rate_hz
        code = reasons[0].code
        self._causes[code] += 1
        self._latest[code] = reasons
        previous_code, count = self._repeated
        self._repeated = (code, count + 1 if code == previous_code else 1)

    @property
    def duration_s(self) -> float:
        """Length of all samples so far."""
        return self._earlier_s + ((self._head - self._stretch_start) / self._rate_hz if self._rate_hz else 0.0)

    @property
    def waited_s(self) -> float:
        """Length of the samples since the last revolution, as last examined."""
        return self._waited_s

    @property
    def reasons(self) -> tuple[Reason, ...]:
        """Reasons why there was no revolution at all; empty when there was one, or nothing was examined yet.

        A wheel that stood most of the time should have rolled in the rest of it: the commonest of the other reasons
        counts.
        """
        if self._has_revolution or not self._causes:
            return ()
        faults = [code for code, _ in self._causes.most_common() if code not in _QUIET]
        return self._latest[faults[0] if faults else self._causes.most_common(1)[0][0]]

    @property
    def present(self) -> tuple[Reason, ...]:
        """Reasons why no revolution comes now; empty as long as that is not certain.

        A wheel that stands is worth a word only when it has never rolled.
        """
        code, count = self._repeated
        if code is None or count < _CONFIRMATIONS or (self._has_revolution and code in _QUIET):
            return ()
        return self._latest[code]

    @property
    def is_fault(self) -> bool:
        """Whether the present reason is a fault of sensor, mounting or configuration."""
        return bool(self.present) and self.present[0].code not in _QUIET
