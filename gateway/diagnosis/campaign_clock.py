"""Rate error of a hub's clock against the host's, from arrival times, to which a link can only add delay."""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.block_decoder import FrameBatch
from gateway.core.types import FloatArray

UNKNOWN: Final = (math.nan, math.nan)

_WINDOW_S: Final = 1.0
_MIN_WINDOWS: Final = 6
# A larger step of the delay is not a delay but a restart of the hub.
_RESTART_S: Final = 5.0
_FIT_ROUNDS: Final = 4
# Frames at the beginning that are searched for slots of the link, and the share that arrives together if it has slots.
_SLOT_FRAMES: Final = 1000
_SLOT_SHARE: Final = 0.3


class HubClockError:
    """Clock error of every hub of a recording, from its frames."""

    def __init__(self) -> None:
        """Start without frames."""
        # (link, hub) -> unwrapped hub time and delay of the last frame, s
        self._last: dict[tuple[str, int], tuple[int, float]] = {}
        # (link, hub, start) -> window -> (hub time, delay) of its earliest arrival
        self._earliest: dict[tuple[str, int, int], dict[int, tuple[float, float]]] = {}
        self._starts: dict[tuple[str, int], int] = {}
        # (link, hub) -> hub time and arrival of its first frames, s
        self._first: dict[tuple[str, int], list[FloatArray]] = {}

    def take(self, link: str, batch: FrameBatch, arrivals_ns: NDArray[np.int64]) -> None:
        """Take a block of frames and their arrival times."""
        hubs = np.asarray(batch.hub)
        for number in np.unique(hubs).tolist():
            of_hub = np.flatnonzero(hubs == number)
            self._take((link, number), np.asarray(batch.tick_us)[of_hub], arrivals_ns[of_hub])

    def _take(self, key: tuple[str, int], tick_us: NDArray[np.uint32], arrivals_ns: NDArray[np.int64]) -> None:
        steps = np.diff(tick_us).astype(np.int32).astype(np.int64)
        ticks = int(tick_us[0]) + np.concatenate(([0], np.cumsum(steps)))
        if key in self._last:
            last_us = self._last[key][0]
            step = int(np.array([(int(tick_us[0]) - last_us) & 0xFFFFFFFF], np.uint32).view(np.int32)[0])
            ticks += last_us + step - int(tick_us[0])
        hub_s = ticks * 1e-6
        parts = self._first.setdefault(key, [])
        if sum(part.shape[1] for part in parts) < _SLOT_FRAMES:
            parts.append(np.stack((hub_s - ticks[0] * 1e-6, (arrivals_ns - arrivals_ns[0]) * 1e-9)))
        delay_s = (arrivals_ns - ticks * 1000) * 1e-9
        previous = self._last[key][1] if key in self._last else float(delay_s[0])
        start = self._starts.get(key, 0) + np.cumsum(np.abs(np.diff(delay_s, prepend=previous)) > _RESTART_S)
        self._last[key] = int(ticks[-1]), float(delay_s[-1])
        self._starts[key] = int(start[-1])
        windows = np.floor(hub_s / _WINDOW_S).astype(np.int64)
        order = np.lexsort((delay_s, windows, start))
        first = np.ones(len(order), dtype=bool)
        first[1:] = (np.diff(windows[order]) != 0) | (np.diff(start[order]) != 0)
        for frame in order[first].tolist():
            earliest = self._earliest.setdefault((*key, int(start[frame])), {})
            window = int(windows[frame])
            if window not in earliest or delay_s[frame] < earliest[window][1]:
                earliest[window] = float(hub_s[frame]), float(delay_s[frame])

    def error(self, hub: int) -> tuple[float, float]:
        """Return the share by which a hub's clock runs fast, and its standard error; NaN when unknown."""
        errors = []
        for (link, number, _), earliest in self._earliest.items():
            if number == hub and (line := _line(earliest)) is not None:
                # Clocks that drift apart by less than the step of a slot leave no trace.
                span_s = _WINDOW_S * (len(earliest) - 2)
                errors.append((line[0], math.hypot(line[1], _slot_step_s(self._first[link, number]) / span_s)))
        return combined(errors)


def _slot_step_s(parts: list[FloatArray]) -> float:
    """Return the drift between the clocks, s, at which another frame becomes the last to reach its slot of the link.

    A link that delivers in slots of host time shows no arrivals between them. Where the periods of frames and slots are
    commensurate, the distance of frames from the end of a slot repeats, and a small clock error changes nothing. 0 for
    a link without slots.
    """
    hub_s, arrival_s = max(parts, key=lambda part: part.shape[1])
    slots = np.unique(arrival_s)
    if len(slots) < _MIN_WINDOWS or 1.0 - len(slots) / len(arrival_s) < _SLOT_SHARE:
        return 0.0
    steps = np.diff(slots)
    slot_s = float(np.median(steps))
    slot_s = float(steps.sum() / np.maximum(np.round(steps / slot_s), 1.0).sum())
    phase_s = np.sort(np.mod(hub_s, slot_s))
    gaps = np.diff(np.append(phase_s, phase_s[0] + slot_s))
    return float(gaps.max())


def combined(errors: list[tuple[float, float]]) -> tuple[float, float]:
    """Return the weighted mean of clock errors (value, std), std being the larger of both estimates; NaN for none."""
    usable = [(value, std) for value, std in errors if math.isfinite(value) and std > 0.0]
    if not usable:
        return UNKNOWN
    value, std = np.array(usable).T
    weight = 1.0 / np.square(std)
    mean = float((weight * value).sum() / weight.sum())
    error = 1.0 / math.sqrt(float(weight.sum()))
    if len(usable) > 1:
        spread = math.sqrt(float((weight * np.square(value - mean)).sum()) / (len(usable) - 1))
        error *= max(1.0, spread)
    return mean, error


def _line(earliest: dict[int, tuple[float, float]]) -> tuple[float, float] | None:
    """Return the clock error from a line fitted to the earliest arrivals, and its standard error; None if unknown."""
    if len(earliest) < _MIN_WINDOWS:
        return None
    # The first and the last window may contain few frames.
    hub_s, delay_s = np.array([earliest[window] for window in sorted(earliest)][1:-1]).T
    delay_s = delay_s - delay_s[0]
    early = np.ones(len(hub_s), dtype=bool)
    slope = offset = 0.0
    residual = delay_s
    for _ in range(_FIT_ROUNDS):
        slope, offset = (float(value) for value in np.polyfit(hub_s[early], delay_s[early], 1))
        residual = delay_s - (offset + slope * hub_s)
        limit = float(np.median(residual)) + 3.0 * float(np.median(np.abs(residual - np.median(residual))))
        inliers = residual <= max(limit, 1e-9)
        if inliers.sum() < _MIN_WINDOWS // 2 or (inliers == early).all():
            break
        early = inliers
    number = int(early.sum())
    spread = math.sqrt(float(np.square(hub_s[early] - hub_s[early].mean()).sum()))
    # At least the resolution of the hub's time stamps.
    scatter = max(1e-6, math.sqrt(float(np.square(residual[early]).sum()) / max(number - 2, 1)))
    # Delays of neighbouring seconds are correlated while a link is busy.
    centred = residual[early] - residual[early].mean()
    power = float(np.square(centred).sum())
    lag = float(centred[1:] @ centred[:-1]) / power if power > 0.0 else 0.0
    dependence = math.sqrt((1.0 + max(0.0, lag)) / (1.0 - min(0.95, max(0.0, lag))))
    return -slope / (1.0 + slope), scatter / spread * dependence
