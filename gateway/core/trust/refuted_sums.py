"""Gain and zero-g offset of the radial axis from the running sums of means and of gravity, each with its error.

`gateway.core.trust.self_calibration` has the two equations. What all revolutions together say against a statement, and
the latest ones clearly do not, came from revolutions that were no evidence: a spell of wrong contacts or of a disturbed
axis. The sums then start again from the latest revolutions (`is_refuted`).
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from gateway.core.estimates.disagreement import CONTRADICTION
from gateway.core.quantity import LARGEST_ZERO_MPS2

# Closure of the belt, relative to the steady value, and its stretch: both limit the gain from gravity.
_CLOSURE_STD: Final = 1.5e-4
# Change of the closure's order 1, over the mean, per sensor offset over the belt radius: 0.07 to 0.22 on random tires.
_CLOSURE_BY_DEPTH: Final = 0.2
_STRETCH_STD: Final = 3e-4
# Relative error of the steady value that may go with the speed: the belt's shape and the sensor's offset, which the
# mean depends on, are known better from revolution to revolution, and the sensor warms up.
_MEAN_SPEED_ERROR: Final = 4e-5
# Standard errors by which gravity must speak for another gain where the steady value is as expected, and its least
# error: order 1 of the wheel's own vibration looks like gravity.
GRAVITY_ALONE: Final = 5.0
LEAST_GRAVITY_ERROR: Final = 0.3
ZERO_MEASURED: Final = 0.3
"""Share of its stated error below which the zero-g offset counts as measured."""
# Standard errors within which the latest revolutions agree with a statement: less than those of a contradiction, so
# that one at the limit does not come and go.
_AGREEMENT_ERRORS: Final = 2.0
# Share of a zero-g offset that a mean must lack.
_LACKING_SHARE: Final = 0.5


class Equations(NamedTuple):
    """Normal equations of two unknowns: ((aa, ab), (ab, bb)) and (a, b)."""

    aa: float = 0.0
    ab: float = 0.0
    bb: float = 0.0
    a: float = 0.0
    b: float = 0.0


class Value(NamedTuple):
    """A value and its standard error."""

    value: float
    std: float


class SpeedErrors(NamedTuple):
    """Errors of the relative steady value and of the zero-g offset that means at different speeds share."""

    gain: float
    zero_mps2: float


def speed_errors(equations: Equations) -> SpeedErrors:
    """Return the errors by a relative error of the steady value that goes with the speed.

    A steady value that is wrong in proportion to its deviation from its mean looks like a zero-g offset.

    Args:
        equations: `Measured.by_mean`, of at least one revolution.

    Returns:
        The errors; infinite at one speed.
    """
    mean = equations.ab / equations.bb
    spread2 = equations.aa / equations.bb - mean * mean
    if not spread2 > 1e-12 * mean * mean:
        return SpeedErrors(math.inf, math.inf)
    gain = _MEAN_SPEED_ERROR * abs(mean) / math.sqrt(spread2)
    return SpeedErrors(gain, gain * abs(mean))


def first_of(equations: Equations, other_std: float) -> tuple[float, float, float] | None:
    """Return the first unknown, its variance and its covariance with the second, which is 0 within `other_std`."""
    bb = equations.bb + other_std**-2.0
    determinant = equations.aa * bb - equations.ab * equations.ab
    if not determinant > 0.0:
        return None
    value = (bb * equations.a - equations.ab * equations.b) / determinant
    return value, bb / determinant, -equations.ab / determinant


def steady_ratio(equations: Equations, zero_std_mps2: float) -> Value | None:
    """Return measured over expected steady value, without the errors of gain, radius and rate."""
    if not equations.aa > 0.0:
        return None
    solved = first_of(equations, max(zero_std_mps2, 1e-3))
    if solved is None:
        return None
    zero = (equations.b - equations.ab * solved[0]) / (equations.bb + max(zero_std_mps2, 1e-3) ** -2.0)
    if abs(zero) > max(LARGEST_ZERO_MPS2, CONTRADICTION * zero_std_mps2):
        # No sensor has it: a few means do not belong to their speeds. All means together have the stated zero.
        std = math.hypot(equations.aa**-0.5, zero_std_mps2 * equations.ab / equations.aa)
        return Value(1.0 + equations.a / equations.aa, std)
    return Value(1.0 + solved[0], math.sqrt(solved[1]))


def zero_offset(equations: Equations, zero_std_mps2: float) -> Value | None:
    """Return the zero-g offset that means at different speeds give, None where there is only one speed or none fits."""
    aa, ab, bb, a, b = equations
    if not aa > 0.0:
        return None
    determinant = aa * bb - ab * ab
    if not determinant > 1e-9 * aa * bb:
        return None
    std = math.hypot(math.sqrt(aa / determinant), speed_errors(equations).zero_mps2)
    value = (aa * b - ab * a) / determinant
    # One that no sensor has is no measurement: a few means do not belong to their speeds.
    return Value(value, std) if abs(value) <= max(LARGEST_ZERO_MPS2, CONTRADICTION * zero_std_mps2) else None


def gravity_gain(equations: Equations, depth: float) -> Value | None:
    """Return the gain from gravity; `depth` is the standard error of the sensor's offset over the belt radius."""
    if not equations.aa > 0.0:
        return None
    solved = first_of(equations, _STRETCH_STD)
    if solved is None:
        return None
    value, variance, covariance = solved
    by_closure = variance * equations.ab + covariance * equations.bb
    closure = by_closure * math.hypot(_CLOSURE_STD, _CLOSURE_BY_DEPTH * depth)
    return Value(1.0 + value, math.hypot(math.sqrt(variance), closure))


