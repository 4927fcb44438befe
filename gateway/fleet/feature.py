"""Declaration of the feature."""

from typing import Final

from gateway.feature import CommandLine, Feature, Registry

FEATURE: Final = Feature(
    commands={
        "campaign": CommandLine("gateway.cli.campaign:campaign", "Estimate many recordings into a dataset."),
        "trends": CommandLine("gateway.cli.trends:trends", "Report how tires and sensors of a dataset change."),
    },
    adds={
        Registry.PARTS: {
            "label of a series": "gateway.trends.watched_series:label_of",
        },
    },
)
