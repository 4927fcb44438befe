"""Comparison of estimated revolutions with a measured speed, rotation or angle."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.core.estimates.estimator import Estimate, Revolution, Status
from gateway.core.types import BoolArray, FloatArray

RIG_CHANNELS: Final = {
    "load": "load_n",
    "side_force": "side_force_n",
    "slip_angle": "slip_angle_rad",
    "camber": "",
    "torque": "axle_torque_nm",
}
"""Channels of a rig, each with the estimate that is compared with it at every revolution."""
_BATCHES: Final = 10
FEWEST_TURNS: Final = 3
"""Fewer revolutions have no mean."""
# Of the longer of a turn and the averaging interval; further apart, the reference has a gap.
_LARGEST_STEP: Final = 3.0
_USUAL_STEP_S: Final = 0.1


@dataclass(frozen=True, slots=True)
class ReferenceComparison:
    """Difference between estimates and a reference.

    Attributes:
        position: wheel position.
        name: name of the reference.
        quantity: as in an import map. A channel of the rig without an estimate has only its mean and scatter.
        revolutions: number of revolutions compared, 0 when there are too few; then the rest is NaN.
        estimated: mean estimate, m/s for a speed, turns per second otherwise, and the unit of a channel of the rig.
        measured: mean of the reference, in the same unit.
        difference: estimate minus reference, in the same unit.
        difference_std: its standard error.
        scatter: standard deviation of the differences of single revolutions, or of a channel without an estimate.
        share_of_error: root mean square of these differences, each as share of its error; NaN without such errors.
        slope: change of the estimate with the channel, over its variation; NaN where that is within the errors.
        slope_std: its standard error.
        radius_m: belt radius with which a speed would agree; NaN for others.
        radius_std_m: its standard error.
        contact_rad: angle of the reference at the contact centre; NaN where there is none.
        contact_scatter_rad: standard deviation of that angle.
        value_std: standard error of a value of the reference, 0 where it is not stated.
    """

    position: str
    name: str
    quantity: str
    revolutions: int
    estimated: float = math.nan
    measured: float = math.nan
    difference: float = math.nan
    difference_std: float = math.nan
    scatter: float = math.nan
    share_of_error: float = math.nan
    slope: float = math.nan
    slope_std: float = math.nan
    radius_m: float = math.nan
    radius_std_m: float = math.nan
    contact_rad: float = math.nan
    contact_scatter_rad: float = math.nan
    value_std: float = 0.0


class TurnLog:
    """Start and duration of the revolutions of one wheel that may be used."""

    def __init__(self) -> None:
        """Begin without any."""
        self._starts_s: list[float] = []
        self._periods_s: list[float] = []
        self._estimates: dict[str, list[tuple[float, float]]] = {name: [] for name in RIG_CHANNELS.values() if name}

    def add(self, revolution: Revolution, estimates: Sequence[Estimate] = ()) -> None:
        """Add a revolution, unless it has a fault, with what is estimated at it."""
        if not revolution.faults and revolution.period_s > 0.0:
            self._starts_s.append(revolution.start_s)
            self._periods_s.append(revolution.period_s)
            pairs = {entry.name: (entry.value, entry.std) for entry in estimates if entry.status is not Status.INVALID}
            for name, values in self._estimates.items():
                values.append(pairs.get(name, (math.nan, math.nan)))

    def compare(
        self,
        position: str,
        name: str,
        quantity: str,
        times_s: Sequence[float],
        values: Sequence[float],
        value_std: float,
        radius_m: float,
        rate_std: float = 0.0,
    ) -> ReferenceComparison:
        """Compare with a reference; fewer than three revolutions that have one give no numbers.

        Args:
            position: wheel position.
            name: name of the reference.
            quantity: speed, rotation, angle or pulses.
            times_s: (n,) hub times of the reference.
            values: (n,) m/s, turns per second, or turns so far.
            value_std: standard error of a value.
            radius_m: belt radius of the estimate.
            rate_std: relative standard error of the sampling rate.
        """
        starts, periods = np.array(self._starts_s), np.array(self._periods_s)
        is_turns = quantity in ("angle", "pulses")
        signed = turn_means(times_s, values, starts, periods, is_turns=is_turns)
        covered = np.isfinite(signed)
        starts, periods, signed = starts[covered], periods[covered], signed[covered]
        if len(starts) < FEWEST_TURNS:
            return ReferenceComparison(position, name, quantity, 0)
        if quantity in RIG_CHANNELS:
            estimates = np.array(self._estimates.get(RIG_CHANNELS[quantity], np.full((len(covered), 2), math.nan)))
            return _with_channel(position, name, quantity, signed, estimates[covered], value_std)
        measured = np.abs(signed)
        estimated = (2.0 * math.pi * radius_m if quantity == "speed" else 1.0) / periods
        differences = estimated - measured
        # The error of an angle counts at both ends only, that of a rate everywhere; an angle shares the sensor's clock.
        span_s = float(starts[-1] + periods[-1] - starts[0])
        rate_error = math.hypot(value_std, rate_std * float(estimated.mean()))
        common_std = math.sqrt(2.0) * value_std / span_s if is_turns else rate_error
        std = math.hypot(mean_std(differences), common_std)
        radius_m = radius_std_m = contact_rad = scatter_rad = math.nan
        if quantity == "speed":
            per_turn = float(estimated.mean())
            circumference = float(np.mean(measured * periods))
            radius_m, radius_std_m = circumference / (2.0 * math.pi), circumference / (2.0 * math.pi) * std / per_turn
        if is_turns:
            order = np.argsort(times_s, kind="stable")
            turns = np.interp(starts, np.asarray(times_s)[order], np.asarray(values)[order])
            contact_rad, scatter_rad = _direction(turns * 2.0 * math.pi)
        return ReferenceComparison(
            position=position,
            name=name,
            quantity=quantity,
            revolutions=len(starts),
            estimated=float(estimated.mean()),
            measured=float(measured.mean()),
            difference=float(differences.mean()),
            difference_std=std,
            scatter=float(differences.std(ddof=1)),
            radius_m=radius_m,
            radius_std_m=radius_std_m,
            contact_rad=contact_rad,
            contact_scatter_rad=scatter_rad,
            value_std=value_std,
        )


def _with_channel(
    position: str, name: str, quantity: str, measured: FloatArray, estimates: FloatArray, value_std: float
) -> ReferenceComparison:
    """Return how (n, 2) estimates with their standard errors, NaN without one, follow (n,) values of a channel.

    `value_std` is the standard error of the channel, which all revolutions share.
    """
    is_valid = np.isfinite(estimates).all(axis=1)
    if is_valid.sum() < FEWEST_TURNS:
        std, scatter = math.hypot(mean_std(measured), value_std), float(measured.std(ddof=1))
        return ReferenceComparison(
            position, name, quantity, len(measured),
            measured=float(measured.mean()), difference_std=std, scatter=scatter,
        )  # fmt: skip
    values, stds, measured = estimates[is_valid, 0], estimates[is_valid, 1], measured[is_valid]
    # A load on a rig may be counted downward.
    differences = values - (np.abs(measured) if quantity == "load" else measured)
    deviations = measured - measured.mean()
    slope = slope_std = math.nan
    if float(measured.std()) > 2.0 * max(value_std, float(differences.std()) / math.sqrt(len(values))):
        sign = math.copysign(1.0, measured.mean()) if quantity == "load" else 1.0
        slope = sign * float(deviations @ values / (deviations @ deviations))
        residuals = values - values.mean() - sign * slope * deviations
        # Consecutive revolutions share an estimator's memory: the error is that of parts, not of revolutions.
        parts = mean_std(residuals * deviations) / float(np.mean(deviations**2))
        slope_std = max(parts, float(residuals.std()) / math.sqrt(float(deviations @ deviations)))
    return ReferenceComparison(
        position, name, quantity, len(values), float(values.mean()), float((values - differences).mean()),
        float(differences.mean()), math.hypot(mean_std(differences), value_std), float(differences.std(ddof=1)),
        float(np.sqrt(np.mean(differences**2 / (stds**2 + value_std**2)))), slope, slope_std,
    )  # fmt: skip


def turn_means(
    times_s: Sequence[float],
    values: Sequence[float],
    starts_s: FloatArray,
    periods_s: FloatArray,
    *,
    is_turns: bool = False,
) -> FloatArray:
    """Return the mean of a reference over each turn, NaN where it does not cover the turn without a gap.

    Args:
        times_s: (m,) hub times of the reference.
        values: (m,) its values.
        starts_s: (n,) hub time of the begin of each turn.
        periods_s: (n,) duration of each.
        is_turns: whether the values are turns so far, of which the rate is returned.
    """
    times, reference = np.asarray(times_s, dtype=np.float64), np.asarray(values, dtype=np.float64)
    order = np.argsort(times, kind="stable")
    times, reference = times[order], reference[order]
    covered = _covered(times, reference if is_turns else None, starts_s, periods_s)
    if not covered.any():
        return np.full(len(starts_s), math.nan)
    # Of a rate the mean over the turn: the difference of its integral.
    integral = reference if is_turns else _integral(times, reference)
    means = (np.interp(starts_s + periods_s, times, integral) - np.interp(starts_s, times, integral)) / periods_s
    return np.where(covered, means, math.nan)


def _covered(times_s: FloatArray, turns: FloatArray | None, starts_s: FloatArray, periods_s: FloatArray) -> BoolArray:
    """Return which revolutions the reference covers without a gap, also one in which whole turns were not counted."""
    if len(times_s) < 2 or not len(starts_s):
        return np.zeros(len(starts_s), dtype=np.bool_)
    first = np.searchsorted(times_s, starts_s, side="right") - 1
    last = np.searchsorted(times_s, starts_s + periods_s, side="left")
    inside = (first >= 0) & (last < len(times_s))
    steps = np.diff(times_s)
    advances = None if turns is None else np.diff(turns) * np.sign(turns[-1] - turns[0])
    # The largest step inside a window: the windows are short, and so is the loop over them.
    for k in np.flatnonzero(inside):
        window = slice(first[k], max(last[k], first[k] + 1))
        inside[k] = float(steps[window].max()) <= _LARGEST_STEP * max(float(periods_s[k]), _USUAL_STEP_S)
        # Twice the advance: an estimate of half the period is to be compared, not left out.
        if advances is not None and inside[k]:
            inside[k] = bool((steps[window] <= (0.5 + 2.0 * advances[window]) * periods_s[k]).all())
    return inside


def _integral(times_s: FloatArray, values: FloatArray) -> FloatArray:
    """Return the integral from the first time to each, by the trapezoidal rule."""
    return np.concatenate(([0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(times_s))))


def mean_std(values: FloatArray) -> float:
    """Return the standard error of a mean of three values or more, by that of consecutive parts."""
    parts = np.array_split(values, min(_BATCHES, len(values)))
    means = np.array([part.mean() for part in parts])
    return float(means.std(ddof=1) / math.sqrt(len(means)))


def _direction(angles_rad: FloatArray) -> tuple[float, float]:
    """Return mean and standard deviation of angles on the circle."""
    mean = complex(np.exp(1j * angles_rad).mean())
    centre = math.atan2(mean.imag, mean.real) % (2.0 * math.pi)
    deviations = (angles_rad - centre + math.pi) % (2.0 * math.pi) - math.pi
    return centre, float(deviations.std(ddof=1))