class Comparison(NamedTuple):
    """A measured value less the stated one, and the error of either; `is_certain` where it says something."""

    difference: float
    std: float
    stated_std: float
    is_certain: bool

    def is_beyond(self, errors: float) -> bool:
        """Return whether it is certain, and the difference beyond so many standard errors of both."""
        return self.is_certain and abs(self.difference) > errors * math.hypot(self.std, self.stated_std)


_NO_COMPARISON: Final = Comparison(0.0, math.inf, 0.0, is_certain=False)


def contradicted(
    by_mean: Equations, by_gravity: Equations, steady_std: float, gain_std: float, zero_std_mps2: float
) -> tuple[Comparison, Comparison, Comparison]:
    """Return the comparisons of steady value, zero-g offset and gravity with their statements.

    Args:
        by_mean: sums of the means.
        by_gravity: sums of gravity.
        steady_std: relative error of the steady value by the stated radius, gain and rate.
        gain_std: relative error of the stated gain.
        zero_std_mps2: of the stated zero-g offset.
    """
    least_std = LEAST_GRAVITY_ERROR / CONTRADICTION
    return (
        _compared(steady_ratio(by_mean, zero_std_mps2), 1.0, steady_std, math.inf),
        _compared(zero_offset(by_mean, zero_std_mps2), 0.0, zero_std_mps2, ZERO_MEASURED * zero_std_mps2),
        _compared(gravity_gain(by_gravity, 0.0), 1.0, max(gain_std, least_std), least_std),
    )


def _compared(value: Value | None, stated_value: float, stated_std: float, limit_std: float) -> Comparison:
    if value is None:
        return _NO_COMPARISON
    return Comparison(value.value - stated_value, value.std, stated_std, value.std < limit_std)


def is_refuted(every: tuple[Comparison, ...], latest: tuple[Comparison, ...], *, at_odds: bool) -> bool:
    """Return whether the latest revolutions agree with all statements, one of which all revolutions contradict.

    Args:
        every: comparisons of all revolutions, as `contradicted` returns them.
        latest: those of the latest ones.
        at_odds: whether the latest ones lack the zero-g offset of earlier ones, which they need not measure then.
    """
    if any(comparison.is_beyond(_AGREEMENT_ERRORS) for comparison in latest):
        return False
    if at_odds and every[1].is_beyond(CONTRADICTION):
        return True
    return any(
        overall.is_beyond(CONTRADICTION)
        and recent.is_certain
        and abs(overall.difference - recent.difference) > CONTRADICTION * math.hypot(overall.std, recent.std)
        for overall, recent in zip(every, latest, strict=True)
    )


def are_at_odds(groups: Sequence[Equations], latest: Equations, zero_std_mps2: float) -> bool:
    """Return whether the mean of the latest revolutions lacks the zero-g offset of earlier ones.

    At one speed no offset shows, and the line of all revolutions does not tell: the latest draw it to themselves where
    they are the fastest. So groups that measured an offset by themselves say what mean is expected. One of them may be
    of both kinds of revolutions.

    Args:
        groups: sums of the means of each group.
        latest: of the latest revolutions.
        zero_std_mps2: of the stated zero-g offset.
    """
    return latest.bb > 0.0 and sum(_lacks_zero(group, latest, zero_std_mps2) for group in groups) > 1


def _lacks_zero(group: Equations, latest: Equations, zero_std_mps2: float) -> bool:
    """Return whether the latest mean lacks a zero-g offset that a group has beyond the error of what is stated."""
    zero = zero_offset(group, math.inf)
    if zero is None or abs(zero.value) <= CONTRADICTION * math.hypot(zero.std, zero_std_mps2):
        return False
    aa, ab, bb, a, _ = group
    speed = latest.ab / latest.bb
    expected = (a - ab * zero.value) / aa * speed + zero.value
    group_variance = (bb * speed * speed - 2.0 * ab * speed + aa) / (aa * bb - ab * ab)
    speed_std = speed_errors(group).gain * (speed - ab / bb)
    std = math.sqrt(max(group_variance, 0.0) + speed_std**2 + 1.0 / latest.bb)
    deficit = math.copysign(1.0, zero.value) * (expected - latest.b / latest.bb)
    return deficit > max(_LACKING_SHARE * abs(zero.value), CONTRADICTION * std)


def are_silent(every: tuple[Comparison, ...], latest: tuple[Comparison, ...]) -> bool:
    """Return whether the latest revolutions say nothing of a statement that all revolutions contradict."""
    return any(
        overall.is_beyond(CONTRADICTION) and not recent.is_certain
        for overall, recent in zip(every, latest, strict=True)
    )
