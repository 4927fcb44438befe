"""A leak that begins at a date: the pressure falls as gas flows through an orifice.

Above about twice the ambient pressure the flow is choked and proportional to the absolute pressure, below it falls to
zero with the difference (Saint-Venant and Wantzel 1839; R. W. Fox, A. T. McDonald: Introduction to Fluid Mechanics,
compressible flow). With the flow function f(p) a leak is a straight line in u = int dp / f(p), whatever its size, so it
is fitted there: tight or slowly losing before a date within a gap between two recordings, and a line after it. Every
gap is tried; the weights of their likelihoods give the date and its error, and the error that the choice of the gap
adds to the rate. Rises are refills, after which the same line goes on from another level.
"""

import math
from functools import cache
from typing import Final, NamedTuple

import numpy as np

from gateway.core.constants import STANDARD_ATMOSPHERE_PA
from gateway.core.types import FloatArray

LEAST_AFTER: Final = 2
"""Recordings after the begin of a leak; one shows a fall, and no rate."""

OF_FLOW: Final = 0.025
"""Relative error of a rate by the warm and cold days of the time that it is measured over."""

_AMBIENT_KPA: Final = STANDARD_ATMOSPHERE_PA * 1e-3
# Ratio of specific heats of air.
_GAMMA: Final = 1.4
# Share of the choked flow that a flat tire is given: the coordinate in which its leak is straight has an end there.
_LEAST_FLOW: Final = 0.05
_LEAST_BEFORE: Final = 5
# Recordings after the begin: two give a rate, a third and a fourth confirm it.
_LEAST_CERTAIN: Final = 4
# A sensor resolves no better; fewer recordings may scatter less by chance.
_LEAST_SCATTER_KPA: Final = 0.3
# Rise between two recordings, in scatters of a difference, from which it is a refill.
_REFILL_STDS: Final = 5.0
# Twice the log likelihood by which a leak explains more than a slow loss, and than a single fall of the pressure.
_LEAST_GAIN: Final = 30.0
_LEAST_OVER_FALL: Final = 15.0
# The scatter is estimated from the recordings too.
_SCATTER_INFLATION: Final = 1.2
# Sum of squares over its freedom beyond which a line is not what the recordings after the begin show.
_MOST_MISFIT: Final = 4.0
# Change of the ambient pressure by weather and altitude.
_AMBIENT_STD_KPA: Final = 4.0
# Relative error of the rate by the pressure itself beyond which a tire is nearly flat.
_MOST_LEVEL_ERROR: Final = 0.2
# Faster losses only: slower ones are told by their likelihood over all refills.
_LEAST_RATE_KPA: Final = 15.0


# Newest recordings in which a leak may have begun, and those that the level before it is fitted to.
_NEWEST_COUNT: Final = 10
_BASE_COUNT: Final = 25
# Scatters by which they are below it, along a leak, so that the rate before is not that of now.
_FALL: Final = 3.0
# Recordings between two refills that show a rate, and errors by which the rates before and after a refill differ.
_LEAST_LINE: Final = 4
_MENDED_STDS: Final = 5.0


class Leak(NamedTuple):
    """A leak from a date on.

    Attributes:
        begin: index of the first recording after it began.
        date_months: time of the begin.
        date_std_months: its standard error.
        rate_kpa: loss a month at the last recording.
        rate_std_kpa: its standard error.
        now_kpa: gauge pressure at one temperature at the last recording.
        now_std_kpa: its standard error.
        expected_kpa: (n - begin,) fitted pressures from the begin on.
        freedom: of the errors.
        is_certain: whether enough recordings show the line, and a single fall or a begin after the last but one do not.
    """

    begin: int
    date_months: float
    date_std_months: float
    rate_kpa: float
    rate_std_kpa: float
    now_kpa: float
    now_std_kpa: float
    expected_kpa: FloatArray
    freedom: int
    is_certain: bool


