"""Table of the differences between two recordings."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from gateway.api.column_table import ColumnTable, TextArray, column, text_array, unit_of
from gateway.estimators.mean_comparison import MeanDifference
from gateway.types import BoolArray, FloatArray
from gateway.views.wording import joined


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Comparison(ColumnTable):
    """Means of two recordings and their differences, one row per wheel and quantity, in SI units.

    Attributes:
        other_recording: name of the recording that is compared.
    """

    _rows: ClassVar[str] = "differences"

    other_recording: str
    wheel: TextArray = field(metadata=column("position"))
    name: TextArray = field(metadata=column("quantity, with its unit"))
    unit: TextArray = field(metadata=column("of the values; empty without one"))
    value: FloatArray = field(metadata=column("mean over the valid revolutions of this recording"))
    std: FloatArray = field(metadata=column("one standard error of the mean"))
    count: NDArray[np.int64] = field(metadata=column("revolutions in the mean"))
    other_value: FloatArray = field(metadata=column("mean over the valid revolutions of the other recording"))
    other_std: FloatArray = field(metadata=column("one standard error of that mean"))
    other_count: NDArray[np.int64] = field(metadata=column("revolutions in that mean"))
    difference: FloatArray = field(metadata=column("other mean less that of this recording"))
    difference_std: FloatArray = field(metadata=column("one standard error of the difference; NaN when not known"))
    significance: FloatArray = field(metadata=column("difference over its standard error"))
    is_significant: BoolArray = field(
        metadata=column("whether chance marks any of the rows with a probability of 1 % at most")
    )

    reasons: TextArray = field(metadata=column("what is to be known of the mean, such as that the quantity varies"))
    other_reasons: TextArray = field(metadata=column("what is to be known of the other mean"))

    @classmethod
    def of(cls, differences: Sequence[MeanDifference], *, recording: str, other_recording: str) -> Self:
        """Return the table of differences."""

        def numbers(values: Sequence[float]) -> Any:
            return np.array(values, np.float64)

        return cls(
            recording=recording,
            other_recording=other_recording,
            wheel=text_array([row.wheel for row in differences]),
            name=text_array([row.name for row in differences]),
            unit=text_array([unit_of(row.name) for row in differences]),
            value=numbers([row.first.value for row in differences]),
            std=numbers([row.first.std for row in differences]),
            count=np.array([row.first.count for row in differences], np.int64),
            other_value=numbers([row.second.value for row in differences]),
            other_std=numbers([row.second.std for row in differences]),
            other_count=np.array([row.second.count for row in differences], np.int64),
            difference=numbers([row.difference for row in differences]),
            difference_std=numbers([row.std for row in differences]),
            significance=numbers([row.significance for row in differences]),
            is_significant=np.array([row.is_significant for row in differences], np.bool_),
            reasons=text_array([joined(row.first.reasons) for row in differences]),
            other_reasons=text_array([joined(row.second.reasons) for row in differences]),
        )

    def _title(self) -> str:
        return f"{len(self)} differences of {self.other_recording} from {self.recording}"
