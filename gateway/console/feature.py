"""Declaration of the feature."""

from typing import Final

from gateway.core.feature import Feature, Registry

FEATURE: Final = Feature(
    adds={
        Registry.PARTS: {
            "screen": "gateway.console.screen:run_console",
        },
    },
)
