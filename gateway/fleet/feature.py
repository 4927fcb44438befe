"""Declaration of the feature."""

from typing import Final

from gateway.core.feature import CommandLine, Feature, Registry

FEATURE: Final = Feature(
    commands={
        "campaign": CommandLine(
            "gateway.fleet.commands.campaign:campaign", "Estimate folders of recordings into a dataset."
        ),
        "trends": CommandLine(
            "gateway.fleet.commands.trends:trends", "Report how tires and sensors of a dataset change."
        ),
    },
    adds={Registry.PARTS: {"label of a series": "gateway.fleet.trends.watched_series:label_of"}},
)
