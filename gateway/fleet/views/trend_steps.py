"""What to do about the findings of a fleet: one line for each remedy, with its tires."""

from collections.abc import Sequence
from typing import Final, NamedTuple

from gateway.fleet.reasons import FleetCode
from gateway.fleet.trends.trend_result import TireTrend
from gateway.fleet.views.trend_tables import tire_name, tires_text

# In the order of their urgency.
_STEPS: Final = {
    "inspect belt, tread and rim before the tire is used again": "STRUCTURE_CHANGED",
    "check the pressure today, and look for a leak at valve, bead and tread":
        "PRESSURE_FELL LOSS_CHANGED LOSES_PRESSURE NEWEST_FALL",
    "measure the tread depth, and check wheel alignment and pressure": "WEARS_FAST WEARS_SHORT WEAR_CHANGED",
    "inspect the tire, and check that load and pressure are stated as they are":
        "STIFFNESS_DRIFTS SLOPE_CHANGED PASSED",
    "check that the sensor is fastened; if it is, replace it": "SENSOR_MOVES",
    "record at two speeds: they tell a changed gain of the sensor from a changed zero": "SENSOR_STEADY",
    "check fastening, supply and antenna of the sensor": "SENSOR_LOSSES SENSOR_NOISE",
    "drive slower, or take a sensor of a larger range": "SENSOR_CLIPS",
    "replace the pressure sensor, and measure the pressure by hand until then":
        "PRESSURE_STUCK PRESSURE_CONSTANT TEMPERATURE_IMPOSSIBLE TEMPERATURE_STUCK",
    "look at the last recording: treadlink estimate RECORDING --html drive.html": "ALARMS",
    "remove the cause that the finding names, and record again": "FEW_VALID",
    "copy the recordings again, or repair them: treadlink repair RECORDING": "DAMAGED",
    "record again soon: one recording proves no change": "LAST_DEVIATES",
    "check that the vehicle file says so too": "TIRES_EXCHANGED TIRE_MOVED STATED_CHANGED",
}  # fmt: skip
_STEP_OF: Final = {
    getattr(FleetCode, f"TREND_{name}"): step for step, names in _STEPS.items() for name in names.split()
}


class TrendStep(NamedTuple):
    """What to do, and for which tires."""

    about: str
    step: str


def trend_steps(tires: Sequence[TireTrend]) -> list[TrendStep]:
    """Return one step for each remedy that the findings of any tire need."""
    names: dict[str, list[str]] = {step: [] for step in _STEPS}
    for tire in tires:
        for step in dict.fromkeys(_STEP_OF[finding.code] for finding in tire.findings if finding.code in _STEP_OF):
            names[step].append(tire_name(tire))
    return [TrendStep(tires_text(of_step, len(tires)), step) for step, of_step in names.items() if of_step]
