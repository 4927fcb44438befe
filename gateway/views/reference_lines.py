"""Lines about the difference between estimates and a measured reference."""

from __future__ import annotations

import math
from collections.abc import Sequence

from gateway.pipeline.reference_comparison import ReferenceComparison
from gateway.views.numbers import round_to_error


def reference_lines(comparisons: Sequence[ReferenceComparison]) -> list[str]:
    """Return the lines of every comparison."""
    return [line for comparison in comparisons for line in _lines(comparison)]


def _lines(found: ReferenceComparison) -> list[str]:
    head = f"{found.position}, reference {found.name}"
    if found.revolutions == 0:
        return [f"{head}: fewer than 3 revolutions have a reference; nothing to compare"]
    unit, factor = ("km/h", 3.6) if found.quantity == "speed" else ("Hz", 1.0)
    estimated, measured = (_plain(value * factor) for value in (found.estimated, found.measured))
    share = 100.0 / found.measured if found.measured else math.nan
    percent = _with_error(found.difference * share, found.difference_std * share)
    difference = _with_error(found.difference * factor, found.difference_std * factor)
    lines = [
        f"{head}: {found.revolutions} revolutions, {estimated} {unit} estimated, {measured} {unit} measured; "
        f"difference {difference} {unit} ({percent} %)"
    ]
    if found.quantity == "speed":
        radius = _with_error(found.radius_m * 1e3, found.radius_std_m * 1e3)
        lines.append(f"{head}: the speeds agree with a belt radius of {radius} mm")
    if math.isfinite(found.contact_rad):
        centre, scatter = math.degrees(found.contact_rad), math.degrees(found.contact_scatter_rad)
        lines.append(f"{head}: the contact centre is at {centre:.1f} deg of it, with a scatter of {scatter:.2g} deg")
    return lines


def _with_error(value: float, std: float) -> str:
    return round_to_error(value, std).joined()


def _plain(value: float) -> str:
    return f"{value:.6g}"
