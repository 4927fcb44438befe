"""Declaration of the feature."""

from typing import Final

from gateway.feature import CommandLine, Feature, Registry

FEATURE: Final = Feature(
    commands={
        "command": CommandLine("gateway.cli.command:command", "Send a command to a hub and print its reply."),
        "keys": CommandLine("gateway.cli.keys:keys", "Manage sensor signing keys."),
    },
    adds={
        Registry.PARTS: {
            "frame guard": "gateway.security.guard:open_guard",
            "key file": "gateway.security.key_file:default_key_file",
            "commanded links": "gateway.session.control_socket:CommandedLinks",
        },
    },
)