def flow(gauge_kpa: FloatArray) -> FloatArray:
    """Return the flow through an orifice by gauge pressure, as an absolute pressure (kPa) that is choked.

    Args:
        gauge_kpa: (n,) at one temperature.
    """
    absolute = np.maximum(np.asarray(gauge_kpa, dtype=np.float64), 0.0) + _AMBIENT_KPA
    ratio = _AMBIENT_KPA / absolute
    critical = (2.0 / (_GAMMA + 1.0)) ** (_GAMMA / (_GAMMA - 1.0))

    def psi(ratios: FloatArray) -> FloatArray:
        return np.sqrt(np.maximum(ratios ** (2.0 / _GAMMA) - ratios ** ((_GAMMA + 1.0) / _GAMMA), 0.0))

    choked_psi = float(psi(np.array([critical]))[0])
    share = np.maximum(np.where(ratio < critical, 1.0, psi(ratio) / choked_psi), _LEAST_FLOW)
    return np.asarray(absolute * share, dtype=np.float64)


@cache
def _flow_integral() -> tuple[FloatArray, FloatArray]:
    """Return gauge pressures and the coordinate in which a leak is a straight line."""
    # The flow ends with a root of the difference, which the steps follow.
    gauge = 1500.0 * np.linspace(0.0, 1.0, 4001) ** 2
    slopes = 1.0 / np.maximum(flow(0.5 * (gauge[1:] + gauge[:-1])), 1e-3)
    return gauge, np.concatenate([[0.0], np.cumsum(slopes * np.diff(gauge))])


def straightened(gauge_kpa: FloatArray, at_kpa: float) -> FloatArray:
    """Return pressures in which a leak is a straight line whose slope is that at one pressure.

    Args:
        gauge_kpa: (n,) at one temperature.
        at_kpa: pressure near which they are kPa.
    """
    gauge, integral = _flow_integral()
    origin = float(np.interp(at_kpa, gauge, integral))
    return np.asarray(at_kpa + float(flow(np.array([at_kpa]))[0]) * (np.interp(gauge_kpa, gauge, integral) - origin))


def bent(along_kpa: FloatArray, at_kpa: float) -> FloatArray:
    """Return the pressures of straightened ones."""
    gauge, integral = _flow_integral()
    origin = float(np.interp(at_kpa, gauge, integral))
    return np.interp(origin + (along_kpa - at_kpa) / float(flow(np.array([at_kpa]))[0]), integral, gauge)


def _steepness(gauge_kpa: float) -> float:
    """Return the logarithmic derivative of the flow, per kPa."""
    below, above = flow(np.array([max(gauge_kpa - 1.0, 0.0), max(gauge_kpa, 0.0) + 1.0])).tolist()
    return math.log(above / below) / 2.0


def newest_fall(months: FloatArray, cold_kpa: FloatArray, scatter_kpa: float) -> tuple[int, float] | None:
    """Return where the newest recordings begin that are below their trend as after a leak, and by how many scatters.

    Few recordings show a fall before they show a rate. None where no fall is visible.

    Args:
        months: (n,) times of the recordings, increasing.
        cold_kpa: (n,) gauge pressures at one temperature.
        scatter_kpa: of single recordings.
    """
    months, values = months[-_BASE_COUNT:], cold_kpa[-_BASE_COUNT:]
    skipped, count = len(cold_kpa) - len(values), len(values)
    scatter = max(scatter_kpa, _LEAST_SCATTER_KPA)
    changes = np.diff(values)
    jumps = changes > _REFILL_STDS * math.sqrt(2.0) * scatter
    # A fall that is long ago, after which the pressure held, was air that was let out.
    newest_start = max(count - 1 - _NEWEST_COUNT, 0)
    jumps[:newest_start] |= changes[:newest_start] < -_REFILL_STDS * math.sqrt(2.0) * scatter
    pieces = np.concatenate([[0.0], np.cumsum(jumps)])
    rows = np.column_stack([months - months[-1], pieces[:, None] == np.unique(pieces)[None, :]]).astype(np.float64)
    onsets = np.arange(max(count - _NEWEST_COUNT, _LEAST_BEFORE), count)
    if count <= rows.shape[1] + 1 or not onsets.size:
        return None
    # The leak begins with the last recording before it, or just before the first one of it.
    ramps = [np.maximum(months - months[onset - 1], 0.0) for onset in onsets]
    ramps += [np.maximum(months - months[onset], 0.0) for onset in onsets[:-1]]
    ramp_columns = np.column_stack(ramps)
    basis = np.linalg.qr(rows)[0]
    residuals = values - basis @ (basis.T @ values)
    ramp_columns = ramp_columns - basis @ (basis.T @ ramp_columns)
    lengths = np.sqrt(np.einsum("ij,ij->j", ramp_columns, ramp_columns))
    usable = lengths > 1e-6
    deviations = np.where(usable, -(residuals @ ramp_columns) / np.where(usable, lengths, 1.0), 0.0) / scatter
    peak = int(np.argmax(deviations))
    if deviations[peak] <= _FALL:
        return None
    return skipped + int([*onsets, *onsets[:-1]][peak]), float(deviations[peak])


