"""Read a vehicle configuration from TOML."""

from __future__ import annotations

from pathlib import Path

from gateway.config.cross_checks import cross_faults
from gateway.config.validation import parse_document, read_text
from gateway.config.vehicle import VehicleConfig


def load_vehicle(path: Path) -> VehicleConfig:
    """Return the configuration in a file.

    Raises:
        ConfigError: the file cannot be read, or the configuration has faults; the message lists all of them.
    """
    return parse_vehicle(read_text(path, "the configuration"), str(path))


def parse_vehicle(text: str, origin: str) -> VehicleConfig:
    """Return the configuration in a TOML text; `origin` names it in messages.

    Raises:
        ConfigError: naming every fault as `origin: key: value found, what is allowed`.
    """
    return parse_document(VehicleConfig, text, origin, cross_faults)
