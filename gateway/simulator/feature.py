"""Declaration of the feature."""

from typing import Final

from gateway.core.feature import CommandLine, Feature

FEATURE: Final = Feature(
    commands={
        "simulate": CommandLine("gateway.simulator.commands.simulate:simulate", "Simulate hubs and tires."),
    },
)
