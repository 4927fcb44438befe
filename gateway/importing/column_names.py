"""What the name of a column and its stated unit say about its quantity."""

import re
from collections.abc import Collection
from typing import Final

from gateway.core.constants import STANDARD_GRAVITY_MPS2

_BRACKET: Final = re.compile(r"[\[(]\s*([^\[\]()]{1,12}?)\s*[\])]")
_FACTOR: Final = (
    r"(?:[µμunmckMGdh]?(?:Nm|Pa|Hz|Ohm|eV|rad|bar|m|g|s|A|V|W|N|J|K|Ω)|[µμunmck]T|m?G|m?[Gg]auss|°[CF]?|deg[CF]?|degrees?|"
    r"%|‰|1|min|h|km/?h|kph|km/hr|mph|rpm|kpa|psi|mps\^?[2²]?|dps|sec|seconds|turns|U|rev|r|counts?|digits?|LSB|dB|ppm)"
    r"(?:(?:\^|\*\*)?-?[1-4]|[²³]|⁻[¹²])?"
)
_UNIT: Final = re.compile(
    rf"(?:ft|in|mm|cm)/s(?:ec)?(?:\^|\*\*)?[2²]|[µμu]g|Gal|mV|{_FACTOR}(?:\s?[/*·. ]\s?{_FACTOR})*"
)
# Parts of units that are none alone: an index, or the letter of an axis, a wheel or a channel.
_NOT_ALONE: Final = re.compile(r"[1-9rUhG]|\d+|-\d+")
_UNIT_WORD: Final = re.compile(
    r"(?:^|[^a-z0-9])(rpm|kmh|kph|km/h|mph|deg|kpa|bar|psi|mps2|m/s2|m/s\^2|mg)(?:[^a-z0-9]|$)", re.IGNORECASE
)
_RATE: Final = (
    r"(?:^|[^a-z])(?:fs|sr|(?:sampl(?:es?|ing)[_ -]?)?(?:rate|freq(?:uency)?)|abtast(?:rate|frequenz)|"
    r"messrate|log[_ -]?rate|samples[_ /]?(?:per[_ ]?)?s(?:ec(?:ond)?)?)"
)
_RATE_NAME: Final = re.compile(rf"{_RATE}(?:[_ -]?hz)?$", re.IGNORECASE)
_RATE_TEXT: Final = re.compile(
    rf"{_RATE}(?![a-z])(?P<before>[^\d\n]{{0,20}})(?P<number>\d+(?:[.,]\d+)?(?:e[+-]?\d+)?)[;,:\t ]*"
    r"(?P<after>(?:k?Hz|k?S/s|samples/s(?:ec)?)\b)?",
    re.IGNORECASE,
)
# A rate or frequency without a unit may be of anything; that of samples is in Hz.
_OF_SAMPLES: Final = re.compile(r"(?:^|[^a-z])(?:fs|sr)[^a-z]|sampl|abtast|messrate", re.IGNORECASE)
_STEP: Final = (
    r"(?:^|[^a-z])(?:dt|delta[_ -]?(?:x|t)|(?:x[_ -]?)?increment|wf_increment|x[_ -]?step|time[_ -]?step|"
    r"(?:sampl(?:e|es|ing)|abtast)[_ -]?(?:interval|period|time|intervall|zeit))"
)
_STEP_NAME: Final = re.compile(rf"{_STEP}(?:[_ -]?s)?$", re.IGNORECASE)
_STEP_TEXT: Final = re.compile(
    rf"{_STEP}(?![a-z])(?P<before>[^\d\n]{{0,20}})(?P<number>\d*[.,]?\d+(?:e[+-]?\d+)?)[;,:\t ]*(?P<after>[mµu]?s\b)?",
    re.IGNORECASE,
)
_SECONDS: Final = re.compile(r"(?:^|[^a-zµ])([mµu]?)s(?:ec)?(?:[^a-z]|$)", re.IGNORECASE)
_HERTZ: Final = re.compile(r"(k?)(?:Hz|S/s|samples/s)", re.IGNORECASE)
_NO_UNIT: Final = frozenset({"-", "?", "1", "none", "n/a"})
_UNIT_NAMES: Final = {
    "m/s²": "m/s^2", "m/s**2": "m/s^2", "mps^2": "m/s^2", "ms^-2": "m/s^2", "m/s/s": "m/s^2", "m*s^-2": "m/s^2",
    "m s^-2": "m/s^2", "m s-2": "m/s^2", "m·s^-2": "m/s^2", "m·s⁻²": "m/s^2", "mps²": "m/s^2", "G": "g", "gn": "g",
    "kph": "km/h", "kmh": "km/h", "km/hr": "km/h", "1/min": "rpm", "U/min": "rpm", "r/min": "rpm", "min^-1": "rpm",
    "kpa": "kPa", "psig": "psi", "barg": "bar", "°": "deg", "degree": "deg", "degrees": "deg", "sec": "s",
    "seconds": "s", "msec": "ms", "usec": "us", "µs": "us", "μs": "us",
    "°C": "degC", "°/s": "deg/s", "dps": "deg/s",
}  # fmt: skip
_TIME_UNITS: Final = (
    ("ns", re.compile(r"ns|nsec|nanos(?:ec(?:ond)?s?)?", re.IGNORECASE)),
    ("us", re.compile(r"[uµμ]s|[uµ]sec|micros(?:ec(?:ond)?s?)?|mikrosekunden?", re.IGNORECASE)),
    ("ms", re.compile(r"ms|msec|millis(?:ec(?:ond)?s?)?|millisekunden?", re.IGNORECASE)),
    ("s", re.compile(r"s|secs?|seconds?|sek|sekunden?|seg(?:undos?)?", re.IGNORECASE)),
    ("min", re.compile(r"min(?:utes?|uten?|utos?)?", re.IGNORECASE)),
)
_TIME_WORD: Final = re.compile(
    rf"(?<![A-Za-zµμ])({'|'.join(text.pattern for _, text in _TIME_UNITS)})(?![A-Za-z])", re.IGNORECASE
)
_OF_TIME: Final = re.compile(r"time|zeit|stamp|elapsed|tiempo|tempo|temps|(?:^|[^a-z])t(?:[^a-z]|$)", re.IGNORECASE)
# Behind any name these are units of time alone.
_AT_END: Final = re.compile(r"(?<=[_ .-])(?:ns|us|µs|ms|nsec|usec|msec)$", re.IGNORECASE)
_NO_TIME: Final = re.compile(r"speed|veloc|geschw|^v[_ .-]|acc|beschl", re.IGNORECASE)
_SURELY_ACCELERATION: Final = re.compile(r"acc|beschl", re.IGNORECASE)
_ACCELERATION: Final = re.compile(
    r"acc|beschl|radial|circumf|tangent|(?:^|[^a-z])a[_ .-]?(?:[xyz]|\d{1,2}|rad|tan|lat)?(?:[^a-z]|$)", re.IGNORECASE
)
# The letter alone is a unit behind the name of an axis only.
_AXIS_IN_G: Final = re.compile(r"([xyz]|.{2,})_g", re.IGNORECASE)
_SENSITIVITY: Final = re.compile(r"(\d+(?:[.,]\d+)?)\s*mV\s*/\s*(g\b|\(?m\s*/\s*s)", re.IGNORECASE)
_PART_OF_TIME: Final = re.compile(
    r"(?:h|hh|hours?|std|stunden?|m|mm|min|mins|minutes?|minuten?|years?|jahr|months?|monat|days?|tag|"
    r"(?:m|u|n|milli|micro|nano|mikro)?(?:s|ss|sec|secs|seconds?|sek|sekunden?))",
    re.IGNORECASE,
)
MICROSECONDS: Final = re.compile(r"(?:u|µ|mi[ck]ro)(?:s|secs?|seconds?|sek|sekunden?)", re.IGNORECASE)
AN_ERROR: Final = re.compile(
    r"(?:^|[^a-z])(?:std(?:dev|err)?|err(?:or)?|sigma|unc(?:ertainty)?|deviation)(?:[^a-z]|$)", re.IGNORECASE
)
"""What is named so is the error of a quantity, not the quantity."""
A_MAGNITUDE: Final = "a magnitude"
"""Quantity of a column without a direction, which no axis is."""
# The first that fits names the column; sensors of several quantities use one letter for each axis.
_OTHERS: Final = (
    (re.compile(r"magnitude|resultant|(?:^|[^a-z])(?:norm|abs|vecsum|total)(?:[^a-z]|$)", re.IGNORECASE), A_MAGNITUDE),
    (
        re.compile(
            r"gyr|ang(?:ular)?[_ .-]?(?:vel|rate|speed)|(?:roll|pitch|yaw)[_ .-]?rate|drehrate|"
            r"(?:^|[^a-z])(?:omega|w)[_ .-]?[xyz](?:[^a-z]|$)",
            re.IGNORECASE,
        ),
        "a rate of rotation",
    ),
    (
        re.compile(
            r"euler|quat|(?:^|[^a-z])(?:d?q[_ .-]?[wxyz0-3]|roll|pitch|yaw|heading|azimuth)(?:[^a-z]|$)", re.IGNORECASE
        ),
        "an angle",
    ),
    (re.compile(r"magnet|(?:^|[^a-z])magn?[_ .-]?[xyz]?(?:[^a-z]|$)", re.IGNORECASE), "a magnetic field"),
)


