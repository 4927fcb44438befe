"""Declaration of the feature."""

from typing import Final

from gateway.feature import Feature, Registry

FEATURE: Final = Feature(
    adds={
        Registry.PARTS: {
            "screen": "gateway.views.console.screen:run_console",
        },
    },
)
