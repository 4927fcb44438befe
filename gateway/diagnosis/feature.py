"""Declaration of the feature."""

from typing import Final

from gateway.core.feature import CommandLine, Feature, Registry

FEATURE: Final = Feature(
    commands={
        "diagnose": CommandLine(
            "gateway.diagnosis.commands.diagnose:diagnose", "Find out why the model does not fit a tire."
        )
    },
    adds={
        Registry.PLUGIN_CHECKS: {Registry.EFFECTS: "gateway.diagnosis.effects.catalogue:plugin_statuses"},
        Registry.PARTS: {"effects file": "gateway.diagnosis.effects_opening:open_effects_file"},
    },
)
