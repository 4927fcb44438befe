"""Declaration of the feature."""

from typing import Final

from gateway.core.feature import CommandLine, Feature

FEATURE: Final = Feature(
    commands={
        "note": CommandLine(
            "gateway.upkeep.commands.note:note", "Add a comment or tags to recordings without changing them."
        ),
        "repair": CommandLine(
            "gateway.upkeep.commands.repair:repair", "Repair a recording that was cut off or damaged."
        ),
        "compact": CommandLine("gateway.upkeep.commands.repair:compact", "Compress finished recordings."),
        "set-clock": CommandLine(
            "gateway.upkeep.commands.repair:set_clock", "Copy a recording with right times, if its clock was wrong."
        ),
        "merge": CommandLine("gateway.upkeep.commands.merge:merge", "Merge recordings of one drive."),
    },
)
