"""Plans of sensors as lines and as JSON."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.text.aligned_table import WIDEST, table_lines
from gateway.core.text.numbers import split_name
from gateway.core.text.plain_values import plain
from gateway.core.text.text import json_text
from gateway.core.text.wording import joined
from gateway.planner.accelerometer import Accelerometer
from gateway.planner.least_sensor import LeastSensor, WorstError
from gateway.planner.link_load import LinkLoad, PowerModel, link_load
from gateway.planner.planned_errors import PlannedError, SensorPlan


def plan_lines(plan: SensorPlan, power: PowerModel | None = None, columns: int = WIDEST) -> Iterator[str]:
    """Yield the lines of one sensor at one speed: its state, then scatter and what stays of each quantity."""
    peak_g = plan.peak_mps2 / STANDARD_GRAVITY_MPS2
    state = "usable" if plan.usable else "not usable"
    yield f"{plan.sensor.name} at {3.6 * plan.speed_mps:g} km/h: {state}"
    has_rate = not math.isnan(plan.rate_hz)
    rate = "rate unknown"
    if has_rate:
        rate = f"{plan.rate_hz:.0f} Hz, {plan.contact_samples:.0f} samples in the contact"
    yield f"  peak {peak_g:.0f} g of {plan.sensor.range_g:g} g; {rate}"
    if has_rate:
        yield f"  {_load_line(link_load(plan.rate_hz, plan.sensor.current_ma, power), power)}"
    if plan.reasons:
        yield f"  {joined(plan.reasons)}"
    if not plan.errors:
        return
    counts = sorted({error.revolutions for error in plan.errors})
    rows = [["  quantity", "true", *(f"after {count}" for count in counts), "bound", "stays", "stated"]]
    by_name: dict[str, dict[int, PlannedError]] = {}
    for error in plan.errors:
        by_name.setdefault(error.quantity, {})[error.revolutions] = error
    for name, errors in by_name.items():
        last = errors[max(errors)]
        scatters = [f"{errors[count].scatter:.3g}" if count in errors else "-" for count in counts]
        bound = f"{last.bound:.3g}" if math.isfinite(last.bound) else "-"
        rows.append([f"  {name}", f"{last.truth:.4g}", *scatters, bound, f"{last.stays:.3g}", f"{last.stated:.3g}"])
    yield from table_lines(rows, columns)


def _load_line(load: LinkLoad, power: PowerModel | None) -> str:
    parts = [f"{load.data_kbps:.0f} kbit/s"]
    if power is not None and load.radio_share > 1.0:
        parts.append(f"more than the {power.radio_kbps:g} kbit/s of the radio")
    elif power is not None:
        parts.append(f"radio on {100.0 * load.radio_share:.0f} % of the time")
        finite = math.isfinite(load.battery_h)
        parts.append(
            f"{load.battery_h:.3g} h from {power.battery_mah:g} mAh"
            if finite
            else "battery: the sensor's current is unknown"
        )
    return ", ".join(parts)


def plan_json(plans: Sequence[SensorPlan], power: PowerModel | None = None) -> str:
    """Return plans as a JSON document; what is not known is null."""
    return json_text(plain([_as_json(plan, power) for plan in plans]), indent=2) + "\n"


def least_line(least: LeastSensor) -> str:
    """Return what a sensor needs at one rate as a line."""
    if not least.reached:
        return f"{least.rate_hz:6.0f} Hz: not with any noise: {_worst(least.worst)}"
    return (
        f"{least.rate_hz:6.0f} Hz: at least {math.ceil(least.range_g)} g, at most {least.noise_mg_rthz:g} mg/sqrt(Hz): "
        f"{_worst(least.worst)}"
    )


def _worst(worst: WorstError) -> str:
    label, unit = split_name(worst.quantity)
    error, limit = (f"{unit.factor * value:.3g} {unit.symbol}".rstrip() for value in (worst.error, worst.wanted))
    text = f"{error} of {limit}" if math.isfinite(worst.error) else "not valid in most drives"
    if worst.share <= 1.0:
        text += f", after {worst.minutes:.2g} min of driving"
    return f"{label} at {3.6 * worst.speed_mps:g} km/h: {text}"


def parts_line(parts: Sequence[Accelerometer]) -> str:
    """Return which parts reach the errors, some if their unknown noise is small enough."""
    names = [f"{part.name} (noise unknown)" if part.missing() else part.name for part in parts]
    return f"           parts: {', '.join(names) or 'none of the list'}"


def least_json(leasts: Sequence[LeastSensor]) -> str:
    """Return what sensors need as a JSON document; what is not reached is null."""
    return json_text(plain(leasts), indent=2) + "\n"


def _as_json(plan: SensorPlan, power: PowerModel | None) -> dict[str, Any]:
    return {
        "sensor": plan.sensor.model_dump(mode="json"),
        "speed_mps": plan.speed_mps,
        "rate_hz": plan.rate_hz,
        "peak_mps2": plan.peak_mps2,
        "contact_samples": plan.contact_samples,
        **link_load(plan.rate_hz, plan.sensor.current_ma, power)._asdict(),
        "usable": plan.usable,
        "reasons": plan.reasons,
        "errors": plan.errors,
    }
