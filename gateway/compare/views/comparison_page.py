"""Two recordings as one self-contained HTML page: what differs, what else differs, both over time, all means."""

from collections.abc import Iterator, Sequence
from typing import Any, Final

from gateway.compare.mean_comparison import FALSE_ALARM, MeanDifference
from gateway.compare.views.drive import Drive
from gateway.compare.views.drive_comparison import difference_cells, shared_wheels, varying_line
from gateway.compare.views.drive_page import page_over_time
from gateway.compare.views.drive_pictures import begin_ns, pictures_json
from gateway.compare.views.wheel_glance import GLANCE, number
from gateway.core.text.html_template import script_data
from gateway.core.text.numbers import plain_name, round_to_error, split_name
from gateway.core.text.text import clean, counted

_MOST_NAMED: Final = 3
# What the tire's numbers rest on, and by which share of it conditions are not alike; of temperatures by kelvin.
_CONDITIONS: Final = (
    ("load, stated", "load_n", 0.01), ("pressure", "pressure_pa", 0.01), ("speed", "speed_mean_mps", 0.05),
    ("temperature", "temperature_degc", 5.0),
)  # fmt: skip


def comparison_page(first: Drive, second: Drive, differences: Sequence[MeanDifference]) -> str:
    """Return a comparison as an HTML page without external resources; errors as for `result_page`."""
    wheels = shared_wheels(first, second)
    return page_over_time(
        "comparison_page.html.j2",
        title=f"{clean(second.name)} compared with {clean(first.name)}",
        facts=f"{clean(first.name)} · {clean(second.name)} · {', '.join(map(clean, wheels))}",
        answer=" ".join(_answer(differences)),
        steps=list(_steps(first, second, wheels)),
        data=script_data(_pictures(first, second)),
        names=[first.name, second.name],
        wheels=[(wheel, _glance(first, second, wheel), _rows(differences, wheel)) for wheel in wheels],
        varying=varying_line(differences),
        runs=[(drive.name, drive.run) for drive in (first, second) if drive.run],
        chance=f"{100.0 * FALSE_ALARM:.0f} %",
    )


def _answer(differences: Sequence[MeanDifference]) -> Iterator[str]:
    """Yield the summary: how much differs, and the largest differences, one of each quantity."""
    significant = sorted(
        (row for row in differences if row.is_significant), key=lambda row: abs(row.significance), reverse=True
    )
    if not significant:
        yield f"None of {counted(len(differences), 'difference')} is more than chance makes."
        return
    yield f"{len(significant)} of {counted(len(differences), 'difference')} are more than chance makes."
    largest = {row.name: row for row in reversed(significant)}
    named = [row for row in significant if largest[row.name] is row][:_MOST_NAMED]
    yield f"The clearest: {'; '.join(map(_said, named))}."


def _said(row: MeanDifference) -> str:
    """Return one difference in words; in percent where the quantity has no unit."""
    unit = split_name(row.name)[1]
    factor, symbol = unit.factor, unit.symbol
    if not symbol and row.first.value:
        factor, symbol = 100.0 / abs(row.first.value), "%"
    size = round_to_error(abs(row.difference) * factor, row.std * factor).joined()
    words = "higher" if row.difference > 0.0 else "lower"
    return f"{clean(row.wheel)} {plain_name(row.name)} {words} by {size} {symbol}"


def _steps(first: Drive, second: Drive, wheels: Sequence[str]) -> Iterator[dict[str, str]]:
    """Yield what else was not alike: a difference may come from it."""
    for label, name, share in _CONDITIONS:
        unit = split_name("speed_mps" if name == "speed_mean_mps" else name)[1]
        unlike = []
        for wheel in wheels:
            before, after = (number(drive.wheels[wheel].cells(), name) for drive in (first, second))
            scale = 1.0 if name == "temperature_degc" else abs(before)
            if abs(after - before) > share * scale:
                values = (f"{value * unit.factor:.4g}" for value in (before, after))
                unlike.append(f"{clean(wheel)} {' and '.join(values)} {unit.symbol}")
        if unlike:
            said = (
                f"not alike: {', '.join(unlike)}. What rests on it differs with it: record again with the same {label}"
            )
            yield {"about": label, "step": said}


def _pictures(first: Drive, second: Drive) -> dict[str, Any]:
    """Return the pictures of both recordings over the time since the first revolution of each."""
    parts = [pictures_json(drive, (), begin_ns(drive)) for drive in (first, second)]
    count = len(parts[0]["wheels"])
    rows = [{quantity["name"]: quantity for quantity in part["quantities"]} for part in parts]
    absent = [{"wheels": [None] * len(part["wheels"])} for part in parts]
    quantities = [
        {**quantity, "wheels": [*rows[0].get(name, absent[0])["wheels"], *rows[1].get(name, absent[1])["wheels"]]}
        for name, quantity in {**rows[0], **rows[1]}.items()
    ]
    return {
        **parts[0],
        "begin_ms": None,
        "wheels": [
            {**wheel, "name": f"{wheel['name']} {drive.name}"}
            for drive, part in zip((first, second), parts, strict=True)
            for wheel in part["wheels"]
        ],
        "quantities": quantities,
        "first": list(dict.fromkeys(name for part in parts for name in part["first"])),
        "waveforms": [
            {**waveform, "wheel": waveform["wheel"] + index * count}
            for index, part in enumerate(parts)
            for waveform in part["waveforms"]
        ],
    }


def _glance(first: Drive, second: Drive, wheel: str) -> list[tuple[str, list[str]]]:
    cells = [drive.wheels[wheel].cells() for drive in (first, second)]
    return [(label, [shown(values) for values in cells]) for label, shown in GLANCE]


def _rows(differences: Sequence[MeanDifference], wheel: str) -> list[tuple[str, str, tuple[str, ...], bool]]:
    """Return name, unit and cells of each quantity of a wheel, and whether the difference is significant."""
    return [
        (plain_name(row.name), split_name(row.name)[1].symbol, difference_cells(row), row.is_significant)
        for row in differences
        if row.wheel == wheel
    ]
