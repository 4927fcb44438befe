"""Declaration of the feature."""

from typing import Final

from gateway.core.feature import CommandLine, Feature, Registry

FEATURE: Final = Feature(
    commands={
        "import": CommandLine(
            "gateway.importing.commands.import_measurement:import_",
            "Make a recording of a measurement of another program.",
        ),
    },
    adds={
        Registry.ESTIMATE_OUTPUTS: {
            "references": "gateway.importing.reference_output:REFERENCES",
        },
        Registry.PLUGIN_CHECKS: {
            Registry.IMPORTERS: "gateway.importing.file_formats:plugin_statuses",
        },
        Registry.PARTS: {
            "rig channels": "gateway.importing.rig_channels:RigChannels",
        },
    },
)
