"""Declaration of the feature."""

from typing import Final

from gateway.core.feature import CommandLine, Feature

FEATURE: Final = Feature(
    commands={
        "view": CommandLine(
            "gateway.viewer.commands.view:view", "Look into recordings in a browser, from hours to single samples."
        ),
    },
)
