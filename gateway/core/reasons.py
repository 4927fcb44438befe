"""Reasons and notices as values: a code with its numbers. `gateway.core.text.wording` turns them into text.

Each room, of the core or a feature, declares its codes in its module `reasons`.

A template is a format string over the values of its reason. Values are in SI units; a unit after the format converts
and is printed: `{depth_m:.1f mm}` shows 0.008 as `8.0 mm`. A
format of `probability` rounds down near 1. A nested reason is replaced by its own text. `{unit: }` is
the symbol of a unit that the reason carries itself, behind a blank unless it is empty. `{name:series}` is the label of
a series of trends.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, TypeAlias

Value: TypeAlias = "float | str | Reason | tuple[Value, ...]"


class Code:
    """Meaning of a reason, declared with the template of its text. The code itself is the name in lower case.

    Codes appear in JSON output and recordings: a code may be added, but not renamed without an entry in the changelog.

    Attributes:
        text_template: text with the values it needs, by default the first of `words`. Only `gateway.core.text.wording`
            fills it.
        words: templates of the values that are one of a few kinds, by the value's name and the kind.
        name: of the attribute of its room's `Codes`.
        codes: that class.
    """

    __slots__ = ("codes", "name", "text_template", "words")

    name: str
    codes: type[Codes]

    def __init__(self, text_template: str = "", **words: Mapping[str, str]) -> None:
        self.text_template = text_template or f"{{{next(iter(words))}}}"
        self.words = words

    def __str__(self) -> str:
        return self.name.lower()

    def __repr__(self) -> str:
        return f"<{self.codes.__name__}.{self.name}>"

    def __lt__(self, other: Code) -> bool:
        return str(self) < str(other)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle and copy by reference, since codes are compared by identity."""
        return getattr, (self.codes, self.name)


class Codes:
    """Codes of a room, the attributes of its class."""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        for name, value in vars(cls).items():
            if isinstance(value, Code):
                value.name, value.codes = name, cls

    @classmethod
    def members(cls) -> tuple[Code, ...]:
        """Return the codes in their order."""
        return tuple(value for value in vars(cls).values() if isinstance(value, Code))


@dataclass(frozen=True, slots=True, init=False)
class Reason:
    """A code and the values that belong to it, in SI units with the unit in the name.

    Attributes:
        code: its meaning.
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

    @property
    def kind(self) -> tuple[Code | Value | None, ...]:
        """Its code, and which of the code's sentences it is: equal in reasons that differ in numbers and names only."""
        return self.code, *map(dict(self.values).get, self.code.words)

    def __iter__(self) -> Iterator[Reason]:
        """Iterate over this reason and those nested in it, outermost first."""
        yield self
        for _, value in self.values:
            for inner in value if isinstance(value, tuple) else (value,):
                if isinstance(inner, Reason):
                    yield from inner


def codes_of(reasons: Iterable[Reason]) -> tuple[Code, ...]:
    """Return the codes of reasons and of those nested in them, in order."""
    return tuple(inner.code for reason in reasons for inner in reason)


class Level(StrEnum):
    """Severity of a notice."""

    INFO = "info"
    WARNING = "warning"
    SECURITY = "security"
    """A warning that an attack could explain."""
    ERROR = "error"
    """Data is being lost."""


@dataclass(frozen=True, slots=True)
class Notice:
    """Something that the user should know.

    Attributes:
        subject: name of the link, hub, wheel or file that it is about, empty for the whole session.
        reason: what happened.
        level: how much it matters.
    """

    subject: str
    reason: Reason
    level: Level = Level.INFO


class CoreCode(Codes):
    """Reasons of the core that several of its rooms give."""

    EFFECTS_OF_OTHER_OFFSET = Code(
        "the effects were identified with the sensor {found_m:z.2f mm} below the neutral layer, but {offset_m:z.2f "
        "mm} is in use here: the difference may be counted twice"
    )
    EFFECTS_OF_OTHER_RADIUS = Code(
        "the effects were identified with a belt radius of {found_m:.1f mm}, but {radius_m:.1f mm} is in use here"
    )
    EFFECTS_OF_OTHER_SENSOR = Code("the effects were identified on sensor {found_on}, but this is sensor {sensor}")

    NO_STEADY_VALUE = Code("the mean of the radial signal is not positive: its steady value is missing")
    CORRELATED = Code("correlated {correlation:+.2f} with {number}")
    MODEL_ERROR_SHARE = Code("{share:.0%} of the variance is an error of the model")
    NOT_DETERMINED = Code("not determined: the standard error is {relative_error:times} the value")
    NOT_SETTLED = Code("settling: {revolutions:.0f} of {needed:.0f} revolutions")
    NO_REVOLUTION = Code("no revolution is complete in {duration_s:.1f s} of samples: {why}")
    SAMPLES_WITHOUT_HELLO = Code(
        "{count} blocks of samples arrived, but no valid HELLO: without its rate and scale nothing can be estimated. "
        "A hub sends a HELLO every 2 s. Restart the hub; `treadlink protocol check` says what is wrong with a HELLO"
    )
    PLUGIN_REFUSED = Code(
        why={
            "effect_taken": "{by} has an effect of this name or rank already: {effect}, rank {rank}",
            "lacks_members": "it lacks {members}",
            "name_differs": "it states another name, {name}",
            "name_taken": "{by} has this name already",
            "not_imported": "it cannot be imported: {error}",
            "quantity_taken": "{by} has its quantity {name} already",
            "wrong_type": "it is not {expected}",
        },
    )
    RECEIVER_TIME = Code(
        "the receiver's clock is {ahead_s:+.1f s} from that of this computer, which dated the recording: `treadlink "
        "set-clock FILE` makes a copy with the receiver's times"
    )
    SENTENCES_UNREAD = Code(
        "its position, speed and time are not read: install the package 'pynmeagps' (pip install 'treadlink[nmea]')"
    )
    SINK_CLOSED = Code("finished")
    ASSUMED_NOT_MEASURED = Code("assumed, not measured: {text}")
    ASSUMED_RADIUS = Code("belt radius {radius_m:g mm} (no configuration states it)")
    FROM_CONFIGURATION = Code("--config")
    FROM_RECORDING = Code("configuration recorded with it")
    FROM_SENSOR = Code("measured by the sensor")
    ROW_FEW_VALID = Code("only {count} of {of} revolutions give a valid value")
    TREND_CONTACT_CHANGED = Code(
        "since {date}, {name:series} is {change:+.3g}{unit: } ± {std:.2g}{unit: } from its earlier trend, by {by}: "
        "{count} recordings, {first} to {last}",
        by={
            "measured": "the load or the stiffness",
            "unmeasured": "the load, the stiffness, or a pressure that is not measured",
        },
    )
    TREND_LEVEL_CHANGED = Code(
        "since {date}, {name:series} is {change:+.3g}{unit: } ± {std:.2g}{unit: } from its earlier trend: {count} "
        "recordings, {first} to {last}"
    )
    TREND_SENSOR_GAIN = Code("sensor: its gain has changed by {share:.1%} ± {std:.1%}")
    TREND_SENSOR_ZERO = Code("sensor: its zero has changed by {change_mps2:.1f m/s²} ± {std:.1f m/s²}")
