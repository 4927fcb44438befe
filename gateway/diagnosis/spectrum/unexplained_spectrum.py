"""Lines and bands above the fitted density that no effect of the catalogue explains."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Final

import numpy as np
from scipy.ndimage import maximum_filter1d

from gateway.core.constants import AXIS_NAMES
from gateway.core.types import BoolArray, FloatArray
from gateway.diagnosis import criteria
from gateway.diagnosis.data.condition_groups import modes
from gateway.diagnosis.remainder.statistics import held_scaling, rare_ratio, scaling_of
from gateway.diagnosis.result import Unexplained
from gateway.diagnosis.spectrum.nonsynchronous_density import Site

# Window widths in bins.
_WIDTHS: Final = (1, 5, 15, 45, 135)
_EDGE_SIGMAS: Final = 2.0
_SIDEBAND_ORDERS: Final = 3.0
_RESAMPLING_ORDERS: Final = 10.0
_MAX_PARTS: Final = 16
_LINE_HZ: Final = 8.0
# Share of a band's power that a line in it must hold for the band to be that line.
_LINE_POWER_SHARE: Final = 0.5
_SAME_HZ: Final = 1.0
_SAME_ORDER: Final = 0.06
# A multiple of the wheel's frequency, so near; a band is of multiples where it is this many times as high near them.
_MULTIPLE_HZ: Final = 0.7
_NEAR_HZ: Final = 1.2
_COMB_RATIO: Final = 2.0
# Largest ratio of speeds that count as one, as a logarithm.
_SPEED_WIDTH_LN: Final = 0.05


@dataclass(frozen=True, slots=True)
class Part:
    """A line or band above the model on one axis of one group.

    Attributes:
        group: index of the group.
        axis: index of the axis.
        low_hz: lower end.
        high_hz: upper end.
        centre_hz: centre of its power.
        rms_mps2: rms above the model.
        std_mps2: one standard error.
        multiple: whether it lies at multiples of the wheel's frequency.
    """

    group: int
    axis: int
    low_hz: float
    high_hz: float
    centre_hz: float
    rms_mps2: float
    std_mps2: float
    multiple: bool = False

    @property
    def line(self) -> bool:
        """Whether the part is a line rather than a band."""
        return self.high_hz - self.low_hz <= _LINE_HZ


def parts_left(site: Site, density: FloatArray, noise: FloatArray, level: FloatArray) -> list[Part]:
    """Return the lines and bands above the model of one group.

    Args:
        site: the group.
        density: (3, m) density of the fitted model.
        noise: (3, m) its part that is sensor noise.
        level: (3,) noise level before any low-pass.
    """
    spectra = site.spectra
    power = spectra.mean_power()
    explained = np.maximum(density - noise, 0.0)
    reach = max(1, round(_SIDEBAND_ORDERS * spectra.wheel_hz / spectra.step_hz))
    filtered = np.maximum(level[:, None] - noise, 0.0)
    allowed = (
        density
        + criteria.FILTER_TO * np.minimum(filtered, noise)
        + criteria.EXPLAINED_TO * explained
        + criteria.SIDEBANDS * maximum_filter1d(explained, 2 * reach + 1, axis=1, mode="nearest")
    )
    parts: list[Part] = []
    for axis in np.flatnonzero(spectra.present).tolist():
        parts += _parts(site, axis, power[axis], density[axis], allowed[axis])
    return [part for part in parts if not _is_sideband(part, parts, spectra.wheel_hz)]


def _is_sideband(part: Part, lines: Sequence[Part], wheel_hz: float) -> bool:
    """Return whether a part is a sideband of a strong line, left by the resampling of each revolution to time."""
    return any(
        part.rms_mps2 < criteria.BESIDE_A_LINE * line.rms_mps2
        and abs(part.centre_hz - line.centre_hz) < _RESAMPLING_ORDERS * wheel_hz
        for line in lines
    )


def several_speeds(sites: Sequence[Site]) -> bool:
    """Return whether the groups differ in speed."""
    speeds = [site.spectra.speed_mps for site in sites]
    return max(speeds) > criteria.SPEEDS_APART * min(speeds)


def _parts(site: Site, axis: int, power: FloatArray, density: FloatArray, allowed: FloatArray) -> list[Part]:
    spectra = site.spectra
    frequency, step = spectra.frequency_hz, spectra.step_hz
    freedom = float(spectra.freedom.sum())
    ratio = power / allowed
    # Neighbouring bins are correlated: a single bin has more degrees of freedom than its share of a wide bin.
    windows = []
    for width in _WIDTHS:
        if width > len(ratio) // 4:
            break
        bin_freedom = freedom * (1.9 if width == 1 else width)
        mean = np.convolve(ratio, np.ones(width) / width, mode="same")
        windows.append((width, mean, rare_ratio(bin_freedom, criteria.RARE), rare_ratio(bin_freedom, _EDGE_SIGMAS)))
    is_free = np.ones(len(ratio), dtype=bool)
    parts: list[Part] = []
    for _ in range(_MAX_PARTS):
        strongest: tuple[float, int, int] | None = None
        for number, (_, mean, limit, _) in enumerate(windows):
            excess_ratio = np.where(is_free, (mean - 1.0) / (limit - 1.0), 0.0)
            peak = int(np.argmax(excess_ratio))
            if excess_ratio[peak] > 1.0 and (strongest is None or excess_ratio[peak] > strongest[0]):
                strongest = float(excess_ratio[peak]), number, peak
        if strongest is None:
            break
        _, number, peak = strongest
        width, mean, _, end = windows[number]
        first = last = peak
        while first > 0 and is_free[first - 1] and mean[first - 1] > end:
            first -= 1
        while last < len(ratio) - 1 and is_free[last + 1] and mean[last + 1] > end:
            last += 1
        # The mean over a window extends half its width beyond the excess; a line has the width of the Hann window.
        half = width // 2
        first, last = min(first + half, peak), max(last - half, peak)
        first, last = max(0, min(first, peak - 1)), min(len(ratio) - 1, max(last, peak + 1))
        # A band that exceeds the model only as a whole keeps the width of its window.
        for part in (slice(first, last + 1), _free_bins(is_free, peak, half)):
            excess = power[part] - density[part]
            total = float(excess.sum()) * step
            error = math.sqrt(float(np.square(power[part]).sum()) / freedom) * step
            if total > 0.5 * criteria.SIGMAS_LISTED * error:
                rms = math.sqrt(total)
                line_bins = _main_line(frequency[part], excess)
                weight = np.maximum(excess[line_bins], 0.0)
                centre = float(weight @ frequency[part][line_bins]) / float(weight.sum())
                low_hz, high_hz = frequency[part][line_bins][[0, -1]].tolist()
                multiple = _at_multiples(frequency[part][line_bins], excess[line_bins], centre, spectra.wheel_hz)
                parts.append(Part(site.index, axis, low_hz, high_hz, centre, rms, 0.5 * error / rms, multiple))
                first, last = min(first, part.start), max(last, part.stop - 1)
                break
        is_free[max(0, first - 2 - half) : last + 3 + half] = False
    return parts


def _main_line(frequency: FloatArray, excess: FloatArray) -> slice:
    """Return the bins of the line that holds most of a part, all of them where none does.

    A strong line has skirts and sidebands, since each revolution is resampled to time by itself.
    """
    half = max(1, round(0.5 * _LINE_HZ / float(frequency[1] - frequency[0])) - 1)
    peak = int(np.argmax(excess))
    line = slice(max(0, peak - half), peak + half + 1)
    return line if float(excess[line].sum()) > _LINE_POWER_SHARE * float(excess.sum()) else slice(None)


def _free_bins(is_free: BoolArray, peak: int, half: int) -> slice:
    """Return the free bins around a peak, up to `half` on either side."""
    first = last = peak
    while first > max(0, peak - half) and is_free[first - 1]:
        first -= 1
    while last < min(len(is_free) - 1, peak + half) and is_free[last + 1]:
        last += 1
    return slice(first, last + 1)


def _at_multiples(frequency: FloatArray, excess: FloatArray, centre_hz: float, wheel_hz: float) -> bool:
    """Return whether the excess of some bins lies at multiples of the wheel's frequency."""
    if frequency[-1] - frequency[0] <= min(_LINE_HZ, wheel_hz):
        order = round(centre_hz / wheel_hz)
        return order > 0 and abs(centre_hz - order * wheel_hz) <= max(_MULTIPLE_HZ, _SAME_ORDER * wheel_hz)
    is_near = np.abs(frequency - np.round(frequency / wheel_hz) * wheel_hz) <= _NEAR_HZ
    if is_near.all() or not is_near.any():
        return False
    return float(excess[is_near].mean()) > _COMB_RATIO * max(float(excess[~is_near].mean()), 0.0)


