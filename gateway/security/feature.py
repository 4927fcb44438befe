"""Declaration of the feature."""

from typing import Final

from gateway.core.feature import CommandLine, Feature, Registry

FEATURE: Final = Feature(
    commands={
        "command": CommandLine(
            "gateway.security.commands.command:command", "Send a command to a hub and print its reply."
        ),
        "keys": CommandLine(
            "gateway.security.commands.keys:keys", "Make, list and remove the keys that sensors sign with."
        ),
    },
    adds={
        Registry.PARTS: {
            "frame guard": "gateway.security.guard:open_guard",
            "key file": "gateway.security.key_file:default_key_file",
            "commanded links": "gateway.security.control_socket:CommandedLinks",
        },
    },
)
