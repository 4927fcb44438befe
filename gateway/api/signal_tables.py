"""Tables of one wheel's signals: samples, revolutions, waveforms in angle, their average and their orders."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from gateway.api.column_table import ColumnTable, IndexArray, TextArray, TimeArray, column, require_pandas, utc_array
from gateway.core.constants import AXIS_NAMES
from gateway.core.estimates.estimator import Revolution
from gateway.core.estimates.results import RevolutionResult
from gateway.core.optional_packages import require_packages
from gateway.core.revolutions.angle_resampling import GRID_SIZE, angle_grid
from gateway.core.revolutions.order_spectrum import ORDER_COUNT, order_coefficients
from gateway.core.table_columns import AVERAGE_COLUMNS, SAMPLE_COLUMNS, Column
from gateway.core.text.wording import joined
from gateway.core.types import BoolArray, ComplexArray, FloatArray
from gateway.exporting.mean_revolution import MeanOfRevolutions, MeanRevolution
from gateway.exporting.recorded_signals import EnvironmentReading, SignalBlock

if TYPE_CHECKING:
    import pandas as pd
    import xarray


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Samples(ColumnTable):
    """Acceleration of one wheel, sample by sample.

    The axes turn with the sensor: circumferential is positive in the direction in which it travels, lateral to the left
    of the vehicle, radial toward the wheel centre. Scale and zero are those that the sensor states. An axis that the
    sensor lacks is NaN, a computer's time that is not known NaT.

    Attributes:
        wheel: position.
        rate_hz: sampling rate measured against the hub's clock.
        ac_coupled: whether the sensor passes no steady value.
    """

    _rows: ClassVar[str] = "samples"
    _shared: ClassVar[Mapping[str, Column]] = SAMPLE_COLUMNS

    wheel: str
    rate_hz: float
    ac_coupled: bool
    device_s: FloatArray = field(metadata=column())
    host_utc: TimeArray = field(metadata=column())
    circumferential_mps2: FloatArray = field(metadata=column())
    lateral_mps2: FloatArray = field(metadata=column())
    radial_mps2: FloatArray = field(metadata=column())
    saturated: BoolArray = field(metadata=column())
    lost_before: IndexArray = field(metadata=column())
    number: IndexArray = field(metadata=column())
    segment: IndexArray = field(metadata=column())

    @property
    def axes_mps2(self) -> FloatArray:
        """The three axes together, (n, 3)."""
        return np.stack((self.circumferential_mps2, self.lateral_mps2, self.radial_mps2), axis=1)

    @property
    def gaps(self) -> list[tuple[float, int]]:
        """Gaps as (device time in s of the first sample after it, number of samples lost)."""
        rows = np.flatnonzero(self.lost_before)
        return list(zip(self.device_s[rows].tolist(), self.lost_before[rows].tolist(), strict=True))

    def _title(self) -> str:
        lost, saturated = int(self.lost_before.sum()), int(self.saturated.sum())
        duration_s = len(self) / self.rate_hz if self.rate_hz else 0.0
        return (
            f"{len(self)} samples of {self.wheel}, {duration_s:.2f} s at {self.rate_hz:.1f} Hz, {lost} lost, "
            f"{saturated} saturated"
        )

    @classmethod
    def of(cls, blocks: Iterable[SignalBlock], *, recording: str, wheel: str, start_s: float, stop_s: float) -> Self:
        """Return the samples from device time `start_s` to `stop_s` of the blocks of one wheel."""
        parts: list[tuple[SignalBlock, slice]] = []
        for block in blocks:
            first, end = np.searchsorted(block.hub_time_s, (start_s, stop_s)).tolist()
            if first < end:
                parts.append((block, slice(first, end)))
        sizes = np.array([part.stop - part.start for _, part in parts], np.int64)
        lost = np.zeros(sizes.sum(), np.int64)
        lost[np.cumsum(sizes) - sizes] = [block.lost_before if part.start == 0 else 0 for block, part in parts]
        axes = np.empty((3, len(lost)))
        np.concatenate([np.empty((3, 0)), *(block.axes_mps2[part].T for block, part in parts)], axis=1, out=axes)
        last = parts[-1][0] if parts else None

        def joined_parts(kind: type, values: Iterable[NDArray[Any]]) -> NDArray[Any]:
            return np.concatenate([np.zeros(0, kind), *values])

        return cls(
            recording=recording,
            wheel=wheel,
            rate_hz=math.nan if last is None else last.rate_hz,
            ac_coupled=last is not None and last.ac_coupled,
            device_s=joined_parts(np.float64, (block.hub_time_s[part] for block, part in parts)),
            host_utc=utc_array(joined_parts(np.int64, (block.host_time_ns[part] for block, part in parts))),
            circumferential_mps2=axes[0],
            lateral_mps2=axes[1],
            radial_mps2=axes[2],
            saturated=joined_parts(np.bool_, (block.saturated[part] for block, part in parts)),
            lost_before=lost,
            number=joined_parts(
                np.int64, (block.first_sample + np.arange(part.start, part.stop) for block, part in parts)
            ),
            segment=np.repeat(np.array([block.segment for block, _ in parts], np.int64), sizes),
        )


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Environment(ColumnTable):
    """Pressure and temperature in the tire of one wheel.

    Attributes:
        wheel: position.
    """

    _rows: ClassVar[str] = "readings"
    _shared: ClassVar[Mapping[str, Column]] = SAMPLE_COLUMNS

    wheel: str
    device_s: FloatArray = field(metadata=column())
    host_utc: TimeArray = field(metadata=column())
    pressure_pa: FloatArray = field(metadata=column("inflation pressure above ambient (gauge); NaN when not measured"))
    temperature_degc: FloatArray = field(metadata=column("temperature of the inner liner; NaN when not measured"))
    supply_v: FloatArray = field(metadata=column("supply of the sensor; NaN when not measured"))

    def _title(self) -> str:
        return f"{len(self)} readings of {self.wheel}"

    @classmethod
    def of(cls, readings: Iterable[EnvironmentReading], *, recording: str, wheel: str) -> Self:
        """Return the readings of one wheel."""
        rows = (
            (
                reading.hub_time_s,
                reading.host_time_ns,
                reading.pressure_pa,
                reading.temperature_degc,
                reading.supply_v,
            )
            for reading in readings
        )
        return cls.of_rows(rows, recording=recording, wheel=wheel)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Revolutions(ColumnTable):
    """Revolutions of one wheel: times, speed, contact and conditions, one row each.

    Attributes:
        wheel: position.
    """

    _rows: ClassVar[str] = "revolutions"

    wheel: str
    revolution: IndexArray = field(metadata=column())
    device_start_s: FloatArray = field(metadata=column())
    device_end_s: FloatArray = field(metadata=column())
    host_utc: TimeArray = field(metadata=column())
    speed_mps: FloatArray = field(metadata=column())
    omega_radps: FloatArray = field(metadata=column())
    omega_dot_radps2: FloatArray = field(metadata=column())
    leading_edge_rad: FloatArray = field(metadata=column())
    leading_edge_std_rad: FloatArray = field(metadata=column())
    trailing_edge_rad: FloatArray = field(metadata=column())
    trailing_edge_std_rad: FloatArray = field(metadata=column())
    noise_mps2: FloatArray = field(metadata=column())
    rate_hz: FloatArray = field(metadata=column())
    radius_m: FloatArray = field(metadata=column())
    load_n: FloatArray = field(metadata=column())
    pressure_pa: FloatArray = field(metadata=column())
    temperature_degc: FloatArray = field(metadata=column())
    missing_fraction: FloatArray = field(metadata=column())
    saturated: BoolArray = field(metadata=column())
    usable: BoolArray = field(metadata=column())
    faults: TextArray = field(metadata=column())

    def _title(self) -> str:
        if not len(self):
            return f"no revolution of {self.wheel}"
        kmh = self.speed_mps * 3.6
        return (
            f"{len(self)} revolutions of {self.wheel}, {int(self.usable.sum())} usable, "
            f"{kmh.min():.1f} to {kmh.max():.1f} km/h"
        )

    @classmethod
    def of(cls, results: Iterable[RevolutionResult], *, recording: str, wheel: str, has_host_time: bool) -> Self:
        """Return the table of results of one wheel."""
        rows = (_revolution_row(result, has_host_time) for result in results)
        return cls.of_rows(rows, recording=recording, wheel=wheel)


def _revolution_row(result: RevolutionResult, has_host_time: bool) -> tuple[Any, ...]:
    """Return the cells of a revolution in the order of the columns of `Revolutions`."""
    revolution, conditions = result.revolution, result.conditions
    return (
        revolution.index,
        revolution.start_s,
        revolution.start_s + revolution.period_s,
        result.host_ns if has_host_time else 0,
        revolution.omega_radps * conditions.radius_m,
        revolution.omega_radps,
        revolution.omega_dot_radps2,
        revolution.leading_edge_rad,
        revolution.leading_edge_std_rad,
        revolution.trailing_edge_rad,
        revolution.trailing_edge_std_rad,
        revolution.noise_mps2,
        revolution.rate_hz,
        conditions.radius_m,
        conditions.load_n,
        conditions.pressure_pa,
        conditions.temperature_degc,
        revolution.missing_fraction,
        bool(revolution.saturated),
        not revolution.faults,
        joined(revolution.faults),
    )


def _columns_of_each(revolutions: Sequence[Revolution]) -> dict[str, Any]:
    """Return the columns that tables of waveforms share."""
    return {
        "revolution": np.array([revolution.index for revolution in revolutions], np.int64),
        "device_start_s": np.array([revolution.start_s for revolution in revolutions], np.float64),
        "omega_radps": np.array([revolution.omega_radps for revolution in revolutions], np.float64),
        "usable": np.array([not revolution.faults for revolution in revolutions], np.bool_),
    }


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class AngleWaveforms(ColumnTable):
    """Acceleration of one wheel in the angle domain: one row per revolution, one value per angle.

    The angle is 0 at the contact centre; the sensor enters the contact at negative and leaves it at positive angles.
    Angles from 0 on come from the first half of the revolution, negative ones from its second half. Axes are
    (n, m), one row per revolution.

    Attributes:
        wheel: position.
        angle_rad: (m,) angles of the columns, from -pi on in equal steps.
    """

    _rows: ClassVar[str] = "revolutions"

    wheel: str
    angle_rad: FloatArray
    revolution: IndexArray = field(metadata=column())
    device_start_s: FloatArray = field(metadata=column())
    omega_radps: FloatArray = field(metadata=column())
    usable: BoolArray = field(metadata=column())
    circumferential_mps2: FloatArray = field(metadata=column())
    lateral_mps2: FloatArray = field(metadata=column())
    radial_mps2: FloatArray = field(metadata=column())
    normalised_mps2: FloatArray = field(metadata=column())

    def _title(self) -> str:
        return f"{len(self)} revolutions of {self.wheel} at {len(self.angle_rad)} angles"

    def to_pandas(self, axis: str = "radial") -> pd.DataFrame:
        """Return one axis as a DataFrame: rows are revolutions, columns are angles in rad.

        Args:
            axis: `circumferential`, `lateral`, `radial` or `normalised`.

        Raises:
            ValueError: another axis.
            OutputError: pandas is not installed.
        """
        name = f"{axis}_mps2"
        if name not in ("normalised_mps2", *(f"{axis_name}_mps2" for axis_name in AXIS_NAMES)):
            raise ValueError(f"there is no axis '{axis}': choose {', '.join(AXIS_NAMES)} or normalised")
        pandas = require_pandas()
        frame: pd.DataFrame = pandas.DataFrame(
            self[name],
            index=pandas.Index(self.revolution, name="revolution"),
            columns=pandas.Index(self.angle_rad, name="angle_rad"),
        )
        frame.attrs.update({"unit": "m/s^2", "axis": axis, **self.metadata})
        return frame

    def to_xarray(self) -> xarray.DataArray:
        """Return the waveforms as a DataArray of (revolution, axis, angle_rad) in m/s^2.

        Number, start, speed and usability of a revolution are coordinates; the axis `normalised` is the radial one
        without gravity, at the mean speed.

        Raises:
            OutputError: xarray is not installed.
        """
        require_packages("the array of waveforms", "xarray", "xarray")
        import xarray

        axes = (*AXIS_NAMES, "normalised")
        of_revolution = ("device_start_s", "omega_radps", "usable")
        return xarray.DataArray(
            np.stack([self[f"{axis}_mps2"] for axis in axes], axis=1),
            dims=("revolution", "axis", "angle_rad"),
            coords={
                "revolution": self.revolution,
                "axis": list(axes),
                "angle_rad": ("angle_rad", self.angle_rad, {"units": "rad", "long_name": "angle of the sensor"}),
                **{name: ("revolution", self[name], {"units": self.units[name]}) for name in of_revolution},
            },
            name="specific_force",
            attrs={"units": "m/s^2", **self.metadata},
        )

    @classmethod
    def of(cls, results: Iterable[RevolutionResult], *, recording: str, wheel: str) -> Self:
        """Return the waveforms of results of one wheel."""
        revolutions = [result.revolution for result in results]
        axes = np.empty((3, len(revolutions), GRID_SIZE))
        normalised = np.empty((len(revolutions), GRID_SIZE))
        for row, revolution in enumerate(revolutions):
            axes[:, row] = revolution.axes_mps2
            normalised[row] = revolution.radial_mps2
        return cls(
            recording=recording,
            wheel=wheel,
            angle_rad=angle_grid(),
            **_columns_of_each(revolutions),
            circumferential_mps2=axes[0],
            lateral_mps2=axes[1],
            radial_mps2=axes[2],
            normalised_mps2=normalised,
        )


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class AverageWaveform(ColumnTable):
    """Time synchronous average of one wheel's usable revolutions, one row per angle, with the scatter between them.

    The axes are averaged as measured. The normalised radial axis is scaled to the mean speed first, revolution by
    revolution. Over a range of speeds its scatter stays that of the tire, while that of the axes contains the change
    with speed.

    Attributes:
        wheel: position.
        count: number of revolutions.
        omega_radps: mean angular speed.
        omega_std_radps: its standard deviation.
        leading_edge_rad: mean leading contact edge.
        leading_edge_std_rad: its standard error.
        trailing_edge_rad: mean trailing contact edge.
        trailing_edge_std_rad: its standard error.
        orders_mps2: (61,) complex coefficients c - i s of the normalised radial axis.
        orders_std_mps2: (61,) standard error of each real coefficient.
    """

    _rows: ClassVar[str] = "angles"
    _shared: ClassVar[Mapping[str, Column]] = AVERAGE_COLUMNS

    wheel: str
    count: int
    omega_radps: float
    omega_std_radps: float
    leading_edge_rad: float
    leading_edge_std_rad: float
    trailing_edge_rad: float
    trailing_edge_std_rad: float
    orders_mps2: ComplexArray
    orders_std_mps2: FloatArray
    angle_rad: FloatArray = field(metadata=column())
    circumferential_mps2: FloatArray = field(metadata=column())
    circumferential_scatter_mps2: FloatArray = field(metadata=column())
    lateral_mps2: FloatArray = field(metadata=column())
    lateral_scatter_mps2: FloatArray = field(metadata=column())
    radial_mps2: FloatArray = field(metadata=column())
    radial_scatter_mps2: FloatArray = field(metadata=column())
    normalised_mps2: FloatArray = field(metadata=column())
    normalised_scatter_mps2: FloatArray = field(metadata=column())

    def _title(self) -> str:
        return f"average of {self.count} revolutions of {self.wheel} at {self.omega_radps:.2f} rad/s"

    @classmethod
    def of(cls, results: Iterable[RevolutionResult], *, recording: str, wheel: str) -> Self | None:
        """Return the average of the usable results of one wheel; None when there is none."""
        total = MeanOfRevolutions()
        for result in results:
            if not result.revolution.faults:
                total.add(result.revolution)
        mean = total.mean()
        return cls(recording=recording, wheel=wheel, **_average_columns(mean)) if mean is not None else None


def _average_columns(mean: MeanRevolution) -> dict[str, Any]:
    radial = mean.radial
    return {
        "count": mean.count,
        "omega_radps": mean.omega_radps,
        "omega_std_radps": mean.omega_std_radps,
        "leading_edge_rad": radial.leading_edge_rad,
        "leading_edge_std_rad": radial.leading_edge_std_rad,
        "trailing_edge_rad": radial.trailing_edge_rad,
        "trailing_edge_std_rad": radial.trailing_edge_std_rad,
        "orders_mps2": radial.orders_mps2,
        "orders_std_mps2": radial.orders_std_mps2,
        **mean.curves(),
    }


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class OrderSpectra(ColumnTable):
    """Order spectrum of one axis of one wheel, one row per revolution.

    Order n repeats n times per revolution. Its coefficient is the complex number c - i s of c cos(n angle) + s sin(n
    angle); order 0 is the mean. Orders that the sampling rate does not carry are NaN.

    Attributes:
        wheel: position.
        axis: `circumferential`, `lateral`, `radial` or `normalised`.
        order: (61,) orders 0 to 60.
    """

    _rows: ClassVar[str] = "revolutions"

    wheel: str
    axis: str
    order: IndexArray
    revolution: IndexArray = field(metadata=column())
    device_start_s: FloatArray = field(metadata=column())
    omega_radps: FloatArray = field(metadata=column())
    usable: BoolArray = field(metadata=column())
    order_max: IndexArray = field(metadata=column())
    orders_mps2: ComplexArray = field(metadata=column("coefficients c - i s, (n, 61) complex"))

    @property
    def amplitude_mps2(self) -> FloatArray:
        """Amplitude of every order, (n, 61)."""
        return np.abs(self.orders_mps2)

    @property
    def frequency_hz(self) -> FloatArray:
        """Frequency of every order, (n, 61)."""
        result: FloatArray = np.outer(self.omega_radps, self.order) / (2.0 * math.pi)
        return result

    def _title(self) -> str:
        return f"orders 0 to {int(self.order[-1])} of {len(self)} revolutions of {self.wheel}, {self.axis} axis"

    def to_pandas(self) -> pd.DataFrame:
        """Return the complex coefficients as a DataFrame: rows are revolutions, columns are orders.

        Raises:
            OutputError: pandas is not installed.
        """
        pandas = require_pandas()
        frame: pd.DataFrame = pandas.DataFrame(
            self.orders_mps2,
            index=pandas.Index(self.revolution, name="revolution"),
            columns=pandas.Index(self.order, name="order"),
        )
        frame.attrs.update({"unit": "m/s^2", **self.metadata})
        return frame

    @classmethod
    def of(cls, results: Iterable[RevolutionResult], *, recording: str, wheel: str, axis: str) -> Self:
        """Return the orders of results of one wheel."""
        revolutions = [result.revolution for result in results]
        orders = np.empty((len(revolutions), ORDER_COUNT), np.complex128)
        for row, revolution in enumerate(revolutions):
            orders[row] = (
                revolution.orders_mps2
                if axis == "normalised"
                else order_coefficients(revolution.axes_mps2[AXIS_NAMES.index(axis)], revolution.order_max)
            )
        return cls(
            recording=recording,
            wheel=wheel,
            axis=axis,
            order=np.arange(ORDER_COUNT),
            **_columns_of_each(revolutions),
            order_max=np.array([revolution.order_max for revolution in revolutions], np.int64),
            orders_mps2=orders,
        )
