"""Scans of the candidates: trials of all effects that a set can take, shared among this process and others.

A trial depends on its fit alone. The processes take the effects of a scan one by one from a common counter, so that
none waits while another works, and the result does not depend on which of them made a trial.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, TypeVar

import numpy as np

from gateway.core.types import FloatArray
from gateway.core.worker_pool import SharedNumbers, Workers, shared_counters
from gateway.diagnosis.angle.candidate_trial import Trial, shapes_of, try_effect
from gateway.diagnosis.angle.discrepancy import Applied, Discrepancy
from gateway.diagnosis.angle.discrepancy_kernels import Concentration
from gateway.diagnosis.angle.fit import Fit, Linearisation
from gateway.diagnosis.angle.likelihood import Whitened
from gateway.diagnosis.data.campaign_data import Campaign
from gateway.diagnosis.effects.effect import BaselineModel
from gateway.diagnosis.effects.local_effects import LocalChange
from gateway.diagnosis.model.baseline import Core, NoShapeError, Shape
from gateway.diagnosis.model.baseline_registry import make_core
from gateway.diagnosis.model.closure_model import AngleEffect, ClosureModel

_Result = TypeVar("_Result")


class _Values(NamedTuple):
    """A trial without its effect and model."""

    start: FloatArray
    vector: FloatArray
    cost: float
    promise: float


@dataclass(frozen=True, slots=True)
class _Material:
    """Constants of a search, which another process receives once."""

    campaign: Campaign
    model: BaselineModel
    data: Whitened
    effects: Mapping[str, AngleEffect]
    discrepancy: Discrepancy


@dataclass(frozen=True, slots=True)
class _Order:
    """A scan as another process receives it: the fit without the constants of the search.

    Attributes:
        scan: number of its counter.
        names: candidates.
        effects: names of those in the fit.
        fit: derivatives and residual, weighted.
        shapes: of the belt in the groups in which effects are tried.
        amplitudes: of the discrepancy; None without.
        concentrations: of the discrepancy.
    """

    scan: int
    names: tuple[str, ...]
    effects: tuple[str, ...]
    fit: Linearisation
    shapes: Mapping[int, Shape]
    amplitudes: FloatArray | None
    concentrations: tuple[Concentration, ...]


class Scan:
    """Trials of candidates on one fit, begun in other processes if there are any."""

    def __init__(self, fit: Fit, effects: Sequence[AngleEffect], groups: Sequence[int]) -> None:
        """Take what the trials depend on.

        Args:
            fit: of a set of effects.
            effects: candidates.
            groups: indices of the groups in which they are tried.
        """
        self.fit = fit
        self._candidates = tuple(effects)
        # The longest trials first: one that is begun last keeps the others waiting.
        self.effects = tuple(sorted(effects, key=lambda effect: (-effect.refinements, -_starts(fit, effect))))
        self.shapes: Mapping[int, Shape] = {}
        self._counters: SharedNumbers | None = None
        self._number = 0
        self._remote_futures: set[Future[dict[int, _Values | None]]] = set()
        try:
            self.shapes = shapes_of(fit, groups)
        except (NoShapeError, np.linalg.LinAlgError):
            self.effects = ()

    def is_of(self, fit: Fit, effects: Sequence[AngleEffect]) -> bool:
        """Return whether this is the scan of a fit with these candidates."""
        return fit is self.fit and list(effects) == list(self._candidates)

    def share(
        self, counters: SharedNumbers, number: int, elsewhere: Iterable[Future[dict[int, _Values | None]]]
    ) -> None:
        """Share the work with other processes that take from the same counter."""
        self._counters, self._number, self._remote_futures = counters, number, set(elsewhere)

    def trials(self, expired: Callable[[], bool] = lambda: False) -> list[Trial]:
        """Return the successful trials, the best promise first, then by name; none where the time is over before all.

        Args:
            expired: True when the time is over.
        """
        trial_of: dict[int, Trial | None] = {}
        while (index := self._next(len(trial_of))) < len(self.effects):
            if expired():
                return []
            trial_of[index] = try_effect(self.fit, self.effects[index], self.shapes)
        while len(trial_of) < len(self.effects):
            done, self._remote_futures = wait(self._remote_futures, return_when=FIRST_COMPLETED)
            for future in done:
                for number, values in future.result().items():
                    trial_of[number] = None if values is None else self._trial(self.effects[number], values)
        trials = [trial for trial in trial_of.values() if trial is not None]
        return sorted(trials, key=lambda trial: (-trial.promise, trial.effect.name))

    def _next(self, own_count: int) -> int:
        return own_count if self._counters is None else self._counters.take(self._number)

    def _trial(self, effect: AngleEffect, values: _Values) -> Trial:
        model = ClosureModel(self.fit.model.campaign, self.fit.model.core, (*self.fit.model.effects, effect))
        return Trial(effect, model, *values)


class Helpers:
    """Other processes that make trials while this one evaluates sets."""

    def __init__(self, workers: Workers) -> None:
        """Take the other processes, which may have done other work before."""
        self._workers = workers

    def begin(
        self,
        campaign: Campaign,
        core: Core,
        data: Whitened,
        effects: Mapping[str, AngleEffect],
        discrepancy: Discrepancy,
    ) -> None:
        """Give the processes what a search works on.

        Args:
            campaign: conditions.
            core: baseline model.
            data: whitened.
            effects: candidates by name.
            discrepancy: of the campaign, not concentrated.
        """
        material = _Material(campaign, core.model, data, effects, discrepancy)
        for worker in self._workers.each:
            worker.submit(_receive, material)

    def ahead(self, work: Callable[[Campaign], _Result], campaign: Campaign) -> Callable[[], _Result]:
        """Begin work on the campaign of the search in another process; return a function for its result.

        Args:
            work: a function of a module. Without other processes it is called when its result is asked for.
            campaign: of the search.
        """
        worker = next(iter(self._workers.each), None)
        return partial(work, campaign) if worker is None else worker.submit(_run_on_campaign, work).result

    def scan(self, fit: Fit, effects: Sequence[AngleEffect], groups: Sequence[int]) -> Scan:
        """Return a scan, begun in the other processes."""
        scan = Scan(fit, effects, groups)
        # The answer that a change at one place holds is this process's own.
        local = any(isinstance(effect, LocalChange) for effect in fit.model.effects)
        number = self._workers.new_counter() if scan.effects and not local else None
        if number is not None:
            order = _order_of(number, scan)
            futures = [worker.submit(_trial_values, order) for worker in self._workers.each]
            scan.share(self._workers.counters, number, futures)
        return scan


def _starts(fit: Fit, effect: AngleEffect) -> int:
    return len(effect.starts(tuple(group.conditions for group in fit.model.campaign.groups)))


def _order_of(number: int, scan: Scan) -> _Order:
    applied = scan.fit.applied
    return _Order(
        number,
        tuple(effect.name for effect in scan.effects),
        tuple(effect.name for effect in scan.fit.model.effects),
        scan.fit.linearisation(scan.shapes),
        scan.shapes,
        None if applied is None else applied.amplitudes,
        () if applied is None else applied.discrepancy.concentrations,
    )


class _Helper:
    """What another process has of a search."""

    def __init__(self, material: _Material) -> None:
        self.material = material
        self._core = make_core(material.model)
        self._discrepancy = material.discrepancy
        self._applied: list[Applied] = []

    def fit(self, order: _Order) -> Fit:
        """Return the fit of an order."""
        material = self.material
        model = ClosureModel(material.campaign, self._core, [material.effects[name] for name in order.effects])
        return Fit.of(order.fit, model, material.data, self._apply(order))

    def _apply(self, order: _Order) -> Applied | None:
        """Return the discrepancy of an order; the last ones are kept, since several scans have the same."""
        if order.amplitudes is None:
            return None
        if self._discrepancy.concentrations != order.concentrations:
            self._discrepancy = self.material.discrepancy
            for concentration in order.concentrations:
                self._discrepancy = self._discrepancy.concentrated(concentration)
            self._applied.clear()
        for applied in self._applied:
            if np.array_equal(applied.amplitudes, order.amplitudes):
                return applied
        self._applied = [self._discrepancy.applied(order.amplitudes), *self._applied[:1]]
        return self._applied[0]


_helper: _Helper | None = None


def _receive(material: _Material) -> None:
    """Take, in another process, the constants of a search."""
    global _helper
    _helper = _Helper(material)


def _run_on_campaign(work: Callable[[Campaign], _Result]) -> _Result:
    assert _helper is not None
    return work(_helper.material.campaign)


def _trial_values(order: _Order) -> dict[int, _Values | None]:
    """Return, in another process, the trials of the effects that are left to take, by their place."""
    assert _helper is not None
    counters = shared_counters()
    values_of: dict[int, _Values | None] = {}
    fit: Fit | None = None
    while (index := counters.take(order.scan)) < len(order.names):
        fit = _helper.fit(order) if fit is None else fit
        trial = try_effect(fit, _helper.material.effects[order.names[index]], order.shapes)
        values_of[index] = None if trial is None else _Values(trial.start, trial.vector, trial.cost, trial.promise)
    return values_of