def unit_of(name: str, stated: str) -> str:
    """Return the unit of a column, empty without one: as stated, in brackets in its name, or a word of its name.

    Args:
        name: of the column; brackets that hold no unit are part of it, such as `acc(:,3)` and `acc z (FL)`.
        stated: unit that the file states, empty without one.
    """
    unit = stated.strip().strip("[]()").strip()
    if unit.lower() in _NO_UNIT:
        unit = ""
    if not unit:
        unit = next((text for text in reversed(_BRACKET.findall(name)) if _is_unit(text, name)), "")
    if not unit and (word := _UNIT_WORD.search(name)):
        unit = word[1].lower()
    if not unit and (axis := _AXIS_IN_G.fullmatch(name)) and (len(axis[1]) == 1 or names_acceleration(axis[1])):
        unit = "g"
    if not unit:
        unit = _time_unit(name)
    if unit in ("S", "MS", "US") and _OF_TIME.search(name):
        unit = unit.lower()
    return _UNIT_NAMES.get(unit, unit)


def are_units(cells: Collection[str]) -> bool:
    """Return whether the cells of a line are units, at least two of them.

    >>> are_units(["s", "m/s^2", ""]), are_units(["left", "right"])
    (True, False)
    """
    filled = [cell for cell in cells if cell]
    return len(filled) > 1 and all(unit_of(f"acc ({cell})", "") or cell.lower() in ("s", "-") for cell in filled)


