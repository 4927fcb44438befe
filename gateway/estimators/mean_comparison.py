"""Differences between the means of two recordings, and whether they are more than chance."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from gateway.estimators.weighted_mean import MeanEstimate

FALSE_ALARM: Final = 0.01
"""Probability that any difference of a comparison is called significant where there is none (Bonferroni)."""

Means = Mapping[tuple[str, str], MeanEstimate]
"""Means by wheel and quantity."""


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


def compared_means(first: Means, second: Means) -> list[MeanDifference]:
    """Return the differences of what both recordings have, in the order of the first.

    All errors count as independent. Those of a statement that both share, such as the belt radius, cancel in truth: the
    error of the difference is then too large, and what is significant is so all the more. The scatter alone would not
    do, since some running averages have no end of their memory.

    Args:
        first: means of one recording.
        second: means of the other.

    Returns:
        one for each wheel and quantity; effective degrees of freedom by Welch and Satterthwaite (JCGM 100 G.4.1).
    """
    shared = [key for key in first if key in second]
    level = FALSE_ALARM / max(len(shared), 1)
    return [_compared(*key, first[key], second[key], level) for key in shared]


def _compared(wheel: str, name: str, first: MeanEstimate, second: MeanEstimate, level: float) -> MeanDifference:
    from scipy.stats import norm, t

    difference = second.value - first.value
    std = math.hypot(first.std, second.std)
    significance = difference / std if std > 0.0 else math.nan
    inverse = sum((mean.std / std) ** 4 / mean.freedom for mean in (first, second)) if std > 0.0 else 0.0
    chance = 2.0 * float(t.sf(abs(significance), 1.0 / inverse) if inverse > 0.0 else norm.sf(abs(significance)))
    return MeanDifference(wheel, name, first, second, difference, std, significance, chance < level)