def unexplained(sites: Sequence[Site], parts: Sequence[Part]) -> list[Unexplained]:
    """Merge parts that belong together over groups and axes; return them largest first."""
    remaining = sorted(parts, key=lambda part: -part.rms_mps2)
    entries = []
    while remaining:
        seed = remaining[0]
        by_hz = [part for part in remaining if _same_hz(seed, part)]
        by_order = [part for part in remaining if _same_order(seed, part, sites)]
        speeds_hz, speeds_order = (_speeds(map(attrgetter("group"), alike), sites) for alike in (by_hz, by_order))
        locked = speeds_order > speeds_hz
        members = by_order if locked else by_hz
        is_lock_known = max(speeds_order, speeds_hz) > 1
        entries.append(_entry(sites, members, locked if is_lock_known else None))
        remaining = [part for part in remaining if part not in members]
    return sorted(entries, key=lambda entry: -entry.rms_mps2)


def _same_hz(seed: Part, part: Part) -> bool:
    if seed.line and part.line:
        return abs(part.centre_hz - seed.centre_hz) <= _SAME_HZ
    return part.low_hz <= seed.high_hz and seed.low_hz <= part.high_hz


def _same_order(seed: Part, part: Part, sites: Sequence[Site]) -> bool:
    seed_hz, part_hz = sites[seed.group].spectra.wheel_hz, sites[part.group].spectra.wheel_hz
    if seed.line and part.line:
        return abs(part.centre_hz / part_hz - seed.centre_hz / seed_hz) <= max(_SAME_ORDER, 0.7 / min(seed_hz, part_hz))
    return part.low_hz / part_hz <= seed.high_hz / seed_hz and seed.low_hz / seed_hz <= part.high_hz / part_hz


