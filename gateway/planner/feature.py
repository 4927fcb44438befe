"""Declaration of the feature."""

from typing import Final

from gateway.core.feature import CommandLine, Feature

FEATURE: Final = Feature(
    commands={
        "plan": CommandLine(
            "gateway.planner.commands.plan:plan", "Say what a sensor will be able to measure before it is bought."
        ),
    },
)
