"""Declaration of the feature."""

from typing import Final

from gateway.feature import CommandLine, Feature

FEATURE: Final = Feature(
    commands={
        "simulate": CommandLine("gateway.cli.simulate:simulate", "Simulate hubs and tires."),
    },
)
