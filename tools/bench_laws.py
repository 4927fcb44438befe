"""Laws from what is left: right kinds, pulls and false laws, on causes that the library's equations did not make.

Four parts: (1) kinds of the library in other forms, (2) causes outside library and catalogue, (3) nothing, (4) what is
left of (1), turned by an angle or scrambled. A case is three recordings, two speeds at one load and a third speed at
another one, of five blocks of 20 revolutions. The set without effects is the base: the cases have none of the
catalogue.

Run: python tools/bench_laws.py [--count 2] [--parts 1,2,3,4] [--seed 1] [--cache DIR] [--cases FILE] [--no-belts]
"""

import argparse
import itertools
import json
import math
import tempfile
import time
from collections.abc import Container, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from accuracy.tables import Table
from law_rig.causes import SENSORS, belt_causes, chain_causes, outside_causes, simulated, through
from law_rig.rolling_in_time import Rolling
from law_rig.unread_causes import unread_belt_causes, unread_chain_causes, unread_outside_causes

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.types import ComplexArray
from gateway.diagnosis.angle.discrepancy import Discrepancy
from gateway.diagnosis.angle.fit import fit_model
from gateway.diagnosis.angle.likelihood import whiten
from gateway.diagnosis.angle.residual import residual_ratio
from gateway.diagnosis.angle.set_evidence import evaluate
from gateway.diagnosis.data.campaign_data import Block, Campaign, Group
from gateway.diagnosis.data.revolution_orders import waveform_orders
from gateway.diagnosis.effects.angle_orders import ORDERS
from gateway.diagnosis.effects.effect import CIRCUMFERENTIAL, LATERAL, RADIAL, BaselineModel, GroupConditions
from gateway.diagnosis.laws.law_search import propose_laws
from gateway.diagnosis.model.baseline_registry import make_core
from gateway.diagnosis.model.closure_model import ClosureModel
from gateway.diagnosis.result import Law
from gateway.ring.rolling_ring import RingParameters, solve_rolling_ring

_RADIUS_M, _PRESSURE_PA = 0.31, 2.2e5
_CONDITIONS: Final = ((60.0, 4500.0), (40.0, 4500.0), (80.0, 3600.0))
_BLOCKS, _REVOLUTIONS, _NODES, _DEPTH_M = 5, 20, 2880, 0.004
_TIRE: Final = RingParameters.from_numbers(
    2.6e-3, 0.21, 2.6, 2.2, radius_m=_RADIUS_M, pressure_pa=_PRESSURE_PA, tread_stiffness_npm2=6e7,
    extension_stiffness_n=1e9,
)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """A case: its cause, the law that is right (empty for none), its size, and the orders of its three recordings.

    Unread: the cause's author had not read the library.
    """

    cause: str
    law: str
    size: float
    orders_mps2: list[ComplexArray]
    unread: bool = False


def conditions() -> list[GroupConditions]:
    """Return the conditions of the recordings."""
    return [
        GroupConditions(kmh / 3.6 / _RADIUS_M, 0.0, _RADIUS_M, load_n, _PRESSURE_PA, 25.0, 25.0, 9600.0, 0.0)
        for kmh, load_n in _CONDITIONS
    ]


