"""What a comparison says first: which condition differs and how far, what differs with it, and what to do."""

import math
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from gateway.compare.mean_comparison import MeanDifference
from gateway.compare.views.drive import Drive
from gateway.compare.views.wheel_glance import number
from gateway.core.text.numbers import plain_name, round_to_error, split_name
from gateway.core.text.text import clean

# What the tire's numbers rest on, and from which share of it conditions are not alike; of temperatures from kelvin.
_CONDITIONS: Final = (
    ("pressure", "pressure_pa", 0.01), ("stated load", "load_n", 0.01), ("speed", "speed_mean_mps", 0.05),
    ("temperature", "temperature_degc", 5.0), ("belt radius", "radius_m", 0.002),
)  # fmt: skip
# A difference of conditions is sure from so many of its standard errors, where they are known.
_SURE_STDS: Final = 3.0
# A difference that may be chance is named with a cause from so many of its standard errors.
_WITH_CAUSE: Final = 2.0
_LONGEST_LIST: Final = 5
_OTHERWISE: Final = "to compare the tire itself, record again at the same {label}"
_STEPS: Final = {
    "belt radius": "state the same belt radius in both vehicle files, unless the tire is another one",
}
_LEAK: Final = "if nobody let air out, look for a leak at valve, bead and tread; "
_NO_CAUSE: Final = (
    "no condition that was recorded explains it: repeat the second recording to confirm it, then run treadlink "
    "diagnose on both to see what the signals differ by"
)


class Cause(NamedTuple):
    """A condition of a wheel that is not the same in both recordings.

    Attributes:
        wheel: position.
        label: of the condition.
        size: `35.1 ± 1.5 kPa lower (231.4, then 196.3 kPa)`.
        is_lower: in the second recording.
    """

    wheel: str
    label: str
    size: str
    is_lower: bool


class ComparisonVerdict(NamedTuple):
    """First lines of the page.

    Attributes:
        answer: sentences.
        lines: what differs, one line for each wheel.
        steps: what to do, with what it is about.
        wheel: of which most is said, empty where nothing differs.
    """

    answer: str
    lines: list[str]
    steps: list[dict[str, str]]
    wheel: str


def comparison_verdict(
    first: Drive, second: Drive, wheels: Sequence[str], differences: Sequence[MeanDifference]
) -> ComparisonVerdict:
    """Return what to say first of two recordings of some wheels."""
    causes = [cause for wheel in wheels for cause in _causes(first, second, wheel)]
    significant = [row for row in differences if row.is_significant]
    with_cause, differing = {cause.wheel for cause in causes}, {row.wheel for row in significant}
    unexplained = [wheel for wheel in wheels if wheel in differing - with_cause]
    calm = [wheel for wheel in wheels if wheel not in with_cause | differing]
    loudest = max(significant, key=lambda row: abs(row.significance), default=None)
    return ComparisonVerdict(
        " ".join(_sentences(causes, unexplained, calm)),
        [line for wheel in wheels for line in _lines(wheel, causes, differences)],
        [*_steps(causes), *({"about": clean(wheel), "step": _NO_CAUSE} for wheel in unexplained)],
        loudest.wheel if loudest is not None else causes[0].wheel if causes else "",
    )


def _sentences(causes: Sequence[Cause], unexplained: Sequence[str], calm: Sequence[str]) -> Iterator[str]:
    """Yield the causes, then the wheels whose numbers differ without one, then those of which nothing differs."""
    for label, *_ in _CONDITIONS:
        of_label = [f"{clean(cause.wheel)} {cause.size}" for cause in causes if cause.label == label]
        if of_label:
            yield f"{label.capitalize()} differs: {'; '.join(of_label)}."
    if unexplained:
        yield f"{_listed(unexplained)}: the tire's numbers differ, and no condition that was recorded does."
    if calm:
        yield f"{_listed(calm)}: no difference beyond chance."
    if not causes and not unexplained:
        yield "Nothing to act on."


def _causes(first: Drive, second: Drive, wheel: str) -> Iterator[Cause]:
    cells = [drive.wheels[wheel].cells() for drive in (first, second)]
    for label, name, share in _CONDITIONS:
        unit = split_name("speed_mps" if name == "speed_mean_mps" else name)[1]
        stem, _, suffix = name.rpartition("_")
        before, after = (number(row, name) for row in cells)
        std = math.hypot(*(number(row, f"{stem}_std_{suffix}") for row in cells))
        difference = after - before
        scale = 1.0 if name == "temperature_degc" else abs(before)
        if not abs(difference) > share * scale or abs(difference) < _SURE_STDS * std:
            continue
        size = round_to_error(abs(difference) * unit.factor, std * unit.factor).joined()
        values = ", then ".join(f"{unit.of(value):.4g}" for value in (before, after))
        symbol = "K" if unit.symbol == "°C" else unit.symbol
        words = "lower" if difference < 0.0 else "higher"
        yield Cause(wheel, label, f"{size} {symbol} {words} ({values} {unit.symbol})", difference < 0.0)


def _lines(wheel: str, causes: Sequence[Cause], differences: Sequence[MeanDifference]) -> Iterator[str]:
    """Yield what differs of a wheel: with a cause also what chance may have made."""
    labels = [cause.label for cause in causes if cause.wheel == wheel]
    of_wheel = [row for row in differences if row.wheel == wheel and not (row.first.reasons or row.second.reasons)]
    of_wheel.sort(key=lambda row: abs(row.significance), reverse=True)
    sure = [_phrase(row) for row in of_wheel if row.is_significant][:_LONGEST_LIST]
    unsure = [_phrase(row) for row in of_wheel if not row.is_significant and abs(row.significance) >= _WITH_CAUSE]
    if labels and unsure:
        sure.append(f"perhaps also, within chance: {', '.join(unsure[:_LONGEST_LIST])}")
    head = f"{clean(wheel)}, with the {' and the '.join(labels)}" if labels else clean(wheel)
    if sure:
        yield f"{head}: {'; '.join(sure)}."
    elif labels:
        yield f"{head}: nothing else differs beyond chance."


def _phrase(row: MeanDifference) -> str:
    """Return one difference in words; in percent where the quantity has no unit."""
    unit = split_name(row.name)[1]
    factor, symbol = unit.factor, unit.symbol
    if not symbol and row.first.value:
        factor, symbol = 100.0 / abs(row.first.value), "%"
    size = round_to_error(abs(row.difference) * factor, row.std * factor).joined()
    words = "higher" if row.difference > 0.0 else "lower"
    return f"{plain_name(row.name)} {size} {symbol} {words}"


def _steps(causes: Sequence[Cause]) -> Iterator[dict[str, str]]:
    """Yield one step for each condition and direction."""
    wheels: dict[tuple[str, bool], list[str]] = {}
    for cause in causes:
        wheels.setdefault((cause.label, cause.is_lower), []).append(cause.wheel)
    for (label, is_lower), which in wheels.items():
        step = _STEPS.get(label, _OTHERWISE.format(label=label.removeprefix("stated ")))
        leak = _LEAK if label == "pressure" and is_lower else ""
        yield {"about": f"{_listed(which)}, {label}", "step": f"{leak}{step}"}


def _listed(wheels: Sequence[str]) -> str:
    return ", ".join(map(clean, wheels))
