"""Effects files as commands open them: read, checked against the catalogue of effects and against the vehicle."""

from collections.abc import Sequence
from pathlib import Path

from gateway.config.effects_file import check_effects, load_effects
from gateway.config.vehicle import VehicleConfig
from gateway.signal.effect_correction import CorrectionTable


def open_effects_file(path: Path) -> CorrectionTable:
    """Return the table of an effects file.

    Raises:
        ConfigError: the file cannot be read, is not an effects file, or was edited.
        TreadlinkError: an effect is not in the catalogue, or its parameters are not those of the catalogue or outside
            of their ranges.
    """
    # The catalogue takes longer to import than all that a session without known effects needs.
    from gateway.closure.known_effects import known_effects

    table = load_effects(path)
    known_effects(table, str(path))
    return table


def open_effects(paths: Sequence[Path], vehicle: VehicleConfig | None) -> tuple[CorrectionTable, ...]:
    """Return the tables of effects files; errors as for `open_effects_file`.

    Raises:
        ConfigError: a file does not belong to the vehicle.
    """
    tables = tuple(map(open_effects_file, paths))
    check_effects(tables, vehicle)
    return tables
