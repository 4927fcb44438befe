"""Declaration of the feature."""

from typing import Final

from gateway.core.feature import CommandLine, Feature, Registry

FEATURE: Final = Feature(
    commands={
        "simulate": CommandLine("gateway.simulator.commands.simulate:simulate", "Simulate hubs and tires."),
    },
    adds={
        Registry.SOURCES: {"sim": "gateway.simulator.simulated_kind:SIM"},
    },
)
