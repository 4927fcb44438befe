"""Declaration of the feature."""

from typing import Final

from gateway.feature import CommandLine, Feature

FEATURE: Final = Feature(
    commands={
        "plan": CommandLine("gateway.cli.plan:plan", "Say what a sensor will be able to measure before it is bought."),
    },
)
