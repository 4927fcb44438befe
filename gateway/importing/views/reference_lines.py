"""Lines about the difference between estimates and a measured reference."""

import math
from collections.abc import Sequence
from typing import Final

from gateway.core.text.numbers import round_to_error
from gateway.importing.reference_comparison import ReferenceComparison

_RIG_UNITS: Final = {
    "load": ("N", 1.0),
    "side_force": ("N", 1.0),
    "slip_angle": ("deg", 180.0 / math.pi),
    "camber": ("deg", 180.0 / math.pi),
    "torque": ("N*m", 1.0),
}


def reference_lines(comparisons: Sequence[ReferenceComparison]) -> list[str]:
    """Return the lines of every comparison."""
    return [line for comparison in comparisons for line in _lines(comparison)]


def _lines(comparison: ReferenceComparison) -> list[str]:
    head = f"{comparison.position}, reference {comparison.name}"
    if comparison.revolutions == 0:
        return [f"{head}: fewer than 3 revolutions have a reference; nothing to compare"]
    if comparison.quantity in _RIG_UNITS:
        unit, factor = _RIG_UNITS[comparison.quantity]
        if math.isfinite(comparison.estimated):
            return _channel_lines(head, comparison, unit, factor)
        mean = _with_error(comparison.measured * factor, comparison.difference_std * factor)
        return [
            f"{head}: {comparison.revolutions} revolutions, mean {mean} {unit}, "
            f"scatter of single revolutions {comparison.scatter * factor:.2g} {unit}"
        ]
    unit, factor = ("km/h", 3.6) if comparison.quantity == "speed" else ("Hz", 1.0)
    estimated, measured = (_plain(value * factor) for value in (comparison.estimated, comparison.measured))
    percent_factor = 100.0 / comparison.measured if comparison.measured else math.nan
    percent = _with_error(comparison.difference * percent_factor, comparison.difference_std * percent_factor)
    difference = _with_error(comparison.difference * factor, comparison.difference_std * factor)
    lines = [
        f"{head}: {comparison.revolutions} revolutions, {estimated} {unit} estimated, {measured} {unit} measured; "
        f"difference {difference} {unit} ({percent} %)"
    ]
    if comparison.quantity == "speed":
        radius = _with_error(comparison.radius_m * 1e3, comparison.radius_std_m * 1e3)
        exact = "" if comparison.value_std > 0.0 else ", if the reference is exact: its std is 0 or not stated"
        lines.append(f"{head}: the speeds agree with a belt radius of {radius} mm{exact}")
    if math.isfinite(comparison.contact_rad):
        centre, scatter = math.degrees(comparison.contact_rad), math.degrees(comparison.contact_scatter_rad)
        lines.append(f"{head}: the contact centre is at {centre:.1f} deg of it, with a scatter of {scatter:.2g} deg")
    return lines


def _channel_lines(head: str, comparison: ReferenceComparison, unit: str, factor: float) -> list[str]:
    """Return the lines of an estimate and the channel of a rig that it follows."""
    estimated, measured = (f"{value * factor:.4g}" for value in (comparison.estimated, comparison.measured))
    difference = _with_error(comparison.difference * factor, comparison.difference_std * factor)
    lines = [
        f"{head}: {comparison.revolutions} revolutions, {estimated} {unit} estimated, {measured} {unit} measured; "
        f"difference {difference} {unit}, single revolutions scatter {comparison.scatter * factor:.2g} {unit} "
        f"(they differ by {comparison.share_of_error:.2g} of their errors)"
    ]
    if math.isfinite(comparison.slope):
        slope = _with_error(comparison.slope, comparison.slope_std)
        lines.append(f"{head}: where it varies, the estimate changes {slope} times as much")
    return lines


def _with_error(value: float, std: float) -> str:
    return round_to_error(value, std).joined()


def _plain(value: float) -> str:
    return f"{value:.6g}"
