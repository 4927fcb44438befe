"""Effects files as sessions open them: read, and checked against the catalogue of effects."""

from pathlib import Path

from gateway.core.revolutions.effect_correction import CorrectionTable
from gateway.diagnosis.effects_file import load_effects
from gateway.diagnosis.known_effects import known_effects


def open_effects_file(path: Path) -> CorrectionTable:
    """Return the table of an effects file.

    Raises:
        ConfigError: the file cannot be read, is not an effects file, or was edited.
        TreadlinkError: an effect is not in the catalogue, or its parameters are not those of the catalogue or outside
            of their ranges.
    """
    table = load_effects(path)
    known_effects(table, str(path))
    return table
