"""Declaration of the feature."""

from typing import Final

from gateway.core.feature import CommandLine, Feature

FEATURE: Final = Feature(
    commands={
        "scan": CommandLine("gateway.bench.commands.scan:scan", "List hubs in range and serial ports."),
        "setup": CommandLine(
            "gateway.bench.commands.setup:setup",
            "Write a vehicle file by asking: wheels, radius, pressure, load.",
        ),
        "doctor": CommandLine(
            "gateway.bench.commands.doctor:doctor", "Check packages, ports, permissions and configuration."
        ),
        "completion": CommandLine(
            "gateway.bench.commands.completion:completion", "Print the completion script of a shell."
        ),
    },
)
