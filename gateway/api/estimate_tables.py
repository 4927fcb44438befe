"""Tables of a recording's results: estimates in long form, and alarms."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from gateway.api.column_table import (
    ColumnTable,
    IndexArray,
    TextArray,
    TimeArray,
    column,
    require_pandas,
    text_array,
    unit_of,
    utc_array,
)
from gateway.api.covariance import CAUSES, covariance, relative_errors, scatter_correlation
from gateway.api.estimate_comparison import Comparison
from gateway.api.table_plot import drawn_each
from gateway.compare.mean_comparison import Radius, compared_means
from gateway.core.estimates.estimator import Status
from gateway.core.estimates.result_block import ResultBlock
from gateway.core.estimates.results import AlarmRecord
from gateway.core.estimates.weighted_mean import MeanEstimate, WeightedMean, coverage_factor, mean_estimate
from gateway.core.nearest_name import did_you_mean
from gateway.core.quantity import Basis
from gateway.core.quantity_catalogue import quantity_of
from gateway.core.table_columns import unsuffixed
from gateway.core.text.readout import DISTANCE
from gateway.core.text.wording import joined, text
from gateway.core.types import BoolArray, FloatArray

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Estimates(ColumnTable):
    """Estimates of a recording in long form: one row per revolution and quantity.

    Values have the unit in their name: `load_n` is in N, `speed_mps` in m/s.
    """

    _rows: ClassVar[str] = "estimates"

    wheel: TextArray = field(metadata=column("position"))
    revolution: IndexArray = field(metadata=column())
    device_start_s: FloatArray = field(metadata=column())
    device_end_s: FloatArray = field(metadata=column())
    host_utc: TimeArray = field(metadata=column())
    name: TextArray = field(metadata=column("quantity, with its unit"))
    value: FloatArray = field(metadata=column("in the unit of the name; NaN when invalid"))
    std: FloatArray = field(metadata=column("one standard error, same unit; NaN when not known"))
    constant_std: FloatArray = field(metadata=column("its part that revolutions share"))
    scatter_std: FloatArray = field(metadata=column("its part that averaging makes smaller"))
    unit: TextArray = field(metadata=column("of value and std; empty without one"))
    status: TextArray = field(metadata=column("valid, provisional or invalid"))
    reasons: TextArray = field(metadata=column("why it is not valid, or notes on a valid one"))
    radius_m: FloatArray = field(metadata=column("belt radius that it rests on"))
    shared_std: FloatArray = field(
        metadata=column(f"(n, {len(CAUSES)}) relative standard errors of {', '.join(CAUSES)}")
    )

    @property
    def names(self) -> tuple[str, ...]:
        """Quantities in the table, in the order of their first rows."""
        return tuple(dict.fromkeys(self.name.tolist()))

    def select(
        self, name: str | None = None, *, wheel: str | None = None, status: str | Sequence[str] | None = None
    ) -> Self:
        """Return the rows of a quantity, a wheel and a status; None for all of them.

        Raises:
            KeyError: the table has no such quantity or wheel.
            ValueError: no such status.
        """
        chosen = np.ones(len(self), np.bool_)
        for key, wanted in (("name", name), ("wheel", wheel)):
            if wanted is not None:
                is_wanted: BoolArray = self[key] == wanted
                if not is_wanted.any():
                    present = list(dict.fromkeys(self[key].tolist()))
                    raise KeyError(
                        f"no estimate has the {key} '{wanted}'. {did_you_mean(wanted, present)}"
                        f"There is {', '.join(present) or 'none'}"
                    )
                chosen &= is_wanted
        if status is not None:
            statuses = [status] if isinstance(status, str) else list(status)
            present = [item.value for item in Status]
            for unknown in (item for item in statuses if item not in present):
                raise ValueError(
                    f"no status is '{unknown}'. {did_you_mean(unknown, present)}There is {', '.join(present)}"
                )
            chosen &= np.isin(self.status.astype(str), statuses)
        return self._selected(chosen)

    def mean(self, name: str, *, wheel: str | None = None) -> MeanEstimate:
        """Return the mean of a quantity over its valid revolutions, with its uncertainty in the terms of JCGM 100.

        The mean of the column is not it: revolutions share most of their error, which no averaging makes smaller.

        Args:
            name: of the quantity.
            wheel: whose; None where the table has one wheel with this quantity.

        Raises:
            KeyError: the table has no such quantity or wheel, or no valid value of it.
            ValueError: several wheels have it.
        """
        rows = self.select(name, wheel=wheel)
        wheels = list(dict.fromkeys(rows.wheel.tolist()))
        if len(wheels) > 1:
            raise ValueError(f"'{name}' is that of several wheels: choose wheel, one of {', '.join(wheels)}")
        mean = WeightedMean()
        valid: BoolArray = (rows.status == Status.VALID.value) & np.isfinite(rows.value)
        columns = (rows.value[valid].tolist(), rows.std[valid].tolist(), rows.scatter_std[valid].tolist())
        for value, std, scatter_std in zip(*columns, strict=True):
            mean.add(value, std, scatter_std)
        if not mean.count:
            raise KeyError(f"no revolution of {wheels[0]} has a valid '{name}'")
        return mean_estimate(mean, quantity_of(name).correlated_revolutions)

    def compare(self, other: Estimates) -> Comparison:
        """Return the differences of another recording, as `treadlink compare` prints them; the distance is left out.

        Args:
            other: estimates of the other recording.

        Returns:
            a row for each wheel and quantity with valid values in both; of their errors, that of the same belt radius
            counts as common to both.
        """
        differences = compared_means(self._means(), other._means(), self._radii(), other._radii())
        return Comparison.of(differences, recording=self.recording, other_recording=other.recording)

    def _means(self) -> dict[tuple[str, str], MeanEstimate]:
        means = {}
        for wheel in dict.fromkeys(self.wheel.tolist()):
            for name in self.names:
                if name != DISTANCE:
                    with suppress(KeyError):  # no valid value
                        means[wheel, name] = self.mean(name, wheel=wheel)
        return means

    def _radii(self) -> dict[str, Radius]:
        """Return the belt radius of each wheel, as it was at the end."""
        radii = {}
        for wheel in dict.fromkeys(self.wheel.tolist()):
            last = int(np.flatnonzero(self.wheel == wheel)[-1])
            radius_m = float(self.radius_m[last])
            radii[wheel] = Radius(radius_m, radius_m * float(self.shared_std[last, CAUSES.index(Basis.RADIUS)]))
        return radii

    def expanded(self, probability: float = 0.95) -> tuple[FloatArray, float]:
        """Return the expanded uncertainty of each row, (n,), and its coverage factor (JCGM 100, 6.2).

        The factor is that of a normal distribution: the parts of an estimate's error have many degrees of freedom.

        Args:
            probability: that value +- uncertainty contains the quantity.

        Raises:
            ValueError: the probability is not within 0 and 1.
        """
        factor = coverage_factor(probability)
        return factor * self.std, factor

    def covariance(self, *names: str, wheel: str | None = None, revolution: int | None = None) -> FloatArray:
        """Return the covariance of quantities of a revolution, (k, k), in the order and units of the names.

        Radius, rate, gain, load and pressure connect the constant parts of the errors, with the powers that are
        declared of each quantity; the scattering parts are correlated as they are over the valid revolutions.

        Args:
            names: of the quantities.
            wheel: whose; None where the table has one wheel with them.
            revolution: its number; None for the last in which all are valid.

        Raises:
            KeyError: the table has no such quantity or wheel, or no revolution in which all are valid.
            ValueError: no name, or several wheels have the quantities.
        """
        if not names:
            raise ValueError("the covariance needs the names of quantities")
        tables = [self.select(name, wheel=wheel, status=Status.VALID.value) for name in names]
        wheels = list(dict.fromkeys(position for table in tables for position in table.wheel.tolist()))
        if len(wheels) > 1:
            raise ValueError(f"several wheels have these quantities: choose wheel, one of {', '.join(wheels)}")
        numbers = reduce(np.intersect1d, [table.revolution for table in tables])
        if not len(numbers) or (revolution is not None and revolution not in numbers):
            which = "no revolution" if revolution is None else f"not revolution {revolution}"
            raise KeyError(f"{which} has valid values of all of {', '.join(names)}")
        chosen = int(numbers[-1]) if revolution is None else revolution
        series = np.stack([table.value[np.isin(table.revolution, numbers)] for table in tables], axis=1)
        selected = [table._selected(table.revolution == chosen) for table in tables]
        value, constant, scatter = (
            np.array([float(table[key][0]) for table in selected]) for key in ("value", "constant_std", "scatter_std")
        )
        return covariance(names, value, constant, scatter, selected[0].shared_std[0], scatter_correlation(series))

    def plot(self, *names: str) -> Figure:
        """Return a matplotlib figure of quantities against time, with bands of their standard errors.

        Args:
            names: quantities; none for all. Invalid estimates are left out.

        Raises:
            KeyError: there is no such quantity.
            OutputError: matplotlib is not installed.
        """
        series = {}
        for name in names or self.names:
            rows = self.select(name)
            for wheel in dict.fromkeys(rows.wheel.tolist()):
                good: BoolArray = (rows.wheel == wheel) & (rows.status != Status.INVALID.value)
                label, unit = f"{wheel} {name}", str(rows.unit[0])
                series[label] = rows.device_end_s[good], rows.value[good], rows.std[good], unit
        return drawn_each(series, "device_end_s (s)", self._title())

    def to_pandas(self, *, wide: bool = False) -> pd.DataFrame:
        """Return a DataFrame; text columns are categories.

        Args:
            wide: one row per revolution and wheel instead, with columns `NAME`, `NAME_std`, its parts
                `NAME_constant_std` and `NAME_scatter_std`, and `NAME_status`.

        Raises:
            OutputError: pandas is not installed.
        """
        frame = super().to_pandas()
        for column_of_text in ("wheel", "name", "unit", "status", "reasons"):
            frame[column_of_text] = frame[column_of_text].astype("category")
        if not wide:
            return frame
        pandas = require_pandas()
        rows = ["wheel", "revolution"]
        plain = frame.astype(dict.fromkeys(("wheel", "name", "status"), object))
        times = plain[[*rows, "device_start_s", "device_end_s", "host_utc"]].drop_duplicates(rows).set_index(rows)
        parts = {
            suffix: plain.pivot(index=rows, columns="name", values=values)
            for suffix, values in (
                ("", "value"),
                ("_std", "std"),
                ("_constant_std", "constant_std"),
                ("_scatter_std", "scatter_std"),
                ("_status", "status"),
            )
        }
        named = {f"{name}{suffix}": part[name] for name in self.names for suffix, part in parts.items()}
        table: pd.DataFrame = pandas.concat([times, pandas.DataFrame(named)], axis=1).reset_index()
        units = {name: unit_of(unsuffixed(name)) for name in table.columns}
        table.attrs.clear()
        table.attrs.update({"units": units, **self.metadata})
        return table

    def _title(self) -> str:
        wheels = ", ".join(dict.fromkeys(self.wheel.tolist())) or "no wheel"
        return f"{len(self)} estimates of {wheels}: {', '.join(self.names)}"


class EstimateRows:
    """Collects estimates block by block, in little memory."""

    def __init__(self, *, has_host_time: bool) -> None:
        """Start empty."""
        self._has_host_time = has_host_time
        self._codes: dict[str, int] = {}
        self._columns: dict[str, list[NDArray[Any]]] = {}

    def add(self, block: ResultBlock) -> None:
        """Add the estimates of consecutive revolutions."""
        rows, count = len(block), len(block.names)
        of_revolution = {
            "revolution": np.array([revolution.index for revolution in block.revolutions]),
            "host_utc": utc_array([result.host_ns if self._has_host_time else 0 for result in block.results]),
            "device_start_s": np.array([revolution.start_s for revolution in block.revolutions]),
            "device_end_s": np.array([revolution.start_s + revolution.period_s for revolution in block.revolutions]),
            "radius_m": np.array([conditions.radius_m for conditions in block.conditions]),
            "shared_std": np.array([relative_errors(conditions) for conditions in block.conditions]),
        }
        columns = {name: np.repeat(cells, count, axis=0) for name, cells in of_revolution.items()} | {
            "wheel": self._coded([block.position] * (rows * count)),
            "name": self._coded(list(block.names) * rows),
            "status": self._coded(map(str, block.status)),
            "reasons": self._coded(map(joined, block.reasons)),
            "value": block.value.ravel(),
            "std": block.std.ravel(),
            "constant_std": block.constant_std.ravel(),
            "scatter_std": block.scatter_std.ravel(),
        }
        for name, cells in columns.items():
            self._columns.setdefault(name, []).append(cells)

    def table(self, recording: str) -> Estimates:
        """Return the table."""
        words = text_array(list(self._codes))
        units = text_array(list(map(unit_of, self._codes)))
        columns = {name: np.concatenate(blocks) for name, blocks in self._columns.items()}
        if not columns:
            empty = Estimates.of_rows([], recording=recording)
            return replace(empty, shared_std=np.empty((0, len(CAUSES))))
        texts = {name: words[columns[name]] for name in ("wheel", "name", "status", "reasons")}
        return Estimates(recording=recording, unit=units[columns["name"]], **(columns | texts))

    def _coded(self, words: Iterable[str]) -> NDArray[np.int64]:
        codes = self._codes
        return np.array([codes.setdefault(word, len(codes)) for word in words], np.int64)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Alarms(ColumnTable):
    """Alarms over a whole recording, one row per alarm; times count from its beginning."""

    _rows: ClassVar[str] = "alarms"

    subject: TextArray = field(metadata=column("position of the wheel, or name of the link"))
    name: TextArray = field(metadata=column("kind of the alarm"))
    reason: TextArray = field(metadata=column("what was wrong, as last seen"))
    count: IndexArray = field(metadata=column("how often it was raised"))
    first_s: FloatArray = field(metadata=column("first raising"))
    last_s: FloatArray = field(metadata=column("last time at which it stood"))
    total_s: FloatArray = field(metadata=column("time for which it stood"))
    standing: BoolArray = field(metadata=column("whether it stood at the end"))

    @classmethod
    def of(cls, records: Iterable[AlarmRecord], *, recording: str) -> Self:
        """Return the table of alarm records."""
        rows = (
            (
                record.position,
                str(record.name),
                text(record.reason),
                record.count,
                record.first_s,
                record.last_s,
                record.total_s,
                record.is_standing,
            )
            for record in records
        )
        return cls.of_rows(rows, recording=recording)
