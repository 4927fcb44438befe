"""Drawing of a case from a seed: tire, sensor, undeclared effects with sizes, and the label that lists them."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from enum import StrEnum
from itertools import combinations
from typing import Any, Final

import numpy as np

from closure_rig.bench import Bench, draw_bench
from closure_rig.bent import Bend
from closure_rig.causes import CAUSES, SIZES, Drawing, Tables, cause
from closure_rig.outside import STRANGERS, Disturbance, stranger

# Pairs that exclude or mask each other.
UNPAIRED: Final = frozenset(
    frozenset(pair)
    for pair in (
        *combinations(("gain", "rolling radius", "sample clock error", "run-out"), 2),
        *combinations(("AC coupling", "gain", "zero-g offset", "rolling radius", "sample clock error"), 2),
        ("clipping", "AC coupling"),
        ("gain", "gain-temperature drift"),
        ("camber", "zero-g offset"),
        ("camber", "AC coupling"),
    )
)


class Kind(StrEnum):
    """Kind of a case."""

    EFFECT = "effect"
    PAIR = "pair"
    OUTSIDE = "outside"
    NOTHING = "nothing"


@dataclass(frozen=True, slots=True)
class Order:
    """Order for a case.

    Attributes:
        kind: of the case.
        seed: of everything else.
        names: effects, in or outside the catalogue; empty for none.
        size: index in SIZES.
    """

    kind: Kind
    seed: int
    names: tuple[str, ...] = ()
    size: int = 0

    @property
    def number(self) -> int:
        """Seed of the case's random numbers; cases of the same seed share none."""
        return zlib.crc32(repr((str(self.kind), self.seed, self.names, self.size)).encode())


@dataclass(frozen=True, slots=True)
class Case:
    """A case to be recorded.

    Attributes:
        order: the order.
        bench: tire, sensor and runs without undeclared effects.
        tables: undeclared effects, as changes to the scenario.
        mirrored: keys of `tables` that change sign in reverse.
        per_load: keys of `tables` to be multiplied by a run's load.
        disturbance: undeclared disturbance, added to the samples.
        bend: nonlinearity of the sensor.
        label: the truth, to be sealed.
    """

    order: Order
    bench: Bench
    tables: Tables
    mirrored: tuple[tuple[str, str], ...]
    per_load: tuple[tuple[str, str], ...]
    disturbance: Disturbance | None
    bend: Bend | None
    label: Mapping[str, Any]


def draw(order: Order) -> Case:
    """Return the case of an order, always the same one.

    Raises:
        ValueError: effects that cannot occur together.
    """
    bench_rng, rng = np.random.default_rng(order.number).spawn(2)
    bench = draw_bench(bench_rng)
    tables: dict[str, dict[str, Any]] = {}
    mirrored: list[tuple[str, str]] = []
    per_load: list[tuple[str, str]] = []
    sizes: dict[str, dict[str, Any]] = {}
    disturbance: Disturbance | None = None
    bend: Bend | None = None
    for name in order.names:
        # Both effects of a pair must be large enough to find.
        index = int(rng.integers(1, 3)) if order.kind is Kind.PAIR else order.size
        entry = stranger(name) if order.kind is Kind.OUTSIDE else cause(name)
        size = entry.sizes[index]
        drawing = Drawing(size, rng, bench)
        for table, values in entry.tables(drawing).items():
            taken = tables.setdefault(table, {})
            if clash := set(taken) & set(values):
                raise ValueError(f"{' and '.join(order.names)} both set {table}.{', '.join(sorted(clash))}")
            taken.update(values)
        if order.kind is Kind.OUTSIDE:
            make = stranger(name).disturbance
            disturbance = None if make is None else make(size, rng)
        else:
            mirrored += cause(name).mirrored
            per_load += cause(name).per_load
            make_bend = cause(name).bend
            bend = bend if make_bend is None else make_bend(drawing)
        sizes[name] = {"size": SIZES[index], "value": size, "unit": entry.unit}
    inside = order.kind is not Kind.OUTSIDE
    label = {
        "kind": str(order.kind),
        "seed": order.seed,
        "truth": sorted(order.names) if inside else [],
        "outside": None if inside else order.names[0],
        "sizes": sizes,
        "tables": tables,
        "bend": None if bend is None else asdict(bend),
        "bench": asdict(bench),
    }
    return Case(order, bench, tables, tuple(mirrored), tuple(per_load), disturbance, bend, label)


def blind(seed: int) -> Order:
    """Return the order that a seed draws: an effect, a pair, an effect outside the catalogue, or none."""
    rng = np.random.default_rng(seed)
    kind = Kind(str(rng.choice([Kind.EFFECT, Kind.PAIR, Kind.OUTSIDE, Kind.NOTHING], p=[0.5, 0.2, 0.15, 0.15])))
    size = int(rng.integers(0, len(SIZES)))
    if kind is Kind.NOTHING:
        return Order(kind, seed)
    if kind is Kind.OUTSIDE:
        return Order(kind, seed, (STRANGERS[int(rng.integers(len(STRANGERS)))].name,), size)
    if kind is Kind.EFFECT:
        return Order(kind, seed, (CAUSES[int(rng.integers(len(CAUSES)))].name,), size)
    return Order(kind, seed, pair(rng))


def pair(rng: np.random.Generator) -> tuple[str, str]:
    """Return two effects that can occur together."""
    while True:
        first, second = (CAUSES[int(i)].name for i in rng.choice(len(CAUSES), 2, replace=False))
        if frozenset((first, second)) not in UNPAIRED:
            return first, second