class Bench:
    """Draws cases; signals of the belt are simulated once and kept."""

    def __init__(self, cache: Path, *, belts: bool = True) -> None:
        self._cache = cache
        self._belts = (*belt_causes(), *unread_belt_causes()) if belts else ()
        self._conditions = conditions()
        self._half_angle_rad = []
        self._plain = []
        for condition in self._conditions:
            solved = solve_rolling_ring(
                _TIRE, condition.load_n, _PRESSURE_PA, condition.omega_radps, nodes=_NODES, sensor_offset_m=_DEPTH_M
            )
            self._half_angle_rad.append(solved.half_angle_rad)
            along_and_radial = np.zeros((3, _NODES))
            radial, along = solved.sensor.specific_force(condition.omega_radps, gravity_mps2=STANDARD_GRAVITY_MPS2)
            along_and_radial[RADIAL], along_and_radial[CIRCUMFERENTIAL] = radial, along
            self._plain.append(waveform_orders(along_and_radial))

    def _rolling(self, group_conditions: GroupConditions) -> Rolling:
        return Rolling(_TIRE, group_conditions.load_n, _PRESSURE_PA, group_conditions.omega_radps)

    def in_library(self, number: int, rng: np.random.Generator) -> Case:
        """Return a case of a kind in the library in another form."""
        read_chain = chain_causes(rng)
        belt, chain = self._belts, (*read_chain, *unread_chain_causes(rng))
        # The causes in turn, those of chain and belt mixed.
        causes = len(belt) + len(chain)
        which = next(step for step in (5, 7, 1) if math.gcd(step, causes) == 1) * number % causes
        if which < len(chain):
            cause = chain[which]
            orders = [through(cause.fault, o, h) for o, h in zip(self._plain, self._conditions, strict=True)]
            return Case(cause.name, cause.law, cause.size, orders, which >= len(read_chain))
        belt_cause = belt[which - len(chain)]
        unread = which - len(chain) >= len(belt_causes())
        sensor, factor = int(rng.integers(SENSORS)), rng.uniform(0.4, 1.0)
        orders = []
        for plain, condition in zip(self._plain, self._conditions, strict=True):
            rolling = self._rolling(condition)
            with_it = simulated(belt_cause.change, rolling, _DEPTH_M, self._cache, belt_cause.name.replace(" ", "_"))[
                sensor
            ]
            change = with_it - simulated(None, rolling, _DEPTH_M, self._cache, "nothing")[sensor]
            read = plain.copy()
            read[[RADIAL, CIRCUMFERENTIAL]] += factor * condition.omega_radps**2 * change
            orders.append(read)
        return Case(belt_cause.name, belt_cause.law, factor * belt_cause.size, orders, unread)

    def outside(self, number: int, rng: np.random.Generator) -> Case:
        """Return a case outside library and catalogue."""
        read = outside_causes(rng)
        causes = (*read, *unread_outside_causes(rng))
        which = number % len(causes)
        name, fault = causes[which]
        orders = [through(fault, o, h) for o, h in zip(self._plain, self._conditions, strict=True)]
        return Case(name, "", math.nan, orders, which >= len(read))

    def nothing(self, number: int, rng: np.random.Generator) -> Case:  # noqa: ARG002 - alike
        """Return a case without anything."""
        return Case("nothing", "", math.nan, [orders.copy() for orders in self._plain])

    def turned(self, number: int, rng: np.random.Generator) -> Case:
        """Return a case of the library whose cause is turned or scrambled, alike in all recordings."""
        case = self.in_library(number, rng)
        order = np.arange(ORDERS)
        if number % 2:
            factor, name = np.exp(-1j * order * rng.uniform(0.3, 2.0 * math.pi - 0.3)), "turned"
        else:
            factor, name = np.exp(1j * rng.uniform(0.0, 2.0 * math.pi, ORDERS)), "scrambled"
            factor[0] = 1.0
        orders = [p + factor * (o - p) for o, p in zip(case.orders_mps2, self._plain, strict=True)]
        return Case(f"{name}: {case.cause}", "", math.nan, orders, case.unread)

    def campaign(self, case: Case, rng: np.random.Generator) -> Campaign:
        """Return the recordings of a case with noise."""
        noise = math.exp(rng.uniform(math.log(0.4), math.log(2.0)))
        variance = np.full((3, ORDERS), noise**2)
        variance[LATERAL] = math.nan
        groups = []
        for index, (condition, truth) in enumerate(zip(self._conditions, case.orders_mps2, strict=True)):
            blocks = []
            for _ in range(_BLOCKS):
                real, imaginary = rng.normal(0.0, noise / math.sqrt(_REVOLUTIONS), (2, 3, ORDERS))
                imaginary[:, 0] = 0.0
                orders = truth + real + 1j * imaginary
                orders[LATERAL] = complex(math.nan, math.nan)
                blocks.append(Block(_REVOLUTIONS, condition, orders))
            state = [4500.0, 3600.0].index(condition.load_n)
            half = self._half_angle_rad[index]
            group = Group(f"run {index + 1}", index, state, condition, tuple(blocks), variance, half)
            groups.append(replace(group, declared_offset_m=_DEPTH_M))
        return Campaign("W", tuple(group.label for group in groups), tuple(groups), 2, {})


def judged(campaign: Campaign) -> tuple[tuple[Law, ...], float, float]:
    """Return the laws of a campaign, CPU seconds of the search, and the power left over that of the noise."""
    core = make_core(BaselineModel.EXACT)
    data = whiten(campaign, core)
    model = ClosureModel(campaign, core)
    fit = fit_model(model, data, model.priors()[0], from_afar=True)
    base = evaluate(fit, data, Discrepancy(campaign, data), None)
    started = time.process_time()
    laws = propose_laws(base, data).laws
    return laws, time.process_time() - started, residual_ratio(base.fit, data)


def outcomes(
    bench: Bench, parts: list[int], count: int, seed: int, done: Container[tuple[int, int, int]] = ()
) -> Iterator[dict[str, Any]]:
    """Yield the outcome of every case, the parts in turn, less those done: seed, part and number of each."""
    draws = {1: bench.in_library, 2: bench.outside, 3: bench.nothing, 4: bench.turned}
    for number in range(count):
        for part in parts:
            if (seed, part, number) in done:
                continue
            rng = np.random.default_rng([seed, part, number])
            case = draws[part](number, rng)
            laws, cpu_s, ratio = judged(bench.campaign(case, rng))
            yield {"seed": seed, "number": number, **_outcome(part, case, laws, cpu_s, ratio)}


