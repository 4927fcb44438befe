"""Results of consecutive revolutions of one wheel, by revolution and quantity."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property
from itertools import chain, groupby
from operator import itemgetter

import numpy as np

from gateway.core.estimates.estimator import Estimate, Revolution, Status, TireConditions
from gateway.core.estimates.results import RevolutionResult
from gateway.core.reasons import Reason
from gateway.core.types import FloatArray

_NAME, _VALUE, _STD, _STATUS, _REASONS, _SCATTER_STD = map(itemgetter, range(len(Estimate._fields)))


class ResultBlock:
    """Results of k consecutive revolutions of one wheel that have the same q estimates.

    Flat sequences have the q estimates of the first revolution first.

    Attributes:
        results: in order, at least one.
        position: of the wheel.
        names: of the q estimates.
    """

    def __init__(self, results: Sequence[RevolutionResult]) -> None:
        self.results = results
        self.position = results[0].position
        self.names = tuple(map(_NAME, results[0].estimates))

    def __len__(self) -> int:
        return len(self.results)

    @property
    def revolutions(self) -> list[Revolution]:
        """The k revolutions."""
        return [result.revolution for result in self.results]

    @property
    def conditions(self) -> list[TireConditions]:
        """The conditions of each."""
        return [result.conditions for result in self.results]

    @cached_property
    def estimates(self) -> Sequence[Estimate]:
        """The k q estimates, flat."""
        return list(chain.from_iterable(result.estimates for result in self.results))

    @cached_property
    def value(self) -> FloatArray:
        """(k, q) values; NaN where not finite."""
        return self._numbers(_VALUE)

    @cached_property
    def std(self) -> FloatArray:
        """(k, q) standard errors; NaN where not finite."""
        return self._numbers(_STD)

    @cached_property
    def scatter_std(self) -> FloatArray:
        """(k, q) scattering parts; NaN where the standard error is."""
        return np.where(np.isnan(self.std), np.nan, self._numbers(_SCATTER_STD))

    @cached_property
    def constant_std(self) -> FloatArray:
        """(k, q) parts that revolutions share; NaN where the standard error is."""
        constant: FloatArray = np.sqrt(np.maximum(self.std**2 - self.scatter_std**2, 0.0))
        return constant

    @cached_property
    def status(self) -> Sequence[Status]:
        """Status of the k q estimates, flat."""
        return list(map(_STATUS, self.estimates))

    @cached_property
    def reasons(self) -> Sequence[tuple[Reason, ...]]:
        """Reasons of the k q estimates, flat."""
        return list(map(_REASONS, self.estimates))

    def _numbers(self, field: Callable[[Estimate], float]) -> FloatArray:
        shape = len(self), len(self.names)
        numbers = np.fromiter(map(field, self.estimates), np.float64, shape[0] * shape[1]).reshape(shape)
        return np.where(np.isfinite(numbers), numbers, np.nan)


def blocks_of(results: Iterable[RevolutionResult]) -> Iterator[ResultBlock]:
    """Return results as blocks; those of one wheel that follow each other share a block."""
    groups = groupby(results, lambda result: (result.position, *map(_NAME, result.estimates)))
    return (ResultBlock(list(rows)) for _, rows in groups)
