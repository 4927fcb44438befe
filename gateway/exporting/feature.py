"""Declaration of the feature."""

from typing import Final

from gateway.feature import CommandLine, Feature

FEATURE: Final = Feature(
    commands={
        "export": CommandLine(
            "gateway.cli.export:export", "Write measurements to CSV, Parquet, MATLAB, MDF, TYDEX or MCAP files."
        ),
    },
)
