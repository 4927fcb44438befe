"""Features of this package, in the order of `treadlink --help`."""

from typing import Final

FEATURES: Final = (
    "gateway.compare.feature",
    "gateway.glossary.feature",
    "gateway.viewer.feature",
    "gateway.exporting.feature",
    "gateway.diagnosis.feature",
    "gateway.fleet.feature",
    "gateway.forces.feature",
    "gateway.inflation.feature",
    "gateway.importing.feature",
    "gateway.upkeep.feature",
    "gateway.simulator.feature",
    "gateway.planner.feature",
    "gateway.ring.feature",
    "gateway.papers.feature",
    "gateway.bench.feature",
    "gateway.security.feature",
    "gateway.makers.feature",
    "gateway.vehicle.feature",
    "gateway.console.feature",
    "gateway.publishing.feature",
)