def is_steady_leak(months: FloatArray, cold_kpa: FloatArray, scatter_kpa: float) -> bool:
    """Return whether a tire leaks from its first recording on so fast that its pressure follows the flow of an orifice.

    Args:
        months: (n,) times of the recordings, increasing.
        cold_kpa: (n,) gauge pressures at one temperature.
        scatter_kpa: of single recordings.
    """
    stds = np.full(len(months), max(scatter_kpa, _LEAST_SCATTER_KPA))
    values = straightened(cold_kpa, float(cold_kpa[-1]))
    bent_stds = stds * float(flow(cold_kpa[-1:])[0]) / np.maximum(flow(cold_kpa), 1e-3)
    refills = _refills(cold_kpa, stds)
    coefficients, _, squares = _levels_fit(months, values, bent_stds, refills)
    return -coefficients[0] > _LEAST_RATE_KPA and squares < _levels_fit(months, cold_kpa, stds, refills)[2] - _FALL**2


def mended_at(months: FloatArray, cold_kpa: FloatArray, scatter_kpa: float) -> int:
    """Return the first recording after the last refill that ended a leak; 0 where none did.

    Args:
        months: (n,) times of the recordings, increasing.
        cold_kpa: (n,) gauge pressures at one temperature.
        scatter_kpa: of single recordings.
    """
    scatter = max(scatter_kpa, _LEAST_SCATTER_KPA)
    edges = [0, *np.flatnonzero(np.diff(cold_kpa) > _REFILL_STDS * math.sqrt(2.0) * scatter) + 1, len(cold_kpa)]
    for number in range(len(edges) - 2, 0, -1):
        before, after = (slice(edges[index], edges[index + 1]) for index in (number - 1, number))
        lines = [_slope(months[period], cold_kpa[period], scatter) for period in (before, after)]
        if None in lines:
            continue
        (old_slope, old_std), (new_slope, new_std) = (line for line in lines if line is not None)
        if new_slope - old_slope > max(_LEAST_RATE_KPA, _MENDED_STDS * math.hypot(old_std, new_std)):
            return int(edges[number])
    return 0


def _slope(months: FloatArray, values: FloatArray, std: float) -> tuple[float, float] | None:
    """Return the slope of a line and its error; None of too few points."""
    if len(months) < _LEAST_LINE:
        return None
    centred = months - months.mean()
    square = float(centred @ centred)
    return (float(centred @ values) / square, std / math.sqrt(square)) if square > 0.0 else None


class _Fit(NamedTuple):
    """A leak that begins in one gap: in kPa that are straightened at the last pressure."""

    begin: int
    squares: float
    rate: float
    rate_std: float
    now: float
    now_std: float
    expected: FloatArray
    share: float
    after_squares: float
    freedom: int


