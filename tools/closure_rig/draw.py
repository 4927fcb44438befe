"""Drawing of a case from a seed: tire, sensor, undeclared effects with sizes, and the label that lists them."""

import zlib
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from enum import StrEnum
from itertools import combinations
from typing import Any, Final

import numpy as np

from closure_rig.bench import Bench, draw_bench
from closure_rig.bent import Bend, Creep
from closure_rig.causes import CAUSES, SIZES, Drawing, Tables, cause
from closure_rig.outside import STRANGERS, Disturbance, OutputFault, stranger

# Pairs that exclude or mask each other.
UNPAIRED: Final = frozenset(
    frozenset(pair)
    for pair in (
        *combinations(("gain", "rolling radius", "sample clock error", "run-out"), 2),
        *combinations(("AC coupling", "gain", "zero-g offset", "rolling radius", "sample clock error"), 2),
        ("clipping", "AC coupling"),
        ("gain", "gain-temperature drift"),
        # One list of the scenario has the gains of all axes.
        ("gain", "circumferential gain"),
        ("camber", "zero-g offset"),
        ("camber", "AC coupling"),
        # One table of the scenario has both, and one list of axes.
        ("clipping", "mounting resonance"),
    )
)


BLIND_STRANGERS: Final = 7
BLIND_CAUSES: Final = 36
"""Number of effects outside and in the catalogue that `blind` draws from: kept diagnoses rely on what a seed draws."""


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
        bend: nonlinearity of the sensor, or the creep of its bond.
        label: the truth, to be sealed.
        fault: makes the undeclared fault of the samples' transport, anew for each recording.
    """

    order: Order
    bench: Bench
    tables: Tables
    mirrored: tuple[tuple[str, str], ...]
    per_load: tuple[tuple[str, str], ...]
    disturbance: Disturbance | None
    bend: Bend | Creep | None
    label: Mapping[str, Any]
    fault: Callable[[], OutputFault] | None = None


class Parts:
    """Undeclared things of one case, added one by one."""

    def __init__(self, bench: Bench, *, outside: bool) -> None:
        """Start with nothing.

        Args:
            bench: tire, sensor and runs.
            outside: whether names are those of effects outside the catalogue.
        """
        self._bench = bench
        self._outside = outside
        self._names: list[str] = []
        self._tables: dict[str, dict[str, Any]] = {}
        self._mirrored: list[tuple[str, str]] = []
        self._per_load: list[tuple[str, str]] = []
        self._disturbance: Disturbance | None = None
        self._bend: Bend | Creep | None = None
        self._fault: Callable[[], OutputFault] | None = None

    def add(self, name: str, size: float, rng: np.random.Generator) -> None:
        """Add an effect of this size; `rng` draws what else it has, such as a phase.

        Raises:
            ValueError: it cannot occur together with the others.
        """
        drawing = Drawing(size, rng, self._bench)
        entry = stranger(name) if self._outside else cause(name)
        for table, values in entry.tables(drawing).items():
            taken = self._tables.setdefault(table, {})
            if clash := set(taken) & set(values):
                raise ValueError(f"{name} sets {table}.{', '.join(sorted(clash))}, as {' and '.join(self._names)} do")
            taken.update(values)
        self._names.append(name)
        if self._outside:
            self._add_outside(name, drawing)
            return
        self._mirrored += cause(name).mirrored
        self._per_load += cause(name).per_load
        make_bend = cause(name).bend
        self._bend = self._bend if make_bend is None else make_bend(drawing)

    def _add_outside(self, name: str, drawing: Drawing) -> None:
        entry = stranger(name)
        if entry.disturbance is not None:
            self._disturbance = entry.disturbance(drawing.size, drawing.rng)
        if entry.creep is not None:
            self._bend = entry.creep(drawing)
        if entry.fault is not None:
            make, size, seed = entry.fault, drawing.size, int(drawing.rng.integers(2**31))
            self._fault = lambda: make(size, np.random.default_rng(seed))

    def case(self, order: Order, sizes: Mapping[str, Mapping[str, Any]], **more: Any) -> Case:
        """Return the case; `sizes` and `more` are for the label."""
        label = {
            "kind": str(order.kind),
            "seed": order.seed,
            "truth": [] if self._outside else sorted(self._names),
            "outside": self._names[0] if self._outside else None,
            "sizes": sizes,
            "tables": self._tables,
            "bend": None if self._bend is None else asdict(self._bend),
            "bench": asdict(self._bench),
            **more,
        }
        return Case(
            order,
            self._bench,
            self._tables,
            tuple(self._mirrored),
            tuple(self._per_load),
            self._disturbance,
            self._bend,
            label,
            self._fault,
        )


def draw(order: Order) -> Case:
    """Return the case of an order, always the same one.

    Raises:
        ValueError: effects that cannot occur together.
    """
    bench_rng, rng = np.random.default_rng(order.number).spawn(2)
    outside = order.kind is Kind.OUTSIDE
    parts = Parts(draw_bench(bench_rng), outside=outside)
    sizes: dict[str, dict[str, Any]] = {}
    for name in order.names:
        # Both effects of a pair must be large enough to find.
        index = int(rng.integers(1, 3)) if order.kind is Kind.PAIR else order.size
        entry = stranger(name) if outside else cause(name)
        parts.add(name, entry.sizes[index], rng)
        sizes[name] = {"size": SIZES[index], "value": entry.sizes[index], "unit": entry.unit}
    return parts.case(order, sizes)


def blind(seed: int) -> Order:
    """Return the order that a seed draws: an effect, a pair, an effect outside the catalogue, or none."""
    rng = np.random.default_rng(seed)
    kind = Kind(str(rng.choice([Kind.EFFECT, Kind.PAIR, Kind.OUTSIDE, Kind.NOTHING], p=[0.5, 0.2, 0.15, 0.15])))
    size = int(rng.integers(0, len(SIZES)))
    if kind is Kind.NOTHING:
        return Order(kind, seed)
    if kind is Kind.OUTSIDE:
        return Order(kind, seed, (STRANGERS[int(rng.integers(BLIND_STRANGERS))].name,), size)
    if kind is Kind.EFFECT:
        return Order(kind, seed, (CAUSES[int(rng.integers(BLIND_CAUSES))].name,), size)
    return Order(kind, seed, pair(rng, BLIND_CAUSES))


def pair(rng: np.random.Generator, count: int = len(CAUSES)) -> tuple[str, str]:
    """Return two effects that can occur together, of the first `count`."""
    while True:
        first, second = (CAUSES[int(i)].name for i in rng.choice(count, 2, replace=False))
        if frozenset((first, second)) not in UNPAIRED:
            return first, second