def _outcome(part: int, case: Case, laws: tuple[Law, ...], cpu_s: float, ratio: float) -> dict[str, Any]:
    told: dict[str, Any] = {
        "part": part,
        "cause": case.cause,
        "unread": case.unread,
        "right": case.law,
        "left": ratio,
        "cpu_s": cpu_s,
    }
    if not laws:
        return {**told, "said": ""}
    law = laws[0]
    fitted = next(iter(law.parameters.values()))
    size, std = fitted.value, fitted.std
    if "cosine_m" in law.parameters:
        other = law.parameters["sine_m"]
        size = math.copysign(math.hypot(size, other.value), case.size)
    rises = max((check.after_mps2 / check.before_mps2 for check in law.unseen), default=math.nan)
    return {
        **told,
        "said": law.name,
        "certain": law.certain,
        "reasons": [str(reason.code) for reason in law.reasons],
        "size": float(size),
        "std": float(std),
        "truth": float(case.size),
        "pull": float((size - case.size) / std) if law.name == case.law else math.nan,
        "share": law.share,
        "log_odds": law.log_odds,
        "rise": rises,
    }


def summary(cases: list[dict[str, Any]]) -> tuple[Table, Table]:
    """Return the tables: by part, and by kind for those of the library."""
    rows = []
    titles = {1: "library, other forms", 2: "outside", 3: "nothing", 4: "turned, scrambled"}
    for (part, title), unread in itertools.product(titles.items(), (False, True)):
        selected = [case for case in cases if case["part"] == part and (case["unread"] and part == 1) is unread]
        if not selected:
            continue
        laws = [case for case in selected if case["said"] and case["certain"]]
        clues = [case for case in selected if case["said"] and not case["certain"]]
        right, hints = (sum(case["said"] == case["right"] for case in some) for some in (laws, clues))
        cpu = float(np.median([case["cpu_s"] for case in selected]))
        nothing = len(selected) - len(laws) - len(clues)
        title += ", unread" if unread else ""
        rows.append((title, *map(str, (len(selected), len(laws), right, len(clues), hints, nothing)), f"{cpu:.1f}"))
    heads = ("part", "cases", "laws", "right in kind", "clues", "right", "nothing", "CPU s")
    parts = Table("Laws", "CPU is the median of the search.", heads, tuple(rows))
    kinds = []
    for law in sorted({case["right"] for case in cases if case["right"]}):
        selected = [case for case in cases if case["right"] == law and case["part"] == 1]
        certain = [case for case in selected if case["said"] and case["certain"]]
        hits = [case for case in certain if case["said"] == law]
        sized = [case for case in hits if math.isfinite(case["truth"])]
        ratio = f"{np.median([case['size'] / case['truth'] for case in sized]):.3f}" if sized else "-"
        rms = f"{math.sqrt(np.mean([case['pull'] ** 2 for case in sized])):.2f}" if sized else "-"
        kinds.append((law.removeprefix("law: "), *map(str, (len(selected), len(certain), len(hits))), ratio, rms))
    by_kind = ("kind", "cases", "laws", "right", "size over truth", "rms of pulls")
    return parts, Table("Kinds", "Cases of part 1; sizes of right laws.", by_kind, tuple(kinds))


def main() -> None:
    """Run the cases and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=2, help="cases of each part")
    parser.add_argument("--parts", default="1,2,3,4")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cache", type=Path, default=Path(tempfile.gettempdir()) / "treadlink-laws")
    parser.add_argument("--no-belts", action="store_true", help="of the library, errors of the sensor chain alone")
    parser.add_argument(
        "--cases", type=Path, help="file of outcomes, a JSON object a line: read, not run again, and added to"
    )
    chosen = parser.parse_args()
    bench = Bench(chosen.cache, belts=not chosen.no_belts)
    parts = [int(part) for part in chosen.parts.split(",")]
    results = []
    if chosen.cases is not None and chosen.cases.is_file():
        lines = map(json.loads, chosen.cases.read_text(encoding="utf-8").splitlines())
        results = [case for case in lines if case["seed"] == chosen.seed and case["part"] in parts]
    done = {(case["seed"], case["part"], case["number"]) for case in results}
    for case in outcomes(bench, parts, chosen.count, chosen.seed, done):
        results.append(case)
        if chosen.cases is not None:
            with chosen.cases.open("a", encoding="utf-8") as file:
                file.write(json.dumps(case) + "\n")
    for table in summary(results):
        print(table.text(markdown=True))


if __name__ == "__main__":
    main()
