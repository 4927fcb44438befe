"""Declaration of the feature."""

from typing import Final

from gateway.core.feature import CommandLine, Feature

FEATURE: Final = Feature(
    commands={
        "export": CommandLine(
            "gateway.exporting.commands.export:export",
            "Write measurements as CSV, Parquet, MATLAB, MDF, TYDEX or MCAP.",
        ),
    },
)
