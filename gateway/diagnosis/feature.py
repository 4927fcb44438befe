"""Declaration of the feature."""

from typing import Final

from gateway.feature import CommandLine, Feature

FEATURE: Final = Feature(
    commands={
        "diagnose": CommandLine("gateway.cli.diagnose:diagnose", "Identify the physical effects that the model lacks."),
    },
)
