"""Two recordings as one self-contained HTML page: what differs, what else differs, both over time, all means."""

from collections.abc import Sequence
from typing import Any, Final

from gateway.compare.mean_comparison import FALSE_ALARM, MeanDifference
from gateway.compare.views.comparison_verdict import comparison_verdict
from gateway.compare.views.drive import Drive
from gateway.compare.views.drive_comparison import difference_cells, shared_wheels, varying_line
from gateway.compare.views.drive_page import page_over_time, recorded_at
from gateway.compare.views.drive_pictures import first_ns, pictures_json
from gateway.compare.views.wheel_glance import GLANCE
from gateway.core.shown_units import shown_in
from gateway.core.text.html_template import script_data
from gateway.core.text.numbers import plain_name, split_name
from gateway.core.text.text import clean

_ORDER: Final = ("First", "second")


def comparison_page(first: Drive, second: Drive, differences: Sequence[MeanDifference]) -> str:
    """Return a comparison as an HTML page without external resources; errors as for `result_page`."""
    with shown_in(second.units):
        return _page(first, second, differences)


def _page(first: Drive, second: Drive, differences: Sequence[MeanDifference]) -> str:
    wheels = shared_wheels(first, second)
    verdict = comparison_verdict(first, second, wheels, differences)
    recordings = [(drive.name, recorded_at(drive)) for drive in (first, second)]
    return page_over_time(
        "comparison_page.html.j2",
        title=f"{clean(second.name)} compared with {clean(first.name)}",
        facts=" · ".join(
            f"{order}: {clean(name)}, {date}" for order, (name, date) in zip(_ORDER, recordings, strict=True)
        ),
        answer=verdict.answer,
        lines=verdict.lines,
        steps=verdict.steps,
        data=script_data(_pictures(first, second, wheels, verdict.wheel)),
        recordings=recordings,
        wheels=[(wheel, _glance(first, second, wheel), _rows(differences, wheel)) for wheel in wheels],
        varying=varying_line(differences),
        runs=[(drive.name, drive.run) for drive in (first, second) if drive.run],
        chance=f"{100.0 * FALSE_ALARM:.0f} %",
    )


def _pictures(first: Drive, second: Drive, wheels: Sequence[str], chosen: str) -> dict[str, Any]:
    """Return the pictures of both recordings over the time since the first revolution of each, a wheel at a time."""
    parts = [pictures_json(drive, (), first_ns(drive)) for drive in (first, second)]
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
            {**wheel, "name": f"{wheel['name']} {drive.name}", "style": index}
            for index, (drive, part) in enumerate(zip((first, second), parts, strict=True))
            for wheel in part["wheels"]
        ],
        "choices": [
            {"name": wheel, "wheels": [list(first.wheels).index(wheel), count + list(second.wheels).index(wheel)]}
            for wheel in wheels
        ],
        "chosen": wheels.index(chosen) if chosen in wheels else 0,
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
    return [(label, [cell_text(values) for values in cells]) for label, cell_text in GLANCE]


def _rows(differences: Sequence[MeanDifference], wheel: str) -> list[tuple[str, str, tuple[str, ...], bool]]:
    """Return name, unit and cells of each steady quantity of a wheel, and whether the difference is significant."""
    return [
        (plain_name(row.name), split_name(row.name)[1].symbol, difference_cells(row), row.is_significant)
        for row in differences
        if row.wheel == wheel and not (row.first.reasons or row.second.reasons)
    ]