def _time_unit(name: str) -> str:
    """Return the unit of time in the name of a column of times, such as `time_ms`, empty without one."""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name)
    match = _TIME_WORD.fullmatch(name.strip(" _")) or _TIME_WORD.search(words)
    is_alone = match is not None and match[0] in (name.strip(" _"), words.strip(" _"))
    is_at_end = _AT_END.search(words) is not None and not _NO_TIME.search(words)
    if match is None or not (_OF_TIME.search(words) or is_alone or is_at_end):
        return ""
    return next(unit for unit, text in _TIME_UNITS if text.fullmatch(match[1]))


def _is_unit(text: str, name: str) -> bool:
    """Return whether the text of a bracket is a unit; an acceleration has none of the letters that number channels."""
    if text == "G":
        return names_acceleration(name)
    channel = len(text) == 1 and text in "AKNWJm" and names_acceleration(name)
    is_unit = text in _UNIT_NAMES or _UNIT.fullmatch(text) is not None
    return is_unit and not channel and not _NOT_ALONE.fullmatch(text)


def names_rate(name: str) -> bool:
    """Return whether the name of an attribute or of a single number is that of a sampling rate."""
    return _RATE_NAME.search(name) is not None


def rate_of(name: str, value: object) -> float | None:
    """Return the sampling rate in Hz that a named number states, itself or by the time between samples, or None."""
    try:
        number = float(str(value).strip("[] "))
    except ValueError:
        return None
    if names_rate(name):
        return number
    return 1.0 / number if _STEP_NAME.search(name) and 0.0 < number < 1.0 else None


def rate_in_text(line: str) -> float | None:
    r"""Return the sampling rate in Hz that a line above the columns states, None where it states none.

    >>> rate_in_text("# run 12, sample rate: 9.6 kHz")
    9600.0
    >>> rate_in_text("Abtastrate [Hz];9600,0")
    9600.0
    >>> rate_in_text("Delta_X\t0.0001\t0.0001")
    10000.0
    """
    match = _RATE_TEXT.search(line)
    unit = _HERTZ.search(match["after"] or match["before"]) if match else None
    if match is not None and (unit is not None or _OF_SAMPLES.search(match[0])):
        return float(match["number"].replace(",", ".")) * (1e3 if unit is not None and unit[1] else 1.0)
    match = _STEP_TEXT.search(line)
    step = float(match["number"].replace(",", ".")) if match else 0.0
    if match is None or not step > 0.0:
        return None
    unit = _SECONDS.search(match["after"] or match["before"])
    return 1.0 / (step * {"m": 1e-3, "u": 1e-6, "µ": 1e-6}.get(unit[1].lower() if unit else "", 1.0))


def names_acceleration(name: str) -> bool:
    """Return whether a name says that a column is an acceleration."""
    return other_quantity(name) is None and _ACCELERATION.search(name) is not None


def other_quantity(name: str) -> str | None:
    """Return the quantity beside accelerations that a sensor has and a name says, such as `a rate of rotation`."""
    for pattern, quantity in _OTHERS:
        if pattern.search(name) and (quantity == A_MAGNITUDE or not _SURELY_ACCELERATION.search(name)):
            return quantity
    return None


def parts_of_time(names: Collection[str]) -> set[str]:
    """Return the columns that together are a time of day, such as `h`, `m`, `s` and `us`; empty with less than three.

    >>> sorted(parts_of_time(["h", "m", "s", "us", "az"]))
    ['h', 'm', 's', 'us']
    """
    parts = {name for name in names if _PART_OF_TIME.fullmatch(name.strip())}
    return parts if len(parts) > 2 else set()


def sensitivity_in_text(text: str) -> float | None:
    """Return the sensitivity in mV per g that a line states, None where it states none.

    >>> sensitivity_in_text("Sensitivity: 10.2 mV/g")
    10.2
    """
    match = _SENSITIVITY.search(text)
    if match is None:
        return None
    value = float(match[1].replace(",", "."))
    return value * STANDARD_GRAVITY_MPS2 if match[2].startswith("(") or match[2].startswith("m") else value
