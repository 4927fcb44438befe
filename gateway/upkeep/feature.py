"""Declaration of the feature."""

from typing import Final

from gateway.feature import CommandLine, Feature

FEATURE: Final = Feature(
    commands={
        "note": CommandLine("gateway.cli.note:note", "Add a comment or tags to recordings without changing them."),
        "repair": CommandLine("gateway.cli.repair:repair", "Repair a recording that was cut off or damaged."),
        "compact": CommandLine("gateway.cli.repair:compact", "Compress finished recordings."),
        "set-clock": CommandLine(
            "gateway.cli.repair:set_clock", "Copy a recording with right times, if its clock was wrong."
        ),
        "merge": CommandLine("gateway.cli.merge:merge", "Merge recordings of one drive."),
    },
)
