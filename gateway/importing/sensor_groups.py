"""Groups of columns that belong to one sensor: by the groups of the file, or by what the names of axes share."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from gateway.core.errors import ImportDataError
from gateway.importing.columns import FileFacts
from gateway.importing.import_map import ImportedWheel

# The letter or word of an axis at the end or the beginning of a name, behind or before what names the sensor.
_AXIS_LAST: Final = re.compile(
    r"(?P<sensor>.*?)[_ .:/-]*(?P<axis>a?[xyz]|rad(?:ial)?|tan(?:gential)?|circ\w*|lat(?:eral)?|long?\w*)"
    r"\s*(?P<unit>[\[(].*[\])])?",
    re.IGNORECASE,
)
_AXIS_FIRST: Final = re.compile(
    r"(?P<axis>(?:a(?:cc?(?:el[a-z]*)?)?)?[_ .]?[xyz])[_ .:/-]*"
    r"(?P<sensor>\d{1,3}|[(\[]?[A-Za-z]{0,12}[_ .-]?\d{0,3}[)\]]?)",
    re.IGNORECASE,
)


def sensor_groups(names: Sequence[str], of_file: Mapping[str, Sequence[str]]) -> dict[str, str]:
    """Return the sensor of each column, where the columns are of several; empty where they may be of one.

    Two groups are two sensors where both have an axis of the same name: a file may also keep each axis of one sensor
    in a group of its own.

    Args:
        names: columns of accelerations.
        of_file: group of a column, and its name there.
    """
    for split in (_of_file(names, of_file), _by_pattern(names, _AXIS_LAST), _by_pattern(names, _AXIS_FIRST)):
        sizes = Counter(group for group, _ in split.values()).values()
        axes = Counter(axis for _, axis in split.values())
        is_several = len(sizes) > 1 and max(axes.values(), default=0) > 1
        # A single axis beside whole sensors may be of any.
        if len(split) == len(names) and is_several and (min(sizes) > 1 or len(axes) == 1):
            return {name: group for name, (group, _) in split.items()}
    return {}


def require_one_sensor(path: Path, facts: FileFacts, wheels: Sequence[ImportedWheel]) -> None:
    """Check that the axes of each wheel are of one sensor, and those of all at one rate.

    Raises:
        ImportDataError: naming the axes with their sensors or steps.
    """
    axes = [axis.column for wheel in wheels for axis in wheel.axis.present().values()]
    steps_s = {name: facts.steps_s[name] for name in axes if name in facts.steps_s}
    if steps_s and max(steps_s.values()) > 1.5 * min(steps_s.values()):
        details = ", ".join(f"{name} has {step_s:g} s" for name, step_s in steps_s.items())
        raise ImportDataError(
            f"{path}: the axes differ in their step: {details}",
            "Leave axes of other rates out of the map: interpolation would change an acceleration.",
        )
    for wheel in wheels:
        columns = [axis.column for axis in wheel.axis.present().values()]
        if len(columns) < 2:
            continue
        groups = _sensors_in_file(columns, facts)
        if len(set(groups.values())) > 1:
            details = ", ".join(f"'{name}' of {groups[name]}" for name in columns)
            raise ImportDataError(
                f"{path}: the axes of wheel {wheel.position} are of several sensors: {details}",
                "State the axes of one sensor for a wheel, and a [[wheel]] for each sensor.",
            )


def _sensors_in_file(columns: Sequence[str], facts: FileFacts) -> dict[str, str]:
    """Return the sensors of columns where each of these has all the axes that are named, else nothing."""
    for split in (
        _of_file(facts.names, facts.groups), _by_pattern(facts.names, _AXIS_LAST), _by_pattern(facts.names, _AXIS_FIRST)
    ):  # fmt: skip
        if not all(name in split for name in columns):
            continue
        column_groups = {name: split[name][0] for name in columns}
        axes = {split[name][1] for name in columns}
        complete = set(split.values())
        if len(set(column_groups.values())) > 1 and all(
            (group, axis) in complete for group in column_groups.values() for axis in axes
        ):
            return column_groups
    return {}


def _of_file(names: Sequence[str], groups: Mapping[str, Sequence[str]]) -> dict[str, tuple[str, str]]:
    return {name: (groups[name][0], groups[name][1]) for name in names if name in groups}


def _by_pattern(names: Sequence[str], pattern: re.Pattern[str]) -> dict[str, tuple[str, str]]:
    """Return (sensor, axis) of the names that a pattern splits."""
    matches = {name: pattern.fullmatch(name) for name in names}
    return {
        name: (match["sensor"].strip(" _-.:/()[]"), match["axis"].lower().lstrip("ac_ ."))
        for name, match in matches.items()
        if match is not None and match["sensor"].strip(" _-.:/()[]")
    }
