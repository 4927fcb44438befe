"""Two recordings side by side: conditions, means and their differences, for a terminal and as CSV."""

import io
from collections.abc import Iterator, Sequence
from typing import Final

from gateway.compare.mean_comparison import FALSE_ALARM, MeanDifference, Radius
from gateway.compare.views.drive import Drive
from gateway.compare.views.wheel_glance import GLANCE
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.weighted_mean import MeanEstimate
from gateway.core.quantity_catalogue import unit_of
from gateway.core.reasons import Reason
from gateway.core.shown_units import shown_in
from gateway.core.text.aligned_table import WIDEST, table_lines
from gateway.core.text.numbers import finite_or_none, fixed, plain_name, round_to_error, split_name
from gateway.core.text.readout import DISTANCE
from gateway.core.text.table_sinks import CsvSink
from gateway.core.text.text import clean, counted
from gateway.core.text.wording import joined, text

_CSV_COLUMNS: Final = (
    "wheel", "quantity", "unit", "first", "first_std", "first_count", "second", "second_std", "second_count",
    "difference", "difference_std", "significance", "is_significant", "first_reason", "second_reason",
)  # fmt: skip


def means_of(drive: Drive) -> dict[tuple[str, str], MeanEstimate]:
    """Return the means over valid revolutions by wheel and quantity, without the distance, which only grows."""
    return {
        (position, name): mean
        for position, wheel in drive.wheels.items()
        for name, mean in {**wheel.row.means(), **drive.rig_means(position)}.items()
        if name != DISTANCE
    }


def radii_of(drive: Drive) -> dict[str, Radius]:
    """Return the belt radius of each wheel, as it was at the end."""
    conditions = {position: wheel.row.conditions for position, wheel in drive.wheels.items()}
    return {position: Radius.of(last) for position, last in conditions.items() if last is not None}


def comparison_lines(
    first: Drive, second: Drive, differences: Sequence[MeanDifference], columns: int = WIDEST
) -> list[str]:
    """Return the lines of a comparison, wheel by wheel, for a terminal of some columns."""
    with shown_in(second.units):
        return list(_lines(first, second, differences, columns))


def _lines(first: Drive, second: Drive, differences: Sequence[MeanDifference], columns: int) -> Iterator[str]:
    for wheel in shared_wheels(first, second):
        cells = [drive.wheels[wheel].cells() for drive in (first, second)]
        rows: list[tuple[str, ...]] = [(wheel, clean(first.name), clean(second.name), "difference", "in errors")]
        rows += [(label, *(cell_text(values) for values in cells), "", "") for label, cell_text in GLANCE]
        rows += [(_label(row.name), *difference_cells(row)) for row in differences if row.wheel == wheel]
        yield from table_lines(rows, columns)
        yield ""
    if varying := varying_line(differences):
        yield f"~ {varying}"
    significant = sum(difference.is_significant for difference in differences)
    yield (
        f"{significant} of {counted(len(differences), 'difference')} marked * are significant: were there none, chance "
        f"would mark any of them with a probability of {100.0 * FALSE_ALARM:.0f} %"
    )


def shared_wheels(first: Drive, second: Drive) -> list[str]:
    """Return the wheels that both recordings have, in the order of the first."""
    return [position for position in first.wheels if position in second.wheels]


def varying_line(differences: Sequence[MeanDifference]) -> str:
    """Return what varied by far more than its errors and why its mean says little, empty without any."""
    varying = dict.fromkeys(plain_name(row.name) for row in differences if row.first.reasons or row.second.reasons)
    return f"{', '.join(varying)}: {text(Reason(EstimateCode.ROW_SCATTERS))}" if varying else ""


def _label(name: str) -> str:
    symbol = split_name(name)[1].symbol
    return f"{plain_name(name)}, {symbol}" if symbol else plain_name(name)


def difference_cells(compared: MeanDifference) -> tuple[str, str, str, str]:
    """Return first mean, second mean, difference and its significance as text, without their unit."""
    unit = split_name(compared.name)[1]
    means = [
        round_to_error(unit.of(mean.value), mean.std * unit.factor).joined() + " ~" * bool(mean.reasons)
        for mean in (compared.first, compared.second)
    ]
    difference = round_to_error(compared.difference * unit.factor, compared.std * unit.factor).joined()
    return means[0], means[1], difference, fixed(compared.significance, 1) + (" *" if compared.is_significant else "  ")


def comparison_csv(differences: Sequence[MeanDifference]) -> bytes:
    """Return the differences as CSV, in SI units, one row for each wheel and quantity; unknown is empty."""
    buffer = io.BytesIO()
    sink = CsvSink(buffer)
    sink.header(_CSV_COLUMNS)
    for compared in differences:
        first, second = compared.first, compared.second
        numbers = (compared.difference, compared.std, compared.significance)
        sink.row(
            [
                *(compared.wheel, compared.name, unit_of(compared.name)),
                *(
                    first.value,
                    finite_or_none(first.std),
                    first.count,
                    second.value,
                    finite_or_none(second.std),
                    second.count,
                ),
                *(*map(finite_or_none, numbers), compared.is_significant),
                *(joined(first.reasons), joined(second.reasons)),
            ]
        )
    return buffer.getvalue()
