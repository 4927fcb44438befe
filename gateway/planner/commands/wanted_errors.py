"""What is asked of a sensor: the largest error of a quantity, `wear=0.5mm`, and speeds, `60..120km/h`."""

import re
from collections.abc import Mapping
from typing import Final

from gateway.core.errors import ConfigError
from gateway.core.nearest_name import did_you_mean
from gateway.core.text.numbers import split_name
from gateway.planner.wants import Want

_NUMBER: Final = r"\d+(?:\.\d+)?(?:e-?\d+)?"
_WANT: Final = re.compile(rf"(.+?)=({_NUMBER}) ?(.*)")
_SPEEDS: Final = re.compile(rf"({_NUMBER})(?:\.\.({_NUMBER}))? ?(?:km/h)?")
_KMH_PER_MPS: Final = 3.6
_MIN_KMH, _MAX_KMH = 5.0, 400.0


def parse_want(text: str, truths: Mapping[str, float]) -> Want:
    """Return what `NAME=NUMBER UNIT` asks for; the unit is that of the screens, or % of the true value.

    Args:
        text: with the name of a quantity, or its name without the unit.
        truths: true value of each quantity that is planned.

    Raises:
        ConfigError: no quantity, number or unit; the remedy names those that there are.
    """
    match = _WANT.fullmatch(text)
    if match is None:
        raise ConfigError(f"'{text}' asks for no error", "Write --want wear=0.5mm, or a share of the value: Ts=3%.")
    by_short_name = {split_name(name)[0].replace(" ", "_"): name for name in truths}
    label = match[1].strip().replace(" ", "_")
    name = label if label in truths else by_short_name.get(label)
    if name is None:
        raise ConfigError(
            f"'{label}' is no quantity that is planned",
            f"{did_you_mean(label, by_short_name)}Known: {', '.join(by_short_name)}.",
        )
    unit, error = split_name(name)[1], float(match[2])
    if match[3] == "%" and truths[name]:
        largest = error * 0.01 * abs(truths[name])
    elif match[3] == unit.symbol:
        largest = error / unit.factor
    else:
        units = [symbol for symbol in (unit.symbol, "%" if truths[name] else "") if symbol]
        if not match[3]:
            raise ConfigError(f"the error of {label} has no unit", f"Write {label}={match[2]}{units[0]}.")
        raise ConfigError(f"'{match[3]}' is no unit of the error of {name}", f"Give it in {' or '.join(units)}.")
    if largest <= 0.0:
        raise ConfigError(f"no sensor has an error of {match[2]} in {name}", "Give an error above 0.")
    return Want(name, largest)


def parse_speeds_mps(text: str) -> tuple[float, ...]:
    """Return the speeds of `60..120km/h`, both ends and the middle, or of `80km/h`.

    Raises:
        ConfigError: no speeds between 5 and 400 km/h.
    """
    match = _SPEEDS.fullmatch(text)
    slowest = float(match[1]) if match is not None else 0.0
    fastest = float(match[2] or slowest) if match is not None else 0.0
    if not _MIN_KMH <= slowest <= fastest <= _MAX_KMH:
        raise ConfigError(
            f"'{text}' is no range of speeds from {_MIN_KMH:g} to {_MAX_KMH:g} km/h", "Write --at 60..120km/h."
        )
    return tuple(kmh / _KMH_PER_MPS for kmh in sorted({slowest, 0.5 * (slowest + fastest), fastest}))
