"""The simulator in the registry of sources."""

from typing import Final

from gateway.core.links.source import SourceKind

SIM: Final = SourceKind("gateway.simulator.simulator_source:open_simulator", live=False)
