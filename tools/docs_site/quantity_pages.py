"""Reference of quantities, generated from their declarations."""

from collections.abc import Iterator
from math import isfinite
from typing import Final

from gateway.core.quantity import Quantity, Trend
from gateway.core.quantity_catalogue import CATALOGUE
from gateway.core.table_columns import typeset_unit
from gateway.core.text.numbers import fixed, split_name
from gateway.fleet.trends.trend_result import asymmetry_of, by_temperature, rate_of
from tools.docs_site.markdown import code, escaped, table

_INTRODUCTION: Final = """\
# Quantities

Each estimator declares its quantities once; columns, frames, entities, trends and the rules of
[validity](../explanation/validity.md) follow from it. [Estimates](estimates.md) says what they mean together.

- **Sign**: what a positive value means. Axes are those of ISO 8855: x forward, y to the left, z up. Angles of the
  contact count from its centre, positive behind it.
- **Rests on**: what is stated or measured, with the exponent where the value is proportional to a power of it.
- **Possible**: values that a tire, a sensor or a road can have. One beyond them by 2.5 standard errors is provisional.

R is the belt radius, Omega the angular speed, theta the contact half angle, Q the load, p0 the pressure, h the
thickness of the ring, e the depth of the sensor below the neutral layer, s the radial axis, y the lateral displacement.
"""


def quantities_markdown() -> str:
    """Return the reference of every quantity, by estimator, and of where each is shown."""
    lines = [_INTRODUCTION]
    shown: dict[str, Quantity] = {}
    for estimator, quantities in CATALOGUE.items():
        new = [quantity for quantity in quantities if quantity.name not in shown]
        shown |= {quantity.name: quantity for quantity in new}
        lines += [f"## {estimator}", ""]
        others = ", ".join(code(quantity.name) for quantity in quantities if quantity not in new)
        if others:
            lines += [f"{others}: as above.", ""]
        if new:
            heads = ("Name", "Unit", "Quantity", "Equation", "Sign", "Rests on", "Possible")
            lines += table(heads, map(_row, new))
    lines += ["## Where they are shown", "", "Every quantity is in the tables, recordings, and live revolutions.", ""]
    heads = ("Name", "On screen", "In live states", "Home Assistant", "CAN signal", "Resolution", "Trends")
    lines += table(heads, (_places(quantity) for quantity in shown.values() if _is_elsewhere(quantity)))
    return "\n".join(lines).rstrip() + "\n"


def _row(quantity: Quantity) -> tuple[str, ...]:
    low, high = quantity.possible
    powers = [f"{basis}^{power:g}" if power != 1.0 else str(basis) for basis, power in quantity.powers.items()]
    others = sorted(str(basis) for basis in quantity.rests_on if basis not in quantity.powers)
    limits = f"{fixed(low, 2) if isfinite(low) else '-∞'} to {fixed(high, 2) if isfinite(high) else '∞'}"
    return (
        code(quantity.name),
        typeset_unit(quantity.name) or "1",
        escaped(quantity.description),
        escaped(quantity.equation),
        quantity.sign,
        escaped(", ".join([*powers, *others])),
        limits if isfinite(low) or isfinite(high) else "",
    )


def _is_elsewhere(quantity: Quantity) -> bool:
    return bool(quantity.bus or quantity.watch or quantity.compared or quantity.is_in_state)


def _places(quantity: Quantity) -> tuple[str, ...]:
    label, unit = split_name(quantity.name)
    bus = quantity.bus
    return (
        code(quantity.name),
        f"{label}, {unit.symbol}" if unit.symbol else label,
        "yes" if quantity.is_in_state else "",
        quantity.entity,
        f"{bus.frame.name}, {code(bus.signal)}" if bus is not None else "",
        f"{bus.resolution:g} {typeset_unit(quantity.name)}".rstrip() if bus is not None else "",
        ", ".join(_trends(quantity)),
    )


def _trends(quantity: Quantity) -> Iterator[str]:
    if quantity.watch is not None:
        yield code(rate_of(quantity.watch))
        if quantity.watch.trend is Trend.STIFFNESS:
            yield code(by_temperature(quantity.watch))
    if quantity.compared:
        yield code(asymmetry_of(quantity))
