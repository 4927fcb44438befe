"""History of a tire: the columns of its recordings in the order of time."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.core.quantity import Statement
from gateway.core.reasons import Value
from gateway.core.shown_units import ShownUnits
from gateway.core.types import BoolArray, FloatArray

MONTH_NS: Final = 365.25 / 12.0 * 86_400e9
"""Length of a mean month in ns."""


@dataclass(frozen=True, slots=True)
class TireHistory:
    """Recordings of one tire at one wheel, in the order of time.

    Attributes:
        vehicle: name.
        position: of the wheel.
        sensor_id: of the tire's sensor.
        recordings: (n,) names of files.
        paths: (n,) of them.
        time_ns: (n,) starts.
        km: (n,) distance driven, from any zero.
        has_odometer: whether `km` is from an odometer.
        columns: (n,) each: numbers of the table of recordings by column, NaN where unknown.
        invalid: names of estimates -> reason of the last recording without a value.
        part: number of the tire where one sensor has had several.
        doubts: names of estimates -> (n,) why each value is provisional, empty where it is valid.
        alarms: (n,) names and texts of the alarms of each recording.
        faults: (n,) commonest reason for rejected revolutions of each recording.
        stated: (n,) each: statements as texts that are equal where the statement is, empty where it is not known.
        units: that screens show, as its last recording states.
        is_identified: False where neither a vehicle's name nor a sensor says that all recordings are of one tire.
    """

    vehicle: str
    position: str
    sensor_id: str
    recordings: tuple[str, ...]
    paths: tuple[str, ...]
    time_ns: NDArray[np.int64]
    km: FloatArray
    has_odometer: bool
    columns: Mapping[str, FloatArray]
    invalid: Mapping[str, str]
    part: int = 1
    is_identified: bool = True
    doubts: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    alarms: tuple[tuple[tuple[str, str], ...], ...] = ()
    faults: tuple[str, ...] = ()
    stated: Mapping[Statement, tuple[str, ...]] = field(default_factory=dict)
    units: ShownUnits = ShownUnits.SI

    @property
    def months(self) -> FloatArray:
        """Age at each recording, in months since the first."""
        return np.asarray((self.time_ns - self.time_ns[0]) / MONTH_NS, dtype=np.float64)

    def since(self, index: int) -> dict[str, Value]:
        """Return when the state of a recording began, s since the epoch: between it and the one before, each as likely.

        Without a recording before it, that is its own time, which has no error.
        """
        time_s = 1e-9 * float(self.time_ns[index])
        if index <= 0:
            return {"since_s": time_s}
        gap_s = time_s - 1e-9 * float(self.time_ns[index - 1])
        return {"since_s": time_s - 0.5 * gap_s, "since_std_s": gap_s / math.sqrt(12.0)}

    def column(self, name: str) -> FloatArray:
        """Return a column, NaN throughout when the dataset has none of this name."""
        column = self.columns.get(name)
        return np.full(len(self.recordings), math.nan) if column is None else column

    def doubts_of(self, name: str) -> tuple[str, ...]:
        """Return (n,) why the values of a column are provisional, empty where they are valid."""
        return self.doubts.get(name) or ("",) * len(self.recordings)

    def chosen(self, keep: BoolArray, part: int) -> TireHistory:
        """Return the history of some of the recordings."""
        index = np.flatnonzero(keep)
        return replace(
            self,
            recordings=tuple(self.recordings[i] for i in index),
            paths=tuple(self.paths[i] for i in index),
            time_ns=self.time_ns[index],
            km=self.km[index],
            columns={name: column[index] for name, column in self.columns.items()},
            part=part,
            doubts={name: tuple(texts[i] for i in index) for name, texts in self.doubts.items()},
            alarms=tuple(self.alarms[i] for i in index if self.alarms),
            faults=tuple(self.faults[i] for i in index if self.faults),
            stated={name: tuple(texts[i] for i in index) for name, texts in self.stated.items()},
        )

    def split(self, begins: list[int]) -> Iterator[TireHistory]:
        """Yield the history in parts that begin at these recordings."""
        index = np.arange(len(self.recordings))
        for part, (begin, end) in enumerate(zip([0, *begins], [*begins, len(index)], strict=True), start=1):
            yield self.chosen((index >= begin) & (index < end), part)
