"""Sources of what is measured beside the hub for the registry of sources, and the ends of their log files."""

from typing import Final

from gateway.core.links.source import SourceKind

CAN_FILE_SUFFIXES: Final = (
    ".blf", ".asc", ".log", ".csv", ".trc", ".mf4", ".asc.gz", ".log.gz", ".csv.gz", ".trc.gz",
)  # fmt: skip
"""Ends of the log files of a CAN bus."""

NMEA_FILE_SUFFIXES: Final = (".nmea", ".log", ".txt", ".nmea.gz", ".log.gz", ".txt.gz")
"""Ends of the log files of a positioning receiver."""

RTL433_FILE_SUFFIXES: Final = (".json", ".jsonl", ".log", ".txt", ".json.gz", ".jsonl.gz", ".log.gz", ".txt.gz")
"""Ends of the log files of rtl_433; a pipe or a growing file has another one."""

CAN: Final = SourceKind("gateway.vehicle.can_source:open_can_source", file_suffixes=CAN_FILE_SUFFIXES)
NMEA: Final = SourceKind("gateway.vehicle.nmea_source:open_nmea", file_suffixes=NMEA_FILE_SUFFIXES)
RTL433: Final = SourceKind("gateway.vehicle.tire_sensor_source:open_rtl433", file_suffixes=RTL433_FILE_SUFFIXES)
