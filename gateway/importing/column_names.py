"""What the name of a column and its stated unit say about its quantity."""

import re
from typing import Final

_BRACKET: Final = re.compile(r"[\[(]\s*([^\[\]()]{1,12}?)\s*[\])]")
_FACTOR: Final = (
    r"(?:[µμunmckMGdh]?(?:Nm|Pa|Hz|Ohm|eV|rad|bar|m|g|s|A|V|W|N|J|K|Ω)|[µμunmck]T|m?G|m?[Gg]auss|°[CF]?|deg[CF]?|degrees?|"
    r"%|‰|1|min|h|km/?h|kph|km/hr|mph|rpm|kpa|psi|mps\^?[2²]?|dps|sec|seconds|turns|U|rev|r|counts?|digits?|LSB|dB|ppm)"
    r"(?:(?:\^|\*\*)?-?[1-4]|[²³]|⁻[¹²])?"
)
_UNIT: Final = re.compile(rf"{_FACTOR}(?:\s?[/*·. ]\s?{_FACTOR})*")
# Parts of units that are none alone: an index, or the letter of an axis, a wheel or a channel.
_NOT_ALONE: Final = re.compile(r"[1-9rUhG]|\d+|-\d+")
_UNIT_WORD: Final = re.compile(
    r"(?:^|[^a-z0-9])(rpm|kmh|kph|km/h|mph|deg|kpa|bar|psi|mps2|m/s2|m/s\^2|mg)(?:[^a-z0-9]|$)", re.IGNORECASE
)
_RATE: Final = r"(?:^|[^a-z])(?:fs|(?:sampl(?:es?|ing)[_ -]?)?(?:rate|freq(?:uency)?)|abtast(?:rate|frequenz))"
_RATE_NAME: Final = re.compile(rf"{_RATE}(?:[_ -]?hz)?$", re.IGNORECASE)
_RATE_TEXT: Final = re.compile(
    rf"{_RATE}(?![a-z])(?P<before>[^\d\n]{{0,20}})(?P<number>\d+(?:[.,]\d+)?)[;,:\t ]*(?P<after>(?:k?Hz|k?S/s)\b)?",
    re.IGNORECASE,
)
_HERTZ: Final = re.compile(r"(k?)(?:Hz|S/s)", re.IGNORECASE)
_NO_UNIT: Final = frozenset({"-", "?", "1", "none", "n/a"})
_UNIT_NAMES: Final = {
    "m/s²": "m/s^2", "m/s**2": "m/s^2", "mps^2": "m/s^2", "ms^-2": "m/s^2", "m/s/s": "m/s^2", "m*s^-2": "m/s^2",
    "m s^-2": "m/s^2", "m s-2": "m/s^2", "m·s^-2": "m/s^2", "m·s⁻²": "m/s^2", "mps²": "m/s^2", "G": "g", "gn": "g",
    "kph": "km/h", "kmh": "km/h", "km/hr": "km/h", "1/min": "rpm", "U/min": "rpm", "r/min": "rpm", "min^-1": "rpm",
    "kpa": "kPa", "°": "deg", "degree": "deg", "degrees": "deg", "sec": "s", "seconds": "s", "µs": "us", "μs": "us",
    "°C": "degC", "°/s": "deg/s", "dps": "deg/s",
}  # fmt: skip
_SURELY_ACCELERATION: Final = re.compile(r"acc|beschl", re.IGNORECASE)
_ACCELERATION: Final = re.compile(
    r"acc|beschl|radial|circumf|tangent|(?:^|[^a-z])a[_ .-]?(?:[xyz]|\d{1,2}|rad|tan|lat)?(?:[^a-z]|$)", re.IGNORECASE
)
# The letter alone is a unit behind the name of an axis only.
_AXIS_IN_G: Final = re.compile(r"([xyz]|.{2,})_g", re.IGNORECASE)
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
    return _UNIT_NAMES.get(unit, unit)


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


def rate_in_text(line: str) -> float | None:
    """Return the sampling rate in Hz that a line above the columns states with its unit, None where it states none.

    >>> rate_in_text("# run 12, sample rate: 9.6 kHz")
    9600.0
    >>> rate_in_text("Abtastrate [Hz];9600,0")
    9600.0
    """
    match = _RATE_TEXT.search(line)
    unit = _HERTZ.search(match["after"] or match["before"]) if match else None
    if match is None or unit is None:
        return None
    return float(match["number"].replace(",", ".")) * (1e3 if unit[1] else 1.0)


def names_acceleration(name: str) -> bool:
    """Return whether a name says that a column is an acceleration."""
    return other_quantity(name) is None and _ACCELERATION.search(name) is not None


def other_quantity(name: str) -> str | None:
    """Return the quantity beside accelerations that a sensor has and a name says, such as `a rate of rotation`."""
    for pattern, quantity in _OTHERS:
        if pattern.search(name) and (quantity == A_MAGNITUDE or not _SURELY_ACCELERATION.search(name)):
            return quantity
    return None
