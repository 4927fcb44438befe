"""Declaration of the feature."""

from typing import Final

from gateway.feature import CommandLine, Feature

FEATURE: Final = Feature(
    commands={
        "compare": CommandLine(
            "gateway.cli.compare:compare", "Compare two recordings: means, differences and their significance."
        ),
        "orders": CommandLine("gateway.cli.orders:orders", "Show the order spectra and the average of every wheel."),
    },
)
