"""Declaration of the feature."""

from typing import Final

from gateway.feature import CommandLine, Feature

FEATURE: Final = Feature(
    commands={
        "protocol": CommandLine(
            "gateway.cli.protocol:protocol", "Check a firmware; generate C code, vectors, dissector, schema."
        ),
    },
)
