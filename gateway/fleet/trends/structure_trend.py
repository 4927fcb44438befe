"""Structure of a tire over its recordings: what changes of the averaged waveform far from the sensor's own contact.

The sensor is glued to the tire, so that the angle of its contact is an angle of the tire, revolution by revolution and
recording by recording. A place of the belt, the tread or the rim that differs is in the contact when the sensor is at
the same angle each time, and the waves that it sends on stand in the average there. In the short waves far from the
sensor's contact, load, pressure, speed and uniform wear leave next to nothing. What conditions leave is fitted and
taken away; uniform wear grows with time as a local change may, but with one shape at all wheels of a fleet, which is
taken away.
Another sensor begins another tire, whose angles are others.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from gateway.core.types import FloatArray, IntArray
from gateway.fleet.trends.tire_history import TireHistory

FIRST_ORDER: Final = 12
LAST_ORDER: Final = 50
"""Orders of the averaged waveform that are followed: longer waves are the load's and the pressure's."""

# Angle from the sensor's contact centre from which on a change is not that of the contact itself.
_FAR_RAD: Final = 0.6
_ANGLES_RAD: Final = np.linspace(0.0, 2.0 * np.pi, 120, endpoint=False)
_FAR_ANGLES_RAD: Final = _ANGLES_RAD[np.abs(_ANGLES_RAD - np.pi) < np.pi - _FAR_RAD]
_COVARIATES: Final = ("contact_length_m", "pressure_pa", "temperature_degc")
# Recordings from which each power of the speed is fitted: waves run on at their own speed, and turn with that of the
# wheel. Freedom that must remain, recordings before and after a change.
_PER_POWER: Final = 10
_MOST_POWERS: Final = 4
_LEAST_FREEDOM: Final = 10
_LEAST_AFTER: Final = 3
STEPS_APART: Final = 3
RAMPS: Final = (0.0, 0.25, 0.5, 0.75)
# Other tires from which their median growth is that of uniform wear: a local change of one leaves it as it is.
_LEAST_OTHERS: Final = 3
# Part of a course that must be independent of the conditions.
_LEAST_SHARE: Final = 0.3
# Orders of recordings by chance that the course is compared with, and standard deviations beyond their mean: healthy
# rings reach 4. Change that is worth a finding, root mean square over R Omega^2.
_SHUFFLES: Final = 100
_CHANCE_STDS: Final = 6.0
_NOTABLE: Final = 2e-3
# A single recording counts no more than so many scatters.
_MOST_SCATTERS: Final = 4.0
# A place sends waves along the belt as it passes the contact. The sensor feels most of them when it still has 0.7 to 1
# of their angle to turn to its own contact (two rings of other equations, 40 to 100 km/h, a fifth to five times the
# usual losses), and those from near the sensor anywhere. The place is told where they are felt within a third of a
# radian, by more than half of what is felt at all, before they may be the sensor's own of the turn before.
_LEAST_TURN: Final = 0.7
_PLACE_ERROR_RAD: Final = 0.1
_FELT_RAD: Final = 0.35
_LEAST_FELT: Final = 0.55
_FARTHEST_RAD: Final = 4.7
_SMOOTHING: Final = np.hanning(13)[1:-1] / np.hanning(13).sum()


class StructureChange(NamedTuple):
    """Change of the waveform.

    Attributes:
        begin: recording from which on.
        is_sudden: whether it came at once, and does not grow.
        share: root mean square over the far angles at the last recording, over R Omega^2.
        std: standard error of it.
        scatter: of one recording.
        ahead_rad: bounds of the place that changed: how far ahead of the sensor it passes the contact; None where the
            waveform does not show it.
    """

    begin: int
    is_sudden: bool
    share: float
    std: float
    scatter: float
    ahead_rad: tuple[float, float] | None = None


class _Waves(NamedTuple):
    """Recordings (n,) with a waveform, a basis (n, p) of their conditions, and the waves (n, angles) beside these."""

    rows: IntArray
    base: FloatArray
    waves: FloatArray


def structure_changes(histories: Sequence[TireHistory]) -> list[StructureChange | None]:
    """Return how the waveform of each tire changes beside its conditions, and beside how those of the others grow.

    None where it does not, or recordings are few.
    """
    results: list[StructureChange | None] = [None] * len(histories)
    usable = [(index, waves) for index, history in enumerate(histories) if (waves := _waves_of(history)) is not None]
    shapes = _medians_of_others([_growth(histories[index], waves) for index, waves in usable])
    for (index, waves), shape in zip(usable, shapes, strict=True):
        unit = shape / max(float(np.linalg.norm(shape)), 1e-300)
        beside = waves._replace(waves=waves.waves - np.outer(waves.waves @ unit, unit))
        results[index] = _change(histories[index], beside)
    return results


def _medians_of_others(growths: Sequence[FloatArray]) -> FloatArray:
    """Return (tires, angles) the median growth of all other tires, zeros where they are too few."""
    stacked = np.reshape(growths, (len(growths), len(_FAR_ANGLES_RAD)))
    if len(growths) <= _LEAST_OTHERS:
        return np.zeros_like(stacked)
    ordered, count = np.sort(stacked, axis=0), len(growths) - 1
    # Without a tire's own value, those above it move down by one.
    low, high = (
        np.where(stacked <= ordered[rank], ordered[rank + 1], ordered[rank]) for rank in ((count - 1) // 2, count // 2)
    )
    return np.asarray(0.5 * (low + high))


def _waves_of(history: TireHistory) -> _Waves | None:
    orders = history.columns.get("average_orders")
    if orders is None:
        return None
    speed = history.column("speed_mean_mps")
    rows = np.flatnonzero(np.isfinite(orders).all(axis=1) & np.isfinite(speed))
    conditions = [values for name in _COVARIATES if np.isfinite(values := history.column(name)[rows]).all()]
    if len(rows) < 2 * _LEAST_FREEDOM:
        return None
    columns = _columns(speed[rows], conditions)
    if len(rows) - columns.shape[1] - 1 < _LEAST_FREEDOM:
        return None
    base = np.linalg.qr(columns)[0]
    return _Waves(rows, base, _without(base, _far_waveforms(orders[rows])))


def _growth(history: TireHistory, waves: _Waves) -> FloatArray:
    """Return (angles,) by how much the waveform grows from the first recording to the last."""
    months = history.months[waves.rows]
    alone = _without(waves.base, months)
    return np.asarray(np.ptp(months) * (alone @ waves.waves) / max(float(alone @ alone), 1e-12), dtype=np.float64)


def _change(history: TireHistory, beside: _Waves) -> StructureChange | None:
    rows, base, waves = beside
    scatters = np.sqrt(np.mean(waves**2, axis=1, keepdims=True))
    waves = waves * np.minimum(1.0, _MOST_SCATTERS * np.median(scatters) / np.maximum(scatters, 1e-12))
    courses, onsets = _courses(history.months[rows])
    residual = _without(base, courses)
    usable = np.linalg.norm(residual, axis=0) > _LEAST_SHARE * np.linalg.norm(courses - courses.mean(axis=0), axis=0)
    courses, onsets, residual = courses[:, usable], onsets[usable], residual[:, usable]
    freedom = len(rows) - base.shape[1] - 1
    if not courses.size or not np.any(waves):
        return None
    normed = residual / np.linalg.norm(residual, axis=0)
    rng = np.random.default_rng(len(rows))
    explained = _explained(normed, waves, freedom)
    by_chance = [
        _explained(normed, _without(base, waves[rng.permutation(len(rows))]), freedom).max() for _ in range(_SHUFFLES)
    ]
    peak = int(explained.argmax())
    if explained[peak] < np.mean(by_chance) + _CHANCE_STDS * np.std(by_chance):
        return None
    change = courses[-1, peak] * (normed[:, peak] @ waves) / np.linalg.norm(residual[:, peak])
    unexplained = waves - np.outer(normed[:, peak], normed[:, peak] @ waves)
    scatter = float(np.sqrt(np.sum(unexplained**2) / freedom / waves.shape[1]))
    share = float(np.sqrt(np.mean(change**2)))
    if share < _NOTABLE:
        return None
    std = scatter * float(courses[-1, peak] / np.linalg.norm(residual[:, peak]))
    is_sudden = peak >= int(usable[: len(RAMPS)].sum())
    return StructureChange(int(rows[onsets[peak]]), is_sudden, share, std, scatter, _ahead_rad(change, std))


def _ahead_rad(change: FloatArray, std: float) -> tuple[float, float] | None:
    """Return how far ahead of the sensor the place of a change (angles,) passes the contact; None if not shown."""
    felt = np.maximum(np.convolve(change**2 - std**2, _SMOOTHING, mode="same"), 0.0)
    ahead = 2.0 * np.pi - _FAR_ANGLES_RAD
    most = float(ahead[felt.argmax()])
    if most > _FARTHEST_RAD or felt[np.abs(ahead - most) < _FELT_RAD].sum() < _LEAST_FELT * felt.sum():
        return None
    # What is felt nearer to the sensor's contact is left out.
    low = most - _PLACE_ERROR_RAD if most > _FAR_RAD + _FELT_RAD else 0.0
    return low, most / _LEAST_TURN + _PLACE_ERROR_RAD


def _columns(speed: FloatArray, conditions: list[FloatArray]) -> FloatArray:
    """Return the columns (n, p) of the conditions."""
    count = len(speed)
    powers = min(_MOST_POWERS, count // _PER_POWER) if _varies(speed) else 0
    standard = _standard(speed) if powers else speed
    others = [_standard(values) for values in conditions if _varies(values)]
    crossed = [standard * others[0]] if powers and others and count >= _PER_POWER * _MOST_POWERS else []
    return np.column_stack([np.ones(count), *(standard**power for power in range(1, powers + 1)), *others, *crossed])


def _varies(values: FloatArray) -> bool:
    return bool(np.ptp(values) > 1e-6 * np.abs(values).max())


def _standard(values: FloatArray) -> FloatArray:
    return np.asarray((values - values.mean()) / values.std(), dtype=np.float64)


def _without(base: FloatArray, values: FloatArray) -> FloatArray:
    """Return columns without what a basis (n, p) explains of them."""
    return np.asarray(values - base @ (base.T @ values), dtype=np.float64)


def _far_waveforms(orders: FloatArray) -> FloatArray:
    """Return the waveforms (n, angles) of cosines and sines, in turn, of the orders."""
    phases = np.outer(np.arange(FIRST_ORDER, LAST_ORDER + 1), _FAR_ANGLES_RAD)
    return np.asarray(orders[:, 0::2] @ np.cos(phases) + orders[:, 1::2] @ np.sin(phases), dtype=np.float64)


def _courses(months: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return the courses (n, m) of a change, growing ones first, and the recordings (m,) at which they begin."""
    count, span = len(months), months[-1] - months[0]
    growing = [np.maximum(months - months[0] - share * span, 0.0) for share in RAMPS]
    steps = range(2 * _LEAST_AFTER, count - _LEAST_AFTER + 1, STEPS_APART)
    onsets = [int(np.flatnonzero(course)[0]) if course.any() else 0 for course in growing]
    return (
        np.column_stack([*growing, *((np.arange(count) >= step).astype(np.float64) for step in steps)]),
        np.array([*onsets, *steps]),
    )


def _explained(normed: FloatArray, waves: FloatArray, freedom: int) -> FloatArray:
    """Return (m,) what each course explains over what it leaves, a degree of freedom each."""
    explained = np.sum((normed.T @ waves) ** 2, axis=1)
    total = np.sum(waves**2)
    return np.asarray(explained * freedom / np.maximum(total - explained, 1e-12 * total), dtype=np.float64)
