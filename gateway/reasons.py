"""Why something is as it is, as a value: a code with its numbers. `gateway.views.wording` turns it into text."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import TypeAlias

Value: TypeAlias = "float | str | Reason | tuple[Value, ...]"


class Code(StrEnum):
    """What a reason says. The text of each code, with the values it needs, is in `gateway.views.wording`.

    Codes appear in JSON output and recordings: a code may be added, but not renamed without an entry in the changelog.
    """

    # Revolutions
    SAMPLES_LOST = "samples_lost"

    # Estimates

    # Sensors

    # Wheels, links and alarms

    # Security

    # Files and configuration


@dataclass(frozen=True, slots=True, init=False)
class Reason:
    """A code and the values that belong to it, in SI units with the unit in the name.

    Attributes:
        code: what is said.
        values: name and value of each number, name or nested reason, in the order given.
    """

    code: Code
    values: tuple[tuple[str, Value], ...]

    def __init__(self, code: Code, **values: Value) -> None:
        object.__setattr__(self, "code", code)
        object.__setattr__(self, "values", tuple(values.items()))

    def __getitem__(self, name: str) -> Value:
        """Return one value; raises KeyError when the code has none of that name."""
        return dict(self.values)[name]

    def __iter__(self) -> Iterator[Reason]:
        """Iterate over this reason and those nested in it, outermost first."""
        yield self
        for _, value in self.values:
            for inner in value if isinstance(value, tuple) else (value,):
                if isinstance(inner, Reason):
                    yield from inner