def _speeds(groups: Iterable[int], sites: Sequence[Site]) -> int:
    """Return the number of speeds of groups; those that differ by a few percent are one."""
    labels = modes(np.log([site.spectra.speed_mps for site in sites]), _SPEED_WIDTH_LN)
    return len({int(labels[group]) for group in groups})


def _entry(sites: Sequence[Site], parts: Sequence[Part], locked: bool | None) -> Unexplained:
    """Return one entry; `locked` is None if only one speed shows it."""
    sizes = _axis_sizes(parts)
    axis = max(sizes, key=lambda candidate: sizes[candidate])
    axis_parts = [part for part in parts if part.axis == axis]
    groups, rms, std = _group_sizes(axis_parts)
    exponent, exponent_std = held_scaling([sites[group].spectra.speed_mps for group in groups], rms, std)
    scaling = scaling_of(exponent, exponent_std, several=several_speeds(sites))
    size = math.sqrt(float(np.mean(np.square(rms))))
    error = math.sqrt(float(np.square(np.array(rms) * std).sum())) / (len(rms) * size)
    line = all(part.line for part in axis_parts)
    low, high = min(part.low_hz for part in axis_parts), max(part.high_hz for part in axis_parts)
    # A constant frequency at several speeds is a multiple of the wheel's frequency only by chance.
    doubtful = locked is not False and all(part.multiple for part in axis_parts)
    orders = _orders(sites, axis_parts)
    return Unexplained(
        AXIS_NAMES[axis],
        "time",
        _order_range(orders, doubtful=doubtful) if locked or doubtful else None,
        (low, high),
        None,
        scaling,
        size,
        error,
        lock_known=not doubtful,
        narrow=line,
        centre_order=float(np.mean([centre for _, centre, _ in orders])) if locked else math.nan,
        road_m=float(np.mean([sites[part.group].spectra.speed_mps / part.centre_hz for part in axis_parts]))
        if locked and not doubtful
        else math.nan,
        centre_hz=float(np.mean([part.centre_hz for part in axis_parts])) if line and not locked else math.nan,
        speeds=(_speeds(map(attrgetter("group"), parts), sites), _speeds(range(len(sites)), sites))
        if locked is False
        else None,
        other_axes=tuple((AXIS_NAMES[other_axis], value) for other_axis, value in sizes.items() if other_axis != axis),
    )


def _axis_sizes(parts: Sequence[Part]) -> dict[int, float]:
    """Return the rms of the parts of each axis, in m/s²."""
    return {
        axis: math.sqrt(np.mean([part.rms_mps2**2 for part in parts if part.axis == axis]))
        for axis in sorted({part.axis for part in parts})
    }


def _orders(sites: Sequence[Site], parts: Sequence[Part]) -> list[tuple[float, float, float]]:
    """Return lower end, centre and upper end of each part over the wheel's frequency."""
    wheel_hz = [sites[part.group].spectra.wheel_hz for part in parts]
    return [
        (part.low_hz / hz, part.centre_hz / hz, part.high_hz / hz) for part, hz in zip(parts, wheel_hz, strict=True)
    ]


def _group_sizes(parts: Sequence[Part]) -> tuple[list[int], list[float], list[float]]:
    """Return the groups of some parts, the rms of their parts in each, and its relative standard error."""
    groups = sorted({part.group for part in parts})
    rms, std = [], []
    for group in groups:
        group_parts = [part for part in parts if part.group == group]
        rms.append(math.sqrt(sum(part.rms_mps2**2 for part in group_parts)))
        std.append(math.sqrt(sum((part.rms_mps2 * part.std_mps2) ** 2 for part in group_parts)) / rms[-1])
    return groups, rms, std


def _order_range(orders: Sequence[tuple[float, float, float]], *, doubtful: bool) -> tuple[int, int]:
    """Return the first and the last order of parts.

    Args:
        orders: lower end, centre and upper end of each part over the wheel's frequency.
        doubtful: whether they may be multiples of the wheel's frequency, which are integers within the line's width.
    """
    low, high = min(low for low, _, _ in orders), max(high for _, _, high in orders)
    if not doubtful:
        return math.floor(low), math.ceil(high)
    first, last = max(1, math.ceil(low - 0.02)), max(1, math.floor(high + 0.02))
    if first > last:
        first = last = max(1, round(np.mean([centre for _, centre, _ in orders])))
    return first, last
