"""Mean of an estimate over revolutions, with its standard uncertainty in the terms of JCGM 100."""

import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import Final

from gateway.core.estimates.reasons import EstimateCode
from gateway.core.reasons import Reason

_UNEXPLAINED: Final = 3.0
"""Scatter over the standard error from which errors do not explain it."""


class WeightedMean:
    """Mean of values with standard errors, weighted by these, in constant memory.

    Revolutions share most of their error: a running average, the belt radius, the load. Its standard error is therefore
    the weighted mean of the errors, sum(w s) / sum(w) with w = 1 / s^2, as for errors that are fully correlated. Where
    the scattering parts of the errors are known, `constant_std` is that of the constant parts alone.

    Values that scatter far more than their errors differ by more than these: driving changes the quantity. Their mean
    is then not weighted, since errors that change with the quantity would draw it to one side, and its standard error
    contains the scatter.

    Attributes:
        count: number of values.
    """

    def __init__(self) -> None:
        self.count = 0
        self._weight = self._weighted_mean = self._weighted_std = self._weighted_constant = self._scatter_square = 0.0
        self._mean = self._squares = 0.0
        self._has_errors = True

    def add(self, value: float, std: float, scatter_std: float = 0.0) -> None:
        """Take a finite value; one without a usable error makes the mean an unweighted one without error.

        Args:
            value: of one revolution.
            std: its standard error.
            scatter_std: the part of it that scatters; 0 where not known.
        """
        self.count += 1
        step = value - self._mean
        self._mean += step / self.count
        self._squares += step * (value - self._mean)
        if std > 0.0 and math.isfinite(std):
            weight = 1.0 / (std * std)
            self._weight += weight
            # By steps: equal values have their own value as the mean, to the last digit.
            self._weighted_mean += weight / self._weight * (value - self._weighted_mean)
            self._weighted_std += weight * std
            self._weighted_constant += weight * math.sqrt(max(std * std - scatter_std * scatter_std, 0.0))
            self._scatter_square += scatter_std * scatter_std
        else:
            self._has_errors = False

    @property
    def value(self) -> float | None:
        """The mean, None without a value."""
        if not self.count:
            return None
        is_weighted = self._stated_std is not None and not self.varies
        mean = self._weighted_mean if is_weighted else self._mean
        return mean if math.isfinite(mean) else None

    @property
    def std(self) -> float | None:
        """Standard error of the mean, None when it is not known."""
        std = self._stated_std
        return math.hypot(std, self.scatter or 0.0) if std is not None and self.varies else std

    @property
    def _stated_std(self) -> float | None:
        if not self.count or not self._has_errors or not self._weight > 0.0:
            return None
        std = self._weighted_std / self._weight
        return std if math.isfinite(std) else None

    @property
    def varies(self) -> bool:
        """Whether the values scatter far more than their errors explain, and `std` contains the scatter."""
        std, scatter = self._stated_std, self.scatter
        return std is not None and scatter is not None and scatter > _UNEXPLAINED * std

    @property
    def reasons(self) -> tuple[Reason, ...]:
        """What is to be known of the mean: that its values vary."""
        return (Reason(EstimateCode.ROW_SCATTERS),) if self.varies else ()

    @property
    def constant_std(self) -> float | None:
        """Part of `std` that revolutions share."""
        return None if self.std is None else self._weighted_constant / self._weight

    @property
    def stated_scatter(self) -> float:
        """Root mean square scattering part of the values' errors, 0 where none is known."""
        return math.sqrt(self._scatter_square / self.count) if self.count else 0.0

    @property
    def scatter(self) -> float | None:
        """Standard deviation between the values, None of less than two."""
        return math.sqrt(self._squares / (self.count - 1)) if self.count > 1 else None


@dataclass(frozen=True, slots=True)
class MeanEstimate:
    """Mean of a quantity over revolutions.

    Attributes:
        value: weighted mean; where the values vary, the mean.
        std: combined standard uncertainty of the mean.
        constant_std: its part that averaging does not make smaller: the weighted mean of the constant parts of the
            errors of the revolutions (radius, load, gains).
        scatter_std: its part from the scatter of the revolutions: `scatter` (type A) or the scattering part of their
            errors, whichever is larger, over the root of `independent`; all of `scatter` where the values vary.
        scatter: standard deviation of one revolution.
        count: number of revolutions.
        independent: how many independent values these are; a running average hands on most of a value.
        freedom: effective degrees of freedom of `std` (Welch and Satterthwaite, JCGM 100 G.4.1); infinite where the
            shared part rules.
        reasons: that the values vary by far more than their errors, if so.
    """

    value: float
    std: float
    constant_std: float
    scatter_std: float
    scatter: float
    count: int
    independent: float
    freedom: float
    reasons: tuple[Reason, ...] = ()

    def expanded(self, probability: float = 0.95) -> tuple[float, float]:
        """Return the expanded uncertainty of the mean, and its coverage factor.

        Args:
            probability: that the interval value +- uncertainty contains the quantity.

        Returns:
            (uncertainty, factor): the factor is Student's t of `freedom` (JCGM 100 G.3).

        Raises:
            ValueError: the probability is not within 0 and 1.
        """
        factor = coverage_factor(probability, self.freedom)
        return factor * self.std, factor


def coverage_factor(probability: float, freedom: float = math.inf) -> float:
    """Return the factor of the expanded uncertainty: Student's t of the degrees of freedom (JCGM 100 G.3).

    Args:
        probability: that value +- factor * std contains the quantity.
        freedom: of the standard uncertainty; infinite of a normal distribution.

    Raises:
        ValueError: the probability is not within 0 and 1.
    """
    if not 0.0 < probability < 1.0:
        raise ValueError(f"a coverage probability is within 0 and 1, not {probability}")
    tail = 0.5 * (1.0 + probability)
    if math.isinf(freedom):
        return NormalDist().inv_cdf(tail)
    from scipy.stats import t

    return float(t.ppf(tail, freedom))


def mean_estimate(mean: WeightedMean, memory_revolutions: float = 0.0) -> MeanEstimate:
    """Return the mean with its uncertainty.

    Args:
        mean: of at least one value.
        memory_revolutions: time constant of the running average that the values come from, 0 without one.

    Returns:
        NaN for parts that are not known: without errors, or of a single value.
    """
    independent = max(mean.count / max(2.0 * memory_revolutions, 1.0), 1.0)
    scatter = math.nan if mean.scatter is None else mean.scatter
    constant_std = math.nan if mean.constant_std is None else mean.constant_std
    observed, error_scatter = (0.0 if math.isnan(scatter) else scatter), mean.stated_scatter
    scatter_std = observed if mean.varies else max(observed, error_scatter) / math.sqrt(independent)
    std = math.hypot(constant_std, scatter_std)
    freedom = math.inf
    # An error that is stated is taken as known.
    if independent > 1.0 and observed > error_scatter:
        freedom = (std / scatter_std) ** 4 * (independent - 1.0)
    return MeanEstimate(
        value=math.nan if mean.value is None else mean.value,
        std=std,
        constant_std=constant_std,
        scatter_std=scatter_std,
        scatter=scatter,
        count=mean.count,
        independent=independent,
        freedom=freedom,
        reasons=mean.reasons,
    )
