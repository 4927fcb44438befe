"""Table of the differences between two recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Self

from gateway.api.column_table import ColumnTable, IndexArray, TextArray, column, unit_of
from gateway.compare.mean_comparison import MeanDifference
from gateway.core.text.wording import joined
from gateway.core.types import BoolArray, FloatArray


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
    count: IndexArray = field(metadata=column("revolutions in the mean"))
    other_value: FloatArray = field(metadata=column("mean over the valid revolutions of the other recording"))
    other_std: FloatArray = field(metadata=column("one standard error of that mean"))
    other_count: IndexArray = field(metadata=column("revolutions in that mean"))
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
        rows = (
            (
                row.wheel,
                row.name,
                unit_of(row.name),
                *(row.first.value, row.first.std, row.first.count),
                *(row.second.value, row.second.std, row.second.count),
                *(row.difference, row.std, row.significance, row.is_significant),
                joined(row.first.reasons),
                joined(row.second.reasons),
            )
            for row in differences
        )
        return cls.of_rows(rows, recording=recording, other_recording=other_recording)

    def _title(self) -> str:
        return f"{len(self)} differences of {self.other_recording} from {self.recording}"
