"""Declaration of the feature."""

from typing import Final

from gateway.core.feature import CommandLine, Feature

FEATURE: Final = Feature(
    commands={
        "protocol": CommandLine(
            "gateway.makers.commands.protocol:protocol",
            "Check a firmware; write C code and other files for makers.",
        ),
    },
)
