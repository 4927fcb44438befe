"""Declaration of the feature."""

from typing import Final

from gateway.core.feature import CommandLine, Feature, Registry

FEATURE: Final = Feature(
    commands={
        "compare": CommandLine(
            "gateway.compare.commands.compare:compare",
            "Compare two recordings: means, differences and their significance.",
        ),
        "orders": CommandLine(
            "gateway.compare.commands.orders:orders", "Show what repeats with each turn of a wheel, and what does not."
        ),
    },
    adds={
        Registry.ESTIMATE_OUTPUTS: {
            "page": "gateway.compare.page_output:PAGE",
        },
    },
)
