"""Plan of the cases of a benchmark: kinds, effects, wanted strengths and baseline models, all from one seed."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from closure_rig.bench import Bench, draw_campaign
from closure_rig.causes import CAUSES, cause
from closure_rig.draw import Case, Kind, Order, Parts, pair
from closure_rig.limit import Strength, size_of
from closure_rig.outside import STRANGERS, stranger
from gateway.diagnosis.effects.catalogue import candidates
from gateway.diagnosis.effects.effect import BaselineModel

NOTHINGS: Final = 300
PAIRS: Final = 100
EACH_EFFECT: Final = 9
EACH_LARGE: Final = 2
EACH_STRANGER: Final = 13
"""Cases of each kind: 333 single effects about their detection limits, 74 of usual sizes, 156 outside the catalogue."""

SINGLE: Final = (0.3, 10.0)
TOGETHER: Final = (3.0, 100.0)
OUTSIDE: Final = (2.0, 60.0)
"""Strengths, in detection limits: of single effects, of those of a pair, and outside the catalogue."""

# Four of five cases from the exact ring, the others from the paper's series.
_MODELS: Final = (BaselineModel.EXACT, BaselineModel.PAPER)
_MODEL_SHARES: Final = (0.8, 0.2)


@dataclass(frozen=True, slots=True)
class Planned:
    """A case to be made.

    Attributes:
        number: in the plan.
        kind: of the case.
        names: effects, in or outside the catalogue.
        strengths: wanted, in detection limits, one an effect; None for the usual large size.
        model: baseline model that the diagnosis starts from.
        seed: of everything else.
    """

    number: int
    kind: Kind
    names: tuple[str, ...]
    strengths: tuple[float | None, ...]
    model: BaselineModel
    seed: int

    @property
    def stem(self) -> str:
        """Name of its folder, which reveals nothing."""
        return f"{self.number:04d}"

    @property
    def stratum(self) -> str:
        """Kind, with large single effects apart."""
        return "large effect" if None in self.strengths else str(self.kind)


def plan(seed: int) -> list[Planned]:
    """Return all cases of a benchmark."""
    rng = np.random.default_rng(seed)
    wanted: list[tuple[Kind, tuple[str, ...], tuple[float | None, ...]]] = []
    for entry in CAUSES:
        wanted += [(Kind.EFFECT, (entry.name,), (size,)) for size in _spread(rng, SINGLE, EACH_EFFECT)]
        wanted += [(Kind.EFFECT, (entry.name,), (None,))] * EACH_LARGE
    for _ in range(PAIRS):
        sizes = np.exp(rng.uniform(math.log(TOGETHER[0]), math.log(TOGETHER[1]), 2))
        wanted.append((Kind.PAIR, pair(rng), (float(sizes[0]), float(sizes[1]))))
    for outsider in STRANGERS:
        wanted += [(Kind.OUTSIDE, (outsider.name,), (size,)) for size in _spread(rng, OUTSIDE, EACH_STRANGER)]
    wanted += [(Kind.NOTHING, (), ())] * NOTHINGS
    cases = []
    for number, (kind, names, strengths) in enumerate(wanted):
        model = _MODELS[int(rng.choice(len(_MODELS), p=_MODEL_SHARES))]
        if kind in (Kind.EFFECT, Kind.PAIR) and not set(names) <= set(candidates(model)):
            model = BaselineModel.EXACT
        cases.append(Planned(number, kind, names, strengths, model, int(rng.integers(2**31))))
    return cases


def sampled(cases: Sequence[Planned], seed: int) -> list[Planned]:
    """Return the cases in an order of which any beginning is a fair sample of every stratum."""
    rng = np.random.default_rng(seed)
    places: dict[int, float] = {}
    for stratum in dict.fromkeys(case.stratum for case in cases):
        selected = [case.number for case in cases if case.stratum == stratum]
        for index, which in enumerate(rng.permutation(len(selected)).tolist()):
            places[selected[which]] = (index + float(rng.random())) / len(selected)
    return sorted(cases, key=lambda case: places[case.number])


def make(planned: Planned) -> Case:
    """Return a planned case with sizes of the wanted strengths."""
    bench, seeds = _drawn(planned)
    outside = planned.kind is Kind.OUTSIDE
    sizes: dict[str, dict[str, Any]] = {}
    if planned.names:
        measure = Strength(bench, Parts(bench, outside=False).case(Order(Kind.NOTHING, planned.seed), {}))
        for name, wanted, seed in zip(planned.names, planned.strengths, seeds, strict=True):
            size, strength = _sized(name, wanted, seed, bench, measure, outside=outside)
            entry = stranger(name) if outside else cause(name)
            sizes[name] = {"value": size, "unit": entry.unit, "strength": strength, "seed": seed}
    return remake(planned, sizes)


def remake(planned: Planned, sizes: Mapping[str, Mapping[str, Any]]) -> Case:
    """Return a planned case with the sizes that its label has."""
    bench, _ = _drawn(planned)
    parts = Parts(bench, outside=planned.kind is Kind.OUTSIDE)
    for name in planned.names:
        parts.add(name, float(sizes[name]["value"]), np.random.default_rng(int(sizes[name]["seed"])))
    order = Order(planned.kind, planned.seed, planned.names)
    return parts.case(order, sizes, number=planned.number, stratum=planned.stratum, model=str(planned.model))


def _drawn(planned: Planned) -> tuple[Bench, list[int]]:
    """Return tire, sensor and runs of a case, and a seed for each of its effects."""
    bench_rng, parts_rng = np.random.default_rng(planned.seed).spawn(2)
    bench = draw_campaign(bench_rng, warm="gain-temperature drift" in planned.names)
    return bench, parts_rng.integers(0, 2**31, len(planned.names)).tolist()


def _sized(
    name: str, wanted: float | None, seed: int, bench: Bench, measure: Strength, *, outside: bool
) -> tuple[float, float]:
    """Return the size of an effect and its strength."""
    strength_of = _strength_of(name, seed, bench, measure, outside=outside)
    if wanted is None:
        large = cause(name).sizes[-1]
        return large, strength_of(large)
    return size_of(name, outside=outside, wanted=wanted, strength=strength_of)


def _strength_of(name: str, seed: int, bench: Bench, measure: Strength, *, outside: bool) -> Callable[[float], float]:
    kind = Kind.OUTSIDE if outside else Kind.EFFECT

    def strength(size: float) -> float:
        alone = Parts(bench, outside=outside)
        alone.add(name, size, np.random.default_rng(seed))
        return measure(alone.case(Order(kind, seed, (name,)), {}))

    return strength


def _spread(rng: np.random.Generator, extent: tuple[float, float], count: int) -> list[float]:
    """Return numbers spread evenly over a range on a logarithmic scale, one at random in each part."""
    low, high = math.log(extent[0]), math.log(extent[1])
    places = (np.arange(count) + rng.random(count)) / count
    result: list[float] = np.exp(low + (high - low) * places).tolist()
    return result
