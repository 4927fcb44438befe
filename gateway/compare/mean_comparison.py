"""Differences between the means of two recordings, and whether they are more than chance."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple, Self

from gateway.core.estimates.estimator import TireConditions
from gateway.core.estimates.weighted_mean import MeanEstimate
from gateway.core.quantity import Basis
from gateway.core.quantity_catalogue import quantity_of

FALSE_ALARM: Final = 0.01
"""Probability that any difference of a comparison is called significant where there is none (Bonferroni)."""

Means = Mapping[tuple[str, str], MeanEstimate]
"""Means by wheel and quantity."""


class Radius(NamedTuple):
    """Belt radius of a wheel that a recording rests on, and its standard error, m."""

    value: float
    std: float

    @classmethod
    def of(cls, conditions: TireConditions) -> Self:
        """Return the one in use."""
        return cls(conditions.radius_m, conditions.radius_std_m)


@dataclass(frozen=True, slots=True)
class MeanDifference:
    """A quantity of one wheel in two recordings.

    Attributes:
        wheel: position.
        name: quantity, with its unit.
        first: mean in the first recording.
        second: mean in the second one.
        difference: second less first.
        std: its standard error; NaN where it is not known.
        significance: difference over its error; NaN where that is not known.
        is_significant: whether chance hardly makes any difference of the comparison as large.
    """

    wheel: str
    name: str
    first: MeanEstimate
    second: MeanEstimate
    difference: float
    std: float
    significance: float
    is_significant: bool


def compared_means(
    first: Means,
    second: Means,
    first_radii: Mapping[str, Radius] | None = None,
    second_radii: Mapping[str, Radius] | None = None,
) -> list[MeanDifference]:
    """Return the differences of what both recordings have, in the order of the first.

    An error of the belt radius changes both means alike where both rest on the same one: of it, a difference has what
    it has itself (JCGM 100 F.1.2.3). All other errors count as independent, since load, pressure and even the sensor
    may be others; where they are not, what is significant is so all the more. The scatter alone would not do, since
    some running averages have no end of their memory.

    Args:
        first: means of one recording.
        second: means of the other.
        first_radii: belt radius of each wheel in the first recording; None where not known.
        second_radii: likewise in the second one.

    Returns:
        one for each wheel and quantity; effective degrees of freedom by Welch and Satterthwaite (JCGM 100 G.4.1).
    """
    common_keys = [key for key in first if key in second]
    level = FALSE_ALARM / max(len(common_keys), 1)
    radii = {
        wheel: min(radius.std, (second_radii or {})[wheel].std) / radius.value
        for wheel, radius in (first_radii or {}).items()
        if (second_radii or {}).get(wheel, Radius(math.nan, 0.0)).value == radius.value
    }
    return [_compared(*key, first[key], second[key], radii.get(key[0], 0.0), level) for key in common_keys]


def _compared(
    wheel: str, name: str, first: MeanEstimate, second: MeanEstimate, radius_std: float, level: float
) -> MeanDifference:
    from scipy.stats import norm, t

    difference = second.value - first.value
    common = math.prod(_by_radius(name, mean, radius_std) for mean in (first, second)) if radius_std else 0.0
    std = math.sqrt(max(first.std**2 + second.std**2 - 2.0 * common, 0.0))
    significance = difference / std if std > 0.0 else math.nan
    inverse = sum((mean.std / std) ** 4 / mean.freedom for mean in (first, second)) if std > 0.0 else 0.0
    chance = 2.0 * float(t.sf(abs(significance), 1.0 / inverse) if inverse > 0.0 else norm.sf(abs(significance)))
    return MeanDifference(wheel, name, first, second, difference, std, significance, chance < level)


def _by_radius(name: str, mean: MeanEstimate, radius_std: float) -> float:
    """Return the change of a mean by a relative standard error of the radius, no more than its constant part."""
    quantity = quantity_of(name)
    change = quantity.powers.get(Basis.RADIUS, 0.0) * (mean.value - quantity.origin) * radius_std
    return max(-mean.constant_std, min(change, mean.constant_std)) if math.isfinite(mean.constant_std) else 0.0
