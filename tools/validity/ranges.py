"""Parameters that can be other than is taken for granted, from the declarations themselves, and the sizes people meet.

`ranges.tsv` has for each parameter, or for a table, how a size is meant, the sizes, what has to be set beside it, and
their source. A parameter that is not in it gets a range from its declaration.
"""

import math
import types
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final, Literal, get_args, get_origin

from pydantic.fields import FieldInfo

from firmware_protocol.messages import Environment, Hello
from gateway.core.config.validation import Section
from gateway.core.config.vehicle import VehicleConfig
from gateway.simulator.link_faults import FAULTS
from gateway.simulator.scenario_model import Scenario
from gateway.simulator.time_series import Series

STATED: Final = "states:"
TABLE: Final = Path(__file__).with_name("ranges.tsv")
AXES: Final = ("circumferential", "lateral", "radial")
# Tables without a parameter of a run's numbers: names, alarms, signatures; the simulator's statements are made here,
# and pressures come from the wheel's own sensor.
_WITHOUT: Final = frozenset({"scenario", "stated", "vehicle", "test", "thresholds", "security", "placard", "tpms"})
# `[wheel.tire]` is `[tire]` again.
_AGAIN: Final = frozenset({"states:wheel.tire"})
# Tables of these the independent tire lacks, and keys of its tire.
_RING_ONLY: Final = ("edge_waves.", "tread_pitch.", "tire.drum", "tire.axle_torque", "tire.bending_damping",
                     "tire.sidewall_stiffening", "tire.runout", "tire.shear", "tire.rotary", "tire.tangential_damping",
                     "road.profile", "road.waviness", "road.unsprung", "road.suspension", "road.damper")  # fmt: skip
# A standard error that is stated: over what it is.
_UNDERSTATED: Final = (0.33, 0.7)

Way = Literal["is", "off", "times", "ramp", "share", "choice", "none"]


@dataclass(frozen=True, slots=True)
class Span:
    """Sizes of one parameter.

    Attributes:
        key: `table.key` of a scenario, with `states:` of a vehicle file, or of a message or fault of the link.
        way: `is` the value, `off` adds to the truth, `times` changes it by percent, `ramp` does so from the beginning
            of the run to its end (slowly), `share` is a time as a share of the run, `choice` is one of some values,
            `none` has no sizes.
        sizes: lowest and highest, or the choices.
        signed: whether either sign occurs.
        beside: other parameters that have to be set, with their values.
        source: of the sizes, or why there are none.
        axis: number of the axis of a parameter that each axis has.
    """

    key: str
    way: Way
    sizes: tuple[Any, ...]
    signed: bool = False
    beside: tuple[tuple[str, Any], ...] = ()
    source: str = ""
    axis: int | None = None

    @property
    def name(self) -> str:
        """Name of the parameter, with its axis."""
        return self.key if self.axis is None else f"{self.key}.{AXES[self.axis]}"

    @property
    def ring_only(self) -> bool:
        """Whether the independent tire has no such parameter."""
        return self.key.startswith(_RING_ONLY)

    @property
    def is_error(self) -> bool:
        """Whether it is a standard error that is stated."""
        return self.key.startswith(STATED) and "_std" in self.key


def value_of(text: str) -> Any:
    """Return the value of a word of the table."""
    if text in ("True", "False", "None"):
        return {"True": True, "False": False, "None": None}[text]
    try:
        return float(text)
    except ValueError:
        return text


@cache
def listed() -> dict[str, Span]:
    """Return the rows of the table by key."""
    spans = {}
    for line in TABLE.read_text(encoding="utf-8").splitlines()[1:]:
        key, way, sizes, beside, source = line.split("\t")
        values = sizes.split() if way == "choice" else sizes.lstrip("±").split("..") if sizes else []
        pairs = (item.split("=") for item in beside.split(";") if item)
        spans[key] = Span(
            key, way, tuple(map(value_of, values)), sizes.startswith("±"),
            tuple((name, value_of(value)) for name, value in pairs), source,
        )  # fmt: skip
    return spans


