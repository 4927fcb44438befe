"""A plan of the next recording as lines and as JSON."""

from collections.abc import Iterator
from typing import Any

from gateway.planning.next_recording import RecordingPlan
from gateway.quantity_catalogue import RING_NUMBERS
from gateway.views.numbers import finite_or_none, split_name
from gateway.views.plain_values import plain

_KPA_PER_PA = 1e-3


def recording_plan_lines(plan: RecordingPlan) -> Iterator[str]:
    """Yield what is open, the present errors, and a line for each recording, best first; errors in percent."""
    if plan.open_effects:
        effects = ", ".join(f"{name} {100.0 * p:.0f} %" for name, p in plan.open_effects.items())
        yield f"next recording; open, with their probabilities: {effects}"
    else:
        yield "next recording; no effect is open"
    for want in plan.wants:
        label, unit = split_name(want.quantity)
        yield f"  wanted: {label} within {unit.factor * want.error:.3g} {unit.symbol}".rstrip()
    names = list(dict.fromkeys((*RING_NUMBERS, *(want.quantity for want in plan.wants))))
    labels = "".join(f"{split_name(name)[0]:>13}" for name in names)
    yield f"  {'':2}{'speed':>9}{'load':>8}{'pressure':>10}{'duration':>10}{'decides':>9}{'ln odds':>9}{labels}"
    yield f"  {'':2}{'now':>9}{'':46}{_errors(plan, plan.errors, names)}"
    for recording in plan.recordings:
        odds = f"{recording.log_odds:9.1f}" if finite_or_none(recording.log_odds) is not None else f"{'-':>9}"
        decides = f"{100.0 * recording.decided:.0f} %" if plan.open_effects else "-"
        yield (
            f"  {'* ' if recording.suffices else '  '}{3.6 * recording.speed_mps:4.0f} km/h"
            f"{recording.load_n:6.0f} N{_KPA_PER_PA * recording.pressure_pa:6.0f} kPa{recording.duration_s:8.0f} s"
            f"{decides:>9}{odds}{_errors(plan, recording.errors, names)}{'  reversed' if recording.is_reversed else ''}"
        )
    reached = all(plan.errors[want.quantity] <= want.error for want in plan.wants)
    if not plan.open_effects and reached:
        yield "  nothing is needed"
    elif any(recording.suffices for recording in plan.recordings):
        yield "  * suffices"
    else:
        yield "  none of these suffices alone"


def _errors(plan: RecordingPlan, errors: Any, names: list[str]) -> str:
    return "".join(f"{100.0 * errors[name] / abs(plan.values[name]):11.3g} %" for name in names)


def recording_plan_json(plan: RecordingPlan) -> dict[str, Any]:
    """Return a plan as plain values; null where one is not known."""
    document = {
        "open_effects": plan.open_effects,
        "sets": plan.sets,
        "wanted": {want.quantity: want.error for want in plan.wants},
        "values": plan.values,
        "errors": plan.errors,
        "recordings": plan.recordings,
    }
    return dict(plain(document))
