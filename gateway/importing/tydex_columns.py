"""Reader of TYDEX files, release 1.3, by the public description of their sections; run by `reader_process`.

Constants and channels stand in fixed columns: key 1 to 10, comment 11 to 40, unit 41 to 50, then the value of a
constant, or factor and offsets of a channel: physical = factor (measured + first offset) + second offset.
"""

from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import numpy as np

from gateway.core.errors import ImportDataError
from gateway.core.types import FloatArray
from gateway.importing.columns import number_table
from gateway.importing.waveform_columns import Waveform, WaveformColumns

_MISSING: Final = "NOTAVAIL"
_CLOCKS: Final = ("%d.%m.%Y %H:%M:%S", "%d.%m.%Y %H:%M")


class TydexColumns(WaveformColumns):
    """Channels by their keys; a constant with a unit is a column of one value."""

    def __init__(self, path: Path) -> None:
        """Read the file.

        Raises:
            ImportDataError: it lacks channels or data, or a line is no row of numbers.
        """
        super().__init__(path)
        sections: dict[str, list[tuple[int, str]]] = {}
        section: list[tuple[int, str]] = []
        for number, line in enumerate(path.read_text(encoding="latin-1").splitlines(), 1):
            if line.startswith("**"):
                section = sections.setdefault(line[2:].split()[0].upper() if line[2:].strip() else "", [])
            elif line.strip() and not line.startswith("!"):
                section.append((number, line))
        channels = [line for _, line in sections.get("MEASURCHANNELS", [])]
        rows = [(number, line.upper().replace(_MISSING, "nan")) for number, line in sections.get("MEASURDATA", [])]
        if not channels or not rows:
            raise ImportDataError(f"{path} has no **MEASURCHANNELS with **MEASURDATA", "Export it again.")
        if "END" not in sections:
            self.warnings.append("the file is cut: it has no **END")
            rows = rows[:-1] if len(rows[-1][1].split()) < len(channels) else rows
        self._values(channels, rows)
        for _, line in sections.get("CONSTANTS", []):
            key, unit, value = _fields(line)
            with suppress(ValueError):
                constant = np.full(len(rows), float(value))
                if unit.strip("-") and key not in self.waveforms:
                    self._add(key, unit, constant)
        header = dict(_fields(line)[::2] for _, line in sections.get("HEADER", []))
        for clock in _CLOCKS:
            with suppress(ValueError):
                start = datetime.strptime(f"{header.get('DATE')} {header.get('CLCKTIME')}", clock).replace(tzinfo=UTC)
                self.start_ns = int(start.timestamp()) * 1_000_000_000

    def _values(self, channels: list[str], rows: list[tuple[int, str]]) -> None:
        table = number_table(self.path, rows, len(channels))
        for line, measured in zip(channels, table.T, strict=True):
            key, unit, numbers = _fields(line)
            try:
                coefficients = [float(number) for number in numbers.split()[:3]]
                factor, input_offset, output_offset = coefficients + [1.0, 0.0, 0.0][len(coefficients) :]
            except ValueError as error:
                raise ImportDataError(
                    f"{self.path}: channel {key} has no factor of numbers", "Export it again."
                ) from error
            self._add(key, unit, factor * (measured + input_offset) + output_offset)

    def _add(self, key: str, unit: str, values: FloatArray) -> None:
        self.waveforms[key] = Waveform.of(values, "" if unit == "-" else unit)


def _fields(line: str) -> tuple[str, str, str]:
    """Return key, unit and the rest of a line in fixed columns."""
    return line[:10].strip(), line[40:50].strip(), line[50:].strip()
