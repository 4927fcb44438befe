"""Declaration of the feature."""

from typing import Final

from gateway.feature import CommandLine, Feature

FEATURE: Final = Feature(
    commands={
        "import": CommandLine(
            "gateway.cli.import_measurement:import_", "Convert a CSV, MAT, HDF5, MF4, TDMS or IDE file to a recording."
        ),
    },
)