def spans() -> Iterator[Span]:
    """Yield every parameter that has a size, each axis apart."""
    for key, field in declared():
        span = _row(key) or derived(key, field)
        if span is None or span.way == "none":
            continue
        if _has_axes(key, field):
            yield from (
                Span(span.key, span.way, span.sizes, span.signed, span.beside, span.source, axis) for axis in range(3)
            )
        else:
            yield span


def _row(key: str) -> Span | None:
    """Return the row of a key, or that of a table which it is in."""
    above = (f"{key[:end]}.*" for end, letter in enumerate(key) if letter == ".")
    return next((listed()[name] for name in (key, *above) if name in listed()), None)


def declared() -> Iterator[tuple[str, FieldInfo | None]]:
    """Yield the key and declaration of every parameter: scenario, vehicle file, messages of the hub, faults."""
    yield from _keys(Scenario, "", "")
    yield from _keys(VehicleConfig, STATED, "")
    yield from ((f"hello:{name}", None) for name in Hello._fields)
    yield from ((f"environment:{name}", None) for name in Environment._fields)
    yield from ((f"link:{name}", None) for name in FAULTS)


def _keys(section: type[Section], prefix: str, path: str) -> Iterator[tuple[str, FieldInfo]]:
    for name, field in section.model_fields.items():
        key = f"{prefix}{path}{name}"
        inner = _section(field.annotation)
        if inner is None:
            yield key, field
        elif name not in _WITHOUT and key not in _AGAIN and not (path and not prefix):
            # A wheel of a scenario inherits its tables.
            yield from _keys(inner, prefix, f"{path}{name}.")


def _section(annotation: Any) -> type[Section] | None:
    """Return the table that a field is, or has several of."""
    if isinstance(annotation, type) and issubclass(annotation, Section):
        return annotation
    return next(filter(None, map(_section, get_args(annotation))), None) if get_args(annotation) else None


def derived(key: str, field: FieldInfo | None) -> Span | None:
    """Return the sizes that a declaration suggests: a quarter off, or a part of what is allowed; None of a text."""
    if field is None:
        return Span(key, "times", (1.0, 25.0), True, source="declaration")
    if key.startswith(STATED) and "_std" in key:
        return Span(key, "times", tuple(100.0 * (share - 1.0) for share in _UNDERSTATED), source="declaration")
    kinds = _leaves(field.annotation)
    default = field.default.low if isinstance(field.default, Series) else field.default
    if choices := tuple(value for value in kinds if not isinstance(value, type) and value != default):
        return Span(key, "choice", choices, source="declaration")
    if bool in kinds:
        return Span(key, "choice", (not default,), source="declaration")
    if not {int, float, Series} & set(kinds):
        return None
    if isinstance(default, int | float) and default:
        return Span(key, "is", (0.75 * default, 1.25 * default), source="declaration")
    high = next((getattr(item, "le", None) for item in field.metadata if getattr(item, "le", None)), 1.0)
    return Span(key, "is", (1e-3 * high, 1e-1 * high), source="declaration")


def _leaves(annotation: Any) -> tuple[Any, ...]:
    """Return the types and literal values that an annotation is made of."""
    if get_origin(annotation) is Literal:
        return get_args(annotation)
    parts = [part for part in get_args(annotation) if part is not types.NoneType]
    return tuple(leaf for part in parts for leaf in _leaves(part)) if parts else (annotation,)


def _has_axes(key: str, field: FieldInfo | None) -> bool:
    if field is None:
        return key in ("hello:range_mps2", "hello:scale_mps2", "hello:offset_counts")
    return field.annotation == tuple[float, float, float]


def drawn_size(span: Span, fraction: float, sign: float) -> float:
    """Return the size at a fraction of the range, even in its logarithm; of choices the number of one."""
    if span.way == "choice":
        return float(min(int(fraction * len(span.sizes)), len(span.sizes) - 1))
    low, high = span.sizes
    if low * high <= 0.0:
        return float(low + fraction * (high - low))
    size = math.copysign(math.exp(math.log(abs(low)) + fraction * math.log(high / low)), low)
    return math.copysign(size, sign) if span.signed else size
