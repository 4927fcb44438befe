"""Page of the accelerometers that are shipped: their data sheets, and what each can do on a tire at three speeds."""

import functools
import math
from collections.abc import Iterator
from typing import Final

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.text.numbers import split_name
from gateway.planner.accelerometer import Accelerometer, shipped_accelerometers
from gateway.planner.planned_errors import AFTER, SensorPlan, plan_sensor
from gateway.simulator.scenario import load_scenario
from gateway.simulator.scenario_model import Scenario
from gateway.simulator.time_series import constant
from tools.docs_site.markdown import code, escaped, table

SPEEDS_KMH: Final = (60.0, 100.0, 150.0)
_SCENARIO: Final = "lab"
# Tires of a small car, of the scenario and of a van: belt radius in mm, load in N, pressure in kPa.
_TIRES: Final = ((270.0, 3500.0, 220.0), (None, None, None), (370.0, 9000.0, 350.0))
_WHEELS: Final = 40
_SLOW_MPS: Final = 20.0

_INTRODUCTION: Final = """\
# Accelerometers

The parts of the list that `treadlink plan` has, and what each can do on the tire of the scenario `{scenario}`, of
{radius:.0f} mm belt radius: at {speeds} km/h, the peak is {peaks} g. Made by the same code as
[`treadlink plan`](../how-to/choose-a-sensor.md). A value that no document was found for is left out; read the data
sheet before you buy.

**Up to** is the speed at which the peak fills the range, on three tires by their belt radius. Words behind *no* and
*yes* are the reasons `plan_...` of [Reasons](reasons.md). Without its noise, a part's errors cannot be planned.
"""


@functools.cache
def accelerometers_markdown() -> str:
    """Return the page."""
    scenario = load_scenario(_SCENARIO)
    rows = [(part, _plans(scenario, part)) for part in shipped_accelerometers().sensor]
    peaks = ", ".join(f"{plan.peak_mps2 / STANDARD_GRAVITY_MPS2:.0f}" for plan in rows[0][1])
    lines = [
        _INTRODUCTION.format(
            scenario=_SCENARIO,
            radius=scenario.wheels()[0].tire.radius_mm,
            speeds=", ".join(f"{speed:g}" for speed in SPEEDS_KMH),
            peaks=peaks,
        )
    ]
    lines += ["## What each can do", ""]
    tires = [_tire(scenario, *tire) for tire in _TIRES]
    lines += table(
        (
            "Part",
            *(f"Up to, km/h, {tire.wheels()[0].tire.radius_mm:.0f} mm" for tire in tires),
            *(f"{speed:g} km/h" for speed in SPEEDS_KMH),
        ),
        (
            (
                escaped(part.name),
                *(f"{3.6 * _fastest_mps(tire, part):.0f}" for tire in tires),
                *(escaped(_ability(plan)) for plan in plans),
            )
            for part, plans in rows
        ),
    )
    for part, plans in rows:
        lines += _errors(part, plans)
    lines += ["", "## Data sheets", ""]
    heads = (
        "Part",
        "Range, g",
        "Rate, Hz",
        "Band, Hz",
        "Noise, mg/√Hz",
        "Step, mg",
        "Survives, g",
        "Read by",
        "Source",
    )
    lines += table(heads, (_sheet(part) for part, _ in rows))
    return "\n".join(lines).rstrip() + "\n"


def _tire(scenario: Scenario, radius_mm: float | None, load_n: float | None, pressure_kpa: float | None) -> Scenario:
    """Return the scenario with another tire of the same numbers, or as it is."""
    if radius_mm is None or load_n is None or pressure_kpa is None:
        return scenario
    (first, *_) = scenario.wheels()
    changed = {
        "load_n": constant(load_n),
        "pressure_kpa": constant(pressure_kpa),
        "tire": first.tire.model_copy(update={"radius_mm": radius_mm, "reference_pressure_kpa": pressure_kpa}),
    }
    return scenario.model_copy(update={"wheel": (first.model_copy(update=changed),)})


def _fastest_mps(scenario: Scenario, part: Accelerometer) -> float:
    """Return the speed at which the peak reaches the range or what the part survives: it grows with the square."""
    plan = plan_sensor(scenario, part.model_copy(update={"noise_mg_rthz": None}), _SLOW_MPS, wheels=1)
    limit_g = min(part.range_g, part.survival_g or math.inf)
    square_ratio = (limit_g - 1.0) / (plan.peak_mps2 / STANDARD_GRAVITY_MPS2 - 1.0)
    return plan.speed_mps * math.sqrt(max(square_ratio, 0.0))


def _plans(scenario: Scenario, part: Accelerometer) -> list[SensorPlan]:
    return [plan_sensor(scenario, part, speed / 3.6, wheels=_WHEELS) for speed in SPEEDS_KMH]


def _ability(plan: SensorPlan) -> str:
    words = [str(reason.code).removeprefix("plan_").replace("_", " ") for reason in plan.reasons]
    return ": ".join(filter(None, ("yes" if plan.usable else "no", ", ".join(words))))


def _errors(part: Accelerometer, plans: list[SensorPlan]) -> Iterator[str]:
    """Yield the errors of a part whose noise is known, where it can be used."""
    for plan in plans:
        errors = [error for error in plan.errors if error.revolutions == AFTER[-1]]
        if errors:
            yield from ("", f"{escaped(part.name)} at {3.6 * plan.speed_mps:g} km/h after {AFTER[-1]} revolutions:", "")
            shown = ((error, split_name(error.quantity)[1]) for error in errors)
            yield from table(
                ("Quantity", "Unit", "Scatter", "Stays"),
                (
                    (code(e.quantity), unit.symbol, f"{unit.factor * e.scatter:.2g}", f"{unit.factor * e.stays:.2g}")
                    for e, unit in shown
                ),
            )


def _sheet(part: Accelerometer) -> tuple[str, ...]:
    numbers = (part.range_g, part.rate_hz, part.bandwidth_hz, part.noise_mg_rthz, part.resolution_mg, part.survival_g)
    texts = ("" if number is None else f"{number:g}" for number in numbers)
    return (escaped(part.name), *texts, escaped(part.interface), escaped(part.source))
