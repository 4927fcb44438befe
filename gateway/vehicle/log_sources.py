"""Sources of vehicle signals for the registry of sources, and the ends of their log files."""

from typing import Final

from gateway.core.links.source import SourceKind

CAN_FILE_SUFFIXES: Final = (
    ".blf", ".asc", ".log", ".csv", ".trc", ".mf4", ".asc.gz", ".log.gz", ".csv.gz", ".trc.gz",
)  # fmt: skip
"""Ends of the log files of a CAN bus."""

NMEA_FILE_SUFFIXES: Final = (".nmea", ".log", ".txt", ".nmea.gz", ".log.gz", ".txt.gz")
"""Ends of the log files of a positioning receiver."""

CAN: Final = SourceKind("gateway.vehicle.can_source:open_can_source", file_suffixes=CAN_FILE_SUFFIXES)
NMEA: Final = SourceKind("gateway.vehicle.nmea_source:open_nmea", file_suffixes=NMEA_FILE_SUFFIXES)