def newest_leak(months: FloatArray, cold_kpa: FloatArray, scatter_kpa: float, drift_kpa: float = 0.0) -> Leak | None:
    """Return the leak that the newest recordings show; None without one.

    Args:
        months: (n,) times of the recordings, increasing.
        cold_kpa: (n,) gauge pressures at one temperature.
        scatter_kpa: of single recordings.
        drift_kpa: standard error of the rate, a month, by what is not measured.
    """
    count = len(months)
    if count < _LEAST_BEFORE + LEAST_AFTER:
        return None
    scatter = max(scatter_kpa, _LEAST_SCATTER_KPA)
    at_kpa = float(cold_kpa[-1])
    values = straightened(cold_kpa, at_kpa)
    slopes = float(flow(np.array([at_kpa]))[0]) / np.maximum(flow(cold_kpa), 1e-3)
    stds = scatter * slopes
    fits = [
        fit
        for onset in range(_LEAST_BEFORE, count - LEAST_AFTER + 1)
        if (fit := _fit(months, values, stds, onset)) is not None
    ]
    tight = _line_squares(months, values, stds)
    fits = [fit for fit in fits if fit.rate > 0.0]
    if not fits:
        return None
    leak = min(fits, key=lambda fit: fit.squares)
    if tight - leak.squares < _LEAST_GAIN or leak.rate < max(_LEAST_RATE_KPA, 3.0 * leak.rate_std, 3.0 * drift_kpa):
        return None
    if _fall_squares(months, values, stds) - leak.squares < _LEAST_OVER_FALL:
        return None
    # Of a leak that began after the last recording but one only a lower limit of the rate is known.
    line_without_last = _line_squares(months[:-1], values[:-1], stds[:-1])
    weights = np.exp(-0.5 * np.minimum(np.array([fit.squares for fit in fits]) - leak.squares, 100.0))
    weights /= weights.sum()
    rates, dates, variances = (
        np.array([fit.rate for fit in fits]),
        np.array([months[fit.begin - 1] + fit.share * (months[fit.begin] - months[fit.begin - 1]) for fit in fits]),
        np.array([fit.rate_std**2 for fit in fits]),
    )
    rate, date = float(weights @ rates), float(weights @ dates)
    inflation = max(leak.after_squares / max(leak.freedom, 1), 1.0) if leak.freedom > 0 else 1.0
    last_kpa = float(bent(np.array([leak.now]), at_kpa)[0])
    # Near the ambient pressure the flow follows the difference.
    level_error = _steepness(last_kpa) * math.hypot(_AMBIENT_STD_KPA, leak.now_std)
    rate_std = math.sqrt(
        _SCATTER_INFLATION**2 * float(weights @ (inflation * variances + (rates - rate) ** 2))
        + drift_kpa**2
        + rate**2 * (OF_FLOW**2 + level_error**2)
    )
    gap = float(months[leak.begin] - months[leak.begin - 1])
    date_std = math.sqrt(
        float(weights @ (dates - date) ** 2) + min(gap**2 / 12.0, (scatter * math.sqrt(1.5) / leak.rate) ** 2)
    )
    return Leak(
        leak.begin,
        date,
        date_std,
        rate,
        rate_std,
        last_kpa,
        leak.now_std,
        bent(leak.expected, at_kpa),
        leak.freedom,
        count - leak.begin >= _LEAST_CERTAIN
        and line_without_last - leak.squares >= _LEAST_OVER_FALL
        and level_error < _MOST_LEVEL_ERROR
        and (leak.freedom <= 0 or leak.after_squares <= _MOST_MISFIT * leak.freedom),
    )


def _line_squares(months: FloatArray, values: FloatArray, stds: FloatArray) -> float:
    """Return the sum of squares of a line with refills through all recordings."""
    return _levels_fit(months, values, stds, _refills(values, stds))[2]


