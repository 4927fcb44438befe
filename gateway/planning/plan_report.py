"""Plans of sensors as lines and as JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any, Final

from gateway.constants import STANDARD_GRAVITY_MPS2
from gateway.planning.planned_errors import PlannedError, SensorPlan
from gateway.views.wording import as_json, joined

# One axis in words of the protocol, without its frames.
_BITS_PER_SAMPLE: Final = 16


def plan_lines(plan: SensorPlan) -> Iterator[str]:
    """Yield the lines of one sensor at one speed: its state, then scatter and what stays of each quantity."""
    peak_g = plan.peak_mps2 / STANDARD_GRAVITY_MPS2
    state = "usable" if plan.usable else "not usable"
    yield f"{plan.sensor.name} at {3.6 * plan.speed_mps:g} km/h: {state}"
    known_rate = not math.isnan(plan.rate_hz)
    rate = "rate unknown"
    if known_rate:
        kbps = plan.rate_hz * _BITS_PER_SAMPLE * 1e-3
        rate = f"{plan.rate_hz:.0f} Hz, {plan.contact_samples:.0f} samples in the contact, {kbps:.0f} kbit/s of samples"
    yield f"  peak {peak_g:.0f} g of {plan.sensor.range_g:g} g; {rate}"
    if plan.reasons:
        yield f"  {joined(plan.reasons)}"
    if not plan.errors:
        return
    counts = sorted({error.revolutions for error in plan.errors})
    header = "".join(f"{f'after {count}':>12}" for count in counts)
    yield f"  {'quantity':<18}{'true':>12}{header}{'stays':>12}{'stated':>12}"
    by_name: dict[str, dict[int, PlannedError]] = {}
    for error in plan.errors:
        by_name.setdefault(error.quantity, {})[error.revolutions] = error
    for name, errors in by_name.items():
        last = errors[max(errors)]
        scatters = "".join(f"{errors[count].scatter:12.3g}" if count in errors else f"{'-':>12}" for count in counts)
        yield f"  {name:<18}{last.truth:12.4g}{scatters}{last.stays:12.3g}{last.stated:12.3g}"


def plan_json(plans: Sequence[SensorPlan]) -> str:
    """Return plans as a JSON document; what is not known is null."""
    return json.dumps([_as_json(plan) for plan in plans], indent=2, allow_nan=False) + "\n"


def _as_json(plan: SensorPlan) -> dict[str, Any]:
    return {
        "sensor": plan.sensor.model_dump(mode="json"),
        "speed_mps": plan.speed_mps,
        "rate_hz": _finite(plan.rate_hz),
        "peak_mps2": plan.peak_mps2,
        "contact_samples": _finite(plan.contact_samples),
        "usable": plan.usable,
        "reasons": [as_json(reason) for reason in plan.reasons],
        "errors": [
            {key: _finite(value) if isinstance(value, float) else value for key, value in asdict(error).items()}
            for error in plan.errors
        ],
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
