"""Entries of the glossary: quantities, effects of a diagnosis, reasons, columns, statuses, from their declarations."""

from __future__ import annotations

import importlib
import pkgutil
import re
from collections import ChainMap
from collections.abc import Iterator
from math import isinf
from typing import Final, NamedTuple

from gateway.core import table_columns as tables
from gateway.core.estimates.registry import DEFAULT_ESTIMATORS
from gateway.core.quantity import Basis, Quantity
from gateway.core.quantity_catalogue import declared, given_by, unit_of
from gateway.core.reasons import Code, Codes
from gateway.core.text.numbers import split_name
from gateway.diagnosis.effects.catalogue import catalogue
from gateway.diagnosis.effects.effect import Effect

_STATUSES: Final = {
    "valid": "the value can be used; its standard error contains everything that is stated or known to be uncertain",
    "provisional": "the value can be used with care; the reason beside it says what may be wrong (mark ~)",
    "invalid": "there is no value that can be used; the reason beside it says why (mark x)",
}
_TERMS: Final = {
    "baseline": "the tire model without any effect, against which effects of a diagnosis are compared",
    "exact ring": "the tire model without small-angle approximations: a belt that bends, on sidewall springs, on a "
    "flat or curved road; `--model exact`",
    "held-out rms": "root mean square of the error on revolutions that the fit has not seen, in m/s²; also: error on "
    "unseen revolutions",
    "neutral layer": "the layer of the belt that bending does not stretch; the sensor sits below it, toward the axle",
    "noise floor": "error that a perfect model would leave: the noise of the averaged signal",
    "order": "events in a turn of the wheel: order 2 comes twice in each turn, at any speed",
    "standard error": "one standard uncertainty (JCGM 100): the true value is within it in two of three cases, within "
    "twice of it in 19 of 20",
    "zero-g offset": "what an axis of the sensor reads without any acceleration",
}
_STATEMENTS: Final = {
    Basis.RADIUS: "belt radius",
    Basis.RATE: "sampling rate",
    Basis.GAIN: "gain of the sensor",
    Basis.LOAD: "load",
    Basis.PRESSURE: "pressure",
    Basis.OFFSET: "depth of the sensor",
    Basis.ZERO: "zero of the sensor",
    Basis.AXES: "alignment of the axes",
    Basis.ALONG: "circumferential axis",
    Basis.COUPLING: "AC coupling",
    Basis.HUB: "motion of the hub",
    Basis.SIGN: "side that the lateral axis points to",
}
# The first of these tables with a name explains it.
_COLUMNS: Final = ChainMap(
    tables.REVOLUTION_COLUMNS, tables.RECORDING_HEAD, tables.RECORDING_TAIL, tables.FAILURE_COLUMNS,
    tables.DIAGNOSIS_COLUMNS, tables.SAMPLE_COLUMNS, tables.AVERAGE_COLUMNS,
)  # fmt: skip


class Entry(NamedTuple):
    """A word and what it means.

    Attributes:
        kind: `quantity`, `effect`, `reason`, `status`, `column` or `term`.
        word: as the program writes it.
        names: what a user may call it; the first is its name in files.
        lines: label and text of each thing that is known of it; the first has no label.
    """

    kind: str
    word: str
    names: tuple[str, ...]
    lines: tuple[tuple[str, str], ...]


def entries() -> Iterator[Entry]:
    """Yield every entry: statuses, terms, quantities, effects, columns, reasons."""
    for kind, meanings in (("status", _STATUSES), ("term", _TERMS)):
        yield from (Entry(kind, word, (word,), (("", meaning),)) for word, meaning in meanings.items())
    by_default = given_by(DEFAULT_ESTIMATORS)
    for quantity in declared():
        yield _of_quantity(quantity, is_default=quantity.name in by_default)
    for effect in catalogue().values():
        yield _of_effect(effect)
    yield from (Entry("column", name, (name,), (("", column.description),)) for name, column in _COLUMNS.items())
    for code in reason_codes():
        kinds = ((f"{name} {kind}", text) for name, texts in code.words.items() for kind, text in texts.items())
        lines = tuple((label, _with_placeholders(text)) for label, text in (("", code.text_template), *kinds) if text)
        yield Entry("reason", str(code), (str(code),), lines)


def reason_codes() -> list[Code]:
    """Return the codes of every room, by their name; each room declares them in its module `reasons`."""
    for module in pkgutil.walk_packages(importlib.import_module("gateway").__path__, "gateway."):
        if module.name.endswith(".reasons"):
            importlib.import_module(module.name)
    rooms = (room for room in Codes.__subclasses__() if room.__module__.startswith("gateway."))
    return sorted((code for room in rooms for code in room.members()), key=str)


def matching(word: str) -> list[Entry]:
    """Return the entries of that name, else those whose name contains it, else those with it in their text."""
    plain_word = _plain(word)
    everything = list(entries())
    exact = [entry for entry in everything if plain_word in map(_plain, entry.names)]
    named = exact or [entry for entry in everything if any(plain_word in _plain(name) for name in entry.names)]
    return named or [entry for entry in everything if any(plain_word in _plain(text) for _, text in entry.lines)]


def _plain(name: str) -> str:
    return " ".join(re.split(r"[\s_-]+", name.strip().lower()))


def _of_quantity(quantity: Quantity, *, is_default: bool) -> Entry:
    label, unit = split_name(quantity.name)
    low, high = (f"{limit * unit.factor:.4g}" if not isinf(limit) else "" for limit in sorted(quantity.possible))
    limits = f"{low or 'any'} to {high or 'any'} {unit.symbol}".rstrip() if low or high else ""
    named = [_STATEMENTS[basis] for basis in Basis if basis in _STATEMENTS and _depends(quantity, basis)]
    lines = (
        ("", quantity.description),
        ("in files", f"{quantity.name}, {unit_of(quantity.name) or 'a pure number'}"),
        ("shown in", unit.symbol),
        ("equation", quantity.equation),
        ("positive", quantity.sign),
        ("possible", limits),
        ("rests on", ", ".join(named)),
        ("given by", "estimators that run by default" if is_default else "an estimator to choose with --estimator"),
    )
    names = (quantity.name, label, quantity.live_label or "", quantity.plain, quantity.entity)
    return Entry("quantity", label, tuple(name for name in names if name), tuple(line for line in lines if line[1]))


def _depends(quantity: Quantity, basis: Basis) -> bool:
    return basis in quantity.rests_on or quantity.powers.get(basis, 0.0) != 0.0


def _of_effect(effect: Effect) -> Entry:
    lines = (
        ("", effect.summary),
        ("equation", effect.equation),
        ("source", effect.source),
        ("parameters", ", ".join(parameter.name for parameter in effect.parameters)),
        ("seen in", effect.observed_in),
        ("confused with", "; ".join(", ".join(confounder.names) for confounder in effect.confounders)),
    )
    names = tuple(name for name in (effect.name, effect.title) if name)
    return Entry("effect", effect.title or effect.name, names, tuple(line for line in lines if line[1]))


def _with_placeholders(template: str) -> str:
    """Return a template with the names of its values."""
    return re.sub(r"\{([^:}!]*)(?:\{[^}]*\}|[^{}])*\}", lambda match: f"<{match[1].strip() or 'value'}>", template)
