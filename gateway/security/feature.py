"""Declaration of the feature."""

from typing import Final

from gateway.feature import CommandLine, Feature

FEATURE: Final = Feature(
    commands={
        "command": CommandLine("gateway.cli.command:command", "Send a command to a hub and print its reply."),
        "keys": CommandLine("gateway.cli.keys:keys", "Manage sensor signing keys."),
    },
)
