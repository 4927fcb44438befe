"""One tire through all cases: calibration, runs, judgement."""

import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from independent_tire.steady import NotSteadyError

from gateway.core.errors import ConfigError
from gateway.core.estimates.doubt_rules import EVERY_RULE, DoubtRule
from gateway.core.estimates.tire_data import LoadCalibration
from gateway.forces.tire_fit import TirePoint, fit_load_calibration
from gateway.ring.rolling_ring import RingNotConvergedError
from validity.cases import Case, drawn, named
from validity.finite_elements import record_refereed, refereed_world
from validity.independent import record_rolled, rolled_tires, rolled_world
from validity.judging import Judged, judge
from validity.runs import Run, Store, record, results_of
from validity.statements import LOAD_STD, NotApplicableError, Statement, draw_statement, moved_to
from validity.tires import World, draw_world

Recorder = Callable[[World, Sequence[int]], Run]

# Loads and pressures of the calibration, over the tire's own.
_CALIBRATED: Final = ((0.7, 1.0), (1.0, 1.0), (1.3, 1.0), (1.0, 1.15))
_CALIBRATION_REVOLUTIONS: Final = 24
REVOLUTIONS: Final = 32
# The first revolutions are timed without an average to compare them with.
_SKIPPED: Final = 5
# Of so many tires one has no reference.
_WITHOUT_REFERENCE: Final = 3


@dataclass(frozen=True, slots=True)
class Order:
    """One tire's share of the bench.

    Attributes:
        seed: of the bench.
        tire: number of the tire.
        cases: names of those to run.
        pairs: random pairs of misstatements to run beside them, and as many beside normal errors.
        estimators: to judge.
        store: folder of kept solutions, None for none.
        rolled: folder of kept independent tires; None for tires that are solved.
        refereed: whether finite elements solve them, in place of the exact ring.
        drive: number of the drive; another one has other noise.
    """

    seed: int
    tire: int
    cases: tuple[str, ...]
    estimators: tuple[str, ...]
    store: Path | None = None
    pairs: int = 0
    rolled: Path | None = None
    refereed: bool = False
    drive: int = 0


def judge_tire(order: Order) -> list[Judged]:
    """Return the judged estimates of one tire in all cases, one size each."""
    return [item for told in told_runs(order) for item in told.judged()]


@dataclass(frozen=True, slots=True)
class ToldRun:
    """A run of a case and what is stated of it."""

    order: Order
    case: Case
    size: float
    run: Run
    statement: Statement

    def judged(self, rules: frozenset[DoubtRule] = EVERY_RULE) -> list[Judged]:
        """Return the judged estimates of a gateway with some of the rules of doubt."""
        order = self.order
        results = results_of(self.run, self.statement, order.estimators, rules)
        return [*judge(self.run, self.statement, results, self.case, self.size, order.tire, order.estimators)]


def told_runs(order: Order) -> Iterator[ToldRun]:
    """Yield one tire in all cases; one in which it has no equilibrium is left out."""
    Store.folder = order.store
    plain, record_world = _tire_of(order)
    plain = replace(plain, revolutions=REVOLUTIONS)
    said = draw_statement(plain, np.random.default_rng([order.seed, order.tire, 1]))
    if order.tire % _WITHOUT_REFERENCE == _WITHOUT_REFERENCE - 1:
        said = replace(said, reference=None)
    runs: dict[World, Run] = {}
    calibrations: dict[World, LoadCalibration | None] = {}
    for case in (*named(order.cases), *drawn(order.pairs, order.seed, order.tire)):
        if case.ring_only and (order.rolled is not None or order.refereed):
            continue
        size = case.size(order.seed, order.tire)
        rng = np.random.default_rng([order.seed, order.tire, zlib.crc32(case.name.encode())])
        try:
            world, statement = case.change(plain, said, size, rng)
            if "load" in order.estimators and order.rolled is None:
                tire = _as_calibrated(plain, world)
                if tire not in calibrations:
                    calibrations[tire] = calibration_of(tire, said, order, record_world)
                statement = replace(statement, calibration=calibrations[tire])
            if world not in runs:
                runs = {plain: runs[plain]} if plain in runs else {}
                runs[world] = record_world(
                    world, (order.seed, order.tire, order.drive) if order.drive else (order.seed, order.tire)
                )
            statement.vehicle(world)
        except (RingNotConvergedError, NotApplicableError, NotSteadyError, ConfigError):
            # No such tire stands, or the gateway rejects what is stated of it.
            continue
        yield ToldRun(order, case, size, runs[world], statement)


def _tire_of(order: Order) -> tuple[World, Recorder]:
    """Return the plain tire, and what records a run of it."""
    if order.refereed:
        return refereed_world(order.seed, order.tire), record_refereed
    if order.rolled is None:
        return draw_world(order.seed, order.tire), record
    tires = rolled_tires(order.rolled)
    rolled = tires[order.tire % len(tires)]
    return rolled_world(rolled, order.seed, order.tire), partial(record_rolled, rolled)


def _as_calibrated(plain: World, world: World) -> World:
    """Return the tire that was calibrated before the run: new, cold, and with the sensor that it has."""
    return replace(
        plain,
        damping_nspm2=world.damping_nspm2,
        extension_mn=world.extension_mn,
        tread_mpa=world.tread_mpa,
        offset_m=world.offset_m,
    )


def calibration_of(tire: World, said: Statement, order: Order, record_world: Recorder) -> LoadCalibration | None:
    """Return the load calibration of a tire as `treadlink calibrate` makes it; None where it sees no contact."""
    points: list[TirePoint] = []
    for index, (load, pressure) in enumerate(_CALIBRATED):
        world = replace(
            tire,
            load_n=tire.load_n * load,
            pressure_pa=tire.pressure_pa * pressure,
            revolutions=_CALIBRATION_REVOLUTIONS,
        )
        run = record_world(world, (order.seed, order.tire, 100 + index))
        true = moved_to(replace(said, offset_mm=1e3 * tire.offset_m), tire, world)
        results = results_of(run, true, ("kinematic",))[_SKIPPED:]
        halves = [0.5 * (r.revolution.trailing_edge_rad - r.revolution.leading_edge_rad) for r in results]
        half = float(np.nanmedian(halves)) if np.isfinite(halves).any() else np.nan
        if not half > 0.0:
            return None
        weighed = world.load_n * (1.0 + 0.5 * LOAD_STD * float(np.random.default_rng([order.tire, index]).normal()))
        points.append(TirePoint(str(index), weighed, 0.5 * LOAD_STD * weighed, world.pressure_pa, half, {}))
    return fit_load_calibration(points).calibration
