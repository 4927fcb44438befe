"""Declaration of the feature."""

from typing import Final

from gateway.feature import CommandLine, Feature, Registry

FEATURE: Final = Feature(
    commands={
        "diagnose": CommandLine("gateway.cli.diagnose:diagnose", "Identify the physical effects that the model lacks."),
    },
    adds={
        Registry.PARTS: {
            "effects file": "gateway.session.effects_opening:open_effects_file",
        },
    },
)
