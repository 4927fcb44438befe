"""Declaration of the feature."""

from typing import Final

from gateway.core.feature import CommandLine, Feature, Registry

FEATURE: Final = Feature(
    commands={
        "plan": CommandLine(
            "gateway.planner.commands.plan:plan", "Say what a sensor will be able to measure before it is bought."
        ),
    },
    adds={
        Registry.ESTIMATE_OUTPUTS: {"uncertainty-budget": "gateway.planner.budget_option:BUDGET"},
        Registry.VEHICLE_CHECKS: {"errors": "gateway.planner.vehicle_budget:largest_errors"},
    },
)
