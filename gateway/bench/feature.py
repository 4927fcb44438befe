"""Declaration of the feature."""

from typing import Final

from gateway.feature import CommandLine, Feature

FEATURE: Final = Feature(
    commands={
        "scan": CommandLine("gateway.cli.scan:scan", "List hubs in range and serial ports."),
        "setup": CommandLine(
            "gateway.cli.setup:setup", "Write a vehicle file for plugged hubs: wheels, radius, pressure, load."
        ),
        "doctor": CommandLine("gateway.cli.doctor:doctor", "Check packages, ports, permissions and configuration."),
        "completion": CommandLine("gateway.cli.completion:completion", "Print the completion script of a shell."),
    },
)
