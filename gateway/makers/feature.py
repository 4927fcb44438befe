"""Declaration of the feature."""

from typing import Final

from gateway.core.feature import CommandLine, Feature

FEATURE: Final = Feature(
    commands={
        "protocol": CommandLine(
            "gateway.makers.commands.protocol:protocol",
            "Check a firmware; generate C code, vectors, dissector, schema.",
        ),
    },
)
