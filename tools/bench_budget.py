"""Gains that budgets of errors promise, and those that come when the statement is made: five careless statements.

Run: python tools/bench_budget.py
"""

from dataclasses import replace

from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.planner.accelerometer import Accelerometer
from gateway.planner.planned_errors import driven
from gateway.planner.uncertainty_budget import SOURCES, budgets
from gateway.simulator.scenario import load_scenario

_CARELESS = (
    ("wear_mm", "load", 0.10),
    ("Cw", "pressure", 0.07),
    ("speed_mps", "belt radius", 0.02),
    ("angular_speed_radps", "sampling rate", 0.01),
    ("wear_mm", "temperature of the new tire", 15.0),
)
_REVOLUTIONS = 64
_BY_NAME = {source.name: source for source in SOURCES}


def main() -> None:
    """Print the table."""
    lab = load_scenario("lab")
    sensor = Accelerometer(name="quiet", range_g=500.0, rate_hz=4000.0, noise_mg_rthz=2.0)
    print("| quantity | careless statement | its error | made to | error before | promised | came |")
    print("|---|---|---|---|---|---|---|")
    for quantity, name, error in _CARELESS:

        def stated(setup: WheelSetup, name: str = name, error: float = error) -> WheelSetup:
            setup = setup if name.startswith("temperature") else _careful(setup)
            return _BY_NAME[name].with_error(setup, error)

        setup, (drive,) = driven(lab, sensor, 80.0 / 3.6, wheels=1, statements=stated)
        budget = next(item for item in budgets(setup, drive[:_REVOLUTIONS]) if item.estimate.name == quantity)
        promise = budget.promise
        assert promise is not None, f"{quantity} has nothing to make better"
        better = promise.source.with_error(setup, promise.source.better)
        _, (second,) = driven(lab, sensor, 80.0 / 3.6, wheels=1, seed=1, statements=lambda _, better=better: better)
        came = next(estimate for estimate in second[_REVOLUTIONS - 1].estimates if estimate.name == quantity)
        source = promise.source
        unit, factor = (" %", 100.0) if source.is_relative else (f" {source.unit}", 1.0)
        cells = (quantity, source.name, f"{factor * error:g}{unit}", f"{factor * source.better:g}{unit}")
        errors = (f"{std:.3g}" for std in (budget.estimate.std, promise.std, came.std))
        print(f"| {' | '.join((*cells, *errors))} |")


def _careful(setup: WheelSetup) -> WheelSetup:
    reference = replace(setup.tire.reference, temperature_degc=25.0, Cw=None)
    return replace(setup, tire=replace(setup.tire, reference=reference), radius_std_m=1e-3 * setup.radius_m)


if __name__ == "__main__":
    main()
