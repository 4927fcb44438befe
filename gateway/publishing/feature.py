"""Declaration of the feature."""

from typing import Final

from gateway.core.feature import Feature, Registry

FEATURE: Final = Feature(
    adds={
        Registry.PLUGIN_CHECKS: {
            Registry.SINKS: "gateway.publishing.sink:plugin_statuses",
        },
        Registry.PARTS: {
            "live outputs": "gateway.publishing.publisher:open_outputs",
            "files of live outputs": "gateway.publishing.publisher:files_of",
        },
    },
)