def _fall_squares(months: FloatArray, values: FloatArray, stds: FloatArray) -> float:
    """Return the least sum of squares of a line with refills and one fall, as of air that is let out."""
    refills = _refills(values, stds)
    levels = (refills[:, None] == np.unique(refills)[None, :]).astype(np.float64)
    rows = np.column_stack([months - months[-1], levels]) / stds[:, None]
    basis = np.linalg.qr(rows)[0]
    scaled = values / stds
    residuals = scaled - basis @ (basis.T @ scaled)
    falls = (np.arange(len(months))[:, None] >= np.arange(_LEAST_BEFORE, len(months))[None, :]) / stds[:, None]
    falls = falls - basis @ (basis.T @ falls)
    lengths = np.maximum(np.einsum("ij,ij->j", falls, falls), 1e-12)
    projections = falls.T @ residuals
    gains = np.where(projections < 0.0, projections**2 / lengths, 0.0)
    return float(residuals @ residuals - gains.max())


def _refills(values: FloatArray, stds: FloatArray) -> FloatArray:
    """Return (n,) the number of refills before each recording."""
    rises = np.diff(values) > _REFILL_STDS * math.sqrt(2.0) * np.maximum(stds[1:], stds[:-1])
    return np.concatenate([[0.0], np.cumsum(rises)])


def _levels_fit(
    months: FloatArray, values: FloatArray, stds: FloatArray, refills: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """Return coefficients and covariance of a line with a level for each part, slope first, and the sum of squares."""
    levels = (refills[:, None] == np.unique(refills)[None, :]).astype(np.float64)
    rows = np.column_stack([months - months[-1], levels]) / stds[:, None]
    coefficients = np.asarray(np.linalg.lstsq(rows, values / stds, rcond=None)[0], dtype=np.float64)
    residuals = values / stds - rows @ coefficients
    covariance = np.asarray(np.linalg.pinv(rows.T @ rows), dtype=np.float64)
    return coefficients, covariance, float(residuals @ residuals)


def _fit(months: FloatArray, values: FloatArray, stds: FloatArray, onset: int) -> _Fit | None:
    """Return the fit of a leak that begins before a recording."""
    before = slice(0, onset)
    tight = _levels_fit(months[before], values[before], stds[before], _refills(values[before], stds[before]))
    tight_slope, tight_squares = float(tight[0][0]), tight[2]
    level = float(tight[0][-1])  # at months[begin - 1]
    level_std = math.sqrt(max(float(tight[1][-1, -1]), 0.0))
    after = slice(onset, len(months))
    times, observed, errors = months[after], values[after], stds[after]
    refills = _refills(observed, errors)
    count = len(times)
    freedom = count - 1 - len(np.unique(refills))
    if freedom < 0:
        return None
    coefficients, covariance, squares = _levels_fit(times, observed, errors, refills)
    # Where the line of the leak meets the level before it: the begin, within the gap.
    rate = -float(coefficients[0]) + min(tight_slope, 0.0)
    first_value = float(coefficients[1]) + float(coefficients[0]) * (times[0] - times[-1])
    fall = level + tight_slope * (times[0] - months[onset - 1]) - first_value
    gap = float(times[0] - months[onset - 1])
    row = np.zeros(len(coefficients))
    row[:2] = times[0] - times[-1], 1.0
    fall_std = math.hypot(level_std, math.sqrt(max(float(row @ covariance @ row), 0.0)))
    least_fall, most_fall = 0.0, max(rate, 0.0) * gap
    excess = max(fall - most_fall, least_fall - fall, 0.0)
    # The distance by which the line misses the gap, by the error that fall and rate have together.
    slope_std = math.sqrt(max(float(covariance[0, 0]), 0.0))
    combined_std = math.hypot(fall_std, gap * slope_std if fall > most_fall else 0.0)
    misfit = (excess / max(combined_std, 1e-9)) ** 2
    if misfit > 25.0:
        return None
    share = 1.0 - float(np.clip(fall / max(rate * gap, 1e-9), 0.0, 1.0))
    design = np.column_stack([times - times[-1], (refills[:, None] == np.unique(refills)[None, :]).astype(np.float64)])
    return _Fit(
        onset,
        tight_squares + squares + misfit,
        -float(coefficients[0]),
        slope_std,
        float(coefficients[-1]),
        math.sqrt(max(float(covariance[-1, -1]), 0.0)),
        design @ coefficients,
        share,
        squares,
        freedom,
    )
